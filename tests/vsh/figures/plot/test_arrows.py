"""Arrows point where the motion goes: the one thing a picture may not do is point the wrong way.

The truth is projected here by the formulas of the projections, without WCS.
"""

import numpy as np
import pytest
from test_sky_axes import CENTRES, SOME

from vsh import Coefficients, ParameterError
from vsh.figures.plot import PROJECTIONS, arrow_grid, draw_vectors, even_grid, sky_axes
from vsh.sky.sphere import triad


def plane(projection, centre, r):
    """Unit vectors on the plane of a map, east to the left, by closed formulas; (n, 2)."""
    lon, lat = np.radians(centre)
    about = np.array([[np.cos(lat), 0, np.sin(lat)], [0, 1, 0], [-np.sin(lat), 0, np.cos(lat)]])
    turn = about @ np.array([[np.cos(lon), np.sin(lon), 0], [-np.sin(lon), np.cos(lon), 0], [0, 0, 1]])
    x, y, z = turn @ r
    if projection == "globe":
        return np.stack([-y, z], axis=1)
    if projection == "polar":
        k = np.sqrt(2 / (1 + x))
        return np.stack([-k * y, k * z], axis=1)
    phi, theta = np.arctan2(y, x), np.arcsin(np.clip(z, -1, 1))
    if projection == "hammer":
        k = np.sqrt(2 / (1 + np.cos(theta) * np.cos(phi / 2)))
        return np.stack([-2 * k * np.cos(theta) * np.sin(phi / 2), k * np.sin(theta)], axis=1)
    t = theta.copy()
    for _ in range(200):  # 2t + sin 2t = π sin θ
        t -= (2 * t + np.sin(2 * t) - np.pi * np.sin(theta)) / np.maximum(2 + 2 * np.cos(2 * t), 1e-9)
    return np.stack([-2 * np.sqrt(2) / np.pi * phi * np.cos(t), np.sqrt(2) * np.sin(t)], axis=1)


def angle_of(steps):
    return np.arctan2(steps[:, 1], steps[:, 0])


@pytest.mark.parametrize("centre", SOME)
@pytest.mark.parametrize("projection", PROJECTIONS)
def test_arrows_point_where_the_motion_goes(projection, centre):
    axes = sky_axes(projection=projection, centre=centre)
    lon, lat = arrow_grid(axes)
    rng = np.random.default_rng(1)
    heading = rng.uniform(0, 2 * np.pi, lon.size)
    motion = np.array([np.sin(heading), np.cos(heading)]) * rng.uniform(0.3, 1, lon.size)
    shafts = draw_vectors(axes, lon, lat, motion)
    axes.figure.canvas.draw()
    assert len(shafts.get_segments()) == lon.size  # none is left out
    lines = np.stack([axes.transData.transform(line) for line in shafts.get_segments()])
    p, q, r = triad(lon, lat)
    along = (motion[0] * p + motion[1] * q) / np.hypot(*motion)
    step = 1e-4
    expected = angle_of(plane(projection, centre, r + step * along) - plane(projection, centre, r - step * along))
    middle = lines.shape[1] // 2
    found = angle_of(lines[:, middle + 1] - lines[:, middle - 1])
    off = np.degrees(np.abs(np.angle(np.exp(1j * (found - expected)))))
    assert off.max() < 1
    # And none is split: the seam is hundreds of dots away.
    assert np.hypot(*np.moveaxis(np.diff(lines, axis=1), 2, 0)).max() < 10


@pytest.mark.parametrize("projection", PROJECTIONS)
def test_as_many_arrows_for_every_centre(projection):
    numbers = set()
    for centre in CENTRES:
        axes = sky_axes(projection=projection, centre=centre)
        grid = arrow_grid(axes)
        motion = Coefficients.from_vectors(rotation=(1, 2, 3), glide=(3, -2, 1)).at(*grid)
        numbers.add(len(draw_vectors(axes, *grid, motion).get_segments()))
    assert len(numbers) == 1
    assert numbers.pop() > (250 if axes.is_whole else 100)


@pytest.mark.parametrize("projection", ["hammer", "mollweide"])
def test_arrows_keep_off_the_rim_and_fill_the_map(projection):
    """No place of the map is farther from an arrow than a step and a half of their grid."""
    axes = sky_axes(projection=projection, centre=(30, 20))
    grid, everywhere = arrow_grid(axes, 12.0), even_grid(4.0)
    distance = np.arccos(np.clip(triad(*everywhere)[2].T @ triad(*grid)[2], -1, 1)).min(1)
    assert np.degrees(distance).max() < 18
    _, native = axes.project(*grid)
    assert np.abs(native).max() < 175


def test_arrow_at_the_seam_is_moved_not_lost():
    axes = sky_axes()
    lon, lat = np.radians([179.9, 180.1, 0.0, 180.0]), np.radians([0.0, 40.0, 89.0, -80.0])
    for heading in np.linspace(0, 2 * np.pi, 16, endpoint=False):
        motion = np.tile([[np.sin(heading)], [np.cos(heading)]], 4)
        lines = np.array(draw_vectors(axes, lon, lat, motion).get_segments())
        assert len(lines) == 4
        assert np.abs(np.diff(lines, axis=1)).max() < 60


def test_lengths_and_colours_are_those_of_the_motions():
    axes = sky_axes()
    motion = np.array([[1.0, 0.0, 0.0], [0.0, 3.0, 0.0]])
    shafts = draw_vectors(
        axes, np.array([0.1, 0.1, 1.0]), np.array([0.1, -0.1, 0.0]), motion, color=np.eye(4)[[0, 1, 2]]
    )
    lines = np.array(shafts.get_segments())  # the third does not move and is no arrow
    lengths = np.hypot(*np.moveaxis(np.diff(lines, axis=1), 2, 0)).sum(1)
    assert lengths[1] / lengths[0] == pytest.approx(3, rel=0.02)
    np.testing.assert_array_equal(shafts.get_colors(), np.eye(4)[[0, 1]])
    with pytest.raises(ParameterError, match="motion have shapes"):
        draw_vectors(axes, np.zeros(3), np.zeros(3), np.zeros((3, 2)))


def test_grid_is_even():
    lon, lat = even_grid(5.0)
    assert np.abs(np.mean(triad(lon, lat)[2], axis=1)).max() < 1e-3
