"""Checks, slicing, and what a field may not do to the caller's arrays."""

import astropy.units as u
import numpy as np
import pytest
from astropy.utils.masked import Masked
from conftest import random_field

import fit
from vsh import Field
from vsh.tools.bad_rows import as_floats_and_mask
from vsh.tools.errors import FieldError, FrameError

GOOD = {"ra": [10.0, 20, 30], "dec": [1.0, 2, 3], "pmra": [1.0, 2, 3], "pmdec": [4.0, 5, 6]}
GOOD |= {"pmra_error": [0.1, 0.2, 0.3], "pmdec_error": [0.4, 0.5, 0.6]}


def test_bare_columns_are_gaias():
    field = Field.from_columns(**GOOD, pmra_pmdec_corr=[0.1, 0, -0.1], redshift=[1, np.nan, 2], name=[1, 2, 3])
    np.testing.assert_allclose(field.lon, np.radians([10, 20, 30]))
    np.testing.assert_allclose(field.motion, [[1000, 2000, 3000], [4000, 5000, 6000]])
    np.testing.assert_allclose(field.sigma, [[100, 200, 300], [400, 500, 600]])
    np.testing.assert_array_equal(field.rho, [0.1, 0, -0.1])
    assert len(field) == 3


def test_quantities_come_in_any_unit():
    field = Field.from_columns(
        [10, 20, 30] * u.deg,
        ([1, 2, 3] * u.deg).to(u.arcsec),
        [1, 2, 3] * u.mas / u.yr,
        [4000, 5000, 6000] * u.uas / u.yr,
        Masked([0.1, 0.2, 0.3] * u.mas / u.yr, mask=[False, False, True]),
        ([0.4, 0.5, 0.6] * u.mas / u.yr).to(u.rad / u.s),
        on_bad="drop",
    )
    np.testing.assert_allclose(field.motion, [[1000, 2000], [4000, 5000]])
    np.testing.assert_allclose(field.sigma, [[100, 200], [400, 500]])
    assert field.notes == ("left out 1 of 3 rows: pmra_error missing: 1",)


def test_masks_slices_and_indices_keep_every_column():
    field = Field.from_columns(**GOOD, redshift=[1, 2, 3], magnitude=[15, 16, 17], name=["a", "b", "c"])
    for keep in (np.array([False, True, True]), slice(1, None), [1, 2]):
        part = field[keep]
        assert list(part.name) == ["b", "c"]
        np.testing.assert_array_equal(part.redshift, [2, 3])
        np.testing.assert_array_equal(part.magnitude, [16, 17])
        np.testing.assert_array_equal(part.motion, field.motion[:, 1:])
    assert len(field[1]) == 1


def test_field_cannot_be_changed_and_changes_nothing():
    motion = np.ones((2, 3))
    field = Field(np.zeros(3), np.zeros(3), motion, np.ones((2, 3)))
    with pytest.raises(ValueError, match="read-only"):
        field.motion[0] = 5
    motion[0] = 2  # the caller's own array is still the caller's to change


def test_integers_and_float32_and_big_endian_are_numbers():
    columns = {name: np.array(values, dtype=">f4") for name, values in GOOD.items()}
    columns["ra"] = np.array([10, 20, 30], dtype="u1")
    field = Field.from_columns(**columns)
    assert field.motion.dtype == np.dtype("=f8")
    np.testing.assert_allclose(field.motion, Field.from_columns(**GOOD).motion)


def test_columns_of_a_table_of_rows_are_columns():
    """A strided column, and single numbers where columns are expected."""
    table = np.array([GOOD[name] for name in GOOD]).T.copy()
    field = Field.from_columns(**{name: table[:, k] for k, name in enumerate(GOOD)})
    np.testing.assert_array_equal(field.motion, Field.from_columns(**GOOD).motion)
    assert as_floats_and_mask("ra", table[:, 0])[0].flags.c_contiguous
    assert as_floats_and_mask("ra", np.array(3.0))[0].shape == (1,)


def test_every_fault_is_counted_once():
    n = 10
    columns = {name: np.full(n, values[0]) for name, values in GOOD.items()}
    columns["pmra"] = np.ma.array(columns["pmra"], mask=np.arange(n) == 1)
    columns["dec"][1] = columns["dec"][2] = 95
    columns["pmdec"][3] = np.nan
    columns["pmra_error"][4] = 0
    columns["pmdec_error"][5] = -1
    columns["pmra_error"][6] = np.inf
    rho = np.zeros(n)
    rho[7] = np.sqrt(1 - 0.9e-6)
    rho[8] = np.sqrt(1 - 1.1e-6)
    with pytest.raises(FieldError, match="7 of 10 rows cannot be used") as error:
        Field.from_columns(**columns, pmra_pmdec_corr=rho)
    for part in ("pmra missing: 1 (row 1)", "|dec| > 90°: 1 (row 2)", "proper motion not finite: 1 (row 3)",
                 "σ ≤ 0: 2 (rows 4, 5)", "error not finite: 1 (row 6)", "ρ² ≥ 1 − 1e-6: 1 (row 7)", "on_bad=\"drop\""):  # fmt: skip
        assert part in str(error.value)
    field = Field.from_columns(**columns, pmra_pmdec_corr=rho, on_bad="drop")
    assert len(field) == 3
    assert field.notes[0].startswith("left out 7 of 10 rows: pmra missing: 1;")


def test_poles_are_on_the_sky():
    columns = GOOD | {"dec": [90.0, -90.0, 0.0]}
    assert len(Field.from_columns(**columns)) == 3


@pytest.mark.parametrize(("change", "message"), [
    ({"lat": np.zeros(2)}, r"lat has shape \(2,\), expected \(3,\)"),
    ({"motion": np.zeros((3, 2))}, r"motion has shape \(3, 2\), expected \(2, 3\)"),
    ({"sigma": -np.ones((2, 3))}, "3 of 3 rows cannot be used: σ ≤ 0"),
    ({"rho": np.array([0, 0, 1.0])}, "1 of 3 rows cannot be used: ρ² ≥ 1 − 1e-6"),
    ({"frame": "B1950"}, "unknown frame 'B1950'"),
])  # fmt: skip
def test_constructor_has_the_same_checks(change, message):
    good = {"lon": np.zeros(3), "lat": np.zeros(3), "motion": np.zeros((2, 3)), "sigma": np.ones((2, 3))}
    with pytest.raises(ValueError, match=message):
        Field(**(good | change))


def test_turning_a_field_does_not_refuse_what_the_gate_let_through():
    """Errors of 1 and 5000 at 45° are correlated beyond the limit; the source is the same."""
    field = random_field(200, seed=1, rho=0.0)
    stretched = Field(field.lon, field.lat, field.motion, np.array([[1.0], [5000.0]]) * np.ones((2, 200)))
    turned = stretched.to_frame("galactic")
    assert (turned.rho**2).max() > 1 - 1e-6
    np.testing.assert_allclose(turned.chi2, stretched.chi2, rtol=1e-6)


def test_fields_add():
    one, two = random_field(30, seed=1), random_field(20, seed=2)
    both = one + two
    assert len(both) == 50
    np.testing.assert_array_equal(both.motion, np.concatenate([one.motion, two.motion], axis=1))
    sums, whole = fit.normal_equations(one, 2) + fit.normal_equations(two, 2), fit.normal_equations(both, 2)
    np.testing.assert_allclose(whole.matrix, sums.matrix, atol=1e-12 * np.abs(sums.matrix).max())
    assert [len(each) for each in (both[:30], both[30:])] == [30, 20]
    with pytest.raises(FrameError, match="icrs and galactic"):
        one + two.to_frame("galactic")
    with pytest.raises(TypeError):
        one + 1


def test_sum_of_fields_has_missing_values():
    from dataclasses import replace

    one = replace(random_field(3, seed=1), magnitude=np.arange(3.0), name=np.array([7, 8, 9])).add_note("from A")
    two = replace(random_field(2, seed=2), name=np.array(["J1", "J2"])).add_note("from B")
    both = one + two
    np.testing.assert_array_equal(both.magnitude, [0, 1, 2, np.nan, np.nan])
    assert both.name.tolist() == ["7", "8", "9", "J1", "J2"]
    assert both.notes == ("from A", "from B")
    assert (one + random_field(2, seed=2)).name.tolist() == ["7", "8", "9", "", ""]
    near = replace(one, redshift=np.ones(3), redshift_frame="cmb")
    assert (near + two).redshift_frame == "cmb"
    np.testing.assert_array_equal((near + two).redshift, [1, 1, 1, np.nan, np.nan])
    with pytest.raises(FieldError, match="redshifts stand in"):
        near + replace(two, redshift=np.ones(2), redshift_frame="heliocentric")
