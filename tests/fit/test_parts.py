"""Everything that works in passes gives with parts what it gives with all sources in memory."""

import numpy as np
import pytest

import fit
import sim
from fit import Moments
from fit.correlation import correlation_matrices, leakage, lmax_table
from fit.posterior import grid, sample
from fit.redshift import binned, equal_information_edges
from fit.resample import block_bootstrap, bootstrap, compare_blocks, jackknife
from fit.robust import clip, excess_noise, student_t
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh import Field, Modes
from vsh.io.parts import as_parts
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, with_redshift
from vsh.tools.errors import DegeneracyError, EmptyFieldError, FieldError, FrameError, ModesError, ParameterError

RNG = np.random.default_rng(20)


def heavy_tails(n=3000):
    """A sky with a field of degree 1, errors that are wrong in the south, outliers, redshifts and names."""
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    sigma = rng.uniform(100, 400, (2, n))
    scale = np.where(lat < 0, 1.6, 1.0) * np.where(rng.random(n) < 0.03, 8, 1)
    motion = rng.normal(size=(2, n)) * sigma * scale
    return Field(
        lon, lat, motion, sigma, rng.uniform(-0.5, 0.5, n), redshift=rng.uniform(0.01, 3, n), name=np.arange(n)
    )


FIELD = heavy_tails()
#: Blocks of different sizes, one with a single source.
PARTS = as_parts([FIELD[:1], FIELD[1:1200], FIELD[1200:1900], FIELD[1900:]])


def same(one, two, rtol=1e-10):
    """Coefficients within 1e-10 of their errors, covariances within 1e-10."""
    scale = np.sqrt(np.diag(two.covariance))
    assert np.max(np.abs(one.values - two.values) / scale) < rtol
    assert np.max(np.abs(one.covariance - two.covariance) / np.outer(scale, scale)) < rtol
    assert one.n_data == two.n_data
    assert one.chi2 == pytest.approx(two.chi2, rel=1e-10)


@pytest.mark.parametrize("lmax", [1, 2, 7])
def test_normal_equations(lmax):
    same(fit.fit_field(PARTS, lmax), fit.fit_field(FIELD, lmax))
    exact = fit.normal_equations(PARTS, lmax, method="design-matrix")
    np.testing.assert_allclose(exact.rhs, fit.normal_equations(FIELD, lmax).rhs, atol=1e-12 * np.abs(exact.rhs).max())


def test_moments_hold_every_lower_degree():
    """Degree 10 cut from degree 30's is its own, to 1e-12."""
    cut, own = Moments.of(FIELD, 30).to_degree(10), Moments.of(FIELD, 10)
    for name in ("weights", "motions"):
        one, two = getattr(cut, name), getattr(own, name)
        assert np.abs(one - two).max() < 1e-12 * np.abs(two).max()
    one, two = cut.normal_equations(), fit.normal_equations(FIELD, 10, method="design-matrix")
    assert np.abs(one.matrix - two.matrix).max() < 1e-12 * np.abs(two.matrix).max()
    assert np.abs(one.rhs - two.rhs).max() < 1e-12 * np.abs(two.rhs).max()
    assert (one.chi2_null, one.n_data) == (pytest.approx(two.chi2_null), two.n_data)


def test_moments_add_and_subtract():
    whole = Moments.of(FIELD, 6)
    total = sum(Moments.of(FIELD[i::48], 6) for i in range(48))
    assert np.abs(total.weights - whole.weights).max() < 1e-12 * np.abs(whole.weights).max()
    rest = whole - Moments.of(FIELD[:1000], 6)
    own = Moments.of(FIELD[1000:], 6)
    assert np.abs(rest.motions - own.motions).max() < 1e-11 * np.abs(whole.motions).max()
    assert rest.n_data == own.n_data == 4000
    assert (whole + Moments.of(FIELD, 3)).lmax == 3
    assert Moments.of(PARTS, 6).n_data == 6000
    rows = whole.to_table()  # each under its own frequencies
    for letter, width in (("a", 12), ("e", 6)):
        kept = rows["of"] == letter
        assert (rows["n"][kept].min(), rows["n"][kept].max(), rows["m"][kept].max()) == (-width, width, width)


def test_moments_say_what_they_cannot():
    with pytest.raises(ModesError, match="do not hold degree 7: sum sources to degree 7"):
        Moments.of(FIELD[:10], 6).normal_equations(7)
    with pytest.raises(FrameError, match=r'to_frame\("icrs"\)'):
        Moments.of(FIELD[:10], 2) + Moments.of(FIELD[:10].to_frame("galactic"), 2)
    with pytest.raises(ModesError, match="have the shape"):
        Moments(lmax=2, weights=np.zeros((3, 5, 9)), motions=np.zeros((2, 3, 4)), chi2_null=0.0, n_data=0)
    with pytest.raises(ParameterError, match="must be Field or ScalarField or Parts"):
        Moments.of("sky.fits", 2)
    with pytest.raises(EmptyFieldError, match="the field is empty"):
        Moments.of(FIELD[:0], 2)


def test_moments_are_small():
    """What a part sends: 49 kB at degree 10 where normal equations are 461, 415 kB at 30 where they are 29 500."""
    for lmax, kilobytes in ((10, 48.72), (30, 414.8)):
        moments = Moments.of(FIELD[:100], lmax)
        assert (moments.weights.nbytes + moments.motions.nbytes) / 1e3 == pytest.approx(kilobytes, rel=1e-3)


def test_weight_on_the_sky():
    """Its integral is the sum of the weights."""
    moments = Moments.of(FIELD, 8)
    lat, weight = moments.on_sky()
    area = np.cos(lat) * 2 * np.pi**2 / weight.size
    assert (weight.sum(1) * area).sum() == pytest.approx(FIELD.information.sum() / 2)


@pytest.mark.parametrize("options", [{}, {"kappa": 2.0}, {"threshold": 3.0}])
def test_clipping_drops_the_same_sources(options):
    one, two = clip(PARTS, 3, **options), clip(FIELD, 3, **options)
    same(one.solution, two.solution)
    assert one.limit == pytest.approx(two.limit, rel=1e-12)
    assert one.n_rounds == two.n_rounds
    assert one.solution.notes == two.solution.notes
    assert one.kept is None
    dropped = np.concatenate([np.setdiff1d(part.name, one.select(part).name) for part in PARTS.pieces])
    assert len(dropped) > 0
    np.testing.assert_array_equal(np.sort(dropped), np.flatnonzero(~two.kept))


def test_robust_fits():
    one, two = student_t(PARTS, 2), student_t(FIELD, 2)
    same(one.solution, two.solution)
    assert one.n_rounds == two.n_rounds
    assert one.nu == pytest.approx(two.nu, rel=1e-10)
    assert one.solution.notes == two.solution.notes  # they name the five sources with the least weight
    assert one.effective == pytest.approx(two.weights.sum() ** 2 / (two.weights**2).sum(), rel=1e-10)


@pytest.mark.parametrize("scale", [False, True])
def test_excess_noise(scale):
    one, two = excess_noise(PARTS, 2, scale=scale), excess_noise(FIELD, 2, scale=scale)
    same(one.solution, two.solution)
    assert one.excess_noise == pytest.approx(two.excess_noise, rel=1e-9)


@pytest.mark.parametrize("edges", [[0.0, 0.5, 1.0, 2.0], 4])
@pytest.mark.parametrize("shared", [False, True])
def test_bins_of_redshift(edges, shared):
    one, two = (binned(each, 2, edges, shared_higher_degrees=shared, method="least-squares") for each in (PARTS, FIELD))
    np.testing.assert_array_equal(one.edges, two.edges)
    np.testing.assert_array_equal(one.counts, two.counts)
    for a, b in zip(one.solutions, two.solutions, strict=True):
        same(a, b)
    assert one.notes == two.notes


def test_edges_of_equal_information_are_those_of_the_whole():
    rng = np.random.default_rng(1)
    crowded = FIELD[:500]
    columns = {name: getattr(crowded, name) for name in ("lon", "lat", "motion", "sigma", "rho")}
    crowded = Field(**columns, redshift=np.where(rng.random(500) < 0.2, np.nan, rng.choice([0.1, 0.2, 0.3, 1.0], 500)))
    np.testing.assert_array_equal(
        equal_information_edges(as_parts([crowded[:200], crowded[200:]]), 3), equal_information_edges(crowded, 3)
    )


def test_sources_without_redshift_are_counted_over_all_parts():
    z = FIELD.redshift.copy()
    z[:1200] = np.nan  # two parts have none at all
    z[1200] = -1.0
    blind = Field(FIELD.lon, FIELD.lat, FIELD.motion, FIELD.sigma, FIELD.rho, redshift=z, redshift_frame="true")
    parts = as_parts([blind[:1], blind[1:1200], blind[1200:1900], blind[1900:]])
    found = binned(parts, 1, [0.0, 1.0, 3.0])
    assert "left out 1201 sources without a usable redshift: 1200 missing, 1 zero or negative" in found.notes
    velocity = observer_velocity(parts.map(with_redshift), 67.4)
    assert velocity.n_data == 2 * 1799
    assert any("left out 1201 sources" in note for note in velocity.notes)


@pytest.mark.slow
def test_resampling():
    one, two = jackknife(PARTS, 1, 2, progress=False), jackknife(FIELD, 1, 2, progress=False)
    np.testing.assert_allclose(one.covariance, two.covariance, rtol=1e-9, atol=1e-9 * two.covariance.max())
    one, two = (block_bootstrap(each, 2, 2, 50, 3, progress=False) for each in (PARTS, FIELD))
    np.testing.assert_allclose(one.replicates, two.replicates, rtol=1e-8, atol=1e-8)
    assert compare_blocks(PARTS, 1, progress=False)[1][:3] == compare_blocks(FIELD, 1, progress=False)[1][:3]
    with pytest.raises(DegeneracyError, match="all sources lie in one block"):
        jackknife(as_parts([FIELD[:1]]), 1, 1)


@pytest.mark.slow
def test_one_step_of_the_bootstrap_is_the_full_one_to_first_order():
    one = bootstrap(FIELD, 1, 2000, 1, progress=False)
    rng, replicates = np.random.default_rng(2), []
    for _ in range(2000):  # a source that is drawn k times counts as measured k times
        times = rng.poisson(1.0, len(FIELD))
        drawn = FIELD[times > 0]
        weighted = drawn.with_errors(drawn.sigma / np.sqrt(times[times > 0]))
        replicates.append(fit.solve(fit.normal_equations(weighted, 1)).values)
    assert one.sigma == pytest.approx(np.std(replicates, axis=0), rel=0.08)  # three standard deviations of 2000 draws
    np.testing.assert_allclose(one.replicates.mean(0), one.solution.values, atol=3.5 / np.sqrt(2000) * one.sigma.max())
    # Errors that are wrong are seen: in the south they are 1.6 times as large, and one source in 30 is 8 times off.
    assert np.all(one.sigma > 1.4 * one.solution.sigma)
    again = bootstrap(FIELD, 1, 2000, 1, progress=False)
    np.testing.assert_array_equal(one.replicates, again.replicates)
    assert bootstrap(PARTS, 1, 3, 1, progress=False).method == "one-step bootstrap"
    assert bootstrap(FIELD, 1, 3, 1, progress=False).method == "one-step bootstrap"


def test_correlations_and_leakage():
    one, two = correlation_matrices([PARTS, PARTS]), correlation_matrices([FIELD, FIELD])
    np.testing.assert_allclose(one.matrix(1), two.matrix(1), atol=1e-12)
    np.testing.assert_allclose(one.dipoles[0], two.dipoles[0], atol=1e-12)
    frame = [correlation_matrices(each, solver="frame", offsets=each).matrix() for each in (PARTS, FIELD)]
    np.testing.assert_allclose(*frame, atol=1e-12)
    np.testing.assert_allclose(leakage(PARTS, 1, 4).matrix, leakage(FIELD, 1, 4).matrix, atol=1e-11)
    np.testing.assert_allclose(lmax_table(PARTS, 3, sigma=100.0), lmax_table(FIELD, 3, sigma=100.0), rtol=1e-10)


def test_frame_solver_and_the_cross_check():
    one, two = fit.solve_frame(PARTS), fit.solve_frame(FIELD)
    np.testing.assert_allclose(one.values, two.values, rtol=1e-9)
    assert one.chi2 == pytest.approx(two.chi2)
    assert fit.cross_check(PARTS).largest < 1e-9


@pytest.fixture(scope="module")
def galaxies():
    rng = np.random.default_rng(3)
    population = sim.galaxies(2000, rng)
    signal = sim.signal.acceleration((3.0, -4.0, 0.0)) + sim.signal.secular_parallax(CMB_VELOCITY_PLANCK18.value)
    return with_redshift(sim.observe(population, signal, rng=rng, release="DR4"))


def test_velocity_and_the_hubble_constant(galaxies):
    sky = as_parts([galaxies[:700], galaxies[700:]])
    same(observer_velocity(sky, 67.4), observer_velocity(galaxies, 67.4))
    same(hubble_constant(sky, "planck"), hubble_constant(galaxies, "planck"))
    one, two = (grid(each, hubble_prior=(67.4, 5.0), n_points=50) for each in (sky, galaxies))
    assert one.mean("H0") == pytest.approx(two.mean("H0"), rel=1e-6)
    one, two = (sample(each, n_samples=5000, hubble_prior=(67.4, 5.0), progress=False) for each in (sky, galaxies))
    assert one.frame == two.frame


def test_no_part_with_sources():
    with pytest.raises(EmptyFieldError, match="no part holds a source"):
        fit.normal_equations(PARTS.map(lambda field: field[field.lat > 4]), 1)
    with pytest.raises(FieldError, match="parts of a catalogue are expected, not str"):
        as_parts("sky.fits")
    with pytest.raises(ParameterError, match="must be Field or ScalarField or Parts"):
        clip("sky.fits", Modes(1))
