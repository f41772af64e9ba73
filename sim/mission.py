"""A mission: how the sky is scanned, and how well each transit is measured."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from sim.astrometry import KNOT_INTERVAL, RELEASES, compute_unit_transit_errors, parallax_error
from sim.scanning import NominalScanningLaw
from vsh.tools import arguments
from vsh.tools.errors import FrameError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, FloatArray, Release, Rng


@dataclass(frozen=True)
class Mission(InNotebook):
    """A scanning law with the errors of its measurements.

    Attributes
    ----------
    scanning_law : NominalScanningLaw
        Which source is seen when, and under which angle.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose parallax errors the transits are made to give, whatever the length of the mission.
    attitude : float or "solved"
        Error of the attitude in 30-second intervals, shared by all sources that are seen in one [µas]; or solved from
        the sources themselves, together with them (`sim.agis`).
    knots : float
        Time between the knots of an attitude that is solved. [s]

    Notes
    -----
    An attitude in µas is a shortcut: sources are solved one by one. It is right where something else holds the attitude
    as well as that, as Gaia's hundreds of stars a quasar do: one star of 100 µas a transit for each quasar leaves the
    errors of an acceleration at 1.03 to 1.09 of those that are quoted. Where quasars alone determine it, in knots of 30
    s, the errors of large scales are 2.3 times the quoted ones on an even sky, and 16 times on one as uneven as the
    IGQL: "solved" has them (docs/agis.md).

    Examples
    --------
    >>> mission = Mission(NominalScanningLaw(years=1.0), release="DR4")
    >>> mission.years
    1.0
    """

    scanning_law: NominalScanningLaw
    release: Release = "DR3"
    attitude: float | Literal["solved"] = 10.0
    knots: float = 30.0

    def __post_init__(self) -> None:
        arguments.a(NominalScanningLaw)("scanning_law", self.scanning_law)
        if self.release not in RELEASES:
            raise ParameterError(f"unknown release {self.release!r}: choose one of {', '.join(RELEASES)}")
        if isinstance(self.attitude, str):
            arguments.choice("attitude", self.attitude, ("solved",))
        else:
            object.__setattr__(self, "attitude", arguments.not_negative("attitude", self.attitude))
        object.__setattr__(self, "knots", arguments.positive("knots", self.knots))

    @property
    def is_solved(self) -> bool:
        """Return whether the attitude is solved together with the sources."""
        return self.attitude == "solved"

    @property
    def years(self) -> float:
        """Length of the mission. [yr]"""
        return self.scanning_law.years

    @property
    def frame(self) -> str:
        """Axes of the positions it takes."""
        return self.scanning_law.frame

    def check_frame(self, frame: str) -> None:
        """Raise FrameError unless positions in the axes `frame` are in those of the scanning law.

        Raises
        ------
        FrameError
            If they are not.
        """
        if frame != self.frame:
            raise FrameError(f"positions are in {frame}, the mission's in {self.frame}")

    def transit_error(self, magnitude: ArrayLike | None, excess_noise: ArrayLike = 0.0) -> FloatArray:
        """Along-scan error of a transit by `magnitude` G, (n,), with `excess_noise` in quadrature. [µas]

        Raises
        ------
        ParameterError
            If there are no magnitudes.
        """
        if magnitude is None:
            raise ParameterError("errors of transits go by magnitude, and these sources have none")
        point_error = parallax_error(magnitude, self.release) / compute_unit_transit_errors(self.scanning_law)[2]
        return np.hypot(point_error, excess_noise)

    def attitude_noise(self, rng: Rng) -> FloatArray | None:
        """Error of the attitude in every interval between knots, (k,) [µas], by `rng`; None where it has none.

        Raises
        ------
        ParameterError
            If the attitude is solved with the sources.
        """
        if isinstance(self.attitude, str):
            raise ParameterError("an attitude that is solved has no noise of its own: it is that of the solution")
        n_intervals = int(np.ceil(self.years / KNOT_INTERVAL)) + 1
        return self.attitude * arguments.generator(rng).standard_normal(n_intervals) if self.attitude else None


def as_mission(mission: Mission | NominalScanningLaw, release: Release = "DR3") -> Mission:
    """A Mission; a bare scanning law becomes one with the errors of a release."""
    if isinstance(mission, NominalScanningLaw):
        return Mission(mission, release)
    return arguments.a(Mission, NominalScanningLaw)("mission", mission)
