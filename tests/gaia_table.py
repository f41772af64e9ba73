"""A small table in Gaia's columns, and what a field read from it must hold."""

import numpy as np
from astropy.table import Table

N = 30
NAMES = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")
UNITS = dict.fromkeys(["ra", "dec"], "deg") | dict.fromkeys(["pmra", "pmdec", "pmra_error", "pmdec_error"], "mas / yr")


def table(units=True):
    rng = np.random.default_rng(1)
    out = Table({"source_id": 4_000_000_000_000_000_001 + np.arange(N)})
    out["ra"], out["dec"] = rng.uniform(0, 360, N), rng.uniform(-90, 90, N)
    out["pmra"], out["pmdec"] = rng.normal(size=(2, N))
    out["pmra_error"], out["pmdec_error"] = rng.uniform(0.1, 1, (2, N))
    out["pmra_pmdec_corr"] = rng.uniform(-0.5, 0.5, N)
    out["phot_g_mean_mag"], out["redshift_qsoc"] = rng.uniform(15, 20, N), rng.uniform(0.5, 3, N)
    if units:
        for name, unit in UNITS.items():
            out[name].unit = unit
    return out


class Stream:
    """An object of which nothing is known but its Arrow stream: what polars and DuckDB return."""

    def __init__(self, arrow):
        self.arrow = arrow

    def __arrow_c_stream__(self, requested_schema=None):
        return self.arrow.__arrow_c_stream__(requested_schema)


def check(field):
    """What is read of `table` in any form, with or without units."""
    t = table()
    np.testing.assert_array_equal(field.name, t["source_id"])
    assert field.name.dtype == np.int64
    for found, names, factor in (
        ([field.lon, field.lat], NAMES[:2], np.pi / 180),
        ([*field.motion, *field.sigma], NAMES[2:], 1000),
        ([field.rho, field.magnitude, field.redshift], ("pmra_pmdec_corr", "phot_g_mean_mag", "redshift_qsoc"), 1),
    ):
        np.testing.assert_allclose(found, [factor * t[name].value for name in names], rtol=1e-13)
