"""What catalogues to come will tell, in one table."""

from typing import TYPE_CHECKING

from study.forecast._forecast import SURVEYS, SecondEpoch, Survey, SurveyForecast, forecast_surveys
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from study.forecast._plot import plot_forecast

__all__ = ["SURVEYS", "SecondEpoch", "Survey", "SurveyForecast", "forecast_surveys"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_forecast"]})
