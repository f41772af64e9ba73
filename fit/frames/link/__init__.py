"""Frames linked over all magnitudes: orientation and spin of catalogues from stars, quasars and what is known."""

from typing import TYPE_CHECKING

from fit.frames.link._link import StepSearch, find_step, link
from fit.frames.link._rows import LinkPrior, Unknowns, read_priors
from fit.frames.link._solution import FrameTie, LinkPlan, forecast
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.frames.link._plot import plot_link

__all__ = [
    "FrameTie",
    "LinkPlan",
    "LinkPrior",
    "StepSearch",
    "Unknowns",
    "find_step",
    "forecast",
    "link",
    "read_priors",
]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_link"]})
