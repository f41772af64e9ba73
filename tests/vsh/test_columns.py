"""A field by the names and units of its table, and as objects of other packages."""

import numpy as np
import pytest
from astropy import units
from astropy.table import Table
from conftest import random_field

import fit
import vsh
from vsh.tools.errors import FieldError, FrameError


def test_columns_are_those_of_the_table():
    field = random_field(30, 1)
    table = field.to_table()
    for name in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error"):
        np.testing.assert_allclose(getattr(field, name), np.asarray(table[name]), rtol=1e-12)
    assert field.columns == table.colnames
    assert len(field.head()) == 5
    assert field.z is field.redshift


def test_columns_of_other_axes_name_the_way():
    with pytest.raises(FrameError, match=r'to_frame\("icrs"\)'):
        random_field(30, 1).to_frame("galactic").ra  # noqa: B018


@pytest.mark.parametrize("frame", ["icrs", "galactic", "ecliptic"])
def test_skycoord_is_the_same_place_and_motion(frame):
    """Astropy turns positions and motions to ICRS as we do."""
    field = random_field(30, 1)
    turned = field.to_frame(frame).to_skycoord().icrs
    np.testing.assert_allclose(turned.ra.deg, field.ra, atol=2e-5)
    np.testing.assert_allclose(turned.dec.deg, field.dec, atol=2e-5)
    tolerance = 1e-6 * np.abs(field.motion).max() / 1000
    np.testing.assert_allclose(turned.pm_ra_cosdec.to_value(units.mas / units.yr), field.pmra, atol=1e3 * tolerance)


def test_fields_are_read_where_one_is_wanted(tmp_path):
    field = random_field(60, 1)
    field.write(tmp_path / "q.fits")
    wanted = fit.fit_field(field, 3)
    for given in (str(tmp_path / "q.fits"), tmp_path / "q.fits", Table.read(tmp_path / "q.fits")):
        assert fit.fit_field(given).values == pytest.approx(wanted.values, rel=1e-9)
        assert fit.recommended(given, 1).spin.value == pytest.approx(fit.recommended(field, 1).spin.value, rel=1e-9)
    assert vsh.Field.read(tmp_path / "q.fits").pmra == pytest.approx(vsh.read_field(tmp_path / "q.fits").pmra)
    assert len(vsh.Field.from_table(field.to_table())) == 60
    with pytest.raises(FieldError, match="a path or a table of a catalogue, not int"):
        fit.recommended(3)


def test_field_is_fitted_without_its_table(monkeypatch):
    """A look for columns built the table of every field that was fitted."""
    field = random_field(60, 1)
    monkeypatch.setattr(type(field), "_make_table_columns", lambda self: pytest.fail("the table was built"))
    assert fit.fit_field(field, 1).n_sources == 60


def test_pandas_and_a_plot():
    pytest.importorskip("pandas")
    field = random_field(30, 1)
    assert field.to_pandas()["pmra"].to_numpy() == pytest.approx(field.pmra)
    assert field.plot().figure is not None
