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
    add_acceleration_prior,
    add_flow_prior,
    add_vector_prior,
    check_parameters_determined,
    compute_flow_covariance,
    marginalise_flow,
    subtract_known_motions,
)
from fit.secular_parallax._estimate import (
    WITH_LOCAL_GROUP,
    VelocityForecast,
    forecast_velocity,
    hubble_constant,
    is_redshift_frame_undeclared,
    make_local_group,
    make_notes_on_local_group,
    observer_velocity,
    predict_errors,
    warn_of_undeclared_frame,
)
from fit.secular_parallax._model import ASSUMED, LEFT_DISPERSION, DistanceModel, make_flow_modes_within
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
