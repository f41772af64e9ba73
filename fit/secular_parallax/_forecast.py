"""What a catalogue to come will tell of our velocity and of H0."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fit.secular_parallax._estimate import HubbleSolution, VelocitySolution, hubble_constant, observer_velocity
from vsh.field import Field
from vsh.types import ArrayLike
from vsh.vector import Vector


def predict(
    sources: Any,
    hubble: float = 67.3,
    velocity: str | Vector | ArrayLike = "planck",
    *,
    sigma: ArrayLike | None = None,
    **options: Any,
) -> tuple[VelocitySolution, HubbleSolution]:
    """Errors of our velocity and of H0 to come: a VelocitySolution and a HubbleSolution with nan for values.

    Parameters
    ----------
    sources, sigma
        As for `fit.correlation.predict`, with redshifts.
    hubble : float
        For the velocity, and the scale of H0's error [km/s/Mpc]
    velocity
        As for `fit.secular_parallax.hubble_constant`.
    **options
        Of `fit.secular_parallax.observer_velocity`, but hubble.

    Returns
    -------
    tuple[VelocitySolution, HubbleSolution]
    """
    still = Field.without_motions(sources, sigma)
    options = {"redshift_frame": still.redshift_frame or "true"} | options
    still = still.minus(still.motion)
    ours = observer_velocity(still, hubble, **options)
    constant = hubble_constant(still, velocity, hubble=hubble, **options)
    nothing = float("nan")
    return (
        replace(ours, values=np.full(len(ours.names), nothing), chi2=nothing),
        replace(constant, values=np.full(len(constant.names), nothing), chi2=nothing),
    )
