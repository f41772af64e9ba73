"""Populations on their skies."""

import numpy as np
import pytest
from astropy.table import Table
from conftest import real_catalogue

import sim
from sim.skies import draw_positions, sky_map
from vsh.io.maps import read_map
from vsh.models.cosmology import transverse_distance
from vsh.sky.pixels import centres, pixels_of
from vsh.sky.sphere import triad
from vsh.tools.errors import FieldError, TableError


def test_positions_have_the_density_of_the_map():
    density = np.random.default_rng(1).uniform(0, 1, 48)
    density[5] = np.nan
    lon, lat = draw_positions(100_000, 2, density)
    counts = np.bincount(pixels_of(lon, lat, 2), minlength=48)
    expected = 100_000 * np.nan_to_num(density) / np.nansum(density)
    assert counts[5] == 0
    assert np.abs((counts - expected) / np.sqrt(np.maximum(expected, 1))).max() < 5


def test_positions_fill_their_pixels():
    """A map of one value is a uniform sky: components of the mean direction vanish like n^-½."""
    lon, lat = draw_positions(100_000, 1, np.ones(12))
    assert np.abs(triad(lon, lat)[2].mean(1)).max() < 4 / np.sqrt(3 * 100_000)
    assert len(np.unique(lon + 1j * lat)) > 99_990


@pytest.mark.parametrize("sky", ["uniform", "plane-avoiding", "gums", "igql"])
def test_named_skies(sky):
    density, frame = sky_map(sky)
    assert frame == "galactic"
    assert density.min() >= 0
    latitude = np.degrees(centres(64)[1])
    plane = density[np.abs(latitude) < 2].mean() / density.mean()
    assert plane == pytest.approx(1) if sky == "uniform" else plane < 0.05
    assert len(sim.quasars(100, 1, sky)) == 100


def test_igql_is_northern():
    lat = sim.quasars(20_000, 1, "igql").lat
    assert (lat > 0).mean() > 0.7
    assert (lat < np.radians(-40)).mean() < 0.02


@pytest.mark.parametrize(
    ("sky", "message"),
    [("flat", "unknown sky 'flat': choose one of uniform, plane-avoiding, gums, igql"), (np.ones(13), "13 pixels is no HEALPix map"),
     (-np.ones(12), "must not be negative"), (np.zeros(12), "not zero everywhere")],
)  # fmt: skip
def test_bad_skies(sky, message):
    with pytest.raises(ValueError, match=message):
        sim.quasars(10, 1, sky)


def test_galaxies_fill_the_volume():
    galaxies = sim.galaxies(50_000, rng=1, absolute=-25.0)  # all of them bright enough
    cube = transverse_distance(galaxies.redshift) ** 3
    low, high = transverse_distance(np.array([0.001, 0.03])) ** 3
    assert np.mean((cube - low) / (high - low)) == pytest.approx(0.5, abs=4 * np.sqrt(1 / 12 / 50_000))
    assert 0.001 <= galaxies.redshift.min() < galaxies.redshift.max() <= 0.03
    faint = sim.galaxies(20_000, rng=1)
    assert faint.magnitude.max() < 20
    counts, edges = np.histogram(faint.magnitude, np.arange(12, 20.1, 0.5))
    assert 16 <= edges[counts.argmax()] <= 17.5
    with pytest.raises(ValueError, match="(must rise from above zero|min_redshift must be above zero)"):
        sim.galaxies(10, 1, min_redshift=0.0)


def test_vlbi_is_a_subset():
    quasars = sim.quasars(1000, 1)
    chosen = sim.vlbi_quasars(quasars, 50, 2)
    assert len(chosen) == 50
    assert np.isin(chosen.magnitude, quasars.magnitude).all()
    with pytest.raises(ValueError, match="2000 quasars cannot be chosen from 1000"):
        sim.vlbi_quasars(quasars, 2000, 1)


def test_selection_functions():
    values, frame = read_map(real_catalogue("selection_function_NSIDE64_G20.0.fits"))
    assert len(values) == 12 * 64**2
    quasars = sim.quasars(20_000, 1, values, map_frame=frame or "galactic")
    assert len(quasars) == 20_000


def test_bad_maps(tmp_path):
    (tmp_path / "map.fits").write_text("no map")
    with pytest.raises(TableError, match="is damaged or not FITS"):
        read_map(tmp_path / "map.fits")
    with pytest.raises(FieldError, match="no HEALPix map"):
        draw_positions(1, 1, np.ones(5))


@pytest.mark.parametrize(("name", "rows"), [("openngc_galaxies.ecsv", 9940), ("sdss_dr5_quasars.fits", 77_429)])
def test_positions_of_a_real_table(name, rows):
    table = Table.read(real_catalogue(name))
    redshift = np.ma.filled(np.ma.asarray(table["z"], float), np.nan)
    population = sim.Population(np.radians(table["ra"]), np.radians(table["dec"]), redshift=redshift)
    assert len(population) == rows
    assert np.isfinite(population.redshift).mean() > 0.9
    field = sim.observe(population, sim.acceleration((0, 5, 0)), rng=1, sigma=10.0)
    np.testing.assert_array_equal(field.redshift, population.redshift)


@pytest.mark.slow
def test_galaxies_that_cluster_do_cluster():
    galaxies, _ = sim.clustered_galaxies(3000, 1)
    assert len(galaxies) == 3000
    counts = np.histogram2d(galaxies.lon, np.sin(galaxies.lat), (8, 4))[0]
    # Poisson counts would have a variance of their mean.
    assert counts.var() > 1.5 * counts.mean()
