"""Figures: the one thing a picture may not do is point the wrong way."""

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("agg")
import matplotlib.pyplot as plt
from conftest import random_field

import fit
from vsh import Coefficients, Modes
from vsh.sky.plot import draw_vectors, even_grid, map_angles, on_map, plot_field, sky_axes


@pytest.fixture(autouse=True)
def close_figures():
    yield
    plt.close("all")


def test_east_is_to_the_left():
    lon = np.array([0.0, 0.1, 6.2, np.pi - 0.01])
    np.testing.assert_allclose(on_map(lon), [0, -0.1, 2 * np.pi - 6.2, -np.pi + 0.01], atol=1e-12)


def test_arrows_point_where_the_motion_goes():
    """Far from the centre, north is not up: compare with the way two projected points differ."""
    axes = sky_axes()
    axes.figure.canvas.draw()  # only now has the map its shape
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 200), np.radians(rng.uniform(-80, 80, 200))
    heading = rng.uniform(0, 2 * np.pi, 200)
    motion = np.array([np.sin(heading), np.cos(heading)])
    inside = np.abs(np.abs(on_map(lon)) - np.pi) > 0.05
    step = 1e-5
    points = [
        axes.transData.transform(
            np.c_[on_map(lon + sign * step * motion[0] / np.cos(lat)), lat + sign * step * motion[1]]
        )
        for sign in (1, -1)
    ]
    dx, dy = (points[0] - points[1]).T
    expected = np.arctan2(dy, dx)
    turned = np.angle(np.exp(1j * (map_angles(axes, lon, lat, motion) - expected)))
    np.testing.assert_allclose(turned[inside], 0, atol=1e-3)
    north_is_up = np.abs(np.angle(np.exp(1j * (np.pi / 2 + heading - expected))))
    assert np.degrees(north_is_up[inside].max()) > 45  # what matplotlib alone would draw wrong


def test_drawn_arrows_have_that_angle_and_length():
    axes = sky_axes()
    lon, lat = np.array([1.0, 4.0]), np.array([0.8, -0.8])
    motion = np.array([[1.0, 0.0], [0.0, 3.0]])
    arrows = draw_vectors(axes, lon, lat, motion)
    np.testing.assert_allclose(np.hypot(arrows.U, arrows.V), [1, 3])
    np.testing.assert_allclose(np.arctan2(arrows.V, arrows.U), map_angles(axes, lon, lat, motion))
    np.testing.assert_allclose(arrows.angles, np.degrees(map_angles(axes, lon, lat, motion)))


def test_the_grid_is_even():
    lon, lat = even_grid(5.0)
    assert np.abs(np.mean([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)], axis=1)).max() < 1e-3


@pytest.mark.parametrize("frame", ["icrs", "galactic", "ecliptic"])
def test_figures_name_their_frame(frame):
    field = random_field(100, seed=1).to_frame(frame)
    figure = plot_field(field, fit.fit_field(field, 2).coefficients)
    words = [text.get_text() for text in figure.axes[0].texts]
    assert any(word.startswith("ICRS" if frame == "icrs" else frame) for word in words)
    still = plot_field(field, Coefficients(Modes(1), np.zeros(6)))  # nothing to draw is no crash
    still.canvas.draw()


def test_spectrum_and_correlation():
    solution = fit.fit_field(random_field(500, seed=1), 4)
    for figure in (fit.output.plot_spectrum(solution), fit.output.plot_correlation(solution)):
        figure.canvas.draw()
    image = figure.axes[0].images[0]
    assert image.norm.vmin == -image.norm.vmax
