"""Fields from SkyCoord, fields as tables, and what a notebook shows."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.table import Table

from vsh import Field, FieldError, FrameError, ScalarField, Vector
from vsh.io import catalogue
from vsh.tools.notebook import format_html_value

RNG = np.random.default_rng(1)
N = 20
COORD = SkyCoord(
    RNG.uniform(0, 360, N) * u.deg, np.degrees(np.arcsin(RNG.uniform(-1, 1, N))) * u.deg,
    pm_ra_cosdec=RNG.normal(size=N) * u.uas / u.yr, pm_dec=RNG.normal(size=N) * u.mas / u.yr,
)  # fmt: skip
ERRORS = RNG.uniform(0.1, 1, (2, N))


def test_from_skycoord():
    field = Field.from_skycoord(COORD, ERRORS[0], ERRORS[1] * u.uas / u.yr, np.full(N, 0.3), redshift=np.ones(N))
    np.testing.assert_allclose(field.lon, COORD.ra.rad, rtol=1e-15)
    np.testing.assert_allclose(field.motion, [COORD.pm_ra_cosdec.to_value("uas/yr"), COORD.pm_dec.to_value("uas/yr")])
    np.testing.assert_allclose(field.sigma, [1000 * ERRORS[0], ERRORS[1]])
    assert field.frame == "icrs"
    assert field.redshift.sum() == N


def test_other_frames_turn_as_astropy_turns_them():
    for theirs, ours in (("galactic", "galactic"), ("barycentricmeanecliptic", "ecliptic")):
        there = Field.from_skycoord(COORD.transform_to(theirs), *ERRORS)
        assert there.frame == ours
        here = Field.from_skycoord(COORD, *ERRORS).to_frame(ours)
        np.testing.assert_allclose(there.motion, here.motion, rtol=0, atol=2e-9)


def test_columns_of_a_table_keep_their_units():
    """Found by a newcomer: errors in µas/yr were taken as mas/yr."""
    table = Table(
        {"pmra_error": ERRORS[0], "pmdec_error": ERRORS[1]},
        units=dict.fromkeys(["pmra_error", "pmdec_error"], "uas/yr"),
    )
    field = Field.from_skycoord(COORD, table["pmra_error"], table["pmdec_error"])
    np.testing.assert_allclose(field.sigma, ERRORS, rtol=1e-14)
    masked = Table(table, masked=True)
    masked["pmra_error"].mask[2] = True
    assert len(Field.from_skycoord(COORD, masked["pmra_error"], masked["pmdec_error"], on_bad="drop")) == N - 1
    table["pmra_error"].unit = "m"
    with pytest.raises(FieldError, match="pmra_error cannot be converted to mas / yr"):
        Field.from_skycoord(COORD, table["pmra_error"], table["pmdec_error"])


def test_numbers_that_stand_for_none_are_no_motions():
    for motion, error in ((-9999.0, 1.0), (1.0, 99999.0), (1e20, 1.0)):
        with pytest.raises(FieldError, match="marks missing data"):
            Field.from_columns([10.0], [20.0], [motion], [1.0], [1.0], [error])


@pytest.mark.parametrize(("coord", "error", "words"), [
    (COORD.fk5, FrameError, "coordinates in fk5 are not known: convert to icrs, galactic, bary"),
    (SkyCoord(COORD.ra, COORD.dec), FieldError, "has no proper motions: give it pm_ra_cosdec and pm_dec"),
    ([1, 2], FieldError, "a SkyCoord is expected, not list"),
])  # fmt: skip
def test_tables_that_are_no_field(coord, error, words):
    with pytest.raises(error, match=words):
        Field.from_skycoord(coord, *ERRORS)


def test_scalar_fields_are_written_too(tmp_path):
    field = ScalarField.from_columns([10.0, 20.0], [1.0, 2.0], [3.0, 4.0], [1.0, 1.0], unit="µas", frame="ecliptic")
    field.write(tmp_path / "s.ecsv")
    back = catalogue.read_scalars(tmp_path / "s.ecsv", "value")
    assert (back.frame, back.unit) == ("ecliptic", "µas")
    np.testing.assert_allclose(back.values, field.values, rtol=1e-15)


def test_in_a_notebook():
    html = Field.from_skycoord(COORD, *ERRORS, notes=["<script>"])._repr_html_()
    assert "20 sources, icrs" in html
    assert "2 × 20, from" in html
    assert "redshift" not in html  # nobody knows one
    assert "&lt;script&gt;" in html
    assert "<script>" not in html
    html = Vector([3.0, 4.0, 0.0], np.eye(3))._repr_html_()
    assert "5.0 ± 1.0 µas/yr" in html
    assert format_html_value(np.array([1.0, np.nan] * 20)) == "40, from 1 to 1, 20 missing"
    assert format_html_value(np.array(["a", "b", "c", "d"])) == "4: a, b, c, …"
    assert len(format_html_value("x" * 1000)) < 200
