"""Student's t over sources: the frame with the heaviness of the tails and the size of the errors found from the data.

The differences of a source, d of them, are independent and of unit variance but for a factor s²/u: s common to all
sources, u of the source, drawn from a Gamma distribution with mean 1 and ν degrees of freedom. That is Student's t in d
dimensions (Lange, Little & Taylor 1989, JASA 84, 881); a source that is a binary has a small u, in all its rows.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.special import gammainc, gammaln, logsumexp

from fit.link._rows import Rows
from vsh.tools.types import FloatArray

#: Degrees of freedom that are tried; the last is as good as a normal distribution.
TAILS = (1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 10.0, 20.0, 50.0, 1e6)
#: Sizes of errors around the best, in errors of its logarithm.
_AROUND = np.arange(-3.0, 3.01)
#: An outlier's errors are so many times the others'.
OUTLIER = 3.0


@dataclass(frozen=True, eq=False)
class Node:
    """The frame at one ν and s: where its posterior is highest, its covariance there, and ln of the evidence."""

    tails: float
    scale: float
    values: FloatArray
    covariance: FloatArray
    evidence: float
    weight: FloatArray
    outlier: FloatArray
    excess: float = 0.0
    across: float = 1.0


def nodes(
    rows: Rows, prior: tuple[FloatArray, FloatArray], tails: Sequence[float] = TAILS, scale: float | None = None
) -> list[Node]:
    """The frame at a grid of ν and of s around the best of each; `scale` is given where it is not sought."""
    d = rows.dims
    values = np.zeros(rows.design.shape[1])
    listed = []
    for nu in reversed(sorted(tails)):
        values, best = _best(rows, prior, nu, values, scale)
        spread = np.sqrt((nu + d.mean() + 2) / nu / (2 * d.sum())) if scale is None else 0.0
        for step in _AROUND if scale is None else (0.0,):
            s = best * np.exp(step * spread)
            values, weight, size = _climb(rows, prior, nu, s, values)
            evidence, covariance = _laplace(rows, prior, nu, s, values, weight, size)
            # Flat in ln s; steps of one error.
            evidence += np.log(spread) if spread else 0.0
            beyond = gammainc((nu + d) / 2, (nu + size / s**2) / 2 / OUTLIER**2)
            listed.append(Node(nu, float(s), values, covariance, evidence, weight, beyond))
    return listed


def mixed(listed: Sequence[Node]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean and covariance of all nodes together, and the probability of each."""
    evidence = np.array([each.evidence for each in listed])
    share = np.exp(evidence - logsumexp(evidence))
    mean = np.sum([w * each.values for w, each in zip(share, listed, strict=True)], axis=0)
    covariance = np.sum(
        [
            w * (each.covariance + np.outer(each.values - mean, each.values - mean))
            for w, each in zip(share, listed, strict=True)
        ],
        axis=0,
    )
    return mean, covariance, share


def _best(rows, prior, nu, values, scale):
    """Frame and size of errors together, for one ν."""
    d = rows.dims
    s = 1.0 if scale is None else scale
    for _ in range(100):
        values, weight, size = _climb(rows, prior, nu, s, values, most=1)
        if scale is not None:
            break
        new = np.sqrt(max(np.sum(weight * s**2 * size) / d.sum(), 1e-300))
        done = abs(np.log(new / s)) < 1e-3
        s = new
        if done:
            break
    return values, s


def _climb(rows, prior, nu, s, values, most=200):
    """The frame of highest posterior by reweighted least squares; weights of sources 1/s² and less, and χ² of each."""
    d, n = rows.dims, len(rows.names)
    matrix0, rhs0 = prior
    for _ in range(most):
        size = np.bincount(rows.source, (rows.rhs - rows.design @ values) ** 2, minlength=n)
        weight = (nu + d) / (nu * s**2 + size)
        weighted = rows.design * weight[rows.source, None]
        matrix = weighted.T @ rows.design + matrix0
        new = cho_solve(cho_factor(matrix), weighted.T @ rows.rhs + rhs0)
        moved = (new - values) @ matrix @ (new - values)
        values = new
        if moved < 1e-10:
            break
    size = np.bincount(rows.source, (rows.rhs - rows.design @ values) ** 2, minlength=n)
    return values, (nu + d) / (nu * s**2 + size), size


def _laplace(rows, prior, nu, s, values, weight, size):
    """ln of the evidence for ν and s, and the covariance, by the curvature where the posterior is highest."""
    d = rows.dims
    matrix0, rhs0 = prior
    residual = rows.rhs - rows.design @ values
    weighted = rows.design * weight[rows.source, None]
    expected = weighted.T @ rows.design + matrix0
    pull = np.zeros((len(rows.names), len(values)))
    np.add.at(pull, rows.source, rows.design * residual[:, None])
    matrix = expected - (pull * (2 * weight**2 / (nu + d))[:, None]).T @ pull
    if np.linalg.eigvalsh(matrix)[0] <= 0.2 * np.linalg.eigvalsh(expected)[0]:  # between two modes
        ratio = (nu + d) / (nu + d + 2) / s**2
        matrix = (rows.design * ratio[rows.source, None]).T @ rows.design + matrix0
    factor = cho_factor(matrix)
    log_likelihood = np.sum(
        gammaln((nu + d) / 2) - gammaln(nu / 2) - d / 2 * np.log(np.pi * nu * s**2)
        - (nu + d) / 2 * np.log1p(size / (nu * s**2))
    )  # fmt: skip
    log_prior = rhs0 @ values - values @ matrix0 @ values / 2
    evidence = log_likelihood + log_prior - np.sum(np.log(np.diag(factor[0])))
    return float(evidence), cho_solve(factor, np.eye(len(values)))
