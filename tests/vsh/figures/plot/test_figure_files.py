"""Figures as files."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from vsh import ParameterError
from vsh.figures.plot import apply_style, panels, save_figures


@apply_style
def drawn():
    (axes,) = panels()
    axes.plot(np.arange(3))
    axes.set_xlabel("µ_α*")
    return axes


def test_formats(tmp_path):
    paths = save_figures({"a": drawn(), "b": drawn()}, tmp_path, format=("png", "pdf", "svg"), dpi=100)
    assert [path.name for path in paths] == ["a.png", "a.pdf", "a.svg", "b.png", "b.pdf", "b.svg"]
    assert not plt.get_fignums()
    assert plt.imread(paths[0]).shape[1] == 354
    assert b"/FontFile2" in paths[1].read_bytes()  # TrueType, embedded
    assert b"/Type3" not in paths[1].read_bytes()


@pytest.mark.parametrize("ending", ["png", "pdf", "svg"])
def test_same_figure_twice_is_the_same_file(tmp_path, ending):
    files = []
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        files += save_figures({"a": drawn()}, tmp_path / name, format=ending)
    assert files[0].read_bytes() == files[1].read_bytes()


def test_commands_offer_what_can_be_written():
    from vsh.commands import parsing
    from vsh.figures.plot import FORMATS
    from vsh.tools.formats import WRITTEN

    assert parsing.FIGURE_FORMATS == FORMATS
    assert {f".{ending}" for ending in parsing.TABLE_FORMATS} <= set(WRITTEN)


def test_bad_ones(tmp_path):
    with pytest.raises(ParameterError, match="format"):
        save_figures({}, tmp_path, format="jpg")
    with pytest.raises(ParameterError, match="dpi"):
        save_figures({}, tmp_path, dpi=0)
