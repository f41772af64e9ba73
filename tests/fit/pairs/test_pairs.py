"""Correlations of pairs by brute force, pair by pair."""

import contextlib

import numpy as np
import pytest
from conftest import triad
from numpy.testing import assert_allclose
from scipy.stats import ncx2

import sim
from fit import pairs
from fit.pairs._correlation import _compute_interval
from fit.pairs._sums import _compute_cross_terms, find_covariance, sum_pairs
from vsh import Coefficients, Field, FieldError, ParameterError
from vsh.io.parts import as_parts
from vsh.models.covariance import Spectrum, d_plus, wave_fractions
from vsh.tools.units import hubble_rate

EDGES = np.radians(np.arange(0, 181, 12.0))
RNG = np.random.default_rng(1)
#: Few and wide ones, for many skies.
WIDE = np.radians(np.arange(0, 181, 22.5))


def brute(field, weights, edges):
    """Every pair once, both directions pointing away from the first source: ξ+, ξ−, weight and number of each bin."""
    axes = [triad(*place) for place in zip(field.lon, field.lat, strict=True)]
    east, north, out = np.swapaxes(np.array(axes), 0, 1)
    motion = field.motion[0][:, None] * east + field.motion[1][:, None] * north
    sums = np.zeros((4, len(edges) - 2))
    for i in range(len(field) - 1):
        there, here = slice(i + 1, None), out[i]
        cos = np.clip(out[there] @ here, -1, 1)
        theta, sin = np.arccos(cos), np.sqrt(1 - cos**2)
        first = (out[there] - cos[:, None] * here) / sin[:, None]
        second = (cos[:, None] * out[there] - here) / sin[:, None]
        along = (first @ motion[i]) * np.sum(second * motion[there], 1)
        across = (np.cross(here, first) @ motion[i]) * np.sum(np.cross(out[there], second) * motion[there], 1)
        w = weights[i] * weights[there]
        for k in range(len(edges) - 2):
            hat = np.sin(np.pi / 2 * np.interp(theta, edges[k : k + 3], [0, 1, 0])) ** 2
            sums[:, k] += (hat * w) @ (along + across), (hat * w) @ (along - across), hat @ w, hat.sum()
    return sums[0] / sums[2], sums[1] / sums[2], sums[2], sums[3]


def noisy(n=1500, seed=2, signal=None):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-0.7, 1, n))
    sigma = rng.uniform(20, 80, n)
    motion = sigma * rng.normal(size=(2, n))
    if signal is not None:
        motion = motion + signal(lon, lat)
    return Field(lon, lat, motion, np.stack([sigma, sigma]))


@pytest.mark.parametrize("weights", [None, pytest.param(RNG.uniform(0, 1, 1500), marks=pytest.mark.slow)])
def test_brute_force(weights):
    """Pairs of 1500 sources one by one: ξ+ to 1e-4 of its largest at degree 120, ξ− to 3e-4, better at 240."""
    field = noisy(signal=sim.wave_background(0.5, 1))
    plus, minus, weight, count = brute(field, 1 / field.sigma[0] ** 2 if weights is None else weights, EDGES)
    for lmax, tolerance in ((120, 1e-4), (240, 4e-5)):
        found = pairs.correlation_function(field, EDGES, weights=weights, lmax=lmax)
        assert_allclose(found.plus, plus, atol=tolerance * np.abs(plus).max())
        assert_allclose(found.minus, minus, atol=3 * tolerance * np.abs(minus).max())
        assert_allclose(found.weight, weight, rtol=tolerance)
        assert_allclose(found.n_pairs, count, rtol=tolerance)
    assert_allclose(found.theta, EDGES[1:-1])
    assert found.lmax == 360


@pytest.mark.parametrize("kind", ["spin", "glide"])
def test_dipole_follows_its_law(kind):
    """T1: ⟨∥∥⟩ = P/8π, ⟨⊥⊥⟩ = P cos θ/8π; S1 the other way round; P = 8π/3 of the square of the vector."""
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(0, 2 * np.pi, 20000), np.arcsin(rng.uniform(-1, 1, 20000))
    vector = {"spin": "rotation"}.get(kind, "glide")
    products = []
    for axis in np.eye(3):  # over the three axes the law holds on any sky
        motion = Coefficients.from_vectors(**{vector: 3 * axis}).at(lon, lat)
        products.append(pairs.correlation_function(Field(lon, lat, motion, np.ones((2, 20000))), EDGES, lmax=90))
    theta = products[0].theta
    plus, minus = (sum(getattr(each, name) for each in products) for name in ("plus", "minus"))
    sign = 1 if kind == "spin" else -1
    # A bin sees the mean of its curve; the bins are 12° wide.
    mean = np.array([_mean(lambda t: np.cos(t), EDGES[k : k + 3]) for k in range(len(theta))])
    assert_allclose(plus, 9 * (1 + mean), atol=0.02)
    assert_allclose(minus, sign * 9 * (1 - mean), atol=0.02)
    fitted = products[2].fit(("spin", "glide"))
    assert fitted[kind][0] == pytest.approx(8 * np.pi / 3 * 9, rel=0.05)


def _mean(function, edges):
    theta = np.linspace(edges[0], edges[2], 2001)
    hat = np.sin(np.pi / 2 * np.interp(theta, edges, [0, 1, 0])) ** 2 * np.sin(theta)
    return np.sum(hat * function(theta)) / hat.sum()


def test_curve_of_waves():
    theta = np.array([0.2, 0.8, 1.3, 2.0, 2.7])
    assert_allclose(pairs.waves_curve(theta), [0.9330074, 0.2452544, -0.2881578, -0.3992638, -0.0912705], atol=1e-7)
    assert_allclose(pairs.waves_curve(theta), wave_fractions(2000) @ d_plus(2000, theta), atol=1e-6)
    assert_allclose(pairs.waves_curve([0.0, np.pi]), [1.0, 0.0], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("n_skies", [40])
def test_errors_that_are_wrong_bias_nothing(n_skies):
    """Noise three times the quoted errors, and ten times on half the sky: templates about zero."""
    found = []
    for seed in range(n_skies):
        field = noisy(600, seed)
        field = field.with_errors(field.sigma / np.where(field.lat > 0.3, 10, 3))
        fitted = pairs.correlation_function(field, WIDE, lmax=40).fit()
        found.append(fitted.values / fitted.sigma)
    pulls = np.array(found)
    assert np.abs(pulls.mean(0)).max() < 4 / np.sqrt(n_skies)
    assert np.std(pulls) == pytest.approx(1, abs=1 / np.sqrt(n_skies))


@pytest.mark.slow
def test_errors_of_motions_that_neighbours_share():
    """Random fields from sky to sky: errors right within a sixth; those of a wide field on one sky are too large."""
    rng, spread, errors = np.random.default_rng(3), [], []
    for seed in range(40):
        signal = sim.systematics(Spectrum.given(np.where(np.arange(1, 11) > 3, 3000.0, 0.0)), rng, lmax=10)
        found = pairs.correlation_function(noisy(800, seed, signal), WIDE, lmax=40)
        spread.append(np.concatenate([found.plus, found.minus]))
        errors.append(np.diag(found.covariance))
    ratio = np.sqrt(np.mean(errors, 0)) / np.std(spread, 0)
    assert np.median(ratio) == pytest.approx(1, abs=0.17)
    wide = pairs.correlation_function(noisy(1500, 1, sim.acceleration((0, 60, 0))), EDGES, lmax=60)
    alone = pairs.correlation_function(noisy(1500, 1), EDGES, lmax=60)
    assert (wide.sigma_plus > alone.sigma_plus).all()


def test_pairs_of_blocks_add_up_to_the_whole():
    field = noisy(400)
    total, blocks, _, _ = sum_pairs(field, 20, 1, None, None)
    plus, minus, weight = np.ones((1, 20)), np.zeros((1, 20)), np.zeros((1, 21))
    assert _compute_cross_terms(blocks, plus, minus, weight).sum() == pytest.approx(total.spectra[0].sum(), rel=1e-10)
    assert np.isnan(find_covariance(blocks[:3], plus, minus, weight)).all()


def test_jackknife_sums_are_zero_for_all_sources(monkeypatch):
    """Of each estimate, what blocks and pairs of them have more than it expects adds up to nothing."""
    seen = []
    monkeypatch.setattr(
        "fit.pairs._correlation.find_covariance", lambda *arguments: seen.append(arguments) or np.eye(2)
    )
    with contextlib.suppress(ValueError, ParameterError):
        pairs.correlation_function(noisy(400), WIDE, lmax=40)
    between = _compute_cross_terms(*seen[0])
    assert np.abs(between.sum((1, 2))).max() < 1e-9 * np.abs(between).sum((1, 2)).max()


def test_parts_and_threads_give_the_same():
    field = noisy(900)
    one = pairs.correlation_function(field, EDGES, lmax=60, threads=1)
    assert pairs.correlation_function(field, EDGES, lmax=60, threads=3) == one
    parts = pairs.correlation_function(as_parts([field[:300], field[300:].add_note("of the second")]), EDGES, lmax=60)
    assert "of the second" in parts.notes
    assert_allclose(parts.plus, one.plus, atol=1e-10 * np.abs(one.plus).max())
    assert_allclose(parts.covariance, one.covariance, atol=1e-9 * np.abs(one.covariance).max())


def test_own_templates():
    field = noisy(800)
    found = pairs.correlation_function(field, EDGES, lmax=60)
    own = {"mine": lambda theta: np.stack([hubble_rate(70) ** 2 * pairs.waves_curve(theta), 0 * theta])}
    assert found.fit(own).values == pytest.approx(found.fit(["waves"]).values, rel=1e-9)
    with pytest.raises(ParameterError, match="no template is called 'strings'"):
        found.fit(["strings"])
    with pytest.raises(ParameterError, match="must be a function of θ"):
        found.fit({"mine": 3.0})
    with pytest.raises(ParameterError, match="cannot tell 2 templates apart"):
        found.fit({"one": own["mine"], "two": own["mine"]})
    with pytest.raises(ParameterError, match="no template is called 'spin': waves are"):
        found.fit(["waves"])["spin"]


def test_messages():
    field = noisy(50)
    for edges, said in (([0.1, 0.2], "three angles"), ([0.3, 0.2, 0.1], "ascend"), (np.arange(0.0, 181, 12), "np.radians"),
                        ([0.0, 0.1, np.nan], "not finite")):  # fmt: skip
        with pytest.raises(ParameterError, match=said):
            pairs.correlation_function(field, edges)
    with pytest.raises(ParameterError, match="do not resolve bins of 1°: lmax of 1432 or more"):
        pairs.correlation_function(field, np.radians([0, 1, 2]), lmax=60)
    with pytest.raises(FieldError, match="two sources"):
        pairs.correlation_function(field[:1], EDGES)
    with pytest.raises(ParameterError, match="5 are below zero"):
        pairs.correlation_function(field, EDGES, weights=np.where(np.arange(50) < 5, -1.0, 1.0))
    with pytest.raises(ParameterError, match="those of a Field in memory"):
        pairs.correlation_function(as_parts([field, field]), EDGES, weights=np.ones(100))
    tiny = Field(field.lon, field.lat, field.motion, np.where(np.arange(50) == 7, 1e-7, field.sigma))
    with pytest.raises(FieldError, match="one source has all the weight"):  # its pair with itself leaves only rounding
        pairs.correlation_function(tiny, EDGES)
    blurred = pairs.correlation_function(field, EDGES, lmax=30)
    assert "blur bins" in blurred.notes[-1]
    near = Field(0.001 * field.lon, 0.001 * field.lat, field.motion, field.sigma)
    found = pairs.correlation_function(near, EDGES, lmax=130)
    assert np.isnan(found.plus[-1])
    assert any("have no pairs" in note for note in found.notes)
    assert any("tell no errors" in note for note in found.notes)


def test_treecorr():
    treecorr = pytest.importorskip("treecorr", reason="there is no wheel of TreeCorr for Windows")
    """TreeCorr's pairs of a field with spin, glide and noise: its first component points west."""
    field = noisy(3000, 7, sim.spin((100, 0, 60)) + sim.acceleration((0, 0, 150)))
    catalogue = treecorr.Catalog(
        ra=field.lon, dec=field.lat, ra_units="rad", dec_units="rad", v1=-field.motion[0], v2=field.motion[1],
        w=1 / field.sigma[0] ** 2,
    )  # fmt: skip
    theirs = treecorr.VVCorrelation(
        bin_type="Linear", min_sep=20, max_sep=100, nbins=80, sep_units="deg", metric="Arc", bin_slop=0, num_threads=1
    )
    theirs.process(catalogue)
    # Their narrow bins, summed under our hat, are our bin.
    edges = np.radians([30.0, 60, 90])
    hat = np.sin(np.pi / 2 * np.interp(np.radians(theirs.meanr), edges, [0, 1, 0])) ** 2 * theirs.weight
    found = pairs.correlation_function(field, edges, lmax=120)
    assert found.plus[0] == pytest.approx(np.sum(hat * theirs.xip) / hat.sum(), rel=1e-4)
    assert found.minus[0] == pytest.approx(np.sum(hat * theirs.xim) / hat.sum(), rel=1e-3)
    assert found.weight[0] == pytest.approx(hat.sum(), rel=1e-4)


@pytest.mark.slow
def test_intervals_of_templates_hold_as_squares_scatter():
    """Value ± 1.96 errors held zero on 84 to 95 % of skies, and a spin's power on 86."""
    held, plain = [], []
    for seed in range(40):
        rng = np.random.default_rng([8, seed])
        lon, lat = sim.uniform_sky(800, rng)
        omega = np.array([0.0, 0.0, 3.0])
        motion = 30 * rng.normal(size=(2, 800)) + Coefficients.from_vectors(omega, np.zeros(3)).at(lon, lat)
        found = pairs.correlation_function(
            Field(lon, lat, motion, np.full((2, 800), 30.0)), np.radians([0, 30, 60, 90, 120, 150, 180])
        )
        templates = found.fit(["spin", "glide", "waves"])
        truth = np.array([8 * np.pi / 3 * omega @ omega, 0.0, 0.0])
        low, high = templates.interval().T
        held.append((low <= truth) & (truth <= high))
        plain.append(np.abs(templates.values - truth) < 1.96 * templates.sigma)
    assert (low >= 0).all()
    np.testing.assert_allclose(templates.coefficients, [3, 3, 14.2], rtol=0.02)
    assert np.mean(held) > 0.92  # of 120: 0.95 ± 0.02, and more where zero is the truth
    assert np.mean(held) > np.mean(plain)
    wide = templates.interval(0.997)
    assert (wide[:, 1] >= high).all()
    assert "95 % intervals" in templates.report()
    assert {"low95", "high95"} < set(templates.to_table().colnames)


def test_limits_of_templates_invert_the_chance_of_squares():
    """Of an amplitude whose error is known: as small a value, or as large, has a chance of 2.5 % at the limits."""
    for k in (3.0, 14.2):
        for power in (0.5, 20.0):
            s2 = 1.7
            sigma = np.sqrt(2 * k * s2**2 + 4 * s2 * power)
            low, high = _compute_interval(power, sigma, k, 0.025, np.inf)
            assert_allclose(ncx2.cdf(power / s2 + k, k, high / s2), 0.025, rtol=0.02)
            if low > 0:
                assert_allclose(ncx2.sf(power / s2 + k, k, low / s2), 0.025, rtol=0.02)
    assert _compute_interval(-4.0, 3.0, 3.0, 0.025, 40.0)[0] == 0.0
    # Of thousands of effective sources and a strong signal, where scipy's function is nan below 1e-28.
    for k, power in ((13.0, 10.0), (35.0, 3.0), (35.0, 30.0)):
        known, thousands = (_compute_interval(power, 1.0, k, 0.025, dof) for dof in (np.inf, 1e4))
        assert_allclose(thousands, known, rtol=1e-12)  # 10⁴ is where the degrees of freedom are taken as all
        assert_allclose(thousands, _compute_interval(power, 1.0, k, 0.025, 3e3), rtol=0.02)


@pytest.mark.slow
def test_verdict_sees_what_is_there():
    """A glide of twenty errors is seen, and said to be no proof; noise shows nothing on nearly every sky."""
    edges = np.radians([0, 30, 60, 90, 120, 150, 180])
    seen = pairs.correlation_function(noisy(1500, 1, sim.acceleration((0, 120, 0))), edges, lmax=40).fit().verdict
    assert seen.startswith("pairs show ")
    assert "glide" in seen.split(", of the sky")[0]
    assert "do not separate" in seen
    found = [pairs.correlation_function(noisy(800, seed), edges, lmax=40).fit().verdict for seed in range(20)]
    assert sum(each.startswith("none of the templates is detected") for each in found) >= 19


def test_sources_that_give_no_errors_are_refused():
    sky = sim.observe(sim.quasars(3, 1), sim.spin((0, 0, 0)), 2, sigma=100.0)
    with pytest.raises(ParameterError, match="give no errors of the correlation"):
        pairs.correlation_function(sky, np.radians(np.linspace(0, 180, 14))).fit(("spin", "glide", "waves"))
