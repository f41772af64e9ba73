"""Fits that do not trust every source."""

from dataclasses import dataclass, replace
from functools import partial
from typing import cast

import numpy as np
from scipy.special import chdtr, chdtri

from fit.normal import normal_equations
from fit.solution import AboutSolution, Solution
from fit.solving import solve
from vsh.field import Field, Weighed
from vsh.io.parts import Parts, as_parts, median
from vsh.models.covariance import Covariance, as_covariance
from vsh.modes import Modes
from vsh.scalars import ScalarField, modes_for
from vsh.tools import arguments
from vsh.tools.arguments import positive
from vsh.tools.errors import ConvergenceError
from vsh.tools.logs import logged
from vsh.tools.types import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class Clipped(AboutSolution):
    """A fit to the sources that agree with it.

    Attributes
    ----------
    solution : Solution
        Solution of the sources kept.
    kept : (n,) bool array or None
        Which those are; None of a catalogue in parts, whose sources `select` chooses.
    n_rounds : int
        How many fits it took.
    limit : float
        The largest X that was kept.
    factor : float
        Factor on the errors for the selection by residuals, included in the solution's covariance.
    n_clipped : int
        How many sources were left out.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> clipped = clip(field, 1, threshold=6.0)
    >>> clipped.n_clipped, len(clipped.sources(field))
    (0, 500)
    """

    solution: Solution
    kept: BoolArray | None
    n_rounds: int
    limit: float
    factor: float = 1.0
    n_clipped: int = 0

    def select(self, field: Field) -> Field:
        """Those sources of a `field` in the solution's frame that agree with the fit; a step for `Parts.map`."""
        return _select(field, partial(_distances, solution=self.solution), self.limit)

    def sources(self, field: Field | Parts) -> Field | Parts:
        """The sources that were kept, of the `field` or the parts that were clipped; a note says how many were not."""
        chosen = field.map(self.select) if isinstance(field, Parts) else field[self.kept]
        return chosen.add_note(self.solution.notes[-1])

    @property
    def scatter_factor(self) -> float:
        """By which a covariance is multiplied that was estimated from the scatter of the kept sources.

        They were kept because they fit: their scatter is too small, and so seems their influence.
        """
        return self.factor**4


@logged("clipped")
@arguments.accepts(
    field=arguments.a(Field, ScalarField, Parts), threshold=arguments.positive, max_rounds=arguments.whole
)
def clip(
    field: Field | ScalarField | Parts,
    modes: Modes | int,
    kappa: float = 3.0,
    threshold: float | None = None,
    *,
    max_rounds: int = 100,
    covariance: Covariance | FloatArray | None = None,
) -> Clipped:
    """Fit, leave out what lies too far from the fit, and fit again until nothing changes.

    The distance is X = √(Δᵀ C⁻¹ Δ), Δ the residual of a source, C its covariance. Every round looks at all sources
    again, so one left out may come back. For Gaussian errors κ times the median leaves out a fraction 2^(−κ²) of good
    sources; of a scalar field the limit is the one that leaves out as many (κ = 3: 3.1 standard errors).

    Parameters
    ----------
    field : Field, ScalarField or Parts
        The sources. Parts are gone through four times a round, twice with a threshold.
    modes : Modes, or the degree lmax
        What to fit.
    kappa : float
        Leave out X > κ · median(X)
    threshold : float, optional
        Leave out X > threshold instead.
    max_rounds : int
        Largest number of rounds.
    covariance : Covariance or (2n, 2n) array, optional
        Covariance of the motions of a field, all east components first, in place of its errors
        (`fit.normal_equations`). The distance of a source is then by its own block of the matrix.

    Raises
    ------
    ConvergenceError
        If the clipping oscillates, has not converged after `max_rounds`, or leaves too few sources.
    ParameterError
        If kappa or the threshold is not positive.

    Notes
    -----
    Lindegren et al. (2018, A&A 616, A2), Klioner et al. (2021, A&A 649, A9) clip like this. Sources that are
    chosen this way scatter less than their errors, and carry less information: with q half the squared limit in
    units of the errors, covariances are multiplied by (1 − e^−q)/(1 − (1 + q) e^−q), χ² divided by
    1 − q e^−q/(1 − e^−q). Both hold for Gaussian errors, of the size quoted or all wrong by one factor; the
    square root of the first is 1.006, 1.108, 1.308 for κ = 3, 2, 1.5 (pulls within 5 % of 1).

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> off = field.motion.copy()
    >>> off[:, 7] += 5000
    >>> clipped = clip(Field(lon, lat, off, field.sigma), 1, 5.0)
    >>> np.flatnonzero(~clipped.kept).tolist()
    [7]
    """
    modes = modes_for(field, modes)
    shared = None if covariance is None else as_covariance(covariance, field)
    sky = as_parts(field if shared is None else shared.own_errors(cast(Field, field)), Weighed)
    given = positive("kappa", kappa) if threshold is None else threshold
    normal = normal_equations(field, modes, covariance=shared)
    n_sources = n_kept = normal.n_sources
    components = modes.components
    # For Gaussian errors the median tells their scale, and so how many σ the limit is.
    q = (chdtri(components, 2.0 ** -(given**2)) if threshold is None else given**2) / 2
    in_medians = (
        float(np.sqrt(chdtri(components, 2.0 ** -(kappa**2)) / chdtri(components, 0.5))) if threshold is None else 1.0
    )
    kept, before, seen = None, None, set()
    for rounds in range(1, max_rounds + 1):
        solution = solve(normal)
        distances = partial(_distances, solution=solution)
        if sky.in_memory is not None:  # once a round, for the median and the choice alike
            distances = partial(_known, values=distances(sky.in_memory))
        limit = threshold or in_medians * float(median(sky, distances, f"clip, round {rounds}"))
        chosen = sky.sum(partial(_within, distances=distances, limit=limit), roles=(), words=f"clip, round {rounds}")
        if chosen["mark"] == kept or (kept is None and chosen["sources"] == n_sources):
            rule = (
                f"κ = {kappa:g}{'' if components == 2 else f', {in_medians:.3g}'} times the median"
                if threshold is None
                else "the given threshold"
            )
            note = f"clipped {n_sources - n_kept} of {n_sources} sources with X > {limit:.3g} ({rule}; {rounds} rounds)"
            mask = distances(sky.in_memory) <= limit if sky.in_memory is not None else None
            return _corrected(solution, mask, rounds, limit, q, note, n_sources - n_kept)
        if components * chosen["sources"] < len(modes):
            raise ConvergenceError(
                f"the clip keeps {chosen['sources']} of {n_sources} sources, too few for {len(modes)} coefficients: "
                f"take a larger {'kappa' if threshold is None else 'threshold'} than {given:g}"
            )
        kept, n_kept = chosen["mark"], chosen["sources"]
        if kept in seen or rounds == max_rounds:
            swing = sky.sum(partial(_differing, one=(distances, limit), two=before), roles=(), words="clip")
        if kept in seen and swing <= max(1, n_sources // 1000):
            return _settled(sky, modes, shared, (distances, limit), before, rounds, swing, q)
        if kept in seen:
            raise ConvergenceError(
                f"the clipping oscillates after {rounds} rounds: {swing} sources are alternately clipped and kept at "
                f"X ≈ {limit:.3g}. Take another kappa, or the absolute threshold={limit * 1.02:.3g}"
            )
        seen.add(kept)
        before = distances, limit
        select = partial(_select, distances=distances, limit=limit)
        if sky.in_memory is None:
            normal = normal_equations(sky.map(select), modes)
        else:
            own = None if shared is None else shared[distances(sky.in_memory) <= limit]
            normal = normal_equations(select(sky.in_memory), modes, covariance=own)
    raise ConvergenceError(
        f"the clip has not settled after {max_rounds} rounds: {swing} sources more or less in the last"
    )


def _settled(sky, modes, shared, one, two, rounds, swing, q):
    """The fit to what both choices keep between which a few sources swing."""
    both = partial(_larger, one=one, two=two)
    select = partial(_select, distances=both, limit=1.0)
    mask = None
    if sky.in_memory is None:
        normal = normal_equations(sky.map(select), modes)
    else:
        mask = both(sky.in_memory) <= 1.0
        normal = normal_equations(select(sky.in_memory), modes, covariance=None if shared is None else shared[mask])
    n_sources, n_kept = sky.sum(len), normal.n_sources
    limit = one[1]
    note = (
        f"clipped {n_sources - n_kept} of {n_sources} sources with X > {limit:.3g} ({rounds} rounds; {swing} of them "
        f"{'was' if swing == 1 else 'were'} alternately clipped and kept)"
    )
    return _corrected(solve(normal), mask, rounds, limit, q, note, n_sources - n_kept)


def _larger(field, one, two):
    """The larger of X over its limit by two fits."""
    return np.maximum(*(distances(field) / limit for distances, limit in (one, two)))


def _corrected(solution, kept, rounds, limit, q, note, n_clipped):
    """The clipped solution, its errors and χ² corrected for the choice by residuals up to X²/2 = q."""
    variance, share = truncation(q, solution.modes.components)
    if variance > 1.001:
        note += f"; errors multiplied by {np.sqrt(variance):.3f} and χ² divided by {share:.3f} for that choice"
    solution = replace(
        solution, covariance=solution.covariance * variance, chi2=solution.chi2 / share, notes=(*solution.notes, note)
    )
    return Clipped(solution, kept, rounds, limit, float(np.sqrt(variance)), n_clipped)


def _distances(field, solution):
    """X of each source."""
    return np.sqrt(solution.residuals(field).chi2)


def _known(field, values):
    """X of the field in memory, which was computed before."""
    return values


def _select(field, distances, limit):
    return field[distances(field) <= limit]


def _differing(field, one, two):
    """How many sources one fit keeps and the other does not."""
    kept, before = (distances(field) <= limit for distances, limit in (one, two or one))
    return int((kept != before).sum())


def _within(field, distances, limit):
    """How many sources are kept, and a sum of hashes that tells one choice from another."""
    kept = distances(field) <= limit
    places = np.stack([field.lon[kept], field.lat[kept]]).view(np.uint64)
    # The finaliser of SplitMix64 (Steele et al. 2014) mixes the bits of each source's place; sums are modulo 2⁶⁴.
    mixed = places[0] ^ (places[1] * np.uint64(0x9E3779B97F4A7C15))
    for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
        mixed = (mixed ^ (mixed >> np.uint64(shift))) * np.uint64(factor)
    return {"sources": int(kept.sum()), "mark": _Mark(int(np.sum(mixed ^ (mixed >> np.uint64(31)), dtype=np.uint64)))}


class _Mark(int):
    """A sum of hashes, modulo 2⁶⁴."""

    def __add__(self, other):
        return _Mark(int.__add__(self, other) % 2**64)


def truncation(q: float, components: int = 2) -> tuple[float, float]:
    """What a cut at X²/2 = q does to Gaussian residuals: factors on variance and on χ²."""
    # For two, 1 − e^{−q} and 1 − (1 + q) e^{−q}.
    kept, slope = chdtr(components, 2 * q), chdtr(components + 2, 2 * q)
    return float(kept / slope), float(slope / kept)
