"""What a mission measures, and with which errors its solution begins."""

from __future__ import annotations

import numpy as np

from sim.agis.passes import Scans
from sim.variability import Variability, markov_chain
from vsh.basis import harmonics
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import FloatArray, Rng


@arguments.accepts(scans=arguments.a(Scans), rng=arguments.seed)
def observations(
    scans: Scans, rng: Rng, *, variability: Variability | None = None, variable: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Observations less what the true parameters make of them: noise, and photocentres that vary.

    Parameters
    ----------
    scans : Scans
        The transits.
    rng : Generator or int
        The source of all randomness.
    variability : Variability, optional
        Of the photocentres, at every transit.
    variable : (n,) bool array, optional
        Which sources vary; all unless given.

    Returns
    -------
    along, across : (k,) arrays
        Zero across where nothing is measured. [µas]
    """
    noise, chains = generator(rng).spawn(2)
    with np.errstate(divide="ignore"):
        sigma = 1 / np.sqrt(scans.weights)
    sigma[~np.isfinite(sigma)] = 0.0
    along, across = (noise.standard_normal(len(scans)) for _ in range(2))
    along *= sigma[0, scans.source]
    across *= sigma[1, scans.source]
    if variability is not None and variability.sigma > 0:
        order = np.argsort(scans.source, kind="stable")  # of a source, in the order of time
        if variable is not None:
            order = order[np.asarray(variable, bool)[scans.source[order]]]
        owner, times = scans.source[order], scans.time()[order]
        east, north = (markov_chain(times, variability.sigma, variability.tau, chains, owner) for _ in range(2))
        sin, cos = (column[order].astype(float) for column in (scans.sin, scans.cos))
        along[order] += sin * east + cos * north
        across[order] += sin * north - cos * east
    return along, across


@arguments.accepts(
    scans=arguments.a(Scans), rng=arguments.seed, random=arguments.not_negative, systematic=arguments.not_negative, attitude=arguments.not_negative
)  # fmt: skip
def start_errors(
    scans: Scans, rng: Rng, *, random: float = 1e5, systematic: float = 1e4, attitude: float = 10.0
) -> tuple[FloatArray, FloatArray]:
    """With which errors a solution begins; those of Bachchan, Hobbs & Lindegren (2016, section 4) unless given."""
    rng = generator(rng)
    start = random * rng.standard_normal((scans.n_sources, 5))
    fields = harmonics(scans.lon, scans.lat, 3)
    for columns in (slice(0, 2), slice(3, 5)):
        field = np.tensordot(rng.standard_normal(len(fields)), fields, 1)
        start[:, columns] += systematic * (field / np.sqrt(np.mean(np.sum(field**2, 0)))).T
    return start, attitude * rng.standard_normal((scans.intervals + 3, 3))
