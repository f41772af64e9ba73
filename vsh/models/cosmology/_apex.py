"""Our own motion through the Universe: as the dipole of the microwave background tells it, and as users give it.

In which frame a redshift stands, and the way from one to another.

A redshift that an observer measures holds the source's own velocity and the observer's: (1 + z_obs) =
(1 + z) (1 + v_r/c)/(1 + v·r/c), with v the observer's velocity with respect to the microwave background, toward the
apex. Frames differ by that observer.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from vsh.field import Field
from vsh.sky.frames import TRUE, check_frame, check_redshift_frame, rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.arguments import explained, number
from vsh.tools.errors import FieldError, NothingLeftError, ParameterError
from vsh.tools.notes import WithoutRedshift
from vsh.tools.printing import in_a_line
from vsh.tools.types import ArrayLike, BoolArray, FloatArray
from vsh.tools.units import SPEED_OF_LIGHT
from vsh.vector import Vector

#: Planck Collaboration (2020, A&A 641, A1), table 3: toward the apex. [km/s]
CMB_VELOCITY_PLANCK18 = Vector.from_spherical(369.82, 264.021, 48.253, (0.11, 0.011, 0.005), "galactic", "km/s")
#: What Bachchan, Hobbs & Lindegren (2016, A&A 589, A71) put into their simulations. [km/s]
BACHCHAN_2016 = Vector.from_spherical(369.0, 263.99, 48.26, frame="galactic", unit="km/s")
#: Velocities that have names, in every command and study.
VELOCITIES = {"planck": CMB_VELOCITY_PLANCK18, "paper": BACHCHAN_2016}


def velocity_along(value: Any, frame: str) -> Vector:
    """A velocity along the axes of `frame`."""
    check_frame(frame)
    if isinstance(value, str):
        if value not in VELOCITIES:
            raise ParameterError(
                f"no velocity is called {value!r}; there are {', '.join(VELOCITIES)}, or give three numbers in km/s"
            )
        value = VELOCITIES[value]
    if not isinstance(value, Vector):
        try:
            three = np.asarray(value, float)
        except (TypeError, ValueError):
            three = np.empty(0)
        if three.shape != (3,):
            raise ParameterError(f"a velocity has three components, not {value!r}")
        if not (np.isfinite(three).all() and three.any()):
            raise ParameterError(
                f"a velocity of {three} km/s has no direction: a secular parallax cannot be scaled by it"
            )
        value = Vector(three, np.zeros((3, 3)), frame, "km/s")
    if not value.amplitude > 0:
        raise ParameterError(
            f"a velocity of {value.amplitude} km/s has no direction: a secular parallax cannot be scaled by it"
        )
    return replace(value.to_frame(frame), unit="km/s")


def velocity_from_apex(speed: float, l: float, b: float) -> Vector:
    """A velocity of so many km/s toward Galactic longitude and latitude [deg], without error.

    Parameters
    ----------
    speed : float
        [km/s]
    l : float
        Galactic longitude. [deg]
    b : float
        Galactic latitude. [deg]

    Raises
    ------
    ParameterError
        If the speed is not above zero, or the direction is none.
    """
    speed, l, b = (number(name, x) for name, x in (("speed", speed), ("l", l), ("b", b)))
    if not (0 < speed < 3e5 and abs(l) <= 360 and abs(b) <= 90):
        raise ParameterError(
            f"a velocity is SPEED,L,B: km/s above zero, Galactic longitude and latitude of the apex in degrees; not "
            f"{speed:g},{l:g},{b:g}"
        )
    return Vector.from_spherical(speed, l, b, frame="galactic", unit="km/s")


#: Karachentsev & Makarov (1996, AJ 111, 794): the Sun's velocity with respect to the Local Group. [km/s]
SUN_IN_LOCAL_GROUP = Vector.from_spherical(316.0, 93.0, -4.0, frame="galactic", unit="km/s")
#: Kogut et al. (1993, ApJ 419, 1): the velocity of the Local Group in the microwave background. [km/s]
LOCAL_GROUP = Vector.from_spherical(627.0, 276.0, 30.0, (22.0, 3.0, 3.0), "galactic", "km/s")
_NONE = Vector(np.zeros(3), np.zeros((3, 3)), "galactic", "km/s")
#: The Sun's velocity with respect to the observer at rest in each frame of redshifts. [km/s]
REDSHIFT_FRAMES = {"heliocentric": _NONE, "cmb": CMB_VELOCITY_PLANCK18, "local-group": SUN_IN_LOCAL_GROUP}


@explained
def to_cmb(redshift: FloatArray, lon: FloatArray, lat: FloatArray, frame: str, redshift_frame: str) -> FloatArray:
    """Redshifts as an observer at rest in the microwave background would measure them.

    With the velocity of Planck (2018), never one that was fitted: what is fitted would bear on itself.

    Parameters
    ----------
    redshift : (n,) array
        As measured.
    lon, lat : (n,) arrays
        Positions. [rad]
    frame : str
        Axes of the positions.
    redshift_frame : str
        One of `REDSHIFT_FRAMES`; "true" redshifts stay as they are.

    Examples
    --------
    >>> apex = CMB_VELOCITY_PLANCK18.to_frame("icrs").direction
    >>> float(to_cmb(np.array([0.01]), *np.radians([[apex[0]], [apex[1]]]), "icrs", "heliocentric")[0].round(6))
    0.011246
    """
    redshift = np.asarray(redshift, float)
    if redshift_frame == TRUE:
        return redshift
    r = triad(lon, lat)[2]
    turn = rotation_matrix("galactic", frame)
    toward = {name: turn @ REDSHIFT_FRAMES[name].value @ r / SPEED_OF_LIGHT for name in ("cmb", redshift_frame)}
    return (1 + redshift) * (1 + toward["cmb"]) / (1 + toward[redshift_frame]) - 1


#: Below this redshift a source moves with its neighbours, not with the expansion.
FLOW_LIMIT = 1e-4


def usable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> BoolArray:
    """Which redshifts are finite, positive and at least `min_redshift`: a mask."""
    redshift = np.asarray(redshift, float)
    return np.isfinite(redshift) & (redshift > 0) & (redshift >= min_redshift)


def count_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> str:
    """How many redshifts cannot be used, and why, in words."""
    counts = reasons_unusable(redshift, min_redshift)
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)


def reasons_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> dict[str, int]:
    """How many redshifts cannot be used, by reason."""
    redshift = np.asarray(redshift, float)
    return {
        "missing": int((~np.isfinite(redshift)).sum()),
        "zero or negative": int((np.isfinite(redshift) & (redshift <= 0)).sum()),
        f"below {min_redshift:g}": int(((redshift > 0) & (redshift < min_redshift)).sum()),
    }


@explained
def with_redshift(
    field: Field, min_redshift: float = FLOW_LIMIT, redshift_frame: str | None = None, *, missing_only: bool = False
) -> Field:
    """The sources of a field whose redshift can be used; a note counts the others and names the first.

    Where it is known in which frame the redshifts stand, those at rest in the microwave background count.

    Parameters
    ----------
    field : Field
        The sources.
    min_redshift : float
        The smallest redshift of use.
    redshift_frame : str, optional
        The field's own unless given.
    missing_only : bool
        Leave out those without a value alone: one that is there and wrong is for the reader of the table to see.

    Raises
    ------
    FieldError
        If the field has no redshifts, or none that can be used.
    """
    if field.redshift is None:
        raise FieldError("these sources have no redshifts: the table needs a column of them (--columns redshift=NAME)")
    frame = redshift_frame or field.redshift_frame
    redshift = np.asarray(field.redshift)
    if frame is not None:
        redshift = to_cmb(redshift, field.lon, field.lat, field.frame, check_redshift_frame(frame))
    good = np.isfinite(redshift) if missing_only else usable(redshift, min_redshift)
    if good.all():
        return field
    redshift = np.where(good, min_redshift, redshift) if missing_only else redshift
    bad = ~good
    names = () if field.name is None else tuple(in_a_line(name) for name in field.name[bad][:5])
    reasons = reasons_unusable(redshift, min_redshift)
    note = WithoutRedshift.of_table(reasons, len(field), field.lon, field.redshift, names=names)
    if bad.all():
        error = NothingLeftError(
            f"{bad.sum()} of {len(field)} sources without a usable redshift: "
            f"{count_unusable(redshift, min_redshift)}. No source is left"
        )
        error.notes = (note,)
        raise error
    return field[good].add_note(note)
