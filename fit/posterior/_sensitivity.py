"""What the prior on H0 does to the result: the same data under other priors."""

from __future__ import annotations

from typing import Any

import numpy as np

from fit.posterior._priors import HUBBLE_LIMITS
from fit.sampling import Flat, Normal
from vsh.types import FloatArray

#: Levels of the columns: median, 68 %, and one-sided limits of 95 %.
_LEVELS = np.array([0.5, 0.15865525, 0.84134475, 0.95, 0.05])


def hubble_likelihood(model: Any, samples: dict[str, FloatArray], hubble: FloatArray) -> FloatArray | None:
    """The logarithm of the likelihood of H0, all else integrated or at its median; None where it has no closed form.

    Parameters
    ----------
    model : ParallaxModel
        Of the data.
    samples : dict of str to (n,) array
        Of the posterior.
    hubble : (k,) array
        [km/s/Mpc]
    """
    if not hasattr(model, "conditional") or not model.priors.velocity.gaussian:
        return None
    others = [np.full(hubble.size, np.median(samples[name])) for name in model.priors.free if name != "H0"]
    numbers = np.column_stack([hubble, *others])
    return model.conditional(numbers, with_priors=False)[0]


def other_priors(prior: Any) -> dict[str, Any]:
    """Priors beside the one that was given, as functions of H0 that return log-densities.

    Parameters
    ----------
    prior : Flat, Normal or Density
        On H0.
    """
    found = {"as given": prior.log}
    if isinstance(prior, Normal):
        found["twice as wide"] = Normal(prior.mean, 2 * prior.sigma, prior.low, prior.high).log
    if isinstance(prior, Flat) and prior.proper:
        width = prior.high - prior.low
        found["twice as wide"] = Flat(max(prior.low - width / 2, 0.0), prior.high + width / 2).log
    return found | {
        "flat in H0": np.zeros_like,
        "flat in v H0": lambda h: 3 * np.log(h),
        "flat in log H0": lambda h: -np.log(h),
    }


def sensitivity_lines(model: Any, samples: dict[str, FloatArray]) -> list[str]:
    """A table of H0 under several priors, as lines; none where the likelihood has no closed form.

    Parameters
    ----------
    model : ParallaxModel
        Of the data.
    samples : dict of str to (n,) array
        Of the posterior.
    """
    hubble = np.geomspace(*HUBBLE_LIMITS, 4000)
    log = hubble_likelihood(model, samples, hubble)
    if log is None or not np.isfinite(log).any():
        return []
    lines = ["H0 under other priors [km/s/Mpc], between 1 and 1000; one-sided limits"]
    lines.append(f"{'':18}{'median':>10}{'68 %':>22}{'95 % below':>14}{'95 % above':>12}")
    step = np.gradient(hubble)
    for name, prior in other_priors(model.priors.hubble).items():
        total = log + prior(hubble)
        weight = np.where(np.isfinite(total), np.exp(total - np.nanmax(total[np.isfinite(total)])), 0.0) * step
        share = np.cumsum(weight) / weight.sum()
        median, low, high, below, above = np.interp(_LEVELS, share, hubble)
        ends = weight[:40].sum() + weight[-40:].sum()  # within a factor of 1.07 of a limit
        said = "  (leans on the limits)" if ends > 0.02 * weight.sum() else ""
        lines.append(f"{name:18}{median:10.4g}{low:11.4g} …{high:9.4g}{below:14.4g}{above:12.4g}{said}")
    return lines
