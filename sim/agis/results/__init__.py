"""What a joint solution found, and what its errors are like."""

from sim.agis.results._frame import rotate_frame
from sim.agis.results._solution import AgisSolution
from sim.agis.results._statistics import correlation_by_angle, ratio_by

__all__ = ["AgisSolution", "correlation_by_angle", "ratio_by", "rotate_frame"]
