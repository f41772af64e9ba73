"""What a redshift and a magnitude tell of a distance, when redshifts hold velocities and errors."""

from fit.distances._calibrate import WHOLE_DISPERSION, calibrate, calibrate_if_known
from fit.distances._calibration import Calibration
from fit.distances._density import SourceDensity, flow_counts, flow_limits
from fit.distances._errors import ErrorsByRedshift
from fit.distances._luminosity import LuminosityFunction
from fit.distances._moments import InverseDistances, inverse_distances, mean_rates

__all__ = [
    "Calibration",
    "InverseDistances",
    "LuminosityFunction",
    "SourceDensity",
    "calibrate",
    "flow_counts",
    "inverse_distances",
]
