"""Samples in a few numbers: our own, since libraries change what an interval is."""

from typing import NamedTuple

import numpy as np

UNITS = {
    "v_x": "km/s", "v_y": "km/s", "v_z": "km/s", "speed": "km/s", "H0": "km/s/Mpc", "sigma_pec": "km/s",
    "sigma_extra": "µas/yr", "outlier_fraction": "", "a_x": "µas/yr", "a_y": "µas/yr", "a_z": "µas/yr",
    "omega_x": "µas/yr", "omega_y": "µas/yr", "omega_z": "µas/yr",
}  # fmt: skip

#: The same as standards for tables want them.
FITS_UNITS = {"km/s": "km / s", "km/s/Mpc": "km / (Mpc s)", "µas/yr": "uas / yr"}


class Interval(NamedTuple):
    """What samples say of one quantity; the intervals leave equal parts on both sides."""

    median: float
    low68: float
    high68: float
    low95: float
    high95: float
    mean: float
    sigma: float


def intervals(samples):
    """An Interval for each name.

    >>> found = intervals({"x": np.arange(101.0)})["x"]
    >>> found.median, round(found.low68, 2), round(found.high68, 2), round(found.low95, 2)
    (50.0, 15.87, 84.13, 2.28)
    """
    levels = [50, 15.865525, 84.134475, 2.2750132, 97.7249868]  # the median, and the Gaussian's 1 and 2 σ
    return {
        name: Interval(*map(float, np.percentile(x, levels)), float(np.mean(x)), float(np.std(x, ddof=1)))
        for name, x in samples.items()
    }


def text_of(posterior):
    """A page of text on a posterior."""
    steps, walkers, _ = posterior.chain.shape
    slowest = max(posterior.autocorrelation.values())
    priors = posterior.model.priors
    said = priors.describe()
    lines = [
        f"Posterior ({posterior.frame} axes, velocity toward the apex)",
        f"priors         velocity: {priors.velocity.words or said['velocity']}",
        f"               H0: {said['hubble']} km/s/Mpc",
        f"               peculiar velocities: {said['peculiar']} km/s{_fixed(said['peculiar'])}",
        f"               extra noise: {said['extra']} µas/yr",
        f"chain          {steps} steps of {walkers} walkers = {steps / slowest:.0f} autocorrelation times",
        f"               {len(posterior.samples['H0'])} samples kept after burn-in and thinning",
        f"{'':18}{'median':>10}{'68 %':>22}{'95 %':>22}",
    ]
    for name, row in posterior.summary().items():
        lines.append(
            f"{name:18}{row.median:10.4g}{row.low68:11.4g} …{row.high68:9.4g}{row.low95:11.4g} …{row.high95:9.4g}  "
            f"{UNITS[name]}"
        )
    return "\n".join([*lines, *_at_limits(posterior)])


def _at_limits(posterior, near=0.02, share=1e-3):
    """Where the samples lean against a limit that neither data nor priors give."""
    prior, samples = posterior.model.priors.hubble, posterior.samples["H0"]
    low, high = posterior.model.priors.limits("H0")
    lines = []
    width = near * (high - low)
    for limit, leaning, given in (
        (low, samples < min(low + width, low * (1 + 5 * near)), prior.low),
        (high, samples > high * (1 - near), prior.high),
    ):
        if np.mean(leaning) > share:
            who = "of the prior" if limit == given else "of the sampler"
            lines.append(
                f"warning        {100 * np.mean(leaning):.2g} % of the samples lie next to H0 = {limit:g}, a limit {who}: the result "
                "depends on where it is"
            )
    return lines


def _fixed(peculiar):
    return " (fixed: in the weights alone)" if peculiar[0].isdigit() else " (free: the scatter bears on σ_pec H0)"
