"""Amplitudes of random fields of known spectra: what the likelihood of the floor and of waves is tested by."""

from types import SimpleNamespace

import numpy as np

from fit.background._amplitude import compute_posteriors_and_evidence
from fit.background._likelihood import Likelihood, check_degrees, equations_of, should_fit_scale
from vsh.models.covariance import Spectrum


def covariance_of(likelihood, best):
    """The covariance of the amplitudes and κ², from the expected information."""
    tau = best.noise_scale**2
    ratios = best.amplitudes / tau
    cross, single = likelihood.information(ratios)
    k = len(likelihood)
    information = np.empty((k + 1, k + 1))
    information[:k, :k] = cross
    information[:k, k] = information[k, :k] = single - cross @ ratios
    information[k, k] = likelihood.n_data - 2 * ratios @ single + ratios @ cross @ ratios
    block = slice(None) if likelihood.noise_scale else slice(k)
    scale = np.sqrt(np.diag(information)[block])
    scale = np.outer(scale, scale)
    covariance = np.full((k + 1, k + 1), np.nan)
    covariance[block, block] = 2 * tau**2 * np.linalg.pinv(information[block, block] / scale) / scale
    return covariance


def fit_amplitudes(normal, spectra, noise_scale=None, *, degrees=None, free=(1,)):
    """The amplitudes of the spectra, with their errors, at the maximum of the likelihood."""
    equations = equations_of(normal)
    modes = equations.modes
    spectra = [spectra] if isinstance(spectra, Spectrum) else spectra
    flat = check_degrees(modes, free, "free") if free != () else ()
    rest = [l for l in range(1, modes.lmax + 1) if l not in flat]
    degrees = check_degrees(modes, rest if degrees is None else degrees)
    fit_scale = should_fit_scale(normal, noise_scale)
    likelihood = Likelihood(equations, spectra, degrees, flat, fit_scale)
    best = likelihood.find_maximum()
    covariance = covariance_of(likelihood, best)
    return SimpleNamespace(
        noise_scale_error=float(np.sqrt(covariance[-1, -1]) / (2 * best.noise_scale)) if fit_scale else 0.0,
        log_evidence=compute_posteriors_and_evidence(likelihood, best)[1],
        degrees=degrees,
        **vars(best),
    )
