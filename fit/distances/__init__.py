"""What a redshift and a magnitude tell of a distance, when redshifts hold velocities and errors."""

from fit.distances._calibration import (
    WHOLE_DISPERSION,
    Calibration,
    calibrate,
    calibrate_if_known,
    declared_frame,
    inverse_distances,
    motions_per_velocity,
)
from fit.distances._density import (
    MeasuredInverseDistances,
    flow_information,
    flow_limits,
    has_distance_or_parallax,
    inverse_distances_from_measurements,
)

__all__ = [
    "Calibration",
    "MeasuredInverseDistances",
    "calibrate",
    "inverse_distances",
    "inverse_distances_from_measurements",
]
