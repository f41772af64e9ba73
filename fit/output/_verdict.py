"""In one line whether an acceleration is seen, with every error that is known of."""

from typing import Any

import numpy as np

from fit.quality import SEEN, printed_p_value
from vsh.vector import Vector


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
    known = True
    a: Vector = solution.acceleration
    covariance, errors = np.array(a.covariance), ["as quoted"]
    if solution.errors_from != "the catalogue":
        errors = [f"from {solution.errors_from.partition(', with the floor')[0]}"]
    elif solution.quality.contradicted and solution.quality.factor > 1:
        covariance *= solution.quality.factor**2
        errors = [f"{solution.quality.factor:.2f} times those quoted"]
    if shared:
        errors.append("with what sources share")
    elif solution.floor is not None:
        covariance += solution.floor.acceleration_error**2 * np.eye(3)
        errors.append(f"with what sources share (± {solution.floor.acceleration_error:.2g})")
    else:
        errors.append("without what sources share: --lmax 3 or --recommended tells it")
        known = False
    whole = Vector(a.value, covariance, a.frame, a.unit)
    p = whole.p_value if p_value is None else p_value
    rest = f"p = {printed_p_value(p)}; errors {', '.join(errors)}"
    if not p < SEEN:
        return f"verdict: no acceleration is seen, it is below {whole.amplitude_limit():.3g} µas/yr (95 %); {rest}"
    lon, lat = whole.direction
    size = f"{whole.amplitude:.3g} ± {whole.amplitude_error:.2g} µas/yr"
    place = f"{lon:.0f}°, {lat:+.0f}° ({a.frame}) ± {whole.direction_cone():.0f}°"
    return f"verdict: {'' if known else 'perhaps '}an acceleration of {size} towards {place}; {rest}"
