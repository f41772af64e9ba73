"""Power by degree, and how surprising it would be if there were only noise."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np
from scipy.special import ndtri

from fit.quality import Quality, normal_deviate
from vsh import Coefficients, Field, Modes, Vector
from vsh.modes import KINDS
from vsh.types import FloatArray, Kind

__all__ = [
    "Degree",
    "HarmonicResult",
    "spectrum",
    "wilson_hilferty",
]


class HarmonicResult(Protocol):
    """What a spectrum and a report need of a solution."""

    @property
    def modes(self) -> Modes:
        """The Modes that were fitted."""

    @property
    def coefficients(self) -> Coefficients:
        """The best fit. [µas/yr]"""

    @property
    def covariance(self) -> FloatArray:
        """Of the coefficients, (p, p). [(µas/yr)²]"""

    @property
    def correlation(self) -> FloatArray:
        """Of the coefficients, (p, p)."""

    @property
    def spin(self) -> Vector:
        """ω. [µas/yr]"""

    @property
    def acceleration(self) -> Vector:
        """ã. [µas/yr]"""

    @property
    def chi2(self) -> float:
        """Of the residuals."""

    @property
    def reduced_chi2(self) -> float:
        """χ² per degree of freedom."""

    @property
    def dof(self) -> int:
        """Degrees of freedom."""

    @property
    def quality(self) -> Quality:
        """What χ² says of the errors."""

    @property
    def n_data(self) -> int:
        """Data points: two a source."""

    @property
    def frame(self) -> str:
        """Of the axes."""

    @property
    def notes(self) -> tuple[str, ...]:
        """What the reader should know of the data."""

    @property
    def covariance_dof(self) -> float:
        """With how many degrees of freedom the covariance was estimated; inf where it was not."""

    @property
    def errors_from(self) -> str:
        """Where the covariance comes from."""

    @property
    def scaled(self) -> HarmonicResult:
        """The same with errors scaled where χ² asks for it."""

    def noise_power(self, kind: Kind, l: int) -> float:
        """The power that noise alone gives on average.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        float
        """

    def power_error(self, kind: Kind, l: int) -> float:
        """Standard error of the power.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        float
        """

    def p_value(self, kind: Kind, l: int) -> float:
        """Of as much signal from noise alone.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        float
        """

    def chi2_of_degree(self, kind: Kind, l: int) -> float:
        """cᵀ C⁻¹ c of one kind and degree.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        float
        """

    def residuals(self, field: Field) -> Field:
        """The field less the fit.

        Parameters
        ----------
        field : Field
            In the frame of the solution.

        Returns
        -------
        Field
        """


class Degree(NamedTuple):
    """One kind and degree of a solution.

    `power` is as fitted, `noise` what noise alone gives on average, `error` the standard
    error [(µas/yr)²]; `p_value` the exact probability of as much signal from noise and `z` the
    same as a one-sided normal deviate; `mk_w` and `mk_z` the W and Z of Mignard & Klioner
    (2012, sect. 5.2), which hold for a uniform sky only.
    """

    kind: str
    l: int
    power: float
    noise: float
    error: float
    p_value: float
    z: float
    mk_w: float
    mk_z: float

    @property
    def debiased(self) -> float:
        """Power less what noise gives on average. [(µas/yr)²]"""
        return self.power - self.noise


def spectrum(solution: HarmonicResult) -> list[Degree]:
    """Every kind and degree of a solution, a list of Degree: T first, then S.

    Parameters
    ----------
    solution : Solution
        What was found.

    Returns
    -------
    list[Degree]
    """
    return [_degree(solution, kind, l) for kind in KINDS for l in range(1, solution.modes.lmax + 1)]


def wilson_hilferty(w: float, n: float) -> float:
    """Z = √(9n/2) [(W/n)^⅓ − (1 − 2/(9n))]: nearly normal when W is χ² with n degrees of freedom.

    Parameters
    ----------
    w : float
        W.
    n : float
        Degrees of freedom.

    Returns
    -------
    float

    Examples
    --------
    >>> round(float(wilson_hilferty(12, 3)), 4)
    2.4304
    """
    return np.sqrt(4.5 * n) * (np.cbrt(w / n) - (1 - 2 / (9 * n)))


def _degree(solution, kind, l):
    n = 2 * l + 1
    w = solution.chi2_of_degree(kind, l)
    p_value = solution.p_value(kind, l)
    zonal = solution.modes.slice_of(kind, l).start
    power = solution.coefficients.power(kind, l)
    mk_w = power / solution.covariance[zonal, zonal]
    return Degree(
        kind,
        l,
        power,
        solution.noise_power(kind, l),
        solution.power_error(kind, l),
        p_value,
        _deviate(solution, w, n, p_value),
        float(mk_w),
        float(wilson_hilferty(mk_w, n)),
    )


def _deviate(solution, w, n, p_value):
    """z of the p-value; from χ² itself where there is one, since p rounds to 0 and 1."""
    if np.isinf(solution.covariance_dof):
        return float(normal_deviate(w, n))
    return float(-ndtri(p_value))
