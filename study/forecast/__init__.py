"""What catalogues to come will tell, in one table."""

from typing import TYPE_CHECKING

import lazy_loader

from study.forecast._forecast import Forecast, forecast
from study.forecast._surveys import SURVEYS, Survey

if TYPE_CHECKING:
    from study.forecast._plot import plot_forecast

__all__ = ["SURVEYS", "Forecast", "Survey", "forecast"]

# matplotlib is imported when a figure is first asked for.
__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"_plot": ["plot_forecast"]})


def __dir__() -> list[str]:
    return __all__
