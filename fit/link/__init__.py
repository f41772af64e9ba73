"""Frames linked over all magnitudes: orientation and spin of catalogues from stars, quasars and what is known."""

from typing import TYPE_CHECKING

from fit.link._link import link
from fit.link._plan import LinkPlan, forecast
from fit.link._prior import LinkPrior, read_priors
from fit.link._solution import LinkSolution
from fit.link._steps import StepSearch, find_step
from fit.link._unknowns import Unknowns
from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from fit.link._plot import plot_link

__all__ = [
    "LinkPlan",
    "LinkPrior",
    "LinkSolution",
    "StepSearch",
    "Unknowns",
    "find_step",
    "forecast",
    "link",
    "read_priors",
]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazily(__name__, __all__, {"_plot": ["plot_link"]})
