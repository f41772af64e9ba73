"""Crossings by a compiled loop (numba): each source through all spins, without arrays in between."""

import numpy as np
from numba import njit

from vsh.tools.parallel import compile_loops
from vsh.tools.types import FloatArray, IntArray


@njit(inline="always")
def _compute_height(r, i, axis, k):
    return r[i, 0] * axis[k, 0] + r[i, 1] * axis[k, 1] + r[i, 2] * axis[k, 2]


@compile_loops()
def find_crossings(
    r: FloatArray, axes: tuple, times: FloatArray, reach: FloatArray, chunk: int, max_height: float, half_angle: float
) -> tuple[IntArray, FloatArray, IntArray]:
    """Source, time and field of all crossings, by source and time; axes and directions are rows of three."""
    z, u, w = axes
    capacity = 200 * len(r) + 100
    source, time, views = np.empty(capacity, np.int64), np.empty(capacity), np.empty(capacity, np.int64)
    n_crossings, n_spins, full_turn = 0, len(times) - 1, 2 * np.pi
    for i in range(len(r)):
        for c in range(len(reach)):
            if not abs(_compute_height(r, i, z, chunk * c)) < max_height + reach[c]:
                continue
            h1 = _compute_height(r, i, z, chunk * c)
            for k in range(chunk * c, min(chunk * (c + 1), n_spins)):
                h0, h1 = h1, _compute_height(r, i, z, k + 1)
                if (h0 >= max_height and h1 >= max_height) or (h0 <= -max_height and h1 <= -max_height):
                    continue
                azimuth = np.arctan2(_compute_height(r, i, w, k), _compute_height(r, i, u, k))
                azimuth_shift = np.arctan2(_compute_height(r, i, w, k + 1), _compute_height(r, i, u, k + 1)) - azimuth
                azimuth_shift -= full_turn * np.round(azimuth_shift / full_turn)
                for view in (1, -1):
                    phase = (azimuth - view * half_angle) % full_turn
                    # Where the azimuth of a source falls, a field may meet it twice in a spin.
                    for lap in range(2 if phase < -azimuth_shift else 1):
                        fraction = (phase + lap * full_turn) / (full_turn - azimuth_shift)
                        if not (fraction < 1 and abs(h0 + fraction * (h1 - h0)) < max_height):
                            continue
                        if n_crossings == capacity:
                            source, time = np.append(source, source), np.append(time, time)
                            views, capacity = np.append(views, views), 2 * capacity
                        crossing_time = times[k] + fraction * (times[k + 1] - times[k])
                        slot = n_crossings
                        # The four of a spin come nearly in order.
                        while slot > 0 and source[slot - 1] == i and time[slot - 1] > crossing_time:
                            source[slot], time[slot], views[slot] = i, time[slot - 1], views[slot - 1]
                            slot -= 1
                        source[slot], time[slot], views[slot] = i, crossing_time, view
                        n_crossings += 1
    return source[:n_crossings].copy(), time[:n_crossings].copy(), views[:n_crossings].copy()
