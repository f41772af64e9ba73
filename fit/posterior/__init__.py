"""The posterior of our velocity and the Hubble constant."""

from fit.posterior._posterior import Posterior, read_samples
from fit.posterior._priors import Priors
from fit.posterior._sample import GridPosterior, grid, sample
from fit.posterior._sampling import Density, Flat, Normal
from fit.posterior._summary import Interval, Samples
from vsh.tools.modules import hint_missing_names

__all__ = [
    "Density",
    "Flat",
    "GridPosterior",
    "Interval",
    "Normal",
    "Posterior",
    "Priors",
    "Samples",
    "grid",
    "read_samples",
    "sample",
]

__getattr__ = hint_missing_names(__name__, __all__)
