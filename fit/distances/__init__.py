"""What a redshift and a magnitude tell of a distance, when redshifts hold velocities and errors."""

from fit.distances._calibrate import WHOLE_DISPERSION, calibrate, calibrate_if_known
from fit.distances._calibration import Calibration, InverseDistances, inverse_distances, mean_rates
from fit.distances._density import ErrorsByRedshift, LuminosityFunction, SourceDensity, flow_counts, flow_limits
from fit.distances._measured import MeasuredRates, has_distances, measured_rates

__all__ = ["Calibration", "MeasuredRates", "calibrate", "inverse_distances", "measured_rates"]
