"""Quasars of a file in Gaia's columns, with what subsets are chosen by."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vsh import Field, tables
from vsh.archive import DR3, DR4
from vsh.catalogue import Columns, missing_column, read_field
from vsh.checks.notebook import InNotebook
from vsh.checks.types import BoolArray, FloatArray
from vsh.errors import TableError
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import angles, triad

_NEEDED = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
_FURTHER = ("pmra_pmdec_corr", "phot_g_mean_mag", "nu_eff_used_in_astrometry", "used_for_reference_frame_spin")
#: Fewer sources say nothing.
FEWEST = 100
#: Inside |sin b| = 0.1 stars hide among the quasars.
PLANE = 0.1


@dataclass(frozen=True, eq=False)
class Sources(InNotebook):
    """Sources that can be used.

    Attributes
    ----------
    field : Field
        Their motions, ICRS.
    six : (n,) bool array
        Which have six-parameter solutions; the others have five.
    wavenumber : (n,) array or None
        Effective, of those with five. [µm⁻¹]
    for_spin : (n,) bool array or None
        Which the release used for the spin of its frame.
    label : str
        Of the file.
    """

    field: Field
    six: BoolArray
    wavenumber: FloatArray | None
    for_spin: BoolArray | None
    label: str


def read_gaia(path: Any) -> Sources:
    """Read quasars from a file in the columns of Gaia's archive.

    Parameters
    ----------
    path : path or table
        Of `vsh-archive gaia-crf3`, or of `vsh-sim crf3`.

    Returns
    -------
    Sources
        Without those that are no single sources or cannot be used otherwise; notes of its field count them.

    Raises
    ------
    TableError
        If a column is missing.
    FieldError
        If no source can be used.
    """
    opened = tables.open_table(path)
    for name in _NEEDED:
        if name not in opened.names:
            raise TableError(f"{opened.label}: {missing_column(name, opened)}")
    solution = next((name for name in (DR4.solution, DR3.solution) if name in opened.names), None)
    wanted = [*_NEEDED, *(name for name in _FURTHER if name in opened.names), *([solution] if solution else [])]
    found = opened.columns(wanted)
    table = {name: np.ma.MaskedArray(values, False if mask is None else mask) for name, (values, mask) in found.items()}
    rows = np.arange(len(table["ra"]))
    units = {name: unit for name, unit in opened.units.items() if name in _NEEDED}
    field = read_field(table | {"row": rows}, Columns(name="row", redshift=None), units, on_bad="drop")
    kept = np.asarray(field.name)
    lacking = [f"no column {name}: no subsets by it" for name in _FURTHER[1:] if name not in opened.names]
    if solution is None:
        lacking.append(f"warning: no column {DR3.solution}: all sources are taken for five-parameter solutions")
    field = field.add_note(*lacking)

    def column(name, fill):
        return None if name not in table else np.ma.filled(table[name].astype(type(fill)), fill)[kept]

    six = np.zeros(len(kept), bool) if solution is None else np.ma.filled(table[solution], 0)[kept] == 95
    return Sources(field, six, column(_FURTHER[2], np.nan), column(_FURTHER[3], False), opened.label)


def subsets(sources: Sources) -> dict[str, BoolArray]:
    """The parts of the sky and of the sources that are fitted, by name, (n,) masks each."""
    field, five = sources.field, ~sources.six
    chosen = {"five parameters": five, "six parameters": sources.six, "all": five | sources.six}
    if field.magnitude is not None:
        g = field.magnitude
        chosen |= {"G ≤ 18": five & (g <= 18), "18 < G ≤ 19": five & (g > 18) & (g <= 19),
                   "19 < G ≤ 20": five & (g > 19) & (g <= 20), "G > 20": five & (g > 20)}  # fmt: skip
    if sources.wavenumber is not None and np.isfinite(sources.wavenumber[five]).any():
        nu = sources.wavenumber
        low, high = np.nanquantile(nu[five], [1 / 3, 2 / 3])
        chosen |= {"red third": five & (nu < low), "middle third": five & (nu >= low) & (nu < high),
                   "blue third": five & (nu >= high)}  # fmt: skip
    chosen |= {name: five & mask for name, mask in _places(field).items()}
    if sources.for_spin is not None:
        chosen["used for the frame's spin"] = five & sources.for_spin
    return chosen


def _places(field):
    def latitude(frame):
        return angles(rotation_matrix("icrs", frame) @ triad(field.lon, field.lat)[2])

    l, b = latitude("galactic")
    beta = latitude("ecliptic")[1]
    plane = np.abs(np.sin(b)) < PLANE
    return {
        "without the Galactic plane": ~plane, "|b| < 30°": np.abs(b) < np.pi / 6, "|b| ≥ 30°": np.abs(b) >= np.pi / 6,
        "north Galactic half": b >= 0, "south Galactic half": b < 0, "north ecliptic half": beta >= 0,
        "south ecliptic half": beta < 0, "north celestial half": field.lat >= 0, "south celestial half": field.lat < 0,
        "half toward the centre": np.cos(l) >= 0, "half away from it": np.cos(l) < 0,
    }  # fmt: skip
