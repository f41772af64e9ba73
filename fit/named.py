"""Least-squares solutions whose parameters have names of their own, not those of coefficients."""

from dataclasses import dataclass, fields
from typing import Any

from fit.solution import LinearSolution
from fit.storage import count, decoded, encoded
from vsh.io import tables
from vsh.sky.frames import check_frame
from vsh.tools.arguments import covariance, float_array
from vsh.tools.errors import TableError
from vsh.tools.types import FloatArray, Table
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class NamedSolution(LinearSolution):
    """A least-squares solution for named parameters."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    chi2: float
    n_data: int
    frame: str
    notes: tuple = ()

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
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
        rest = {
            entry.name: encoded(getattr(self, entry.name))
            for entry in fields(self)
            if entry.name not in ("names", "values", "covariance")
        }
        return columns, {"fields": rest}, {}

    @classmethod
    def _unpack(cls, columns, rest):
        options = {name: decoded(value) for name, value in rest["fields"].items()}
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
        """Parameters with their errors and correlations as an astropy Table, a row each."""
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma}
        columns |= {f"correlation_{name}": column for name, column in zip(self.names, self.correlation.T, strict=True)}
        return tables.table_of(columns, {"frame": self.frame, "notes": list(map(str, self.notes))})

    def plot(self, *, ax: Any = None) -> Any:  # a link's has panels
        """The correlation matrix of the parameters on matplotlib axes."""
        from fit.output import plot_correlation

        return plot_correlation(self, ax=ax)

    def _vector(self, name, unit="µas/yr"):
        start = self.names.index(f"{name}_x")
        part = slice(start, start + 3)
        return Vector(self.values[part], self.covariance[part, part], self.frame, unit)
