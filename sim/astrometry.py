"""Errors of Gaia by magnitude, and from transits to five-parameter solutions with their covariances.

A transit at time t under the position angle ψ measures, along the scan,

    w = (Δα* + µ_α* (t − t₀)) sin ψ + (Δδ + µ_δ (t − t₀)) cos ψ + f_ϖ ϖ.

The problem is linear, so the errors of a solution are those of a solution of the noise.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from sim.population import uniform_sky
from sim.scanning import NominalScanningLaw, Transits
from sim.variability import Variability, markov_chain
from vsh.io.epochs import make_design_rows
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray, Release, Rng

#: For each release: the factor t on the parallax error, and σ_µα* and σ_µδ in parallax errors a year.
#: "paper" is Bachchan et al.'s five-year mission: the t of DR4 (five and a half years) times 0.886, which
#: brings the formal errors of their case A out of our magnitudes and scanning law.
RELEASES = {
    "DR3": (1.0, 1.03, 0.89),
    "DR4": (0.749, 0.58, 0.50),
    "DR5": (0.527, 0.29, 0.25),
    "paper": (0.749 * 0.886, 0.556, 0.496),
}

#: Sky-mean errors of Δα* and Δδ at the mean epoch in parallax errors (Gaia's published performance).
POSITION_FACTORS = (0.787, 0.699)


def parallax_error(magnitude: ArrayLike, release: Release = "DR3") -> FloatArray:
    """Sky-mean standard error of the parallax, (n,). [µas]

    Gaia's published error model: √(40 + 800 z + 30 z²) · t with z = 10^{0.4 (max(G, 13) − 15)}.
    """
    if release not in RELEASES:
        raise ParameterError(f"unknown release {release!r}: choose one of {', '.join(RELEASES)}")
    z = 10 ** (0.4 * (np.maximum(magnitude, 13.0) - 15.0))
    return np.sqrt(40 + 800 * z + 30 * z**2) * RELEASES[release][0]


@arguments.accepts(magnitude=arguments.float_array)
def gaia_errors(magnitude: ArrayLike, release: Release = "DR3") -> FloatArray:
    """Sky-mean standard errors of µ_α* and µ_δ, (2, n). [µas/yr]

    Parameters
    ----------
    magnitude : (n,) array
        G.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose errors are drawn.

    Examples
    --------
    >>> gaia_errors(np.array([20.0]), "DR5").round().ravel()
    array([94., 81.])
    """
    error = parallax_error(magnitude, release)
    _, east, north = RELEASES[release]
    return np.stack([east * error, north * error])


__all__ = ["Astrometry", "solve_astrometry"]

#: Time between knots of the attitude, whose error all sources seen in between share. [yr]
KNOT_INTERVAL = 30.0 / (365.25 * 86400)
PARAMETERS = ("ra", "dec", "parallax", "pmra", "pmdec")
#: A source is solved if it has more transits than parameters, and its normal matrix is no worse conditioned.
LEAST_EIGENVALUE = 1e-6
#: Where two of them that a field can have stand.
COMPONENTS = {"motion": slice(3, 5), "position": slice(0, 2)}


@dataclass(frozen=True, eq=False)
class Astrometry(Frozen):
    """Five-parameter solutions.

    Attributes
    ----------
    errors : (n, 5) array
        Estimate less truth, in the order of PARAMETERS. [µas, and µas/yr]
    covariance : (n, 5, 5) array
        As quoted; nan where a source has too few transits.
    transits : (n,) array
        How many each source had.
    """

    errors: FloatArray
    covariance: FloatArray
    transits: IntArray

    @property
    def solved(self) -> BoolArray:
        """Mask of the sources with a solution, (n,)."""
        return np.isfinite(self.covariance[:, 0, 0])


def smallest_eigenvalue(matrix: FloatArray) -> FloatArray:
    """Smallest eigenvalue of normal matrices, (…, p, p), scaled to a diagonal of one: how well they are determined."""
    root_diagonal = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 1e-300))
    return np.linalg.eigvalsh(matrix / (root_diagonal[..., :, None] * root_diagonal[..., None, :]))[..., 0]


def split_covariance(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard errors, (2, n), and correlations, (n,), of covariances, (n, 2, 2)."""
    sigma = np.sqrt(np.stack([covariance[:, 0, 0], covariance[:, 1, 1]]))
    return sigma, covariance[:, 0, 1] / (sigma[0] * sigma[1])


def solve_astrometry(
    transits: Transits,
    error: ArrayLike,
    rng: Rng,
    *,
    years: float = 5.0,
    variability: Variability | None = None,
    attitude: FloatArray | None = None,
    quote_variability: bool = False,
) -> Astrometry:
    """Simulate the measurements of all transits and solve for every source.

    Parameters
    ----------
    transits : Transits
        Ordered by source.
    error : (n,) array
        Along-scan error of a transit for each of the n sources [µas]
    rng : Generator or int
        The source of all randomness.
    years : float
        Length of the mission; the reference epoch is its middle.
    variability : Variability, optional
        Variability of the photocentres.
    attitude : (k,) array, optional
        Error of the attitude in each interval between knots, shared by all sources [µas]
    quote_variability : bool
        Fold the variability into the quoted covariance, A⁺ (W⁻¹ + C) A⁺ᵀ; the
        weights of the solution stay those of the measurement noise.
    """
    rng = generator(rng)
    error = np.asarray(error, float)
    n, source = len(error), transits.source
    design = make_design_rows(transits.angle, transits.parallax_factor, transits.time - years / 2)
    noise = error[source] * rng.standard_normal(len(source))
    if variability is not None and variability.sigma > 0:
        east, north = (markov_chain(transits.time, variability.sigma, variability.tau, rng, source) for _ in range(2))
        noise += east * design[0] + north * design[1]
    if attitude is not None:
        noise += attitude[np.minimum((transits.time / KNOT_INTERVAL).astype(int), len(attitude) - 1)]

    counts = transits.counts(n)
    normal, rhs = np.empty((n, 5, 5)), np.empty((n, 5))
    for i in range(5):
        rhs[:, i] = np.bincount(source, design[i] * noise, n)
        for j in range(i + 1):
            normal[:, i, j] = normal[:, j, i] = np.bincount(source, design[i] * design[j], n)
    # A solution wants more transits than parameters, and scans in more than one direction.
    is_solved = (counts > 5) & (smallest_eigenvalue(normal) > LEAST_EIGENVALUE)
    inverse_normal = np.full((n, 5, 5), np.nan)
    inverse_normal[is_solved] = np.linalg.inv(normal[is_solved])
    errors = np.einsum("nij,nj->ni", inverse_normal, rhs)
    covariance = inverse_normal * error[:, None, None] ** 2
    if quote_variability and variability is not None:
        covariance = covariance + _compute_variability_covariances(inverse_normal, design, transits, variability, n)
    return Astrometry(errors, covariance, counts)


def predict_solution_covariances(
    transits: Transits,
    error: FloatArray,
    *,
    years: float = 5.0,
    variability: Variability | None = None,
    attitude: float = 0.0,
) -> tuple[FloatArray, FloatArray]:
    """Formal and true covariances of the solutions, without drawing them: two (n, 5, 5) arrays.

    The true one adds A⁺ C A⁺ᵀ of the variability, and the attitude's error as if it were independent
    from transit to transit. nan where a source has too few transits.
    """
    formal = solve_astrometry(transits, error, 0, years=years).covariance
    inverse_normal = formal / error[:, None, None] ** 2
    true = formal + attitude**2 * inverse_normal
    if variability is not None and variability.sigma > 0:
        design = make_design_rows(transits.angle, transits.parallax_factor, transits.time - years / 2)
        true = true + _compute_variability_covariances(inverse_normal, design, transits, variability, len(error))
    return formal, true


def _compute_variability_covariances(inverse, design, transits, variability, n):
    """A⁺ C A⁺ᵀ of every source, C the covariance of its variability at its transits."""
    covariances = np.zeros((n, 5, 5))
    bounds = np.searchsorted(transits.source, np.arange(n + 1))
    for k, (begin, end) in enumerate(pairwise(bounds)):
        pseudoinverse = inverse[k] @ design[:, begin:end]
        angle = transits.angle[begin:end]
        chain_covariance = variability.covariance(transits.time[begin:end]) * np.cos(np.subtract.outer(angle, angle))
        covariances[k] = pseudoinverse @ chain_covariance @ pseudoinverse.T
    return covariances


def compute_unit_transit_errors(law: NominalScanningLaw, n: int = 2000, seed: int = 1) -> FloatArray:
    """Sky-mean errors of (α*, δ, ϖ, µ_α*, µ_δ) for a transit error of one, (5,).

    From n uniform positions, always the same ones; the law remembers the result.
    """
    if (n, seed) not in law.remembered:
        rng = np.random.default_rng(seed)
        solution = solve_astrometry(law.transits(*uniform_sky(n, rng)), np.ones(n), rng, years=law.years)
        if not solution.solved.any():
            raise ParameterError(
                f"in {law.years:g} years no source has transits enough for five parameters: a longer mission is needed"
            )
        law.remembered[n, seed] = np.sqrt(np.einsum("nii->ni", solution.covariance[solution.solved])).mean(0)
    return law.remembered[n, seed]
