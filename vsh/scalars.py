"""Scalar fields on the sky: parallaxes, differences of magnitudes or colours, ratios of errors."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np

from vsh.coefficients import Coefficients
from vsh.field import SourcesWithErrors
from vsh.modes import Modes, ScalarModes, as_modes
from vsh.sky.frames import AXES, FRAME_KEY, check_frame, rotation_matrix
from vsh.sky.pixels import centres, check_nside, pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import float_array, number
from vsh.tools.bad_rows import as_floats_and_mask, check_column_shapes, find_bad_rows, floats_or_nan, select_usable_rows
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, OnBad
from vsh.tools.units import DEGREE

#: Degree 1 is d·r: rows (1,0), (1,1,re), (1,1,im) of its coefficients from x, y, z of d. That of a glide, over √2.
DIPOLE = np.sqrt(2 * np.pi / 3) * np.array([[0, 0, np.sqrt(2)], [-1, 0, 0], [0, 1, 0]])
DIPOLE.flags.writeable = False


#: Sources that are expected in a pixel of counts at least; where so many are expected, none is no chance.
_IN_PIXEL, _FULL_PIXEL = 30, 15.0


class ScalarCoefficients(Coefficients):
    """A band-limited scalar field on the sphere, f = Σ f_l0 Y_l0 + 2 (f_lm^R Re Y_lm − f_lm^I Im Y_lm).

    Attributes
    ----------
    modes : ScalarModes
        What each entry of `values` multiplies.
    values : (p,) array, read-only
        The coefficients.

    Raises
    ------
    ModesError
        If there are not as many values as modes.

    Notes
    -----
    Norm and signs of Mignard & Klioner (2012): a spheroidal mode is the gradient of a scalar one over √(l(l+1)).

    Examples
    --------
    >>> zero_point = ScalarCoefficients.from_moments(mean=-20.0, dipole=(1, 2, 3))
    >>> round(zero_point.mean, 9), zero_point.dipole.round(9)
    (-20.0, array([1., 2., 3.]))
    >>> zero_point.at(lon=[0.0], lat=[0.0]).round(9)
    array([-19.])
    """

    _modes_type = ScalarModes

    @classmethod
    def from_moments(cls, mean: float = 0.0, dipole: ArrayLike = (0, 0, 0), lmax: int = 1) -> ScalarCoefficients:
        """The field mean + dipole · r.

        Parameters
        ----------
        mean : float
            Mean of the whole sky.
        dipole : (3,) array
            Along the axes of the frame.
        lmax : int
            The highest degree, at least 1.
        """
        modes = ScalarModes(lmax)
        values = np.zeros(len(modes))
        values[0] = np.sqrt(4 * np.pi) * number("mean", mean)
        values[modes.slice_of("F", 1)] = DIPOLE @ float_array("dipole", dipole, (3,))
        return cls(modes, values)

    @property
    def mean(self) -> float:
        """The mean over the whole sky, f_00/√4π."""
        return float(self.values[0] / np.sqrt(4 * np.pi))

    @property
    def dipole(self) -> FloatArray:
        """d of the part d·r, along the axes of the frame, (3,)."""
        return np.linalg.solve(DIPOLE, self.values[self.modes.slice_of("F", 1)])

    def at(self, lon: ArrayLike, lat: ArrayLike) -> FloatArray:
        """The field at `lon`, `lat` [rad], (n,)."""
        return super().at(lon, lat)[0]


@dataclass(frozen=True, eq=False, repr=False)
class ScalarField(SourcesWithErrors):
    """Numbers of n sources, with their errors: parallaxes, differences of magnitudes or colours, logarithms of ratios.

    A field is checked once, here. Its arrays are read-only.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions in the frame of the analysis. [rad]
    values, sigma : (n,) arrays
        The numbers and their standard errors, independent of each other. [`unit`]
    unit : str
        "" of a pure number.
    name : (n,) array or None
        64-bit integers or text.
    frame : str
        "icrs", "galactic" or "ecliptic".
    notes : tuple of str
        What a reader of any result should know.

    Raises
    ------
    FieldError
        If shapes disagree or a source cannot be used: something not finite, σ ≤ 0, |lat| > 90°.

    Examples
    --------
    >>> field = ScalarField([0.0, 1.0], [0.0, 0.5], [-30.0, -10.0], [10.0, 10.0], "µas")
    >>> field
    <ScalarField: 2 sources, icrs, in µas>
    """

    lon: FloatArray
    lat: FloatArray
    values: FloatArray
    sigma: FloatArray
    unit: str = ""
    name: np.ndarray | None = None
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    components: ClassVar[int] = 1
    units_shown: ClassVar[dict[str, str]] = {"lon": "rad", "lat": "rad"}
    #: Said where a Field is expected.
    not_taken: ClassVar[str] = ": it holds numbers, not motions"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        names = ("lon", "lat", "values", "sigma")
        arrays = {column: np.array(floats_or_nan(column, getattr(self, column))) for column in names}
        if self.name is not None:
            arrays["name"] = np.asarray(self.name)
        check_column_shapes(arrays, lambda column: (arrays["lon"].size,))
        invalid_rows = _find_invalid_rows(arrays["lon"], arrays["lat"], arrays["values"], arrays["sigma"])
        select_usable_rows(invalid_rows, arrays["lon"].size)
        self._set_frozen(**arrays, unit=str(self.unit), notes=tuple(self.notes))

    @classmethod
    def from_columns(
        cls,
        ra: Any,
        dec: Any,
        values: Any,
        errors: Any,
        *,
        unit: str = "",
        name: ArrayLike | None = None,
        frame: str = "icrs",
        on_bad: OnBad = "raise",
        notes: Iterable[str] = (),
    ) -> ScalarField:
        """A field from columns as catalogues have them.

        Parameters
        ----------
        ra, dec : (n,) arrays
            Positions [deg, or Quantities of any angle]
        values, errors : (n,) arrays
            In `unit`; Quantities and columns with units are converted to it. Masked or missing ones cannot be used.
        unit : str
            Unit of both, as astropy writes it ("uas", "mag"); that of the values unless given.
        name : (n,) array, optional
            One for each source.
        frame : str
            Axes of the positions.
        on_bad : {"raise", "drop"}
            What to do about sources that cannot be used; a note counts what was dropped.
        notes : iterable of str
            Its first notes.

        Raises
        ------
        FieldError
            If a column is no array of n numbers, or, with "raise", if any source cannot be used.

        Examples
        --------
        >>> ScalarField.from_columns([10.0], [-20.0], [-0.02], [0.1], unit="mas")
        <ScalarField: 1 sources, icrs, in mas>
        """
        unit = unit or str(getattr(values, "unit", None) or "")
        columns, missing = {}, {}
        for column, array, column_unit in (
            ("ra", ra, "deg"),
            ("dec", dec, "deg"),
            ("values", values, unit),
            ("errors", errors, unit),
        ):
            columns[column], missing[column] = as_floats_and_mask(column, _convert_to_quantity(array), column_unit)
        if name is not None:
            columns["name"] = np.asarray(name)
        check_column_shapes(columns, lambda column: (columns["ra"].size,))
        lon, lat = columns["ra"] * DEGREE, columns["dec"] * DEGREE
        missing_rows = {f"{column} missing": mask for column, mask in missing.items()}
        invalid = _find_invalid_rows(lon, lat, columns["values"], columns["errors"], missing_rows, turns=1)
        rows, added_notes = select_usable_rows(invalid, lon.size, on_bad, identifying_arrays=(lon, lat))
        names = columns["name"][rows] if name is not None else None
        lon, lat, numbers, sigma = (column[rows] for column in (lon, lat, columns["values"], columns["errors"]))
        return cls(lon, lat, numbers, sigma, unit, names, frame, (*notes, *added_notes))

    @classmethod
    def from_counts(
        cls, lon: ArrayLike, lat: ArrayLike, nside: int | None = None, selection: Any = None, *, frame: str = "icrs"
    ) -> ScalarField:
        """The number density of sources: counts in pixels over those expected, less one, with the noise of counts.

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        nside : int, optional
            Resolution of the pixels; unless given, such that 30 sources are expected in each, 32 at most.
        selection : (12 nside²,) array, optional
            Share of the sources of each pixel that the catalogue has, a HEALPix map in ring order in the axes of
            `frame`, up to a factor; zero, or not finite, where nothing was observed. The same everywhere unless given.
        frame : str
            Axes of the positions.

        Raises
        ------
        ParameterError
            If the selection is no map, or negative, or no source lies where it is above zero; or if a part of the sky
            has no source, and no selection is given.

        Notes
        -----
        The dipole of the field is that of the density relative to the mean of the pixels used; where these are a part
        of the sky, it is divided by one plus the fitted mean. Clustering of the sources is power of every degree, which
        the floor of `fit.recommended` takes into account.

        Examples
        --------
        >>> rng = np.random.default_rng(1)
        >>> lon, lat = rng.uniform(0, 2 * np.pi, 50_000), np.arcsin(rng.uniform(-1, 1, 50_000))
        >>> ScalarField.from_counts(lon, lat, 8)
        <ScalarField: 768 sources, icrs>
        """
        lon, lat = float_array("lon", lon), float_array("lat", lat)
        coverage = np.ones(12) if selection is None else np.ravel(float_array("selection", selection, finite=False))
        coverage, map_nside = np.where(np.isfinite(coverage), coverage, 0.0), np.sqrt(coverage.size / 12)
        if map_nside != int(map_nside) or (coverage < 0).any():
            raise ParameterError(f"a selection is a HEALPix map of at least zero, not {coverage.size} values")
        if nside is None:
            largest_nside2 = lon.size / (12 * _IN_PIXEL * max((coverage > 0).mean(), 1e-3))
            nside = next((candidate for candidate in (32, 16, 8, 4, 2) if candidate**2 <= largest_nside2), 1)
        n_pixels = 12 * check_nside(nside) ** 2
        if selection is None:
            coverage = np.ones(n_pixels)
        elif nside != map_nside:  # the mean of the pixels within
            pixels = pixels_of(*centres(int(map_nside)), nside)
            coverage = np.bincount(pixels, coverage, n_pixels) / np.maximum(np.bincount(pixels, minlength=n_pixels), 1)
        counts, is_used = np.bincount(pixels_of(lon, lat, nside), minlength=n_pixels), coverage > 0
        if not counts[is_used].any():
            raise ParameterError(f"none of {lon.size} sources lies where the selection is above zero")
        expected = counts[is_used].sum() * coverage[is_used] / coverage[is_used].sum()
        notes = [f"counts of {counts[is_used].sum()} sources in {is_used.sum()} pixels of nside {nside}"]
        if n_outside := int(counts[~is_used].sum()):
            notes.append(f"{n_outside} sources lie where the selection is zero and are not counted")
        if (n_empty := int(((counts[is_used] == 0) & (expected > _FULL_PIXEL)).sum())) > 0:
            remark = f"{n_empty} pixels have no source where {_FULL_PIXEL:g} or more are expected: give a selection"
            if selection is None:
                raise ParameterError(f"{remark}, a HEALPix map of what of the sky the catalogue has (density,MAP)")
            notes.append(f"warning: {remark} without them")
        if 100 * (n_repeated := lon.size - np.unique(lon + 1j * lat).size) > lon.size:
            notes.append(f"warning: {n_repeated} of {lon.size} sources are at the place of another, and count each")
        lon, lat = (angle[is_used] for angle in centres(nside))
        return cls(lon, lat, counts[is_used] / expected - 1, 1 / np.sqrt(expected), "", None, frame, tuple(notes))

    def _make_table_columns(self):
        columns = {"source_id": np.arange(1, len(self) + 1) if self.name is None else self.name}
        lon, lat, *_ = AXES[self.frame]
        columns |= {
            lon: np.degrees(self.lon),
            lat: np.degrees(self.lat),
            "value": self.values,
            "value_error": self.sigma,
        }
        units = {lon: "deg", lat: "deg"} | (dict.fromkeys(("value", "value_error"), self.unit) if self.unit else {})
        return columns, units, {} if self.frame == "icrs" else {FRAME_KEY: self.frame}

    def __repr__(self) -> str:
        return f"<ScalarField: {len(self)} sources, {self.frame}{', in ' if self.unit else ''}{self.unit}>"

    @property
    def data(self) -> FloatArray:
        """The values as (1, n): what is fitted."""
        return self.values[None]

    @property
    def weights(self) -> FloatArray:
        """1/σ² of each source, (1, n)."""
        return 1 / self.sigma[None] ** 2

    @property
    def whitened(self) -> FloatArray:
        """The values in units of their errors, (1, n)."""
        return self.data / self.sigma

    def minus(self, model: ArrayLike) -> ScalarField:
        """Subtract the values of a model, `model` (n,) in `unit`."""
        return self._derive(values=self.values - float_array("model", model, self.values.shape, broadcast=True))

    def with_errors(self, sigma: ArrayLike) -> ScalarField:
        """Replace the standard errors `sigma`, (n,). [`unit`]"""
        return replace(self, sigma=float_array("sigma", sigma, finite=False, unit=self.unit))

    def to_frame(self, name: str) -> ScalarField:
        """Turn the positions to the frame `name` (icrs, galactic, ecliptic); the values stay."""
        if check_frame(name) == self.frame:
            return self
        lon, lat = angles(rotation_matrix(self.frame, name) @ triad(self.lon, self.lat)[2])
        return self._derive(lon=lon, lat=lat, frame=name)


def _find_invalid_rows(lon, lat, values, sigma, further=None, turns=2):
    return find_bad_rows(lon, lat, values[None], sigma[None], np.zeros(lon.shape), further, turns=turns, label="value")


def _convert_to_quantity(column):
    """A column of a table as a Quantity, where it has a unit."""
    return column.quantity if getattr(column, "unit", None) is not None and hasattr(column, "quantity") else column


def modes_for(field: Any, value: Any) -> Modes:
    """The modes in which a field is expanded: `ScalarModes` of a ScalarField, `Modes` of anything else."""
    return as_modes(value, ScalarModes if isinstance(field, ScalarField) else Modes)
