"""Figures of all results at the widths of journals: no two texts lie on each other."""

import warnings

import matplotlib.pyplot as plt
import pytest
from conftest import random_field
from every_result import RESULTS, result_of
from matplotlib.text import Text

import fit
from fit.resample import bootstrap
from vsh.figures.plot import SkyAxes, figure_of

#: Columns of MNRAS and A&A, and A&A's whole page. [mm]
WIDTHS = [84, pytest.param(88, marks=pytest.mark.slow), pytest.param(180, marks=pytest.mark.slow)]
#: corner's own figures have panels of their own size: a column is too narrow for four unknowns.
OWN_SIZE = {"samples"}


def shown(figure):
    """Texts that are drawn, with where they are [pixels]."""
    figure.canvas.draw()
    hidden = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            drawn = {id(label) for tick in axis._update_ticks() for label in (tick.label1, tick.label2)}
            labels = {id(each) for tick in (*axis.majorTicks, *axis.minorTicks) for each in (tick.label1, tick.label2)}
            hidden |= labels if isinstance(axes, SkyAxes) else labels - drawn
    renderer = figure.canvas.get_renderer()
    for text in figure.findobj(Text):
        if id(text) not in hidden and text.get_visible() and text.get_text().strip():
            yield text.get_text(), text.get_window_extent(renderer)


def collisions(figure):
    """Pairs of texts that lie on each other by more than two pixels in both directions."""
    texts = list(shown(figure))
    for i, (one, a) in enumerate(texts):
        for two, b in texts[:i]:
            wide, high = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
            if wide > 2.5 and high > 2.5 and one != two:
                yield one, two


@pytest.mark.slow
@pytest.mark.parametrize("width", WIDTHS)
def test_no_two_texts_lie_on_each_other(width):
    bad = {}
    for name in RESULTS.keys() - OWN_SIZE:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            figure = figure_of(result_of(name).plot())
            figure.set_size_inches(width / 25.4, figure.get_size_inches()[1])
            bad |= {name: found} if (found := list(collisions(figure))) else {}
        plt.close(figure)
    assert not bad


def test_no_text_of_a_fit_is_cut():
    field = random_field(600, 1)
    solution = bootstrap(field, 3, 40, 1, progress=False).resampled_solution
    for name, drawn in fit.output.draw_figures(solution, field).items():
        figure = figure_of(drawn() if callable(drawn) else drawn)
        wide, high = figure.bbox.width, figure.bbox.height
        figure.canvas.draw()
        for text in [each for axes in figure.axes for each in (axes.title, axes.xaxis.label, axes.yaxis.label)]:
            box = text.get_window_extent()
            assert not text.get_text() or min(box.x0, box.y0) > -1.5, (name, text)
            assert not text.get_text() or max(box.x1 - wide, box.y1 - high) < 1.5, (name, text)
        plt.close(figure)


def test_collision_is_seen():
    figure, axes = plt.subplots()
    axes.text(0.5, 0.5, "here")
    axes.text(0.5, 0.5, "and there")
    assert list(collisions(figure)) == [("and there", "here")]
