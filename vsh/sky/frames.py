"""The frames of the sky and the way from one to another, and positions with their errors, of which frames are made."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import float_array
from vsh.tools.bad_rows import check_source_columns
from vsh.tools.errors import FieldError, FrameError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import BoolArray, FloatArray
from vsh.tools.units import UAS

__all__ = ["FRAMES", "Positions", "rotation_matrix"]
#: Our names and astropy's. "ecliptic" is the mean ecliptic and equinox of J2000, barycentric.
FRAMES = {"icrs": "icrs", "galactic": "galactic", "ecliptic": "barycentricmeanecliptic"}
#: Where a table's metadata keep the frame of a field, if it is not ICRS.
FRAME_KEY = "FRAME"
#: Columns of positions and motions by frame: those of ICRS as in Gaia's archive, of the others as in astropy.
AXES = {
    "icrs": ("ra", "dec", "pmra", "pmdec"),
    "galactic": ("l", "b", "pm_l_cosb", "pm_b"),
    "ecliptic": ("ecl_lon", "ecl_lat", "pm_ecl_lon_coslat", "pm_ecl_lat"),
}
#: Where they keep which of the columns of distances and parallaxes are a field's own.
MEASURED_KEY = "MEASURED"
#: What longitude and latitude are called.
ANGLES = {"icrs": ("α", "δ"), "galactic": ("l", "b"), "ecliptic": ("λ", "β")}


def title_of(frame: str) -> str:
    """Name of a frame as it is written in figures and papers."""
    return frame.upper() if frame == "icrs" else frame


def check_frame(name: str) -> str:
    """Return `name` if it is a known frame; raise FrameError otherwise."""
    if not isinstance(name, str) or name not in FRAMES:
        raise FrameError(f"unknown frame {name!r}: choose one of {', '.join(FRAMES)}")
    return name


def coordinate_columns(coord: Any, error: type[Exception] = FrameError) -> tuple[dict[str, Any], str]:
    """Positions of an astropy SkyCoord, motions and distances where it has them, in Gaia's names; and their frame."""
    frame_names = {astropy_name: our_name for our_name, astropy_name in FRAMES.items()}
    frame = coord.frame.name
    if frame not in frame_names:
        raise error(f"coordinates in {frame} are not known: convert to {', '.join(frame_names)}, as with coord.icrs")
    position = coord.spherical
    columns = {"ra": position.lon.to("deg"), "dec": position.lat.to("deg")}
    if "s" in coord.frame.data.differentials:
        motions = coord.sphericalcoslat.differentials["s"]
        columns |= {"pmra": motions.d_lon_coslat.to("mas / yr"), "pmdec": motions.d_lat.to("mas / yr")}
    if position.distance.unit.is_equivalent("m"):
        columns["distance"] = position.distance
    return {name: np.ravel(values) for name, values in columns.items()}, frame_names[frame]


def rotation_matrix(frame: str, to: str) -> FloatArray:
    """The matrix A of r' = A r, from the axes of `frame` to those of `to`.

    Parameters
    ----------
    frame : str
        From which.
    to : str
        To which.

    Examples
    --------
    The Galactic centre in ICRS, as a unit vector:

    >>> rotation_matrix("galactic", "icrs")[:, 0].round(4)
    array([-0.0549, -0.8734, -0.4838])
    """
    return _compute_rotation_matrix(check_frame(frame), check_frame(to))


#: From ICRS, as astropy has them: its Galactic frame, and the mean ecliptic and equinox of J2000 (IAU 2006).
_FROM_ICRS = {
    "icrs": np.eye(3),
    "galactic": np.array([[-0.05487565771259163, -0.8734370519556159, -0.48383507361671546],
                          [0.4941094371927268, -0.44482972122329517, 0.7469821839866676],
                          [-0.8676661375596576, -0.19807633727300059, 0.45598381368730156]]),
    "ecliptic": np.array([[0.9999999999999941, -7.078368954848322e-08, 8.05621398373642e-08],
                          [3.2897004077419646e-08, 0.9174821299149584, 0.39777699944404793],
                          [-1.0207044725484355e-07, -0.39777699944404304, 0.9174821299149556]]),
}  # fmt: skip


@lru_cache
def _compute_rotation_matrix(frame, target_frame):
    matrix = np.eye(3) if frame == target_frame else _FROM_ICRS[target_frame] @ _FROM_ICRS[frame].T
    matrix.flags.writeable = False
    return matrix


def rotate_astrometry(
    matrix: FloatArray, lon: FloatArray, lat: FloatArray, motion: FloatArray, sigma: FloatArray, rho: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Positions, motions and their errors along other axes."""
    old_east, old_north, r = triad(lon, lat)
    new_lon, new_lat = angles(matrix @ r)
    # The old east and north along the new east: cosine and sine of the turn.
    east = triad(new_lon, new_lat)[0]
    cos, sin = np.sum(east * (matrix @ old_east), 0), np.sum(east * (matrix @ old_north), 0)
    mu, (s1, s2) = motion, sigma
    v1, v2, v12 = s1**2, s2**2, rho * s1 * s2
    cross_term = 2 * cos * sin * v12
    new_sigma = np.sqrt([cos**2 * v1 + sin**2 * v2 + cross_term, sin**2 * v1 + cos**2 * v2 - cross_term])
    covariance = cos * sin * (v2 - v1) + (cos**2 - sin**2) * v12
    new_motion = np.stack([cos * mu[0] + sin * mu[1], cos * mu[1] - sin * mu[0]])
    return new_lon, new_lat, new_motion, new_sigma, covariance / (new_sigma[0] * new_sigma[1])


#: Redshifts of the expansion alone, without anybody's velocity: those of simulations.
TRUE = "true"
#: Where a table's metadata keep the frame of its redshifts.
REDSHIFT_FRAME_KEY = "ZFRAME"
#: A column of it, the same in all rows, in a format without metadata.
REDSHIFT_FRAME_COLUMN = "redshift_frame"
#: Observers of redshifts: the Sun, one at rest in the microwave background, one in the Local Group.
REDSHIFT_FRAME_NAMES = ("heliocentric", "cmb", "local-group", TRUE)
_REDSHIFT_FRAME_PATTERNS = (
    (re.compile(r"helioc|baryc|geoc", re.IGNORECASE), "heliocentric"),
    (re.compile(r"\bcmb\b|microwave background|3\s?K\b", re.IGNORECASE), "cmb"),
    (re.compile(r"local[ -]group", re.IGNORECASE), "local-group"),
    (re.compile(r"true redshift|cosmological redshift", re.IGNORECASE), TRUE),
)


def check_redshift_frame(value: Any) -> str:
    """A frame of redshifts by name."""
    frame_name = str(value).lower().replace("_", "-") if isinstance(value, str) else ""
    frame_name = {"barycentric": "heliocentric", "helio": "heliocentric"}.get(frame_name, frame_name)
    if frame_name not in REDSHIFT_FRAME_NAMES:
        raise ParameterError(f"a redshift's frame is {', '.join(REDSHIFT_FRAME_NAMES)}, not {value!r}")
    return frame_name


def parse_redshift_frame(description: str | None) -> str | None:
    """The frame of redshifts that a column's description tells, if it does."""
    frames = {name for pattern, name in _REDSHIFT_FRAME_PATTERNS if pattern.search(description or "")}
    return frames.pop() if len(frames) == 1 else None


@dataclass(frozen=True, eq=False, repr=False)
class Positions(Frozen):
    """Positions of n sources.

    Attributes
    ----------
    lon, lat : (n,) arrays
        [rad]
    sigma : (2, n) array
        Standard errors of α cos δ and δ. [µas]
    rho : (n,) array
        Their correlation; zero unless given.
    name : (n,) array of str or None
    motion : (2, n) array or None
        Proper motions µ_α*, µ_δ, to carry positions to another epoch. [µas/yr]
    epoch : float or None
        Epoch of the positions. [Julian year]
    defining : (n,) bool array or None
        Which of them define the axes of the frame.
    frame : str
    notes : tuple of str
    covariance : (2n, 2n) array or None
        Covariance of all of them, α cos δ first, where the sources share errors. [µas²]

    Raises
    ------
    FieldError
        If shapes disagree or a source has no position or no error.
    """

    lon: FloatArray
    lat: FloatArray
    sigma: FloatArray
    rho: FloatArray = None  # type: ignore[assignment]  # zero unless given, an array from then on
    name: np.ndarray | None = None
    motion: FloatArray | None = None
    epoch: float | None = None
    defining: BoolArray | None = None
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    covariance: FloatArray | None = None

    def __post_init__(self) -> None:
        check_frame(self.frame)
        self._set_frozen(**check_source_columns(self, ("lat", "sigma", "rho", "motion"), ("name", "defining")))
        if self.covariance is not None:
            n = 2 * len(self)
            self._set_frozen(covariance=float_array("the covariance of positions", self.covariance, (n, n)))

    def __len__(self) -> int:
        return self.lon.size

    def __repr__(self) -> str:
        return f"<Positions: {len(self)} sources, {self.frame}>"

    def __getitem__(self, keep: Any) -> Positions:
        """The sources picked by a mask, a slice or indices."""
        columns: dict[str, Any] = {k: v for k, v in vars(self).items() if isinstance(v, np.ndarray)}
        matrix = columns.pop("covariance", None)
        arrays = {k: v[..., keep] for k, v in columns.items()}
        if matrix is not None:
            rows = np.arange(2 * len(self)).reshape(2, -1)[:, keep].ravel()
            arrays["covariance"] = matrix[np.ix_(rows, rows)]
        return replace(self, **arrays)

    def to_frame(self, name: str) -> Positions:
        """Turn positions, motions and errors to the frame `name` (icrs, galactic, ecliptic).

        Raises
        ------
        FrameError
            If there is a covariance between sources, which is not turned.
        """
        if check_frame(name) == self.frame:
            return self
        if self.covariance is not None:
            raise FrameError(f"a covariance between sources is not turned: compare these in {self.frame} axes")
        motion = self.sigma if self.motion is None else self.motion
        turned = rotate_astrometry(rotation_matrix(self.frame, name), self.lon, self.lat, motion, self.sigma, self.rho)
        columns: dict[str, Any] = dict(zip(("lon", "lat", "motion", "sigma", "rho"), turned, strict=True))
        return replace(self, **columns | ({"motion": None} if self.motion is None else {}), frame=name)

    def at_epoch(self, epoch: float | None) -> Positions:
        """Move the sources to `epoch` [Julian year] along straight lines; without motions they stay.

        Raises
        ------
        FieldError
            If the epoch of the positions is not known.
        """
        if self.motion is None or epoch is None or epoch == self.epoch:
            return self
        if self.epoch is None:
            raise FieldError("these positions have motions but no epoch to carry them from")
        p, q, r = triad(self.lon, self.lat)
        east, north = self.motion * (UAS * (epoch - self.epoch))
        lon, lat = angles(r + east * p + north * q)
        return replace(self, lon=lon, lat=lat, epoch=epoch)
