"""What catalogues to come will tell, in one table."""

from typing import TYPE_CHECKING

import lazy_loader

from study.forecast._forecast import SurveyForecast, forecast_surveys
from study.forecast._surveys import SURVEYS, Survey
from vsh.tools.modules import old_names

if TYPE_CHECKING:
    from study.forecast._plot import plot_forecast

__all__ = ["SURVEYS", "Survey", "SurveyForecast", "forecast_surveys"]

# matplotlib is imported when a figure is first asked for.
_lazy, _, _ = lazy_loader.attach(__name__, submod_attrs={"_plot": ["plot_forecast"]})
__getattr__ = old_names(__name__, {"Forecast": "SurveyForecast", "forecast": "forecast_surveys"}, _lazy)


def __dir__() -> list[str]:
    return __all__
