"""Distances given redshifts and magnitudes: against sums over fine grids, drawn galaxies, and the whole likelihood."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many
from scipy.optimize import minimize

import sim
from fit.distances import calibrate, inverse_distances, motions_per_velocity
from fit.distances._density import LogCurve
from fit.secular_parallax import observer_velocity
from vsh.io.parts import as_parts
from vsh.models.cosmology import BACHCHAN_2016, to_cmb, transverse_distance
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, FieldError, ParameterError
from vsh.tools.units import AU_PER_YEAR

OURS = BACHCHAN_2016.to_frame("icrs").value
C = 299792.458


def seen(n=4000, seed=1, dispersion=750.0, error=0.0, low=0.002, high=0.03, **options):
    """Galaxies as they are seen, cut in the redshift that is seen, and their true redshifts."""
    rng = np.random.default_rng([9, *np.atleast_1d(seed)])
    population = sim.galaxies(5 * n, rng, min_redshift=2e-4, max_redshift=0.05)
    signal = sim.secular_parallax(OURS) + sim.acceleration((0, -4, 0)) + sim.peculiar(dispersion, rng)
    field = sim.observe(population, signal, rng, redshifts="heliocentric", redshift_error=error, **options)
    z = to_cmb(field.redshift, field.lon, field.lat, "icrs", "heliocentric")
    keep = np.flatnonzero((z > low) & (z < high))[:n]
    return field[keep], population.redshift[keep]


@pytest.mark.parametrize("error", [0.0, 0.003])
@pytest.mark.parametrize("magnitudes", [True, False])
def test_mean_variance_and_slope_by_a_sum_over_a_fine_grid(error, magnitudes):
    field, _ = seen(300, dispersion=400.0, error=error)
    given = {"magnitudes": False, "density": np.ones_like}
    if magnitudes:
        given = {"luminosity": lambda m: -((m + 18) ** 2) / 4.5, "density": "volume"}
    calibration = calibrate(field, dispersion=400.0, **given)
    found = inverse_distances(field, calibration)
    z = np.geomspace(1e-4, 0.2, 200_001)
    d = transverse_distance(z)
    volume = d**2 * np.gradient(d, z)
    rate = 1 / (AU_PER_YEAR * d)
    x_seen = np.log1p(to_cmb(field.redshift, field.lon, field.lat, "icrs", "heliocentric"))
    spread = np.sqrt((400.0 / C) ** 2 + (error / np.exp(x_seen)) ** 2)

    def moments(i, shift=0.0):
        weight = volume * np.exp(-(((x_seen[i] + shift - np.log1p(z)) / spread[i]) ** 2) / 2) * np.gradient(z)
        if magnitudes:
            absolute = field.magnitude[i] - 5 * np.log10(d * (1 + z)) - 25
            weight = weight * np.exp(-((absolute + 18) ** 2) / 4.5)
        weight /= weight.sum()
        mean = weight @ rate
        return mean, weight @ (rate - mean) ** 2

    expected = np.array([moments(i) for i in range(0, 300, 15)])
    np.testing.assert_allclose(found.mean[::15], expected[:, 0], rtol=1e-4)
    np.testing.assert_allclose(found.variance[::15], expected[:, 1], rtol=2e-3)
    step = 1e-6
    slope = [(moments(i, step)[0] - moments(i, -step)[0]) / (2 * step) for i in range(0, 300, 60)]
    np.testing.assert_allclose(found.slope[::60], slope, rtol=5e-3)


@pytest.mark.parametrize(("dispersion", "error"), [(300.0, 0.0), (750.0, 0.0), (300.0, 0.003)])
def test_mean_is_that_of_galaxies_that_were_drawn(dispersion, error):
    """E[k − m | z_obs, G] is zero, near and far, bright and faint; and the variance is right."""
    field, true = seen(40_000, 3, dispersion, error)
    found = inverse_distances(field, calibrate(field, dispersion=dispersion, density="volume"))
    k = 1 / (AU_PER_YEAR * transverse_distance(true))
    off, sigma = (k - found.mean) / found.mean, np.sqrt(found.variance) / found.mean
    bright = field.magnitude < np.median(field.magnitude)
    for cut in ((0.002, 0.006), (0.006, 0.012), (0.012, 0.02), (0.02, 0.03)):
        inside = (found.redshift > cut[0]) & (found.redshift < cut[1])
        for half in (bright, ~bright):
            chosen = inside & half
            if chosen.sum() < 50:
                continue
            assert abs(off[chosen].mean()) < 4 * sigma[chosen].mean() / np.sqrt(chosen.sum()) + 0.01
        if inside.sum() > 1000:  # of few sources the largest alone counts
            assert np.mean((off[inside] / sigma[inside]) ** 2) == pytest.approx(1, abs=0.1)
    # Redshifts as they stand would be off by several per cent.
    naive = k * AU_PER_YEAR * transverse_distance(found.redshift) - 1
    near = found.redshift < 0.01
    assert abs(naive[near].mean()) > 3 * abs(off[near].mean())


def test_luminosity_function_comes_back():
    field, _ = seen(40_000, 2)
    curve = calibrate(field).luminosity
    magnitude = np.linspace(-21.0, -15.8, 30)
    log = curve.log(magnitude) + (magnitude + 18) ** 2 / 4.5
    assert np.ptp(log) < 0.3
    assert "galaxies to magnitude 20.0" in curve.words


def test_curve_goes_on_straight():
    curve = LogCurve(np.array([0.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, 0.5, 0.2]))
    x = np.array([-3.0, -2.0, -1.0, 4.0, 5.0, 6.0])
    steps = np.diff(curve(x))
    assert steps[0] == pytest.approx(steps[1])
    assert steps[3] == pytest.approx(steps[4])


def test_true_redshifts_are_taken_as_they_are():
    field, true = seen(200)
    field = replace(field, redshift=true, redshift_frame="true")
    found = inverse_distances(field, calibrate(field))
    np.testing.assert_allclose(found.mean, 1 / (AU_PER_YEAR * transverse_distance(true)))
    assert not found.variance.any()
    assert not found.slope.any()
    np.testing.assert_allclose(motions_per_velocity(field, None), found.mean)


@few_or_many(4, 30)
def test_distances_of_their_own(n_skies):
    """Pulls of four skies and 1400 sources: + 0.09 ± 0.03 on average."""
    pulls = []
    for seed in range(n_skies):
        field, true = seen(1800, seed=[4, seed])
        d = transverse_distance(true)
        rng = np.random.default_rng(seed)
        distance = np.where(np.arange(1800) % 2 == 0, d + 4.0 * rng.standard_normal(1800), np.nan)
        field = replace(field, distance=distance, distance_error=np.full(1800, 4.0))
        found = inverse_distances(field, calibrate(field))
        assert found.own.sum() == 900
        # Near the limits of the catalogue its cut in redshift tells of distances as well.
        inside = found.own & (true > 0.006) & (true < 0.022)
        pulls.append(((1 / (AU_PER_YEAR * d) - found.mean) / np.sqrt(found.variance))[inside])
    assert np.concatenate(pulls).mean() == pytest.approx(0.09, abs=0.06 + 0.12 / np.sqrt(n_skies))
    assert np.concatenate(pulls).std() == pytest.approx(1, abs=0.02 + 0.2 / np.sqrt(n_skies))


def whole_likelihood(field, dispersion):
    """The most probable (v, ã) where each source's distance is integrated over, without any expansion."""
    z = to_cmb(field.redshift, field.lon, field.lat, "icrs", "heliocentric")
    s = dispersion / C
    x = np.maximum(np.log1p(z)[:, None] + s * np.linspace(-5, 5, 81), 1e-4)
    d = transverse_distance(np.expm1(x).ravel()).reshape(x.shape)
    absolute = field.magnitude[:, None] - 5 * np.log10(d * np.exp(x)) - 25
    log = 3 * np.log(d) - np.log(x) - ((x - np.log1p(z)[:, None]) / s) ** 2 / 2 - (absolute + 18) ** 2 / 4.5
    weight = np.exp(log - log.max(1, keepdims=True))
    weight /= weight.sum(1, keepdims=True)
    k = 1 / (AU_PER_YEAR * d)
    p, q, _ = triad(field.lon, field.lat)
    variance = [field.sigma[i][:, None] ** 2 + (dispersion * k) ** 2 for i in (0, 1)]

    def misfit(theta):
        v, a = theta[:3] * 100, theta[3:]
        chi = sum(
            (field.motion[i][:, None] + (v @ e)[:, None] * k - (a @ e)[:, None]) ** 2 / variance[i]
            + np.log(variance[i])
            for i, e in enumerate((p, q))
        )
        least = chi.min(1, keepdims=True)
        return float(np.sum(least / 2) - np.sum(np.log(np.sum(weight * np.exp(-(chi - least) / 2), 1))))

    found = minimize(misfit, np.r_[OURS / 100, 0, -4, 0], method="BFGS").x
    return found[:3] * 100


@pytest.mark.parametrize("seed", [1, pytest.param(2, marks=pytest.mark.slow)])
def test_against_the_whole_marginal_likelihood(seed):
    field, _ = seen(2500, seed, release="DR5")
    found = observer_velocity(
        field, 67.3, peculiar_dispersion=750.0, flows=None, luminosity=lambda m: -((m + 18) ** 2) / 4.5
    )
    exact = whole_likelihood(field, 750.0)
    assert np.abs((found.velocity.value - exact) / found.velocity.sigma).max() < 0.25


def test_parts_give_the_same():
    field, _ = seen(1500)
    whole = calibrate(field, dispersion=500.0)
    parts = calibrate(as_parts([field[:400], field[400:]]), dispersion=500.0)
    np.testing.assert_allclose(inverse_distances(field, parts).mean, inverse_distances(field, whole).mean, rtol=1e-9)
    for options in ({"magnitudes": False}, {"flows": "linear", "n_modes": 60}):
        one = observer_velocity(field, 67.3, **options)
        two = observer_velocity(as_parts([field[:400], field[400:]]), 67.3, **options)
        np.testing.assert_allclose(one.values, two.values, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize(
    ("change", "options", "error", "words"),
    [
        ({"magnitude": np.r_[np.nan, np.full(299, 15.0)]}, {}, FieldError, r"1 of 300 sources have no magnitude: leave those out .*--columns magnitude="),
        ({"magnitude": None}, {"magnitudes": True}, ParameterError, "magnitudes are asked for, and 300 of 300"),
        ({}, {"dispersion": 20_000.0}, FieldError, r"peculiar velocities of redshifts \(20000 km/s\) are larger than c z of"),
        ({}, {"density": "clumpy"}, ParameterError, 'a density is "volume", "fitted"'),
        ({"magnitude": None}, {"luminosity": np.zeros_like}, ParameterError, "needs magnitudes"),
        ({}, {"redshift_frame": "galactic"}, ParameterError, "a redshift's frame is"),
        ({"redshift": np.r_[-0.01, np.full(299, 0.02)]}, {}, FieldError, "give no distance once they are taken from heliocentric ones"),
    ],
)  # fmt: skip
def test_bad_arguments_are_refused(change, options, error, words):
    with pytest.raises(error, match=words):
        calibrate(replace(seen(300)[0], **change), **options)


def test_few_galaxies_are_refused():
    with pytest.raises(DegeneracyError, match="20 galaxies with magnitudes say nothing"):
        calibrate(seen(300)[0][:20])


@pytest.mark.slow
@few_or_many(12, 40)
@pytest.mark.parametrize("magnitudes", [None, pytest.param(False, marks=pytest.mark.slow)])
def test_pulls_on_skies_as_they_are_seen(magnitudes, n_skies):
    """Velocities from redshifts that hold velocities: no bias, and errors that hold; redshifts as they stand have one."""
    off, pulls, naive = [], [], []
    toward = OURS / np.linalg.norm(OURS)
    for seed in range(n_skies):
        field, _ = seen(1500, 100 + seed, dispersion=600.0, release="DR5")
        found = observer_velocity(field, 67.3, peculiar_dispersion=600.0, flows=None, magnitudes=magnitudes).velocity
        as_true = observer_velocity(field, 67.3, peculiar_dispersion=600.0, flows=None, redshift_frame="true").velocity
        off.append((found.value - OURS) @ toward / np.sqrt(toward @ found.covariance @ toward))
        naive.append((as_true.value - OURS) @ toward / np.sqrt(toward @ as_true.covariance @ toward))
        pulls.extend((found.value - OURS) / found.sigma)
    assert abs(np.mean(off)) < 3.5 / np.sqrt(n_skies)
    assert np.std(pulls) == pytest.approx(1, abs=4 / np.sqrt(2 * len(pulls)))
    assert np.mean(naive) < np.mean(off)


@pytest.mark.parametrize("density", [None, "volume"])
@pytest.mark.parametrize("log", [
    lambda m: np.log(10 ** (-0.4 * (m + 22))) - 10 ** (-0.4 * (m + 22)),  # Schechter's: nothing is so bright
    lambda m: np.where(m > -26, 0.3 * m, -np.inf),
    lambda m: np.where(m > -19, 0.0, -3.0),
])  # fmt: skip
def test_luminosity_functions_with_ends_and_steps(log, density):
    """Those that are given are taken as they are, between the points of no table."""
    field, _ = seen(200, 1, dispersion=300.0)
    calibration = calibrate(field, dispersion=300.0, luminosity=log, density=density)
    moments = inverse_distances(field, calibration)
    x, s = np.log1p(moments.redshift), calibration.spread(field, moments.redshift)
    low, high = np.maximum(x - 6 * s, np.log1p(1e-4)), x + 6 * s
    nodes, weights = np.polynomial.legendre.leggauss(32)
    true = (high + low) / 2 + (high - low) / 2 * nodes[:, None]
    log_d, weight = calibration.log_distance(true)
    weight += calibration.density.log(np.exp(log_d)) - ((true - x) / s) ** 2 / 2
    weight += log(field.magnitude - 5 / np.log(10) * (log_d + true) - 25)
    weight = weights[:, None] * np.exp(weight - weight.max(0))
    mean = np.sum(weight * np.exp(-log_d), 0) / weight.sum(0)
    np.testing.assert_allclose(1 / moments.distance, mean, rtol=1e-8)
