"""Names, units and rows of the catalogues of the next years: Quaia, DESI, CatWISE, CatNorth, Rubin, Gaia DR4."""

import numpy as np
import pytest
from astropy.table import Table

from vsh.io.catalogue import read_field
from vsh.tools.errors import FieldError, TableError

N = 200
RNG = np.random.default_rng(0)
RA, DEC = RNG.uniform(0, 360, N), np.degrees(np.arcsin(RNG.uniform(-1, 1, N)))
MOTION, ERROR, Z = RNG.normal(0, 0.3, (2, N)), np.full(N, 0.3), RNG.uniform(0.1, 3, N)
GAIA = {"ra": RA, "dec": DEC, "pmra": MOTION[0], "pmdec": MOTION[1], "pmra_error": ERROR, "pmdec_error": ERROR}


def table(**columns):
    return Table(GAIA | columns)


@pytest.mark.parametrize(("columns", "redshift"), [
    (GAIA | {"redshift_quaia": Z, "redshift_quaia_err": 0.01 * Z}, True),
    ({"TARGETID": np.arange(N), "TARGET_RA": RA, "TARGET_DEC": DEC, "Z": Z, "ZERR": 1e-4 * Z, "PMRA": MOTION[0],
      "PMDEC": MOTION[1], "PMRA_ERROR": ERROR, "PMDEC_ERROR": ERROR}, True),
    ({"RA": RA, "DEC": DEC, "Z": Z, "PMRA": MOTION[0], "PMDEC": MOTION[1], "PMRA_IVAR": ERROR**-2.0,
      "PMDEC_IVAR": ERROR**-2.0}, True),
    ({"ra": RA, "dec": DEC, "PMRA": MOTION[0] / 1e3, "PMDec": MOTION[1] / 1e3, "sigPMRA": ERROR / 1e3,
      "sigPMDec": ERROR / 1e3}, False),
    ({"ra": RA, "dec": DEC, "pmRa": MOTION[0], "pmRaErr": ERROR, "pmDec": MOTION[1], "pmDecErr": ERROR}, False),
    (GAIA | {"z_ph": Z}, True),
], ids=["quaia", "desi", "desi targets", "catwise", "rubin", "catnorth"])  # fmt: skip
def test_names_and_units_are_known(columns, redshift):
    field = read_field(Table(columns))
    np.testing.assert_allclose(field.motion, 1e3 * MOTION, rtol=1e-12)
    np.testing.assert_allclose(field.sigma, 300, rtol=1e-12)
    assert (field.redshift is not None) == redshift
    if redshift:
        np.testing.assert_allclose(field.redshift, Z)


@pytest.mark.parametrize("unit", ["mas", "arcsec"])
def test_units_of_inverse_variances(unit):
    size = {"mas": 1.0, "arcsec": 1e-3}[unit]
    made = Table({"RA": RA, "DEC": DEC, "PMRA": MOTION[0] * size, "PMDEC": MOTION[1] * size,
                  "PMRA_IVAR": (ERROR * size) ** -2.0, "PMDEC_IVAR": (ERROR * size) ** -2.0})  # fmt: skip
    for name in ("PMRA", "PMDEC"):
        made[name].unit, made[f"{name}_IVAR"].unit = f"{unit} / yr", f"yr2 / {unit}2"
    np.testing.assert_allclose(read_field(made).sigma, 300, rtol=1e-12)


def test_motions_called_mu_ask_for_their_unit():
    names = ("mu_ra", "mu_dec", "mu_ra_error", "mu_dec_error")
    columns = {"ra": RA, "dec": DEC} | dict(zip(names, (*MOTION, ERROR, ERROR), strict=True))
    with pytest.raises(TableError, match="no unit"):
        read_field(Table(columns))
    field = read_field(Table(columns), units=dict.fromkeys(names, "mas/yr"))
    np.testing.assert_allclose(field.motion, 1e3 * MOTION)


@pytest.mark.parametrize("name", ["Z_error", "E_Z", "Z_ERROR"])
def test_errors_of_coordinates_and_energies_are_none_of_a_redshift(name):
    assert read_field(table(Z=Z, **{name: ERROR})).redshift_error is None
    both = read_field(table(z=Z, **{name: ERROR}))
    assert both.redshift is not None
    assert both.redshift_error is None


def test_errors_of_redshifts_need_redshifts_and_are_named():
    assert read_field(table(z_error=ERROR)).redshift_error is None
    field = read_field(table(z=Z, z_error=0.01 * Z))
    assert any("errors of the redshifts are in column z_error" in note for note in field.notes)


def test_redshift_whose_error_says_that_it_is_not_known_is_missing():
    errors = 1e-4 * Z
    errors[[3, 7, 11]] = [20.0, 9.99, 99.0]
    field = read_field(table(z=Z, z_error=errors))
    assert np.flatnonzero(np.isnan(field.redshift)).tolist() == [3, 7, 11]
    assert any(
        "3 redshifts with an error of 1 + z or more are taken as missing (first: row 3" in n for n in field.notes
    )


def test_redshift_that_is_not_read_is_named():
    field = read_field(table(photometric_redshift=Z, photometric_redshift_err=ERROR))
    assert field.redshift is None
    assert any("the table has photometric_redshift: --columns redshift=" in note for note in field.notes)


def test_other_astrometric_models_are_left_out_unasked():
    """Every user of DR4 meets them on the first day: they are no bad rows, and are counted by what they are."""
    models = np.full(N, 31)
    models[:5], models[5] = 127, 511
    assert len(read_field(table(astrometric_params=models))) == N - 6
    bad = table(astrometric_params=models)
    bad["pmra"][[2, 50]] = np.nan  # the first is of another model
    with pytest.raises(FieldError, match="1 .*row 50|row 50"):
        read_field(bad)
    assert len(read_field(bad, on_bad="drop")) == N - 7
