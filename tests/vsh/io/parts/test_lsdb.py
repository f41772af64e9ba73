"""LSDB's catalogues in parts, also after a cone and a join. LSDB pins its sisters: `make test-oracles` has a place of its own."""

import numpy as np
import pytest

import fit
from fit import Moments
from vsh import Field
from vsh.io.catalogue import parts

lsdb = pytest.importorskip("lsdb", reason="LSDB is not installed: make test-oracles")
import pandas  # noqa: E402

RNG = np.random.default_rng(3)
N = 5000
TABLE = pandas.DataFrame({
    "source_id": np.arange(N), "ra": RNG.uniform(0, 360, N), "dec": np.degrees(np.arcsin(RNG.uniform(-1, 1, N))),
    "pmra": RNG.normal(size=N), "pmdec": RNG.normal(size=N), "pmra_error": RNG.uniform(0.1, 0.5, N),
    "pmdec_error": RNG.uniform(0.1, 0.5, N), "pmra_pmdec_corr": RNG.uniform(-0.5, 0.5, N), "other": RNG.normal(size=N),
})  # fmt: skip
ROLES = ["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr"]


@pytest.fixture(scope="module")
def catalog(tmp_path_factory):
    path = tmp_path_factory.mktemp("hats") / "sky"
    lsdb.from_dataframe(TABLE, catalog_name="sky", lowest_order=1, highest_order=3, partition_rows=400).write_catalog(
        path
    )
    return path


def close(one, two):
    assert np.abs(one.weights - two.weights).max() <= 1e-12 * np.abs(two.weights).max()
    assert np.abs(one.motions - two.motions).max() <= 1e-12 * np.abs(two.motions).max()
    assert one.n_data == two.n_data


def test_catalogue(catalog):
    whole = Moments.of(Field.from_columns(*(TABLE[name] for name in ROLES)), 5)
    opened = lsdb.open_catalog(catalog)
    sky = parts(opened)
    assert len(sky) == len(opened.get_healpix_pixels()) > 8
    close(Moments.of(sky, 5), whole)
    assert (Moments.of(sky, 5).weights == Moments.of(parts(opened), 5).weights).all()
    close(Moments.of(parts(catalog), 5), whole)  # its folder, without LSDB


def test_cone_and_a_join(catalog):
    opened = lsdb.open_catalog(catalog)
    cone = opened.cone_search(ra=10.0, dec=20.0, radius_arcsec=40 * 3600)
    near = TABLE[np.cos(np.radians(40)) < np.sin(np.radians(TABLE.dec)) * np.sin(np.radians(20)) + np.cos(
        np.radians(TABLE.dec)) * np.cos(np.radians(20)) * np.cos(np.radians(TABLE.ra - 10))]  # fmt: skip
    assert fit.normal_equations(parts(cone), 2).n_data == 2 * len(near)
    known = lsdb.from_dataframe(TABLE[["source_id", "ra", "dec"]][::3].assign(redshift=1.0), catalog_name="known")
    joined = opened.crossmatch(known, radius_arcsec=0.1, suffixes=("", "_known"))
    assert parts(
        joined, columns={"redshift": "redshift_known"} if "redshift_known" in joined.columns else None
    ).counted() == len(TABLE[::3])


def bytes_read():
    """What this process has read so far."""
    with open("/proc/self/io") as file:
        return int(file.readline().split()[1])


def test_only_the_columns_that_are_used_are_read_and_once(tmp_path):
    """150 columns, of which eight are used; and a clip, which passes over them many times."""
    import dask

    import fit.robust

    n = 40_000
    rng = np.random.default_rng(1)
    columns = {name: np.tile(TABLE[name], n // N) for name in ROLES} | {f"x{k}": rng.normal(size=n) for k in range(141)}
    wide = pandas.DataFrame(columns | {"source_id": np.arange(n), "ra": rng.uniform(0, 360, n)})
    lsdb.from_dataframe(wide, catalog_name="wide", lowest_order=0, highest_order=1).write_catalog(tmp_path / "wide")
    used, counts = ["source_id", *ROLES], {}
    with dask.config.set(scheduler="synchronous"):
        for name, options in (("named", {"columns": used}), ("all", {})):
            opened = lsdb.open_catalog(tmp_path / "wide", **options)
            begin = bytes_read()
            fit.normal_equations(parts(opened), 1)
            counts[name] = bytes_read() - begin
        begin = bytes_read()
        fit.robust.clip(parts(lsdb.open_catalog(tmp_path / "wide")), 1, 3)
        counts["clip"] = bytes_read() - begin
    assert counts["all"] < 2 * counts["named"]  # which also reads what the catalogue says of itself
    assert counts["clip"] < 2.5 * counts["named"]
