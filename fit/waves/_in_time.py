"""A wave that changes during the observations: coefficients times cosine and sine of time, from every transit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from fit.quality import norm_limit
from fit.waves._map import Whitened, chance, map_of
from fit.waves._search import WaveSearch
from vsh.basis import harmonics
from vsh.checks import arguments
from vsh.checks.types import FloatArray, Rng
from vsh.epochs import Observations
from vsh.errors import DegeneracyError, ParameterError
from vsh.modes import as_modes

#: Of every search in time.
SOLVED_ATTITUDE = (
    "warning: amplitudes and limits are those of an attitude that is known from elsewhere; where it was solved from the same sky, as in "
    "Gaia's releases, 0.5 to 0.6 of a wave is left, and a 95 % limit is half of the truth"
)


@arguments.accepts(frequency=arguments.positive, nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
def search_in_time(
    observations: Observations,
    frequency: float,
    *,
    lmax: int = 5,
    nside: int = 8,
    n_skies: int = 1000,
    rng: Rng = 1,
) -> WaveSearch:
    """Look for one gravitational wave of a frequency within the mission, in positions along scan.

    Each source keeps five parameters of its own, and the frame a rotation and a glide that swing at the frequency; what is
    left is compared with a wave from every direction, its two polarisations with cosine and sine of time.

    Parameters
    ----------
    observations : Observations
        Of `vsh.epochs.read_observations`.
    frequency : float
        Of the wave. Below about one cycle in the time that they span, positions and motions of the sources take all of
        it. [1/yr]
    lmax : int
        The highest degree; a wave has 99 % of its power up to 5.
    nside : int
        Of the HEALPix map of directions.
    n_skies : int
        Simulated skies of noise, for the p-value.
    rng : Generator or int
        The source of their noise.

    Returns
    -------
    WaveSearch
        Amplitudes of the strain: plus and cross of cosine, then of sine. [µas; 1 µas is a strain of 4.8e-12]

    Raises
    ------
    DegeneracyError
        If the observations determine no wave of this frequency.
    ParameterError
        If they are no Observations, or the frequency is not above zero.

    Notes
    -----
    The response is that of a wave much shorter than the distances of the sources (Book & Flanagan 2011), and much longer
    than the time from one field of view to the other. 2F of noise is χ² with four degrees of freedom in one direction;
    the p-value is of all directions at this frequency: of several that are tried, it is to be multiplied by their number.

    Amplitudes and limits are those of an attitude that is known from elsewhere. Where the attitude was solved from the same
    sky, as in Gaia's releases, it takes a part of the wave up: of waves put into such a solution 0.49 to 0.62 of the
    amplitude is found, and the "95 %" limit is 0.50 to 0.64 of the true one. A p-value of noise stays what it is.
    """
    arguments.a(Observations)("observations", observations)
    modes = as_modes(lmax)
    if modes.lmax < 2:
        raise ParameterError("waves have degrees from 2 on: lmax of 2 or more")
    p, used = len(modes), 0
    matrix, rhs = np.zeros((2 * p, 2 * p)), np.zeros(2 * p)
    for rows, form, side, count in _sources(observations, 2 * np.pi * frequency):
        basis = harmonics(observations.lon[rows], observations.lat[rows], modes)
        # (cosine, sine) × (east, north) of each source, and of each coefficient.
        flat = basis.reshape(p, -1)
        blocks = [
            [flat @ np.einsum("nij,pjn->pin", form[:, a : a + 2, b : b + 2], basis).reshape(p, -1).T for b in (0, 2)]
            for a in (0, 2)
        ]
        matrix += np.block(blocks)
        rhs += np.concatenate([flat @ side[:, a : a + 2].T.ravel() for a in (0, 2)])
        used += count
    if used == 0:
        raise DegeneracyError("no source has more observations than five parameters of its own: none tells of waves")
    white = Whitened.of(matrix, rhs, np.tile(modes.degrees >= 2, 2))
    statistic, amplitudes, spread = map_of(white, modes, nside, copies=2)
    found = WaveSearch(
        statistic, amplitudes, norm_limit(np.sqrt(statistic) * spread, spread, 4), 1.0, n_skies, tuple(range(2, modes.lmax + 1)),
        "icrs", used, float(frequency), "µas", (*observations.notes, SOLVED_ATTITUDE),
    )  # fmt: skip
    return replace(found, p_value=chance(white, modes, nside, statistic.max(), n_skies, rng, copies=2))


def _sources(
    observations: Observations, rate: float, size: int = 2000
) -> Iterator[tuple[Any, FloatArray, FloatArray, int]]:
    """Of some sources at a time: which, and the 4 × 4 forms and sides that their five parameters leave, and how many observations."""
    n = len(observations.lon)
    bounds = np.searchsorted(observations.source, np.arange(n + 1))
    for start in range(0, n, size):
        stop = min(start + size, n)
        own = slice(bounds[start], bounds[stop])
        design, time, scan = observations.design[:, own], observations.time[own], observations.design[:2, own]
        columns = np.concatenate(
            [design, scan * np.cos(rate * time), scan * np.sin(rate * time), observations.position[own][None]]
        )
        columns = columns / observations.error[own]
        source = observations.source[own] - start
        counts = np.bincount(source, minlength=stop - start)
        sums = np.array([[np.bincount(source, x * y, stop - start) for x in columns] for y in columns]).transpose(
            2, 0, 1
        )
        five = sums[:, :5, :5]
        scale = np.sqrt(np.maximum(np.einsum("nii->ni", five), 1e-300))
        enough = counts > 5
        with np.errstate(invalid="ignore"):
            enough &= np.linalg.cond(five / scale[:, :, None] / scale[:, None, :]) < 1e10
        if not enough.any():
            continue
        some = sums[enough]
        taken = some[:, :5, 5:].transpose(0, 2, 1) @ np.linalg.solve(some[:, :5, :5], some[:, :5, 5:])
        left = some[:, 5:, 5:] - taken
        yield start + np.flatnonzero(enough), left[:, :4, :4], left[:, :4, 4], int(counts[enough].sum())
