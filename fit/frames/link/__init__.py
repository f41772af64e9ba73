"""Frames linked over all magnitudes: orientation and spin of catalogues from stars, quasars and what is known."""

from fit.frames.link._link import StepSearch, find_step, link
from fit.frames.link._rows import LinkPrior, Unknowns, read_priors
from fit.frames.link._solution import FrameTie, LinkPlan, forecast

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
