"""What the acceleration of the Solar System says of our Galaxy: circular speed, distance of its centre, potentials."""

from typing import TYPE_CHECKING

from fit.galaxy._galaxy import GalacticOrbit, orbit
from fit.galaxy._relations import (
    R0,
    SGR_A,
    SOLAR_SPEED,
    SOLAR_SPEED_ERROR,
    angular_speed,
    angular_speed_error,
    circular_speed,
    distance_of_centre,
    expected_acceleration,
)
from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from fit.galaxy._plot import plot_orbit

__all__ = ["R0", "GalacticOrbit", "circular_speed", "distance_of_centre", "expected_acceleration", "orbit"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazily(__name__, __all__, {"_plot": ["plot_orbit"]})
