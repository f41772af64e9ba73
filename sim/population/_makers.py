"""Quasars and galaxies with the distributions that Gaia sees."""

from __future__ import annotations

import numpy as np

from sim.population._draws import plane_avoiding_sky, quasar_magnitudes, quasar_redshifts, uniform_sky
from sim.population._population import Population
from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.types import FloatArray, Rng
from vsh.errors import ParameterError

#: Magnitudes, and millions of stars that are brighter, over the whole sky.
STAR_COUNTS = (10.0, 15.0, 18.0, 20.0), (0.34, 26.0, 250.0, 1000.0)


@arguments.accepts(n=arguments.whole, rng=arguments.seed, max_magnitude=arguments.number)
def quasars(
    n: int, rng: Rng, sky: str | FloatArray = "uniform", *, max_magnitude: float = 20.0, map_frame: str = "icrs"
) -> Population:
    """n quasars with Gaia's distribution of magnitudes.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    sky : {"uniform", "plane-avoiding", "gums", "igql"} or (12 nside²,) array
        A name, or a HEALPix map of their density in ring order (a selection function).
    max_magnitude : float
        The faintest G, at most 21.
    map_frame : str
        Of the axes of a map that is given.

    Returns
    -------
    Population
        In ICRS.

    Raises
    ------
    ParameterError
        If n is not positive, the sky unknown or the map no map.
    """
    rng = generator(rng)
    lon, lat = _positions(n, rng, sky, map_frame)
    # Redshifts from a stream of their own: they shift nothing that is drawn later.
    return Population(lon, lat, quasar_magnitudes(n, rng, max_magnitude), quasar_redshifts(n, rng.spawn(1)[0]))


@arguments.accepts(quasars=arguments.a(Population), n=arguments.whole, rng=arguments.seed)
def vlbi_quasars(quasars: Population, n: int, rng: Rng) -> Population:
    """n of the quasars, at random: those whose positions VLBI knows (the paper has 3300 of 500 000).

    Parameters
    ----------
    quasars : Population
        From which to choose.
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.

    Raises
    ------
    ParameterError
        If there are fewer than n.
    """
    if not 0 < n <= len(quasars):
        raise ParameterError(f"{n} of {len(quasars)} quasars cannot be chosen")
    return quasars[np.sort(generator(rng).choice(len(quasars), n, replace=False))]


@arguments.accepts(
    n=arguments.whole,
    rng=arguments.seed,
    min_redshift=arguments.positive,
    max_redshift=arguments.positive,
    max_magnitude=arguments.number,
    absolute=arguments.number,
    spread=arguments.positive,
)
def galaxies(
    n: int,
    rng: Rng,
    sky: str | FloatArray = "uniform",
    *,
    min_redshift: float = 0.001,
    max_redshift: float = 0.03,
    max_magnitude: float = 20.0,
    absolute: float = -18.0,
    spread: float = 1.5,
    map_frame: str = "icrs",
) -> Population:
    """n galaxies, evenly in the volume between two redshifts, as far as they are bright enough.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    sky
        As for `quasars`.
    min_redshift, max_redshift : float
        Redshifts.
    max_magnitude : float
        The completeness limit, G.
    absolute, spread : float
        Mean and standard deviation of the absolute magnitudes; with these the
        counts peak at G ≈ 17, as those of the paper's galaxies do.
    map_frame : str
        Of the axes of a map that is given.

    Returns
    -------
    Population
        In ICRS.

    Raises
    ------
    ParameterError
        If redshifts do not rise from above zero, or the sky is unknown.
    """
    from vsh.cosmology import distance_modulus, transverse_distance

    if not 0 < min_redshift < max_redshift:
        raise ParameterError(f"redshifts must rise from above zero, not from {min_redshift} to {max_redshift}")
    rng = generator(rng)
    lon, lat = _positions(n, rng, sky, map_frame)
    grid = np.linspace(min_redshift, max_redshift, 2000)
    distance = transverse_distance(grid)
    redshift, magnitude = np.empty(0), np.empty(0)
    while len(redshift) < n:
        cube = rng.uniform(distance[0] ** 3, distance[-1] ** 3, n)
        z = np.interp(np.cbrt(cube), distance, grid)
        modulus = distance_modulus(np.cbrt(cube), z)
        g = modulus + rng.normal(absolute, spread, n)
        redshift, magnitude = np.r_[redshift, z[g < max_magnitude]], np.r_[magnitude, g[g < max_magnitude]]
    return Population(lon, lat, magnitude[:n], redshift[:n])


@arguments.accepts(
    n=arguments.whole, rng=arguments.seed, min_magnitude=arguments.number, max_magnitude=arguments.number
)
def stars(
    n: int,
    rng: Rng,
    sky: str | FloatArray = "uniform",
    *,
    min_magnitude: float = 12.0,
    max_magnitude: float = 20.0,
    map_frame: str = "icrs",
) -> Population:
    """n stars with the counts by magnitude of the whole sky: what holds the attitude of a real mission.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    sky
        As for `quasars`.
    min_magnitude, max_magnitude : float
        G, from 10 to 20.
    map_frame : str
        Of the axes of a map that is given.

    Returns
    -------
    Population
        In ICRS.

    Raises
    ------
    ParameterError
        If magnitudes do not rise from 10 to 20 at most, or the sky is unknown.

    Notes
    -----
    0.34, 26, 250 and 1000 million stars are brighter than 10, 15, 18 and 20 (Perryman et al. 2001, A&A 369, 339, table 1);
    in between the logarithm of the counts is taken for linear.
    """
    if not STAR_COUNTS[0][0] <= min_magnitude < max_magnitude <= STAR_COUNTS[0][-1]:
        raise ParameterError(
            f"magnitudes of stars rise between 10 and 20, not from {min_magnitude:g} to {max_magnitude:g}"
        )
    rng = generator(rng)
    lon, lat = _positions(n, rng, sky, map_frame)
    magnitudes, counts = STAR_COUNTS[0], np.log(STAR_COUNTS[1])
    low, high = np.exp(np.interp((min_magnitude, max_magnitude), magnitudes, counts))
    return Population(lon, lat, np.interp(np.log(rng.uniform(low, high, n)), counts, magnitudes))


def _positions(n, rng, sky, map_frame):
    if n < 1:
        raise ParameterError(f"a population has at least one member, not {n}")
    exact = {"uniform": uniform_sky, "plane-avoiding": plane_avoiding_sky}
    if not isinstance(sky, (str, np.ndarray)):
        raise ParameterError(f"a sky is a name or a HEALPix map, not {type(sky).__name__}")
    if isinstance(sky, str) and sky in exact:
        return exact[sky](n, rng)
    from sim.skies import draw_positions  # healpy, for maps alone

    return draw_positions(n, rng, sky, map_frame)
