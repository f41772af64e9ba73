"""The estimator that `vsh-fit`'s options name, and what it makes of a class of the sources."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import fit
from fit.normal import NormalEquations
from fit.solving import with_coverage
from vsh.modes import Modes


@dataclass(frozen=True, eq=False)
class Estimate:
    """A fit by the estimator that was asked for.

    Attributes
    ----------
    solution : Solution
    sources : Field or Parts
        Those that went into it.
    n_clipped : int
        How many were clipped.
    weights : Recommended, Reweighted, ExcessNoise or None
        The fit whose weights classes and templates are summed with; None of least squares.
    """

    solution: Any
    sources: Any
    n_clipped: int = 0
    weights: Any = None

    def equations(self, field: Any, lmax: int, *, templates: Sequence[Any] = ()) -> NormalEquations:
        """Sum normal equations of a class of the sources by the weights of this estimator."""
        if self.weights is None:
            return fit.normal_equations(field, lmax, templates=templates)
        return self.weights.equations(field, lmax, templates=templates)

    @property
    def is_scaled(self) -> bool:
        """Whether χ² scales the errors of `equations`: not where they come from residuals already."""
        return self._robust is None

    @property
    def _robust(self):
        """The robust fit whose weights are taken; None of other estimators, and where it did not settle."""
        weights = self.weights.weights if isinstance(self.weights, fit.Recommended) else self.weights
        return weights if isinstance(weights, fit.robust.Reweighted) else None

    @property
    def class_note(self) -> str:
        """Which estimator the numbers of classes and templates have."""
        if self._robust is not None:
            return "classes and templates are summed by the weights of the robust fit, errors from their own residuals"
        if isinstance(self.weights, fit.robust.ExcessNoise):
            return "classes and templates have the excess noise of the whole, errors scaled by the χ²/dof of each"
        return "classes and templates are fitted by least squares, errors scaled by the χ²/dof of each"


def estimate(field: Any, modes: Modes, options: argparse.Namespace) -> Estimate:
    """Fit by the estimator that the options name: of `--clip` and one other at most."""
    if options.recommended:
        found = fit.recommended(field, modes.lmax, rng=options.seed)
        return Estimate(found.plain, field, 0, found)
    factor, n_clipped = 1.0, 0
    weights: Any = None
    solution: Any = None
    if options.clip is not None or options.clip_threshold is not None:
        clipped = fit.robust.clip(field, modes, options.clip, options.clip_threshold)
        solution, n_clipped = clipped.solution, clipped.n_clipped
        field, factor = clipped.sources(field), clipped.scatter_factor
    if options.excess_noise:
        weights = fit.robust.excess_noise(field, modes, scale=options.excess_noise == "scale")
        solution = weights.solution
    elif options.robust:
        method = {"student": fit.robust.student_t, "permissive": fit.robust.permissive}[options.robust]
        weights = method(field, modes)
        solution = weights.solution
    elif options.bootstrap:
        solution = fit.resample.bootstrap(field, modes, options.bootstrap, options.seed).resampled_solution
    elif options.jackknife == 0:
        best: Any
        _, best, advice = fit.resample.compare_blocks(field, modes)
        solution = best.resampled.resampled_solution
        solution = replace(solution, notes=(*solution.notes, advice))
    elif options.jackknife:
        solution = fit.resample.jackknife(field, modes, options.jackknife).resampled_solution
    elif solution is None:
        return Estimate(fit.fit_field(field, modes, floor=False), field, n_clipped)
    else:
        return Estimate(with_coverage(solution, field), field, n_clipped)
    solution = replace(solution, covariance=solution.covariance * factor)
    return Estimate(with_coverage(solution, field), field, n_clipped, weights)
