"""In one line whether an acceleration is seen, with every error that is known of."""

from typing import Any

import numpy as np

from fit.quality import SEEN, printed_p_value
from vsh.vector import GAIA_EDR3, Vector


def verdict(solution: Any, *, shared: bool = False, p_value: float | None = None) -> str:
    """Whether the acceleration is seen, and how large it is or can be; empty for what has no motions.

    Parameters
    ----------
    solution : Solution
        Its errors are multiplied by √(χ²/dof) where χ² contradicts those of the catalogue.
    shared : bool
        Whether what sources share is in its errors already; otherwise its `floor` is added, where it has one.
    p_value : float, optional
        Probability of as large an acceleration by chance, where it is known better than by its errors alone.

    Returns
    -------
    str
        A sentence, which names the errors it rests on.
    """
    if solution.unit != "µas/yr" or not np.isfinite(solution.covariance).all():
        return ""
    whole, errors, known = with_all_errors(solution, shared=shared)
    p = whole.p_value if p_value is None else p_value
    near = f" (seen: below {SEEN})" if SEEN <= p < 0.05 else ""
    rest = f"p = {printed_p_value(p)}{near}; errors {', '.join(errors)}{_beside_gaia(whole)}"
    if not p < SEEN:
        return f"verdict: no acceleration is seen, it is below {whole.amplitude_limit():.3g} µas/yr (95 %); {rest}"
    a, (lon, lat) = solution.acceleration, whole.direction
    size = f"{whole.amplitude:.3g} ± {whole.amplitude_error:.2g} µas/yr"
    place = f"{lon:.0f}°, {lat:+.0f}° ({a.frame}) ± {whole.direction_cone():.0f}°"
    return f"verdict: {'' if known else 'perhaps '}an acceleration of {size} towards {place}; {rest}"


def with_all_errors(
    solution: Any, name: str = "acceleration", *, shared: bool = False
) -> tuple[Vector, list[str], bool]:
    """The spin or the acceleration with every error that is known of; what these are; is what is shared among them?

    Parameters
    ----------
    solution : Solution
        As for `verdict`.
    name : {"spin", "acceleration"}
        Which.
    shared : bool
        As for `verdict`.
    """
    a: Vector = getattr(solution, name)
    covariance, errors, known = np.array(a.covariance), ["as quoted"], True
    if solution.errors_from != "the catalogue":
        errors = [f"from {solution.errors_from.partition(', with the floor')[0]}"]
    elif solution.quality.contradicted and solution.quality.factor > 1:
        covariance *= solution.quality.factor**2
        errors = [f"{solution.quality.factor:.2f} times those quoted"]
    if shared:
        errors.append("with what sources share")
    elif solution.floor is not None:
        error = getattr(solution.floor, f"{name}_error")
        covariance += error**2 * np.eye(3)
        errors.append(f"with what sources share (± {error:.2g})")
    else:
        errors.append("without what sources share: --lmax 3 or --recommended tells it")
        known = False
    return Vector(a.value, covariance, a.frame, a.unit), errors, known


def holds_floor(solution: Any) -> bool:
    """Whether what sources share is in the errors of a solution."""
    return ", with the floor" in solution.errors_from


def _beside_gaia(whole):
    """A word where it is not the acceleration that Gaia EDR3 has."""
    gaia = GAIA_EDR3.to_frame(whole.frame)
    p = Vector(whole.value - gaia.value, whole.covariance + gaia.covariance, whole.frame).p_value
    if not p < SEEN:
        return ""
    return f"; Gaia EDR3's {gaia.amplitude:.2f} ± {gaia.amplitude_error:.2f} is another (p = {printed_p_value(p)})"
