"""Catalogues that there are or will be: how many sources, and how well each is measured."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from sim.noise import gaia_errors
from sim.population import CRF3_COUNTS, SIX_PARAMETERS, crf3_magnitudes
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray


@dataclass(frozen=True)
class Survey(InNotebook):
    """A catalogue of quasars, and of galaxies where it has some. A new one is a new value of this.

    Attributes
    ----------
    n_quasars : int
        Sources at rest.
    release : {"DR3", "DR4", "DR5"} or None
        Release whose errors at each magnitude are taken, for the magnitudes of Gaia's quasars.
    factor : float
        By which these errors are multiplied.
    sigma : float or None
        One error for all, in place of a release's. [µas/yr]
    n_galaxies : int
        Within z = 0.03; 0 where there are none.
    floor : float
        What sources share: an error of each component of spin and acceleration that no number of them lowers. [µas/yr]
    says : str
        Where the numbers come from.
    """

    n_quasars: int
    release: Any = None
    factor: float = 1.0
    sigma: Any = None
    n_galaxies: int = 0
    floor: float = 0.0
    says: str = ""

    def __post_init__(self) -> None:
        """Check that errors can follow from it."""
        arguments.whole("n_quasars", self.n_quasars)
        arguments.whole("n_galaxies", self.n_galaxies, least=0)
        arguments.positive("factor", self.factor)
        arguments.not_negative("floor", self.floor)
        if (self.release is None) == (self.sigma is None):
            raise ParameterError("a survey has the errors of a release, or one sigma for all: one of the two")
        if self.sigma is not None:
            arguments.positive("sigma", self.sigma)

    def errors(self, n: int) -> FloatArray:
        """Errors of `n` quasars, (2, n), of as much information as all of them have; the same for each. [µas/yr]"""
        if self.release is None:
            one = np.full(2, self.sigma)
        else:
            magnitude, larger = _quasars()
            one = 1 / np.sqrt(np.mean(1 / (larger * gaia_errors(magnitude, self.release)) ** 2, axis=1))
        return np.tile((one * self.factor * np.sqrt(n / self.n_quasars))[:, None], n)

    def galaxy_errors(self, magnitude: FloatArray) -> FloatArray:
        """Errors of galaxies of `magnitude` G, (2, n). [µas/yr]"""
        if self.release is None:
            return np.full((2, len(magnitude)), self.factor) * self.sigma
        return gaia_errors(magnitude, self.release) * self.factor


@lru_cache(maxsize=1)
def _quasars():
    """Magnitudes of Gaia-CRF3's quasars, and factors on their errors: information to half a per cent."""
    five, six = (count // 8 for count in CRF3_COUNTS.values())
    return crf3_magnitudes(five, six, 1), np.where(np.arange(five + six) < five, 1.0, SIX_PARAMETERS)


_QUASARS, _GALAXIES = sum(CRF3_COUNTS.values()), 100_000
#: By name. Floors are an assumption: 0.3 µas/yr for DR3, and as the errors of faint sources beyond.
SURVEYS = {
    "Gaia DR3": Survey(_QUASARS, "DR3", n_galaxies=_GALAXIES, floor=0.3, says="Gaia-CRF3's quasars"),
    "Gaia DR4": Survey(_QUASARS, "DR4", n_galaxies=_GALAXIES, floor=0.13, says="the same, 66 months"),
    "Gaia DR5": Survey(_QUASARS, "DR5", n_galaxies=_GALAXIES, floor=0.044, says="the same, ten years"),
    "near infrared": Survey(
        _QUASARS, "DR4", 1 / 14, n_galaxies=_GALAXIES, floor=0.01,
        says="a successor twenty years later: motions 14 times as good (Hobbs et al. 2021, Exp. Astron. 51, 783)",
    ),
    "VLBI": Survey(1500, sigma=5.0, floor=0.1, says="an assumption: 1500 sources to 5 µas/yr, structure included"),
}  # fmt: skip
#: What is forecast: words and unit, in the order of the table.
QUANTITIES = {
    "spin": ("spin, a component", "µas/yr"),
    "acceleration": ("acceleration, a component", "µas/yr"),
    "acceleration_floor": ("  with the floor", "µas/yr"),
    "acceleration_law": ("  with DR3's law of angles", "µas/yr"),
    "direction": ("  its direction, with the floor", "°"),
    "speed": ("circular speed V0, with the floor", "km/s"),
    "r0": ("R0 with Sgr A*'s motion, with the floor", "kpc"),
    "waves": ("h70² Ω of waves, 95 %, with the floor", ""),
    "wave": ("  one wave, its rate, of noise", "µas/yr"),
    "shear": ("shear, a component", "% of H0"),
    "degree": ("degrees with DR3's systematics", ""),
    "velocity": ("our velocity, a component", "km/s"),
    "hubble": ("H0", "km/s/Mpc"),
    "velocity_flows": ("  velocity, flows unknown", "km/s"),
    "hubble_flows": ("  H0, flows unknown", "km/s/Mpc"),
}
