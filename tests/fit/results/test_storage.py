import re
from dataclasses import fields
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field
from every_result import RESULTS, result_of

import fit
from fit.results import storage
from fit.results.storage import _RESULT_CLASSES, read
from vsh.figures.plot import figure_of
from vsh.tools.errors import TableError
from vsh.tools.notes import codes_of


def test_every_kind_of_result_is_tried():
    """Another kind of result joins RESULTS; a chain is in a file of its own (tests/fit/posterior)."""
    import_module("fit.results.output")
    tried = {type(result_of(name)) for name in RESULTS}
    kinds = {kind for kind in _RESULT_CLASSES.values() if kind in tried or not kind.__subclasses__()}
    assert {kind.__name__ for kind in kinds - tried} == {"Posterior"}


@pytest.mark.parametrize("name", RESULTS)
def test_every_result_can_do_everything(name):
    result = result_of(name)
    report = result.report()
    assert report.endswith("\n")
    assert len(report.splitlines()) >= 2
    assert "nan" not in report
    assert not re.search(r"[<]\w+ object at", report)
    table = result.to_table()
    assert isinstance(table, Table)
    assert len(table)
    assert "<" in result._repr_html_()
    assert result == result
    assert result != object()
    assert isinstance(hash(result), int)


def test_file_of_a_module_that_moved_is_read_by_its_face():
    """A kind whose private module has another name now is what the room has under the name of the kind."""
    assert storage._import_class("fit.background._moved_since", "Floor") is fit.background.Floor
    with pytest.raises(TableError):
        storage._import_class("fit.background._moved_since", "NoSuchKind")


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_every_result_can_be_drawn(name):
    figure = figure_of(result_of(name).plot())
    assert figure.axes
    figure.canvas.draw()
    plt.close(figure)


def same(a, b):
    """Equal to the last bit, whatever is inside."""
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in fields(a))
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and a.tobytes() == np.asarray(b, a.dtype).tobytes()
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float):
        return a == b or (np.isnan(a) and np.isnan(b))
    return a == b


#: Every result, as FITS but for the first two among the slow tests.
FILES = [(name, "ecsv") for name in RESULTS] + [(name, "fits") for name in [*RESULTS][:2]]
FILES += [pytest.param(name, "fits", marks=pytest.mark.slow) for name in [*RESULTS][2:]]


@pytest.mark.parametrize(("name", "ending"), FILES)
def test_there_and_back(name, ending, tmp_path):
    result = result_of(name)
    path = tmp_path / f"result.{ending}"
    result.write(path, {"ORIGIN": "a test"})
    again = read(path)
    assert same(again, result)
    assert again.report() == result.report()
    assert repr(again) == repr(result)
    assert codes_of(getattr(again, "notes", ())) == codes_of(getattr(result, "notes", ()))
    plain = Table.read(path)  # astropy alone
    assert len(plain)
    assert plain.meta["ORIGIN"] == "a test"


def test_plain_table_says_what_is_in_it(tmp_path):
    solution = result_of("solution")
    solution.write(tmp_path / "solution.ecsv")
    table = Table.read(tmp_path / "solution.ecsv")
    assert table["coefficient"][0] == "t(1,0)"
    assert str(table["value"].unit) == "uas / yr"
    np.testing.assert_array_equal(table["covariance"], solution.covariance)


def test_files_that_cannot_be_read(tmp_path):
    Table({"x": [1.0]}).write(tmp_path / "other.ecsv")
    with pytest.raises(TableError, match="holds no result of a fit"):
        read(tmp_path / "other.ecsv")
    result_of("frame").write(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="holds a FrameSolution, not a Solution"):
        fit.Solution.read(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="as .ecsv or .fits, which keep every bit"):
        result_of("frame").write(tmp_path / "frame.csv")
    with pytest.raises(TableError, match="no such file"):
        read(tmp_path / "none.fits")


def test_for_notebooks_and_papers():
    solution = result_of("solution")
    html = solution._repr_html_()
    assert html.count("<tr>") == 3 + 2 + 1 + 6
    # What is words may be broken, so that none of it is cut off at the edge of the page.
    assert html.count("<td class='broken'>") == 3 + 2
    assert "left out µ" in html
    latex = solution.latex()
    assert latex.startswith(r"\begin{table*}")
    assert latex.count(r"\\") >= 2 + 2
    assert f"{solution.n_sources} sources" in latex
    assert "e+" not in latex


SPOILED = {
    "nan": (lambda t: t.replace_column("value", t["value"] * np.r_[np.nan, np.ones(15)]), "1 of 16 values of value are not finite"),
    "negative variance": (lambda t: t["covariance"].__setitem__((0, 0), -1.0), "negative variances"),
    "asymmetric": (lambda t: t["covariance"].__setitem__((0, 1), 1e3), "not symmetric"),
    "sigma": (lambda t: t.replace_column("sigma", t["sigma"] * 2), "column sigma"),
    "unit": (lambda t: t["value"].__setattr__("unit", "mas / yr"), "column value is in mas"),
    "names permuted": (lambda t: t.replace_column("coefficient", t["coefficient"][::-1]), "column coefficient"),
    "rows permuted": (lambda t: t.reverse(), "negative variances"),
    "a column less": (lambda t: t.remove_column("sigma"), "columns sigma"),
    "masked": (lambda t: t.replace_column("value", np.ma.masked_array(t["value"], np.arange(16) == 3)), "missing"),
}  # fmt: skip


@pytest.mark.parametrize("what", SPOILED)
def test_stored_results_are_checked(what, tmp_path):
    """Each was read without a word."""
    spoil, words = SPOILED[what]
    fit.fit_field(random_field(100, 1), 2).write(tmp_path / "s.ecsv")
    table = Table.read(tmp_path / "s.ecsv")
    spoil(table)
    table.write(tmp_path / "s.ecsv", overwrite=True)
    with pytest.raises(TableError, match=rf"is damaged: its Solution is not as it was written.*{words}"):
        read(tmp_path / "s.ecsv")


def test_results_of_an_older_version_have_defaults_for_what_it_did_not_know(tmp_path):
    """A floor was written without its unit before version 0.2."""
    floor = result_of("floor")
    floor.write(tmp_path / "floor.ecsv")
    text = (tmp_path / "floor.ecsv").read_text(encoding="utf-8")
    older = text.replace(r', "unit": "\u00b5as/yr"', "")
    assert older != text
    (tmp_path / "old.ecsv").write_text(older, encoding="utf-8")
    assert read(tmp_path / "old.ecsv") == floor
