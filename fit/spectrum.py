"""Power by degree, and how surprising it would be if there were only noise."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np

from fit.quality import Quality, normal_deviate
from vsh import Coefficients, Field, Modes, Vector
from vsh.types import FloatArray, Kind


class HarmonicResult(Protocol):
    """What a spectrum and a report need of a solution."""

    @property
    def modes(self) -> Modes: ...
    @property
    def coefficients(self) -> Coefficients: ...
    @property
    def covariance(self) -> FloatArray: ...
    @property
    def correlation(self) -> FloatArray: ...
    @property
    def spin(self) -> Vector: ...
    @property
    def acceleration(self) -> Vector: ...
    @property
    def chi2(self) -> float: ...
    @property
    def reduced_chi2(self) -> float: ...
    @property
    def dof(self) -> int: ...
    @property
    def quality(self) -> Quality: ...
    @property
    def n_data(self) -> int: ...
    @property
    def frame(self) -> str: ...
    @property
    def notes(self) -> tuple[str, ...]: ...
    @property
    def errors_from(self) -> str: ...
    @property
    def scaled(self) -> HarmonicResult: ...
    def noise_power(self, kind: Kind, l: int) -> float: ...
    def power_error(self, kind: Kind, l: int) -> float: ...
    def p_value(self, kind: Kind, l: int) -> float: ...
    def chi2_of_degree(self, kind: Kind, l: int) -> float: ...
    def residuals(self, field: Field) -> Field: ...


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
        return self.power - self.noise


def spectrum(solution: HarmonicResult) -> list[Degree]:
    """Every kind and degree of a solution, a list of Degree: T first, then S."""
    return [_degree(solution, kind, l) for kind in "TS" for l in range(1, solution.modes.lmax + 1)]


def wilson_hilferty(w: float, n: float) -> float:
    """Z = √(9n/2) [(W/n)^⅓ − (1 − 2/(9n))]: nearly normal when W is χ² with n degrees of freedom.

    >>> round(float(wilson_hilferty(12, 3)), 4)
    2.4304
    """
    return np.sqrt(4.5 * n) * (np.cbrt(w / n) - (1 - 2 / (9 * n)))


def _degree(solution, kind, l):
    n = 2 * l + 1
    w = solution.chi2_of_degree(kind, l)
    zonal = solution.modes.slice_of(kind, l).start
    power = solution.coefficients.power(kind, l)
    mk_w = power / solution.covariance[zonal, zonal]
    return Degree(
        kind,
        l,
        power,
        solution.noise_power(kind, l),
        solution.power_error(kind, l),
        solution.p_value(kind, l),
        float(normal_deviate(w, n)),
        float(mk_w),
        float(wilson_hilferty(mk_w, n)),
    )
