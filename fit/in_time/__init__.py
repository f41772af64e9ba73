"""Fields that change with time: functions of time × vector spherical harmonics, from epoch astrometry."""

from fit.in_time._equations import TimeEquations, normal_equations, solve
from fit.in_time._solution import Functions, TimeSolution, waves

__all__ = ["Functions", "TimeEquations", "TimeSolution", "normal_equations", "solve", "waves"]
