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
    check_determined,
    flow_covariance,
    with_acceleration,
    with_flow,
    without_flow,
)
from fit.secular_parallax._estimate import (
    WITHOUT_GROUP,
    VelocityForecast,
    collect_notes,
    forecast_velocity,
    hubble_constant,
    is_frame_undeclared,
    local_group_of,
    observer_velocity,
    predict_errors,
)
from fit.secular_parallax._model import ASSUMED, LEFT_DISPERSION, DistanceModel, modes_within
from fit.secular_parallax._solution import HubbleSolution, ParallaxSolution, VelocitySolution

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
