"""The fit to quote, and the other estimators by name."""

from fit.methods._methods import METHODS, Estimate, estimate
from fit.methods._methods import WITH_VALUE as WITH_VALUE
from fit.methods._recommended import Recommended, recommended
from fit.methods._recommended import degree_for as degree_for

__all__ = ["METHODS", "Estimate", "Recommended", "estimate", "recommended"]
