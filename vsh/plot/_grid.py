"""Where arrows stand."""

from __future__ import annotations

import numpy as np

from vsh.checks.types import FloatArray
from vsh.plot._sky_axes import SkyAxes


def even_grid(step: float = 12.0) -> tuple[FloatArray, FloatArray]:
    """Positions about `step` degrees apart all over the sky: lon, lat. [rad]"""
    lon, lat = [], []
    for degrees in np.arange(-90 + step / 2, 90, step):
        around = max(1, round(360 * np.cos(np.radians(degrees)) / step))
        lon.append((np.arange(around) + 0.5) * 2 * np.pi / around)
        lat.append(np.full(around, np.radians(degrees)))
    return np.concatenate(lon), np.concatenate(lat)


def arrow_grid(axes: SkyAxes, step: float = 12.0) -> tuple[FloatArray, FloatArray]:
    """Positions evenly placed on a map, half a step off its rim: as many wherever its centre is."""
    return axes.of_native(*(_whole(step) if axes.is_whole else _half(step)))


def _whole(step):
    """Rows of native latitude, each from half a step after the seam to half a step before it."""
    phi, theta = [], []
    for degrees in np.arange(-90 + step / 2, 90, step):
        # A place so far from the meridian of the seam that an arrow of half a step does not reach it.
        sine = np.sin(np.radians(step / 2)) / np.cos(np.radians(degrees))
        reach = 180 - np.degrees(np.arcsin(min(1.0, sine)))
        n = max(1, 1 + int(2 * reach * np.cos(np.radians(degrees)) / step + 1e-9))
        if degrees < -90 + 0.75 * step or degrees > 90 - 0.75 * step:
            reach, n = 60.0, 3  # about the pole, which the seam ends at
        phi.append(np.linspace(-reach, reach, n) if n > 1 else np.zeros(1))
        theta.append(np.full(n, degrees))
    return np.radians(np.concatenate(phi)), np.radians(np.concatenate(theta))


def _half(step):
    """The middle, and rings about it to half a step off the limb."""
    phi, theta = [np.zeros(1)], [np.full(1, 90.0)]
    rings = int((90 - step / 2) / step)
    for i in range(1, rings + 1):
        away = i * (90 - step / 2) / rings
        n = max(6, round(360 * np.sin(np.radians(away)) / step))
        phi.append((np.arange(n) + 0.5 * (i % 2)) * 360 / n)
        theta.append(np.full(n, 90 - away))
    return np.radians(np.concatenate(phi)), np.radians(np.concatenate(theta))
