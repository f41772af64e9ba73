"""Amplitudes of backgrounds, by their marginal likelihood.

What the data say of one amplitude, with the other amplitudes and the scale of the errors marginalised.

Everything is a function of √A, in which the likelihood is smooth down to zero. ln|K| and Q are computed at Chebyshev
nodes of the amplitudes (for one spectrum they are known everywhere) and summed over the others and over κ.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Literal, TypeAlias

import numpy as np
from scipy.special import gammaln

from fit.background._likelihood import Likelihood, Maximum, find_root_span, make_gauss_nodes, make_tau_nodes
from vsh.tools.arguments import between, choice, positive
from vsh.tools.notebook import Frozen
from vsh.tools.parallel import limit_blas
from vsh.tools.types import ArrayLike, FloatArray

#: Densities that an amplitude A is given a priori: 1, A^−½, 1/A.
Prior: TypeAlias = Literal["flat", "root", "log"]
_PRIOR_EXPONENTS = {"flat": 1, "root": 0, "log": -1}


def integrate_cumulatively(y: FloatArray, x: FloatArray) -> FloatArray:
    """The integral of y from x[0] to each x."""
    return np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])


@dataclass(frozen=True, eq=False)
class Amplitude(Frozen):
    """The likelihood of one amplitude, on a grid.

    Attributes
    ----------
    root : (m,) array
        √A, rising, closer to each other towards zero.
    log_likelihood : (m,) array
        Its largest value is zero.
    """

    root: FloatArray
    log_likelihood: FloatArray

    @property
    def maximum(self) -> float:
        """The likeliest amplitude, by a parabola through the three highest points."""
        i, x, y = int(np.argmax(self.log_likelihood)), self.root, self.log_likelihood
        if 0 < i < len(x) - 1:
            bend, slope, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
            return float((x[i] - slope / (2 * bend)) ** 2) if bend < 0 else float(x[i] ** 2)
        return float(x[i] ** 2)

    def likelihood(self, amplitude: ArrayLike) -> FloatArray:
        """Likelihood of an `amplitude` ≥ 0, scaled to one at its maximum; zero outside the grid."""
        root = np.sqrt(np.asarray(amplitude, float))
        return np.exp(np.interp(root, self.root, self.log_likelihood, left=-np.inf, right=-np.inf))

    def quantile(self, probability: float, prior: Prior = "flat", lowest: float | None = None) -> float:
        """Quantile of the posterior: the true amplitude is below it with the given probability.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        prior : {"flat", "root", "log"}
            Flat in A, in √A, or in ln A.
        lowest : float, optional
            Where a prior flat in ln A begins; a millionth of the largest A unless given.
        """
        root, probability_below = self._integrate_posterior(prior, lowest)
        return float(np.interp(between("probability", probability, 0, 1), probability_below, root) ** 2)

    def mean(self, prior: Prior = "flat") -> float:
        """The mean amplitude, with the `prior` of `quantile`."""
        root, density = self._compute_posterior_density(prior)
        return float(integrate_cumulatively(density * root**2, root)[-1] / integrate_cumulatively(density, root)[-1])

    def interval(self, probability: float = 0.68, prior: Prior = "flat") -> tuple[float, float]:
        """The likeliest amplitudes that hold the true one with `probability`, with the `prior` of `quantile`.

        Returns
        -------
        tuple of two floats
            Lower and upper limit of A.
        """
        root, density = self._compute_posterior_density(prior)
        fine_root = np.linspace(root[0], root[-1], 8 * len(root))
        fine_density = np.interp(fine_root, root, density)
        likeliest_first = np.argsort(-self.likelihood(fine_root**2), kind="stable")
        cumulative = np.cumsum(fine_density[likeliest_first]) / fine_density.sum()
        inside = likeliest_first[: np.searchsorted(cumulative, between("probability", probability, 0, 1)) + 1]
        return float(fine_root[inside.min()] ** 2), float(fine_root[inside.max()] ** 2)

    def _integrate_posterior(self, prior, lowest=None):
        """√A and the probability below it."""
        root, density = self._compute_posterior_density(prior, lowest)
        probability_below = integrate_cumulatively(density, root)
        return root, probability_below / probability_below[-1]

    def _compute_posterior_density(self, prior, lowest=None):
        """√A and the density of the posterior in it, not normalised."""
        exponent = _PRIOR_EXPONENTS[choice("prior", prior, tuple(_PRIOR_EXPONENTS))]
        root, density = self.root, np.exp(self.log_likelihood)
        if exponent >= 0:
            return root, density * root**exponent
        lowest_root = np.sqrt(positive("lowest", lowest)) if lowest is not None else root[-1] / 1e3
        root = np.geomspace(lowest_root, root[-1], 4 * len(self.root))
        return root, np.interp(root, self.root, density, left=density[0]) / root


_N_ROOTS = 401


def compute_posteriors_and_evidence(
    likelihood: Likelihood, maximum: Maximum, indices: Sequence[int] | None = None
) -> tuple[list[Amplitude], float]:
    """Posterior of each amplitude, all others marginalised, and ln of the evidence relative to no background.

    Notes
    -----
    The prior of the others is the uniform-shrinkage one, A/(A + u) uniform with u the amplitude seen at one standard
    error (Daniels 1999, Canadian J. Statistics 27, 567); that of κ is 1/κ. The evidence is the mean likelihood.
    """
    with limit_blas(len(likelihood.rhs)):
        grid = _AmplitudeGrid(likelihood, maximum)
    pairs = [grid.marginalise_others(k) for k in (range(len(likelihood)) if indices is None else indices)]
    return [amplitude for amplitude, _ in pairs], pairs[0][1]


class _AmplitudeGrid:
    """ln|K| and Q over all amplitudes of interest, and the sums over them."""

    def __init__(self, likelihood: Likelihood, maximum: Maximum) -> None:
        self.likelihood, self.maximum = likelihood, maximum
        self.tau_nodes, self.tau_weights = make_tau_nodes(likelihood, maximum)
        self.root_spans = [find_root_span(likelihood, maximum, k) for k in range(len(likelihood))]
        self.interpolate_logdet_and_gain = likelihood.make_interpolator(self.root_spans, self.tau_nodes)

    def marginalise_others(self, k: int) -> tuple[Amplitude, float]:
        """Amplitude k with all others marginalised, and the evidence."""
        roots = {k: self._find_unit(k) * np.sinh(np.linspace(self._find_span(k)[0], self._find_span(k)[1], _N_ROOTS))}
        axis_order = [k, *(j for j in range(len(self.root_spans)) if j != k)]
        axis_weights = []
        for j in axis_order[1:]:
            y, weight = make_gauss_nodes(24, *self._find_span(j))
            roots[j] = self._find_unit(j) * np.sinh(y)
            axis_weights.append(weight * self._find_unit(j) * np.cosh(y) * self._compute_shrinkage_prior(j, roots[j]))
        log_likelihoods = []
        for tau, weight in zip(self.tau_nodes, self.tau_weights, strict=True):
            logdet, gain = self.interpolate_logdet_and_gain([roots[j] / np.sqrt(tau) for j in sorted(roots)])
            log_likelihoods.append(self.likelihood.combine(logdet, gain, tau) + np.log(weight))
        highest_log_likelihood = np.max(log_likelihoods)
        likelihood = np.transpose(np.exp(log_likelihoods - highest_log_likelihood).sum(0), axis_order)
        # Contracting the last axis first, the target stays.
        marginal = reduce(np.matmul, reversed(axis_weights), likelihood)
        root = roots[k]
        integral = integrate_cumulatively(marginal * self._compute_shrinkage_prior(k, root), root)[-1]
        evidence = float(np.log(integral) + highest_log_likelihood) - self._compute_log_evidence_without_background()
        log_likelihood = np.log(marginal + 1e-300)
        return Amplitude(root, log_likelihood - log_likelihood.max()), evidence

    def _find_unit(self, k):
        """√A of the amplitude that is seen at one standard error."""
        return np.sqrt(self.likelihood.unit[k]) * self.maximum.noise_scale

    def _find_span(self, k):
        """The span by y = arsinh √(A/u), which resolves what is next to zero and what is far from it."""
        return np.arcsinh(np.array(self.root_spans[k]) / self._find_unit(k))

    def _compute_shrinkage_prior(self, k, root):
        u = self._find_unit(k) ** 2
        return 2 * root * u / (u + root**2) ** 2

    def _compute_log_evidence_without_background(self):
        """ln of the likelihood of no background, summed over κ alike."""
        if not self.likelihood.noise_scale:
            return float(self.likelihood.combine(0.0, 0.0, 1.0))
        half_n, half_chi2 = self.likelihood.n_data / 2, self.likelihood.chi2 / 2
        return float(gammaln(half_n) - half_n * np.log(half_chi2))
