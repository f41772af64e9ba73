"""Distances, usable redshifts, and our own motion through the Universe.

Distances are by a flat cosmology of our own or any of astropy's; our motion is that of the dipole of the microwave
background, or as users give it. A redshift that an observer measures holds the source's own velocity and the
observer's: (1 + z_obs) = (1 + z) (1 + v_r/c)/(1 + v·r/c), with v the observer's velocity with respect to the microwave
background, toward the apex. Frames differ by that observer.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import hyp2f1

from vsh.field import Field
from vsh.sky.frames import TRUE, check_frame, check_redshift_frame, rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.arguments import a, accepts, float_array, number, positive
from vsh.tools.errors import ConvergenceError, EmptyFieldError, FieldError, ParameterError
from vsh.tools.notes import UnusableRedshifts
from vsh.tools.printing import one_line_text
from vsh.tools.types import ArrayLike, BoolArray, Cosmology, FloatArray, Quantity
from vsh.tools.units import SPEED_OF_LIGHT
from vsh.vector import Vector

__all__ = [
    "BACHCHAN_2016",
    "CMB_VELOCITY_PLANCK18",
    "FLAT_PLANCK13",
    "distance_modulus",
    "to_cmb",
    "transverse_distance",
    "velocity_from_apex",
    "with_redshift",
]


@dataclass(frozen=True)
class FlatLCDM:
    """A flat cosmology of matter and a cosmological constant, without astropy.cosmology's second to import.

    `H0` and `comoving_transverse_distance` are those of astropy's `FlatLambdaCDM(hubble, omega_m)`, which `to_astropy`
    gives.
    """

    hubble: float
    omega_m: float
    Ok0 = 0.0

    def distance(self, redshift: FloatArray) -> FloatArray:
        """Transverse comoving distance [Mpc]: Baes, Camps & Van De Putte (2017, MNRAS 468, 927), eq. 15."""
        s = ((1 - self.omega_m) / self.omega_m) ** (1 / 3)

        def compute_integral(x):
            return 2 * np.sqrt(x) * hyp2f1(1 / 6, 1 / 2, 7 / 6, -(x**3))

        scale = SPEED_OF_LIGHT / self.hubble / np.sqrt(s * self.omega_m)
        return scale * (compute_integral(s) - compute_integral(s / (redshift + 1)))

    @property
    def H0(self) -> Quantity:
        """The Hubble constant as astropy's Quantity."""
        from astropy import units as u

        return self.hubble * u.km / u.s / u.Mpc

    def comoving_transverse_distance(self, redshift: ArrayLike) -> Quantity:
        """`distance` as astropy's Quantity."""
        from astropy import units as u

        return self.distance(np.asarray(redshift, float)) * u.Mpc

    def to_astropy(self) -> Any:
        """Convert to astropy's `FlatLambdaCDM`."""
        from astropy.cosmology import FlatLambdaCDM

        return FlatLambdaCDM(self.hubble, self.omega_m)


#: Flat, Ω_m = 0.315, H0 = 67.3 km/s/Mpc: Bachchan, Hobbs & Lindegren (2016).
FLAT_PLANCK13 = FlatLCDM(67.3, 0.315)
#: More redshifts than this are interpolated.
_MOST_EXACT = 1000


@accepts(hubble=positive)
def transverse_distance(
    redshift: ArrayLike | None, cosmology: Cosmology | None = None, *, hubble: float | None = None
) -> FloatArray:
    """Transverse comoving distance d_M, (n,). [Mpc]

    Parameters
    ----------
    redshift : (n,) array
        One for each source.
    cosmology : astropy cosmology, optional
        Its shape; its H0 too unless `hubble` is given; flat, Ω_m = 0.315, H0 = 67.3 unless given.
    hubble : float, optional
        H0, to which distances are inversely proportional [km/s/Mpc]

    Raises
    ------
    FieldError
        If any redshift is missing, not positive, or below the flow (z < 1e-4): astropy would
        return 0 Mpc for a nan and a negative distance for a negative redshift.

    Notes
    -----
    More than a thousand redshifts are interpolated, to 1e-9 of the distance or better.

    Examples
    --------
    >>> transverse_distance(np.array([0.001, 0.01, 1.0])).round(2)
    array([   4.45,   44.44, 3406.32])
    """
    if redshift is None:
        raise FieldError("these sources have no redshifts, which a distance needs")
    cosmology = FLAT_PLANCK13 if cosmology is None else _check_cosmology(cosmology)
    redshift = float_array("redshift", redshift, finite=False)
    if not redshift.size:
        raise FieldError("there are no redshifts to take distances of")
    is_usable = usable_mask(redshift)
    if not is_usable.all():
        raise FieldError(
            f"{(~is_usable).sum()} of {redshift.size} redshifts give no distance: {describe_unusable(redshift)}. "
            "Leave those sources out first: vsh.models.cosmology.with_redshift(field), or --on-bad drop"
        )
    grid_distances = _compute_distance(np.linspace(redshift.min(), redshift.max(), 64), cosmology)
    if not (grid_distances > 0).all():
        raise FieldError(
            f"redshifts up to {redshift.max():.3g} reach beyond the antipode of this closed cosmology, where distances "
            "are not positive: leave them out, or lower its densities"
        )
    distance = (_interpolate_distance if redshift.size > _MOST_EXACT else _compute_distance)(redshift, cosmology)
    return distance if hubble is None else distance * (hubble_value(cosmology) / hubble)


def distance_modulus(distance: ArrayLike, redshift: ArrayLike) -> FloatArray:
    """Apparent less absolute magnitude, 5 lg(d_M (1 + z)) + 25.

    Parameters
    ----------
    distance : (n,) array
        Transverse comoving distance. [Mpc]
    redshift : (n,) array
        One for each source.
    """
    distance = float_array("distance", distance, finite=False)
    return 5 * np.log10(distance * (1 + float_array("redshift", redshift, distance.shape, False, True))) + 25


def compute_redshift(distance: ArrayLike, cosmology: Cosmology | None = None) -> FloatArray:
    """Compute the redshift at each transverse comoving distance [Mpc], (n,); nan where the distance is.

    Below z = 10⁻⁴ by Hubble's law; not beyond the antipode of a closed cosmology, nor beyond z = 1000.
    """
    cosmology = FLAT_PLANCK13 if cosmology is None else cosmology
    from scipy.interpolate import make_interp_spline  # slow to import

    grid_redshifts = np.geomspace(FLOW_LIMIT, 1000.0, 4000)
    grid_distances = _compute_distance(grid_redshifts, cosmology)
    rising_part = slice(0, int(np.argmax(grid_distances)) + 1)
    spline = make_interp_spline(np.log(grid_distances[rising_part]), np.log(grid_redshifts[rising_part]), k=3)
    distance = np.asarray(distance, float)
    clipped_distance = np.clip(distance, grid_distances[0], grid_distances[rising_part][-1])
    return np.exp(spline(np.log(clipped_distance))) * np.minimum(distance / grid_distances[0], 1)


def hubble_value(cosmology: Cosmology) -> float:
    """The Hubble constant of a cosmology. [km/s/Mpc]"""
    if isinstance(cosmology, FlatLCDM):
        return cosmology.hubble
    return float(_check_cosmology(cosmology).H0.to_value("km / (s Mpc)"))


def parallax_distance_ratio(distance: ArrayLike, cosmology: Cosmology | None = None) -> FloatArray:
    """Ratio d_M/d_P by which our own motion moves sources more than in flat space, (n,).

    Our velocity moves a source by v/d_P with d_P = d_M/√(1 + Ω_k (d_M H0/c)²), its own by v/d_M (Weinberg 1972,
    Gravitation and Cosmology, sect. 14.4).
    """
    distance = np.asarray(distance, float)
    if cosmology is None or not _check_cosmology(cosmology).Ok0:
        return np.ones_like(distance)
    curvature = float(cosmology.Ok0)
    return np.sqrt(np.maximum(1 + curvature * (distance * hubble_value(cosmology) / SPEED_OF_LIGHT) ** 2, 0.0))


def _check_cosmology(cosmology):
    if isinstance(cosmology, FlatLCDM):  # whose H0 would load astropy's units
        return cosmology
    if not (hasattr(cosmology, "H0") and hasattr(cosmology, "comoving_transverse_distance")):
        raise ParameterError(
            f"cosmology is one of astropy's, FlatLambdaCDM(H0=70, Om0=0.3) say, not a {type(cosmology).__name__} "
            "(CMB_VELOCITY_PLANCK18 of vsh.models.cosmology is our velocity, that of vsh.models.flows a theory of "
            "flows)"
        )
    return cosmology


def _compute_distance(redshift, cosmology):
    if isinstance(cosmology, FlatLCDM):
        return cosmology.distance(redshift)
    return cosmology.comoving_transverse_distance(redshift).to_value("Mpc")


def _interpolate_distance(redshift, cosmology, accuracy=1e-9):
    """Interpolate with a quintic spline of log(d/z) in log(1 + z), refined until it holds between its nodes."""
    lower, upper = np.log1p(redshift.min()), np.log1p(redshift.max()) + 1e-12
    from scipy.interpolate import make_interp_spline  # slow to import

    n_nodes = 32
    while n_nodes <= 4096:
        log_nodes = np.linspace(lower, upper, n_nodes + 1)
        z = np.expm1(log_nodes)
        spline = make_interp_spline(log_nodes, np.log(_compute_distance(z, cosmology) / z), k=5)
        midpoints = (log_nodes[1:] + log_nodes[:-1]) / 2
        z = np.expm1(midpoints)
        if np.abs(spline(midpoints) - np.log(_compute_distance(z, cosmology) / z)).max() < accuracy / 4:
            return redshift * np.exp(spline(np.log1p(redshift)))
        n_nodes *= 2
    raise ConvergenceError(f"the distances of {cosmology} are too rough to interpolate")


#: Planck Collaboration (2020, A&A 641, A1), table 3: toward the apex. [km/s]
CMB_VELOCITY_PLANCK18 = Vector.from_spherical(369.82, 264.021, 48.253, (0.11, 0.011, 0.005), "galactic", "km/s")
#: What Bachchan, Hobbs & Lindegren (2016, A&A 589, A71) put into their simulations. [km/s]
BACHCHAN_2016 = Vector.from_spherical(369.0, 263.99, 48.26, frame="galactic", unit="km/s")
#: Velocities that have names, in every command and study.
VELOCITIES = {"planck": CMB_VELOCITY_PLANCK18, "paper": BACHCHAN_2016}


def velocity_in_frame(value: Any, frame: str) -> Vector:
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
            components = np.asarray(value, float)
        except (TypeError, ValueError):
            components = np.empty(0)
        if components.shape != (3,):
            raise ParameterError(f"a velocity has three components, not {value!r}")
        value = Vector(components, np.zeros((3, 3)), frame, "km/s")
    if not value.amplitude > 0:
        raise ParameterError(f"a velocity of {value.amplitude} km/s has no direction: it scales no secular parallax")
    return value.to_frame(frame).to("km/s")


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
    speed, l, b = (number(name, value) for name, value in (("speed", speed), ("l", l), ("b", b)))
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
_AT_REST = Vector(np.zeros(3), np.zeros((3, 3)), "galactic", "km/s")
#: The Sun's velocity with respect to the observer at rest in each frame of redshifts. [km/s]
REDSHIFT_FRAMES = {"heliocentric": _AT_REST, "cmb": CMB_VELOCITY_PLANCK18, "local-group": SUN_IN_LOCAL_GROUP}


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
    rotation = rotation_matrix("galactic", frame)
    velocities = {name: rotation @ REDSHIFT_FRAMES[name].value @ r / SPEED_OF_LIGHT for name in ("cmb", redshift_frame)}
    cmb_redshift = (1 + redshift) * (1 + velocities["cmb"]) / (1 + velocities[redshift_frame]) - 1
    return np.where(redshift == 0, 0.0, cmb_redshift)  # an exact zero marks one that is not known, and is nowhere near


#: Below this redshift a source moves with its neighbours, not with the expansion.
FLOW_LIMIT = 1e-4


#: A redshift with a larger share of itself for its error tells less of the distance than the other sources do.
_LARGEST_RELATIVE_ERROR = 0.5


def select_certain_redshifts(field: Field) -> Field:
    """The sources whose redshift is known to half of itself, or whose distance is; a note counts and names the others.

    Where no redshift is known so well, none is better than the others, and all sources stay.

    One wrong error among many puts its source so far away that no peculiar velocity scatters it, and lets it outweigh
    all others.
    """
    if field.redshift is None or field.redshift_error is None:
        return field
    with np.errstate(invalid="ignore"):
        is_uncertain = np.asarray(field.redshift_error) > _LARGEST_RELATIVE_ERROR * np.asarray(field.redshift)
    if field.distance is not None:
        is_uncertain &= ~np.isfinite(field.distance)
    if not is_uncertain.any() or is_uncertain.all():
        return field
    names = np.flatnonzero(is_uncertain)[:5] if field.name is None else field.name[is_uncertain][:5]
    reasons = {f"with an error above {_LARGEST_RELATIVE_ERROR:g} of it": int(is_uncertain.sum())}
    note = UnusableRedshifts.of_table(
        reasons, len(field), field.lon, field.redshift, names=tuple(map(one_line_text, names))
    )
    return field[~is_uncertain].add_note(note)


def usable_mask(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> BoolArray:
    """Mask of redshifts that are finite, positive and at least `min_redshift`."""
    redshift = np.asarray(redshift, float)
    return np.isfinite(redshift) & (redshift > 0) & (redshift >= min_redshift)


def describe_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> str:
    """Describe how many redshifts cannot be used, and why."""
    counts = count_unusable(redshift, min_redshift)
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)


def count_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> dict[str, int]:
    """Count the redshifts that cannot be used, by reason."""
    redshift = np.asarray(redshift, float)
    return {
        "missing": int((~np.isfinite(redshift)).sum()),
        "zero or negative": int((np.isfinite(redshift) & (redshift <= 0)).sum()),
        f"below {min_redshift:g}": int(((redshift > 0) & (redshift < min_redshift)).sum()),
    }


@accepts(field=a(Field))
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
    is_usable = np.isfinite(redshift) if missing_only else usable_mask(redshift, min_redshift)
    if is_usable.all():
        return field
    redshift = np.where(is_usable, min_redshift, redshift) if missing_only else redshift
    is_bad = ~is_usable
    names = () if field.name is None else tuple(one_line_text(name) for name in field.name[is_bad][:5])
    reasons = count_unusable(redshift, min_redshift)
    note = UnusableRedshifts.of_table(reasons, len(field), field.lon, field.redshift, names=names)
    if is_bad.all():
        error = EmptyFieldError(
            f"{is_bad.sum()} of {len(field)} sources without a usable redshift: "
            f"{describe_unusable(redshift, min_redshift)}. No source is left"
        )
        error.notes = (note,)
        raise error
    return field[is_usable].add_note(note)
