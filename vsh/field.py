"""A field of proper motions: the one noun that simulations make and fits consume."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from vsh.checks.arrays import float_array, read_only
from vsh.checks.columns import (
    MEASURED,
    check_measured,
    joined,
    skycoord_columns,
    still_columns,
    table_columns,
    usable_columns,
)
from vsh.checks.tabled import Tabled
from vsh.checks.types import ArrayLike, BoolArray, FloatArray, OnBad
from vsh.checks.validation import check_shapes, checked_columns, invalid_rows, select_usable
from vsh.errors import FieldError
from vsh.sky.frames import check_frame, rotation_matrix, turned
from vsh.sky.redshift_frames import check_redshift_frame


@dataclass(frozen=True, eq=False, repr=False)
class Field(Tabled):
    """Proper motions of n sources, with their errors; checked once, here. Its arrays are read-only.

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
        Where something tells it better than the redshift; nan where nothing does. [Mpc, transverse comoving]
    name : (n,) array or None
        64-bit integers or text.
    frame : str
        "icrs", "galactic" or "ecliptic".
    redshift_frame : str or None
        "heliocentric", "cmb", "local-group"; "true" for redshifts of the expansion alone; None where nobody says it.
    notes : tuple of str
        What a reader of any result should know: units that were assumed, rows that were left out.

    Raises
    ------
    FieldError
        If shapes disagree or a source cannot be used: something not finite, σ ≤ 0, ρ² ≥ 1 - 1e-6, |lat| > 90°; or
        if a distance has no error.
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

    components: ClassVar[int] = 2
    unit: ClassVar[str] = "µas/yr"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        if self.redshift_frame is not None:
            self._set("redshift_frame", check_redshift_frame(self.redshift_frame))
        for column, array in checked_columns(self, ("lat", "motion", "sigma", "rho", *MEASURED), ("name",)).items():
            self._set(column, array)
        check_measured(self)
        self._set("notes", tuple(self.notes))

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
            Of the positions and motions alike; of the redshifts.
        on_bad : {"raise", "drop"}
            What to do about sources that cannot be used.
        notes : iterable of str
            Its first notes.
        first_row : int
            Number of the first row in messages, where the columns are part of a table.
        unusable : dict of str to mask, optional
            Further rows that cannot be used, by reason.
        **measured
            redshift, magnitude, redshift_error, distance, distance_error, (n,) each.

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
        given = {"ra": ra, "dec": dec, "pmra": pmra, "pmdec": pmdec, "pmra_error": pmra_error, "pmdec_error": pmdec_error,
                 "pmra_pmdec_corr": pmra_pmdec_corr}  # fmt: skip
        if not set(measured) <= set(MEASURED):
            raise FieldError(
                f"no column is called {', '.join(set(measured) - set(MEASURED))}: {', '.join(MEASURED)} are"
            )
        columns, said = usable_columns(given | measured, name, on_bad, first_row, unusable)
        return cls(**columns, frame=frame, redshift_frame=redshift_frame, notes=(*notes, *said))

    @classmethod
    def from_skycoord(
        cls, coord: Any, pmra_error: Any, pmdec_error: Any, pmra_pmdec_corr: ArrayLike | None = None, **further: Any
    ) -> Field:
        """A field from an astropy SkyCoord with proper motions, and their errors along the same axes.

        Parameters
        ----------
        coord : SkyCoord
            In ICRS, galactic or barycentricmeanecliptic coordinates; the field is in that frame.
        pmra_error, pmdec_error : (n,) arrays
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
        columns, frame = skycoord_columns(coord)
        return cls.from_columns(
            **columns, pmra_error=pmra_error, pmdec_error=pmdec_error, pmra_pmdec_corr=pmra_pmdec_corr, frame=frame, **further
        )  # fmt: skip

    @classmethod
    def without_motions(cls, sources: Any, sigma: ArrayLike | None = None) -> Field:
        """Positions and errors as a Field whose motions are zero; a Field as it is.

        Parameters
        ----------
        sources : Field, Population, or anything with lon and lat [rad], and perhaps sigma, rho, frame
            As for `fit.correlation.predict`.
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
            return sources if sigma is None else sources.with_errors(np.broadcast_to(sigma, (2, len(sources))))
        return cls(**still_columns(sources, sigma), frame=getattr(sources, "frame", "icrs"))

    def __len__(self) -> int:
        return self.lon.size

    @property
    def data(self) -> FloatArray:
        """The motions, (2, n): what is fitted. [µas/yr]"""
        return self.motion

    @property
    def weights(self) -> FloatArray:
        """The inverse covariance [[a, c], [c, b]] of each source, (3, n): a, b, c. [(yr/µas)²]"""
        a, b = 1 / self.sigma**2
        c = -self.rho / (self.sigma[0] * self.sigma[1])
        return np.stack([a, b, c]) / (1 - self.rho**2)

    @property
    def whitened(self) -> FloatArray:
        """The motions decorrelated and in units of their errors, L⁻¹ µ with L Lᵀ = C, (2, n)."""
        (s1, s2), rho, (east, north) = self.sigma, self.rho, self.motion
        return np.stack([east / s1, (north / s2 - rho * east / s1) / np.sqrt(1 - rho**2)])

    def __repr__(self) -> str:
        known = [name for name in (*MEASURED, "name") if getattr(self, name) is not None]
        return f"<Field: {len(self)} sources, {self.frame}{', with ' if known else ''}{', '.join(known)}>"

    def __add__(self, other: Field) -> Field:
        """The sources of both, one after the other, in one frame; what one does not know of its sources is missing."""
        return self._with(**joined(self, other)) if isinstance(other, Field) else NotImplemented

    def minus(self, model: ArrayLike) -> Field:
        """What is left when a model's motions are taken away.

        Parameters
        ----------
        model : (2, n) array
            Motions. [µas/yr]
        """
        return self._with(motion=self.motion - float_array("model", model, self.motion.shape, broadcast=True))

    def with_errors(self, sigma: ArrayLike, rho: ArrayLike | None = None) -> Field:
        """The same motions with other standard errors, (2, n) [µas/yr], and perhaps correlations, (n,).

        Parameters
        ----------
        sigma : (2, n) array
            Standard errors. [µas/yr]
        rho : (n,) array, optional
            Their correlation; as it is unless given.
        """
        rho = self.rho if rho is None else float_array("rho", rho, finite=False)
        sigma = float_array("sigma", sigma, finite=False)
        shapes: dict[str, tuple[int, ...]] = {"sigma": (2, len(self)), "rho": (len(self),)}
        check_shapes({"sigma": sigma, "rho": rho}, shapes.__getitem__)
        select_usable(invalid_rows(self.lon, self.lat, self.motion, sigma, rho), len(self))
        return self._with(sigma=sigma, rho=rho)

    def to_frame(self, name: str) -> Field:
        """The same sources in another frame; motions and covariances turn with the axes.

        Parameters
        ----------
        name : {"icrs", "galactic", "ecliptic"}
            The frame to turn to.
        """
        if check_frame(name) == self.frame:
            return self
        matrix = rotation_matrix(self.frame, name)
        lon, lat, motion, sigma, rho = turned(matrix, self.lon, self.lat, self.motion, self.sigma, self.rho)
        return self._with(lon=lon, lat=lat, motion=motion, sigma=sigma, rho=rho, frame=name)

    def _table(self):
        return table_columns(self)

    def _set(self, column, value):
        # A read-only view: the caller's array stays as it is.
        object.__setattr__(self, column, read_only(value) if isinstance(value, np.ndarray) else value)

    def _with(self, **changes):
        """A field derived from this one, which has been checked already."""
        new = object.__new__(Field)
        for f in fields(self):
            new._set(f.name, changes.get(f.name, getattr(self, f.name)))
        return new


def field_or_fields(name: str, value: Any) -> Any:
    """A Field, or a list, tuple or stream of Fields."""
    if isinstance(value, Field):
        return value
    if isinstance(value, (list, tuple)) and value and all(isinstance(each, Field) for each in value):
        return value
    if hasattr(value, "__next__"):
        return value
    raise ParameterError(f"{name} must be a Field, or a list or stream of Fields, not {type(value).__name__}")
