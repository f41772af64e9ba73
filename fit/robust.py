"""Fits that do not trust every source."""

from dataclasses import dataclass, replace

import numpy as np

from fit.noise import ExtraNoise, extra_noise
from fit.normal import normal_equations
from fit.reweight import Reweighted, permissive, student_t
from fit.solution import Solution
from fit.solve import solve
from vsh.errors import ConvergenceError

__all__ = ["Clipped", "ExtraNoise", "Reweighted", "clip", "extra_noise", "permissive", "student_t"]


@dataclass(frozen=True, eq=False)
class Clipped:
    """A fit to the sources that agree with it.

    Attributes
    ----------
    solution : Solution
        Of the sources kept.
    kept : (n,) bool array
        Which those are.
    rounds : int
        How many fits it took.
    limit : float
        The largest X that was kept.
    """

    solution: Solution
    kept: np.ndarray
    rounds: int
    limit: float


def clip(field, modes, kappa=3.0, threshold=None, max_rounds=100):
    """Fit, leave out what lies too far from the fit, and fit again until nothing changes.

    The distance is X = √(Δᵀ C⁻¹ Δ), Δ the residual of a source, C its covariance. Every
    round looks at all sources again, so one left out may come back. For Gaussian errors
    κ times the median leaves out a fraction 2^(−κ²) of good sources.

    Parameters
    ----------
    field : Field
    modes : Modes
    kappa : float — leave out X > κ · median(X)
    threshold : float, optional — leave out X > threshold instead

    Returns
    -------
    Clipped

    Raises
    ------
    ConvergenceError
        If the choice goes round in circles, or has not settled after `max_rounds`.
    ValueError
        If kappa or the threshold is not positive.

    Notes
    -----
    Lindegren et al. (2018, A&A 616, A2), Klioner et al. (2021, A&A 649, A9) clip like this.
    """
    given = kappa if threshold is None else threshold
    if not given > 0:
        raise ValueError(f"the limit of a clip must be positive, not {given}")
    kept, seen = np.ones(len(field), bool), {}
    for rounds in range(1, max_rounds + 1):
        solution = solve(normal_equations(field[kept], modes))
        x = np.sqrt(solution.residuals(field).chi2)
        limit = float(kappa * np.median(x) if threshold is None else threshold)
        chosen = x <= limit
        if (chosen == kept).all():
            left_out = len(field) - int(kept.sum())
            rule = f"κ = {kappa:g} times the median" if threshold is None else "the given threshold"
            said = f"clipped {left_out} of {len(field)} sources with X > {limit:.3g} ({rule}; {rounds} rounds)"
            return Clipped(replace(solution, notes=(*solution.notes, said)), kept, rounds, limit)
        swing = int((chosen != kept).sum())
        kept = chosen
        if (key := kept.tobytes()) in seen:
            raise ConvergenceError(
                f"the clip goes round in circles after {rounds} rounds: {swing} sources come and go at "
                f"X ≈ {limit:.3g}. Take another kappa, or the absolute threshold={limit * 1.02:.3g} (--threshold)"
            )
        seen[key] = rounds
    raise ConvergenceError(f"the clip has not settled after {max_rounds} rounds: {swing} sources still change")
