"""One gravitational wave from one direction: its best strain, how likely noise alone is, and limits."""

from fit.waves._search import WaveSearch, WaveSpectrum, search, search_in_time

__all__ = ["WaveSearch", "WaveSpectrum", "search", "search_in_time"]
