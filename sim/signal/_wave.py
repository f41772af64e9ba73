"""A single gravitational wave."""

from __future__ import annotations

from dataclasses import dataclass

from sim.signal._signal import Signal
from vsh.models.waves import unit, wave_motions
from vsh.tools.arguments import number
from vsh.tools.types import ArrayLike, FloatArray


@dataclass(frozen=True)
class PlaneWave:
    """Motions by one wave. [µas/yr]"""

    direction: FloatArray
    plus: float
    cross: float

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike | None) -> FloatArray:
        return wave_motions(lon, lat, self.direction, self.plus, self.cross)


def plane_wave(direction: ArrayLike, plus: float, cross: float = 0.0) -> Signal:
    """One plane gravitational wave, much longer than the observations: its motions at the Earth, exactly.

    Parameters
    ----------
    direction : (3,) array
        Where it travels to, along the axes of the frame; of any length. Its source is on the other side of the sky.
    plus, cross : float
        Rates of the strain in two polarisations: south–south less east–east at `direction`, and south–east. A strain h of
        frequency f has 2πf h; 1 µas/yr is h = 2.4e-11 at 1 nHz (`vsh.models.waves.strain_of`). [µas/yr]

    Raises
    ------
    ParameterError
        If the direction has no length, or a rate is no number.

    Notes
    -----
    Pyne et al. (1996, ApJ 465, 566), Book & Flanagan (2011, PRD 83, 024024), eq. 58; only what happens at the Earth, which
    all sources share. ∫|V|² dΩ = (2π/3)(plus² + cross²).

    Examples
    --------
    >>> plane_wave((0, 0, 1), 2.0)([0.0], [0.0]).round(12).ravel()
    array([0., 1.])
    """
    return Signal((PlaneWave(unit(direction), number("plus", plus), number("cross", cross)),))
