"""What the data say of one amplitude, with the other amplitudes and the scale of the errors marginalised.

Everything is a function of √A, in which the likelihood is smooth down to zero. ln|K| and Q are computed at Chebyshev nodes of
the amplitudes (for one spectrum they are known everywhere) and summed over the others and over κ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import reduce
from typing import Literal, TypeAlias

import numpy as np
from numpy.polynomial import chebyshev

from fit.background._likelihood import Likelihood, Maximum
from vsh.checks.arguments import between, choice
from vsh.checks.frozen import Frozen
from vsh.types import ArrayLike, FloatArray

#: Densities that an amplitude A is given beforehand: 1, A^−½, 1/A.
Prior: TypeAlias = Literal["flat", "root", "log"]
_POWERS = {"flat": 1, "root": 0, "log": -1}
#: How far below its maximum the likelihood is followed: e^−18.
_DROP = 18.0
_POINTS = 401


@dataclass(frozen=True, eq=False)
class Amplitude(Frozen):
    """The likelihood of one amplitude, on a grid.

    Attributes
    ----------
    root : (m,) array
        √A, evenly spaced.
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
            bend = y[i - 1] - 2 * y[i] + y[i + 1]
            return (
                float((x[i] + (x[1] - x[0]) * (y[i - 1] - y[i + 1]) / (2 * bend)) ** 2)
                if bend < 0
                else float(x[i] ** 2)
            )
        return float(x[i] ** 2)

    def likelihood(self, amplitude: ArrayLike) -> FloatArray:
        """L, one at its maximum and nothing beyond the grid.

        Parameters
        ----------
        amplitude : array
            A, not below zero.

        Returns
        -------
        array
        """
        x = np.sqrt(np.asarray(amplitude, float))
        return np.exp(np.interp(x, self.root, self.log_likelihood, left=-np.inf, right=-np.inf))

    def quantile(self, probability: float, prior: Prior = "flat", lowest: float | None = None) -> float:
        """The amplitude below which the true one lies with a probability.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        prior : {"flat", "root", "log"}
            Flat in A, in √A, or in ln A.
        lowest : float, optional
            Where a prior flat in ln A begins; it has no limit otherwise.

        Returns
        -------
        float
        """
        x, mass = self._mass(prior, lowest)
        share = np.r_[0.0, np.cumsum((mass[1:] + mass[:-1]) / 2 * np.diff(x))]
        return float(np.interp(between("probability", probability, 0, 1), share / share[-1], x) ** 2)

    def probability_below(self, amplitude: float, prior: Prior = "flat") -> float:
        """The probability of an amplitude below this one: the rank of a truth.

        Parameters
        ----------
        amplitude : float
            A.
        prior : {"flat", "root"}
            As for `quantile`.

        Returns
        -------
        float
        """
        x, mass = self._mass(prior, None)
        share = np.r_[0.0, np.cumsum((mass[1:] + mass[:-1]) / 2 * np.diff(x))]
        return float(np.interp(np.sqrt(amplitude), x, share / share[-1]))

    def interval(self, probability: float = 0.68, prior: Prior = "flat") -> tuple[float, float]:
        """The likeliest amplitudes that together hold the true one with a probability; from zero where zero is likely.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        prior : {"flat", "root"}
            As for `quantile`.

        Returns
        -------
        tuple of two floats
            Of A.
        """
        x, mass = self._mass(prior, None)
        dense = np.linspace(x[0], x[-1], 8 * len(x))
        mass = np.interp(dense, x, mass)
        order = np.argsort(-self.likelihood(dense**2), kind="stable")
        share = np.cumsum(mass[order]) / mass.sum()
        inside = order[: np.searchsorted(share, between("probability", probability, 0, 1)) + 1]
        return float(dense[inside.min()] ** 2), float(dense[inside.max()] ** 2)

    def _mass(self, prior, lowest):
        """√A and the density of the posterior in it, not normalised."""
        power = _POWERS[choice("prior", prior, tuple(_POWERS))]
        x, density = self.root, np.exp(self.log_likelihood)
        if power >= 0:
            return x, density * x**power
        start = np.sqrt(lowest) if lowest is not None else x[-1] / 1e3
        x = np.geomspace(start, x[-1], 4 * _POINTS)
        return x, np.interp(x, self.root, density, left=density[0]) / x


def posteriors(likelihood: Likelihood, best: Maximum, which: list[int]) -> list[Amplitude]:
    """What the data say of some of the amplitudes, each with all others marginalised.

    Parameters
    ----------
    likelihood : Likelihood
        Of all amplitudes.
    best : Maximum
        Where it is largest.
    which : list of int
        Of which amplitudes.

    Notes
    -----
    The prior of the others is the uniform-shrinkage one, A/(A + u) uniform with u the amplitude seen at one standard error
    (Daniels 1999, Canadian J. Statistics 27, 567); that of κ is 1/κ.
    """
    taus, weights = _scales(likelihood, best)
    spans = [_span(likelihood, best, k) for k in range(len(likelihood))]
    parts = _parts(likelihood, spans, taus)
    found = []
    for k in which:
        target = np.linspace(*spans[k], _POINTS)
        nodes, logs = [target], [np.zeros(_POINTS)]
        for other, (low, high) in enumerate(spans):
            if other != k:
                node, weight = np.polynomial.legendre.leggauss(18)
                x = low + (high - low) * (node + 1) / 2
                u = likelihood.unit[other] * best.noise_scale**2
                nodes.append(x)
                logs.append(np.log(weight * x * u / (u + x**2) ** 2))
        order = [k, *(j for j in range(len(spans)) if j != k)]
        total = np.full([len(x) for x in nodes], -np.inf)
        for tau, weight in zip(taus, weights, strict=True):
            logdet, gain = parts([nodes[order.index(j)] / np.sqrt(tau) for j in range(len(spans))])
            value = np.transpose(likelihood.of_parts(logdet, gain, tau), order)
            total = np.logaddexp(total, value + np.log(weight))
        for axis, log in enumerate(logs):
            total += log.reshape([-1 if axis == j else 1 for j in range(len(nodes))])
        others = tuple(range(1, len(nodes)))
        highest = total.max()
        sums = np.log(np.sum(np.exp(total - highest), others) + 1e-300) if others else total - highest
        found.append(Amplitude(target, np.asarray(sums - sums.max())))
    return found


def _scales(likelihood, best):
    """κ² and the weights of a sum over ln κ²."""
    if not likelihood.noise_scale:
        return np.ones(1), np.ones(1)
    node, weight = np.polynomial.legendre.leggauss(9)
    return best.noise_scale**2 * np.exp(4.5 * node * np.sqrt(2 / likelihood.n_data)), weight


def _span(likelihood, best, k):
    """From where to where √A_k is followed, the others where they are likeliest."""
    tau = best.noise_scale**2
    highest = likelihood.profile(best.amplitudes / tau)

    def fallen(x):
        amplitudes = np.array(best.amplitudes)
        amplitudes[k] = x * x
        return highest - likelihood.profile(amplitudes / tau) > _DROP

    top = np.sqrt(best.amplitudes[k])
    step = np.sqrt(likelihood.unit[k] * tau)
    high = top + step
    while not fallen(high) and high < 1e6 * (top + step):
        high = top + 1.5 * (high - top)
    return (0.0 if not fallen(0.0) else _edge(fallen, 0.0, top)), high


def _edge(fallen, out, inside):
    for _ in range(6):
        middle = (out + inside) / 2
        out, inside = (middle, inside) if fallen(middle) else (out, middle)
    return out


def _parts(likelihood: Likelihood, spans, taus) -> Callable[[list[FloatArray]], tuple[FloatArray, FloatArray]]:
    """ln|K| and Q on the tensor of any √a within the spans: by polynomials, or exactly for one spectrum."""
    if len(spans) == 1:
        return lambda roots: tuple(np.array([likelihood.parts(np.array([x * x])) for x in roots[0]]).T)
    ends = [(low / np.sqrt(taus[-1]), high / np.sqrt(taus[0])) for low, high in spans]
    number = {2: 22, 3: 12}.get(len(spans), 8)
    if len(likelihood.rhs) > 300:  # where the degree is high, amplitudes are known well, and the spans short
        number = min(number, 12)
    node = chebyshev.chebpts1(number)
    axes = [low + (high - low) * (node + 1) / 2 for low, high in ends]
    values = np.empty((2, *[number] * len(spans)))
    for index in np.ndindex(*[number] * len(spans)):
        roots = np.array([axis[i] for axis, i in zip(axes, index, strict=True)])
        values[(slice(None), *index)] = likelihood.parts(roots**2)
    inverse = np.linalg.inv(chebyshev.chebvander(node, number - 1))
    # Contracting the first axis behind the two quantities once for each amplitude comes back to the order of the axes.
    series = reduce(lambda array, _: np.moveaxis(np.tensordot(inverse, array, (1, 1)), 0, -1), spans, values)

    def at(roots):
        array = series
        for x, (low, high) in zip(roots, ends, strict=True):
            vander = chebyshev.chebvander(2 * (x - low) / (high - low) - 1, number - 1)
            array = np.moveaxis(np.tensordot(vander, array, (1, 1)), 0, -1)
        return array[0], array[1]

    return at
