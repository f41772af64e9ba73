"""Tables of astrometry by several catalogues, read and written: stars with parallaxes, single epochs, quasars."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vsh.io import tables
from vsh.io.catalogue import as_doubles, check_position_unit, find_frames
from vsh.io.columns import missing_column, unit_factor
from vsh.sky.astrometry import AstrometryRows
from vsh.tools.errors import TableError
from vsh.tools.files import check_overwrite_allowed
from vsh.tools.types import PathName
from vsh.tools.units import DEGREE, MAS

__all__ = ["read_astrometry", "write_astrometry"]

#: The five parameters by the archive's names, and what else they are called; case does not count.
_PARAMETERS = ("ra", "dec", "parallax", "pmra", "pmdec")
#: Errors below this are a slip, and would take all weight. [µas, µas/yr]
_SMALLEST_ERROR = 1e-9
_ALIASES = {
    "name": ("source_name", "iers", "icrf", "name", "star", "source", "object", "designation", "source_id"),
    "catalogue": ("catalogue", "catalog"), "epoch": ("epoch", "ref_epoch"), "ra": ("ra", "raj2000", "ra_icrs"),
    "dec": ("dec", "de", "dej2000", "de_icrs"), "parallax": ("parallax", "plx", "pi"), "pmra": ("pmra",),
    "pmdec": ("pmdec", "pmde"), "radial_velocity": ("radial_velocity", "rv"),
    "magnitude": ("phot_g_mean_mag", "magnitude", "gmag", "g"), "still": ("still", "quasar"),
    "calibrator": ("calibrator", "reference_source", "phase_reference"),
}  # fmt: skip
_UNITS = {"ra": "deg", "dec": "deg", "parallax": "mas", "pmra": "mas / yr", "pmdec": "mas / yr",
          "radial_velocity": "km / s"}  # fmt: skip
#: Errors and correlations, by the names of their parameters.
_CORRELATIONS = {f"{_PARAMETERS[i]}_{_PARAMETERS[j]}_corr": (i, j) for i in range(5) for j in range(i + 1, 5)}
_SPREAD_ALIASES: dict[str, tuple[str, ...]] = {
    f"{name}_error": tuple(form for base in _ALIASES[name] for form in (f"{base}_error", f"{base}_err", f"e_{base}"))
    for name in _PARAMETERS
}
_SPREAD_ALIASES |= {
    role: tuple(f"{first}_{second}_corr" for first in _ALIASES[_PARAMETERS[i]] for second in _ALIASES[_PARAMETERS[j]])
    for role, (i, j) in _CORRELATIONS.items()
}
#: What belongs to a source, whoever measured it.
_SOURCE_ROLES = ("name", "radial_velocity", "magnitude", "still", "calibrator")
#: The catalogue of bare columns, in a table that has those of two side by side.
_BARE_CATALOGUE = "gaia"


def read_astrometry(
    source: Any,
    catalogue: str | None = None,
    *,
    epoch: float | None = None,
    still: bool = False,
    columns: Mapping[str, str] | None = None,
    format: str | None = None,
) -> AstrometryRows:
    """Read the astrometry of stars or quasars from a table, a row for each time that a catalogue gives a source.

    Parameters
    ----------
    source : path, or table
        Names, `epoch` and what was measured of `ra`, `dec`, `parallax`, `pmra`, `pmdec`, with `ra_error` … and
        correlations `ra_dec_corr` … (zero where there are none), `radial_velocity`, `phot_g_mean_mag`,
        `still` (a quasar), `calibrator` (its name). In degrees, mas and mas/yr where the table does not say.
        Errors of ra times cos(dec). A table may have two catalogues side by side, one with a suffix (`ra_VLBI` …), and
        a column `catalogue`.
    catalogue : str, optional
        The catalogue that the rows are of, where no column says; the name of the file unless given.
    epoch : float, optional
        Epoch of all rows, where no column says (2015.0 of ICRF3). [Julian year]
    still : bool
        Whether all sources are quasars, where no column says.
    columns : dict, optional
        From these names to those of the table.
    format : str, optional
        Format of the file, where its name does not say.

    Raises
    ------
    TableError
        If a table lacks names, epochs or everything that could be measured, or a column holds no numbers.
    FieldError
        As `AstrometryRows` does.
    """
    table = tables.open_table(source, format)
    aliases = _ALIASES | _SPREAD_ALIASES
    unknown_roles = sorted(set(columns or {}) - set(aliases))
    if unknown_roles:
        raise TableError(f"columns: nothing is called {', '.join(unknown_roles)}; there are {', '.join(aliases)}")
    label = catalogue or (Path(source).name.split(".")[0] if isinstance(source, str | Path) else "catalogue")
    suffix = _find_catalogue_suffix([name.lower() for name in table.names])
    if suffix and not columns:
        if still or catalogue or epoch is not None:
            raise TableError(
                f"{table.label} has two catalogues side by side: still=, catalogue= and epoch= are of a table of one"
            )
        bare_rows = _CatalogueColumns(table, aliases, {}, "").read_rows(_BARE_CATALOGUE, drops_repeats=True)
        return bare_rows + _CatalogueColumns(table, aliases, {}, suffix).read_rows(suffix.strip("_"))
    return _CatalogueColumns(table, aliases, dict(columns or {}), "", epoch).read_rows(label, still=still)


def _find_catalogue_suffix(names):
    """The suffix of a second catalogue in a table; empty where there is none."""
    suffixes = [n[2:] for n in names if n.startswith("ra_") and {f"dec{n[2:]}", f"epoch{n[2:]}"} <= {*names}]
    return next(iter(suffixes), "") if "ra" in names else ""


class _CatalogueColumns:
    """The columns of a table that belong to one catalogue."""

    def __init__(self, table, aliases, columns, suffix, epoch=None):
        self.table, self.epoch, self.names = table, epoch, {}
        name_by_lower = {name.lower(): name for name in table.names}
        for role, candidates in aliases.items():
            if role in columns:
                if columns[role] not in table.names:
                    raise TableError(f"{table.label}: {missing_column(columns[role], table)}")
                self.names[role] = columns[role]
                continue
            # What a source is called, its magnitude and its colour are not those of one catalogue.
            endings = (suffix, "") if role in _SOURCE_ROLES else (suffix,)
            matches = (name_by_lower.get(candidate + ending) for ending in endings for candidate in candidates)
            column = next((name for name in matches if name), None)
            if column is not None:
                self.names[role] = column
        for role in ("name", "epoch"):
            if role not in self.names and not (role == "epoch" and epoch is not None):
                remedy = "; add it as a column, or say epoch= in read_astrometry" if role == "epoch" else ""
                raise TableError(f"{table.label}: {missing_column(role + suffix, table)}{remedy}")
        frame = find_frames({role: self.names[role] for role in _PARAMETERS if role in self.names}, None, table).frame
        if frame != "icrs":
            raise TableError(
                f"{table.label} has {frame} axes, and a link takes ICRS: turn it, with SkyCoord of astropy say"
            )
        self.columns = table.columns(tuple(dict.fromkeys(self.names.values())))

    def read_numbers(self, role, n_rows):
        """A column in our units, nan where nothing is, and all nan where there is no such column."""
        if role not in self.names:
            return np.full(n_rows, np.nan)
        name = self.names[role]
        unit = _UNITS.get(role.removesuffix("_error"))
        if role in ("ra_error", "dec_error"):
            unit = "mas"
        factor = 1.0 if unit is None else unit_factor(name, self.table.units.get(name), unit)
        return np.ma.filled(as_doubles(name, *self.columns[name]), np.nan) * factor

    def read_texts(self, role):
        """A column of text."""
        values, _ = self.columns[self.names[role]]
        return np.array([value.decode() if isinstance(value, bytes) else str(value) for value in np.asarray(values)])

    def read_calibrator_names(self, n_rows):
        """Names of the calibrators of the rows; empty where there is none."""
        if "calibrator" not in self.names:
            return np.full(n_rows, "")
        _, mask = self.columns[self.names["calibrator"]]
        return np.where(False if mask is None else mask, "", self.read_texts("calibrator"))

    def compute_covariance(self, n_rows):
        """Covariance of the five parameters, (n, 5, 5), from their errors and correlations. [µas, µas/yr]"""
        sigma = MAS * np.stack([self.read_numbers(f"{parameter}_error", n_rows) for parameter in _PARAMETERS])
        if (sigma < 0).any():
            raise TableError(f"{self.table.label}: {int((sigma < 0).sum())} errors are negative")
        tiny = (sigma > 0) & (sigma < _SMALLEST_ERROR)
        if tiny.any():
            raise TableError(
                f"{self.table.label}: {int(tiny.sum())} errors are below {_SMALLEST_ERROR / MAS:g} mas, of row "
                f"{int(np.flatnonzero(tiny.any(0))[0])} say, which nobody measures: 0 stands for what was not measured"
            )
        correlations = np.tile(np.eye(5), (n_rows, 1, 1))
        for role, (i, j) in _CORRELATIONS.items():
            if role in self.names:
                correlations[:, i, j] = correlations[:, j, i] = np.nan_to_num(self.read_numbers(role, n_rows))
        return correlations * sigma.T[:, :, None] * sigma.T[:, None, :]

    def read_rows(self, catalogue_name, drops_repeats=False, still=False):
        """The rows; each once where the table repeats them beside those of another catalogue."""
        names = np.char.strip(self.read_texts("name"))
        n = len(names)
        if not n:
            raise TableError(f"{self.table.label}: the table has no rows")
        positions = {role: self.read_numbers(role, n) for role in ("ra", "dec")}
        is_unit_assumed = "ra" in self.names and self.table.units.get(self.names["ra"]) is None
        check_position_unit(positions, is_unit_assumed, names=self.names)
        lon, lat = positions["ra"] * DEGREE, positions["dec"] * DEGREE
        parallax, *motion = (MAS * self.read_numbers(parameter, n) for parameter in _PARAMETERS[2:])
        is_still = np.nan_to_num(self.read_numbers("still", n)) != 0 if "still" in self.names else np.full(n, still)
        epoch = self.read_numbers("epoch", n) if "epoch" in self.names else np.full(n, float(self.epoch))
        columns = {
            "name": names,
            "catalogue": self.read_texts("catalogue") if "catalogue" in self.names else np.full(n, catalogue_name),
            "epoch": epoch, "lon": lon, "lat": lat, "parallax": parallax,
            "motion": np.stack(motion), "covariance": self.compute_covariance(n), "still": is_still,
            "calibrator": self.read_calibrator_names(n),
            **{role: self.read_numbers(role, n) for role in ("radial_velocity", "magnitude")},
        }  # fmt: skip
        is_kept = np.ones(n, bool)
        if drops_repeats:
            measurements = np.nan_to_num(np.column_stack([columns["epoch"], lon, lat, parallax, *motion]), nan=-1e300)
            name_indices = np.unique(names, return_inverse=True)[1].ravel()
            is_kept[:] = False
            is_kept[np.unique(np.column_stack([name_indices, measurements]), axis=0, return_index=True)[1]] = True
        notes = tuple(self.table.notes)
        empty = is_kept & ~(np.diagonal(columns["covariance"], axis1=1, axis2=2) > 0).any(1)
        if empty.any() and not empty[is_kept].all():
            notes += (f"{self.table.label}: {int(empty.sum())} rows measure nothing with an error, and are left out",)
            is_kept &= ~empty
        kept_columns: dict[str, Any] = {
            role: value[:, is_kept] if role == "motion" else value[is_kept] for role, value in columns.items()
        }
        return AstrometryRows(**kept_columns, notes=notes)


def write_astrometry(
    astrometry: AstrometryRows, path: PathName, meta: Mapping[str, Any] | None = None, *, overwrite: bool = False
) -> None:
    """Write rows of astrometry so that `read_astrometry` reads them.

    Parameters
    ----------
    astrometry : AstrometryRows
        The rows.
    path : str or Path
        An ECSV, FITS or CSV file.
    meta : dict, optional
        Provenance, plain values.
    overwrite : bool
        Whether a file that is there is replaced.
    """
    check_overwrite_allowed(path, overwrite)
    is_measured = astrometry.measured
    sigma = np.sqrt(np.where(is_measured, np.diagonal(astrometry.covariance, axis1=1, axis2=2), np.nan))
    columns: dict[str, Any] = {
        "source_name": astrometry.name, "catalogue": astrometry.catalogue, "epoch": astrometry.epoch,
        "ra": astrometry.lon / DEGREE, "dec": astrometry.lat / DEGREE, "parallax": astrometry.parallax / MAS,
        "pmra": astrometry.motion[0] / MAS, "pmdec": astrometry.motion[1] / MAS,
    }  # fmt: skip
    columns |= {f"{parameter}_error": sigma[:, k] / MAS for k, parameter in enumerate(_PARAMETERS)}
    with np.errstate(invalid="ignore"):
        for role, (i, j) in _CORRELATIONS.items():
            columns[role] = astrometry.covariance[:, i, j] / (sigma[:, i] * sigma[:, j])
    columns |= {
        "radial_velocity": astrometry.radial_velocity, "phot_g_mean_mag": astrometry.magnitude,
        "calibrator": astrometry.calibrator,
        "still": astrometry.still.astype(np.int16),
    }  # fmt: skip
    units = {name: _UNITS.get(name.removesuffix("_error"), "") for name in columns}
    units |= {"ra_error": "mas", "dec_error": "mas", "epoch": "yr", "phot_g_mean_mag": "mag"}
    known_units = {name: unit for name, unit in units.items() if unit}
    tables.write_columns(path, columns, dict(meta or {}), known_units, overwrite)
