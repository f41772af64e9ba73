"""Two catalogues of one sky: what was done to one is found, errors are right, the published comparison of ICRF3 with ICRF2."""

import json
import re
import runpy
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, STUDY, few_or_many, random_field, real_catalogue
from scipy import stats

import fit
import sim
from fit.commands.compare import main
from fit.frames.compare import compare_catalogues, fit_by_error_class
from vsh import Coefficients, ConvergenceError, Field, FieldError, Modes, ParameterError, TableError
from vsh.conventions import from_icrf3, to_icrf3_terms
from vsh.io.catalogue import read_icrf, read_positions
from vsh.models.covariance import Spectrum
from vsh.sky.frames import Positions
from vsh.tools.units import UAS

TRUTH = {"R1": 12.0, "R2": 15.0, "R3": -2.0, "D1": -20.0, "D2": -65.0, "D3": -95.0, "E20": 45.0}


def two(n=1500, seed=1, truth=TRUTH, outliers=0):
    """A catalogue, and the same sources as an older one had them."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(1.5, 2.5, (2, n))
    rho = rng.uniform(-0.5, 0.5, n)
    name = np.array([f"S{i:04d}" for i in range(n)])
    white = rng.standard_normal((2, n))
    noise = sigma * np.stack([white[0], rho * white[0] + np.sqrt(1 - rho**2) * white[1]])
    offset = from_icrf3(truth).at(lon, lat) + noise
    offset[:, :outliers] += 1e5
    older = Positions(lon - offset[0] * UAS / np.cos(lat), lat - offset[1] * UAS, sigma, rho, name=name)
    return Positions(lon, lat, sigma / 100, name=name), older


@pytest.mark.slow
def test_differences_put_in_are_recovered():
    pulls, p = [], []
    for seed in range(40):
        found, kept = compare_catalogues(*two(seed=seed))
        pulls.append([(value - TRUTH.get(name, 0.0)) / error for name, (value, error) in found.parameters.items()])
        assert found.solution.unit == "µas"
        nothing, _ = compare_catalogues(*two(300, seed, truth={"R1": 30.0, "D3": 5.0}))
        p.append(nothing.deformation_p_value)
    assert np.std(pulls) == pytest.approx(1, abs=0.08)
    assert np.abs(np.mean(pulls, 0)).max() < 0.7
    assert np.mean(np.array(p) < 0.3) == pytest.approx(0.3, abs=0.22)
    assert len(kept) == found.solution.n_sources


def test_errors_to_quote_are_those_of_the_scatter():
    """The older catalogue quotes a third of its errors; by least squares these are worked out in classes."""
    new, old = two(truth={})
    found, _ = compare_catalogues(new, replace(old, sigma=old.sigma / 3), floor=False, threshold=1000)
    assert found.best.sigma / found.solution.sigma == pytest.approx(np.full(len(found.solution.sigma), 3), rel=0.1)
    assert "classes" in found.best.errors_from
    by_tails, _ = compare_catalogues(new, old, floor=False, method="student")
    assert by_tails.by_class is None
    np.testing.assert_allclose(by_tails.best.sigma, by_tails.solution.sigma)


def test_more_outliers_than_are_listed():
    found, _ = compare_catalogues(*two(outliers=14))
    assert "among the 14 excluded sources" in found.report()
    assert len(found.outliers_table()) == 14
    assert found.report(long=True).count("\n  S00") == 10


def test_outliers_are_left_out_and_listed():
    found, kept = compare_catalogues(*two(outliers=7), labels=("new", "old"))
    assert set(found.names) == {f"S{i:04d}" for i in range(7)}
    assert (np.diff(found.distances) <= 0).all()
    assert len(kept) == 1493
    assert found.offsets[0] == pytest.approx([1e5, 1e5], rel=0.02)
    text = found.report()
    assert "new − old" in text
    assert "S0000" in text
    assert "µas/yr" not in text
    assert len(found.outliers_table()) == 7


def test_catalogues_with_the_same_values_are_not_compared():
    """ "Not detected: < 7 µas" was said of OCARS beside ICRF3, from which it takes its positions."""
    new, old = two(300)
    rounded = replace(new, lon=new.lon + 1e-5 * new.sigma[0] * UAS, sigma=2 * new.sigma)
    found, _ = compare_catalogues(new, rounded)
    assert found.n_same == found.solution.n_sources == 300
    ((label, text),) = found.answer.lines
    assert label == "no comparison"
    assert "300 of 300" in text
    third = np.arange(300) < 100
    taken = replace(old, lon=np.where(third, new.lon, old.lon), lat=np.where(third, new.lat, old.lat))
    mixed, _ = compare_catalogues(new, taken)
    assert mixed.n_same == 100
    assert mixed.answer.lines[0][0] == "rotation"
    assert any(f"{mixed.n_same} of" in note for note in mixed.solution.notes)
    assert compare_catalogues(*two(300))[0].n_same == 0


@few_or_many(12, 100)
def test_errors_that_are_three_times_too_small_detect_nothing(n_skies):
    """A quarter of the sources was excluded by them, and the rest scattered less than the noise: p < 0.0027 on 37 %."""
    p = []
    for seed in range(n_skies):
        rng = np.random.default_rng([5, seed])
        lon, lat = sim.uniform_sky(500, rng)
        sigma, name = np.full((2, 500), 50.0), np.arange(500)
        a, b = (Field(lon, lat, 3 * sigma * rng.normal(size=(2, 500)), sigma, name=name) for _ in range(2))
        found, _ = compare_catalogues(a, b, 2, floor=False)
        assert len(found.names) < 10
        p += [found.best.spin.p_value, found.best.acceleration.p_value, found.deformation_p_value_by_class]
    assert np.mean(np.array(p) < 0.05) < 0.05 + 3 * np.sqrt(0.05 / len(p))
    assert np.mean(np.array(p) < 0.0027) < 0.03
    assert any("times those given" in note for note in found.solution.notes)


def test_messages_and_counts_name_the_file(tmp_path, capsys):
    new, old = two(300)
    sigma = np.array(old.sigma)
    sigma[0, :7] = np.nan
    files = [str(table(new, tmp_path / "new.ecsv")), str(table(old, tmp_path / "old.ecsv", ra_error=sigma[0]))]
    assert main(files) == 1
    assert "old.ecsv: 7 of 300 rows" in capsys.readouterr().err
    assert main([*files, "--on-bad", "drop"]) == 0
    assert "old.ecsv: left out 7 of 300 rows" in " ".join(capsys.readouterr().out.split())


def test_every_degree_has_its_terms(tmp_path, capsys):
    """Degree 3 stood neither in `parameters` nor in the tables of a paper."""
    found, _ = compare_catalogues(*two(300), modes=3)
    assert len(found.parameters) == len(found.parameters_table()) == len(found.solution.modes)
    *_, mode = found.solution.modes
    value, error = found.parameters[str(mode)]
    assert (value, error) == (found.solution.values[-1], found.solution.sigma[-1])
    files = [str(table(catalogue, tmp_path / f"{i}.ecsv")) for i, catalogue in enumerate(two(300))]
    assert main([*files, "--lmax", "3", "--latex"]) == 0
    assert "$t_{31}^{\\rm R}$" in capsys.readouterr().out


def test_tables_of_several_pairs_have_labels_and_axes_of_their_own(tmp_path, capsys):
    newer, older = two(300)
    files = [str(table(catalogue, tmp_path / f"{i}.ecsv")) for i, catalogue in enumerate((newer, older, newer))]
    noise = np.random.default_rng(3).normal(size=(2, len(newer))) * newer.sigma * UAS
    table(replace(newer, lon=newer.lon + noise[0], lat=newer.lat + noise[1]), files[2])
    assert main([*files, "--lmax", "1", "--floor", "no", "--latex"]) == 0
    text = capsys.readouterr().out
    labels = re.findall(r"\\label\{([^}]*)\}", text)
    assert len(labels) == len(set(labels)) == 5
    assert all("icrs axes" in caption.lower() for caption in re.findall(r"\\caption\{(.*)\}", text))


def test_motions():
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(2000, rng)
    sigma = rng.uniform(5, 50, (2, 2000))
    name = np.arange(2000)
    b = Field(lon, lat, sigma * rng.normal(size=(2, 2000)), sigma, name=name)
    turn = Coefficients.from_vectors(rotation=(3, -2, 5)).at(lon, lat)
    a = Field(lon, lat, b.motion + turn + sigma * rng.normal(size=(2, 2000)), sigma, name=name)[::-1]
    found, _ = compare_catalogues(a, b, 1)
    assert found.solution.unit == "µas/yr"
    assert np.abs((found.solution.spin.value - [3, -2, 5]) / found.solution.spin.sigma).max() < 3.5
    assert np.isnan(found.deformation_p_value)
    # Both covariances: √2 times the errors of one.
    assert found.solution.sigma == pytest.approx(np.sqrt(2) * fit.fit_field(b, 1).sigma, rel=0.15)
    assert len(found.correlations.matrices) == 2


def test_messages():
    new, old = two(200)
    with pytest.raises(ParameterError, match="labels= are two names"):
        compare_catalogues(new, old, labels=("a",))
    with pytest.raises(ParameterError, match="threshold must be above zero"):
        compare_catalogues(new, old, threshold=0)
    with pytest.raises(ConvergenceError, match="clipping leaves"):
        compare_catalogues(new, old, threshold=0.01)
    with pytest.raises(FieldError, match="match Positions or Fields"):
        compare_catalogues(new, Field.from_positions(old))
    with pytest.raises(TableError, match="no source in common"):
        compare_catalogues(new[:100], old[100:])


def table(positions, path, **columns):
    data = {
        "source_id": positions.name, "ra": np.degrees(positions.lon), "dec": np.degrees(positions.lat),
        "ra_error": positions.sigma[0] / 1000, "dec_error": positions.sigma[1] / 1000, "ra_dec_corr": positions.rho,
    }  # fmt: skip
    Table(data | columns).write(path, overwrite=True)
    return str(path)


def test_tables_of_positions(tmp_path):
    new, old = two(300)
    read = read_positions(table(old, tmp_path / "old.fits"))
    np.testing.assert_allclose(read.sigma, old.sigma)
    np.testing.assert_allclose(read.rho, old.rho)
    assert list(read.name) == list(old.name)
    whole = compare_catalogues(new, old)[0].parameters
    again = compare_catalogues(read_positions(table(new, tmp_path / "new.ecsv")), read)[0].parameters
    assert again["D3"] == pytest.approx(whole["D3"], abs=0.2)  # positions as doubles in degrees
    broken = table(old, tmp_path / "broken.fits", ra_error=np.where(np.arange(300) < 3, np.nan, 1.0))
    with pytest.raises(FieldError, match="3 of 300 rows cannot be used: ra_error"):
        read_positions(broken)
    dropped = read_positions(broken, on_bad="drop")
    assert len(dropped) == 297
    assert any("3 of 300" in str(note) for note in dropped.notes)
    filled = read_positions(broken, sigma=100.0)  # for the sources that have no errors, and for no others
    assert (filled.sigma[0, :3] == 100).all()
    np.testing.assert_array_equal(filled.sigma[:, 3:], dropped.sigma)
    assert (read_positions({"ra": [1.0], "dec": [2.0]}, sigma=100.0).sigma == 100).all()
    with pytest.raises(TableError, match="no column 'alpha'"):
        read_positions(broken, {"ra": "alpha"})
    with pytest.raises(TableError, match="--columns sigma="):
        read_positions({"ra": [1.0], "dec": [2.0]})


@pytest.mark.slow
def test_command(tmp_path, capsys):
    new, old = two(400, outliers=3)
    paths = [table(new, tmp_path / "new.fits"), table(old, tmp_path / "old.fits")]
    folder, page = tmp_path / "out", tmp_path / "page.html"
    assert main([*paths, "--lmax", "2", "--output", str(folder), "--html", str(page)]) == 0
    files = {x.name for x in folder.iterdir()}
    assert files == {"report.txt", "comparison.ecsv", "solution.ecsv", "correlation.ecsv", "outliers.ecsv", "parameters.ecsv", "provenance.json", "run.toml", "citation.bib",
                     "sky.png", "spectrum.png", "correlation.png", "residuals.png", "catalogues.png"}  # fmt: skip
    found = fit.storage.read(folder / "comparison.ecsv")
    assert set(found.names) == {"S0000", "S0001", "S0002"}
    html = page.read_text(encoding="utf-8")
    assert "Sources that were left out" in html
    assert "names of the ICRF3 papers" in html
    assert str(tmp_path) not in html
    assert json.loads((folder / "provenance.json").read_text())["left_out"] == 3
    assert "new − old" in capsys.readouterr().out
    assert main([paths[0], str(tmp_path / "none.fits")]) == 1
    assert main([*paths, "--frame", "galactic"]) == 0
    assert "l = " in capsys.readouterr().out
    assert main([*paths, "--what", "motions"]) == 1
    assert "pmra" in capsys.readouterr().err


def test_icrf3_against_icrf2():
    """Charlot et al. (2020) found a glide of some −95 µas towards the north and E20 of 45 between the two."""
    new, old = (read_icrf(real_catalogue(name), "iers") for name in ("icrf3sx.txt", "icrf2-all.txt"))
    found, _ = compare_catalogues(new, old)
    for name, value in TRUTH.items():
        got, error = found.parameters[name]
        assert abs(got - value) < 2 * error, name
    assert found.solution.n_sources > 3300


def test_command_on_the_vlba_table(tmp_path, capsys):
    path = real_catalogue("td2017_vlba_proper_motions.ecsv")
    vlba = Table.read(path)
    turned = sim.spin((3, 0, -5))(np.radians(vlba["ra"]), np.radians(vlba["dec"]))
    vlba["pmra"] += turned[0]
    vlba["pmdec"] += turned[1]
    vlba[20:].write(tmp_path / "turned.ecsv")
    assert main([str(tmp_path / "turned.ecsv"), str(path), "--lmax", "1"]) == 0
    out = capsys.readouterr().out
    assert re.search(r"^  R1 +-3\.00? ± ", out, re.MULTILINE)
    assert re.search(r"^  R3 +5\.00? ± ", out, re.MULTILINE)
    assert main([str(path), str(real_catalogue("icrf3sx.txt"))]) == 1
    assert "--columns sigma=" in capsys.readouterr().err


@pytest.mark.slow
def test_p_values_of_catalogues_that_share_noise():
    """Half of the noise shared: by the formal errors nothing was ever below 0.05."""
    quoted, scaled = [], []
    for seed in range(20):
        rng = np.random.default_rng([21, seed])
        lon, lat = sim.uniform_sky(300, rng)
        sigma = np.full((2, 300), 50.0)
        shared = 50 * np.sqrt(0.5) * rng.normal(size=(2, 300))
        motions = [shared + 50 * np.sqrt(0.5) * rng.normal(size=(2, 300)) for _ in "ab"]
        a, b = (Field(lon, lat, motion, sigma, name=np.arange(300)) for motion in motions)
        comparison, _ = compare_catalogues(a, b, 2)
        quoted.append(comparison.deformation_p_value)
        scaled.append(comparison.deformation_p_value_scaled)
    assert min(quoted) > 0.05
    assert 0.3 < np.mean(scaled) < 0.7  # uniform: 0.5 ± 0.05
    assert np.mean(quoted) > 0.8
    text = comparison.report()
    assert "from the scatter of the residuals in classes of sources with similar formal errors" in text
    assert "their scatter is 0.7" in text


@pytest.mark.parametrize("faint", [False, True])
def test_p_values_where_some_share_noise(faint):
    """All noise of the faint, or of the bright, is shared: one factor for all is wrong, classes of errors are right."""
    rng, p = np.random.default_rng(3), []
    for _ in range(60):
        lon, lat = sim.uniform_sky(500, rng)
        sigma = 10 ** rng.uniform(0.8, 2.0, 500)
        share = np.where((sigma > 25) == faint, 0.95, 0.0)
        motion = rng.normal(size=(2, 500)) * sigma * np.sqrt(2 * (1 - share))
        found = fit_by_error_class(Field(lon, lat, motion, np.sqrt(2) * np.tile(sigma, (2, 1))), Modes(2))
        p.append(found.p_value)
    assert np.mean(np.array(p) < 0.05) <= 0.15
    assert 0.3 < np.mean(p) < 0.7
    assert max(found.factors) > 3 * min(found.factors)


def test_p_value_allows_for_factors_that_are_estimated():
    """F with the degrees of freedom of the classes, weighed by their information: larger than χ² has it."""
    rng, modes = np.random.default_rng(5), Modes(2)
    lon, lat = sim.uniform_sky(40, rng)
    sigma = np.full((2, 40), 10.0)
    field = Field(lon, lat, sigma * rng.normal(size=(2, 40)) + 8.0, sigma)
    found = fit_by_error_class(field, modes)
    beyond = modes.degrees > 1
    inner = found.covariance[np.ix_(beyond, beyond)]
    size = found.values[beyond] @ np.linalg.solve(inner, found.values[beyond])
    assert found.p_value > 1.05 * stats.chi2.sf(size, beyond.sum())
    assert found.p_value == pytest.approx(stats.f.sf(size / beyond.sum(), beyond.sum(), 80 - len(modes)), rel=1e-3)


def test_errors_by_class_of_few_sources_and_of_none():
    field = random_field(40, 1)
    assert len(fit_by_error_class(field, Modes(1)).factors) == 1
    assert np.isnan(fit_by_error_class(field, Modes(1)).p_value)
    assert fit_by_error_class(field[:2], Modes(2)) is None
    assert fit_by_error_class(field.minus(field.motion), Modes(1)) is None


def sharing(seed, n=1500, power=900.0):
    """Two catalogues of one sky, of which the first has systematics."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(n, rng)
    sky = sim.Population(lon, lat)
    pattern = sim.systematics(power * Spectrum.flat(), rng, lmax=7)
    for signal in (pattern, sim.spin((0, 0, 0))):
        field = sim.observe(sky, signal, rng, sigma=100.0)
        yield Field(field.lon, field.lat, field.motion, field.sigma, name=np.arange(n))


@pytest.mark.slow
def test_floor_is_reported_with_a_comparison_or_included(tmp_path, capsys, monkeypatch):
    a, b = sharing(1)
    few, _ = compare_catalogues(a, b, 2)
    assert few.shared is None
    assert few.floor.spin_error > 5
    assert "included in the errors of R and D" in few.report(long=True)
    first = few.solution.modes.degrees == 1
    assert (few.best.sigma[first] > 1.2 * few.solution.sigma[first]).all()
    asked, _ = compare_catalogues(a, b, 2, floor=True)
    assert asked.floor is None
    assert (asked.shared.together().sigma > 2 * few.solution.sigma[first]).all()
    assert "Systematic errors" in asked.report(long=True)
    np.testing.assert_array_equal(asked.best.spin.covariance, asked.shared.solutions[0].spin.covariance)
    np.testing.assert_array_equal(asked.best.spin.value, asked.shared.solutions[0].spin.value)
    np.testing.assert_allclose(asked.best.formal.spin.sigma, asked.solution.formal.spin.sigma)  # without the floor
    table = asked.parameters_table()
    np.testing.assert_allclose(np.asarray(table["sigma"][:3]), asked.best.spin.sigma)
    # As good by a robust fit, which has its own equations.
    robust, _ = compare_catalogues(a, b, 2, floor=True, method="student")
    assert "deformation" in robust.verdict
    assert not np.array_equal(robust.shared.values, asked.shared.values)
    assert compare_catalogues(a[:150], b[:150], 2)[0].floor is None
    monkeypatch.setattr("fit.compare.MANY", 1000)
    assert compare_catalogues(a, b, 2)[0].shared == asked.shared
    assert compare_catalogues(a, b, 2, floor=False)[0].shared is None
    monkeypatch.undo()
    c = replace(next(sharing(2)), lon=a.lon, lat=a.lat)
    for name, field in (("a", a), ("b", b), ("c", c)):
        field.write(tmp_path / f"{name}.fits")
    paths = [str(tmp_path / f"{name}.fits") for name in "abc"]
    assert main([*paths, "--floor", "--long", "--output", str(tmp_path / "out"), "--dpi", "30"]) == 0
    out = capsys.readouterr().out
    assert "a − b: differences of motion" in out
    assert "a − c: differences of motion" in out
    assert out.count("Systematic errors") == 2
    assert "3 catalogues in one solution" in out
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"comparison_b.ecsv", "comparison_c.ecsv", "parameters_c.ecsv", "shared_b.png", "shared_c.ecsv"} <= written
    assert {"chain.ecsv", "chain.png"} <= written
    assert fit.storage.read(tmp_path / "out" / "comparison_c.ecsv").shared is not None
    again = ["--config", str(tmp_path / "out" / "run.toml"), "--output", str(tmp_path / "again"), "--format", "none"]
    assert main(again) == 0
    assert "a − c: differences" in capsys.readouterr().out
    assert main([*paths[:2], str(tmp_path / "none.fits")]) == 1
    assert "no such file" in capsys.readouterr().err


@pytest.mark.parametrize("method", ["student", "excess-noise", "bootstrap", "jackknife"])
def test_other_ways_to_errors(method):
    """Each agrees with plain least squares where errors are right; the report says which it was."""
    a, b = two(truth={"R1": 12.0})
    plain, _ = compare_catalogues(a, b, 1)
    other, _ = compare_catalogues(a, b, 1, method=method, replicates=200)
    assert np.abs((other.solution.values - plain.solution.values) / plain.solution.sigma).max() < 1
    assert np.allclose(other.solution.sigma, plain.solution.sigma, rtol=0.5)
    assert f"method         {method}, its formal errors beside" in other.report()
    assert "scaled by residuals" not in other.report()


def test_rotation_or_glide_alone():
    """On few sources the rest, held at zero, takes nothing of it: errors are smaller, and hold."""
    a, b = two(60, truth={"R1": 12.0})
    comparison, _ = compare_catalogues(a, b, 2, parameters="orientation")
    alone = comparison.parameters_alone
    assert list(alone) == ["R1", "R2", "R3"]
    quoted = to_icrf3_terms(comparison.best.coefficients, comparison.best.sigma)
    assert all(alone[name][1] < quoted[name][1] for name in alone)
    assert "These alone, all others held at zero (errors scaled in classes): R1" in comparison.report()
    assert list(compare_catalogues(a, b, 2, parameters="glide")[0].parameters_alone) == ["D1", "D2", "D3"]
    with pytest.raises(ParameterError, match="parameters"):
        compare_catalogues(a, b, 2, parameters="tilt")


def test_commands_of_these(tmp_path, capsys):
    for name, field in zip("ab", sharing(1), strict=True):
        field.write(tmp_path / f"{name}.fits")
    paths = [str(tmp_path / f"{name}.fits") for name in "ab"]
    assert main([*paths, "--parameters", "spin", "--method", "bootstrap=50"]) == 0
    out = capsys.readouterr().out
    assert "These alone" in out
    assert "method         bootstrap" in out
    for method in ("clip=0", "jackknife=4", "bootstrap=9"):
        with pytest.raises(SystemExit):
            main([*paths, "--method", method])
        assert "--method" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("n_skies", [10, pytest.param(200, marks=STUDY)])
def test_rotation_and_glide_with_what_sources_share_hold(n_skies):
    """Of a flat field errors are 1.28 times too large: Gaia's spectrum, with odds of three to one, rises to degree 1."""
    pulls, plain = [], []
    for seed in range(n_skies):
        comparison, _ = compare_catalogues(*sharing(seed), 2, floor=True)
        solution = comparison.shared.together()
        pulls.append(solution.values / solution.sigma)
        first = comparison.solution.modes.degrees == 1
        plain.append(comparison.solution.values[first] / comparison.solution.sigma[first])
    few = 3 / np.sqrt(2 * 6 * n_skies)
    assert 0.78 - few < np.sqrt(np.mean(np.square(pulls))) < 1.1 + few
    assert np.sqrt(np.mean(np.square(plain))) > 2


def test_all_that_are_left_out_are_explained():
    """Far from the robust fit, then clipped: the counts add up to those that the report has."""
    one, two = (read_icrf(real_catalogue(name)) for name in ("icrf3sx.txt", "icrf2-all.txt"))
    comparison, kept = compare_catalogues(one, two, 2)
    notes = "\n".join(map(str, comparison.solution.notes))
    far, pairs = map(int, re.search(r"(\d+) of (\d+) pairs deviate by more than 15 standard errors", notes).groups())
    clipped = int(re.search(r"clipped (\d+) of", notes)[1])
    assert far + clipped == len(comparison.names)
    assert len(kept) + len(comparison.names) == pairs


@pytest.mark.parametrize("method", ["student", "jackknife"])
def test_deformation_by_errors_that_are_estimated_is_no_detection(method):
    """Hotelling's p-value of 12 or fewer degrees of freedom, and not that of χ²: 0.05 came out on 25 to 60 % of skies."""
    p_values = []
    for seed in range(25):
        rng = np.random.default_rng(seed)
        lon, lat = sim.uniform_sky(40, rng)
        name = np.array([f"s{i}" for i in range(40)])
        sigma = 30 * np.exp(0.7 * rng.normal(size=40)) * np.ones((2, 1))
        a, b = (Field(lon, lat, sigma * rng.normal(size=(2, 40)), sigma, name=name) for _ in "ab")
        comparison, _ = compare_catalogues(a, b, 2, method=method, floor=False)
        p_values.append(comparison.deformation_p_value)
        assert np.array_equal(comparison.deformation_p_value_scaled, comparison.deformation_p_value, equal_nan=True)
    assert np.mean(np.array(p_values) < 0.05) < 0.2
    assert np.isfinite(p_values).any() or method == "jackknife"  # twelve blocks do not determine ten coefficients


def test_what_clipping_does_to_errors_is_done_where_they_are_rescaled():
    """The note said so of a fit to which it was not done; an excess noise is that of the errors given."""
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(4000, rng)
    sigma, name = np.full((2, 4000), 50.0), np.arange(4000)
    a, b, c = (Field(lon, lat, s * rng.normal(size=(2, 4000)), sigma, name=name) for s in (57.5, 50.0, 206.0))
    found, _ = compare_catalogues(a, b, 2, threshold=2, floor=False)
    assert found.solution.reduced_chi2 == pytest.approx((57.5**2 + 50**2) / 5000, rel=0.06)
    found, _ = compare_catalogues(c, b, 2, method="excess-noise", threshold=20, floor=False)
    assert any(re.search(r"excess noise: (19|20)\d", note) for note in found.solution.notes)


def with_shared_errors(seed):
    """Two catalogues of one sky, the first with an error of 80 µas of its axes that its covariance has."""
    catalogues = runpy.run_path(str(ROOT / "benchmarks" / "covariance_between_sources.py"))["catalogues"]
    return catalogues(np.random.default_rng([11, seed]))


def test_errors_that_sources_share_are_those_of_the_covariance():
    """Orientation within its errors on 30 skies; without the covariance they are several times too small."""
    pulls, alone = [], []
    for seed in range(30):
        one, two = with_shared_errors(seed)
        comparison, _ = compare_catalogues(one, two, 1, floor=False)
        pulls.append(comparison.best.spin.value / comparison.best.spin.sigma)
        plain, _ = compare_catalogues(replace(one, covariance=None), two, 1, floor=False)
        alone.append(plain.best.spin.value / plain.best.spin.sigma)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.2
    assert np.sqrt(np.mean(np.square(alone))) > 2
    assert "the covariance between sources" in comparison.report()
    with_floor, _ = compare_catalogues(one, two, 1, floor=True)
    assert (with_floor.best.spin.sigma > 0.9 * comparison.best.spin.sigma).all()
    with pytest.raises(ParameterError, match="A has a covariance between them"):
        compare_catalogues(one, two, 1, method="student")
    with pytest.raises(ParameterError, match="the orientation alone .* A has a covariance between them"):
        compare_catalogues(one, two, 1, parameters="orientation")
    with pytest.raises(ParameterError, match="compare two catalogues"):
        fit.chain.combine_frames({"one": one, "two": two, "three": two}, 1)
    order = np.random.default_rng(3).permutation(len(one))
    turned, _ = compare_catalogues(one[order], two, 1, floor=False)
    np.testing.assert_allclose(turned.best.values, comparison.best.values, atol=1e-6)
    np.testing.assert_allclose(turned.best.covariance, comparison.best.covariance, rtol=1e-6, atol=1e-6)
