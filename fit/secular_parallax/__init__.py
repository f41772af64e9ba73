"""Our velocity from the secular parallax of galaxies for a known H0, and H0 for a known velocity."""

from fit.secular_parallax._equations import (
    OMEGA,
    A,
    Flow,
    LocalGroup,
    ParallaxEquations,
    ParallaxParts,
    ParallaxSums,
    U,
    add_flow_prior,
    check_determined,
    flow_covariance,
    marginalise_flow,
    with_acceleration,
    with_prior,
    without_known,
)
from fit.secular_parallax._estimate import (
    WITH_GROUP,
    VelocityForecast,
    forecast_velocity,
    hubble_constant,
    is_frame_undeclared,
    local_group_of,
    notes_on_group,
    observer_velocity,
    predict_errors,
    warn_of_undeclared_frame,
)
from fit.secular_parallax._model import ASSUMED, LEFT_DISPERSION, DistanceModel, modes_within
from fit.secular_parallax._solution import HubbleSolution, ParallaxSolution, VelocitySolution, doubt_speed

__all__ = [
    "DistanceModel",
    "Flow",
    "HubbleSolution",
    "ParallaxSolution",
    "VelocityForecast",
    "VelocitySolution",
    "forecast_velocity",
    "hubble_constant",
    "observer_velocity",
    "predict_errors",
]
