"""Simulated twins of the real catalogues: what the tests on those look at is tried on a clone without them too."""

import numpy as np
import pytest
from astropy.table import Table

import fit
import sim
from fit.redshift import binned, permutation_test
from vsh import Coefficients, Modes
from vsh.io.catalogue import match, read_field, read_icrf
from vsh.io.maps import read_map

ACCELERATION = np.array([0.1, -1.4, -0.8])


@pytest.fixture(scope="module")
def vlba(tmp_path_factory):
    """Like Truebenbach & Darling's (2017) table: 713 radio sources in µas/yr, heavy tails, errors 2.7 times too small,
    no correlations, some redshifts missing or negative, columns in several types."""
    rng = np.random.default_rng(5)
    n = 713
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.normal(1.0, 0.4, (2, n))
    noise = 2.7 * sigma * rng.standard_t(4, (2, n)) / np.sqrt(2)
    motion = sim.acceleration(ACCELERATION)(lon, lat) + noise
    z = np.round(sim.population.quasar_redshifts(n, rng), 2)
    z[rng.choice(n, 54, replace=False)] = np.nan
    z[np.flatnonzero(np.isfinite(z))[:4]] = -1e-3
    table = Table({"name": [f"Q{i:04d}" for i in range(n)], "ra": np.degrees(lon), "dec": np.degrees(lat), "pmra": motion[0],
                   "pmdec": motion[1], "pmra_error": sigma[0], "pmdec_error": sigma[1], "n_epoch": rng.poisson(90, n),
                   "new_vlba": rng.random(n) < 0.5, "z": z, "f_z": ["d"] * n})  # fmt: skip
    for name in ("ra", "dec"):
        table[name].unit = "deg"
    for name in ("pmra", "pmdec", "pmra_error", "pmdec_error"):
        table[name].unit = "uas / yr"
    path = tmp_path_factory.mktemp("vlba") / "vlba.ecsv"
    table.write(path)
    return path


def test_table_of_radio_sources_is_read_whole(vlba):
    field = read_field(vlba)
    assert len(field) == 713
    assert np.isfinite(field.redshift).sum() == 659
    assert field.name[0] == "Q0000"
    assert "correlations taken as zero" in " ".join(field.notes)


def test_robust_fits_find_the_acceleration(vlba):
    field = read_field(vlba)
    for solution in (fit.robust.student_t(field, 1).solution,
                     fit.robust.excess_noise(field, 1, scale=True).solution, fit.resample.jackknife(field, 1, 4).resampled_solution):  # fmt: skip
        a = solution.acceleration
        assert np.abs((a.value - ACCELERATION) / a.sigma).max() < 3.5


def test_clipped_residuals_suggest_larger_errors(vlba):
    field = read_field(vlba)
    clipped = fit.robust.clip(field, Modes(1), kappa=3)
    text = clipped.solution.report()
    assert "the residuals suggest errors 2." in text
    assert fit.cross_check(field[clipped.kept]).largest < 1e-9


def test_bins_of_a_table_with_wrong_errors_claim_nothing(vlba):
    field = read_field(vlba)
    found = binned(field, 1, [0.01, 0.5, 1, 1.5, 7], method="least-squares")
    text = found.report(p_values=permutation_test(field, found, n_permutations=199))
    assert "  contradicted" not in text
    assert "54 missing, 4 zero or negative" in text
    assert found.trend().test.p_value_quoted < 0.05


def icrf_line(i, lon, lat, sigma):
    hours, degrees = np.degrees(lon) / 15, np.degrees(abs(lat))
    h, d = int(hours), int(degrees)
    m, am = int((hours - h) * 60), int((degrees - d) * 60)
    s, asec = ((hours - h) * 60 - m) * 60, ((degrees - d) * 60 - am) * 60
    sign = "-" if lat < 0 else "+"
    return (f"ICRF J{i:06d}.0+000000 {i:04d}+000 {'D' if i % 3 else ' '} {h:02d} {m:02d} {s:011.8f} {sign}{d:02d} {am:02d} {asec:010.7f} "
            f"{sigma / 15e6 / np.cos(lat):.8f} {sigma / 1e6:.7f} 0.1000 50000.0 50000.0 50000.0 10 100\n")  # fmt: skip


def test_two_icrf_catalogues_differ_by_what_was_put_in(tmp_path):
    rng = np.random.default_rng(3)
    n = 400
    lon, lat = sim.uniform_sky(n, rng)
    truth = Coefficients.from_vectors(rotation=(30, -20, 10), glide=(-21, -65, -93))
    east, north = truth.at(lon, lat) / 206264806247.1
    (tmp_path / "two.txt").write_text("heading\n\n" + "".join(icrf_line(i, lon[i], lat[i], 60) for i in range(n)))
    moved = lon + east / np.cos(lat), lat + north
    (tmp_path / "three.txt").write_text("".join(icrf_line(i, moved[0][i], moved[1][i], 40) for i in range(n - 20)))
    a, b = read_icrf(tmp_path / "three.txt", "iers"), read_icrf(tmp_path / "two.txt", "iers")
    assert a.defining.sum() == np.sum(np.arange(n - 20) % 3 > 0)
    field = match(a, b)
    assert "matched 380 sources by name; unmatched: 0 of 380 and 20 of 400" in " ".join(field.notes)
    found = fit.fit_field(field, 1).coefficients
    # Positions are written to 1e-8 s and 1e-7 arcsec: 0.1 µas.
    np.testing.assert_allclose(np.r_[found.rotation, found.glide], [30, -20, 10, -21, -65, -93], atol=0.1)


def test_selection_function_from_a_file(tmp_path, capsys):
    healpy = pytest.importorskip("healpy", reason="there is no healpy for Windows")

    from sim.commands.simulate import main as simulate

    density = np.where(np.abs(np.degrees(np.pi / 2 - healpy.pix2ang(16, np.arange(12 * 256))[0])) > 20, 1.0, 0.0)
    density[:3] = np.nan
    healpy.write_map(str(tmp_path / "map.fits"), density, coord="G", dtype=float)
    values, frame = read_map(tmp_path / "map.fits")
    assert (len(values), frame) == (12 * 256, "galactic")
    words = ["quasars", "--number", "500", "--errors", "expected"]
    assert simulate([*words, "--sky", str(tmp_path / "map.fits"), "--output", str(tmp_path / "q.fits")]) == 0
    assert "3 of 3072 pixels" in capsys.readouterr().out
    assert np.abs(np.degrees(read_field(tmp_path / "q.fits").to_frame("galactic").lat)).min() > 15
    density[5] = np.inf
    healpy.write_map(str(tmp_path / "inf.fits"), density, coord="G", dtype=float)
    assert simulate([*words, "--sky", str(tmp_path / "inf.fits"), "--output", str(tmp_path / "x.fits")]) == 1
    assert "infinite" in capsys.readouterr().err  # once every source stood there, status 0
    healpy.write_map(str(tmp_path / "where.fits"), np.ones(192), dtype=float)
    words = ["quasars", "--number", "50", "--output", str(tmp_path / "y.fits"), "--sky"]
    assert simulate([*words, str(tmp_path / "where.fits")]) == 1
    assert "does not state its frame" in capsys.readouterr().err
    assert simulate([*words, f"icrs:{tmp_path / 'where.fits'}"]) == 0
