"""The search for one wave: noise is χ², what is put in is found, limits cover."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

import fit
import sim
from fit.waves import search, search_in_time
from fit.waves._search import (
    WhitenedData,
    _compute_templates_and_covariance,
    compute_simulated_p_value,
    draw_maxima,
    fit_wave_by_direction,
)
from vsh import DegeneracyError, Field, ModesError, ParameterError
from vsh.io.epochs import Observations, make_design_rows, read_observations
from vsh.length import length_limits
from vsh.models.waves import wave_motions

K = np.array([1.0, 2.0, -0.5]) / np.linalg.norm([1.0, 2.0, -0.5])


def sky(n=3000, seed=1, signal=None, lowest=-0.8):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(lowest, 1, n))
    sigma = np.full((2, n), 50.0)
    motion = sigma * rng.normal(size=(2, n)) + sim.acceleration((0, 5, 0))(lon, lat)
    return Field(lon, lat, motion if signal is None else motion + signal(lon, lat), sigma)


def whitened(field, lmax=4):
    normal = fit.normal_equations(field, lmax)
    return WhitenedData.of(normal.matrix, normal.rhs, normal.modes.degrees > 1), normal.modes


@pytest.mark.slow
def test_noise_is_chi_square_and_p_values_are_uniform():
    white, modes = whitened(sky())
    rng, one, chances = np.random.default_rng(1), [], []
    for _ in range(300):
        noise = replace(white, values=rng.standard_normal(len(white.values)))
        statistic = fit_wave_by_direction(noise, modes, 4)[0]
        one.append(statistic[17])
        chances.append(compute_simulated_p_value(draw_maxima(noise, modes, 4, 200, rng), statistic.max()))
    assert kstest(one, "chi2", args=(2,)).pvalue > 0.01
    assert kstest(chances, "uniform").pvalue > 0.01


def test_all_other_coefficients_are_free():
    """RᵀR is the inverse of the covariance of those kept, with all others marginalised."""
    field = sky(500, lowest=0.2)
    white, _modes = whitened(field, 3)
    solution = fit.fit_field(field, 3)
    kept = solution.covariance[np.ix_(white.kept, white.kept)]
    np.testing.assert_allclose(white.root.T @ white.root @ kept, np.eye(len(kept)), atol=1e-8)
    np.testing.assert_allclose(white.values, white.root @ solution.values[white.kept], rtol=1e-6, atol=1e-6)


@pytest.mark.slow
def test_wave_is_found():
    skies = (sky(seed=seed, signal=sim.plane_wave(K, 15.0, -8.0)) for seed in range(8))
    found = [search(fit.fit_field(each, 5), n_skies=200) for each in skies]
    assert all(each.p_value == pytest.approx(1 / 201) for each in found)
    assert np.median([np.degrees(np.arccos(each.vector @ K)) for each in found]) < 12
    best = np.argmin(np.sum((np.array([each.vector for each in found]) - K) ** 2, axis=1))
    assert found[best].amplitude == pytest.approx(17, rel=0.25)
    # At its own direction the amplitudes are without bias.
    white, modes = whitened(sky(signal=sim.plane_wave((0, 0, 1), 15.0, -8.0)), 5)
    at = 0  # the first pixel is next to the pole
    _, amplitudes, covariance = fit_wave_by_direction(white, modes, 64)
    assert abs(np.linalg.norm(amplitudes[:, at]) - 17) < 4 * np.sqrt(np.trace(covariance[at]) / 2)


def test_error_of_an_amplitude_on_an_even_sky():
    """σ(ḣ) = σ_µ √(6/N), with all degrees; those to 5 hold 99 %."""
    white, modes = whitened(sky(20000, lowest=-1), 5)
    spread = np.sqrt(np.einsum("nii->n", fit_wave_by_direction(white, modes, 2)[2]) / 2)
    assert spread == pytest.approx(50 * np.sqrt(6 / 20000), rel=0.02)


def test_limits_hold():
    """95 % limits on a wave of 0, 1.5 and 4 errors, of any polarisation, lie above it in 95 % of the skies or more."""
    white, modes = whitened(sky(), 3)
    seen, inverse = _compute_templates_and_covariance(white, modes, 2, 1)
    seen, inverse, rng = seen[:, :, 5], inverse[5], np.random.default_rng(2)
    spread = np.sqrt(np.trace(inverse) / 2)
    for size in (0.0, 1.5, 4.0):
        turn = rng.uniform(0, 2 * np.pi, 4000)
        waves = size * spread * (np.outer(np.cos(turn), seen[0]) + np.outer(np.sin(turn), seen[1]))
        g = (waves + rng.standard_normal(waves.shape)) @ seen.T
        held = length_limits(g @ inverse, np.broadcast_to(inverse, (4000, 2, 2))) >= size * spread
        assert held.mean() > 0.94


@pytest.mark.parametrize("size", [0.0, 2.0, 6.0, 20.0])
@pytest.mark.parametrize(("k", "ratio"), [(2, 4.0), (2, 100.0), (4, 25.0)])
def test_limits_hold_where_errors_differ_by_component(size, k, ratio):
    """One mean error for all, as it was, held 78 % of strong waves in two dimensions with variances of 4 : 1."""
    rng, n = np.random.default_rng(int(ratio)), 2000
    turn = np.linalg.qr(rng.normal(size=(n, k, k)))[0]
    covariance = np.einsum("nij,j,nkj->nik", turn, ratio ** np.linspace(-0.5, 0.5, k), turn)
    unit = rng.normal(size=(n, k))
    true = size * np.sqrt(np.trace(covariance[0]) / k) * unit / np.linalg.norm(unit, axis=1)[:, None]
    seen = true + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(n, k)))
    held = np.mean(length_limits(seen, covariance) >= np.linalg.norm(true, axis=1))
    assert held > 0.95 - 0.012 - 2.5 * np.sqrt(0.05 * 0.95 / n)
    if size < 20:
        return
    assert held < 0.97
    # The same of those along the largest error, which one mean error for all holds in fewer.
    worst = size * np.sqrt(np.trace(covariance[0]) / k) * turn[:, :, -1]
    seen = worst + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(n, k)))
    assert np.mean(length_limits(seen, covariance) >= np.linalg.norm(worst, axis=1)) > 0.938


def test_report_and_strain():
    found = search(fit.fit_field(sky(), 4), n_skies=50, nside=4)
    text = found.report()
    assert "(1 nHz/f)" in text
    assert "95 % limits" in text
    assert found.strain(10.0) == pytest.approx(found.amplitude * 2.445e-12, rel=1e-3)
    assert found.strain_limits(1.0).shape == (192,)
    with pytest.raises(ParameterError, match="a frequency"):
        found.strain()
    with pytest.raises(ModesError, match="from 2 on"):
        search(fit.fit_field(sky(), 3), degrees=(1, 2))
    with pytest.raises(ModesError, match="from 2 on"):
        search(fit.fit_field(sky(), 1))
    assert search(fit.fit_field(sky(), 4), degrees=(2,), n_skies=20, nside=4).degrees == (2,)
    same = search(fit.normal_equations(sky(), 4), n_skies=50, nside=4)
    np.testing.assert_allclose(same.statistic, found.statistic, rtol=1e-8)


def observations(n=150, seed=1, frequency=1.3, amplitude=0.0):
    """Fifty transits of each source in directions of their own, over five years."""
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    source, time = np.repeat(np.arange(n), 50), rng.uniform(-2.5, 2.5, 50 * n)
    angle, factor = rng.uniform(0, 2 * np.pi, 50 * n), rng.uniform(-0.7, 0.7, 50 * n)
    design, error = make_design_rows(angle, factor, time), np.full(50 * n, 100.0)
    own = rng.normal(0, 500, (n, 5))
    position = np.einsum("ki,ik->k", own[source], design) + error * rng.normal(size=50 * n)
    wave = amplitude * wave_motions(lon, lat, K, 1.0, 0.5)
    swing = wave[:, source] * np.cos(2 * np.pi * frequency * time + 0.7)
    position += np.sum(design[:2] * swing, axis=0)
    return Observations(lon, lat, source, time, design, position, error, np.arange(n))


@pytest.mark.slow
def test_wave_in_time_is_found_and_noise_is_not():
    found = search_in_time(observations(amplitude=40.0), 1.3, lmax=4, n_skies=100, attitude="known")
    assert found.p_value == pytest.approx(1 / 101)
    assert np.degrees(np.arccos(found.vector @ K)) < 25
    assert found.amplitude == pytest.approx(40 * np.hypot(1, 0.5), rel=0.35)
    assert found.strain() == pytest.approx(found.amplitude * 4.848e-12, rel=1e-3)
    assert "plus cos" in found.report()
    skies = (observations(seed=seed) for seed in range(30))
    none = [search_in_time(each, 1.3, lmax=3, nside=4, n_skies=60, attitude="known").p_value for each in skies]
    assert kstest(none, "uniform").pvalue > 0.01
    # Elsewhere in frequency there is nothing.
    assert search_in_time(observations(amplitude=40.0), 2.9, lmax=4, n_skies=100, attitude="known").p_value > 0.01


def test_in_time_messages():
    few = observations(5)
    with pytest.raises(DegeneracyError, match="do not determine"):
        search_in_time(few, 1.0, lmax=6, n_skies=1, attitude="known")
    short = Observations(few.lon, few.lat, few.source[:3], few.time[:3], few.design[:, :3], few.position[:3], few.error[:3], few.name)  # fmt: skip
    with pytest.raises(DegeneracyError, match="five parameters"):
        search_in_time(short, 1.0, n_skies=1, attitude="known")
    with pytest.raises(ParameterError, match="must be Observations"):
        search_in_time(sky(), 1.0, attitude="known")
    with pytest.raises(ParameterError, match="from 2 on"):
        search_in_time(few, 1.0, lmax=1, attitude="known")


def test_observations_of_a_file(tmp_path):
    population = sim.quasars(30, 1)
    table = sim.gaia.epochs(population, sim.spin((0, 0, 0)), 1, mission=sim.NominalScanningLaw(years=2.0))
    table.write(tmp_path / "epochs.fits")
    found = read_observations(tmp_path / "epochs.fits")
    assert len(found.lon) == 30
    assert found.position.std() == pytest.approx(np.sqrt(np.mean(found.error**2)), rel=0.1)
    assert search_in_time(found, 3.0, lmax=2, nside=2, n_skies=20, attitude="known").p_value > 0.01
