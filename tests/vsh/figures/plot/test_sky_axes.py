"""A map of the sky: where things are on it, and that its words can be read."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from vsh import FrameError, ParameterError, Vector
from vsh.figures.plot import (
    PROJECTIONS,
    STYLE,
    draw_direction,
    draw_empty,
    draw_line,
    draw_map,
    draw_sources,
    panels,
    sky_axes,
)
from vsh.sky.pixels import centres

CENTRES = [(0, 0), (257, -12), (120, 89), (180, 0), (40, 60), (257, -60), (10, -90), (0, 90), (300, 33), (77.7, -5)]
#: Three of them each time, all among the slow tests.
SOME = [pytest.param(each, marks=[pytest.mark.slow] * (i > 2)) for i, each in enumerate(CENTRES)]


@pytest.mark.parametrize("projection", PROJECTIONS)
@pytest.mark.parametrize("centre", SOME)
def test_labels_lie_on_the_map_and_not_on_each_other(projection, centre):
    """At 9 cm: the width of a column."""
    axes = sky_axes(projection=projection, centre=centre)
    figure = axes.figure
    assert figure.get_size_inches()[0] == pytest.approx(9 / 2.54, abs=0.01)
    figure.canvas.draw()
    boxes, beside = (
        [text.get_window_extent() for text in axes.texts if text.get_gid() == gid] for gid in ("graticule", "rim")
    )
    assert len(boxes) >= 3
    assert len(beside) == (4 if axes.is_whole and centre[1] == 0 else 0)
    every = [*boxes, *beside]
    assert not any(a.overlaps(b) for i, a in enumerate(every) for b in every[:i])
    (x0, y0), (x1, y1) = axes.transData.transform([(-0.5, -0.5), np.array(axes.wcs.array_shape)[::-1] - 0.5])
    for box in boxes:
        for x in (box.x0, box.x1):
            across = (2 * x - x0 - x1) / (x1 - x0), (box.y0 + box.y1 - y0 - y1) / (y1 - y0)
            assert np.hypot(*across) < 1
    for box in beside:
        across = (2 * box.x1 - x0 - x1) / (x1 - x0), (box.y0 + box.y1 - y0 - y1) / (y1 - y0)
        assert np.hypot(*across) > 1
        assert box.x0 > 0


def test_east_is_to_the_left_and_the_centre_in_the_middle():
    for projection in PROJECTIONS:
        axes = sky_axes(projection=projection, centre=(50, 10))
        (middle, east, north), _ = axes.project(np.radians([50, 60, 50]), np.radians([10, 10, 20]))
        np.testing.assert_allclose(middle, np.array(axes.wcs.array_shape)[::-1] / 2 - 0.5, atol=1e-6)
        assert east[0] < middle[0]
        assert north[1] > middle[1]


def test_there_and_back():
    for projection in PROJECTIONS:
        axes = sky_axes(projection=projection, centre=(250, -35))
        lon, lat = np.random.default_rng(1).uniform([[0], [-1.5]], [[6.28], [1.5]], (2, 500))
        xy, _ = axes.project(lon, lat)
        shown = np.isfinite(xy[:, 0])
        assert shown.all() == axes.is_whole
        back = axes.sky_of(*xy[shown].T)
        np.testing.assert_allclose(np.exp(1j * back[0]), np.exp(1j * lon[shown]), atol=1e-6)
        np.testing.assert_allclose(back[1], lat[shown], atol=1e-6)


def test_curve_is_cut_at_the_seam():
    axes = sky_axes(centre=(100, 30))
    line = draw_line(axes, np.linspace(0, 2 * np.pi, 721), np.zeros(721))
    steps = np.hypot(*np.diff(np.asarray(line.get_data()), axis=1))
    assert np.isnan(steps).any()
    assert np.nanmax(steps) < 20


def test_map_shows_each_pixel_where_it_is():
    axes = sky_axes("galactic", centre=(200, 20))
    lon, lat = centres(4)
    picture = draw_map(axes, np.arange(192.0)).get_array()
    xy, _ = axes.project(lon, lat)
    column, row = np.round(xy).astype(int).T
    np.testing.assert_array_equal(picture[row, column], np.arange(192))
    assert np.ma.getmaskarray(np.ma.masked_invalid(picture))[0, 0]  # nothing beyond the rim


def test_hatched_is_where_no_source_stands():
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 4000), np.arcsin(rng.uniform(-1, 1, 4000))
    axes = sky_axes()
    assert draw_empty(axes, lon[:0], lat[:0]) is None
    empty = np.abs(lat) < 0.3
    drawn = draw_empty(axes, lon[~empty], lat[~empty])
    inside = drawn.get_paths()[0].contains_point
    at, _ = axes.project(np.radians([0, 90, 200, 10, 100]), np.radians([0, 5, -5, 50, -60]))
    assert [bool(inside(each)) for each in at] == [True, True, True, False, False]
    whole = draw_empty(sky_axes(), lon, lat)
    parts = [] if whole is None else [part for path in whole.get_paths() for part in path.to_polygons()]
    share = sum(abs(_area(part)) for part in parts) / (np.pi / 4 * 1000 * 500)
    assert share < 0.02


def _area(polygon):
    x, y = polygon.T
    return 0.5 * np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])


def test_directions_have_their_cones():
    axes = sky_axes()
    sure = draw_direction(axes, Vector((0, -4, -2), 0.04 * np.eye(3)), "acceleration")
    assert "68 % within 4°" in sure.get_label()
    circle = axes.lines[-1].get_xydata()
    lon, lat = axes.sky_of(*circle[np.isfinite(circle[:, 0])].T)
    from vsh.sky.sphere import triad

    away = np.degrees(np.arccos(np.array([0, -4, -2]) / np.sqrt(20) @ triad(lon, lat)[2]))
    np.testing.assert_allclose(away, Vector((0, -4, -2), 0.04 * np.eye(3)).direction_cone(), atol=0.01)
    lost = draw_direction(axes, Vector((0.1, 0, 0), np.eye(3)), "spin")
    assert lost.get_label() == "spin: direction not known"
    assert not len(lost.get_offsets())


def test_dots_thin_out():
    axes = sky_axes()
    lon, lat = np.random.default_rng(1).uniform(-1, 1, (2, 50_000))
    few, many = draw_sources(axes, lon[:100], lat[:100]), draw_sources(axes, lon, lat)
    assert many.get_sizes()[0] < few.get_sizes()[0]
    assert many.get_alpha() < few.get_alpha()
    assert len(many.get_offsets()) <= 20_000
    assert many.get_rasterized()


def test_ax_is_drawn_on():
    figure, (left, right) = plt.subplots(1, 2)
    there = left.get_subplotspec().get_position(figure)
    axes = sky_axes("galactic", left)
    assert axes.figure is figure
    assert right in figure.axes
    assert left not in figure.axes
    assert axes.get_subplotspec().get_position(figure).bounds == there.bounds
    assert sky_axes("galactic", axes) is axes
    loose = figure.add_axes((0.1, 0.1, 0.2, 0.2))
    assert sky_axes(ax=loose).get_position(original=True).bounds == pytest.approx((0.1, 0.1, 0.2, 0.2))
    with pytest.raises(ParameterError, match="galactic axes, what is drawn on it in icrs"):
        sky_axes("icrs", axes)


@pytest.mark.parametrize(("how", "error", "words"), [
    ({"frame": "ICRF"}, FrameError, "unknown frame"),
    ({"projection": "aitof"}, ParameterError, "projection"),
    ({"centre": (0, 91)}, ParameterError, "centre is a longitude and a latitude"),
    ({"centre": 3}, ParameterError, "centre"),
    ({"centre": (np.nan, 0)}, ParameterError, "centre"),
])  # fmt: skip
def test_bad_maps(how, error, words):
    with pytest.raises(error, match=words):
        sky_axes(**how)


def test_panels_are_counted():
    _, given = plt.subplots(2, 2)
    assert panels(given, 4, 1)[3] is given[1, 1]
    with pytest.raises(ParameterError, match="1 panels: ax must be as many axes, not 4"):
        panels(given)
    assert STYLE["pdf.fonttype"] == 42
