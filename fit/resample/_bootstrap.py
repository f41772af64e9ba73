"""How the result varies when the sources are drawn again: bootstrap over sources, whole or to first order.

Resampling detects errors that differ from source to source. What neighbours share needs blocks
(`fit.resample.jackknife`), and errors common to the whole sky, above all a glide or a rotation of the frame, cannot be
detected by any resampling.
"""

from dataclasses import dataclass, replace
from functools import partial
from hashlib import blake2b
from typing import Literal, cast

import numpy as np
from scipy.special import gammaincc, stdtrit

from fit.normal import WhiteRows, normal_equations
from fit.quality import ErrorSource
from fit.solution import AboutSolution, Solution
from fit.solving import solve
from fit.sums import leverage
from vsh.basis import harmonics
from vsh.field import Field, Weighed, weighed
from vsh.io.parts import Parts, as_parts
from vsh.models.covariance import Covariance
from vsh.modes import Modes
from vsh.scalars import ScalarField, modes_for
from vsh.tools import arguments
from vsh.tools.arguments import between, choice, generator
from vsh.tools.errors import ParameterError
from vsh.tools.logs import logged
from vsh.tools.parallel import map_blocks, progress_bar
from vsh.tools.types import FloatArray, Rng


@dataclass(frozen=True, eq=False)
class Resampled(AboutSolution):
    """A solution and its replicates from resampled sources.

    Attributes
    ----------
    method : str
    solution : Solution
        Solution of the sources as they are.
    replicates : (n, p) array
        Coefficients of each replicate. [µas/yr]
    covariance : (p, p) array
        Covariance of the coefficients, estimated from the replicates. [(µas/yr)²]
    """

    method: str
    solution: Solution
    replicates: FloatArray
    covariance: FloatArray

    @property
    def quoted(self) -> Solution:
        """The solution with these errors."""
        return self.resampled_solution

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
        return replace(
            self.solution,
            covariance=self.covariance,
            formal_covariance=self.solution.covariance,
            errors_from=source,
            error_source=ErrorSource.JACKKNIFE if self.method == "jackknife" else ErrorSource.BOOTSTRAP,
            covariance_dof=dof,
        )

    def interval(self, probability: float = 0.68) -> FloatArray:
        """Lower and upper end of each coefficient's interval of `probability`, (2, p). [µas/yr]

        Percentiles of the replicates; for the jackknife, whose replicates lie close together, the
        interval of its standard error with Student's t, which allows for few blocks.
        """
        probability = between("probability", probability, 0, 1)
        if self.method == "jackknife":
            reach = stdtrit(len(self.replicates) - 1, 0.5 + probability / 2) * self.sigma
            return self.solution.coefficients.values + np.array([[-1], [1]]) * reach
        return np.percentile(self.replicates, [50 - 50 * probability, 50 + 50 * probability], axis=0)


#: Power of (1 − leverage) by which residuals are divided: those of sources that make much of their own fit are too
#: small. With ½, ¾ and 1 pulls are 1.06, 0.92 and 0.80 where 100 sources with 70 coefficients have all the weight,
#: 1.08, 0.98 and 0.89 with 30 and 16.
_POWER = 0.75
#: Poisson numbers with mean 1, less that mean, by 16 random bits; their variance is 0.99997.
_POISSON = np.searchsorted(gammaincc(np.arange(1, 13), 1.0), (np.arange(2**16) + 0.5) / 2**16).astype(np.float32) - 1


@logged("bootstrap")
@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts), n_replicates=partial(arguments.whole, least=2), rng=arguments.seed
)
def bootstrap(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    n_replicates: int = 100,
    rng: Rng = 1,
    *,
    method: Literal["auto", "full", "one-step"] = "auto",
    covariance: Covariance | FloatArray | None = None,
    progress: bool = True,
) -> Resampled:
    """Draw the sources again, each a Poisson number of times with mean 1.

    Its errors hold for sources whose errors are wrong in any way, but independent of each other.

    Parameters
    ----------
    field : Field, ScalarField or Parts
        The sources. Parts are gone through three times.
    modes : Modes, or the degree lmax
        What to fit.
    n_replicates : int
        How many.
    rng : Generator or int
        The source of all randomness.
    method : {"auto", "full", "one-step"}
        "one-step" takes the first step from the fit to the solution of a draw, N⁻¹ Σ (k − 1) Aᵀ C⁻¹ Δ/(1 − leverage)^¾,
        all draws in one pass; "full" solves again for every draw, and its errors are too large where few sources have
        most of the weight. "auto" takes one step. `Resampled.method` says which it was.
    covariance : Covariance or (2n, 2n) array, optional
        Covariance of the motions, all east components first, in place of the field's errors (`fit.normal_equations`).
        Motions are whitened first, and drawn as what each source says that those before it do not.
    progress : bool
        Show a bar, after two seconds.

    Raises
    ------
    ParameterError
        If all draws of a catalogue in parts are to be solved.

    Notes
    -----
    One step is the score bootstrap of Kline & Santos (2012, J. Econometric Methods 1, 23), with residuals that allow
    for what each source makes of its own fit. Pulls are 0.92 to 1.00 from 300 equal sources at degree 3 to catalogues
    in which 100 of 20 000 sources (degree 5), or 30 of 600 (degree 2), have all the weight; those of "full" are 0.81 in
    the latter.
    """
    modes, rng = modes_for(field, modes), generator(rng)
    choice("method", method, ("auto", "full", "one-step"))
    if covariance is not None:
        return _of_rows(WhiteRows.of(cast(Field, field), modes, covariance), n_replicates, rng, progress)
    solution = solve(normal_equations(field, modes))
    if method != "full":
        return _one_step(as_parts(field, Weighed), solution, n_replicates, rng, progress)
    if isinstance(field, Parts):
        raise ParameterError('a catalogue in parts is drawn in one step: method="one-step"')
    replicates = np.empty((n_replicates, len(modes)))
    for replicate in progress_bar(replicates, words="bootstrap", shown=progress):
        times = rng.poisson(1.0, len(field))
        drawn, times = field[times > 0], times[times > 0]
        # Drawn k times is measured k times as well: errors smaller by √k.
        again = drawn.with_errors(drawn.sigma / np.sqrt(times))
        replicate[:] = solve(normal_equations(again, modes)).coefficients.values
    return Resampled("bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


def _of_rows(rows, n_replicates, rng, progress):
    replicates = np.empty((n_replicates, len(rows.modes)))
    for replicate in progress_bar(replicates, words="bootstrap", shown=progress):
        replicate[:] = solve(rows.normal_equations(rng.poisson(1.0, len(rows)))).coefficients.values
    return Resampled("bootstrap", solve(rows.normal_equations()), replicates, np.cov(replicates, rowvar=False))


def _one_step(sky, solution, n_replicates, rng, progress):
    total = sky.sum(_size, roles=(), words="bootstrap", progress=progress)
    seed = int(rng.integers(2**63))
    work = partial(_drawn_scores, solution=solution, total=total, n_replicates=n_replicates, seed=seed)
    steps = sky.sum(work, roles=(), words="bootstrap", progress=progress)
    # The catalogue's own N⁻¹, also where the solution's covariance is another.
    replicates = solution.values + steps @ solution.covariance
    return Resampled("one-step bootstrap", solution, replicates, np.cov(replicates, rowvar=False))


def _size(field):
    return len(field), float(field.weights[: field.components].sum())


def _drawn_scores(
    field: Field, solution: Solution, total: tuple[int, float], n_replicates: int, seed: int
) -> FloatArray:
    """Σ (k − 1) Aᵀ C⁻¹ Δ/(1 − leverage)^¾ over some sources, (replicates, p), for numbers k drawn for each."""
    share = leverage(field, solution.modes, solution.covariance, total=total)

    def block(part):
        some = field[part]
        # Seeded by the sources: the same draws however many threads, parts or workers there are.
        digest = blake2b(some.lon.tobytes() + some.lat.tobytes(), digest_size=16).digest()
        rng = np.random.default_rng([seed, int.from_bytes(digest, "big")])
        own = weighed(some.weights, solution.residuals(some).data) / (1 - share[part]) ** _POWER
        scores = np.einsum("pkn,kn->pn", harmonics(some.lon, some.lat, solution.modes), own)
        # Single precision, relative to the largest: a millionth of what the draws scatter by.
        size = np.abs(scores).max(1, keepdims=True)
        scores /= np.where(size > 0, size, 1.0)
        times = _POISSON[rng.integers(0, 2**16, (n_replicates, len(some)), dtype=np.uint16)]
        return (times @ scores.T.astype(np.float32)).astype(float) * size.T

    size = max(64, min(2**24 // n_replicates, 2**22 // len(solution.modes)))
    return sum(map_blocks(block, len(field), size), np.zeros((n_replicates, len(solution.modes))))


@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts), n_replicates=partial(arguments.whole, least=2), rng=arguments.seed
)
def parametric_bootstrap(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    n_replicates: int,
    rng: Rng,
    *,
    covariance: Covariance | FloatArray | None = None,
) -> Resampled:
    """Draw the motions again, from the fit and the catalogue's errors.

    The fit is linear and the errors are Gaussian, so the replicates are N(c, N⁻¹) exactly
    and are drawn as such; no sky is simulated.

    Parameters
    ----------
    field, modes, n_replicates, rng, covariance
        As for `bootstrap`.
    """
    modes = modes_for(field, modes)
    solution = solve(normal_equations(field, modes, covariance=covariance))
    draws = generator(rng).standard_normal((n_replicates, len(modes)))
    replicates = solution.coefficients.values + draws @ np.linalg.cholesky(solution.covariance).T
    return Resampled("parametric bootstrap", solution, replicates, np.cov(replicates, rowvar=False))
