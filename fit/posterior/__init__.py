"""The posterior of our velocity and the Hubble constant."""

from fit.posterior._grid import GridPosterior, grid
from fit.posterior._priors import Priors
from fit.posterior._sample import Posterior, read_samples, sample
from fit.posterior._summary import Interval, Samples
from fit.sampling import Density, Flat, Normal

__all__ = [
    "Density",
    "Flat",
    "Normal",
    "Priors",
    "Samples",
    "GridPosterior",
    "Interval",
    "Posterior",
    "grid",
    "read_samples",
    "sample",
]
