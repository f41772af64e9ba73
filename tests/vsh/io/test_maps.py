"""HEALPix maps as densities of sources: what they predict is what the sources themselves give."""

import numpy as np
import pytest

import fit
import sim
from fit.commands.correlate import main
from vsh import TableError
from vsh.io.catalogue import read_sources
from vsh.io.maps import read_density
from vsh.sky.pixels import pixels_of

healpy = pytest.importorskip("healpy", reason="there is no healpy for Windows")
NSIDE = 32


@pytest.fixture(scope="module")
def field():
    quasars = sim.quasars(20_000, rng=1, sky="plane-avoiding")
    return sim.observe(quasars, sim.spin((0, 0, 0)), rng=2, sigma=300.0).to_frame("galactic")


def write(values, path, **options):
    healpy.write_map(path, values, dtype=np.float64, **options)
    return path


@pytest.mark.parametrize("nested", [False, True])
def test_map_of_counts_predicts_the_covariance_of_the_sources(field, tmp_path, nested):
    counts = np.bincount(pixels_of(field.lon, field.lat, NSIDE), minlength=12 * NSIDE**2).astype(float)
    path = write(healpy.reorder(counts, r2n=True) if nested else counts, tmp_path / "map.fits", nest=nested, coord="G")
    density = read_sources(path, sigma=300.0)
    assert density.frame == "galactic"
    ours, theirs = (fit.correlation.predict_covariance(each, 1).covariance for each in (density, field))
    np.testing.assert_allclose(ours, theirs, atol=2e-3 * np.diag(theirs).max())


def test_pixels_without_a_value_are_empty_and_counted(tmp_path):
    values = np.ones(12 * 4**2)
    values[:5], values[5] = healpy.UNSEEN, 0.0
    density = read_density(write(values, tmp_path / "map.fits", coord="C"))
    assert (len(density), density.frame) == (values.size - 6, "icrs")
    assert "5 of 192 pixels of the map have no value" in " ".join(density.notes)


def test_maps_that_are_no_density(tmp_path):
    nowhere = write(np.ones(48), tmp_path / "nowhere.fits")
    with pytest.raises(TableError, match="does not state its frame"):
        read_density(nowhere)
    assert read_density(nowhere, frame="ecliptic").frame == "ecliptic"
    with pytest.raises(TableError, match="12 pixels have a negative number"):
        read_density(write(np.repeat([-1.0, 1.0], [12, 36]), tmp_path / "negative.fits", coord="C"))
    with pytest.raises(TableError, match="no pixel has sources"):
        read_density(write(np.zeros(48), tmp_path / "empty.fits", coord="C"))
    with pytest.raises(TableError, match="neither columns nor rows"):
        read_sources(nowhere, where="dec > 0")


def test_vsh_correlate_reads_a_map(field, tmp_path, capsys):
    counts = np.bincount(pixels_of(field.lon, field.lat, NSIDE), minlength=12 * NSIDE**2).astype(float)
    path = write(counts, tmp_path / "map.fits", coord="G")
    assert main([str(path), "--columns", "sigma=300", "--long"]) == 0
    assert "a map of densities" in capsys.readouterr().out


def test_largest_correlation_is_off_the_diagonal(tmp_path, capsys):
    """A sky without any correlation had one of 1, of a parameter with itself."""
    assert main([str(write(np.ones(12 * 8**2), tmp_path / "map.fits", coord="C"))]) == 0
    line = capsys.readouterr().out.splitlines()[0]
    value, (_, pair) = line.split()[3], line.split(", of ")
    assert abs(float(value.rstrip(","))) < 0.01
    assert len(set(pair.split(" and "))) == 2
