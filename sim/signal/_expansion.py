"""Universes that are not the same in all directions: anisotropic expansion, a void seen off its centre."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.signal._signal import Signal, direction_of
from vsh import Coefficients
from vsh.checks.arguments import number, positive
from vsh.checks.arrays import float_array
from vsh.checks.types import ArrayLike, FloatArray
from vsh.errors import FieldError, ParameterError
from vsh.sky.sphere import triad


@dataclass(frozen=True)
class Shear:
    """Axes that expand at different rates [µas/yr]."""

    matrix: FloatArray

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike) -> FloatArray:
        p, q, r = triad(lon, lat)
        return np.stack([np.sum(p * (self.matrix @ r), 0), np.sum(q * (self.matrix @ r), 0)])


@dataclass(frozen=True)
class Void:
    """A dipole that grows with redshift to `peak` and fades again."""

    glide: Coefficients
    peak: float

    def __call__(self, lon: ArrayLike, lat: ArrayLike, redshift: ArrayLike) -> FloatArray:
        if redshift is None:
            raise FieldError("the void's dipole depends on redshift, and these sources have none")
        x = np.asarray(redshift, float) / self.peak
        return self.glide.at(lon, lat) * x * np.exp(1 - x)


def anisotropic_expansion(shear: ArrayLike) -> Signal:
    """A Bianchi I universe: axes expand at rates that differ, µ = Σ r − (rᵀ Σ r) r.

    Parameters
    ----------
    shear : (3, 3) array
        Σ, symmetric: the expansion rate along each axis less the mean; a
        trace makes no difference [µas/yr]; 1 % of H0 = 70 is 0.15 µas/yr.

    Raises
    ------
    ParameterError
        If the matrix is not symmetric.

    Notes
    -----
    The 0.2 µas/yr of Bachchan et al. (2016) is Quercellini et al.'s (2009) for 1 %.
    """
    shear = float_array("shear", shear, (3, 3))
    if not np.allclose(shear, shear.T):
        raise ParameterError("the shear must be a symmetric 3 × 3 matrix")
    return Signal((Shear(shear),))


def off_centre_void(direction: ArrayLike, amplitude: float = 0.02, peak: float = 1.0) -> Signal:
    """We are off the centre of a large void: a dipole that grows with redshift and fades again.

    µ = A f(z) (e − (e·r) r), f = (z/z_p) e^{1 − z/z_p}. The amplitude is that of Bachchan et al.
    (2016, Table 1); the profile is a description of theirs ("increases at high z, decreases at
    very high z"), not the solution of a model.

    Parameters
    ----------
    direction : (3,) array
        Towards which sources move; only its direction counts.
    amplitude : float
        The largest motion [µas/yr]
    peak : float
        Z_p, the redshift of the largest motion.
    """
    direction = direction_of(direction, "direction")
    glide = number("amplitude", amplitude) * direction / np.linalg.norm(direction)
    return Signal((Void(Coefficients.from_vectors(glide=glide), positive("peak", peak)),))
