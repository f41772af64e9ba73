"""Skies with a known truth."""

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT

import sim
from examples import make_demo_catalogue
from vsh import Coefficients, Modes
from vsh.sky.frames import rotation_matrix
from vsh.tools.errors import VshError


@pytest.mark.parametrize(("release", "east", "north"), [("DR3", 635, 549), ("DR4", 268, 231), ("DR5", 94, 81)])
def test_errors_at_20_are_the_published_ones(release, east, north):
    # docs/theory.md gives them for t and the ratios rounded; the DR4 and DR5 ratios already hold t.
    found = sim.gaia_errors(np.array([20.0]), release).ravel()
    np.testing.assert_allclose(found, [east, north], rtol=0.01)


def test_magnitudes_have_the_published_counts():
    """Of 1 215 942 quasars, 29 200 to G = 18, 146 614 to 19, 490 161 to 20."""
    n = 200_000
    magnitude = sim.quasars(n, rng=1, max_magnitude=21.0).magnitude
    for limit, count in ((18, 29_200), (19, 175_814), (20, 665_975)):
        share = count / 1_215_942
        assert abs((magnitude <= limit).mean() - share) < 4 * np.sqrt(share / n)
    assert magnitude.max() <= 21


def test_plane_is_avoided():
    lon, lat = sim.plane_avoiding_sky(10_000, rng=1, latitude=20)
    r = np.array([np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)])
    sin_b = (rotation_matrix("icrs", "galactic") @ r)[2]
    assert np.abs(sin_b).min() >= np.sin(np.radians(20)) - 1e-12
    assert abs((sin_b > 0).mean() - 0.5) < 0.02


def test_signals_add():
    lon, lat = sim.uniform_sky(20, rng=1)
    any_field = Coefficients(Modes(2), np.arange(16.0))
    total = sim.spin((1, 2, 3)) + sim.acceleration((0, 0, 4)) + any_field
    expected = (Coefficients.from_vectors((1, 2, 3), (0, 0, 4)) + any_field).at(lon, lat)
    np.testing.assert_allclose(total(lon, lat), expected, atol=1e-12)


def test_noise_has_the_covariance_that_is_stated():
    population = sim.Population(*sim.uniform_sky(100_000, rng=1), None)
    field = sim.observe(population, sim.spin((0, 0, 0)), rng=2, sigma=[[3.0], [5.0]], rho=-0.6)
    np.testing.assert_allclose(np.cov(field.motion), [[9, -9], [-9, 25]], rtol=0.02)
    assert abs(np.mean(field.chi2) - 2) < 4 * 2 / np.sqrt(100_000)


def test_seed_is_all_there_is():
    quasars = sim.quasars(50, rng=1)
    one, two, other = (sim.observe(quasars, sim.spin((1, 0, 0)), rng=seed).motion for seed in (5, 5, 6))
    np.testing.assert_array_equal(one, two)
    assert not np.array_equal(one, other)


def test_wrong_names_are_told_the_right_ones():
    with pytest.raises(ValueError, match="unknown release 'DR9': choose one of DR3"):
        sim.gaia_errors(np.array([20.0]), "DR9")
    with pytest.raises(ValueError, match="18 < G ≤ 21"):
        sim.quasars(10, rng=1, max_magnitude=25)


def test_demo_is_what_its_script_makes():
    table = Table.read(ROOT / "fit" / "demo.fits")
    for name, column in make_demo_catalogue.demo_columns().items():
        np.testing.assert_allclose(table[name], column, rtol=1e-6, err_msg=name)
    np.testing.assert_allclose([table.meta[f"SPIN_{axis}"] for axis in "XYZ"], make_demo_catalogue.SPIN)


@pytest.mark.parametrize(
    "options",
    [{"excess_noise": 10.0}, {"quote_variability": True}, {"sigma": 1.0, "mission": 5}, {"rho": 0.1, "mission": 5}],
)
def test_options_that_would_have_no_effect_are_refused(options):
    """They were ignored without a word."""
    if "mission" in options:
        options = options | {"mission": sim.NominalScanningLaw(years=1.0)}
    with pytest.raises(VshError, match="mission"):
        sim.observe(sim.quasars(5, 1), sim.spin((0, 0, 0)), 1, **options)


def test_epochs_show_both_components_along_the_scan():
    """µ_α* sin ψ + µ_δ cos ψ, times the time since the epoch; the noise is the same of the same seed."""
    population = sim.quasars(6, rng=1)
    mission = sim.Mission(sim.NominalScanningLaw(years=2.0), "DR4")
    still, moving = (
        sim.epochs(population, sim.acceleration(value), 2, mission=mission)
        for value in ((0.0, 0.0, 0.0), (3e4, -2e4, 5e4))
    )
    arrival = np.asarray(still["obs_time_tcb"], float) + np.asarray(still["obs_time_bary_corr"], float)[:, None]
    time = arrival / 1e9 / (365.25 * 86400) + 2010
    angle, source = np.radians(np.asarray(still["scan_pos_angle"])), np.asarray(still["source_id"]) - 1
    motion = sim.acceleration((3e4, -2e4, 5e4))(population.lon, population.lat)[:, source]
    shift = (motion[0] * np.sin(angle) + motion[1] * np.cos(angle))[:, None] * (time - still.meta["REFEPOCH"])
    np.testing.assert_allclose(moving["centroid_pos_al"] - still["centroid_pos_al"], shift / 1000, atol=1e-3)


def test_errors_of_vlbi_scatter_by_a_factor_of_two():
    data = sim.link(1, 400, binaries=0.0)
    here = data.catalogue == "vlbi"
    spread = np.log10(np.sqrt(data.covariance[here][:, 0, 0]))
    assert np.std(spread) == pytest.approx(0.3, abs=0.05)
