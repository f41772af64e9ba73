"""The likelihood of one amplitude, and what is read off it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.integrate import cumulative_trapezoid

from vsh.checks.arguments import between, choice
from vsh.checks.frozen import Frozen
from vsh.checks.types import ArrayLike, FloatArray

#: Densities that an amplitude A is given beforehand: 1, A^−½, 1/A.
Prior: TypeAlias = Literal["flat", "root", "log"]
_POWERS = {"flat": 1, "root": 0, "log": -1}


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
        """L, one at its maximum and nothing beyond the grid.

        Parameters
        ----------
        amplitude : array
            A, not below zero.
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
        """
        x, share = self._shares(prior, lowest)
        return float(np.interp(between("probability", probability, 0, 1), share, x) ** 2)

    def probability_below(self, amplitude: float, prior: Prior = "flat") -> float:
        """The probability of an amplitude below this one: the rank of a truth.

        Parameters
        ----------
        amplitude : float
            A.
        prior : {"flat", "root"}
            As for `quantile`.
        """
        return float(np.interp(np.sqrt(amplitude), *self._shares(prior)))

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
        x, mass = self._mass(prior)
        dense = np.linspace(x[0], x[-1], 8 * len(x))
        mass = np.interp(dense, x, mass)
        order = np.argsort(-self.likelihood(dense**2), kind="stable")
        share = np.cumsum(mass[order]) / mass.sum()
        inside = order[: np.searchsorted(share, between("probability", probability, 0, 1)) + 1]
        return float(dense[inside.min()] ** 2), float(dense[inside.max()] ** 2)

    def _shares(self, prior, lowest=None):
        """√A and the probability below it."""
        x, mass = self._mass(prior, lowest)
        share = cumulative_trapezoid(mass, x, initial=0)
        return x, share / share[-1]

    def _mass(self, prior, lowest=None):
        """√A and the density of the posterior in it, not normalised."""
        power = _POWERS[choice("prior", prior, tuple(_POWERS))]
        x, density = self.root, np.exp(self.log_likelihood)
        if power >= 0:
            return x, density * x**power
        start = np.sqrt(lowest) if lowest is not None else x[-1] / 1e3
        x = np.geomspace(start, x[-1], 4 * len(self.root))
        return x, np.interp(x, self.root, density, left=density[0]) / x
