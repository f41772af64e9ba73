"""In one line whether an acceleration and a spin are seen, with every error that is known of."""

from dataclasses import replace
from typing import Any

import numpy as np

from fit.quality import ONE_SIDE, SEEN, ErrorSource, hint_of, printed_p_value, solution_of
from vsh.tools.arguments import explained
from vsh.tools.notes import codes_of
from vsh.tools.types import FloatArray
from vsh.vector import GAIA_EDR3, Vector


@explained
def verdict(solution: Any, *, p_value: float | None = None, p_spin: float | None = None) -> str:
    """Whether acceleration and spin are seen, and how large they are or can be; empty for what has no motions.

    Parameters
    ----------
    solution : Solution
        Its errors are multiplied by √(χ²/dof) where χ² contradicts those of the catalogue.
    p_value, p_spin : float, optional
        Probability of as large an acceleration, or spin, by chance, where it is known better than by its errors alone.

    Returns
    -------
    str
        A sentence, which names the errors it rests on.
    """
    solution = solution_of(solution, "verdict")
    if solution.unit != "µas/yr" or not np.isfinite(solution.covariance).all():
        return ""
    factor = error_factor(solution)
    if factor > _WRONG:
        return f"verdict: none; residuals are {factor:.3g} times the errors: are both in the units that were taken?"
    if solution.covariance_dof < 3:
        return f"verdict: none; {solution.covariance_dof + 1:.0f} replicates are too few for the errors of a vector"
    whole, errors, known = with_all_errors(solution)
    p = whole.p_value if p_value is None else p_value
    hint = hint_of(p)
    half = solution.modes.lmax > 1 and ONE_SIDE in codes_of(solution.notes)
    spin = _spin(with_all_errors(solution, "spin")[0], p_spin)
    rest = f"p = {printed_p_value(p)}{hint and f' ({hint})'}; {spin}; errors {', '.join(errors)}{_beside_gaia(whole)}"
    if half:
        rest += "; one side of the sky tells degree 1 badly from higher ones: --lmax 1, or --recommended"
    if not p < SEEN:
        return f"verdict: no acceleration is seen, it is below {whole.amplitude_limit():.3g} µas/yr (95 %); {rest}"
    a, (lon, lat) = solution.acceleration, whole.direction
    size = f"{whole.amplitude:.3g} ± {whole.amplitude_error:.2g} µas/yr"
    place = f"{lon:.0f}°, {lat:+.0f}° ({a.frame}) ± {whole.direction_cone():.0f}°"
    sure = known and not half
    return f"verdict: {'' if sure else 'perhaps '}an acceleration of {size} towards {place}; {rest}"


#: How the errors of a solution are named.
_NAMES = {
    ErrorSource.CATALOGUE: "as quoted",
    ErrorSource.SCALED: "as quoted, scaled by χ²",
    ErrorSource.FLOWS: "as quoted, with flows of galaxies",
    ErrorSource.EXCESS_NOISE: "with excess noise, from the residuals",
    ErrorSource.RESIDUALS: "from the residuals of the robust fit, source by source",
    ErrorSource.BOOTSTRAP: "from the bootstrap",
    ErrorSource.JACKKNIFE: "from the jackknife",
    ErrorSource.JOINT: "of all together",
}

#: By how much residuals exceed errors where a unit is wrong rather than an error.
_WRONG = 30.0


def error_factor(solution: Any) -> float:
    """By which errors are multiplied where χ² says that those of the catalogue are too small."""
    return max(solution.quality.factor, 1.0) if solution.error_source == ErrorSource.CATALOGUE else 1.0


def _spin(spin, p_spin):
    p = spin.p_value if p_spin is None else p_spin
    if p < SEEN:
        return f"a spin of {spin.amplitude:.3g} ± {spin.amplitude_error:.2g}, p = {printed_p_value(p)}"
    return f"no spin, below {spin.amplitude_limit():.3g} (p = {printed_p_value(p)})"


def with_all_errors(solution: Any, name: str = "acceleration") -> tuple[Vector, list[str], bool]:
    """The spin or the acceleration with every error that is known of; what these are; is what is shared among them?

    Parameters
    ----------
    solution : Solution
        As for `verdict`.
    name : {"spin", "acceleration"}
        Which.
    """
    a: Vector = getattr(solution, name)
    covariance, errors, known = np.array(a.covariance), ["as quoted"], True
    if solution.error_source != ErrorSource.CATALOGUE:
        errors = [_NAMES[ErrorSource(solution.error_source)]]
    elif (factor := error_factor(solution)) > 1:
        covariance *= factor**2
        errors = [f"{factor:.2f} times those quoted"]
    if solution.includes_floor:
        errors.append("with what sources share")
    elif solution.floor is not None:
        error = getattr(solution.floor, f"{name}_error")
        covariance += error**2 * np.eye(3)
        errors.append(f"with what sources share (± {error:.2g})")
    else:
        errors.append("without what sources share: --lmax 3 or --recommended tells it")
        known = False
    return _with(a, covariance), errors, known


def _with(vector, covariance):
    """The same vector with errors that hold its own; of what replicates told their part has degrees of freedom."""
    dof = vector.dof * (np.trace(covariance) / np.trace(vector.covariance)) ** 2  # Satterthwaite (1946)
    return replace(vector, covariance=covariance, dof=float(dof))


def covariance_of_all(solution: Any) -> FloatArray:
    """The covariance of the coefficients with the errors that the verdict has, for figures."""
    covariance = np.array(solution.covariance)
    if solution.unit != "µas/yr" or not np.isfinite(covariance).all() or solution.includes_floor:
        return covariance
    covariance *= error_factor(solution) ** 2
    if solution.floor is not None:
        covariance += np.diag(solution.floor.added(solution.modes))
    return covariance


def _beside_gaia(whole):
    """Whether it is the acceleration that Gaia EDR3 has."""
    gaia = GAIA_EDR3.to_frame(whole.frame)
    p = _with(replace(whole, value=whole.value - gaia.value), whole.covariance + gaia.covariance).p_value
    known = f"Gaia EDR3's {gaia.amplitude:.2f} ± {gaia.amplitude_error:.2f} (p = {printed_p_value(p)})"
    if p < SEEN:
        return f"; disagrees with {known}: is it the instrument? (docs/instrument.md)"
    return f"; agrees with {known}" if whole.p_value < SEEN else f"; allows {known}"
