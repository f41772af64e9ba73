import re
from dataclasses import replace
from importlib import import_module

import matplotlib.pyplot as plt
import numpy as np
import pytest
from astropy.table import Table
from conftest import random_field

import fit
import sim
from fit import in_time
from fit.correlation import correlation_matrices, leakage, predict_covariance
from fit.posterior import grid, sample
from fit.redshift import binned
from fit.results import storage
from fit.results.storage import _KINDS, read
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh import Field, ScalarField, Vector
from vsh.figures.plot import figure_of
from vsh.io.epochs import read_observations
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.models.covariance import Spectrum
from vsh.tools.errors import TableError


def two_catalogues(field):
    """The same sources twice, three of them far off in the second."""
    noise = field.sigma * np.random.default_rng(3).normal(size=(2, len(field)))
    off = np.where(np.arange(len(field)) < 3, 1e5, 0.0)
    named = {"sigma": field.sigma, "rho": field.rho, "name": np.arange(len(field))}
    return Field(field.lon, field.lat, field.motion, **named), Field(field.lon, field.lat, noise + off, **named)


def results():
    field = random_field(200, 1)
    galaxies = sim.observe(sim.galaxies(200, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
    binning = galaxies.add_note("a note: ã in µas/yr")
    spin = Vector([0.1, 0.2, 0.3], 0.01 * np.eye(3))
    return {
        "solution": fit.fit_field(field.add_note("left out µ"), 3),
        "clipped": fit.robust.clip(field, fit.fit_field(field, 2).modes).solution,
        "cross": cross_of(field),
        "shared": fit.background.shared([fit.normal_equations(field[k::2], 3) for k in range(2)], draws=60),
        "kinematics": fit.kinematics(clusters(field)),
        "prediction": predict_covariance(field, 2),
        "frame": fit.solve_frame(field, random_field(50, 2)),
        "velocity": observer_velocity(galaxies, 67.3, spin=spin),
        "velocity and spin": observer_velocity(galaxies, 67.3, spin="free"),
        "hubble": hubble_constant(galaxies, CMB_VELOCITY_PLANCK18),
        "forecast": fit.secular_parallax.forecast_velocity({"one": galaxies}, (0.03,), n_modes=9),
        "velocity and flow": observer_velocity(galaxies, 67.3, flows="linear", n_modes=30),
        "flow": observer_velocity(galaxies, 67.3, flows="linear", n_modes=30).flow,
        "velocity to come": fit.secular_parallax.predict_errors(galaxies)[0],
        "hubble to come": fit.secular_parallax.predict_errors(galaxies)[1],
        "bins": binned(binning, 2, 2),
        "with a floor": fit.solve(
            fit.normal_equations(field, 3), floor=fit.background.floor(fit.normal_equations(field, 3))
        ),
        "scalars": fit.fit_field(ScalarField(field.lon, field.lat, field.motion[0], field.sigma[0], "mag"), 2),
        "pairs": fit.pairs.correlation_function(field, np.radians([0, 40, 80, 120, 180]), nside=1),
        "templates": fit.pairs.correlation_function(field, np.radians([0, 40, 80, 120, 180]), nside=1).fit(),
        "shear": fit.shear.expansion(fit.fit_field(field, 2)),
        "shears": fit.shear.compare_expansions([fit.normal_equations(field, 4)] * 2, labels=["a", "b"], draws=100),
        "orbit": fit.galaxy.orbit(Vector([5.0, 0.1, 0.2], 0.1 * np.eye(3), "galactic")),
        "frames": fit.compare.compare_catalogues(*two_catalogues(field), 1, labels=("one", "two"))[0],
        "chain": fit.chain.combine_frames(dict(zip("ab", two_catalogues(field), strict=True)), 1),
        "in time": in_time.solve(in_time_equations()),
        "link": fit.link.link(sim.link(1, 12), excess=False),
        "steps": fit.link.find_step(sim.link(1, 24), [9.0, 13.0], excess=False, robust=False),
        "plan": fit.link.forecast(fit.link.link(sim.link(1, 12), robust=False), sim.link(2, 3)),
        "waves by frequency": fit.waves.search_in_time(
            epochs(), [1.5, 2.0], attitude="known", lmax=2, nside=2, n_skies=5
        ),
        "one wave": fit.waves.search(fit.fit_field(field, 2), nside=2, n_skies=5),
        "recommended": fit.recommended(field, 3),
        "estimate": fit.estimate(field, 3, "student"),
        "floor": fit.background.floor(fit.normal_equations(field, 3)),
        "background": fit.background.fit_amplitudes(fit.normal_equations(field, 3), [Spectrum.odd(), Spectrum.waves()]),
        "waves": fit.background.wave_limit(fit.normal_equations(field, 2)),
        "common": binned(binning, 2, 2, shared_higher_degrees=True),
        "correlations": correlation_matrices({"one": field, "two": random_field(300, 3)}, 2),
        "leakage": leakage(field, 1, 3),
        "clipping": fit.robust.clip(field, 1),
        "reweighting": fit.robust.student_t(field, 1),
        "excess noise": fit.robust.excess_noise(field, 1),
        "cross-check": fit.cross_check(field),
        "trend": binned(binning, 1, 3).trend(),
        "bootstrap": fit.resample.bootstrap(field, 1, 12, 1, progress=False),
        "moments": fit.Moments.of(field, 2),
        "grid": grid(galaxies, CMB_VELOCITY_PLANCK18, n_points=12),
        "samples": sample(
            galaxies, CMB_VELOCITY_PLANCK18, n_samples=20_000, rng=1, n_walkers=20, progress=False
        ).kept(),
    }


def epochs():
    law = sim.NominalScanningLaw(years=2.0)
    table = sim.epochs(sim.quasars(40, 1), sim.spin((0, 0, 0)), 1, mission=law)
    return read_observations(table).by_transit()


def in_time_equations():
    return in_time.normal_equations(epochs(), 2, in_time.waves(2.0, 3.0, span=(-2.8, -0.7)), attitude="known")


def cross_of(field):
    template = fit.background.Template.density("density", field, 4)
    normal = fit.normal_equations(field, 3, templates=[template])
    return fit.background.cross_powers(fit.solve(normal), normal.templates)


def clusters(field):
    """Sources of a field at measured distances."""
    distance = np.random.default_rng(1).uniform(1e-3, 1e-2, len(field))
    return replace(field, distance=distance, distance_error=0.1 * distance)


NAMES = (
    *(
        "solution",
        "clipped",
        "prediction",
        "frame",
        "velocity",
        "velocity and spin",
        "hubble",
        "bins",
        "common",
        "velocity and flow",
        "flow",
        "forecast",
        "with a floor",
        "recommended",
        "floor",
        "background",
        "waves",
        "scalars",
        "pairs",
        "templates",
        "shear",
        "shears",
        "orbit",
        "one wave",
        "chain",
        "in time",
        "link",
        "steps",
        "plan",
        "waves by frequency",
        "frames",
        "kinematics",
        "shared",
        "cross",
    ),
    *(
        "estimate",
        "correlations",
        "leakage",
        "clipping",
        "reweighting",
        "excess noise",
        "cross-check",
        "trend",
        "bootstrap",
    ),
    *("velocity to come", "hubble to come", "moments", "grid", "samples"),
)


@pytest.fixture(scope="module")
def found():
    return results()


def test_every_kind_of_result_is_tried(found):
    """Another kind of result joins the list above, or says here why not."""
    bases = {
        "FrameResult",
        "LinearSolution",
        "NamedSolution",
        "HarmonicSolution",
        "AboutSolution",
        "Weighted",
        "SampleResult",
        "ParallaxSolution",
    }
    elsewhere = {"Posterior"}  # a chain in a file of its own: tests/fit/posterior
    import_module("fit.results.output")
    assert set(found) == set(NAMES), "every key of results() stands in NAMES"
    assert {type(each).__name__ for each in found.values()} == set(_KINDS) - bases - elsewhere


@pytest.mark.parametrize("name", NAMES)
def test_every_result_can_do_everything(name, found):
    result = found[name]
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
    assert storage._named("fit.background._moved_since", "Floor") is fit.background.Floor
    with pytest.raises(TableError):
        storage._named("fit.background._moved_since", "NoSuchKind")


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_result_can_be_drawn(name, found):
    figure = figure_of(found[name].plot())
    assert figure.axes
    figure.canvas.draw()
    plt.close(figure)


def same(a, b):
    """Equal to the last bit, whatever is inside."""
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and all(same(getattr(a, f), getattr(b, f)) for f in a.__dataclass_fields__)
    if isinstance(a, np.ndarray):
        return a.shape == b.shape and a.tobytes() == np.asarray(b, a.dtype).tobytes()
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, (list, tuple)):
        return type(a) is type(b) and len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, float):
        return a == b or (np.isnan(a) and np.isnan(b))
    return a == b


@pytest.mark.parametrize(
    ("name", "ending"),
    [
        *((name, "ecsv") for name in NAMES),
        *((name, "fits") for name in NAMES[:2]),
        *(pytest.param(name, "fits", marks=pytest.mark.slow) for name in NAMES[2:]),
    ],
)
def test_there_and_back(name, ending, found, tmp_path):
    result = found[name]
    path = tmp_path / f"result.{ending}"
    result.write(path, {"ORIGIN": "a test"})
    again = read(path)
    assert same(again, result)
    assert again.report() == result.report()
    plain = Table.read(path)  # astropy alone
    assert len(plain)
    assert plain.meta["ORIGIN"] == "a test"


def test_plain_table_says_what_is_in_it(found, tmp_path):
    solution = found["solution"]
    solution.write(tmp_path / "solution.ecsv")
    table = Table.read(tmp_path / "solution.ecsv")
    assert table["coefficient"][0] == "t(1,0)"
    assert str(table["value"].unit) == "uas / yr"
    np.testing.assert_array_equal(table["covariance"], solution.covariance)


def test_files_that_cannot_be_read(found, tmp_path):
    Table({"x": [1.0]}).write(tmp_path / "other.ecsv")
    with pytest.raises(TableError, match="holds no result of a fit"):
        read(tmp_path / "other.ecsv")
    found["frame"].write(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="holds a FrameSolution, not a Solution"):
        fit.Solution.read(tmp_path / "frame.fits")
    with pytest.raises(TableError, match="as .ecsv or .fits, which keep every bit"):
        found["frame"].write(tmp_path / "frame.csv")
    with pytest.raises(TableError, match="no such file"):
        read(tmp_path / "none.fits")


def test_for_notebooks_and_papers(found):
    solution = found["solution"]
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
    """Each was read without a word."""
    field = random_field(100, 1)
    solution = fit.fit_field(field, 2)
    solution.write(tmp_path / "s.ecsv")
    table = Table.read(tmp_path / "s.ecsv")
    spoiled(table)
    table.write(tmp_path / "s.ecsv", overwrite=True)
    with pytest.raises(TableError, match=rf"is damaged: its Solution is not as it was written.*{words}"):
        read(tmp_path / "s.ecsv")
