"""What a fit found, and all that can be read off it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.harmonic import HarmonicSolution
from fit.storage import Result, coefficient_columns, count, decoded, encoded, exact, number, words
from vsh import tables
from vsh.checks.arrays import covariance, float_array
from vsh.checks.types import FloatArray, Kind, Table
from vsh.coefficients import Coefficients
from vsh.scalars import DIPOLE, ScalarCoefficients
from vsh.sky.frames import check_frame
from vsh.vector import Vector


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
        Of the residuals of the data, without the penalty of a prior.
    n_data : int
        How many numbers were fitted: two a source. A prior does not count.
    frame : str
        Of the axes.
    notes : tuple of str
        What the reader should know of the data.
    errors_from : str
        Where the covariance comes from, where not from the catalogue's errors alone.
    covariance_dof : float
        Degrees of freedom with which the covariance was estimated; inf where it follows from the errors of the
        sources, the number of replicates less one where it was resampled. p-values allow for them.
    by_prior : float
        How many of the coefficients a prior determined in place of the data, tr(C P) with P its inverse covariance;
        the others cost a degree of freedom each.
    unshrunk : Solution or None
        The same without the prior of a floor: what the powers and p-values of degrees beyond 1 are taken from.
    unit : str
        Of the coefficients: "µas/yr" of motions, "µas" of differences of position.
    """

    coefficients: Coefficients
    covariance: FloatArray
    chi2: float
    n_data: int
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    errors_from: str = "the catalogue"
    covariance_dof: float = float("inf")
    by_prior: float = 0.0
    unshrunk: Solution | None = None
    unit: str = "µas/yr"

    _coefficients = Coefficients

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: degree {self.modes.lmax}, {self.n_sources} sources, {self.frame}, errors from {self.errors_from}>"

    def report(self, *, check: Any = None, truth: dict[str, Any] | None = None, source: str | None = None) -> str:
        """A page of text, as `fit.report` makes it.

        Parameters
        ----------
        check : CrossCheck, optional
            Both solvers at degree 1.
        truth : dict, optional
            Of a simulated catalogue, by name.
        source : str, optional
            What was fitted.
        """
        from fit.output import report

        return report(self, check=check, truth=truth, source=source)

    def plot(self, *, ax: Any = None) -> Any:
        """Power by degree on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.output import plot_spectrum

        return plot_spectrum(self, ax=ax)

    def to_table(self) -> Table:
        """The coefficients with their errors as an astropy Table, a row each."""
        columns = coefficient_columns(self.modes) | {"value": self.values, "sigma": self.sigma}
        return tables.table_of(
            columns, {"frame": self.frame}, {name: self._units[name] for name in ("value", "sigma") if self._units}
        )

    def _repr_html_(self) -> str:
        from fit.output import html_of

        return html_of(self)

    def latex(self) -> str:
        """Spin, acceleration and powers as a LaTeX table (booktabs)."""
        from fit.output import latex_of

        return latex_of(self)

    def of_degree(self, kind: Kind, l: int) -> tuple[FloatArray, FloatArray]:
        """Coefficients of one kind and degree with their covariance: what its power and p-value are of.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree; beyond 1, of the solution without the prior of a floor, if there is one.

        Returns
        -------
        tuple[array, array]
            [µas/yr], [(µas/yr)²]
        """
        if self.unshrunk is not None and l > 1:
            return self.unshrunk.of_degree(kind, l)
        return super().of_degree(kind, l)

    @property
    def dof(self) -> int:
        """Degrees of freedom of χ²: data points less the parameters that they determined, rounded where a prior helped."""
        return self.n_data - len(self.modes) + round(self.by_prior)

    @property
    def scaled(self) -> Solution:
        """The same solution with errors multiplied by √(χ²/dof) where χ² contradicts them, and only there."""
        factor = self.quality.factor
        if factor == 1.0 or self.errors_from != "the catalogue":
            return self
        return replace(self, covariance=self.covariance * factor**2, errors_from=f"the catalogue, times {factor:.3g}")

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, len(self.modes)))
        super().__post_init__()

    def _pack(self):
        columns = coefficient_columns(self.modes) | {
            "value": self.coefficients.values, "sigma": self.sigma, "covariance": self.covariance,
        }  # fmt: skip
        rest = {"lmax": self.modes.lmax, "chi2": exact(self.chi2), "n_data": int(self.n_data), "frame": self.frame,
                "notes": list(map(str, self.notes)), "errors_from": self.errors_from,
                "covariance_dof": exact(self.covariance_dof), "by_prior": exact(self.by_prior), "unshrunk": encoded(self.unshrunk),
                "unit": self.unit}  # fmt: skip
        return columns, rest, self._units

    @property
    def _units(self):
        """Of the columns, where they are ones that tables know."""
        known = {"µas/yr": ("uas / yr", "uas2 / yr2"), "µas": ("uas", "uas2")}
        if self.unit not in known:
            return {}
        one, squared = known[self.unit]
        return {"value": one, "sigma": one, "covariance": squared}

    @classmethod
    def _unpack(cls, columns, rest):
        float_array("value", columns["value"])
        return cls(*cls._plain(columns, rest))

    @classmethod
    def _plain(cls, columns, rest):
        """What every solution is made of, in the order of its attributes."""
        coefficients = cls._coefficients(rest["lmax"], columns["value"])
        return (coefficients, columns["covariance"], number(rest["chi2"]), count(rest["n_data"]), check_frame(rest["frame"]),
                words(rest["notes"]), str(rest["errors_from"]), number(rest["covariance_dof"]), number(rest["by_prior"]), decoded(rest["unshrunk"]),
                str(rest["unit"]))  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False)
class ScalarSolution(Solution):
    """Coefficients of a scalar field with their covariance.

    Attributes
    ----------
    coefficients : ScalarCoefficients
        The best fit. [`unit`]
    covariance : (p, p) array
        As of a `Solution`. [the square of `unit`]
    n_data : int
        How many numbers were fitted: one a source.
    unit : str
        Of the values; "" of pure numbers.
    chi2, frame, notes, errors_from, covariance_dof, by_prior, unshrunk
        As of a `Solution`.
    """

    unit: str = ""

    _coefficients = ScalarCoefficients

    @property
    def mean(self) -> tuple[float, float]:
        """The mean over the sky with its standard error, f_00/√4π; of a fit of degree 0 the weighted mean of the sources."""
        value, variance = self.coefficients.values[0], self.covariance[0, 0]
        return float(value / np.sqrt(4 * np.pi)), float(np.sqrt(variance / (4 * np.pi)))

    @property
    def dipole(self) -> Vector:
        """d of the part d·r, a Vector in `unit`."""
        return self._first_degree("F", DIPOLE, self.unit)

    def _repr_html_(self) -> str:
        return Result._repr_html_(self)


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

    def plot(self, *, ax: Any = None) -> Any:
        """Power by degree on matplotlib axes."""
        return self.solution.plot(ax=ax)
