"""The equations of the secular parallax by our own motion, and their sums for any spread of peculiar velocities.

A source at transverse comoving distance d moves by

    µ = −u_⊥ k + ã_⊥ + ω × r,   k = 1/d,   u = v H0/H_ref,

(Bachchan, Hobbs & Lindegren 2016, sect. 2.3 and 4), where distances are those for H_ref: the
data see the product v H0 only. Each source is turned to the axes of its error ellipse, in which
a variance that is the same in all directions (peculiar velocities, excess noise) is simply added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np

from vsh.cosmology import hubble_value, transverse_distance
from vsh.errors import DegeneracyError
from vsh.field import Field
from vsh.sky.sphere import triad
from vsh.system.parallel import map_blocks
from vsh.types import ArrayLike, Cosmology, FloatArray
from vsh.units import AU_PER_YEAR

#: u: our velocity were H0 what the cosmology has [km/s]; ã and ω [µas/yr].
NAMES = tuple(f"{vector}_{axis}" for vector in ("u", "a", "omega") for axis in "xyz")
U, A, OMEGA = slice(0, 3), slice(3, 6), slice(6, 9)


@dataclass(frozen=True, eq=False)
class ParallaxSums:
    """N θ = b for θ = (u, ã, ω), with what a likelihood needs besides.

    Attributes
    ----------
    matrix : (9, 9) array
    rhs : (9,) array
    chi2_null : float
        Σ y²/V.
    logdet : float
        Σ log V.
    n_data : int

    They add. Each array has a leading axis where the sums were made for several spreads at once.
    """

    matrix: FloatArray
    rhs: FloatArray
    chi2_null: FloatArray
    logdet: FloatArray
    n_data: int

    def __add__(self, other: ParallaxSums) -> ParallaxSums:
        return ParallaxSums(*(getattr(self, each.name) + getattr(other, each.name) for each in fields(self)))


@dataclass(frozen=True, eq=False)
class ParallaxEquations:
    """Uncorrelated equations, two a source.

    Attributes
    ----------
    design : (2n, 9) array
        Of u, ã, ω.
    motion : (2n,) array
        [µas/yr]
    variance : (2n,) array
        Of the catalogue [(µas/yr)²]
    rate : (2n,) array
        k, the motion that a velocity of 1 km/s gives [µas/yr per km/s]
    hubble : float
        H_ref [km/s/Mpc]
    frame : str
    notes : tuple of str
    """

    design: FloatArray
    motion: FloatArray
    variance: FloatArray
    rate: FloatArray
    hubble: float
    frame: str
    notes: tuple[str, ...]

    @property
    def n_data(self) -> int:
        """How many equations: two a source."""
        return len(self.motion)

    @property
    def smallest_variance(self) -> float:
        """Of all equations. [(µas/yr)²]"""
        return float(self.variance.min())

    @property
    def largest_rate(self) -> float:
        """Of all equations. [µas/yr per km/s]"""
        return float(self.rate.max())

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, threads: int | None = None
    ) -> ParallaxSums:
        """Normal equations with variances V = σ² + (spread k)² + excess_noise².

        Parameters
        ----------
        spread : float or (m,) array
            Of peculiar velocities, times H0/H_ref [km/s]
        excess_noise : float or (m,) array
            Noise beyond the catalogue's [µas/yr]
        threads : int, optional
            How many; one a core unless given.

        Returns
        -------
        ParallaxSums
            Its arrays with a leading axis m where spread or excess_noise has one.
        """
        spread, excess_noise = np.broadcast_arrays(spread, excess_noise)
        added = np.stack([np.ravel(spread), np.ravel(excess_noise)]) ** 2
        upper = np.triu_indices(10)

        def block(part):
            variance = self.rate[part, None] ** 2 * added[0] + (self.variance[part, None] + added[1])
            rows = np.column_stack([self.design[part], self.motion[part]])
            products = rows[:, upper[0]] * rows[:, upper[1]]  # weighted, for every spread at once, by one product
            return (1 / variance).T @ products, np.log(variance).sum(0)

        size = max(64, 2**20 // max(55, added.shape[1]))
        parts = list(map_blocks(block, len(self.motion), size, threads))
        gram = np.zeros((added.shape[1], 10, 10))
        gram[:, upper[0], upper[1]] = sum(part[0] for part in parts)
        gram[:, upper[1], upper[0]] = gram[:, upper[0], upper[1]]
        logdet = sum(part[1] for part in parts)
        gram, logdet = gram.reshape(*spread.shape, 10, 10), logdet.reshape(spread.shape)
        return ParallaxSums(gram[..., :9, :9], gram[..., :9, 9], gram[..., 9, 9], logdet, len(self.motion))


def equations_of(field: Field, cosmology: Cosmology) -> ParallaxEquations:
    """The equations of a field.

    Parameters
    ----------
    field : Field
        With redshifts.
    cosmology : astropy cosmology
        The shape of the distance.
    """
    rate = 1 / (AU_PER_YEAR * transverse_distance(field.redshift, cosmology))
    p, q, _ = triad(field.lon, field.lat)
    (s1, s2), rho = field.sigma**2, field.rho
    covariance = rho * np.sqrt(s1 * s2)
    angle = np.arctan2(2 * covariance, s1 - s2) / 2
    mean, half = (s1 + s2) / 2, np.hypot((s1 - s2) / 2, covariance)
    large = mean + half
    small = s1 * s2 * (1 - rho**2) / large  # mean − half would cancel
    cos, sin = np.cos(angle), np.sin(angle)
    east, north = np.concatenate([-rate * p, p, q]), np.concatenate([-rate * q, q, -p])
    y = field.motion
    return ParallaxEquations(
        np.concatenate([cos * east + sin * north, cos * north - sin * east], axis=1).T.copy(),
        np.concatenate([cos * y[0] + sin * y[1], cos * y[1] - sin * y[0]]),
        np.concatenate([large, small]),
        np.concatenate([rate, rate]),
        hubble_value(cosmology),
        field.frame,
        field.notes,
    )


def check_determined(matrix: FloatArray, names: Sequence[str], sources: int, limit: float = 1e10) -> None:
    """Raise DegeneracyError where the data leave a combination of parameters unseen.

    Parameters
    ----------
    matrix : (p, p) array
        The normal matrix.
    names : sequence of str
        Which of them.
    sources : int
        How many.
    limit : float
        On the condition number.

    Raises
    ------
    DegeneracyError
        If they do.
    """
    diagonal = np.diag(matrix)
    if 2 * sources >= len(names) and (diagonal > 0).all():
        scaled = matrix / np.sqrt(np.outer(diagonal, diagonal))
        values = np.linalg.eigvalsh(scaled)
        if values[0] * limit > values[-1]:
            return
    raise DegeneracyError(
        f"{sources} sources cannot separate {', '.join(names)}: more sources, over more of the sky and of "
        "more than one distance, are needed"
    )
