import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field

import fit
import sim
from fit.correlation import correlation_matrices, leakage, predict
from fit.redshift import binned
from fit.secular_parallax import hubble_constant, observer_velocity
from fit.storage import read
from vsh import Vector
from vsh.cosmology import PLANCK_2018
from vsh.errors import TableError


def results():
    field = random_field(200, 1)
    galaxies = sim.observe(sim.galaxies(200, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
    binning = galaxies.add_note("a note: ã in µas/yr")
    spin = Vector([0.1, 0.2, 0.3], 0.01 * np.eye(3))
    return {
        "solution": fit.fit_field(field.add_note("left out µ"), 3),
        "clipped": fit.robust.clip(field, fit.fit_field(field, 2).modes).solution,
        "prediction": predict(field, 2),
        "frame": fit.solve_frame(field, random_field(50, 2)),
        "velocity": observer_velocity(galaxies, 67.3, spin=spin),
        "velocity and spin": observer_velocity(galaxies, 67.3, spin="free"),
        "hubble": hubble_constant(galaxies, PLANCK_2018),
        "bins": binned(binning, 2, 2),
        "common": binned(binning, 2, 2, shared_higher_degrees=True),
        "correlations": correlation_matrices({"one": field, "two": random_field(300, 3)}, 2),
        "leakage": leakage(field, 1, 3),
    }


def same(a, b):
    """Equal to the last bit, whatever is inside."""
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f), getattr(b, f)) for f in a.__dataclass_fields__)
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and a.tobytes() == np.asarray(b, a.dtype).tobytes()
    if isinstance(a, (list, tuple)):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float):
        return a == b or (np.isnan(a) and np.isnan(b))
    return a == b


@pytest.mark.parametrize("ending", ["ecsv", "fits"])
@pytest.mark.parametrize("name", list(results()))
def test_there_and_back(name, ending, tmp_path):
    result = results()[name]
    path = tmp_path / f"result.{ending}"
    result.write(path, {"ORIGIN": "a test"})
    assert same(type(result).read(path), result)
    assert same(read(path), result)
    plain = Table.read(path)  # astropy alone
    assert len(plain)
    assert plain.meta["ORIGIN"] == "a test"


def test_a_plain_table_says_what_is_in_it(tmp_path):
    solution = results()["solution"]
    solution.write(tmp_path / "solution.ecsv")
    table = Table.read(tmp_path / "solution.ecsv")
    assert table["coefficient"][0] == "t(1,0)"
    assert str(table["value"].unit) == "uas / yr"
    np.testing.assert_array_equal(table["covariance"], solution.covariance)


def test_what_cannot_be_read(tmp_path):
    Table({"x": [1.0]}).write(tmp_path / "other.ecsv")
    with pytest.raises(TableError, match="holds no result of a fit"):
        read(tmp_path / "other.ecsv")
    results()["frame"].write(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="holds a FrameSolution, not a Solution"):
        fit.Solution.read(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="as .ecsv or .fits, which keep every bit"):
        results()["frame"].write(tmp_path / "frame.csv")
    with pytest.raises(TableError, match="no such file"):
        read(tmp_path / "none.fits")


def test_for_notebooks_and_papers():
    solution = results()["solution"]
    html = solution._repr_html_()
    assert html.count("<tr>") == 1 + 2 + 1 + 6
    assert "left out µ" in html
    latex = solution.latex()
    assert latex.startswith(r"\begin{tabular}{lcccc}")
    assert latex.count(r"\\") == 1 + 2 + 1 + 6
    assert f"{solution.spin.value[0]:+.3f}" in latex
    assert "e+" not in latex


@pytest.mark.parametrize(
    ("spoiled", "words"),
    [
        (
            lambda table: table.__setitem__("value", table["value"] * np.r_[np.nan, np.ones(15)]),
            "1 of 16 values of value are not finite",
        ),
        (lambda table: table["covariance"].__setitem__((0, 0), -1.0), "negative variances"),
        (lambda table: table["covariance"].__setitem__((0, 1), 1e3), "not symmetric"),
        (lambda table: table.__setitem__("sigma", table["sigma"] * 2), "column sigma"),
        (lambda table: table["value"].__setattr__("unit", "mas / yr"), "column value is in mas"),
        (lambda table: table.__setitem__("coefficient", table["coefficient"][::-1]), "column coefficient"),
        (lambda table: table.reverse(), "negative variances"),
        (lambda table: table.remove_column("sigma"), "columns sigma"),
        (lambda table: table.__setitem__("value", np.ma.masked_array(table["value"], np.arange(16) == 3)), "missing"),
    ],
    ids=[
        "nan",
        "negative variance",
        "asymmetric",
        "sigma",
        "unit",
        "names permuted",
        "rows permuted",
        "a column less",
        "masked",
    ],
)
def test_stored_results_are_checked(spoiled, words, tmp_path):
    """Fault F3: each was read without a word."""
    field = random_field(100, 1)
    solution = fit.fit_field(field, 2)
    solution.write(tmp_path / "s.ecsv")
    table = Table.read(tmp_path / "s.ecsv")
    spoiled(table)
    table.write(tmp_path / "s.ecsv", overwrite=True)
    with pytest.raises(TableError, match=rf"is damaged: its Solution is not as it was written.*{words}"):
        read(tmp_path / "s.ecsv")
