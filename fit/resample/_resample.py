"""How the result varies when the sources do: bootstrap and jackknife.

Normal equations add, so the sky is cut into blocks once, and every replicate is a sum of
blocks that are already there.

Resampling detects errors that differ from source to source, or from block to block. If neighbours share errors,
blocks must be larger than the correlation length (`compare_blocks` estimates it). Errors common to the whole
sky, above all a glide or a rotation of the frame, cannot be detected by any resampling.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from scipy.special import stdtrit

from fit.normal import NormalEquations, normal_equations
from fit.solution import AboutSolution, Solution
from fit.solve import solve
from vsh.checks import arguments
from vsh.checks.arguments import between, generator
from vsh.errors import DegeneracyError
from vsh.field import Field
from vsh.modes import Modes, as_modes
from vsh.sky.pixels import pixels_of
from vsh.system.progress import progress_bar
from vsh.types import Figure, FloatArray, Rng, Table
from vsh.vector import Vector

#: Beyond this, the normal matrices of all blocks are not kept at once. [bytes]
MEMORY = 4 * 2**30


@dataclass(frozen=True, eq=False)
class Resampled(AboutSolution):
    """A solution and its replicates from resampled sources.

    Attributes
    ----------
    method : str
    solution : Solution
        Of the sources as they are.
    replicates : (n, p) array
        Coefficients of each replicate. [µas/yr]
    covariance : (p, p) array
        Of the coefficients, estimated from the replicates. [(µas/yr)²]
    """

    method: str
    solution: Solution
    replicates: FloatArray
    covariance: FloatArray

    def report(self) -> str:
        """The solution with these errors, as text.

        Returns
        -------
        str
        """
        return self.resampled_solution.report()

    def to_table(self) -> Table:
        """The coefficients with these errors as an astropy Table, a row each.

        Returns
        -------
        Table
        """
        return self.resampled_solution.to_table()

    def plot(self) -> Figure:
        """Power by degree with these errors as a matplotlib figure.

        Returns
        -------
        Figure
        """
        return self.resampled_solution.plot()

    @property
    def samples(self) -> FloatArray:
        """Another name of `replicates`."""
        return self.replicates

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each coefficient, (p,). [µas/yr]"""
        return np.sqrt(np.diag(self.covariance))

    @property
    def resampled_solution(self) -> Solution:
        """The solution with this covariance in place of N⁻¹: its `spin` and `acceleration` carry these errors."""
        source = f"the {self.method}, {len(self.replicates)} replicates"
        dof = len(self.replicates) - 1.0
        return replace(self.solution, covariance=self.covariance, errors_from=source, covariance_dof=dof)

    @property
    def spin(self) -> Vector:
        """The spin with these errors, a Vector. [µas/yr]"""
        return self.resampled_solution.spin

    @property
    def acceleration(self) -> Vector:
        """The acceleration with these errors, a Vector. [µas/yr]"""
        return self.resampled_solution.acceleration

    def interval(self, probability: float = 0.68) -> FloatArray:
        """Lower and upper end of each coefficient's interval, (2, p). [µas/yr]

        Percentiles of the replicates; for the jackknife, whose replicates lie close together, the
        interval of its standard error with Student's t, which allows for few blocks.

        Parameters
        ----------
        probability : float
            Between 0 and 1.

        Returns
        -------
        array
        """
        probability = between("probability", probability, 0, 1)
        if self.method == "jackknife":
            reach = stdtrit(len(self.replicates) - 1, 0.5 + probability / 2) * self.sigma
            return self.solution.coefficients.values + np.array([[-1], [1]]) * reach
        return np.percentile(self.replicates, [50 - 50 * probability, 50 + 50 * probability], axis=0)


@arguments.accepts(field=arguments.a(Field), n_replicates=partial(arguments.whole, least=2), rng=arguments.seed)
def bootstrap(field: Field, modes: Modes | int, n_replicates: int, rng: Rng, *, progress: bool = True) -> Resampled:
    """Draw the sources again, each a Poisson number of times with mean 1.

    Its errors hold for sources whose errors are wrong in any way, but independent of each other.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    n_replicates : int
        How many.
    rng : Generator or int
        The source of all randomness.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Resampled
    """
    modes = as_modes(modes)
    rng = generator(rng)
    solution = solve(normal_equations(field, modes))
    replicates = np.empty((n_replicates, len(modes)))
    for replicate in _bar(replicates, progress, "bootstrap"):
        times = rng.poisson(1.0, len(field))
        drawn, times = field[times > 0], times[times > 0]
        # Drawn k times is measured k times as well: errors smaller by √k.
        again = drawn.with_errors(drawn.sigma / np.sqrt(times))
        replicate[:] = solve(normal_equations(again, modes)).coefficients.values
    return Resampled("bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


@arguments.accepts(field=arguments.a(Field), n_replicates=partial(arguments.whole, least=2), rng=arguments.seed)
def parametric_bootstrap(field: Field, modes: Modes | int, n_replicates: int, rng: Rng) -> Resampled:
    """Draw the motions again, from the fit and the catalogue's errors.

    The fit is linear and the errors are Gaussian, so the replicates are N(c, N⁻¹) exactly
    and are drawn as such; no sky is simulated.

    Parameters
    ----------
    field, modes, n_replicates, rng
        As for `bootstrap`.

    Returns
    -------
    Resampled
    """
    modes = as_modes(modes)
    solution = solve(normal_equations(field, modes))
    draws = generator(rng).standard_normal((n_replicates, len(modes)))
    replicates = solution.coefficients.values + draws @ np.linalg.cholesky(solution.covariance).T
    return Resampled("parametric bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


@arguments.accepts(
    field=arguments.a(Field), nside=arguments.whole, n_replicates=partial(arguments.whole, least=2), rng=arguments.seed
)
def block_bootstrap(
    field: Field, modes: Modes | int, nside: int, n_replicates: int, rng: Rng, *, progress: bool = True
) -> Resampled:
    """Bootstrap over HEALPix blocks of the sky: errors that allow for correlations between neighbours.

    Parameters
    ----------
    field, modes, n_replicates, rng, progress
        As for `bootstrap`.
    nside : int
        nside of the HEALPix blocks; blocks without sources are not counted.

    Returns
    -------
    Resampled

    Raises
    ------
    DegeneracyError
        If fewer than two blocks hold sources, or their matrices do not fit into memory.
    """
    modes = as_modes(modes)
    rng = generator(rng)
    parts = _blocks(field, nside)
    p = len(modes)
    if len(parts) * p * p * 8 > MEMORY:
        raise DegeneracyError(
            f"{len(parts)} blocks of {p} × {p} do not fit into memory: lower nside from {nside} or lmax from {modes.lmax}"
        )
    normals = [normal_equations(field[part], modes) for part in _bar(parts, progress, "blocks")]
    matrices = np.array([normal.matrix.ravel() for normal in normals])
    sides = np.array([normal.rhs for normal in normals])
    total: Any = sum(normals)
    solution = solve(total)
    replicates = np.empty((n_replicates, p))
    for replicate in _bar(replicates, progress, "block bootstrap"):
        times = rng.multinomial(len(parts), np.full(len(parts), 1 / len(parts))).astype(float)
        drawn = NormalEquations(
            modes, (times @ matrices).reshape(p, p), times @ sides, 0.0, 2 * len(field), field.frame
        )
        replicate[:] = solve(drawn).coefficients.values
    return Resampled("block bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


@arguments.accepts(field=arguments.a(Field), nside=arguments.whole)
def jackknife(field: Field, modes: Modes | int, nside: int, *, progress: bool = True) -> Resampled:
    """Leave out one HEALPix block of the sky after the other.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    nside : int
        Of the blocks, 58.6°/nside wide: several times the length over which errors are correlated.
        With noise correlated over 10° pulls were 2.1 at nside 4, 1.5 at 2 and 1.3 at 1 (formal errors: 10).
        Take at least twice as many blocks as coefficients: with fewer, errors come out too large.
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Resampled
        Its covariance is (B − 1)/B Σ (c_b − c̄)(c_b − c̄)ᵀ over the B blocks.

    Raises
    ------
    DegeneracyError
        If fewer than two blocks hold sources, or the fit is degenerate without one of them.
    """
    modes = as_modes(modes)
    parts = _blocks(field, nside)
    whole_sky = normal_equations(field, modes)
    replicates = np.empty((len(parts), len(modes)))
    for replicate, part in zip(replicates, _bar(parts, progress, f"jackknife, nside {nside}"), strict=True):
        replicate[:] = solve(whole_sky - normal_equations(field[part], modes)).coefficients.values
    away = replicates - replicates.mean(0)
    covariance = (len(parts) - 1) / len(parts) * away.T @ away
    return Resampled("jackknife", solve(whole_sky), replicates, covariance)


def _blocks(field, nside):
    """The indices of the sources of each block that has any."""
    pixel = pixels_of(field.lon, field.lat, nside)
    order = np.argsort(pixel, kind="stable")
    parts = np.split(order, np.flatnonzero(np.diff(pixel[order])) + 1)
    if len(parts) < 2:
        raise DegeneracyError(f"all sources lie in one block of nside {nside}: take a larger nside")
    return parts


def _bar(things, progress, words):
    return progress_bar(things, words=words, shown=progress)
