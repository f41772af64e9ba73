"""What is known of a frame from elsewhere: binaries, clusters, quasars."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from fit.link._unknowns import VECTORS
from vsh.io import tables
from vsh.io.catalogue import missing_column, unit_factor
from vsh.tools.arguments import choice, covariance, float_array
from vsh.tools.bad_rows import as_floats
from vsh.tools.errors import TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray


@dataclass(frozen=True, eq=False)
class LinkPrior(InNotebook):
    """Orientation or spin of a catalogue at a magnitude, from elsewhere.

    Attributes
    ----------
    vector : str
        "orientation", "spin" or "acceleration".
    value : (3,) array
        [µas or µas/yr]
    covariance : (3, 3) array
    magnitude, colour : float, optional
        Those of the sources it is from; of the brightest, without steps and powers, unless given.
    catalogue : str, optional
        Whose; of the one that is turned unless given.
    """

    vector: str
    value: FloatArray
    covariance: FloatArray = field(repr=False)
    magnitude: float | None = None
    colour: float | None = None
    catalogue: str | None = None

    def __post_init__(self) -> None:
        """Check what a caller may have mixed up."""
        choice("vector", self.vector, tuple(VECTORS))
        object.__setattr__(self, "value", float_array("the value of a prior", self.value, (3,)))
        object.__setattr__(self, "covariance", covariance("the covariance of a prior", self.covariance, 3))


def read_priors(source: Any) -> list[LinkPrior]:
    """Read priors from a table, a row each.

    Parameters
    ----------
    source : path, or table
        Columns `x`, `y`, `z`, `x_error` …, and where known `x_y_corr`, `x_z_corr`, `y_z_corr`, `vector` ("spin" unless
        given), `magnitude`, `colour`, `catalogue`; in µas and µas/yr where the table does not say.

    Raises
    ------
    TableError
        If a column is missing.
    ParameterError
        If a row has an error that is none.
    """
    opened = tables.open_table(source)
    for name in (*"xyz", *(f"{axis}_error" for axis in "xyz")):
        if name not in opened.names:
            raise TableError(f"{opened.label}: {missing_column(name, opened)}")
    data = {name: _numbers(opened, name) for name in opened.names if name in _NUMBERS}
    words = {name: np.asarray(opened.columns((name,))[name][0]).astype(str) for name in _WORDS if name in opened.names}
    priors = []
    for row in range(len(data["x"])):
        unit = "uas" if words.get("vector", ["spin"] * (row + 1))[row] == "orientation" else "uas / yr"

        def number(name, row=row, unit=unit):
            factor = (
                unit_factor(name, opened.units.get(name), unit) if name[:1] in "xyz" and "corr" not in name else 1.0
            )
            return float(data[name][row]) * factor if name in data else 0.0

        sigma = np.array([number(f"{axis}_error") for axis in "xyz"])
        matrix = np.eye(3)
        for name, (i, j) in {"x_y_corr": (0, 1), "x_z_corr": (0, 2), "y_z_corr": (1, 2)}.items():
            matrix[i, j] = matrix[j, i] = number(name)
        known = {name: float(data[name][row]) for name in ("magnitude", "colour") if name in data}
        known = {name: value for name, value in known.items() if np.isfinite(value)}
        priors.append(
            LinkPrior(
                str(words["vector"][row]) if "vector" in words else "spin",
                np.array([number(axis) for axis in "xyz"]),
                matrix * np.outer(sigma, sigma),
                catalogue=str(words["catalogue"][row]) if "catalogue" in words else None,
                **known,
            )
        )
    return priors


_NUMBERS = (*"xyz", *(f"{axis}_error" for axis in "xyz"), "x_y_corr", "x_z_corr", "y_z_corr", "magnitude", "colour")
_WORDS = ("vector", "catalogue")


def _numbers(opened, name):
    """A column, nan where nothing is."""
    values, mask = opened.columns((name,))[name]
    floats, missing = as_floats(name, values)
    return np.where(missing if mask is None else missing | np.asarray(mask, bool), np.nan, floats)
