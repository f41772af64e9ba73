"""Simulation studies: many skies with a known truth, fitted, and what came of it.

The one place that knows both `sim` and `fit`.
"""

from study.config import Study, load
from study.run import run

__all__ = ["Study", "load", "run"]
