"""Sources: where they are, how bright, how far."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from vsh.checks import arguments
from vsh.checks.arguments import generator
from vsh.checks.frozen import Frozen
from vsh.checks.validation import as_floats
from vsh.errors import FieldError, ParameterError, TableError
from vsh.sky.frames import check_frame
from vsh.sky.sphere import angles, triad
from vsh.types import FloatArray, Rng

#: Quasars in Gaia's frame brighter than each magnitude (Gaia DR3, five-parameter solutions).
_BRIGHTER_THAN = {18.0: 29_200, 19.0: 175_814, 20.0: 665_975, 21.0: 1_215_942}


@dataclass(frozen=True, eq=False)
class Population(Frozen):
    """Sources as they are, before anybody observes them.

    Attributes
    ----------
    lon, lat : (n,) arrays — positions [rad]
    magnitude : (n,) array or None — G
    redshift : (n,) array or None
    frame : str — of the positions
    """

    lon: np.ndarray
    lat: np.ndarray
    magnitude: np.ndarray = None
    redshift: np.ndarray = None
    frame: str = "icrs"

    def __post_init__(self) -> None:
        check_frame(self.frame)
        for name in ("lon", "lat", "magnitude", "redshift"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, np.array(as_floats(name, getattr(self, name))[0]))
        super().__post_init__()

    def __len__(self) -> int:
        return len(self.lon)

    def __getitem__(self, keep: Any):
        """The sources picked by a mask, a slice or indices."""
        columns = {f.name: getattr(self, f.name) for f in fields(self)}
        return Population(**{k: v[keep] if isinstance(v, np.ndarray) else v for k, v in columns.items()})


@arguments.accepts(n=arguments.whole, rng=arguments.seed)
def uniform_sky(n: int, rng: Rng) -> tuple[FloatArray, FloatArray]:
    """n positions, uniform over the sphere: longitude and latitude. [rad]

    >>> lon, lat = uniform_sky(1000, rng=1)
    >>> lon.shape, bool(abs(np.sin(lat).mean()) < 0.1)
    ((1000,), True)
    """
    rng = generator(rng)
    return rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))


def plane_avoiding_sky(n: int, rng: Rng, latitude: float = 15.0) -> tuple[FloatArray, FloatArray]:
    """n positions in ICRS, uniform over the sphere but for the Galactic plane, |b| < `latitude` degrees. [rad]"""
    from vsh.sky.frames import rotation_matrix

    rng = generator(rng)
    l = rng.uniform(0, 2 * np.pi, n)
    b = np.arcsin(rng.uniform(np.sin(np.radians(latitude)), 1, n)) * rng.choice([-1, 1], n)
    return tuple(angles(rotation_matrix("galactic", "icrs") @ triad(l, b)[2]))


@arguments.accepts(n=arguments.whole, rng=arguments.seed, max_magnitude=arguments.number)
def quasars(
    n: int, rng: Rng, sky: str | FloatArray = "uniform", *, max_magnitude: float = 20.0, map_frame: str = "icrs"
) -> Population:
    """n quasars with Gaia's distribution of magnitudes.

    Parameters
    ----------
    n : int
    rng : Generator or int — the source of all randomness
    sky : {"uniform", "plane-avoiding", "gums", "igql"} or (12 nside²,) array
        A name, or a HEALPix map of their density in ring order (a selection function).
    max_magnitude : float — the faintest G, at most 21
    map_frame : str — of the axes of a map that is given

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
    """n of the quasars, at random: those whose positions VLBI knows (the paper has 3300 of 500 000)."""
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
    rng : Generator or int — the source of all randomness
    sky : as for `quasars`
    min_redshift, max_redshift : float — redshifts
    max_magnitude : float — the completeness limit, G
    absolute, spread : float — mean and standard deviation of the absolute magnitudes; with these the
        counts peak at G ≈ 17, as those of the paper's galaxies do
    map_frame : str

    Returns
    -------
    Population
        In ICRS.
    """
    from vsh.cosmology import transverse_distance

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
        modulus = 5 * np.log10(np.cbrt(cube) * (1 + z)) + 25
        g = modulus + rng.normal(absolute, spread, n)
        redshift, magnitude = np.r_[redshift, z[g < max_magnitude]], np.r_[magnitude, g[g < max_magnitude]]
    return Population(lon, lat, magnitude[:n], redshift[:n])


def from_table(
    source: Any, *, ra: str = "ra", dec: str = "dec", redshift: str | None = None, magnitude: str | None = None
) -> Population:
    """The positions, and perhaps redshifts and magnitudes, of a real table.

    Parameters
    ----------
    source : path or table — whatever `vsh.tables.as_table` takes
    ra, dec, redshift, magnitude : str — names of columns; positions in degrees

    Returns
    -------
    Population
        In ICRS; a redshift or magnitude that is missing is nan.

    Raises
    ------
    TableError
        If a column is missing.
    FieldError
        If a position is missing or not on the sky, or a column holds no numbers.
    """
    from vsh import tables

    table = tables.as_table(source)
    columns = {}
    for role, name in {"ra": ra, "dec": dec, "redshift": redshift, "magnitude": magnitude}.items():
        if name is None:
            continue
        if name not in table.colnames:
            raise TableError(f"no column {name!r} for {role}. The table has {', '.join(table.colnames)}")
        values, missing = as_floats(name, np.ma.filled(np.ma.asarray(table[name]), np.nan))
        columns[role] = np.where(missing, np.nan, values)
    bad = ~(np.isfinite(columns["ra"]) & (np.abs(columns["dec"]) <= 90))
    if bad.any():
        raise FieldError(
            f"{bad.sum()} of {bad.size} positions are missing or not on the sky (first: row {bad.argmax()})"
        )
    lon, lat = np.radians(columns["ra"]), np.radians(columns["dec"])
    return Population(lon, lat, columns.get("magnitude"), columns.get("redshift"))


def quasar_magnitudes(n: int, rng: Rng, max_magnitude: float = 20.0) -> FloatArray:
    """n magnitudes G with the number counts of Gaia's quasars, log-linear between the published ones.

    Brighter than G = 18 the first slope is continued.
    """
    if not 18 < max_magnitude <= 21:
        raise ParameterError(f"the counts are known for 18 < G ≤ 21, not to {max_magnitude}")
    magnitude, log_count = np.array(list(_BRIGHTER_THAN)), np.log10(list(_BRIGHTER_THAN.values()))
    slope = log_count[1] - log_count[0]
    magnitude, log_count = np.insert(magnitude, 0, 12.0), np.insert(log_count, 0, log_count[0] - 6 * slope)
    top = np.interp(max_magnitude, magnitude, log_count)
    drawn = top + np.log10(1 - generator(rng).uniform(0, 1, n))
    return np.interp(drawn, log_count, magnitude)


def quasar_redshifts(n: int, rng: Rng, scale: float = 0.55, shape: float = 2.7) -> FloatArray:
    """n redshifts from a gamma distribution of mean 1.5, about that of Gaia's and SDSS' quasars; at least 0.05."""
    return np.maximum(generator(rng).gamma(shape, scale, n), 0.05)


def _positions(n, rng, sky, map_frame):
    from sim.skies import draw_positions  # healpy

    if n < 1:
        raise ParameterError(f"a population has at least one member, not {n}")
    exact = {"uniform": uniform_sky, "plane-avoiding": plane_avoiding_sky}
    if not isinstance(sky, (str, np.ndarray)):
        raise ParameterError(f"a sky is a name or a HEALPix map, not {type(sky).__name__}")
    if isinstance(sky, str) and sky in exact:
        return exact[sky](n, rng)
    return draw_positions(n, rng, sky, map_frame)
