"""Fields that change with time: functions of time × vector spherical harmonics, from epoch astrometry."""

from typing import TYPE_CHECKING

from fit.in_time._equations import TimeEquations, normal_equations, solve
from fit.in_time._solution import Functions, TimeSolution, waves
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.in_time._plot import plot_in_time

__all__ = ["Functions", "TimeEquations", "TimeSolution", "normal_equations", "solve", "waves"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_in_time"]})
