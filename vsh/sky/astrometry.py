"""Five astrometric parameters of stars: propagation between epochs, with derivatives, and rows of catalogues."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, fields, replace
from typing import Any

import erfa
import numpy as np

from vsh.sky.sphere import angles, triad
from vsh.tools.bad_rows import check_column_shapes, floats_or_nan
from vsh.tools.errors import EmptyFieldError, FieldError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import merge_notes
from vsh.tools.printing import one_line_text
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray
from vsh.tools.units import AU_PER_YEAR, UAS

__all__ = ["AstrometryRows", "add_positions", "earth", "propagate"]

_ARCSEC = UAS * 1e6


def propagate(
    parameters: ArrayLike, radial_velocity: ArrayLike, start: ArrayLike, end: ArrayLike, *, light_time: bool = True
) -> tuple[FloatArray, FloatArray]:
    """Propagate the five parameters of stars from one epoch to another, along straight lines in space.

    Parameters
    ----------
    parameters : (5, n) array
        Right ascension and declination [rad], parallax [µas], µ_α* and µ_δ [µas/yr], at `start`.
    radial_velocity : (n,) array
        [km/s]
    start, end : (n,) arrays
        Epochs. [Julian year]
    light_time : bool
        Whether to include the changing light travel time from the star, as ERFA's `pmsafe` does. If False, the model
        of ESA SP-1200, vol. 1, sect. 1.5.5, is used, which leaves it out.

    Returns
    -------
    parameters : (5, n) array
        The five parameters at `end`, in the same units.
    jacobian : (n, 5, 5) array
        Derivatives of Δα*, Δδ, ϖ, µ_α*, µ_δ at `end` with respect to those at `start`. [µas, µas/yr]

    Notes
    -----
    The derivatives are always those of the model of SP-1200. Each epoch has its own local axes.
    """
    lon, lat, parallax, *motion = np.asarray(parameters, float)
    velocity, start, end = (np.broadcast_to(np.asarray(x, float), lon.shape) for x in (radial_velocity, start, end))
    t = end - start
    p, q, r = triad(lon, lat)
    # Lengths are in units of the distance at `start`; b is the position of the star at `end`.
    zeta = velocity * parallax * UAS / AU_PER_YEAR
    transverse_rate = (p * motion[0] + q * motion[1]) * UAS
    b, rate = r * (1 + zeta * t) + transverse_rate * t, r * zeta + transverse_rate
    f = 1 / np.linalg.norm(b, axis=0)
    r_end = b * f
    radial_rate = np.sum(r_end * rate, 0)
    sky_motion = f * (rate - r_end * radial_rate)
    if light_time:
        propagated = _propagate_with_erfa(lon, lat, parallax, motion, velocity, start, end)
    else:
        new_lon, new_lat = angles(r_end)
        p_end, q_end, _ = triad(new_lon, new_lat)
        propagated = np.stack(
            [new_lon, new_lat, parallax * f, np.sum(p_end * sky_motion, 0) / UAS, np.sum(q_end * sky_motion, 0) / UAS]
        )
    p_end, q_end, _ = triad(propagated[0], propagated[1])
    jacobian = np.empty((len(lon), 5, 5))
    by_parallax = velocity / AU_PER_YEAR * r
    # The local axes turn with the position, and so the components of the motion change.
    turn_p = (np.tan(lat) * (q * motion[0] - p * motion[1]) - r * motion[0]) * UAS
    turn_q = -r * motion[1] * UAS
    derivatives = (
        (p * (1 + zeta * t) + turn_p * t, p * zeta + turn_p, 0.0),
        (q * (1 + zeta * t) + turn_q * t, q * zeta + turn_q, 0.0),
        (by_parallax * t, by_parallax, 1.0),
        (p * t, p, 0.0),
        (q * t, q, 0.0),
    )
    for k, (db, drate, dparallax) in enumerate(derivatives):
        df = -(f**2) * np.sum(r_end * db, 0)
        dr = f * db + b * df
        dsky_motion = df / f * sky_motion + f * (
            drate - dr * radial_rate - r_end * (np.sum(dr * rate, 0) + np.sum(r_end * drate, 0))
        )
        east = np.sum(p_end * dr, 0)
        turn = np.tan(propagated[1]) * east * np.stack([np.sum(q_end * sky_motion, 0), -np.sum(p_end * sky_motion, 0)])
        jacobian[:, 0, k], jacobian[:, 1, k] = east, np.sum(q_end * dr, 0)
        jacobian[:, 2, k] = dparallax * f + parallax * UAS * df
        jacobian[:, 3, k] = np.sum(p_end * dsky_motion, 0) + turn[0]
        jacobian[:, 4, k] = np.sum(q_end * dsky_motion, 0) + turn[1]
    return propagated, jacobian


def add_positions(covariance: ArrayLike, position_covariance: ArrayLike, years: ArrayLike) -> FloatArray:
    """Compute the covariances of five parameters after positions of another survey are added.

    Parameters
    ----------
    covariance : (n, 5, 5) array
        Covariances of Δα*, Δδ, ϖ, µ_α*, µ_δ at the epoch of the first catalogue. [µas, µas/yr]
    position_covariance : (n, 2, 2) or (2, 2) array
        Covariances of Δα* and Δδ in the other survey, in the frame of the first. [µas²]
    years : (n,) array or float
        Mean epoch of the other survey minus that of the first catalogue. [yr]

    Returns
    -------
    covariance : (n, 5, 5) array
        Covariances of the joint solution, at the epoch of the first catalogue.

    Notes
    -----
    The positions are assumed to be means over several years, without parallactic displacement. They cannot correct the
    frame of the first catalogue, because the survey takes the zero point of each of its fields from that catalogue. Nor
    can they correct the systematic errors of the first catalogue.

    Examples
    --------
    >>> gaia = np.diag([0.08, 0.07, 0.1, 0.05, 0.04]) ** 2
    >>> joint = add_positions(gaia[None], 0.2**2 * np.eye(2), 10.0)
    >>> np.sqrt(joint[0].diagonal()).round(3)
    array([0.079, 0.069, 0.1  , 0.02 , 0.019])
    """
    covariance = np.asarray(covariance, float)
    design = np.zeros((len(covariance), 2, 5))
    design[:, [0, 1], [0, 1]] = 1.0
    design[:, [0, 1], [3, 4]] = np.broadcast_to(years, len(covariance))[:, None]
    projected_covariance = design @ covariance
    gain = np.linalg.solve(projected_covariance @ design.swapaxes(1, 2) + position_covariance, projected_covariance)
    return covariance - projected_covariance.swapaxes(1, 2) @ gain


def _propagate_with_erfa(lon, lat, parallax, motion, velocity, start, end):
    """Propagate with ERFA; its warning that it replaces a zero or negative parallax is ignored."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        propagated = erfa.pmsafe(
            lon, lat, motion[0] * UAS / np.cos(lat), motion[1] * UAS, np.maximum(parallax, 0) * UAS / _ARCSEC, velocity,
            2451545.0, (start - 2000.0) * 365.25, 2451545.0, (end - 2000.0) * 365.25,
        )  # fmt: skip
    new_lon, new_lat, lon_motion, lat_motion, new_parallax, _ = propagated
    # ERFA replaces parallaxes that are zero, and those of stars that would move at a hundredth of the speed of light.
    is_replaced = parallax * UAS / _ARCSEC < np.maximum(1e-6, 327 * np.hypot(*motion) * UAS)
    return np.stack(
        [
            new_lon % (2 * np.pi),
            new_lat,
            np.where(is_replaced, parallax, new_parallax * _ARCSEC / UAS),
            lon_motion * np.cos(new_lat) / UAS,
            lat_motion / UAS,
        ]
    )


def earth(epoch: ArrayLike) -> FloatArray:
    """Compute the barycentric position of the Earth in ICRS, (3, n), to a few km (ERFA's `epv00`). [au]

    Parameters
    ----------
    epoch : (n,) array
        [Julian year]
    """
    days = (np.asarray(epoch, float) - 2000.0) * 365.25
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", erfa.ErfaWarning)
        _, barycentric = erfa.epv00(2451545.0, days)
    return np.asarray(barycentric["p"]).T


#: A correlation matrix with an eigenvalue below this is singular. Rounding errors are smaller.
_SINGULAR = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class AstrometryRows(Frozen):
    """Table of n rows, each with up to five parameters of a source from one of several catalogues, in ICRS.

    Parameters that were not measured are nan: a row may have a position alone, or motions without a position.

    Attributes
    ----------
    name, catalogue : (n,) arrays of str
        Name of the source of each row, and name of the catalogue. A source has the same name in all catalogues.
    epoch : (n,) array
        [Julian year]
    lon, lat : (n,) arrays
        [rad]
    parallax : (n,) array
        [µas]
    motion : (2, n) array
        µ_α*, µ_δ. [µas/yr]
    covariance : (n, 5, 5) array
        Covariance of α*, δ, ϖ, µ_α*, µ_δ; nan in the rows and columns of parameters that were not measured. [µas,
        µas/yr]
    radial_velocity : (n,) array
        nan counts as zero; all are nan unless given. [km/s]
    magnitude : (n,) array
        nan if not known. A source has that of its first row for which it is known.
    still : (n,) bool array
        Mask of the sources that have no parallax and no motion of their own, such as quasars. False unless given.
    displaced : (n,) bool array
        Mask of the positions that are as seen from the Earth at a single epoch, displaced by the parallax. Unless
        given, these are the rows without a parallax, except those of `still` sources.
    calibrator : (n,) array of str
        Calibrator against which the position was measured. Sources with the same calibrator have its error in common.
        Empty if not known.
    notes : tuple of str

    Raises
    ------
    FieldError
        If shapes disagree, a row has no epoch or no measured parameter, a covariance is not positive definite, or
        two rows are the same.
    """

    name: Any
    catalogue: Any
    epoch: FloatArray
    lon: FloatArray
    lat: FloatArray
    parallax: FloatArray
    motion: FloatArray
    covariance: FloatArray
    radial_velocity: FloatArray = None  # type: ignore[assignment]
    magnitude: FloatArray = None  # type: ignore[assignment]
    still: BoolArray = None  # type: ignore[assignment]
    displaced: BoolArray = None  # type: ignore[assignment]
    calibrator: Any = None
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check shapes and values, and fill in what was not given."""
        name = np.asarray(self.name).astype(str)
        n = name.size
        if n == 0:
            raise EmptyFieldError("there is no row of astrometry")
        columns: dict[str, Any] = {"name": name, "catalogue": np.asarray(self.catalogue).astype(str)}
        for column in ("epoch", "lon", "lat", "parallax", "motion", "covariance"):
            columns[column] = floats_or_nan(column, getattr(self, column))
        for column in ("radial_velocity", "magnitude"):
            value = getattr(self, column)
            columns[column] = np.full(n, np.nan) if value is None else floats_or_nan(column, value)
        calibrator = np.full(n, "") if self.calibrator is None else np.asarray(self.calibrator).astype(str)
        columns["calibrator"] = np.char.strip(calibrator)
        still = np.zeros(n, bool) if self.still is None else np.asarray(self.still, bool)
        if self.displaced is None:
            is_displaced = ~still & ~np.isfinite(columns["parallax"]) if columns["parallax"].shape == (n,) else still
        else:
            is_displaced = np.asarray(self.displaced, bool)
        columns |= {"still": still, "displaced": is_displaced}
        shapes: dict[str, tuple[int, ...]] = {"motion": (2, n), "covariance": (n, 5, 5)}
        check_column_shapes(columns, lambda column: shapes.get(column, (n,)))
        self._set_frozen(**columns)
        self._check_rows()

    def _check_rows(self):
        """Raise FieldError if rows cannot be used, with the number of rows and the first row for each reason."""
        is_measured = self.measured
        unusable_rows = {
            "no epoch": ~np.isfinite(self.epoch) | (np.abs(self.epoch - 2000) > 1000),
            "nothing measured that has an error": ~is_measured.any(1),
            "|dec| > 90°": np.abs(self.lat) > np.pi / 2 * (1 + 1e-14),
            "a position with only one coordinate": is_measured[:, 0] != is_measured[:, 1],
            "a covariance that is not positive definite": ~self._find_definite_covariances(is_measured),
        }
        _, key_numbers, n_same = np.unique(self._make_row_keys(), axis=0, return_inverse=True, return_counts=True)
        unusable_rows["the same row twice"] = n_same[key_numbers.ravel()] > 1
        complaints = [
            f"{reason}: {int(mask.sum())} ({one_line_text(self.name[mask][0])} in {self.catalogue[mask][0]}, "
            f"row {int(mask.argmax())})"
            for reason, mask in unusable_rows.items()
            if mask.any()
        ]
        if complaints:
            raise FieldError(
                f"some of the {len(self)} rows cannot be used: {'; '.join(complaints)}; rows are counted from 0. "
                "Correct them or leave them out"
            )

    def _make_row_keys(self):
        """Return the values that identify each row; rows with equal values are duplicates."""
        catalogue_index = np.unique(self.catalogue, return_inverse=True)[1].ravel()
        return np.nan_to_num(np.column_stack([self.source, catalogue_index, self.epoch, self.values.T]), nan=-1e300)

    def _find_definite_covariances(self, is_measured):
        pair_mask = is_measured[:, :, None] & is_measured[:, None, :]
        diagonal = np.eye(5, dtype=bool)
        sigma = np.sqrt(np.where(is_measured, np.diagonal(self.covariance, axis1=1, axis2=2), 1.0))
        matrix = np.where(pair_mask, self.covariance, diagonal) / (sigma[:, :, None] * sigma[:, None, :])
        is_finite = np.isfinite(matrix).all((1, 2))
        matrix = np.where(is_finite[:, None, None], matrix, np.eye(5))
        is_symmetric = np.abs(matrix - matrix.transpose(0, 2, 1)).max((1, 2)) < _SINGULAR
        return is_finite & is_symmetric & (np.linalg.eigvalsh(matrix)[:, 0] > _SINGULAR)

    def __len__(self) -> int:
        return self.name.size

    def __repr__(self) -> str:
        counts = ", ".join(f"{int(np.sum(self.catalogue == name))} of {name}" for name in self.catalogues)
        return f"<AstrometryRows: {self.source.max() + 1} sources, rows: {counts}>"

    def __getitem__(self, keep: Any) -> AstrometryRows:
        """Select rows by a mask, a slice or indices."""
        arrays = {column: value for column, value in vars(self).items() if column != "notes"}
        return replace(self, **{k: v[:, keep] if k == "motion" else v[keep] for k, v in arrays.items()})

    def __add__(self, other: AstrometryRows) -> AstrometryRows:
        """Concatenate the rows of both."""
        if not isinstance(other, AstrometryRows):
            return NotImplemented
        columns: dict[str, Any] = {
            entry.name: np.concatenate([getattr(self, entry.name), getattr(other, entry.name)], axis=-1)
            for entry in fields(self)
            if entry.name not in ("covariance", "notes")
        }
        covariance = np.concatenate([self.covariance, other.covariance])
        return AstrometryRows(**columns, covariance=covariance, notes=merge_notes(self.notes, other.notes))

    @property
    def catalogues(self) -> tuple[str, ...]:
        """Names of the catalogues, in the order of their first rows."""
        return tuple(dict.fromkeys(self.catalogue.tolist()))

    @property
    def source(self) -> IntArray:
        """Number of the source of each row, from 0 by first appearance; case and blanks in names are ignored."""
        name_keys = ["".join(name.split()).casefold() for name in self.name.tolist()]
        numbers = {key: number for number, key in enumerate(dict.fromkeys(name_keys))}
        return np.array([numbers[key] for key in name_keys])

    @property
    def values(self) -> FloatArray:
        """The five parameters, (5, n): positions in rad, the others in µas and µas/yr."""
        return np.vstack([self.lon, self.lat, self.parallax, self.motion])

    @property
    def measured(self) -> BoolArray:
        """Mask of the parameters that each row has together with an error, (n, 5)."""
        with np.errstate(invalid="ignore"):
            return np.isfinite(self.values.T) & (np.diagonal(self.covariance, axis1=1, axis2=2) > 0)
