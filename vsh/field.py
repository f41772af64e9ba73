"""A catalogue of proper motions with errors, `Field`, which simulations return and fits take.

Inside, angles are radians and motions µas/yr; `ra`, `pmra` … have the names and units of Gaia's archive, and
`to_…` the objects of other packages.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Self

import numpy as np

import vsh  # its face: what draws and reads fields knows them itself
from vsh.sky.frames import (
    AXES,
    FRAME_KEY,
    MEASURED_KEY,
    REDSHIFT_FRAME_KEY,
    check_frame,
    check_redshift_frame,
    coordinate_columns,
    rotate_astrometry,
    rotation_matrix,
)
from vsh.tools import bad_rows
from vsh.tools.arguments import float_array, read_only
from vsh.tools.errors import FieldError, FrameError, ParameterError
from vsh.tools.files import check_overwrite_allowed, table_of, write_table
from vsh.tools.notebook import Equal, Frozen
from vsh.tools.notes import NO_REDSHIFTS, VELOCITIES, CodedNote, merge_notes
from vsh.tools.types import ArrayLike, Axes, BoolArray, FloatArray, OnBad, PathName, Table
from vsh.tools.units import DEGREE, MAS

#: Beyond these a number stands for a missing value, or is none.
PLAUSIBLE_RANGES = {"redshift": (-1.0, 20.0), "magnitude": (-30.0, 50.0), "redshift_error": (-1e-300, 100.0),
              "distance": (0.0, 1e6), "distance_error": (0.0, 1e6),
              "parallax": (-1e5, 1e5), "parallax_error": (0.0, 1e5)}  # fmt: skip
#: Redshifts that surveys write where they have none: several of exactly one of these are none.
_NO_REDSHIFT = (9.99, 9.999, 9.9999)
#: What of a source may be known besides its motion.
MEASURED = (
    "redshift", "magnitude", "redshift_error", "distance", "distance_error", "parallax", "parallax_error",
)  # fmt: skip
#: Their units.
_MEASURED_UNITS = dict.fromkeys(MEASURED[3:5], "Mpc") | dict.fromkeys(MEASURED[5:], "mas")
_MOTIONS = ("pmra", "pmdec", "pmra_error", "pmdec_error")


def make_field_arrays(
    given_columns: Mapping[str, Any],
    source_names: ArrayLike | None,
    on_bad: OnBad,
    first_row: int,
    unusable: Mapping[str, BoolArray] | None = None,
    aside: Mapping[str, BoolArray] | None = None,
) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """The arrays of a field, without rows that cannot be used, and notes."""
    notes: tuple[str, ...] = ()
    if on_bad not in ("raise", "drop"):
        raise FieldError(f"on_bad is 'raise' or 'drop', not {on_bad!r}")
    units = dict.fromkeys(("ra", "dec"), "deg") | dict.fromkeys(_MOTIONS, "mas / yr") | {"magnitude": "mag"}
    units |= _MEASURED_UNITS
    absent_columns = [c for c in ("ra", "dec", *_MOTIONS) if given_columns[c] is None]
    if absent_columns:
        raise FieldError(f"{', '.join(absent_columns)} must be given")
    pairs = {c: bad_rows.as_floats_and_mask(c, v, units.get(c, "")) for c, v in given_columns.items() if v is not None}
    columns: dict[str, Any] = {column: pair[0] for column, pair in pairs.items()}
    missing: dict[str, BoolArray] = {column: pair[1] for column, pair in pairs.items()}
    columns.setdefault("pmra_pmdec_corr", np.zeros(columns["ra"].shape))
    n = columns["ra"].size
    if source_names is not None:
        columns["name"] = np.asarray(source_names)
    bad_rows.check_column_shapes(columns, lambda column: (n,))

    block = np.empty((6, n))  # at once: the memory of a large block comes in large pages
    for column, row in zip(("ra", "dec", *_MOTIONS), block, strict=True):
        np.multiply(columns[column], DEGREE if column in ("ra", "dec") else MAS, out=row)
    (lon, lat), motion, sigma = block[:2], block[2:4], block[4:]
    rho = columns["pmra_pmdec_corr"]
    for column, (lower, upper) in PLAUSIBLE_RANGES.items():
        if column in columns:
            values = np.where(missing[column], np.nan, columns[column])
            is_implausible = np.isfinite(values) & ~((values > lower) & (values < upper))
            is_sentinel, tail = np.isin(values, _NO_REDSHIFT if column == "redshift" else ()), ""
            if is_sentinel.sum() > 2:
                is_implausible, tail = is_implausible | is_sentinel, " or exactly 9.99"
            if is_implausible.any():
                look_like_velocities = column == "redshift" and 2 * is_implausible.sum() > is_implausible.size
                text = f"{is_implausible.sum()} values of {column} beyond {lower:g} … {upper:g}{tail} taken as missing"
                notes = (*notes, CodedNote(f"{text}: {VELOCITIES}", NO_REDSHIFTS) if look_like_velocities else text)
            columns[column] = np.where(is_implausible | np.isinf(values), np.nan, values)
    if "redshift" in columns and "redshift_error" in columns:
        notes = (*notes, *_blank_unknown_redshifts(columns, first_row))
    spans = {column: bad_rows.span_of(columns[column]) for column in _MOTIONS}
    masks_by_reason = bad_rows.find_bad_rows(
        lon, lat, motion, sigma, rho,
        dict(unusable or {}) | {f"{c} missing": mask for c, mask in missing.items() if c not in MEASURED},
        bad_rows.find_placeholder_rows({c: columns[c] for c in _MOTIONS}, spans), turns=1,
        spans={"motion": bad_rows.joint_span(spans, _MOTIONS[:2], MAS),
               "sigma": bad_rows.joint_span(spans, _MOTIONS[2:], MAS)},
    )  # fmt: skip
    rows, added_notes = bad_rows.select_usable_rows(masks_by_reason, n, on_bad, first_row, (lon, lat), aside)
    arrays = {"lon": lon[rows], "lat": lat[rows], "motion": motion[:, rows], "sigma": sigma[:, rows], "rho": rho[rows]}
    arrays |= {c: columns[c][rows] for c in (*MEASURED, "name") if c in columns}
    kept_spans = spans if isinstance(rows, slice) else None
    row_numbers = bad_rows.row_numbers(np.arange(n), first_row)[rows]
    doubts = bad_rows.doubtful_motion_notes({c: columns[c][rows] for c in ("pmra", "pmdec")}, kept_spans, row_numbers)
    return arrays, (*notes, *doubts, *added_notes)


def _blank_unknown_redshifts(columns, first_row):
    """Make redshifts missing whose error says that they are not known; a note counts them and names the first.

    Where most are, errors are in another unit.
    """
    with np.errstate(invalid="ignore"):
        is_unknown = columns["redshift_error"] >= 1 + columns["redshift"]
    if not is_unknown.any():
        return ()
    first_index = int(np.argmax(is_unknown))
    text = (
        f"{is_unknown.sum()} redshifts with an error of 1 + z or more are taken as missing (first: row "
        f"{bad_rows.row_numbers(first_index, first_row)}, {columns['redshift'][first_index]:.4g} ± "
        f"{columns['redshift_error'][first_index]:.4g})"
    )
    if look_like_velocities := 2 * is_unknown.sum() > np.isfinite(columns["redshift"]).sum():
        text += f": errors of {VELOCITIES}"
    for column in ("redshift", "redshift_error"):
        columns[column] = np.where(is_unknown, np.nan, columns[column])
    return (CodedNote(text, NO_REDSHIFTS) if look_like_velocities else text,)


def _broadcast_scalar(column_or_scalar, shape):
    """A column, or one number or Quantity for all sources."""
    return np.broadcast_to(column_or_scalar, shape, subok=True) if np.ndim(column_or_scalar) == 0 else column_or_scalar


def concatenate_columns(first: Any, second: Any) -> dict[str, Any]:
    """The attributes of two fields, one after the other; those that only one of them has are missing in the other."""
    if second.frame != first.frame:
        raise FrameError(f"the fields are in {first.frame} and {second.frame}: take both to one frame")
    frames = {field.redshift_frame for field in (first, second) if field.redshift is not None}
    if len(frames) > 1:
        raise FieldError(f"redshifts stand in {' and '.join(map(str, frames))}: take them to one frame first")
    column_names = ("lon", "lat", "motion", "sigma", "rho", *MEASURED, "name")
    columns = {name: _concatenate_column(first, second, name) for name in column_names}
    return columns | {"redshift_frame": next(iter(frames), None), "notes": merge_notes(first.notes, second.notes)}


def _concatenate_column(first_field, second_field, name):
    """A column of two fields; NaN, or no name, for the sources of which it is not known."""
    fields = (first_field, second_field)
    columns = [getattr(field, name) for field in fields]
    if all(column is None for column in columns):
        return None
    is_text = name == "name" and len({None if column is None else column.dtype.kind for column in columns}) > 1
    blank = "" if is_text else np.nan
    columns = [np.full(len(field), blank) if column is None else column for field, column in zip(fields, columns)]
    columns = [column.astype(str) if is_text else column for column in columns]
    return np.concatenate(columns, axis=-1)


class SourcesWithErrors(Frozen):
    """Base of sources with values and errors; `_make_table_columns` gives their columns, units and plain facts."""

    components: ClassVar[int]
    units_shown: ClassVar[dict[str, str]] = {
        "lon": "rad",
        "lat": "rad",
        "motion": "µas/yr",
        "sigma": "µas/yr",
    } | _MEASURED_UNITS
    lon: FloatArray
    frame: str
    notes: tuple[str, ...]

    def __len__(self) -> int:
        return self.lon.size

    @property
    def data(self) -> FloatArray:
        """The values of each source, (components, n)."""
        raise NotImplementedError

    @property
    def weights(self) -> FloatArray:
        """The inverse covariance of each source, (3, n) or (1, n)."""
        raise NotImplementedError

    def __array__(self, dtype: Any = None, copy: Any = None) -> FloatArray:
        """Refuse: a field is no array, and NumPy would take its sources for fields within fields."""
        data = "motion" if self.components == 2 else "values"
        raise FieldError(f"a {type(self).__name__} is no array: name an attribute of it: {data}, lon, lat or sigma")

    def __getitem__(self, keep: Any) -> Self:
        """The sources picked by a mask, a slice or indices."""
        if isinstance(keep, (int, np.integer)):
            keep = [keep]
        if isinstance(keep, str):
            raise FieldError(f"sources are picked by a mask, a slice or indices; the column is field.{keep}")
        return self._derive(**{name: x[..., keep] for name, x in vars(self).items() if isinstance(x, np.ndarray)})

    def select(self, which: Any) -> Self:
        """The sources of a mask, or of these names.

        Parameters
        ----------
        which : mask, slice, or names
            Booleans, one a source; or names of sources as `name` has them, text or integers, in any order; the selected
            sources keep the order of the field. For indices: ``field[indices]``.

        Raises
        ------
        FieldError
            If a mask is not as long as the field, the sources have no names, or one of the names is not among them;
            the message counts those.

        Examples
        --------
        >>> field = Field([0.0, 1.0], [0.0, 0.0], [[1.0, 2.0]] * 2, [[1.0, 1.0]] * 2, name=["3C273", "3C345"])
        >>> field.select(["3C345"]).name.tolist()
        ['3C345']
        """
        if isinstance(which, slice):
            return self[which]
        which = np.atleast_1d(np.asarray(which))
        source_names = getattr(self, "name", None)
        if which.dtype.kind == "b":
            if which.shape != (len(self),):
                raise FieldError(f"a mask has one value a source: {which.shape} for {len(self)}")
            return self[which]
        if source_names is None:
            raise FieldError("these sources have no names to select them by: give a mask, or use field[indices]")
        if which.dtype.kind == "U" and source_names.dtype.kind in "iu":
            source_names = source_names.astype(str)
        unknown_names = which[~np.isin(which, source_names)]
        if unknown_names.size:
            names = ", ".join(map(str, unknown_names[:5]))
            raise FieldError(f"{unknown_names.size} of {which.size} names are not among the sources: {names}")
        return self[np.isin(source_names, which)]

    def check_frame(self, frame: str) -> None:
        """Raise FrameError unless the sources are in a frame."""
        if self.frame != frame:
            raise FrameError(f'the fit is in {frame}, the field in {self.frame}: use .to_frame("{frame}")')

    def add_note(self, *notes: str) -> Self:
        """Add notes that its reader should know."""
        return self._derive(notes=merge_notes((*self.notes, *notes))) if notes else self

    def _derive(self, **changes: Any) -> Self:
        """A field derived from this one, which has been checked already."""
        field = object.__new__(type(self))
        field._set_frozen(**{**vars(self), **changes})
        return field

    def inner(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """xᵀ C⁻¹ y of each source, (n,), for two sets of values."""
        return np.sum(x * multiply_weights(self.weights, y), axis=0)

    @property
    def chi2(self) -> FloatArray:
        """µᵀ C⁻¹ µ of each source: the χ² of its value against none, (n,)."""
        return self.inner(self.data, self.data)

    @property
    def information(self) -> FloatArray:
        """The trace of each source's inverse covariance, (n,): its weight in sums. [(yr/µas)²]"""
        return self.weights[: self.components].sum(0)

    @property
    def log_determinants(self) -> FloatArray:
        """ln of the determinant of each source's covariance, (n,)."""
        if self.components == 1:
            return -np.log(self.weights[0])
        a, b, c = self.weights
        return -np.log(a * b) - np.log1p(-(c**2) / (a * b))

    def _make_table_columns(self) -> tuple[dict[str, Any], dict[str, str], dict[str, Any]]:
        raise NotImplementedError

    def to_table(self) -> Table:
        """The sources as an astropy Table in the names and units of Gaia's archive."""
        columns, units, facts = self._make_table_columns()
        return table_of(columns, facts, units)

    def to_qtable(self) -> Table:
        """The sources as an astropy QTable, whose columns are Quantities."""
        from astropy.table import QTable

        return QTable(self.to_table())

    def write(self, path: PathName, meta: dict[str, Any] | None = None, *, overwrite: bool = False) -> None:
        """Write the sources as a table, which `vsh.io.catalogue` reads.

        Parameters
        ----------
        path : str or Path
            FITS, VOTable, ECSV, CSV, Parquet or HDF5 by its ending.
        meta : dict, optional
            Provenance, plain values.
        overwrite : bool
            Whether a file that is there is replaced.

        Raises
        ------
        WriteError
            If the file exists, and is not to be replaced.
        TableError
            If the format cannot hold what the field has.
        """
        check_overwrite_allowed(path, overwrite)
        write_table(self.to_table(), path, meta, overwrite=overwrite)


def multiply_weights(weights: FloatArray, values: FloatArray) -> FloatArray:
    """W x of each source."""
    if len(weights) == 1:
        return weights * values
    a, b, c = weights
    x, y = values[..., 0, :], values[..., 1, :]
    return np.stack([a * x + c * y, c * x + b * y], axis=-2)


@dataclass(frozen=True, eq=False, repr=False)
class Field(Equal, SourcesWithErrors):
    """Proper motions of n sources with their errors; checked when it is made, with read-only arrays.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions in the frame of the analysis. [rad]
    motion : (2, n) array
        µ_α* (east, cos δ included) and µ_δ (north). [µas/yr]
    sigma : (2, n) array
        Standard errors of the two components. [µas/yr]
    rho : (n,) array
        Correlation of the two components; zero unless given.
    redshift, magnitude, redshift_error : (n,) arrays or None
        nan where unknown.
    distance, distance_error : (n,) arrays or None
        Transverse comoving distances that are known independently of the redshift, otherwise nan. [Mpc]
    parallax, parallax_error : (n,) arrays or None
        Parallaxes, read on request, for analyses of stars. [mas]
    name : (n,) array or None
        64-bit integers or text.
    frame : str
        "icrs", "galactic" or "ecliptic".
    redshift_frame : str or None
        "heliocentric", "cmb", "local-group"; "true" for redshifts of the expansion alone; None where it is not given.
    notes : tuple of str
        What a reader of any result should know: units that were assumed, rows that were left out.

    Raises
    ------
    FieldError
        If shapes disagree or a source cannot be used: something not finite, σ ≤ 0, ρ² ≥ 1 - 1e-6, |lat| > 90°; or
        if a distance has no error.

    Examples
    --------
    >>> field = Field(lon=[0.1, 2.0], lat=[-0.3, 0.7], motion=[[5.0, -3.0], [1.0, 2.0]], sigma=[[2.0, 2.0], [2.0, 4.0]])
    >>> len(field), field.frame
    (2, 'icrs')
    >>> field[1:].motion.ravel().tolist()
    [-3.0, 2.0]
    """

    lon: FloatArray
    lat: FloatArray
    motion: FloatArray
    sigma: FloatArray
    rho: FloatArray = None  # type: ignore[assignment]  # zero unless given, an array from then on
    redshift: FloatArray | None = None
    magnitude: FloatArray | None = None
    name: np.ndarray | None = None
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    redshift_error: FloatArray | None = None
    distance: FloatArray | None = None
    distance_error: FloatArray | None = None
    redshift_frame: str | None = None
    parallax: FloatArray | None = None
    parallax_error: FloatArray | None = None

    components: ClassVar[int] = 2
    unit: ClassVar[str] = "µas/yr"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        if self.redshift_frame is not None:
            self._set_frozen(redshift_frame=check_redshift_frame(self.redshift_frame))
        columns = bad_rows.check_source_columns(self, ("lat", "motion", "sigma", "rho", *MEASURED), ("name",))
        self._set_frozen(**columns, notes=tuple(self.notes))
        bad_rows.check_distances_and_errors(self)

    @classmethod
    def from_columns(
        cls,
        ra: Any,
        dec: Any,
        pmra: Any,
        pmdec: Any,
        pmra_error: Any,
        pmdec_error: Any,
        pmra_pmdec_corr: ArrayLike | None = None,
        *,
        name: ArrayLike | None = None,
        frame: str = "icrs",
        redshift_frame: str | None = None,
        on_bad: OnBad = "raise",
        notes: Iterable[str] = (),
        first_row: int = 0,
        unusable: Mapping[str, BoolArray] | None = None,
        aside: Mapping[str, BoolArray] | None = None,
        **measured: ArrayLike | None,
    ) -> Field:
        """A field from columns as catalogues have them.

        Parameters
        ----------
        ra, dec : (n,) arrays
            Positions [deg, or Quantities of any angle]
        pmra, pmdec, pmra_error, pmdec_error : (n,) arrays
            µ_α* and µ_δ and their errors [mas/yr, or Quantities of any angle per time]
        pmra_pmdec_corr : (n,) array, optional
            Their correlation; zero unless given.
        name : (n,) array, optional
            One for each source.
        frame, redshift_frame : str
            Axes of positions and motions alike; frame of the redshifts.
        on_bad : {"raise", "drop"}
            What to do about sources that cannot be used.
        notes : iterable of str
            Its first notes.
        first_row : int
            Number of the first row in messages, where the columns are part of a table.
        unusable : dict of str to mask, optional
            Further rows that cannot be used, by reason.
        aside : dict of str to mask, optional
            Rows that are no part of the field, by reason: they are counted in a note, and are no error.
        **measured
            redshift, magnitude, redshift_error, distance, distance_error, parallax, parallax_error, (n,) each.

        Raises
        ------
        FieldError
            If a column is no array of n numbers, or, with "raise", if any source cannot be used.

        Examples
        --------
        >>> field = Field.from_columns([10.0], [-20.0], [0.1], [0.2], [0.05], [0.05])
        >>> field.motion.ravel()
        array([100., 200.])
        """
        column_names = ("ra", "dec", *_MOTIONS, "pmra_pmdec_corr")
        column_values = (ra, dec, pmra, pmdec, pmra_error, pmdec_error, pmra_pmdec_corr)
        main_columns = dict(zip(column_names, column_values, strict=True))
        if unknown_names := ", ".join(set(measured) - set(MEASURED)):
            raise FieldError(f"no column is called {unknown_names}: {', '.join(MEASURED)} are")
        columns, added_notes = make_field_arrays(main_columns | measured, name, on_bad, first_row, unusable, aside)
        return cls(**columns, frame=frame, redshift_frame=redshift_frame, notes=(*notes, *added_notes))

    @classmethod
    def from_skycoord(
        cls, coord: Any, pmra_error: Any, pmdec_error: Any, pmra_pmdec_corr: ArrayLike | None = None, **further: Any
    ) -> Field:
        """A field from an astropy SkyCoord with proper motions, and their errors along the same axes.

        Parameters
        ----------
        coord : SkyCoord
            In ICRS, galactic or barycentricmeanecliptic coordinates; the field is in that frame.
        pmra_error, pmdec_error : (n,) arrays, or one number for all
            Errors of the motion in longitude, cos(latitude) included, and latitude. [mas/yr, or Quantities]
        pmra_pmdec_corr : (n,) array, optional
            Their correlation; zero unless given.
        **further
            As for `from_columns`: name, redshift, magnitude, on_bad, notes, …

        Raises
        ------
        FieldError
            If it is no SkyCoord, has no motions, or sources cannot be used.
        FrameError
            If it is in another frame.
        """
        if not hasattr(coord, "frame") or not hasattr(coord, "spherical"):
            raise FieldError(f"a SkyCoord is expected, not {type(coord).__name__}")
        columns, frame = coordinate_columns(coord)
        columns.pop("distance", None)
        if "pmra" not in columns:
            raise FieldError("the SkyCoord has no proper motions: give it pm_ra_cosdec and pm_dec")
        shape = np.shape(columns["ra"])
        return cls.from_columns(
            **columns,
            pmra_error=_broadcast_scalar(pmra_error, shape),
            pmdec_error=_broadcast_scalar(pmdec_error, shape),
            pmra_pmdec_corr=pmra_pmdec_corr,
            frame=frame,
            **further,
        )

    @classmethod
    def from_positions(cls, sources: Any, sigma: ArrayLike | None = None) -> Field:
        """Positions and errors as a Field whose motions are zero; a Field as it is.

        Parameters
        ----------
        sources : Field, Population, or anything with lon and lat [rad], and perhaps sigma, rho, frame
            As for `fit.correlation.predict_covariance`.
        sigma : float or (2, n) array, optional
            Errors in place of the sources' own. [µas/yr]

        Raises
        ------
        FieldError
            If the sources have no positions, or no errors and none are given.
        """
        if getattr(sources, "components", 2) != 2:
            raise FieldError("a ScalarField has no motions, and no errors of motions")
        if isinstance(sources, Field):
            return sources if sigma is None else sources.with_errors(sigma)
        if not (hasattr(sources, "lon") and hasattr(sources, "lat")):
            raise FieldError(f"sources are a Field, or positions with lon and lat, not {type(sources).__name__}")
        sigma = getattr(sources, "sigma", None) if sigma is None else sigma
        if sigma is None:
            raise FieldError("sources without errors need sigma=, in µas/yr")
        shape = (2, np.size(sources.lon))
        further: dict[str, Any] = {name: getattr(sources, name, None) for name in ("rho", "redshift")}
        motion_and_errors = np.zeros(shape), np.broadcast_to(sigma, shape)
        return cls(sources.lon, sources.lat, *motion_and_errors, **further, frame=getattr(sources, "frame", "icrs"))

    @property
    def ra(self) -> FloatArray:
        """Right ascension of each source, (n,). [deg]"""
        return self._check_icrs_and_freeze("ra", self.lon / DEGREE)

    @property
    def dec(self) -> FloatArray:
        """Declination of each source, (n,). [deg]"""
        return self._check_icrs_and_freeze("dec", self.lat / DEGREE)

    @property
    def pmra(self) -> FloatArray:
        """Proper motion µ_α* of each source, cos δ included, (n,). [mas/yr]"""
        return self._check_icrs_and_freeze("pmra", self.motion[0] / MAS)

    @property
    def pmdec(self) -> FloatArray:
        """Proper motion µ_δ of each source, (n,). [mas/yr]"""
        return self._check_icrs_and_freeze("pmdec", self.motion[1] / MAS)

    @property
    def pmra_error(self) -> FloatArray:
        """Standard error of µ_α* of each source, (n,). [mas/yr]"""
        return self._check_icrs_and_freeze("pmra_error", self.sigma[0] / MAS)

    @property
    def pmdec_error(self) -> FloatArray:
        """Standard error of µ_δ of each source, (n,). [mas/yr]"""
        return self._check_icrs_and_freeze("pmdec_error", self.sigma[1] / MAS)

    @property
    def z(self) -> FloatArray | None:
        """Another name of `redshift`."""
        return self.redshift

    @property
    def columns(self) -> list[str]:
        """The names of the columns of `to_table`."""
        return list(self._make_table_columns()[0])

    def __contains__(self, name: object) -> bool:
        """Return whether a source has this name."""
        return self.name is not None and bool(np.any(self.name == name))

    def _check_icrs_and_freeze(self, name, values):
        if self.frame != "icrs":
            raise FrameError(f'{name} is of ICRS axes, and this field has {self.frame} ones: use .to_frame("icrs")')
        return read_only(np.asarray(values))

    def head(self, n: int = 5) -> Table:
        """The first rows of the table.

        Parameters
        ----------
        n : int
            How many.
        """
        return self.to_table()[:n]

    def to_pandas(self) -> Any:
        """The sources as a pandas DataFrame in the names and units of Gaia's archive; `attrs` has units and frame."""
        table = self.to_table()
        dataframe = table.to_pandas()
        units = {name: str(table[name].unit) for name in table.colnames if table[name].unit}
        dataframe.attrs |= {"units": units} | dict(table.meta)
        return dataframe

    def to_skycoord(self) -> Any:
        """The sources as an astropy SkyCoord with positions and proper motions."""
        from astropy import units
        from astropy.coordinates import SkyCoord

        names = ("ra", "dec") if self.frame == "icrs" else ("l", "b") if self.frame == "galactic" else ("lon", "lat")
        east_keyword = f"pm_{names[0]}_cos{names[1]}"
        degrees, motions = (self.lon / DEGREE, self.lat / DEGREE), self.motion / MAS * units.mas / units.yr
        keywords: dict[str, Any] = {name: angle * units.deg for name, angle in zip(names, degrees, strict=True)}
        keywords |= {east_keyword: motions[0], f"pm_{names[1]}": motions[1]}
        frame = "barycentricmeanecliptic" if self.frame == "ecliptic" else self.frame
        return SkyCoord(**keywords, frame=frame)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The sources on the sky, on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, optional
            Sky axes of `vsh.figures.plot.sky_axes`; a new figure unless given.
        """
        return vsh.figures.plot.plot_sources(self, ax=ax)

    @classmethod
    def read(cls, source: Any, **reading: Any) -> Self:
        """Read a catalogue: `vsh.read_field`.

        Parameters
        ----------
        source : path or table
            As for `vsh.io.catalogue.read_field`.
        **reading
            Its arguments: columns, units, on_bad, frame, where, format.
        """
        field: Any = vsh.read_field(source, **reading)
        return field

    @classmethod
    def from_table(cls, table: Any, **reading: Any) -> Self:
        """The field of a table in memory: astropy, pandas, polars, Arrow.

        Parameters
        ----------
        table : table
            As for `vsh.io.catalogue.read_field`.
        **reading
            Its arguments.
        """
        return cls.read(table, **reading)

    @property
    def data(self) -> FloatArray:
        """The motions, (2, n): what is fitted. [µas/yr]"""
        return self.motion

    @property
    def weights(self) -> FloatArray:
        """The inverse covariance [[a, c], [c, b]] of each source, (3, n): a, b, c. [(yr/µas)²]"""
        weights = np.zeros((3, len(self)))
        np.divide(1, self.sigma**2, out=weights[:2])
        if self.rho.any():
            np.divide(-self.rho, self.sigma[0] * self.sigma[1], out=weights[2])
            weights /= 1 - self.rho**2
        return weights

    @property
    def whitened(self) -> FloatArray:
        """The motions decorrelated and in units of their errors, L⁻¹ µ with L Lᵀ = C, (2, n)."""
        east, north = self.motion / self.sigma
        return np.stack([east, (north - self.rho * east) / np.sqrt(1 - self.rho**2)])

    def __repr__(self) -> str:
        columns = [name for name in (*MEASURED, "name") if getattr(self, name) is not None]
        return f"<Field: {len(self)} sources, {self.frame}{', with ' if columns else ''}{', '.join(columns)}>"

    def __add__(self, other: Field) -> Field:
        """The sources of both, one after the other, in one frame; what one does not know of its sources is missing."""
        return self._derive(**concatenate_columns(self, other)) if isinstance(other, Field) else NotImplemented

    def minus(self, model: ArrayLike) -> Field:
        """Subtract the motions of a model, `model` (2, n) [µas/yr]."""
        return self._derive(motion=self.motion - float_array("model", model, self.motion.shape, broadcast=True))

    def corrected(self, correction: Any) -> Field:
        """Subtract motions that are not the sources': those of a frame that turns, as published or as a fit found.

        Parameters
        ----------
        correction : function, or result of a fit
            A function from a Field to motions, (2, n) [µas/yr], such as
            `vsh.models.bright_stars.CANTAT_GAUDIN_BRANDT_2021`; or what has a `model`, as `fit.frames.link` gives,
            which is taken in its own axes.

        Raises
        ------
        ParameterError
            If it is neither, or not of motions.
        """
        frame, unit = (getattr(correction, name, None) for name in ("frame", "unit"))
        model = getattr(correction, "model", correction)
        if not callable(model) or unit not in (None, "µas/yr"):
            raise ParameterError(f"a correction is a function of a Field or has a model of motions, not {correction!r}")
        if frame not in (None, self.frame):
            return self.to_frame(frame).corrected(correction).to_frame(self.frame)
        name = getattr(correction, "__name__", type(correction).__name__)
        return self.minus(model(self)).add_note(f"motions are corrected by {name}")

    def with_errors(self, sigma: ArrayLike, rho: ArrayLike | None = None) -> Field:
        """Replace the standard errors, (2, n) [µas/yr], and perhaps correlations, (n,).

        Parameters
        ----------
        sigma : float or (2, n) array
            Standard errors. [µas/yr]
        rho : (n,) array, optional
            Their correlation; as it is unless given.
        """
        rho = self.rho if rho is None else float_array("rho", rho, finite=False)
        sigma = float_array("sigma", sigma, (2, len(self)) if np.ndim(sigma) == 0 else None, False, broadcast=True)
        shapes: dict[str, tuple[int, ...]] = {"sigma": (2, len(self)), "rho": (len(self),)}
        bad_rows.check_column_shapes({"sigma": sigma, "rho": rho}, shapes.__getitem__)
        bad_rows.select_usable_rows(bad_rows.find_bad_rows(self.lon, self.lat, self.motion, sigma, rho), len(self))
        return self._derive(sigma=sigma, rho=rho)

    def to_frame(self, name: str) -> Field:
        """Turn positions, motions and covariances to the frame `name` (icrs, galactic, ecliptic)."""
        if check_frame(name) == self.frame:
            return self
        matrix = rotation_matrix(self.frame, name)
        lon, lat, motion, sigma, rho = rotate_astrometry(matrix, self.lon, self.lat, self.motion, self.sigma, self.rho)
        return self._derive(lon=lon, lat=lat, motion=motion, sigma=sigma, rho=rho, frame=name)

    def _make_table_columns(self):
        """A field in Gaia's names: columns, their units, and plain facts."""
        columns = {"source_id": np.arange(1, len(self) + 1) if self.name is None else self.name}
        lon, lat, east, north = AXES[self.frame]
        motions = (east, north, f"{east}_error", f"{north}_error")
        columns |= {lon: np.degrees(self.lon), lat: np.degrees(self.lat)}
        columns |= dict(zip(motions, (*(self.motion / MAS), *(self.sigma / MAS)), strict=True))
        columns[f"{east}_{north}_corr"] = self.rho
        optional = {"phot_g_mean_mag" if role == "magnitude" else role: getattr(self, role) for role in MEASURED}
        columns |= {name: values for name, values in optional.items() if values is not None}
        facts = {} if self.frame == "icrs" else {FRAME_KEY: self.frame}
        if self.redshift is not None and self.redshift_frame is not None:
            facts[REDSHIFT_FRAME_KEY] = self.redshift_frame
        if measured_roles := [role for role in MEASURED[3:] if optional[role] is not None]:
            facts[MEASURED_KEY] = " ".join(measured_roles)
        units = dict.fromkeys((lon, lat), "deg") | dict.fromkeys(motions, "mas / yr") | {"phot_g_mean_mag": "mag"}
        units |= _MEASURED_UNITS
        return columns, {name: unit for name, unit in units.items() if name in columns}, facts
