"""Fits that do not trust every source."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.normal import normal_equations
from fit.solution import AboutSolution, Solution
from fit.solve import solve
from vsh.checks import arguments
from vsh.checks.arguments import positive
from vsh.errors import ConvergenceError
from vsh.field import Field
from vsh.modes import Modes, as_modes
from vsh.types import FloatArray


@dataclass(frozen=True, eq=False)
class Clipped(AboutSolution):
    """A fit to the sources that agree with it.

    Attributes
    ----------
    solution : Solution
        Of the sources kept.
    kept : (n,) bool array
        Which those are.
    n_rounds : int
        How many fits it took.
    limit : float
        The largest X that was kept.
    factor : float
        Factor on the standard errors that corrects for the selection by residuals; it is included in the
        solution's covariance.
    """

    solution: Solution
    kept: FloatArray
    n_rounds: int
    limit: float
    factor: float = 1.0


@arguments.accepts(field=arguments.a(Field), threshold=arguments.positive, max_rounds=arguments.whole)
def clip(
    field: Field, modes: Modes | int, kappa: float = 3.0, threshold: float | None = None, *, max_rounds: int = 100
) -> Clipped:
    """Fit, leave out what lies too far from the fit, and fit again until nothing changes.

    The distance is X = √(Δᵀ C⁻¹ Δ), Δ the residual of a source, C its covariance. Every
    round looks at all sources again, so one left out may come back. For Gaussian errors
    κ times the median leaves out a fraction 2^(−κ²) of good sources.

    Parameters
    ----------
    field : Field
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    kappa : float
        Leave out X > κ · median(X)
    threshold : float, optional
        Leave out X > threshold instead.
    max_rounds : int
        Of the iteration.

    Returns
    -------
    Clipped

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
    """
    modes = as_modes(modes)
    given = positive("kappa", kappa) if threshold is None else threshold
    kept, seen = np.ones(len(field), bool), {}
    for rounds in range(1, max_rounds + 1):
        solution = solve(normal_equations(field[kept], modes))
        x = np.sqrt(solution.residuals(field).chi2)
        limit = float(kappa * np.median(x) if threshold is None else threshold)
        chosen = x <= limit
        if (chosen == kept).all():
            left_out = len(field) - int(kept.sum())
            rule = f"κ = {kappa:g} times the median" if threshold is None else "the given threshold"
            # For Gaussian errors the median of X² is 2 ln 2 times what is right, whatever their scale.
            q = given**2 * (np.log(2) if threshold is None else 0.5)
            variance, share = truncation(q)
            said = f"clipped {left_out} of {len(field)} sources with X > {limit:.3g} ({rule}; {rounds} rounds)"
            if variance > 1.001:
                said += f"; errors multiplied by {np.sqrt(variance):.3f} and χ² divided by {share:.3f} for that choice"
            solution = replace(
                solution,
                covariance=solution.covariance * variance,
                chi2=solution.chi2 / share,
                notes=(*solution.notes, said),
            )
            return Clipped(solution, kept, rounds, limit, float(np.sqrt(variance)))
        if 2 * int(chosen.sum()) < len(modes):
            raise ConvergenceError(
                f"the clip keeps {int(chosen.sum())} of {len(field)} sources, too few for {len(modes)} coefficients: "
                f"take a larger {'kappa' if threshold is None else 'threshold'} than {given:g}"
            )
        swing = int((chosen != kept).sum())
        kept = chosen
        if (key := kept.tobytes()) in seen:
            raise ConvergenceError(
                f"the clipping oscillates after {rounds} rounds: {swing} sources are alternately clipped and kept at "
                f"X ≈ {limit:.3g}. Take another kappa, or the absolute threshold={limit * 1.02:.3g} (--clip-threshold)"
            )
        seen[key] = rounds
    raise ConvergenceError(f"the clip has not settled after {max_rounds} rounds: {swing} sources still change")


def truncation(q: float) -> tuple[float, float]:
    """What a cut at X²/2 = q does to Gaussian residuals of two components: factors on variance and on χ².

    Parameters
    ----------
    q : float
        The limit on X²/2.

    Examples
    --------
    >>> [round(float(np.sqrt(truncation(kappa**2 * np.log(2))[0])), 3) for kappa in (3, 2.5, 2, 1.5)]
    [1.006, 1.03, 1.108, 1.308]
    """
    beyond = np.exp(-q)
    kept, slope = -np.expm1(-q), -np.expm1(-q) - q * beyond
    return float(kept / slope), float(slope / kept)
