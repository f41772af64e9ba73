"""Sources: where they are, how bright, how far."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from vsh.models.cosmology import FLAT_PLANCK13, compute_redshift, distance_modulus, hubble_value, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, VelocityGrid, compute_linear_velocities, make_wave_vectors
from vsh.sky.frames import check_frame, rotation_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.bad_rows import as_floats_and_mask
from vsh.tools.errors import FieldError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import FloatArray, Rng


@dataclass(frozen=True, eq=False)
class Population(Frozen):
    """Sources as they are, before anybody observes them.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions [rad]
    magnitude : (n,) array or None
        G.
    redshift : (n,) array or None
    frame : str
        Axes of the positions.

    Examples
    --------
    >>> len(quasars(5, 1))
    5
    """

    lon: FloatArray
    lat: FloatArray
    magnitude: FloatArray | None = None
    redshift: FloatArray | None = None
    frame: str = "icrs"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        for name in ("lon", "lat", "magnitude", "redshift"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.array(as_floats_and_mask(name, getattr(self, name))[0]))
        for name, limit in (("lat", np.pi / 2), ("lon", 4 * np.pi)):
            column = getattr(self, name)
            if column is not None and np.size(column) and np.nanmax(np.abs(column)) > limit * (1 + 1e-12):
                raise FieldError(
                    f"{name} is in radians: {np.nanmax(np.abs(column)):.6g} is too much (np.radians turns degrees)"
                )
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.lon)

    def __getitem__(self, selection: Any):
        """The sources picked by a mask, a slice or indices."""
        return replace(self, **{name: v[selection] for name, v in vars(self).items() if isinstance(v, np.ndarray)})


#: Quasars in Gaia's frame brighter than each magnitude (Gaia DR3, five-parameter solutions).
_BRIGHTER_THAN = {18.0: 29_200, 19.0: 175_814, 20.0: 665_975, 21.0: 1_215_942}
#: Sources with five and with six parameters.
CRF3_COUNTS = {31: 1_215_942, 95: 398_231}
#: By how much errors with six parameters are larger than those with five at one magnitude.
SIX_PARAMETERS = 1.25


@arguments.accepts(n=arguments.whole, rng=arguments.seed)
def uniform_sky(n: int, rng: Rng) -> tuple[FloatArray, FloatArray]:
    """n positions, uniform over the sphere: longitude and latitude. [rad]

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.

    Examples
    --------
    >>> lon, lat = uniform_sky(1000, rng=1)
    >>> lon.shape, bool(abs(np.sin(lat).mean()) < 0.1)
    ((1000,), True)
    """
    rng = generator(rng)
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))


@arguments.accepts(n=arguments.whole, rng=arguments.seed)
def plane_avoiding_sky(n: int, rng: Rng, latitude: float = 15.0) -> tuple[FloatArray, FloatArray]:
    """n positions in ICRS, uniform over the sphere but for the Galactic plane, |b| < `latitude` degrees. [rad]

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    latitude : float
        Below which there are none. [deg]

    Examples
    --------
    >>> lon, lat = plane_avoiding_sky(1000, 1)
    >>> lon.shape
    (1000,)
    """
    rng = generator(rng)
    l = rng.uniform(0, 2 * np.pi, n)
    b = np.arcsin(rng.uniform(np.sin(np.radians(latitude)), 1, n)) * rng.choice([-1, 1], n)
    return angles(rotation_matrix("galactic", "icrs") @ triad(l, b)[2])


def draw_quasar_magnitudes(n: int, rng: Rng, max_magnitude: float = 20.0) -> FloatArray:
    """n magnitudes G with the number counts of Gaia's quasars, log-linear between the published ones.

    Brighter than G = 18 the first slope is continued.
    """
    if not 18 < max_magnitude <= 21:
        raise ParameterError(f"the counts are known for 18 < G ≤ 21, not to {max_magnitude}")
    magnitude, log_count = np.array(list(_BRIGHTER_THAN)), np.log10(list(_BRIGHTER_THAN.values()))
    first_slope = log_count[1] - log_count[0]
    magnitude, log_count = np.insert(magnitude, 0, 12.0), np.insert(log_count, 0, log_count[0] - 6 * first_slope)
    log_limit = np.interp(max_magnitude, magnitude, log_count)
    log_draws = log_limit + np.log10(1 - generator(rng).uniform(0, 1, n))
    return np.interp(log_draws, log_count, magnitude)


def draw_crf3_magnitudes(n_five: int, n_six: int, rng: Rng) -> FloatArray:
    """Magnitudes G like those of Gaia-CRF3: of sources with five parameters, then of those with six."""
    rng = generator(rng)
    return np.concatenate([draw_quasar_magnitudes(n_five, rng, 21.0), 21 - rng.gamma(2.0, 0.32, n_six)])


def quasar_redshifts(n: int, rng: Rng) -> FloatArray:
    """n redshifts from a gamma distribution of mean 1.5, about that of Gaia's and SDSS' quasars; at least 0.05."""
    return np.maximum(generator(rng).gamma(2.7, 0.55, n), 0.05)


#: Spearman's rank correlation of redshift and magnitude among the 77 429 quasars of SDSS DR5 (Schneider et al. 2007, AJ
#: 134, 102, i): bright ones are nearer.
REDSHIFT_BY_MAGNITUDE = 0.243


def assign_redshifts(redshift: FloatArray, magnitude: FloatArray, rng: Rng) -> FloatArray:
    """Assign the redshifts so that their ranks follow those of the magnitudes as they do in SDSS."""
    rho = 2 * np.sin(np.pi * REDSHIFT_BY_MAGNITUDE / 6)  # Pearson's, of normal numbers with these ranks
    ranks = np.argsort(np.argsort(magnitude, kind="stable"), kind="stable")
    score = rho * ndtri((ranks + 0.5) / len(ranks)) + np.sqrt(1 - rho**2) * generator(rng).standard_normal(len(ranks))
    ranked_redshift = np.empty_like(redshift)
    ranked_redshift[np.argsort(score, kind="stable")] = np.sort(redshift)
    return ranked_redshift


#: Magnitudes, and millions of stars that are brighter, over the whole sky.
STAR_COUNTS = (10.0, 15.0, 18.0, 20.0), (0.34, 26.0, 250.0, 1000.0)


@arguments.accepts(n=arguments.whole, rng=arguments.seed, max_magnitude=arguments.number)
def quasars(
    n: int, rng: Rng = 1, sky: str | FloatArray = "uniform", *, max_magnitude: float = 20.0, map_frame: str = "icrs"
) -> Population:
    """Draw n quasars with Gaia's magnitude distribution; bright ones are nearer, as in SDSS (`REDSHIFT_BY_MAGNITUDE`).

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    sky : {"uniform", "plane-avoiding", "gums", "igql"} or (12 nside²,) array
        Name of a sky, or a HEALPix map of the density of quasars in ring order (a selection function).
    max_magnitude : float
        Faintest magnitude G, above 18 and at most 21.
    map_frame : str
        Frame of the map, if `sky` is a map.

    Returns
    -------
    Population
        In ICRS.

    Examples
    --------
    >>> sky = quasars(1000, 1)
    >>> len(sky), bool((sky.magnitude < 21).all())
    (1000, True)
    """
    rng = generator(rng)
    lon, lat = _draw_positions(n, rng, sky, map_frame)
    # Redshifts from streams of their own: they shift nothing that is drawn later.
    redshift_rng, rank_rng = rng.spawn(2)
    magnitude = draw_quasar_magnitudes(n, rng, max_magnitude)
    return Population(lon, lat, magnitude, assign_redshifts(quasar_redshifts(n, redshift_rng), magnitude, rank_rng))


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

    Examples
    --------
    >>> bright = vlbi_quasars(quasars(2000, 1), 100, 2)
    >>> len(bright)
    100
    """
    if not 0 < n <= len(quasars):
        raise ParameterError(f"{n} quasars cannot be chosen from {len(quasars)}")
    return quasars[np.sort(generator(rng).choice(len(quasars), n, replace=False))]


#: The galaxies' lowest redshift, the faintest G, and mean and scatter of the absolute magnitudes.
_MIN_REDSHIFT, _MAX_MAGNITUDE, _ABSOLUTE_MAGNITUDE, _SPREAD = 0.001, 20.0, -18.0, 1.5


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
    rng: Rng = 1,
    sky: str | FloatArray = "uniform",
    *,
    min_redshift: float = _MIN_REDSHIFT,
    max_redshift: float = 0.03,
    max_magnitude: float = _MAX_MAGNITUDE,
    absolute: float = _ABSOLUTE_MAGNITUDE,
    spread: float = _SPREAD,
    map_frame: str = "icrs",
) -> Population:
    """Draw n galaxies brighter than a limit, from a population uniform in volume between two redshifts.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    sky
        As for `quasars`.
    min_redshift, max_redshift : float
        Lowest and highest redshift.
    max_magnitude : float
        Faintest apparent magnitude G, to which the catalogue is complete.
    absolute, spread : float
        Mean and standard deviation of the absolute magnitudes. With the
        defaults the counts peak at G ≈ 17, as do those of Bachchan et al. (2016).
    map_frame : str
        Frame of the map, if `sky` is a map.

    Returns
    -------
    Population
        In ICRS.

    Raises
    ------
    ParameterError
        If the redshifts do not satisfy 0 < min_redshift < max_redshift, or the sky is unknown.

    Examples
    --------
    >>> sky = galaxies(1000, 1, max_redshift=0.02)
    >>> bool((sky.redshift < 0.02).all())
    True
    """
    if not 0 < min_redshift < max_redshift:
        raise ParameterError(f"redshifts must rise from above zero, not from {min_redshift} to {max_redshift}")
    rng = generator(rng)
    lon, lat = _draw_positions(n, rng, sky, map_frame)
    redshift_grid = np.linspace(min_redshift, max_redshift, 2000)
    distance_grid = transverse_distance(redshift_grid)
    redshift, magnitude = np.empty(0), np.empty(0)
    while len(redshift) < n:
        cubed_distance = rng.uniform(distance_grid[0] ** 3, distance_grid[-1] ** 3, n)
        z = np.interp(np.cbrt(cubed_distance), distance_grid, redshift_grid)
        g = distance_modulus(np.cbrt(cubed_distance), z) + rng.normal(absolute, spread, n)
        redshift, magnitude = np.r_[redshift, z[g < max_magnitude]], np.r_[magnitude, g[g < max_magnitude]]
    return Population(lon, lat, magnitude[:n], redshift[:n])


def magnitudes_at(redshift: FloatArray, rng: Rng) -> FloatArray:
    """Magnitudes G of `galaxies` to G = 20 that are seen at given redshifts, (n,): the farther, the fainter.

    Parameters
    ----------
    redshift : (n,) array
        Above zero.
    rng : Generator or int
        The source of all randomness.
    """
    redshift = np.asarray(redshift, float)
    mean_magnitude = distance_modulus(transverse_distance(redshift), redshift) + _ABSOLUTE_MAGNITUDE
    fraction = ndtr((_MAX_MAGNITUDE - mean_magnitude) / _SPREAD)
    return mean_magnitude + _SPREAD * ndtri(np.maximum(generator(rng).uniform(size=redshift.shape) * fraction, 1e-300))


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
        Frame of the map, if `sky` is a map.

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
    0.34, 26, 250 and 1000 million stars are brighter than 10, 15, 18 and 20 (Perryman et al. 2001, A&A 369, 339, table
    1); in between the logarithm of the counts is taken as linear.

    Examples
    --------
    >>> sky = stars(1000, 1)
    >>> float(sky.magnitude.min()) >= 12.0
    True
    """
    if not STAR_COUNTS[0][0] <= min_magnitude < max_magnitude <= STAR_COUNTS[0][-1]:
        raise ParameterError(f"star magnitudes rise between 10 and 20, not from {min_magnitude:g} to {max_magnitude:g}")
    rng = generator(rng)
    lon, lat = _draw_positions(n, rng, sky, map_frame)
    magnitudes, counts = STAR_COUNTS[0], np.log(STAR_COUNTS[1])
    lower, upper = np.exp(np.interp((min_magnitude, max_magnitude), magnitudes, counts))
    return Population(lon, lat, np.interp(np.log(rng.uniform(lower, upper, n)), counts, magnitudes))


def _draw_positions(n, rng, sky, map_frame):
    if n < 1:
        raise ParameterError(f"a population has at least one member, not {n}")
    named_skies = {"uniform": uniform_sky, "plane-avoiding": plane_avoiding_sky}
    if not isinstance(sky, (str, np.ndarray)):
        raise ParameterError(f"a sky is a name or a HEALPix map, not {type(sky).__name__}")
    if isinstance(sky, str) and sky in named_skies:
        return named_skies[sky](n, rng)
    from sim.skies import draw_positions

    return draw_positions(n, rng, sky, map_frame)


@arguments.accepts(n=arguments.whole, rng=arguments.seed, size=arguments.whole)
def clustered_galaxies(
    n: int, rng: Rng, *, max_redshift: float = 0.03, size: int = 160
) -> tuple[Population, VelocityGrid]:
    """n galaxies whose density is log-normal in the matter of linear theory, and the velocities of that matter.

    The second goes to `sim.peculiar(…, flow=grid)`: galaxies and flow are then of one universe.

    Parameters
    ----------
    n : int
        How many.
    rng : Generator or int
        The source of all randomness.
    max_redshift : float
        As for `galaxies`, from redshift 0.001 on.
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
        If the redshift is not between 0.001 and 10.

    Examples
    --------
    >>> sky, flow = clustered_galaxies(200, 1, size=40)
    >>> len(sky)
    200
    """
    rng, max_redshift = generator(rng), arguments.between("max_redshift", max_redshift, _MIN_REDSHIFT, 10.0)
    h = hubble_value(FLAT_PLANCK13) / 100
    min_distance, max_distance = transverse_distance(np.array([_MIN_REDSHIFT, max_redshift])) * h
    half_width = 1.6 * max_distance
    density, velocity = _draw_density_and_velocity(rng, size, half_width)
    # Waves longer than the box carry galaxies along without clustering them.
    _, large_velocity = _draw_density_and_velocity(rng, 48, 8 * half_width, np.pi / half_width / 2)
    axis_points = np.linspace(-half_width, half_width, size, endpoint=False) + half_width / size
    cells = np.stack(np.meshgrid(axis_points, axis_points, axis_points, indexing="ij")).reshape(3, -1)
    coarse_grid = VelocityGrid(large_velocity, 8 * half_width * (1 - 1 / 48), "icrs")
    lon, lat = angles(cells)
    velocity = velocity.reshape(3, -1) + coarse_grid.at(lon, lat, np.linalg.norm(cells, axis=0), "icrs")[0]
    grid = VelocityGrid(velocity.reshape(3, size, size, size), half_width * (1 - 1 / size), "icrs")
    weights = np.exp(density.ravel() - density.var() / 2)
    cumulative = np.cumsum(np.where(np.linalg.norm(cells, axis=0) < max_distance + 2 * half_width / size, weights, 0.0))
    columns: list[list[np.ndarray]] = [[], [], [], []]
    while sum(map(len, columns[0])) < n:
        cell_numbers = np.searchsorted(cumulative, rng.uniform(0, cumulative[-1], 2 * n))
        positions = cells[:, cell_numbers] + rng.uniform(-half_width / size, half_width / size, (3, 2 * n))
        r = np.linalg.norm(positions, axis=0)
        z = compute_redshift(r / h)
        g = distance_modulus(r / h, z) + rng.normal(_ABSOLUTE_MAGNITUDE, _SPREAD, 2 * n)
        is_visible = (r > min_distance) & (r < max_distance) & (g < _MAX_MAGNITUDE)
        for chunks, candidates in zip(columns, (*angles(positions), g, z), strict=True):
            chunks.append(candidates[is_visible])
    lon, lat, magnitude, redshift = (np.concatenate(column)[:n] for column in columns)
    return Population(lon, lat, magnitude, redshift), grid


def _draw_density_and_velocity(rng, size, half_width, max_wavenumber=np.inf):
    """Density contrast and velocity on a periodic grid, of the waves below a wave number along every axis."""
    cell_size = 2 * half_width / size
    k = make_wave_vectors(size, cell_size)
    wavenumber = np.sqrt(np.sum(k**2, 0))
    wavenumber[0, 0, 0] = 1.0
    power = np.where(np.abs(k).max(0) < max_wavenumber, LINEAR_PLANCK18.power_at(wavenumber), 0.0)
    power[0, 0, 0] = 0.0
    amplitudes = np.fft.rfftn(rng.standard_normal((size, size, size))) * np.sqrt(power / cell_size**3)
    density = np.fft.irfftn(amplitudes, (size,) * 3, axes=(0, 1, 2))
    return density, compute_linear_velocities(amplitudes, k, LINEAR_PLANCK18.growth_rate)
