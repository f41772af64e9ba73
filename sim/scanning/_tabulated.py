"""A scanning law from a table."""

from typing import Any

import numpy as np

from sim.scanning._sun import sun_direction
from vsh.sky.frames import check_frame
from vsh.sky.sphere import triad
from vsh.tools.arguments import float_array, positive
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, FloatArray
from vsh.tools.units import DEGREE


class TabulatedLaw(InNotebook):
    """A scanning law from a table, as Gaia's `commanded_scan_law` or plans of a mission to come.

    It says where the satellite looks, for `sim.agis.Response`; transits need the `NominalScanningLaw`.

    Parameters
    ----------
    time : (k,) array
        Rising. [Julian years]
    preceding, following : two (2, k) arrays
        Longitude and latitude of the centres of both fields of view. [rad]
    frame : str
        Axes of the positions.
    gap : float
        A longer step between two times is a gap in the observations. [yr]

    Raises
    ------
    ParameterError
        If times do not rise, or the fields are not always as far apart.

    Examples
    --------
    >>> from sim.scanning import NominalScanningLaw
    >>> law = NominalScanningLaw(years=0.02)
    >>> time = np.arange(0, 0.02, 10 / 86400 / 365.25)
    >>> from vsh.sky.sphere import angles
    >>> table = TabulatedLaw(law.start + time, *(angles(view) for view in law.attitude(time)[1:]))
    >>> round(float(np.degrees(table.basic_angle)), 6)
    106.5
    """

    def __init__(
        self, time: ArrayLike, preceding: ArrayLike, following: ArrayLike, *, frame: str = "icrs", gap: float = 0.003
    ) -> None:
        self.frame = check_frame(frame)
        time = float_array("time", time)
        views = [np.asarray(float_array("a field of view", each, (2, len(time)))) for each in (preceding, following)]
        if time.ndim != 1 or len(time) < 2 or (np.diff(time) <= 0).any():
            raise ParameterError("times of a scanning law rise, and are two at least")
        self.start, self.years = float(time[0]), float(time[-1] - time[0])
        first, second = (triad(*each)[2] for each in views)
        cosine = np.sum(first * second, 0)
        self.basic_angle = float(np.arccos(np.median(cosine)))
        if np.abs(np.arccos(np.clip(cosine, -1, 1)) - self.basic_angle).max() > 0.01 * DEGREE:
            raise ParameterError("the fields of view of a scanning law are always as far apart: look at their units")
        z = np.cross(second, first, axis=0)
        self._z = z / np.sqrt(np.sum(z**2, 0))
        middle = first + second
        self._middle = middle / np.sqrt(np.sum(middle**2, 0))
        self._times = time - self.start
        step = np.diff(self._times)
        long = np.flatnonzero(step > positive("gap", gap))
        self.lost = np.stack([self._times[long], self._times[long + 1]], axis=1)
        turned = np.arccos(np.clip(np.sum(self._middle[:, 1:] * self._middle[:, :-1], 0), -1, 1))
        if np.median(turned) > 10 * DEGREE:
            raise ParameterError("the satellite turns by more than 10° from one time to the next: take a finer table")

    def __repr__(self) -> str:
        return f"<TabulatedLaw: {len(self._times)} times, {self.start:.2f} to {self.start + self.years:.2f}>"

    def sun(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Direction of the Sun in the ecliptic, (3, n), and its distance [AU], at `time` since the start. [yr]"""
        return sun_direction(self.start, time)

    def attitude(self, time: FloatArray) -> Any:
        """Spin axis and both fields of view at `time` [yr since the start], (n,): z, preceding, following."""
        time = np.clip(np.asarray(time, float), 0, self.years)
        k = np.clip(np.searchsorted(self._times, time, side="right") - 1, 0, len(self._times) - 2)
        share = (time - self._times[k]) / (self._times[k + 1] - self._times[k])
        # Between two times the axis moves straight, and the middle of the fields turns evenly about it.
        z = self._z[:, k] * (1 - share) + self._z[:, k + 1] * share
        z /= np.sqrt(np.sum(z**2, 0))
        before = self._middle[:, k] - z * np.sum(self._middle[:, k] * z, 0)
        before /= np.sqrt(np.sum(before**2, 0))
        ahead = np.cross(z, before, axis=0)
        after = self._middle[:, k + 1]
        turn = share * np.arctan2(np.sum(after * ahead, 0), np.sum(after * before, 0))
        half = self.basic_angle / 2
        return (z, *(before * np.cos(turn + a) + ahead * np.sin(turn + a) for a in (half, -half)))
