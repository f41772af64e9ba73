"""How large each effect is, from masses, distances and speeds.

The tables of Bachchan, Hobbs & Lindegren (2016), recomputed: Table 2 (accelerations by the
Local Group and by clusters), eq. 1, sects. 2.3 and 2.6, and the appendix on microlensing.
"""

from typing import Any

import numpy as np
from astropy import constants
from astropy import units as u

from vsh.models.cosmology import FLAT_PLANCK13, transverse_distance
from vsh.tools.arguments import accepts, not_negative, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import Quantity
from vsh.tools.units import AU_PER_YEAR

__all__ = ["ATTRACTORS", "apparent_motion", "attractions", "effects", "lensing_motion"]

#: Masses [solar masses] and distances [kpc] of the paper's Table 2, after van den Bergh (2000) and NED.
ATTRACTORS = {
    "LMC": (2.0e10, 50),
    "M31": (4.0e11, 760),
    "Sagittarius": (1.5e8, 24),
    "SMC": (8.0e8, 59),
    "M33": (1.4e10, 830),
    "NGC6822": (1.9e9, 500),
    "UrsaMinor": (1.7e7, 63),
    "Virgo": (1.2e15, 16036),
    "Fornax": (4.0e13, 20491),
    "Norma": (1.0e15, 69937),
    "Antlia": (3.3e14, 41561),
    "Coma": (7.0e14, 102900),
}

#: Masses [solar masses] and distances [kpc] as they are taken today: LMC by its pull on streams (Erkal et al. 2019,
#: MNRAS 487, 2685) and at 49.6 kpc (Pietrzyński et al. 2019), Sagittarius (Vasiliev et al. 2021, MNRAS 501, 2279), M31
#: (van der Marel et al. 2012; Li et al. 2021), Virgo (Kashibadze et al. 2020), Fornax (Drinkwater et al. 2001), Coma
#: (Łokas & Mamon 2003).
ATTRACTORS_TODAY = {
    "LMC": (1.5e11, 49.6),
    "M31": (1.5e12, 761),
    "Sagittarius": (4e8, 26.5),
    "Virgo": (6.3e14, 16500),
    "Fornax": (7e13, 20000),
    "Coma": (1.4e15, 100000),
}

_ANGULAR = u.dimensionless_angles()


def _in(unit: Any, or_number: bool = False) -> Any:
    """A check that a value is a quantity that can be had in a unit."""

    def check(name, value):
        if or_number and not isinstance(value, u.Quantity):
            return number(name, value)
        try:
            if isinstance(value, u.Quantity):
                value.to(unit, equivalencies=_ANGULAR)
                return value
        except u.UnitConversionError:
            pass
        description = value.unit if isinstance(value, u.Quantity) else type(value).__name__
        raise ParameterError(f"{name} must be a Quantity that can be converted to {unit}, not {description}")

    return check


@accepts(acceleration=_in(u.m / u.s**2))
def apparent_motion(acceleration: Quantity) -> Any:
    """ã = a/c of an acceleration, as a Quantity in µas/yr.

    Parameters
    ----------
    acceleration : Quantity
        Acceleration of the observer.

    Examples
    --------
    >>> f"{apparent_motion(1e-10 * u.m / u.s**2):.6f}"
    '2.171243 uas / yr'
    """
    return (acceleration / constants.c).to(u.uas / u.yr, equivalencies=_ANGULAR)


def circular_acceleration(speed: Quantity, radius: Quantity) -> Any:
    """ã = v²/(R c) of a circular orbit, µas/yr (eq. 1)."""
    return apparent_motion(speed**2 / radius)


def attraction(mass: Quantity, distance: Quantity) -> Any:
    """ã = GM/(d² c) by a mass at a distance, µas/yr (Table 2)."""
    return apparent_motion(constants.G * mass / distance**2)


def attractions(masses: Any = None) -> dict[str, Any]:
    """The paper's Table 2: a dict from name to ã. [µas/yr]

    Parameters
    ----------
    masses : dict, optional
        From name to mass [solar masses] and distance [kpc]: `ATTRACTORS` unless given, `ATTRACTORS_TODAY` for today's,
        of which the LMC's 0.18 is larger than the error that DR4 will have.

    Raises
    ------
    ParameterError
        If `masses` is no such dict, or a mass or distance is not positive.

    Examples
    --------
    >>> round(attractions(ATTRACTORS_TODAY)["LMC"], 2), round(attractions()["LMC"], 3)
    (0.18, 0.024)
    """
    masses = ATTRACTORS if masses is None else masses
    if not isinstance(masses, dict) or not all(
        isinstance(entry, (tuple, list)) and len(entry) == 2 for entry in masses.values()
    ):
        raise ParameterError("masses must be a dict from names to pairs of a mass and a distance")
    masses = {name: [positive(f"masses[{name!r}]", x) for x in pair] for name, pair in masses.items()}
    return {name: float(attraction(m * u.M_sun, d * u.kpc).value) for name, (m, d) in masses.items()}


def transverse_motion(speed: Quantity, distance: Quantity) -> Any:
    """µ = v/d of a transverse speed, ours or the source's, µas/yr (eqs. 2 and 4)."""
    return (speed / distance).to(u.uas / u.yr, equivalencies=_ANGULAR)


def lensing_depth(density: Quantity, mass: Quantity, lens_distance: Quantity, source_distance: Quantity) -> Any:
    """Photometric optical depth τ = π θ_E² N of lenses along the way to a source (appendix).

    θ_E² = (4GM/c²)(1/D_L − 1/D_Q), and N = n D_L² D_Q lenses to the steradian, taken as all of the
    way to be at the distance D_L.
    """
    einstein = 4 * constants.G * mass / constants.c**2 * (1 / lens_distance - 1 / source_distance)
    return float((np.pi * einstein * density * lens_distance**2 * source_distance).to_value(u.dimensionless_unscaled))


@accepts(lens_motion=_in(u.uas / u.yr, or_number=True), depth=not_negative)
def lensing_motion(lens_motion: Quantity, depth: float) -> Any:
    """Rms apparent motion of a source at rest behind moving lenses, µ_L √τ (eq. 5).

    Parameters
    ----------
    lens_motion : Quantity
        Motion of the lens; of a number in any unit, the result is in the same.
    depth : float
        The optical depth.
    """
    return lens_motion * np.sqrt(depth)


def effects(redshift: float = 0.01) -> dict[str, Any]:
    """The paper's Table 1, as numbers. [µas/yr]

    Parameters
    ----------
    redshift : float
        Redshift for which secular parallax and peculiar motion are computed.

    Returns
    -------
    dict
        Mapping from effect to (minimum, maximum); if the paper gives one number, both are equal. The value of the void
        is the paper's own; its model is not computed here.
    """
    from vsh.tools.units import hubble_rate

    distance = float(transverse_distance([redshift], FLAT_PLANCK13)[0])
    galactic = float(circular_acceleration(223 * u.km / u.s, 8.2 * u.kpc).value)
    parallax = 369.0 / (AU_PER_YEAR * distance)
    peculiar = tuple(speed / (AU_PER_YEAR * distance) for speed in (600.0, 1500.0))
    depth = lensing_depth(0.05 / u.Mpc**3, 1e11 * u.M_sun, 5 * u.Gpc, 10 * u.Gpc)
    lens = float(transverse_motion(600 * u.km / u.s, 5 * u.Gpc).value)
    shear = 0.01 * hubble_rate(FLAT_PLANCK13.hubble)
    return {
        "acceleration of the Solar System": (galactic, galactic),
        "cosmological proper motion": (parallax, parallax),
        "anisotropic expansion by 1 %": (shear, shear),
        "off-centre void": (0.02, 0.02),
        "peculiar proper motion": peculiar,
        "weak microlensing, rms": (lensing_motion(lens, depth),) * 2,
    }
