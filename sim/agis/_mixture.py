"""Quasars, galaxies and stars that one mission sees."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.mission import Mission
from sim.population import Population
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, BoolArray, FloatArray, IntArray

KINDS = ("quasars", "galaxies", "stars")


@dataclass(frozen=True, eq=False)
class Mixture(Frozen):
    """Sources of several kinds, one after the other: quasars first.

    Attributes
    ----------
    lon, lat : (n,) arrays
        Positions. [rad]
    sigma : (n,) array
        Errors of a transit along the scan. [µas]
    magnitude, redshift : (n,) arrays
        nan where unknown.
    kind : (n,) int array
        Index into KINDS.
    """

    lon: FloatArray
    lat: FloatArray
    sigma: FloatArray
    magnitude: FloatArray
    redshift: FloatArray
    kind: IntArray

    def __len__(self) -> int:
        return len(self.lon)

    def are(self, kind: str) -> BoolArray:
        """Which sources are of a kind, (n,).

        Parameters
        ----------
        kind : {"quasars", "galaxies", "stars"}
            Which.
        """
        return self.kind == KINDS.index(arguments.choice("kind", kind, KINDS))


@arguments.accepts(mission=arguments.a(Mission), quasars=arguments.a(Population))
def mixture(
    mission: Mission, quasars: Population, galaxies: Population | None = None, stars: Population | None = None, *,
    excess_noise: ArrayLike = 0.0, star_error: float | None = None,
) -> Mixture:  # fmt: skip
    """The sources of a mission with the errors of their transits.

    Parameters
    ----------
    mission : Mission
        Whose errors, by magnitude.
    quasars, galaxies, stars : Population
        In the mission's frame, with magnitudes.
    excess_noise : float or array
        Of galaxies that are no points. [µas]
    star_error : float, optional
        Of a star's transit; by magnitude unless given. What holds the attitude is the weight Σ 1/σ², not the number. [µas]

    Raises
    ------
    ParameterError
        If one has no magnitudes.
    FrameError
        If one is in another frame.
    """
    columns: dict[str, list] = {name: [] for name in ("lon", "lat", "sigma", "magnitude", "redshift", "kind")}
    for index, population in enumerate((quasars, galaxies, stars)):
        if population is None:
            continue
        mission.check_frame(population.frame)
        n = len(population)
        if population.magnitude is None:
            raise ParameterError(f"errors of transits go by magnitude, and the {KINDS[index]} have none")
        sigma = mission.transit_error(population.magnitude, excess_noise if KINDS[index] == "galaxies" else 0.0)
        if KINDS[index] == "stars" and star_error is not None:
            sigma = np.full(n, arguments.positive("star_error", star_error))
        unknown = np.full(n, np.nan)
        redshift = unknown if population.redshift is None else population.redshift
        for name, column in zip(columns, (population.lon, population.lat, sigma, population.magnitude, redshift, np.full(n, index)), strict=True):  # fmt: skip
            columns[name].append(column)
    joined = {name: np.concatenate(parts) for name, parts in columns.items()}
    arguments.float_array("sigma", joined["sigma"])
    return Mixture(**joined)
