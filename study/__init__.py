"""Forecasts and the referee.

The one place that knows both `sim` and `fit`.
"""
