"""A small table in Gaia's columns, and what a field read from it must hold."""

import numpy as np
from astropy.table import Table

N = 30
UNITS = dict.fromkeys(["ra", "dec"], "deg") | dict.fromkeys(["pmra", "pmdec", "pmra_error", "pmdec_error"], "mas / yr")


def table(units=True):
    rng = np.random.default_rng(1)
    columns = {
        "source_id": 4_000_000_000_000_000_001 + np.arange(N),
        "ra": rng.uniform(0, 360, N),
        "dec": rng.uniform(-90, 90, N),
        "pmra": rng.normal(size=N),
        "pmdec": rng.normal(size=N),
        "pmra_error": rng.uniform(0.1, 1, N),
        "pmdec_error": rng.uniform(0.1, 1, N),
        "pmra_pmdec_corr": rng.uniform(-0.5, 0.5, N),
        "phot_g_mean_mag": rng.uniform(15, 20, N),
        "redshift_qsoc": rng.uniform(0.5, 3, N),
    }
    out = Table(columns)
    if units:
        for name, unit in UNITS.items():
            out[name].unit = unit
    return out


def check(field):
    t = table()
    np.testing.assert_array_equal(field.name, t["source_id"])
    assert field.name.dtype == np.int64
    np.testing.assert_allclose(field.lon, np.radians(t["ra"].value), rtol=1e-14)
    np.testing.assert_allclose(field.lat, np.radians(t["dec"].value), rtol=1e-14)
    np.testing.assert_allclose(field.motion, [1000 * t["pmra"].value, 1000 * t["pmdec"].value], rtol=1e-13)
    np.testing.assert_allclose(field.sigma, [1000 * t["pmra_error"].value, 1000 * t["pmdec_error"].value], rtol=1e-13)
    np.testing.assert_allclose(field.rho, t["pmra_pmdec_corr"].value, rtol=1e-13)
    np.testing.assert_allclose(field.magnitude, t["phot_g_mean_mag"].value, rtol=1e-13)
    np.testing.assert_allclose(field.redshift, t["redshift_qsoc"].value, rtol=1e-13)
