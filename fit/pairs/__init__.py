"""Pairs of sources at an angle: correlation functions, without a pair ever counted."""

from fit.pairs._correlation import TEMPLATES, Correlation, TemplateFit, correlation_function, waves_curve

__all__ = ["Correlation", "TemplateFit", "correlation_function"]
