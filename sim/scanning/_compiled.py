"""Crossings by a compiled loop (numba): each source through all spins, without arrays in between."""

import numpy as np
from numba import njit

from vsh.tools.parallel import compile_loops
from vsh.tools.types import FloatArray, IntArray


@njit(inline="always")
def _compute_height(r, i, axis, k):
    return r[i, 0] * axis[k, 0] + r[i, 1] * axis[k, 1] + r[i, 2] * axis[k, 2]


@compile_loops()
def find_all(
    r: FloatArray, axes: tuple, times: FloatArray, reach: FloatArray, chunk: int, max_height: float, half_angle: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """Source, time and field of all crossings, by source and time; axes and directions are rows of three."""
    z, u, w = axes
    size = 200 * len(r) + 100
    owner, time, views = np.empty(size, np.int64), np.empty(size), np.empty(size, np.int64)
    count, spins, turn = 0, len(times) - 1, 2 * np.pi
    for i in range(len(r)):
        for c in range(len(reach)):
            if not abs(_compute_height(r, i, z, chunk * c)) < max_height + reach[c]:
                continue
            h1 = _compute_height(r, i, z, chunk * c)
            for k in range(chunk * c, min(chunk * (c + 1), spins)):
                h0, h1 = h1, _compute_height(r, i, z, k + 1)
                if (h0 >= max_height and h1 >= max_height) or (h0 <= -max_height and h1 <= -max_height):
                    continue
                azimuth = np.arctan2(_compute_height(r, i, w, k), _compute_height(r, i, u, k))
                azimuth_shift = np.arctan2(_compute_height(r, i, w, k + 1), _compute_height(r, i, u, k + 1)) - azimuth
                azimuth_shift -= turn * np.round(azimuth_shift / turn)
                for view in (1, -1):
                    phase = (azimuth - view * half_angle) % turn
                    # Where the azimuth of a source falls, a field may meet it twice in a spin.
                    for lap in range(2 if phase < -azimuth_shift else 1):
                        share = (phase + lap * turn) / (turn - azimuth_shift)
                        if not (share < 1 and abs(h0 + share * (h1 - h0)) < max_height):
                            continue
                        if count == size:
                            owner, time = np.append(owner, owner), np.append(time, time)
                            views, size = np.append(views, views), 2 * size
                        moment = times[k] + share * (times[k + 1] - times[k])
                        index = count
                        # The four of a spin come nearly in order.
                        while index > 0 and owner[index - 1] == i and time[index - 1] > moment:
                            owner[index], time[index], views[index] = i, time[index - 1], views[index - 1]
                            index -= 1
                        owner[index], time[index], views[index] = i, moment, view
                        count += 1
    return owner[:count].copy(), time[:count].copy(), views[:count].copy()
