"""Pairs of sources at an angle: correlation functions, without a pair ever counted."""

from typing import TYPE_CHECKING

from fit.pairs._correlation import TEMPLATES, Correlation, TemplateFit, correlation_function, waves_curve
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.pairs._plot import plot_pairs

__all__ = ["Correlation", "TemplateFit", "correlation_function"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_plot": ["plot_pairs"]})
