"""What a joint solution takes: known before the work begins."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from sim.scanning import NominalScanningLaw
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import GIB, free_memory
from vsh.tools.types import ArrayLike
from vsh.tools.units import JULIAN_YEAR

#: Parts that the transits are cut into for threads: fixed, so that their number changes no bit of a sum.
PARTS = 8
#: Bytes: of a transit while transits are sorted and afterwards; of a source; of a source and right-hand side; of a coefficient.
_SORTING, _TRANSIT, _SOURCE, _COLUMN, _COEFFICIENT = 60, 64, 1440, 40 * (PARTS + 8), 3 * (12 + 5) * 8
#: Bytes of a transit as it is kept.
_KEPT = 28
#: And of the libraries. [bytes]
_BASE = 3e8
#: CPU seconds (of a 2 GHz server core): of a million transits to follow, and for an iteration; of a million coefficients to solve for.
_FOLLOW, _ITERATE, _SOLVE = 4.0, 0.085, 0.3
#: Sources whose transits are counted for the estimate.
_SAMPLE = 300


@dataclass(frozen=True)
class Plan(InNotebook):
    """What a joint solution would take."""

    transits: float
    coefficients: float
    memory: float
    setup_seconds: float
    iteration_seconds: float

    @property
    def memory_on_disk(self) -> float:
        """The same where transits are kept on disk and mapped. [bytes]"""
        return self.memory - _KEPT * self.transits

    def __str__(self) -> str:
        return (
            f"{self.transits / 1e6:.1f} million transits, {3 * self.coefficients / 1e6:.1f} million coefficients of the attitude: "
            f"{self.memory / GIB:.1f} GiB, {self.setup_seconds / 60:.1f} CPU minutes before the first iteration, "
            f"{self.iteration_seconds:.1f} CPU seconds for each"
        )


@arguments.accepts(
    law=arguments.a(NominalScanningLaw),
    lon=arguments.dimension(1),
    lat=arguments.dimension(1),
    knots=arguments.positive,
)
def plan(law: NominalScanningLaw, lon: ArrayLike, lat: ArrayLike, knots: float = 30.0, *, ccds: int = 1) -> Plan:
    """What the joint solution of some sources would take.

    Parameters
    ----------
    law : NominalScanningLaw
        The scanning law.
    lon, lat : (n,) arrays
        Positions in its frame. [rad]
    knots : float
        Time between knots. [s]
    ccds : {1, 9}
        Observations in a transit.

    Returns
    -------
    Plan
        From constants measured on one machine; good to a factor of two on others.

    Raises
    ------
    ParameterError
        If there are no sources, or positions do not match.
    """
    lon = arguments.float_array("lon", lon)
    arguments.float_array("lat", lat, lon.shape)
    if not len(lon):
        raise ParameterError("a plan needs a source at least")
    arguments.choice("ccds", ccds, (1, 9))
    n, k = np.size(lon), expected_transits(law, lon, lat) * ccds
    coefficients = law.years * JULIAN_YEAR / knots + 3
    memory = _BASE + max(_SORTING * k, system_memory(n, coefficients, 1) + _TRANSIT * k)
    setup = (_FOLLOW / ccds + 5 * _ITERATE) * k / 1e6 + _SOLVE * coefficients / 1e6
    return Plan(k, coefficients, memory, setup, _ITERATE * k / 1e6 + _SOLVE * coefficients / 1e6)


def expected_transits(law: NominalScanningLaw, lon: ArrayLike, lat: ArrayLike) -> float:
    """About how many transits some sources will have: those of a sample, times their number."""
    lon, lat = np.asarray(lon), np.asarray(lat)
    some = np.linspace(0, len(lon) - 1, min(_SAMPLE, len(lon))).astype(int)
    return 1.02 * len(law.transits(lon[some], lat[some])) * len(lon) / len(some)


def system_memory(n_sources: int, coefficients: float, columns: int) -> float:
    """Bytes of the normal equations, without the transits."""
    return n_sources * (_SOURCE + _COLUMN * columns) + coefficients * (_COEFFICIENT + 72 * (columns - 1))


def check_memory(needed: float, what: str, remedy: str) -> None:
    """Raise ParameterError if there is not as much memory."""
    free = free_memory()
    if needed > free:
        raise ParameterError(f"{what} would need {needed / GIB:.1f} GiB, and {free / GIB:.1f} GiB are free: {remedy}")


#: Half of the height that a field may have. [rad]
_WIDEST = 0.5
#: Quasars of the paper, at whose number nothing is scaled.
FULL = 500_000


def scaled(n: int, law: NominalScanningLaw | None = None, *, knots: float = 30.0, full: int = FULL) -> tuple[NominalScanningLaw, float]:  # fmt: skip
    """A scanning law and knots with which n sources are seen as `full` ones are by the whole mission.

    As many sources in a field, observations in an interval and transits of a source: with s = n/full the fields are
    1/√s as wide and the satellite turns √s as fast, so that knots are 1/s as far apart.

    Examples
    --------
    >>> law, knots = scaled(5000)
    >>> round(law.spin_rate, 9), round(knots, 9)
    (6.0, 3000.0)
    """
    share = arguments.whole("n", n) / arguments.whole("full", full)
    law = NominalScanningLaw() if law is None else arguments.a(NominalScanningLaw)("law", law)
    root = share**0.5
    if law.half_height / root > _WIDEST:
        least = int(np.ceil(full * (law.half_height / _WIDEST) ** 2))
        raise ParameterError(
            f"{n} sources are too few to stand for {full}: a field would be {np.degrees(2 * law.half_height / root):.0f}° high. "
            f"Take {least} or more, or scale nothing"
        )
    # Gaps that were drawn are kept as they are.
    kept = {"dead_time": 0.0, "rng": None, "gaps": tuple(map(tuple, law.lost))}
    wide = replace(law, half_height=law.half_height / root, spin_rate=law.spin_rate * root, **kept)
    return wide, arguments.positive("knots", knots) / share
