"""What a fit found, and all that can be read off it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fit.linear import LinearSolution
from fit.storage import Result, coefficient_columns, count, exact, number, words
from vsh import tables
from vsh.checks.arguments import covariance, float_array
from vsh.coefficients import FIRST_DEGREE, Coefficients
from vsh.field import Field
from vsh.modes import Modes
from vsh.sky.frames import check_frame
from vsh.types import Figure, FloatArray, Kind, Table
from vsh.vector import Vector, correlation_of


class HarmonicSolution(LinearSolution):
    """What a solution for coefficients says, with or without their full covariance.

    Attributes
    ----------
    coefficients : Coefficients
        The best fit. [µas/yr]
    """

    coefficients: Coefficients

    @property
    def modes(self) -> Modes:
        """The Modes that were fitted."""
        return self.coefficients.modes

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, (p,)."""
        return tuple(map(str, self.modes))

    @property
    def values(self) -> FloatArray:
        """The coefficients as an array, (p,). [µas/yr]"""
        return self.coefficients.values

    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a field, (2, n). [µas/yr]"""
        return at_sources(self.coefficients, field)

    @property
    def spin(self) -> Vector:
        """The spin ω of the frame, a Vector. [µas/yr]"""
        return self._vector("T")

    @property
    def acceleration(self) -> Vector:
        """The acceleration ã of the Solar System, in apparent motion, a Vector. [µas/yr]"""
        return self._vector("S")

    def power(self, kind: Kind, l: int, *, debiased: bool = True) -> float:
        """Power of one kind and degree, ∫ |V_l|² dΩ. [(µas/yr)²]

        Noise adds Σ σ² (with the weights of the power) on average; it is taken away
        unless `debiased` is false, so that a small power may come out negative.
        """
        power = self.coefficients.power(kind, l)
        return power - self.noise_power(kind, l) if debiased else power

    def noise_power(self, kind: Kind, l: int) -> float:
        """The power that noise alone gives on average. [(µas/yr)²]"""
        return float(np.trace(self._weighted_covariance(kind, l)))

    def power_error(self, kind: Kind, l: int) -> float:
        """Standard error of the power. [(µas/yr)²]

        For Gaussian errors var(cᵀ W c) = 4 µᵀ W C W µ + 2 tr (W C)², with W the weights 1 and
        2 of the power; µᵀ W C W µ is estimated without bias, and taken for zero where the degree is not
        significant at 5 %: otherwise errors of powers without a signal come out a quarter too large.
        """
        degree = self.modes.slice_of(kind, l)
        wc = self._weighted_covariance(kind, l)
        wcwc = np.trace(wc @ wc)
        wc_c = self._power_weights(l) * self.coefficients.values[degree]
        signal = max(0.0, wc_c @ self.covariance[degree, degree] @ wc_c - wcwc)
        if self.p_value(kind, l) > 0.05:
            signal = 0.0
        return float(np.sqrt(4 * signal + 2 * wcwc))

    def p_value(self, kind: Kind, l: int) -> float:
        """Probability that noise alone gives this degree as much signal or more.

        W̃ = cᵀ C⁻¹ c over the 2l + 1 coefficients is χ² with 2l + 1 degrees of freedom
        when the true ones are zero, however uneven the sky coverage.
        """
        return float(chdtrc(2 * l + 1, self.chi2_of_degree(kind, l)))

    def chi2_of_degree(self, kind: Kind, l: int) -> float:
        """W̃ = cᵀ C⁻¹ c over the coefficients of one kind and degree."""
        degree = self.modes.slice_of(kind, l)
        c = self.coefficients.values[degree]
        return float(c @ np.linalg.solve(self.covariance[degree, degree], c))

    def _vector(self, kind):
        # The rows of FIRST_DEGREE are orthogonal, but not of one length: the inverse, then.
        inverse = np.linalg.inv(FIRST_DEGREE)
        degree = self.modes.slice_of(kind, 1)
        covariance = inverse @ self.covariance[degree, degree] @ inverse.T
        return Vector(inverse @ self.coefficients.values[degree], covariance, self.frame)

    def _weighted_covariance(self, kind, l):
        degree = self.modes.slice_of(kind, l)
        return self._power_weights(l)[:, None] * self.covariance[degree, degree]

    @staticmethod
    def _power_weights(l):
        return np.array([1.0] + 2 * l * [2.0])


@dataclass(frozen=True, eq=False, repr=False)
class Solution(HarmonicSolution):
    """Coefficients with their covariance.

    Attributes
    ----------
    coefficients : Coefficients
        The best fit. [µas/yr]
    covariance : (p, p) array
        N⁻¹, from the catalogue's errors alone, unless `errors_from` says otherwise. [(µas/yr)²]
    chi2 : float
        Of the residuals.
    n_data : int
        How many numbers were fitted: two a source.
    frame : str
        Of the axes.
    notes : tuple of str
        What the reader should know of the data.
    errors_from : str
        Where the covariance comes from, where not from the catalogue's errors alone.
    """

    coefficients: Coefficients
    covariance: np.ndarray
    chi2: float
    n_data: int
    frame: str = "icrs"
    notes: tuple = ()
    errors_from: str = "the catalogue"

    def __repr__(self) -> str:
        return f"<Solution: degree {self.modes.lmax}, {self.n_data // 2} sources, {self.frame}, errors from {self.errors_from}>"

    def report(self, *, check: Any = None, truth: dict[str, Any] | None = None, source: str | None = None) -> str:
        """A page of text, as `fit.report` makes it."""
        from fit.output import report

        return report(self, check, truth, source)

    def plot(self) -> Figure:
        """Power by degree as a matplotlib figure."""
        from fit.output import plot_spectrum

        return plot_spectrum(self)

    def to_table(self) -> Table:
        """The coefficients with their errors as an astropy Table, a row each."""
        columns = coefficient_columns(self.modes) | {"value": self.values, "sigma": self.sigma}
        return tables.table_of(columns, {"frame": self.frame}, dict.fromkeys(("value", "sigma"), "uas / yr"))

    def _repr_html_(self) -> str:
        from fit.output import html_of

        return html_of(self)

    def latex(self) -> str:
        """Spin, acceleration and powers as a LaTeX table (booktabs)."""
        from fit.output import latex_of

        return latex_of(self)

    @property
    def scaled(self) -> Solution:
        """The same solution with errors multiplied by √(χ²/dof) where χ² contradicts them, and only there."""
        factor = self.quality.factor
        if factor == 1.0 or self.errors_from != "the catalogue":
            return self
        return replace(self, covariance=self.covariance * factor**2, errors_from=f"the catalogue, times {factor:.3g}")

    @cached_property
    def sigma(self) -> FloatArray:
        """Standard error of each coefficient, (p,). [µas/yr]"""
        return np.sqrt(np.diag(self.covariance))

    @cached_property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the coefficients, (p, p)."""
        return correlation_of(self.covariance)

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up.

        Raises
        ------
        ParameterError
            If the covariance is none of so many coefficients.
        """
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, len(self.modes)))
        super().__post_init__()

    def _pack(self):
        columns = coefficient_columns(self.modes) | {
            "value": self.coefficients.values, "sigma": self.sigma, "covariance": self.covariance,
        }  # fmt: skip
        rest = {"lmax": self.modes.lmax, "chi2": exact(self.chi2), "n_data": int(self.n_data), "frame": self.frame,
                "notes": list(map(str, self.notes)), "errors_from": self.errors_from}  # fmt: skip
        return columns, rest, dict.fromkeys(("value", "sigma"), "uas / yr") | {"covariance": "uas2 / yr2"}

    @classmethod
    def _unpack(cls, columns, rest):
        float_array("value", columns["value"])
        return cls(*cls._plain(columns, rest))

    @staticmethod
    def _plain(columns, rest):
        """What every solution is made of, in the order of its attributes."""
        coefficients = Coefficients(Modes(rest["lmax"]), columns["value"])
        return (coefficients, columns["covariance"], number(rest["chi2"]), count(rest["n_data"]), check_frame(rest["frame"]),
                words(rest["notes"]), str(rest["errors_from"]))  # fmt: skip


class AboutSolution(Result):
    """A result that tells something about a solution: text, table and figure are the solution's.

    Attributes
    ----------
    solution : Solution
        What it is about.
    """

    solution: Solution

    def report(self) -> str:
        """The solution as text."""
        return self.solution.report()

    def to_table(self) -> Table:
        """The coefficients with their errors as an astropy Table, a row each."""
        return self.solution.to_table()

    def plot(self) -> Figure:
        """Power by degree as a matplotlib figure."""
        return self.solution.plot()


def at_sources(coefficients: Coefficients, field: Field) -> FloatArray:
    """The motions of coefficients at the sources of a field, (2, n); by the transform for many of them."""
    if len(field) < 10_000:
        return coefficients.at(field.lon, field.lat)
    from vsh.transform import synthesis  # ducc0, for many sources only

    return synthesis(coefficients, field.lon, field.lat)
