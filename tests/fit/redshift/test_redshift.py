import re
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from conftest import few_or_many, random_field, real_catalogue

import fit
import sim
from fit.commands.redshift import main
from fit.redshift import binned, equal_information_edges, permutation_test
from fit.redshift._solution import find_equality_chi2, find_slope_chi2, make_shared_flow
from vsh import Field, Modes, Vector
from vsh.basis import harmonics
from vsh.io import catalogue
from vsh.models.cosmology import BACHCHAN_2016, CMB_VELOCITY_PLANCK18, transverse_distance
from vsh.models.covariance import Spectrum
from vsh.models.flows import LINEAR_PLANCK18 as THEORY
from vsh.tools.errors import DegeneracyError, FieldError, ParameterError
from vsh.tools.units import AU_PER_YEAR

EDGES = [0.001, 0.005, 0.01, 0.03]


def quasars(n, seed, truth=None, edges=(0.1, 4.0), frame="icrs"):
    """Motions whose errors are as stated, at redshifts that tell nothing of them."""
    rng = np.random.default_rng([seed, 5])
    lon, lat = sim.uniform_sky(n, rng)
    population = sim.population.Population(lon, lat, redshift=rng.uniform(*edges, n), frame=frame)
    sigma, rho = 10 ** rng.uniform(0, 1, (2, n)), rng.uniform(-0.9, 0.9, n)
    return sim.observe(population, truth or sim.spin((0, 0, 0)), rng, sigma=sigma, rho=rho)


def test_each_bin_is_a_fit_of_its_own():
    field, edges = quasars(2000, 1), [0.1, 1.0, 2.0, 4.0]
    found = binned(field, 3, edges, flows=None, method="least-squares")
    for (low, high), normal, solution in zip(pairwise(edges), found.normals, found.solutions, strict=True):
        inside = field[(field.redshift >= low) & (field.redshift < high)]
        equations = fit.normal_equations(inside, Modes(3))
        np.testing.assert_allclose(normal.matrix, equations.matrix, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(normal.rhs, equations.rhs, rtol=1e-10, atol=1e-10)
        np.testing.assert_allclose(solution.values, fit.solve(equations).values, rtol=1e-7)
        np.testing.assert_allclose(solution.covariance, fit.solve(equations).covariance, rtol=1e-7)
    assert [normal.n_data for normal in found.normals] == [2 * count for count in found.counts]
    assert found.modes == Modes(3)


def test_one_pass_over_a_stream():
    field, options = quasars(900, 2), {"modes": 1, "edges": [0.1, 2.0, 4.0], "flows": None, "method": "least-squares"}
    whole, streamed = binned(field, **options), binned(iter([field[:500], field[500:]]), **options)
    np.testing.assert_allclose(whole.covariance, streamed.covariance, rtol=1e-10)
    np.testing.assert_allclose(whole.redshift, streamed.redshift)
    with pytest.raises(ParameterError, match="the whole field"):
        binned(iter([field]), 1, 3)


def test_bins_of_equal_information():
    field = quasars(5000, 3)
    edges = equal_information_edges(field, 4)
    weight = field.weights[:2].sum(0)
    shares = [weight[(field.redshift >= a) & (field.redshift < b)].sum() for a, b in pairwise(edges)]
    np.testing.assert_allclose(shares, weight.sum() / 4, rtol=0.05)
    assert binned(field, 1, 4).counts.sum() == 5000


def test_higher_degrees_in_common_are_one_fit():
    """The joint system against a design matrix written out."""
    field = quasars(400, 4)
    edges = [0.1, 2.0, 4.0]
    found = binned(field, 2, edges, shared_higher_degrees=True, flows=None, method="least-squares")
    modes = Modes(2)
    rows = harmonics(field.lon, field.lat, modes)
    own = [i for i, mode in enumerate(modes) if mode.l == 1]
    rest = [i for i, mode in enumerate(modes) if mode.l == 2]
    second = field.redshift >= 2.0
    design = np.concatenate([rows[own] * ~second, rows[own] * second, rows[rest]])
    a, b, c = field.weights
    weighted = np.stack([a * design[:, 0] + c * design[:, 1], c * design[:, 0] + b * design[:, 1]], axis=1)
    normal = np.einsum("ikn,jkn->ij", design, weighted)
    theta = np.linalg.solve(normal, np.einsum("ikn,kn->i", weighted, field.motion))
    np.testing.assert_allclose(found.covariance, np.linalg.inv(normal)[:12, :12], rtol=1e-8, atol=1e-12)
    np.testing.assert_allclose(found.solutions[0].coefficients.values[own], theta[:6], rtol=1e-8)
    np.testing.assert_allclose(found.solutions[1].coefficients.values[own], theta[6:12], rtol=1e-8)
    for solution in found.solutions:
        np.testing.assert_allclose(solution.coefficients.values[rest], theta[12:], rtol=1e-8)
    residual = field.motion - np.einsum("i,ikn->kn", theta, design)
    chi2 = field._derive(motion=residual).chi2
    assert found.solutions[0].chi2 == pytest.approx(chi2[~second].sum())


@pytest.mark.slow
@few_or_many(14, 100)
@pytest.mark.parametrize("shared", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_equality_and_trend_are_chi2_where_nothing_changes(shared, n_skies):
    tests = []
    for seed in range(n_skies):
        field = quasars(300, seed, sim.acceleration((3, 0, 0)) + sim.spin((0, 5, 0)))
        found = binned(field, 2, [0.1, 1.0, 2.0, 4.0], shared_higher_degrees=shared)
        trend = found.trend()
        tests.append([found.equality(), found.equality("S", 1), trend.test, trend.misfit])
    for each in zip(*tests, strict=True):
        dof = each[0].dof
        chi2 = np.array([test.chi2 for test in each])
        assert chi2.mean() == pytest.approx(dof, abs=4 * np.sqrt(2 * dof / n_skies))
        p = np.array([test.p_value for test in each])
        assert abs(p.mean() - 0.5) < 4 * np.sqrt(1 / 12 / n_skies)


def test_secular_parallax_is_found_by_the_trend_and_not_by_equality_alone():
    velocity = Vector([4000.0, 0, 0], np.zeros((3, 3)), unit="km/s")
    population = sim.galaxies(30_000, rng=1)
    field = sim.observe(
        population, sim.secular_parallax(velocity.value) + sim.acceleration((0, 5, 0)), rng=2, sigma=20.0
    )
    found = binned(field, 1, EDGES)
    assert found.equality("S", 1).p_value < 1e-6
    assert found.equality("T", 1).p_value > 1e-3
    slope = found.trend(found.mean_inverse_distance).acceleration
    np.testing.assert_allclose(-slope.value * AU_PER_YEAR, velocity.value, atol=6 * AU_PER_YEAR * slope.sigma.max())
    acceleration, test = found.secular_parallax(velocity)
    assert test.p_value > 1e-3
    np.testing.assert_allclose(acceleration.value, (0, 5, 0), atol=4 * acceleration.sigma.max())
    assert found.secular_parallax(BACHCHAN_2016)[1].p_value < 1e-6


def test_trend_of_one_component_is_that_component():
    def growing(lon, lat, z):
        return sim.acceleration((0, 0, 7.0))(lon, lat) * z

    field = quasars(4000, 7, growing)
    trend = binned(field, 1, 5).trend()
    pull = (trend.acceleration.value - [0, 0, 7.0]) / trend.acceleration.sigma
    assert np.abs(pull).max() < 4
    assert trend.test.p_value < 1e-6
    assert np.abs(trend.spin.value / trend.spin.sigma).max() < 4


def test_left_out_sources_are_counted_and_named():
    field = quasars(300, 8)
    z = field.redshift.copy()
    z[:3] = np.nan, -1.0, 9.0
    found = binned(field._derive(redshift=z, name=np.arange(300)), 1, [0.1, 4.0])
    assert "left out 2 of 300 sources without a usable redshift: 1 missing, 1 zero or negative (0, 1)" in found.notes
    assert "left out 1 sources with redshifts outside 0.1 … 4" in found.notes
    assert found.counts.sum() == 297


@pytest.mark.parametrize(
    ("edges", "error", "words"),
    [
        ([0.1, 0.1000001, 4.0], DegeneracyError, "bin 1 of 2, 0.1 ≤ z < 0.1000001, is empty"),
        ([4.0, 5.0], DegeneracyError, "bin 1 of 1, .* is empty"),
        ([1.0, 0.1], ParameterError, "[Ee]dges of redshift bins rise"),
        ([1.0, 1.0], ParameterError, "[Ee]dges of redshift bins rise"),
        ([1.0, np.nan], ParameterError, "1 of 2 values of edges are not finite"),
        ([1.0], ParameterError, "[Ee]dges of redshift bins rise"),
        (0, ParameterError, "bins must be a whole number of at least 1, not 0"),
        (400, DegeneracyError, "300 sources do not fill 400 bins"),
        (150, DegeneracyError, "150 bins cannot hold equal information: a few sources, or one redshift, weigh more"),
        ([0.1, 0.12, 4.0], DegeneracyError, r"bin 1, .*cannot separate 6 modes.*or take fewer bins"),
    ],
)
def test_bad_edges(edges, error, words):
    with pytest.raises(error, match=words):
        binned(quasars(300, 9), 1, edges)


def test_bad_questions():
    found = binned(quasars(300, 9), 1, 2)
    with pytest.raises(FieldError, match="no redshifts"):
        binned(random_field(50, 1), 1, 2)
    with pytest.raises(ParameterError, match="a finite x for each of the 2 bins"):
        found.trend([1.0])
    with pytest.raises(ParameterError, match="no free coefficients"):
        found.equality("T", 4)
    with pytest.raises(ParameterError, match="at least two bins"):
        binned(quasars(300, 9), 1, 1).trend()


def test_table():
    found = binned(quasars(300, 9, frame="galactic"), 1, 2)
    table = found.to_table()
    assert len(table) == 2
    assert str(table["acceleration_x"].unit) == "uas / yr"
    assert table.meta["frame"] == "galactic"
    np.testing.assert_allclose(table["spin_y_error"], [s.spin.sigma[1] for s in found.solutions])


@pytest.mark.slow
def test_shuffling_keeps_its_promise_with_wrong_errors():
    """Errors five times too small: χ² as quoted claims a difference, scaled and permuted it does not."""
    p_values, plain, scaled = [], [], []
    for seed in range(40):
        field = quasars(250, seed)
        field = field.with_errors(field.sigma / 5)
        found = binned(field, 1, 3, method="least-squares")
        p_values.append(permutation_test(field, found, n_permutations=99, rng=seed)["S"])
        plain.append(found.equality("S", 1).p_value_quoted)
        scaled.append(found.equality("S", 1).p_value)
    assert max(plain) < 0.01
    assert 0.35 < np.mean(scaled) < 0.65  # uniform: the mean of 40 has a standard error of 0.046
    assert 0.35 < np.mean(p_values) < 0.65
    assert min(p_values) >= 0.01


def test_shuffling_begins_with_the_same_chi2():
    field = quasars(500, 11)
    found = binned(field, 1, 3, flows=None)
    values = np.stack([s.coefficients.values for s in found.solutions])
    covariance = np.stack([s.covariance for s in found.solutions])
    assert find_equality_chi2(values, covariance) == pytest.approx(found.equality().quoted)
    assert find_slope_chi2(values, covariance, found.redshift) == pytest.approx(found.trend().test.quoted)
    scaled = covariance * found.scales[:, None, None]
    assert find_slope_chi2(values, scaled, found.redshift) == pytest.approx(found.trend().test.chi2)


def test_slope_that_is_printed_is_of_degree_one():
    """Whatever else is fitted: its row stands below those of spin and acceleration."""
    found = binned(quasars(3000, 4), 3, 3, flows=None)
    assert (found.trend().test.dof, found.trend(first=True).test.dof) == (30, 6)
    row = next(line for line in found.report().splitlines() if line.startswith("  neither has a linear trend"))
    assert row.split()[8] == "6"  # below the degrees of freedom
    np.testing.assert_allclose(found.trend(first=True).acceleration.value, found.trend().acceleration.value, rtol=0.3)
    assert "permuted: computed with --lmax 1 alone" in found.report()


def test_real_catalogue_claims_nothing():
    field = catalogue.read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"), {"redshift": "z"})
    robust = binned(field, 1, [0.01, 0.5, 1, 1.5, 7])
    assert robust.report().count("  not contradicted") == 4
    found = binned(field, 1, [0.01, 0.5, 1, 1.5, 7], method="least-squares")
    assert found.counts.sum() == robust.counts.sum() == 655
    text = found.report(p_values=permutation_test(field, found))
    assert text.count("  not contradicted") == 4
    assert "  contradicted" not in text
    assert "the residuals suggest errors 2.77 times as large" in text
    assert found.trend().test.p_value_quoted < 1e-9  # what the catalogue's errors alone would have claimed


@pytest.mark.parametrize("scatter", [0.3, 30.0])
def test_few_precise_sources_make_no_bin_differ(scatter):
    """Errors over four decades and far below the scatter: 90 of 100 skies "differed" by least squares."""
    p, pulls = [], []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        sigma = np.tile(100 * 10 ** (4 * (rng.random(100) - 0.5)), (2, 1))
        lon, lat = sim.uniform_sky(100, rng)
        motion = np.hypot(sigma, 100 * scatter) * rng.normal(size=(2, 100))
        field = Field(lon, lat, motion, sigma, redshift=rng.uniform(0.5, 3.0, 100))
        bins = binned(field, 1, [0.4, 1.5, 3.1])
        p += [bins.equality(kind, 1).p_value for kind in "TS"]
        pulls += [vector.value / vector.sigma for each in bins.solutions for vector in (each.spin, each.acceleration)]
    assert min(p) > 0.0027
    assert np.sqrt(np.mean(np.square(pulls))) < 1.3


def test_parts_have_the_bins_of_the_whole_by_the_recommended_fit():
    field = quasars(1200, 2)
    whole = binned(field, 1, [0.1, 2.0, 4.0])
    split = binned(catalogue.parts([field[:500], field[500:]]), 1, [0.1, 2.0, 4.0])
    for a, b in zip(whole.solutions, split.solutions, strict=True):
        np.testing.assert_allclose(a.values, b.values, atol=1e-6)
    assert "each bin has the weights of its own fit (recommended)" in whole.notes


def test_markers_stand_where_a_bin_measures():
    """At the mean redshift, points lay 4 to 5 σ off a curve that the test accepted."""
    galaxies = sim.galaxies(20_000, 1, min_redshift=0.001, max_redshift=0.03)
    velocity = CMB_VELOCITY_PLANCK18.to_frame("icrs")
    field = sim.observe(galaxies, sim.secular_parallax(velocity.value), 2, sigma=0.5)
    found = binned(field, 1, [0.001, 0.006, 0.03], flows=None)
    predicted = -np.outer(1 / (AU_PER_YEAR * transverse_distance(found.effective_redshift)), velocity.value)
    at_mean = -np.outer(1 / (AU_PER_YEAR * transverse_distance(found.redshift)), velocity.value)
    for b, solution in enumerate(found.solutions):
        a = solution.acceleration
        assert np.abs((a.value - predicted[b]) / a.sigma).max() < 4
        assert found.edges[b] < found.effective_redshift[b] < found.redshift[b]
    first = found.solutions[0].acceleration
    assert np.abs((first.value - at_mean[0]) / first.sigma).max() > 4


def test_flow_of_bins_against_a_design_matrix():
    """C N⁻¹ Σ AᵀWF of every bin, with errors that hold each source's own motion, written out."""
    field = sim.observe(sim.galaxies(300, 2), sim.spin((0, 0, 0)), 3, sigma=5.0, rho=0.4)
    edges = np.array([0.001, 0.02, 0.03])
    found = binned(field, 2, edges, n_modes=40)
    flow = make_shared_flow(field, edges, THEORY, None, 40)
    distance = transverse_distance(field.redshift)
    rate = 1 / (AU_PER_YEAR * distance)
    own = rate**2 * (150**2 + flow.modes.left(distance * 0.673)[0])
    carried = []
    for low, high in pairwise(edges):
        inside = (field.redshift >= low) & (field.redshift < high)
        rows = harmonics(field.lon[inside], field.lat[inside], Modes(2))
        columns = (
            np.moveaxis(flow.modes.at(field.lon[inside], field.lat[inside], distance[inside] * 0.673)[0], 2, 0)
            * rate[inside]
        )
        (s1, s2), rho = field.sigma[:, inside], field.rho[inside]
        c = np.array([[s1**2 + own[inside], rho * s1 * s2], [rho * s1 * s2, s2**2 + own[inside]]])
        weight = np.linalg.inv(np.moveaxis(c, 2, 0))
        weighted = np.einsum("nkl,pln->pkn", weight, rows)
        normal = np.einsum("pkn,qkn->pq", weighted, rows)
        carried.append(np.linalg.solve(normal, np.einsum("pkn,qkn->pq", weighted, columns)))
    expected = np.concatenate(carried) @ np.concatenate(carried).T
    np.testing.assert_allclose(found.flow_covariance, expected, rtol=1e-6, atol=1e-9 * expected.max())
    for b, solution in enumerate(found.solutions):
        noise = found.covariance[16 * b : 16 * b + 16, 16 * b : 16 * b + 16]
        np.testing.assert_allclose(
            solution.covariance, noise + expected[16 * b :, 16 * b :][:16, :16], rtol=1e-6, atol=1e-9
        )


@pytest.mark.slow
def test_bins_with_errors_that_they_share(tmp_path, capsys):
    """Systematics that quasars of all redshifts share: plain bins differ, bins with the floor do not."""
    quasars = sim.quasars(30_000, 3)
    keep = (quasars.redshift < 1.2) | (quasars.lat > -0.2)  # bins that see different skies
    quasars = quasars[keep]
    field = sim.observe(quasars, sim.systematics(400 * Spectrum.flat(), 5, lmax=8), 2, sigma=400.0)
    bins = binned(field, 5, np.array([0.0, 1.2, 10.0]), flows=None)
    shared = bins.shared(draws=200)
    assert shared.labels[0] == "0 ≤ z < 1.2"
    assert shared.equality() > 0.0027
    field.write(tmp_path / "q.fits")
    words = [str(tmp_path / "q.fits"), "--bins", "0.1,1.2,6", "--redshift-frame", "true", "--flows", "no"]
    assert main([*words, "--lmax", "4", "--floor", "--output", str(tmp_path / "out"), "--dpi", "30"]) == 0
    out = capsys.readouterr().out
    assert "Does the dipole change with redshift?" in out
    assert "by permut" not in out
    assert "higher ones leak" not in out  # the second bin sees a part of the sky: three degrees more allow for that
    assert (tmp_path / "out" / "shared.ecsv").exists()
    with pytest.raises(SystemExit):
        main([*words, "--lmax", "2", "--floor"])
    assert "degrees 1 and 2 tell nothing of systematic errors" in capsys.readouterr().err


def test_flows_are_added_to_the_errors_that_bins_share():
    near = sim.galaxies(3000, 1, min_redshift=0.003, max_redshift=0.03)
    seen = sim.observe(near, sim.spin((0, 0, 0)), 2, sigma=30.0)
    flowing = binned(seen, 3, np.array([0.003, 0.02, 0.03]), n_modes=30)
    with_flows, without = (
        flowing.shared(draws=60),
        binned(seen, 3, np.array([0.003, 0.02, 0.03]), flows=None).shared(draws=60),
    )
    assert np.trace(with_flows.covariance) > 1.01 * np.trace(without.covariance)
    assert "flows are in these errors" in with_flows.notes
    # What is added is the block of degree 1 of each pair of bins, the same for every draw.
    options = {"labels": with_flows.labels, "draws": 60, "noise_scale": flowing.is_scaled}
    added = with_flows.covariances - fit.background.shared(flowing.normals, None, **options).covariances
    q, dipole = len(flowing.free), [i for i, k in enumerate(flowing.free) if list(flowing.modes)[k].l == 1]
    for a in (0, 1):
        for b in (0, 1):
            block = flowing.flow_covariance[a * q : (a + 1) * q, b * q : (b + 1) * q][np.ix_(dipole, dipole)]
            np.testing.assert_allclose(added[:, a, :, b], np.broadcast_to(block, (60, 6, 6)), rtol=1e-6)


@pytest.mark.slow
def test_bin_of_few_sources_does_not_bear_higher_degrees(tmp_path, capsys):
    """Three degrees more than sixty sources determine: the answer is by fewer, and a note says what that means."""
    many, few = sim.quasars(3000, 3, "uniform"), sim.quasars(60, 4, "uniform")
    near, far = (sim.observe(each, sim.spin((0, 0, 0)), 2, sigma=100.0) for each in (many, few))
    rng = np.random.default_rng(1)
    near = replace(near, redshift=rng.uniform(0.5, 2.4, 3000), redshift_frame="true")
    far = replace(far, redshift=rng.uniform(2.6, 4.0, 60), redshift_frame="true")
    (near + far).write(tmp_path / "z.fits")
    words = [str(tmp_path / "z.fits"), "--bins", "0.4,1,2.5,5", "--floor", "--flows", "no", "--format", "none"]
    assert main(words) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "Does the dipole change with redshift?" in out
    assert "2.5 ≤ z < 5: a part of the sky, or few sources" in out


@pytest.mark.slow
def test_bins_of_many_have_what_they_share_unasked(tmp_path, capsys, monkeypatch):
    """From so many sources on the floor is in the answer, below that its size is beside it, and --floor no leaves it."""
    quasars = sim.quasars(4000, 3)
    pattern = sim.systematics(900.0 * Spectrum.flat(), 4, lmax=7)
    sim.observe(quasars, pattern, 5, sigma=100.0).write(tmp_path / "q.fits")
    words = [str(tmp_path / "q.fits"), "--bins", "0.1,1.2,6", "--redshift-frame", "true", "--flows", "no"]
    assert main(words) == 0
    few = capsys.readouterr().out
    assert float(re.search(r"systematic floor is not in these errors: spin ± (\S+),", few)[1]) > 5
    monkeypatch.setattr("fit.results.quality.MANY", 3000)
    assert main(words) == 0
    many = capsys.readouterr().out
    assert "Does the dipole change with redshift?" in many
    assert "by permut" not in many
    assert "not in these errors" not in many
    assert main([*words, "--floor", "no"]) == 0
    without = capsys.readouterr().out
    assert "Does the dipole change" not in without
    assert "systematic floor is not in these errors" in without
    with pytest.raises(SystemExit):
        main([str(tmp_path / "q.fits"), "--h0", "70", "--floor", "no"])
    assert "--floor is for --bins" in capsys.readouterr().err


def test_chi2_of_robust_bins_is_that_of_the_catalogue():
    """It was in units of errors that the robust fit had changed: 0.6 to 1.9 where the errors were right."""
    field = sim.observe(sim.quasars(1500, 1), sim.acceleration((0, 0, 5)), rng=2)
    bins = binned(field, 3, 1, method="recommended")
    np.testing.assert_allclose(bins.to_table()["chi2_dof"], 1.0, atol=0.15)
    for low, high, solution in zip(bins.edges[:-1], bins.edges[1:], bins.solutions, strict=True):
        inside = field[(field.redshift >= low) & (field.redshift < high)]
        assert solution.chi2 == pytest.approx(solution.residuals(inside).chi2.sum(), rel=1e-9)
