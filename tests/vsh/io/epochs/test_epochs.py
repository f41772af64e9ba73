"""Epoch astrometry: fields from transits are those of the solution, and of ESA's own package."""

import itertools
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.table import Table, vstack
from conftest import real_catalogue as real

import fit
import sim
from vsh import Field
from vsh.io.catalogue import read_field
from vsh.io.epochs import (
    downweighting_factor,
    iterate_observations,
    make_design_rows,
    read_epochs,
    read_observations,
    solve_epochs,
)
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


def test_share_of_outliers_is_at_most_one():
    with pytest.raises(ParameterError, match="lies between 0 and 1, not at 2"):
        sim.epochs(sim.quasars(3, 1), sim.spin((0.0, 0.0, 0.0)), 4, outliers=2.0)


def test_fields_from_epochs_are_those_of_the_solution(transits):
    """Plain least squares by dense matrices, source by source, from the table's own columns."""
    field = read_epochs(transits, robust=False)
    assert len(field) == 60
    for i in (0, 7, 59):
        mine = transits["source_id"] == field.name[i]
        angle, factor = np.radians(transits["scan_pos_angle"][mine]), transits["parallax_factor_al"][mine]
        at = years_of(transits[mine])
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
        below, above = downweighting_factor(np.array([z - 1e-9, z + 1e-9]))
        assert below == pytest.approx(above, abs=1e-8)
    slope = np.diff(downweighting_factor(np.array([2.999999, 3.0, 3.000001])))
    assert slope[0] == pytest.approx(slope[1], rel=1e-4)


def years_of(table):
    """Times since the reference epoch when light came to the barycentre, (transits, CCDs)."""
    time = np.asarray(table["obs_time_tcb"]) + np.asarray(table["obs_time_bary_corr"])[:, None]
    return time / (365.25 * 86400e9) - 7.5


def flat(table):
    """A row for each CCD of each transit, with the units of the columns."""
    columns = {name: np.asarray(table[name]) for name in table.colnames}
    long = Table({name: np.repeat(each, 9) if each.ndim == 1 else each.ravel() for name, each in columns.items()})
    for name in table.colnames:
        long[name].unit = table[name].unit
    return long


def coloured(table, scatter=0.085, size=3.0, seed=6):
    """Epochs of sources whose effective wavenumbers are not what they were taken for, and what they are off by."""
    rng = np.random.default_rng(seed)
    table, names = table.copy(), np.unique(table["source_id"])
    correction = scatter * rng.standard_normal(len(names))
    # A factor of each field of view that drifts, and one of each CCD. [mas µm]
    shape = np.shape(table["centroid_pos_al"])
    view = np.where((np.asarray(table["transit_id"]) >> 15) & 1, -1.0, 1.0)[:, None]
    factor = size * (0.5 * view + rng.normal(0, 0.7, (1, shape[1])) + rng.normal(0, 0.5, (shape[0], 1)))
    table["colour_factor_al"] = factor
    shift = factor * correction[np.searchsorted(names, table["source_id"])][:, None]
    table["centroid_pos_al"] = np.asarray(table["centroid_pos_al"]) - shift
    return table, correction


def test_pseudocolour_is_a_sixth_parameter_with_a_prior(transits):
    """Dense matrices, with the prior as one more observation; and zeros for factors change nothing."""
    table, _ = coloured(transits)
    seen = read_observations(table)
    solution = solve_epochs(seen.source, seen.design, seen.position, seen.error, colour=seen.colour, robust=False)
    for i in (0, 7, 59):
        mine = seen.source == i
        rows = np.vstack([seen.design[:, mine], -seen.colour[mine]]).T / seen.error[mine, None]
        rows = np.vstack([rows, [0, 0, 0, 0, 0, 1 / 0.085]])
        values = np.append(seen.position[mine] / seen.error[mine], 0.0)
        inverse = np.linalg.inv(rows.T @ rows)
        x = inverse @ rows.T @ values
        np.testing.assert_allclose(solution.values[i], x[:5], atol=1e-8 * np.abs(x[:5]).max())
        np.testing.assert_allclose(solution.covariance[i], inverse[:5, :5], rtol=1e-8)
        assert solution.pseudocolour[i] == pytest.approx(x[5], rel=1e-6)
        assert solution.pseudocolour_error[i] == pytest.approx(np.sqrt(inverse[5, 5]), rel=1e-8)
    table["colour_factor_al"] = 0.0
    np.testing.assert_array_equal(read_epochs(table).motion, read_epochs(table, pseudocolour=False).motion)
    table["colour_factor_al"] = np.nan  # null in every row, as of a source without a colour
    assert read_observations(table).colour is None
    averaged = read_observations(coloured(transits)[0]).by_transit()
    assert averaged.colour.shape == averaged.position.shape


def test_errors_with_colours_that_are_off(transits):
    """Pulls of motions where wavenumbers are off by what is expected of them: with a pseudocolour as they should be."""
    truth = sim.spin((100.0, 0.0, 0.0)) + sim.acceleration((0.0, 50.0, 0.0))
    table, correction = coloured(transits, size=60.0)
    with_colour, without = (read_epochs(table, robust=False, pseudocolour=each) for each in (True, False))
    pulls = [each.minus(truth(each.lon, each.lat)).whitened.std() for each in (with_colour, without)]
    assert 0.85 < pulls[0] < 1.15
    assert pulls[1] > 1.5
    seen = read_observations(table)
    solution = solve_epochs(seen.source, seen.design, seen.position, seen.error, colour=seen.colour)
    assert 0.8 < np.std((solution.pseudocolour - correction) / solution.pseudocolour_error) < 1.2
    assert any("pseudocolour of each source, prior ± 0.085" in note for note in with_colour.notes)


def gaiasupdate(monkeypatch, name):
    # It imports astroquery, which asks ESA's archive at once; nothing of that is needed here.
    archive = SimpleNamespace(GaiaClass=None, Gaia=None)
    monkeypatch.setitem(sys.modules, "astroquery", SimpleNamespace(gaia=archive))
    monkeypatch.setitem(sys.modules, "astroquery.gaia", archive)
    return pytest.importorskip(f"gaiasupdate.{name}", reason="gaiasupdate is not installed: make test-oracles")


#: Where the two sources of ESA's files are is in none of them; any place gives the same motions.
PLACES = Table({"source_id": np.array([0, 1, 2], np.int64), "ra": [30.0, 10.0, 20.0], "dec": [7.0, 5.0, 6.0]})


def test_solution_of_dr4_is_that_of_dpac():
    """DPAC's own solution of a source from the file of its epochs, by flags and excess noise as AGIS used them."""
    (dpac,) = Table.read(real("esa_epochs/1_archive_source_update_results.parquet"))
    field = read_epochs(real("esa_epochs/1_archive_epoch_astro.parquet"), positions=PLACES)
    error = np.array([dpac["muAlphaStarError"], dpac["muDeltaError"]])
    off = np.array([field.pmra[0] - dpac["muAlphaStar"], field.pmdec[0] - dpac["muDelta"]]) / error
    assert np.abs(off).max() < 1e-3
    np.testing.assert_allclose([field.pmra_error[0], field.pmdec_error[0]], error, rtol=1e-3)
    anew = read_epochs(real("esa_epochs/1_archive_epoch_astro.parquet"), positions=PLACES, robust=True)
    assert abs(anew.pmra[0] - dpac["muAlphaStar"]) > 0.5 * error[0]  # which is what other weights change


@pytest.mark.parametrize("name", [
    "EPOCH_ASTROMETRY-Gaia DR4_INT2 1.csv", "EPOCH_ASTROMETRY-Gaia DR4_INT2 1.ecsv",
    "EPOCH_ASTROMETRY-Gaia DR4_INT2 1.votplain.xml", "EPOCH_ASTROMETRY-Gaia DR4_INT2 1.xml", "1_epoch_astrometry.parquet",
])  # fmt: skip
def test_every_format_of_the_archive_gives_one_solution(name):
    """The CSV has two columns of one name, the internal Parquet file names in camel case."""
    reference = read_epochs(real("esa_epochs/EPOCH_ASTROMETRY-Gaia DR4_INT2 1.fits"), positions=PLACES)
    field = read_epochs(real(f"esa_epochs/{name}"), positions=PLACES)
    np.testing.assert_allclose(field.motion, reference.motion, rtol=1e-9)
    np.testing.assert_allclose(field.sigma, reference.sigma, rtol=1e-7)


def test_weights_of_epochs(transits):
    """Without a column of excess noise the weights are estimated anew, and a note says so; null is no noise."""
    table = transits.copy()
    table["agis_source_excess_noise"] = 3.0  # mas
    own, plain = read_epochs(table), read_epochs(transits, robust=False)
    assert (own.sigma > plain.sigma).all()
    assert any("weights as AGIS had them" in note for note in own.notes)
    table["agis_source_excess_noise"] = np.ma.MaskedArray(np.full(len(table), 3.0), True)
    assert any("no column agis_source_excess_noise" in note for note in read_epochs(table).notes)
    del table["agis_source_excess_noise"]
    np.testing.assert_array_equal(read_epochs(table).motion, read_epochs(table, robust=True).motion)


@pytest.mark.parametrize("has_colour", [False, True], ids=["five", "six"])
def test_against_gaiasupdate(with_outliers, monkeypatch, has_colour):
    """ESA's own package, with its weights, excess noise and prior: parameters to 1e-3 σ, errors to 1e-3."""
    solver = gaiasupdate(monkeypatch, "solver")
    table = coloured(with_outliers)[0] if has_colour else with_outliers
    field = read_epochs(table, robust=True)
    noisy = 0
    for i in range(len(field)):
        mine = table["source_id"] == field.name[i]
        time = years_of(table[mine])
        angle = np.repeat(np.radians(table["scan_pos_angle"][mine]), 9)
        factor = np.repeat(np.asarray(table["parallax_factor_al"][mine]), 9)
        design = make_design_rows(angle, factor, time.ravel()).T
        options = {}
        if has_colour:  # theirs is per nm
            design = np.column_stack([design, -1e3 * np.asarray(table["colour_factor_al"][mine]).ravel()])
            options = {"gaussian_priors": np.array([None] * 5 + [0.085e-3])}
        equations = solver.DesignEquation({
            "design_matrix_coefficients": design,
            "dependent_variable": np.asarray(table["centroid_pos_al"][mine]).ravel(),
            "dependent_variable_error": np.asarray(table["centroid_pos_error_al"][mine]).ravel(),
            **options,
        })  # fmt: skip
        found = equations.solve("agis")
        sigma = 1000 * found["parameters_formal_uncertainty"][3:5]
        assert np.abs(field.motion[:, i] - 1000 * found["parameters"][3:5]).max() < 1e-3 * sigma.min()
        np.testing.assert_allclose(field.sigma[:, i], sigma, rtol=1e-3)
        noisy += found["excess_noise"] > 0
    assert noisy > 3


def test_tables_of_the_archive_against_gaiasupdate(monkeypatch):
    """Its way from a table of the archive, with the sign and unit of the colour factor and the bits of its own."""
    module = gaiasupdate(monkeypatch, "epoch_astrometry")
    pandas = pytest.importorskip("pandas")
    population = sim.quasars(3, np.random.default_rng(5), max_magnitude=20.0)
    table, _ = coloured(sim.epochs(population, sim.spin((0.0, 0.0, 0.0)), 4, complete=True), size=60.0)
    frame = pandas.DataFrame({
        name: list(np.asarray(table[name])) if np.ndim(table[name]) > 1 else np.asarray(table[name])
        for name in table.colnames
    })  # fmt: skip
    for anew, (i, name) in itertools.product((False, True), enumerate(np.unique(table["source_id"]))):
        field = read_epochs(table, robust=True if anew else None)
        found = module.GaiaEpochAstrometryArchive.supdate(
            frame[frame["source_id"] == name], name, compute_excess_noise=anew
        )
        sigma = 1000 * found["parameters_formal_uncertainty"][3:5]
        assert np.abs(field.motion[:, i] - 1000 * np.asarray(found["parameters"][3:5])).max() < 1e-3 * sigma.min()
        np.testing.assert_allclose(field.sigma[:, i], sigma, rtol=1e-3)


def test_files_and_flat_tables(transits, tmp_path):
    transits.write(tmp_path / "epochs.fits")
    field = read_epochs(tmp_path / "epochs.fits")
    np.testing.assert_array_equal(field.motion, read_epochs(transits).motion)
    flat(transits).write(tmp_path / "flat.ecsv")
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


def test_a_batch_without_observations_is_passed_over(transits, tmp_path):
    """The archive has epochs of a few sources of a list: a batch of none ended vsh-waves."""
    transits[:0].write(tmp_path / "a.vot", format="votable")
    with pytest.raises(EmptyFieldError, match="no observation can be used"):
        list(iterate_observations(tmp_path))
    transits.write(tmp_path / "b.vot", format="votable")
    (found,) = iterate_observations(tmp_path)
    assert len(found.time) == len(read_observations(transits).by_transit().time)


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
    row = make_design_rows(rng.uniform(0, 6, 44), rng.uniform(-1, 1, 44), rng.uniform(-2, 2, 44))
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


@pytest.mark.parametrize("value", [0, -99, np.iinfo(np.int64).min, 10**19 // 2])
def test_times_that_stand_for_none_are_left_out(transits, value):
    """Integers of FITS have no nan: such a time was used, and moved a motion by a tenth of its error."""
    wrong = transits.copy()
    times = np.array(wrong["obs_time_tcb"])
    times[5] = value
    wrong["obs_time_tcb"] = times
    found, whole = read_observations(wrong), read_observations(transits)
    assert len(found.time) < len(whole.time)
    assert found.time.min() == pytest.approx(whole.time.min(), abs=0.3)
    assert found.time.max() == pytest.approx(whole.time.max(), abs=0.3)
    assert "without a position, an error or a time" in " ".join(map(str, found.notes))


def test_observations_that_stand_twice_are_said_where_rows_are_observations(transits):
    once = flat(transits[:40])
    assert not any("twice" in str(note) for note in read_observations(once).notes)
    notes = read_observations(vstack([once, once])).notes
    assert any("360 observations stand in the table twice" in str(note) for note in notes)


def test_fields_of_view_are_solved_apart(transits):
    """Their normal equations add up to those of all; sources without an observation there are counted."""
    whole = read_observations(transits)
    halves = [whole.select(f"field of view {number}") for number in (1, 2)]
    assert sum(len(half.time) for half in halves) == len(whole.time)
    solutions = [solve_epochs(x.source, x.design, x.position, x.error, robust=False) for x in (whole, *halves)]
    inverse = [np.linalg.inv(solution.covariance) for solution in solutions]
    np.testing.assert_allclose(inverse[1] + inverse[2], inverse[0], rtol=1e-6, atol=1e-9 * np.abs(inverse[0]).max())
    weighted = [np.einsum("nij,nj->ni", n, s.values) for n, s in zip(inverse, solutions, strict=True)]
    np.testing.assert_allclose(weighted[1] + weighted[2], weighted[0], atol=1e-7 * np.abs(weighted[0]).max())
    first = transits[(np.asarray(transits["transit_id"]) >> 15 & 3 == 0) | (np.asarray(transits["source_id"]) > 2)]
    field = read_epochs(first, where="field of view 2")
    assert len(field) == 58
    assert any("2 sources have none" in note for note in field.notes)


def test_rows_of_ccds_are_solved_apart(transits):
    """All seven have observations, each once; a row that is off moves its own motions alone."""
    whole = read_observations(transits)
    rows = [whole.select(f"CCD row {number}") for number in range(1, 8)]
    assert sum(len(each.time) for each in rows) == len(whole.time)
    assert min(len(each.time) for each in rows) > 0.05 * len(whole.time)
    table, years = transits.copy(), np.asarray(transits["obs_time_tcb"]) / (365.25 * 86400e9) - 7.5
    is_third = (np.asarray(table["transit_id"]) >> 12) & 7 == 3
    table["centroid_pos_al"] = table["centroid_pos_al"] + is_third[:, None] * years  # 1 mas/yr along every scan
    third, fourth = (read_epochs(table, where=f"CCD row {number}", on_bad="drop") for number in (3, 4))
    before, same = (read_epochs(transits, where=f"CCD row {number}", on_bad="drop") for number in (3, 4))
    np.testing.assert_array_equal(fourth.motion, same.motion)
    assert np.abs(third.motion - before.motion).max() > 100
    table["transit_id"] = np.asarray(table["transit_id"]) & ~(7 << 12)
    with pytest.raises(TableError, match="no transit_id tells the CCD row"):
        read_epochs(table, where="CCD row 3")


def test_basic_angle_that_differs_by_the_field_of_view_is_found(transits):
    """Every star seems to move along the equator in one field alone, as by an angle that drifts."""
    table = transits.copy()
    is_first = (np.asarray(table["transit_id"]) >> 15) & 3 == 0
    angle, years = np.radians(table["scan_pos_angle"]), np.asarray(table["obs_time_tcb"]) / (365.25 * 86400e9) - 7.5
    spin = sim.spin((0.0, 0.0, 400.0))
    motion = spin(np.radians(table["ra0"]), np.radians(table["dec0"])) / 1000  # mas/yr
    shift = (motion[0] * np.sin(angle) + motion[1] * np.cos(angle))[:, None] * years
    table["centroid_pos_al"] = table["centroid_pos_al"] + is_first[:, None] * shift

    def spin_of(epochs):
        one, two = (read_epochs(epochs, where=f"field of view {number}") for number in (1, 2))
        sigma = np.hypot(one.sigma, two.sigma)
        return fit.fit_field(Field(one.lon, one.lat, one.motion - two.motion, sigma), 1).spin

    found, without = spin_of(table), spin_of(transits)
    assert abs(found.value[2] - 400) < 3 * found.sigma[2]
    assert found.p_value < 1e-4
    assert without.p_value > 0.0027


def test_epochs_in_place_of_motions_are_solved(transits, tmp_path):
    """`read_field`, and so every command, takes epochs as `read_epochs` does."""
    transits.write(tmp_path / "epochs.fits")
    for where in (None, "field of view 2"):
        field, expected = read_field(tmp_path / "epochs.fits", where=where), read_epochs(transits, where=where)
        assert field.name.tolist() == expected.name.tolist()
        np.testing.assert_allclose(field.motion, expected.motion, rtol=1e-9)
        np.testing.assert_allclose(field.sigma, expected.sigma, rtol=1e-9)
        assert any("epoch astrometry, solved" in note for note in field.notes)
    for wrong in ({"frame": "galactic"}, {"sigma": 1.0}, {"columns": "vizier"}, {"units": {"ra0": "deg"}}):
        with pytest.raises(TableError, match=f"leave out.*{'' if 'columns' in wrong else next(iter(wrong))}"):
            read_field(transits, **wrong)
    with pytest.raises(ParameterError, match="field of view 1"):
        read_field(transits, where="g_mag < 19")
    positions, bare = Table({"source_id": field.name, "ra": field.ra, "dec": field.dec}), transits.copy()
    bare.remove_columns(["ra0", "dec0"])
    with pytest.raises(TableError, match="positions=…"):
        read_field(bare)
    read_epochs(bare, positions=positions).write(tmp_path / "motions.fits")  # the remedy
    assert len(read_field(tmp_path / "motions.fits")) == len(field)


def test_fields_of_view_that_nothing_tells(transits):
    bare = transits.copy()
    bare.remove_column("transit_id")
    with pytest.raises(TableError, match="no transit_id"):
        read_epochs(bare, where="field of view 1")
    with pytest.raises(ParameterError, match="field of view 3"):
        read_epochs(transits, where="field of view 3")
