"""Galaxies that cluster, and the flow that belongs to their clustering."""

from __future__ import annotations

import numpy as np

from sim.population._population import Population
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import Rng
from vsh.errors import ParameterError
from vsh.flows import HUBBLE, PLANCK_2018, LinearTheory, VelocityGrid
from vsh.sky.sphere import angles


@arguments.accepts(
    n=arguments.whole, rng=arguments.seed, min_redshift=arguments.positive, max_redshift=arguments.positive,
    bias=arguments.not_negative, size=arguments.whole,
)  # fmt: skip
def clustered_galaxies(
    n: int,
    rng: Rng,
    *,
    min_redshift: float = 0.001,
    max_redshift: float = 0.03,
    max_magnitude: float = 20.0,
    absolute: float = -18.0,
    spread: float = 1.5,
    bias: float = 1.0,
    theory: LinearTheory = PLANCK_2018,
    size: int = 160,
) -> tuple[Population, VelocityGrid]:
    """n galaxies whose density is log-normal in the matter of linear theory, and the velocities of that matter.

    The second goes to `sim.peculiar(…, flow=grid)`: galaxies and flow are then of one universe.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    min_redshift, max_redshift, max_magnitude, absolute, spread
        As for `galaxies`.
    bias : float
        Galaxies are bias times as clustered as matter; zero is evenly.
    theory : LinearTheory
        The power of matter.
    size : int
        Points of the grid along each axis.

    Returns
    -------
    population : Population
        In ICRS.
    grid : VelocityGrid

    Raises
    ------
    ParameterError
        If redshifts do not rise.
    """
    from vsh.cosmology import PLANCK_2013, distance_modulus, hubble_value, redshift_of, transverse_distance

    if not min_redshift < max_redshift:
        raise ParameterError(f"redshifts must rise, not from {min_redshift} to {max_redshift}")
    rng = generator(rng)
    h = hubble_value(PLANCK_2013) / 100
    near, far = transverse_distance(np.array([min_redshift, max_redshift])) * h
    half = 1.6 * far
    density, velocity = _linear(theory, rng, size, half, low=0.0)
    # Waves longer than the box carry galaxies along without clustering them.
    _, large = _linear(theory, rng, 48, 8 * half, low=0.0, high=np.pi / half / 2)
    x = np.linspace(-half, half, size, endpoint=False) + half / size
    cells = np.stack(np.meshgrid(x, x, x, indexing="ij")).reshape(3, -1)
    wide = VelocityGrid(large, 8 * half * (1 - 1 / 48), "icrs")
    lon, lat = angles(cells)
    velocity = velocity.reshape(3, -1) + wide.at(lon, lat, np.linalg.norm(cells, axis=0), "icrs")[0]
    grid = VelocityGrid(velocity.reshape(3, size, size, size), half * (1 - 1 / size), "icrs")
    chance = np.exp(bias * density.ravel() - bias**2 * density.var() / 2)
    chance = np.cumsum(np.where(np.linalg.norm(cells, axis=0) < far + 2 * half / size, chance, 0.0))
    found: list[list[np.ndarray]] = [[], [], [], []]
    while sum(map(len, found[0])) < n:
        chosen = np.searchsorted(chance, rng.uniform(0, chance[-1], 2 * n))
        place = cells[:, chosen] + rng.uniform(-half / size, half / size, (3, 2 * n))
        r = np.linalg.norm(place, axis=0)
        z = redshift_of(r / h)
        g = distance_modulus(r / h, z) + rng.normal(absolute, spread, 2 * n)
        keep = (r > near) & (r < far) & (g < max_magnitude)
        for each, values in zip(found, (*angles(place), g, z), strict=True):
            each.append(values[keep])
    lon, lat, magnitude, redshift = (np.concatenate(each)[:n] for each in found)
    return Population(lon, lat, magnitude, redshift), grid


def _linear(theory, rng, size, half, low, high=np.inf):
    """Density contrast and velocity on a periodic grid, of the waves between two wave numbers."""
    step = 2 * half / size
    waves = 2 * np.pi * np.fft.fftfreq(size, step)
    k = np.stack(np.meshgrid(waves, waves, waves[: size // 2 + 1], indexing="ij"))
    k[2] = np.abs(k[2])
    length = np.sqrt(np.sum(k**2, 0))
    length[0, 0, 0] = 1.0
    power = np.where((np.abs(k).max(0) > low) & (np.abs(k).max(0) < high), theory.power_at(length), 0.0)
    power[0, 0, 0] = 0.0
    wave = np.fft.rfftn(rng.standard_normal((size, size, size))) * np.sqrt(power / step**3)
    density = np.fft.irfftn(wave, (size,) * 3)
    pull = 1j * theory.growth_rate * HUBBLE * wave / length**2
    return density, np.stack([np.fft.irfftn(pull * each, (size,) * 3) for each in k])
