"""Templates: maps of what may cause systematics, cut to the degree of a fit.

A scalar map m may push motions along its slope, ∇m, or across it, r × ∇m: its coefficients a_lm of degrees 1 … L
times √(l(l+1)) are those of a spheroidal and of a toroidal field. Numbers follow the map itself. Cut to degree L a
template is a sum of the modes that are fitted, t = Σ t_k V_k: normal equations with it as a further unknown are EᵀNE
and Eᵀb, E = [1 | t], so no source is looked at again. Its amplitude has a variance of its own, or it could not be
told from the modes.

Structure beyond degree L is left out on purpose: it lines up with systematics beyond L, which no prior holds, and its
amplitude would be taken as better known than it is.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from typing import Any

import numpy as np

from fit.normal._equations import TemplateField
from fit.normal._moments import Moments
from vsh.coefficients import Coefficients
from vsh.field import Field
from vsh.modes import KINDS, Modes, ScalarModes
from vsh.scalars import ScalarField
from vsh.sky.frames import check_frame
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import float_array
from vsh.tools.errors import FrameError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, FloatArray

#: Two templates whose directions agree as closely as this are one.
_SAME_DIRECTION = 0.999
#: A map that varies by less of its largest value is constant.
_CONSTANT_SCATTER = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Template(Frozen):
    """A map of what may cause systematics: counts of transits, moments of scan angles, densities, motions of stars.

    Attributes
    ----------
    name : str
        What it is called.
    source : (12 nside²,) array, path, Coefficients or ScalarField
        A HEALPix map in ring order, with NaN where nothing is known; a file of one (FITS); motions as they are; or
        numbers at places, weighed by their errors: a column of a catalogue say.
    frame : str
        Axes of a map or of coefficients: "icrs", "galactic" or "ecliptic"; ICRS unless given, or what the header of a
        file states.

    Raises
    ------
    ParameterError
        If the source is none of these.
    TableError
        If a file cannot be read, or does not state its axes and `frame` is not given.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
    >>> field = Field(lon, lat, rng.normal(size=(2, 2000)), np.ones((2, 2000)))
    >>> Template.density("density", field)
    <Template: density, icrs>
    """

    name: str
    source: Any
    frame: str = None  # type: ignore[assignment]  # a string once it is made

    def __post_init__(self) -> None:
        if isinstance(self.source, str | PathLike):
            from vsh.io.maps import read_map_with_frame  # healpy

            remedy = f"frame='galactic' (--templates galactic:{self.name}), or which it is"
            values, frame = read_map_with_frame(self.source, self.frame, remedy)
            object.__setattr__(self, "source", values)
            object.__setattr__(self, "frame", frame)
        elif self.frame is None:
            object.__setattr__(self, "frame", "icrs")
        check_frame(self.frame)
        if isinstance(self.source, Coefficients | ScalarField):
            return
        values = np.ravel(float_array("template", self.source, finite=False))
        nside = np.sqrt(values.size / 12)
        if values.size < 12 or nside != int(nside):
            raise ParameterError(
                f"the template {self.name} has {values.size} values, which is no HEALPix map; numbers at places are "
                "Template.of_sources(name, lon, lat, values)"
            )
        object.__setattr__(self, "source", values)

    def __repr__(self) -> str:
        return f"<Template: {self.name}, {self.frame}>"

    @classmethod
    def of_sources(
        cls, name: str, lon: ArrayLike, lat: ArrayLike, values: ArrayLike, frame: str = "icrs"
    ) -> "Template":
        """A template of numbers at places: a column of a catalogue.

        Parameters
        ----------
        name : str
            What it is called.
        lon, lat : (n,) arrays
            Positions. [rad]
        values : (n,) array
            The numbers; sources whose number is not finite are left out.
        frame : str
            Axes of the positions.
        """
        lon, lat, numbers = _select_finite(lon, lat, values)
        return cls(name, ScalarField(lon, lat, numbers, np.ones(len(numbers)), frame=frame), frame)

    @classmethod
    def of_parts(
        cls, name: str, parts: Iterable[tuple[ArrayLike, ArrayLike, ArrayLike]], frame: str = "icrs", nside: int = 128
    ) -> "Template":
        """Make a template of a catalogue in parts: means over the sources of each HEALPix pixel, at their mean place.

        Parameters
        ----------
        name : str
            What it is called.
        parts : iterable of (lon, lat, values)
            Positions [rad] and numbers, part by part; numbers that are not finite are left out.
        frame : str
            Axes of the positions.
        nside : int
            Resolution; a template of degree l keeps 1 − (l/3.4 nside)² of its power or more.

        Raises
        ------
        ParameterError
            If no number is finite.
        """
        from vsh.sky.pixels import pixels_of  # slow to import

        sums = np.zeros((5, 12 * nside**2))
        for chunk in parts:
            lon, lat, numbers = _select_finite(*chunk)
            if not len(numbers):
                continue
            pixel_numbers = pixels_of(lon, lat, nside)
            for sum_row, weight in zip(sums, (np.ones(len(numbers)), numbers, *triad(lon, lat)[2]), strict=True):
                sum_row += np.bincount(pixel_numbers, weight, minlength=sum_row.size)
        counts, total, *mean_vectors = sums[:, sums[0] > 0]
        if not counts.size:
            raise ParameterError(f"the template {name} has no finite number")
        lon, lat = angles(np.array(mean_vectors))
        return cls(name, ScalarField(lon, lat, total / counts, 1 / np.sqrt(counts), frame=frame), frame)

    @classmethod
    def density(cls, name: str, field: Field | ScalarField | Iterable[Field], nside: int = 16) -> "Template":
        """A template of the number of sources on the sky.

        Parameters
        ----------
        name : str
            What it is called.
        field : Field, ScalarField, or iterable of Fields
            The sources, in one frame.
        nside : int
            Resolution of the map.
        """
        from vsh.sky.pixels import pixels_of  # slow to import, as below

        counts, frame = np.zeros(12 * nside**2), "icrs"
        for chunk in [field] if isinstance(field, Field | ScalarField) else field:
            counts += np.bincount(pixels_of(chunk.lon, chunk.lat, nside), minlength=counts.size)
            frame = chunk.frame
        return cls(name, counts, frame)

    def fields(self, modes: Modes, frame: str) -> list[TemplateField]:
        """The motions that it may cause: along its slope and across of a map, as they are of coefficients.

        Numbers follow the map itself.

        Parameters
        ----------
        modes : Modes
            What is fitted; the template is cut to its degree.
        frame : str
            Axes of the fit.

        Raises
        ------
        ParameterError
            If it is constant, or has no value in half of the sky.
        FrameError
            If its coefficients are of other axes.
        """
        if modes.components == 1:
            if isinstance(self.source, Coefficients):
                raise ParameterError(f"the template {self.name} is of motions, which numbers do not follow")
            coefficients = {self.name: np.r_[0.0, self._fit_scalar_coefficients(modes.lmax, frame)]}
        elif isinstance(self.source, Coefficients):
            if self.frame != frame:
                raise FrameError(f"the template {self.name} is of {self.frame} axes, the fit of {frame} ones")
            common_modes = Modes(min(modes.lmax, self.source.modes.lmax))
            coefficients = {self.name: _pad_coefficients(self.source.to_degree(common_modes.lmax), modes)}
        else:
            scalar = self._fit_scalar_coefficients(modes.lmax, frame)
            degrees = ScalarModes(modes.lmax).degrees[1:]
            scalar = scalar * np.sqrt(degrees * (degrees + 1.0))  # its gradient, in spheroidal modes
            zeros = np.zeros_like(scalar)
            coefficients = {f"{self.name}, along": np.r_[zeros, scalar], f"{self.name}, across": np.r_[scalar, zeros]}
        fields = []
        for name, values in coefficients.items():
            rms = np.sqrt(values**2 @ modes.norm2 / (4 * np.pi))
            if not rms > 0:
                raise ParameterError(f"the template {self.name} is constant: it moves nothing")
            if modes.lmax > 1 and np.all(np.abs(values[modes.degrees > 1]) < _CONSTANT_SCATTER * np.abs(values).max()):
                raise ParameterError(f"the template {self.name} has degree 1 alone, which is what is fitted")
            fields.append(TemplateField(name, values / rms))
        return fields

    def _fit_scalar_coefficients(self, lmax, frame):
        """Fit the coefficients of the map, and give those from degree 1 on."""
        field, scatter = self._standardise_and_find_scatter()
        if scatter == 0:
            raise ParameterError(f"the template {self.name} is constant: it moves nothing")
        normal = Moments.of(field.to_frame(frame), lmax).normal_equations()
        scales = np.sqrt(np.diag(normal.matrix))
        if not (scales > 0).all() or np.linalg.cond(normal.matrix / np.outer(scales, scales)) > 1e6:
            raise ParameterError(f"the template {self.name} is known on too little of the sky for degree {lmax}")
        return np.linalg.solve(normal.matrix, normal.rhs)[1:]

    def _standardise_and_find_scatter(self):
        """Standardise its numbers at places: about their mean, in units of their scatter; and find that scatter."""
        field = self.source
        if not isinstance(field, ScalarField):
            from vsh.sky.pixels import centres, count_missing_pixels

            values, frame = self.source, self.frame
            lon, lat = centres(int(np.sqrt(values.size / 12)))
            is_valid = np.isfinite(values) & (values > -1e30)  # healpy's UNSEEN
            if is_valid.sum() < values.size / 2:
                raise ParameterError(
                    f"the template {self.name} has no value in {count_missing_pixels(values)} of {values.size} pixels"
                )
            field = ScalarField(lon[is_valid], lat[is_valid], values[is_valid], np.ones(is_valid.sum()), frame=frame)
        weights = field.sigma**-2
        mean = np.average(field.values, weights=weights)
        scatter = float(np.sqrt(np.average((field.values - mean) ** 2, weights=weights)))
        if not scatter > _CONSTANT_SCATTER * np.abs(field.values).max(initial=0.0):
            return field, 0.0
        return replace(field, values=(field.values - mean) / scatter), scatter


def _select_finite(lon: ArrayLike, lat: ArrayLike, values: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Select positions and numbers of the sources whose number is finite and not masked."""
    numbers = np.asarray(np.ma.filled(np.ma.asarray(values, float), np.nan))
    valid = np.isfinite(numbers)
    return (float_array("lon", lon, valid.shape)[valid], float_array("lat", lat, valid.shape)[valid], numbers[valid])


def _pad_coefficients(coefficients, modes):
    """Pad coefficients to modes of a higher degree, with zeros above their own."""
    padded_values = np.zeros(len(modes))
    for kind in KINDS:
        for l in range(1, coefficients.modes.lmax + 1):
            padded_values[modes.slice_of(kind, l)] = coefficients.values[coefficients.modes.slice_of(kind, l)]
    return padded_values


def template_fields(templates: Sequence[Template], modes: Modes, frame: str) -> tuple[TemplateField, ...]:
    """The fields of all templates, cut to the degree of `modes`.

    Raises
    ------
    ParameterError
        If one is constant, or two are the same.
    """
    fields = [field for template in templates for field in template.fields(modes, frame)]
    for i, candidate in enumerate(fields):
        for earlier in fields[:i]:
            if abs(candidate.values * modes.norm2 @ earlier.values) / (4 * np.pi) > _SAME_DIRECTION:
                raise ParameterError(f"the templates {earlier.name} and {candidate.name} are the same: leave one out")
    return tuple(fields)
