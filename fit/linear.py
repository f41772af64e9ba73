"""What all linear least-squares solutions have in common, and those whose parameters have names."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.quality import Quality
from fit.storage import Result, count, exact, number
from vsh import tables
from vsh.checks.arrays import covariance, float_array
from vsh.errors import TableError
from vsh.field import Field
from vsh.sky.frames import check_frame
from vsh.types import Figure, FloatArray, Table
from vsh.vector import Vector, correlation_of


class LinearSolution(Result):
    """A least-squares solution: parameters with a covariance, and how well they fit.

    Attributes
    ----------
    names : tuple of str
        Of the parameters.
    values : (p,) array
        The parameters.
    covariance : (p, p) array
        Of the parameters, in the order of `names`.
    chi2 : float
        Of the residuals.
    n_data : int
        Data points: two a source.
    frame : str
        Of the axes.
    notes : tuple of str
        What the reader should know of the data.
    """

    names: Any
    values: Any
    covariance: Any
    chi2: float
    n_data: int
    frame: str
    notes: tuple[str, ...]

    @abstractmethod
    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a field, (2, n). [µas/yr]

        Parameters
        ----------
        field : Field
            In the frame of the solution.

        Returns
        -------
        FloatArray
        """

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each parameter, (p,)."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the parameters, (p, p)."""
        return correlation_of(self.covariance)

    @property
    def dof(self) -> int:
        """Degrees of freedom: data points less parameters."""
        return self.n_data - len(self.names)

    @property
    def quality(self) -> Quality:
        """What χ² says of the errors, a `fit.quality.Quality`."""
        return Quality(self.chi2, self.dof)

    @property
    def reduced_chi2(self) -> float:
        """χ² per degree of freedom; nan where there is none."""
        return self.quality.reduced

    def residuals(self, field: Field) -> Field:
        """The field less the model: a Field, whose `chi2` is that of each source.

        Its `.whitened` are the residuals decorrelated and in units of their errors.

        Parameters
        ----------
        field : Field
            In the frame of the solution.

        Returns
        -------
        Field

        Raises
        ------
        FrameError
            If the field is in another frame.
        """
        field.check_frame(self.frame)
        return field.minus(self.model(field))


@dataclass(frozen=True, eq=False)
class NamedSolution(LinearSolution):
    """A least-squares solution for named parameters.

    Attributes
    ----------
    names : tuple of str
    values : (p,) array
        In the order of `names`.
    covariance : (p, p) array
    chi2 : float
    n_data : int
        Two a source.
    frame : str
        Of the axes.
    notes : tuple of str
        What the reader should know of the data.
    """

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    chi2: float
    n_data: int
    frame: str
    notes: tuple = ()

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up.

        Raises
        ------
        ParameterError
            If values or covariance do not go with the names.
        """
        size = len(self.names)
        object.__setattr__(self, "values", float_array("the values", self.values, (size,), finite=False))
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, size))
        super().__post_init__()

    def _pack(self):
        columns = {
            "parameter": list(self.names),
            "value": self.values,
            "sigma": self.sigma,
            "covariance": self.covariance,
        }
        rest = {name: _packed(getattr(self, name)) for name in self.__dataclass_fields__
                if name not in ("names", "values", "covariance")}  # fmt: skip
        return columns, rest, {}

    @classmethod
    def _unpack(cls, columns, rest):
        options = {name: _unpacked(rest[name]) for name in cls.__dataclass_fields__ if name in rest}
        options["n_data"], options["frame"] = count(options["n_data"]), check_frame(options["frame"])
        names = tuple(columns["parameter"].tolist())
        if len(set(names)) < len(names):
            raise TableError("names of parameters repeat")
        return cls(names=names, values=columns["value"], covariance=columns["covariance"], **options)

    @property
    def spin(self) -> Vector | None:
        """ω, a Vector in µas/yr, or None where it is not among the parameters."""
        return self._vector("omega") if "omega_x" in self.names else None

    @property
    def acceleration(self) -> Vector:
        """ã, a Vector in µas/yr."""
        return self._vector("a")

    def to_table(self) -> Table:
        """Parameters with their errors and correlations as an astropy Table, a row each.

        Returns
        -------
        Table
        """
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma}
        columns |= {f"correlation_{name}": column for name, column in zip(self.names, self.correlation.T, strict=True)}
        return tables.table_of(columns, {"frame": self.frame, "notes": list(map(str, self.notes))})

    def plot(self) -> Figure:
        """The correlation matrix of the parameters as a matplotlib figure.

        Returns
        -------
        Figure
        """
        from fit.output import plot_correlation

        return plot_correlation(self)

    def _vector(self, name, unit="µas/yr"):
        start = self.names.index(f"{name}_x")
        part = slice(start, start + 3)
        return Vector(self.values[part], self.covariance[part, part], self.frame, unit)


def _packed(value):
    """A plain value, to the last bit."""
    if isinstance(value, Vector):
        return {"value": list(map(exact, value.value)), "covariance": [list(map(exact, row)) for row in value.covariance],
                "frame": value.frame, "unit": value.unit}  # fmt: skip
    if isinstance(value, (float, np.floating)):
        return exact(value)
    return list(map(str, value)) if isinstance(value, tuple) else value


def _unpacked(value):
    if isinstance(value, dict):
        three = [number(x) for x in value["value"]]
        return Vector(
            three, [[number(x) for x in row] for row in value["covariance"]], value["frame"], str(value["unit"])
        )
    if isinstance(value, list):
        return tuple(map(str, value))
    is_hex = isinstance(value, str) and value.lstrip("-").startswith(("0x", "nan", "inf"))
    return number(value) if is_hex else value
