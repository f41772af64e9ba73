"""Priors, chains and checkpoints, for any posterior."""

from fit.sampling._arviz import inference_data
from fit.sampling._axis import Axis
from fit.sampling._chain import ENOUGH, Run, autocorrelation, split_r_hat
from fit.sampling._checkpoint import check_writable, fingerprint
from fit.sampling._priors import Density, Flat, Normal, Prior, as_prior, integrable_over_cube, named_function

__all__: list[str] = []
