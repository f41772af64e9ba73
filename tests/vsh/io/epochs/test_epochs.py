"""Epoch astrometry: fields from transits are those of the solution, and of ESA's own package."""

import sys
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.table import Table

import sim
from vsh.io.epochs import design_row, downweight, read_epochs, read_observations, solve_epochs
from vsh.tools.errors import EmptyFieldError, FieldError, ParameterError, TableError


@pytest.fixture(scope="module")
def transits():
    rng = np.random.default_rng(2)
    population = sim.quasars(60, rng, max_magnitude=20.5)
    return sim.epochs(population, sim.spin((100.0, 0.0, 0.0)) + sim.acceleration((0.0, 50.0, 0.0)), 3)


@pytest.fixture(scope="module")
def with_outliers():
    population = sim.quasars(12, np.random.default_rng(5), max_magnitude=20.5)
    return sim.epochs(population, sim.spin((0.0, 0.0, 0.0)), 4, outliers=0.05)


def test_fields_from_epochs_are_those_of_the_solution(transits):
    """Plain least squares by dense matrices, source by source, from the table's own columns."""
    field = read_epochs(transits, robust=False)
    assert len(field) == 60
    for i in (0, 7, 59):
        mine = transits["source_id"] == field.name[i]
        angle, factor = np.radians(transits["scan_pos_angle"][mine]), transits["parallax_factor_al"][mine]
        at = (
            np.asarray(transits["obs_time_tcb"][mine]) + np.asarray(transits["obs_time_bary_corr"][mine])[:, None]
        ) / (365.25 * 86400e9) - 7.5
        rows, values = [], []
        for ccd in range(9):
            sin, cos, t = np.sin(angle), np.cos(angle), at[:, ccd]
            rows.append(np.stack([sin, cos, factor, t * sin, t * cos], axis=1))
            values.append(transits["centroid_pos_al"][mine][:, ccd])
        sigma = transits["centroid_pos_error_al"][mine][0, 0]
        a, y = np.concatenate(rows), np.concatenate(values)
        found = np.linalg.lstsq(a, y, rcond=None)[0][3:] * 1000
        error = sigma * 1000 * np.sqrt(np.diag(np.linalg.inv(a.T @ a))[3:])
        assert np.abs(field.motion[:, i] - found).max() < 1e-6 * error.min()
        np.testing.assert_allclose(field.sigma[:, i], error, rtol=1e-9)


def test_errors_are_those_of_the_mission(transits):
    """Pulls of 120 motions, and formal errors like those of sim.observe on the same sky."""
    population = sim.quasars(60, np.random.default_rng(2), max_magnitude=20.5)
    truth = (sim.spin((100.0, 0.0, 0.0)) + sim.acceleration((0.0, 50.0, 0.0)))(population.lon, population.lat)
    for robust, low, high in ((False, 0.85, 1.15), (True, 0.85, 1.2)):
        field = read_epochs(transits, robust=robust)
        pulls = field.minus(truth).whitened
        assert low < pulls.std() < high
    law = sim.NominalScanningLaw(years=5.5, rng=np.random.default_rng(3).spawn(2)[1])
    formal, _ = sim.expected_covariances(population, sim.Mission(law, "DR4"))
    np.testing.assert_allclose(read_epochs(transits, robust=False).sigma[0], np.sqrt(formal[:, 0, 0]), rtol=1e-6)


@pytest.mark.parametrize(("first", "second"), [(0, 1), (1, 2), (1, 0), (2, 3)])
def test_field_of_view_is_decided_by_times_between_transits(transits, first, second):
    """Whatever codes the fields have, the preceding one sees a source 106.5 minutes before the following one."""
    plain = read_observations(transits)
    assert set(plain.view) == {1, -1}
    other = transits.copy()
    number = np.asarray(other["transit_id"])
    preceding = (number >> 15) & 3 == 0  # as the simulation numbers them
    per_transit = len(plain.view) // len(number)
    np.testing.assert_array_equal(plain.view, np.repeat(np.where(preceding, 1, -1), per_transit))
    code = np.where(preceding, first, second)
    other["transit_id"] = (number & ~(3 << 15)) | (code << 15)
    coded = read_observations(other)
    np.testing.assert_array_equal(coded.view, plain.view)
    assert any(f"code {first} of transit_id is the preceding one, by " in note for note in coded.notes)


@pytest.mark.parametrize(("codes", "view", "words"), [
    ((0,), 1, "taken as the preceding one"),
    ((2,), -1, "taken as the following one"),
    ((1,), None, "the preceding field of view by one numbering and the following one by another"),
    ((0, 1), (1, -1), "as in the epochs of Gaia BH3"),
    ((1, 2), (1, -1), "as in the draft of DR4's data model"),
    ((0, 1, 2), None, "more than there are fields of view"),
])  # fmt: skip
def test_field_of_view_without_pairs_of_transits(transits, codes, view, words):
    one = transits[:12].copy()
    one["obs_time_tcb"] = one["obs_time_tcb"][:1] + (np.arange(12) * 86400e9 * 17).astype(np.int64)[:, None]
    code = np.array(codes)[np.arange(12) % len(codes)]
    one["transit_id"] = (np.arange(10, 22) << 17) | (code << 15) | 5
    read = read_observations(one)
    assert any(words in note for note in read.notes)
    if view is None:
        assert read.view is None
    else:
        expected = np.broadcast_to(view, 1) if np.ndim(view) == 0 else np.array(view)[np.arange(12) % 2]
        assert set(read.view) == set(np.ravel(expected))


def test_field_of_view_that_contradicts_the_times_is_not_taken(transits):
    other = transits.copy()
    code = np.random.default_rng(1).integers(0, 2, len(other))
    other["transit_id"] = (np.asarray(other["transit_id"]) & ~(3 << 15)) | (code << 15)
    read = read_observations(other)
    assert read.view is None
    assert any("contradicts the times between transits" in note for note in read.notes)


def test_excess_noise_is_found():
    """What scatters beyond the errors: the column says it, and a robust solution finds it source by source."""
    population, excess = sim.quasars(20, 1), np.repeat([0.0, 4000.0], 10)
    table = sim.epochs(population, sim.spin((0.0, 0.0, 0.0)), 4, excess_noise=excess)
    per_source = [table["agis_source_excess_noise"][table["source_id"] == k + 1][0] for k in range(20)]
    np.testing.assert_allclose(per_source, excess / 1000)
    seen = read_observations(table)
    found = solve_epochs(seen.source, seen.design, seen.position, seen.error).excess_noise
    assert np.all(found[10:] > 3000)
    assert np.median(found[:10]) < 1000
    assert np.median(found[10:]) == pytest.approx(4000, rel=0.12)  # AGIS weighs down what scatters most
    with pytest.raises(ParameterError, match="2 excess noises are below zero"):
        sim.epochs(population, sim.spin((0.0, 0.0, 0.0)), 4, excess_noise=np.repeat([0.0, -1.0], [18, 2]))


def test_outliers_have_less_weight(with_outliers):
    robust, plain = (read_epochs(with_outliers, robust=each) for each in (True, False))
    assert np.sqrt(np.mean(robust.motion**2)) < np.sqrt(np.mean(plain.motion**2))
    assert any("have a weight below 0.2" in note for note in robust.notes)


def test_weights_join_smoothly():
    for z in (2.0, 3.0):
        below, above = downweight(np.array([z - 1e-9, z + 1e-9]))
        assert below == pytest.approx(above, abs=1e-8)
    slope = np.diff(downweight(np.array([2.999999, 3.0, 3.000001])))
    assert slope[0] == pytest.approx(slope[1], rel=1e-4)


def test_against_gaiasupdate(with_outliers, monkeypatch):
    """ESA's own package, with its weights and excess noise: parameters to 1e-3 σ, errors to 1e-3."""
    # It imports astroquery, which asks ESA's archive at once; nothing of that is needed here.
    archive = SimpleNamespace(GaiaClass=None, Gaia=None)
    monkeypatch.setitem(sys.modules, "astroquery", SimpleNamespace(gaia=archive))
    monkeypatch.setitem(sys.modules, "astroquery.gaia", archive)
    solver = pytest.importorskip("gaiasupdate.solver", reason="gaiasupdate is not installed: make test-oracles")
    field = read_epochs(with_outliers)
    noisy = 0
    for i in range(len(field)):
        mine = with_outliers["source_id"] == field.name[i]
        time = (
            np.asarray(with_outliers["obs_time_tcb"][mine])
            + np.asarray(with_outliers["obs_time_bary_corr"][mine])[:, None]
        ) / (365.25 * 86400e9) - 7.5
        angle = np.repeat(np.radians(with_outliers["scan_pos_angle"][mine]), 9)
        factor = np.repeat(np.asarray(with_outliers["parallax_factor_al"][mine]), 9)
        equations = solver.DesignEquation({
            "design_matrix_coefficients": design_row(angle, factor, time.ravel()).T,
            "dependent_variable": np.asarray(with_outliers["centroid_pos_al"][mine]).ravel(),
            "dependent_variable_error": np.asarray(with_outliers["centroid_pos_error_al"][mine]).ravel(),
        })  # fmt: skip
        found = equations.solve("agis")
        sigma = 1000 * found["parameters_formal_uncertainty"][3:]
        assert np.abs(field.motion[:, i] - 1000 * found["parameters"][3:]).max() < 1e-3 * sigma.min()
        np.testing.assert_allclose(field.sigma[:, i], sigma, rtol=1e-3)
        noisy += found["excess_noise"] > 0
    assert noisy > 3


def test_files_and_flat_tables(transits, tmp_path):
    transits.write(tmp_path / "epochs.fits")
    field = read_epochs(tmp_path / "epochs.fits")
    np.testing.assert_array_equal(field.motion, read_epochs(transits).motion)
    flat = Table({
        name: np.repeat(np.asarray(transits[name]), 9) if transits[name].ndim == 1 else np.asarray(transits[name]).ravel()
        for name in transits.colnames
    })  # fmt: skip
    flat.write(tmp_path / "flat.ecsv")
    np.testing.assert_allclose(read_epochs(tmp_path / "flat.ecsv").motion, field.motion, rtol=1e-9)


def test_observations_that_are_not_used_are_counted(transits):
    changed = transits.copy()
    used = np.ones((len(changed), 9), bool)
    used[:10] = False
    changed["used_by_agis_al"] = used
    changed["centroid_pos_al"][20, 3] = np.nan
    field = read_epochs(changed)
    (note,) = [note for note in field.notes if note.startswith("observations:")]
    assert "not used by AGIS: 90" in note
    assert "without a position, an error or a time: 1" in note
    assert not np.array_equal(field.motion, read_epochs(transits).motion)


def test_epochs_that_cannot_be_solved(transits):
    with pytest.raises(TableError, match="no column 'scan_pos_angle'"):
        read_epochs({name: transits[name] for name in transits.colnames if name != "scan_pos_angle"})
    one = transits[np.flatnonzero(transits["source_id"] == 2)[:1]]  # nine observations in one direction
    rest = transits[transits["source_id"] != 2]
    both = Table({name: np.concatenate([np.asarray(one[name]), np.asarray(rest[name])]) for name in transits.colnames})
    with pytest.raises(FieldError, match="1 of 60 rows cannot be used: scans in too few directions: 1"):
        read_epochs(both)
    field = read_epochs(both, on_bad="drop")
    assert len(field) == 59
    assert 2 not in field.name
    nothing = both.copy()
    nothing["centroid_pos_al"] = np.nan
    with pytest.raises(EmptyFieldError, match="no observation can be used"):
        read_epochs(nothing)


def test_reference_epoch_changes_no_motion(transits):
    one, two = read_epochs(transits, robust=False), read_epochs(transits, robust=False, epoch=2016.0)
    np.testing.assert_allclose(one.motion, two.motion, atol=1e-6 * one.sigma.min())


def test_solution_says_what_it_is():
    rng = np.random.default_rng(1)
    source = np.repeat([0, 1], [40, 4])
    row = design_row(rng.uniform(0, 6, 44), rng.uniform(-1, 1, 44), rng.uniform(-2, 2, 44))
    found = solve_epochs(source, row, rng.normal(size=44), np.ones(44))
    assert found.solved.tolist() == [True, False]
    assert found.observations.tolist() == [40, 4]
    assert np.isnan(found.values[1]).all()


def test_units_are_turned(transits):
    """A column in another unit gives the same motions; one of another kind is refused."""
    plain = read_epochs(transits, robust=False)
    changed = transits.copy()
    changed["centroid_pos_al"] = changed["centroid_pos_al"].to("uas")
    changed["centroid_pos_error_al"] = changed["centroid_pos_error_al"].to("uas")
    changed["scan_pos_angle"] = changed["scan_pos_angle"].to("rad")
    changed["obs_time_bary_corr"] = changed["obs_time_bary_corr"].to("s")
    found = read_epochs(changed, robust=False)
    np.testing.assert_allclose(found.motion, plain.motion, rtol=1e-6, atol=1e-6 * plain.sigma.min())
    changed["scan_pos_angle"].unit = "mag"
    with pytest.raises(TableError, match="column 'scan_pos_angle' is in 'mag'"):
        read_epochs(changed)


def test_doubtful_epochs_are_noted(transits):
    twice = Table({name: np.concatenate([np.asarray(transits[name])] * 2) for name in transits.colnames})
    assert f"warning: {len(transits)} transits stand in the table twice and count as two" in read_epochs(twice).notes
    bare = transits.copy()
    bare.remove_column("obs_time_bary_corr")
    assert any("no column obs_time_bary_corr" in note for note in read_epochs(bare).notes)
