"""What could deceive, in simulated frames: correlations, learnt redshifts, shared errors, stars."""

import numpy as np
import pytest
from conftest import real_catalogue
from scipy.stats import spearmanr

import sim
from sim.commands.simulate import main as simulate
from sim.gaia._link import TRAPS, find_error_inflation
from sim.population import REDSHIFT_BY_MAGNITUDE, assign_redshifts
from vsh.io.catalogue import read_field
from vsh.models.covariance import LINDEGREN_2021


def test_bright_quasars_are_nearer():
    quasars = sim.quasars(40_000, 1)
    assert spearmanr(quasars.redshift, quasars.magnitude)[0] == pytest.approx(REDSHIFT_BY_MAGNITUDE, abs=0.015)
    z, g = np.random.default_rng(1).gamma(2, 1, 1000), np.random.default_rng(2).normal(19, 1, 1000)
    np.testing.assert_array_equal(np.sort(assign_redshifts(z, g, 3)), np.sort(z))  # the same redshifts


def test_as_in_sdss():
    from astropy.table import Table

    table = Table.read(real_catalogue("sdss_dr5_quasars.fits"))
    assert spearmanr(table["z"], table["imag"])[0] == pytest.approx(REDSHIFT_BY_MAGNITUDE, abs=0.001)


@pytest.fixture(scope="module")
def both():
    """The same sky without traps and with them."""
    still = sim.spin((0, 0, 0))
    return [sim.crf3(3, still, n_five=30_000, traps=traps) for traps in (False, True)]


@pytest.mark.slow
def test_traps_change_motions_alone(both):
    clean, trapped = both
    for name in set(clean.colnames) - {"pmra", "pmdec", "parallax"}:
        np.testing.assert_array_equal(np.asarray(clean[name]), np.asarray(trapped[name]))
    assert clean.colnames == trapped.colnames


@pytest.mark.slow
def test_columns_of_scans_and_redshifts(both):
    table = both[0]
    assert 10 < np.median(table["visibility_periods_used"]) < 30  # DR3's: 19 (34 months)
    assert (table["visibility_periods_used"] <= table["matched_transits"]).all()
    assert (table["scan_direction_strength_k2"] >= 0).all()
    assert (table["scan_direction_strength_k2"] <= 1).all()
    assert np.abs(table["scan_direction_mean_k2"]).max() <= 90
    z = np.asarray(table["redshift_qsoc"], float)
    known = np.isfinite(z)
    assert known.mean() == pytest.approx(0.6, abs=0.02)
    # One in twenty redshifts is another's: the rank correlation is a little smaller.
    assert spearmanr(z[known], table["phot_g_mean_mag"][known])[0] == pytest.approx(0.235, abs=0.025)
    assert abs(spearmanr(z[known], table["bp_rp"][known])[0]) > 0.03


@pytest.mark.slow
def test_traps_are_shared_by_sources(both):
    """The difference of both skies: systematic errors, stars within five errors, noise of faint ones a tenth larger."""
    clean, trapped = (read_field(table) for table in both)
    away = trapped.motion - clean.motion
    noise = clean.motion * (find_error_inflation(clean.magnitude) - 1)
    shared = np.median(np.abs(away - noise)) / 0.6745
    # One sky scatters; between half of it (the bright and red) and all of it is shared by a source.
    assert 0.35 < shared / (TRAPS["DR3"] * np.sqrt(LINDEGREN_2021(np.zeros(1))[0])) < 1.6
    size = np.hypot(*((away - noise) / clean.sigma))
    stars = size > 1
    assert 0.003 < stars.mean() < 0.006  # those of less than one error are not told
    assert size.max() < 5.5


@pytest.mark.slow
def test_command_says_traps(tmp_path, capsys):
    path = tmp_path / "crf4.fits"
    assert simulate(["crf4", "--traps", "--number", "1000", "--output", str(path)]) == 0
    with pytest.raises(SystemExit):
        simulate(["quasars", "--traps", "--output", str(tmp_path / "q.fits")])
    assert "--traps is for crf3 and crf4" in capsys.readouterr().err
