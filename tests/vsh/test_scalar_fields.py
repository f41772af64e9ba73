"""Scalar harmonics: known values, frames, tables."""

import pickle

import numpy as np
import pytest
from astropy import units as u
from astropy.table import MaskedColumn, QTable, Table
from numpy.testing import assert_allclose
from scipy.special import sph_harm_y

from vsh import Coefficients, Field, Modes, ScalarCoefficients, ScalarField, ScalarModes
from vsh.basis import harmonics
from vsh.conventions import scalar_from_healpy, scalar_to_healpy
from vsh.io.catalogue import read_scalars
from vsh.rotate import rotate
from vsh.sky.pixels import centres, pixels_of
from vsh.tools.errors import FieldError, ModesError, ParameterError, TableError
from vsh.transform import adjoint, synthesis

RNG = np.random.default_rng(1)
LON, LAT = RNG.uniform(0, 2 * np.pi, 40), np.arcsin(RNG.uniform(-1, 1, 40))


def some(lmax, seed=2):
    modes = ScalarModes(lmax)
    return ScalarCoefficients(modes, np.random.default_rng(seed).normal(size=len(modes)))


def test_order():
    modes = ScalarModes(3)
    assert len(modes) == 16
    assert modes.kinds == ("F",)
    assert Modes(3).kinds == ("T", "S")
    assert [modes.index(mode) for mode in modes] == list(range(16))
    assert_allclose(modes.degrees, [mode.l for mode in modes])
    assert_allclose(modes.norm2, [1 + (mode.m > 0) for mode in modes])
    assert len(ScalarModes(0)) == 1
    assert ScalarModes(2) != Modes(2)


@pytest.mark.parametrize("lmax", [0, 1, 5, 60])
def test_harmonics_are_those_of_scipy(lmax):
    modes = ScalarModes(lmax)
    expected = []
    for mode in modes:
        y = sph_harm_y(mode.l, mode.m, np.pi / 2 - LAT, LON)
        expected.append(y.real if mode.m == 0 else 2 * y.real if mode.part == "re" else -2 * y.imag)
    assert_allclose(harmonics(LON, LAT, modes)[:, 0], expected, atol=1e-11)


def test_spheroidal_mode_is_the_gradient_of_a_scalar_one():
    step = 1e-5
    north = (harmonics(LON, LAT + step, ScalarModes(4)) - harmonics(LON, LAT - step, ScalarModes(4)))[:, 0] / (2 * step)
    l = ScalarModes(4).degrees[1:]
    vector = harmonics(LON, LAT, Modes(4))[len(Modes(4)) // 2 :, 1]
    inside = np.abs(LAT) < 1.4
    assert_allclose(north[1:, inside] / np.sqrt(l * (l + 1))[:, None], vector[:, inside], atol=1e-8)


def test_mean_and_dipole():
    field = ScalarCoefficients.from_moments(mean=-20.0, dipole=(1, 2, 3), lmax=3)
    r = np.stack([np.cos(LAT) * np.cos(LON), np.cos(LAT) * np.sin(LON), np.sin(LAT)])
    assert_allclose(field.at(LON, LAT), -20 + np.array([1, 2, 3]) @ r, atol=1e-12)
    # f10 = √(4π/3) d_z; f11R = −√(2π/3) d_x, f11I = +√(2π/3) d_y.
    expected = np.sqrt(2 * np.pi / 3) * np.array([np.sqrt(2) * 3, -1, 2])
    assert_allclose(field.values[1:4], expected)
    assert field.mean == pytest.approx(-20)
    assert field.dipole == pytest.approx([1, 2, 3])


def test_transforms():
    field = some(30)
    assert_allclose(synthesis(field, LON, LAT), field.at(LON, LAT), atol=1e-10)
    values = RNG.normal(size=(1, 40))
    assert_allclose(
        adjoint(field.modes, LON, LAT, values), harmonics(LON, LAT, field.modes)[:, 0] @ values[0], atol=1e-10
    )


def test_healpy():
    field, nside = some(8), 16
    healpy = pytest.importorskip("healpy", reason="there is no healpy for Windows")
    theta, phi = healpy.pix2ang(nside, np.arange(12 * nside**2))
    theirs = healpy.alm2map(scalar_to_healpy(field), nside, lmax=8)
    assert_allclose(field.at(phi, np.pi / 2 - theta), theirs, atol=1e-10)
    assert_allclose(scalar_from_healpy(scalar_to_healpy(field)).values, field.values, atol=1e-15)
    with pytest.raises(ModesError, match="not those of a scalar field"):
        scalar_from_healpy(np.zeros(4, complex))


def test_rotation():
    field = some(6)
    turned = rotate(field, "galactic")
    for l in range(7):
        assert turned.power("F", l) == pytest.approx(field.power("F", l), rel=1e-12)
    places = ScalarField(LON, LAT, field.at(LON, LAT), np.ones(40)).to_frame("galactic")
    assert_allclose(turned.at(places.lon, places.lat), places.values, atol=1e-11)
    matrix = np.diag(np.arange(49.0))
    assert np.trace(rotate(field, "galactic", covariance=matrix)[1]) > 0


def test_vector_and_scalar_do_not_mix():
    with pytest.raises(ModesError, match="scalar field has no spin"):
        _ = some(2).rotation
    with pytest.raises(ModesError, match="expanded in ScalarModes"):
        ScalarCoefficients(Modes(2), np.zeros(16))
    with pytest.raises(ModesError, match="vector fields.*not in ScalarModes"):
        Coefficients(ScalarModes(2), np.zeros(9))
    with pytest.raises(TypeError):
        some(2) + Coefficients(1, np.zeros(6))
    assert (some(2) + some(3)).modes == ScalarModes(3)


def test_table_with_units_and_masks():
    table = QTable({"ra": [10.0, 20.0, 30.0] * u.deg, "dec": [0.0, 1.0, 2.0] * u.deg})
    table["parallax"], table["parallax_error"] = [-0.02, 0.01, 0.3] * u.mas, [100.0, 200.0, 300.0] * u.uas
    field = read_scalars(table, unit="uas")
    assert_allclose(field.values, [-20, 10, 300])
    assert_allclose(field.sigma, [100, 200, 300])
    assert field.unit == "µas"
    masked = Table({"ra": [10.0, 20.0], "dec": [0.0, 1.0], "parallax_error": [0.1, 0.1]})
    masked["parallax"] = MaskedColumn([0.1, 0.2], mask=[False, True])
    assert "left out 1 of 2 rows: parallax missing: 1" in read_scalars(masked).notes  # no mistake, as of motions
    bare = {"ra": [1, 2], "dec": [1, 2], "parallax": [np.nan, 1], "parallax_error": [1, 1]}
    assert "left out 1 of 2 rows: parallax missing: 1" in read_scalars(bare).notes  # as FITS says so
    with pytest.raises(FieldError, match="1 of 2 rows.*parallax not finite: 1 .row 0"):
        read_scalars(bare | {"parallax": [np.inf, 1]})
    kept = read_scalars(masked, on_bad="drop")
    assert len(kept) == 1
    assert any("taken in mas: parallax" in str(note) for note in kept.notes)
    assert any("1 of 2" in str(note) for note in kept.notes)
    with pytest.raises(TableError, match="no column 'colour'"):
        read_scalars(masked, "colour")
    with pytest.raises(TableError, match="units of parallax, parallax_error do not go together"):
        read_scalars(masked, unit="mag")


def test_messages():
    ones = np.ones(3)
    for values, sigma, said in (([1, np.nan, 2], ones, "value not finite: 1"), (ones, [1, 0, 1], "σ ≤ 0: 1"),
                                (ones, [1, 1], "sigma has shape")):  # fmt: skip
        with pytest.raises(FieldError, match=said):
            ScalarField(ones, 0 * ones, values, sigma)
    with pytest.raises(FieldError, match="the column is field.values"):
        ScalarField(ones, 0 * ones, ones, ones)["values"]
    with pytest.raises(FieldError, match="no motions"):
        Field.from_positions(ScalarField(ones, 0 * ones, ones, ones))


def test_copy_is_as_frozen():
    field = ScalarField(LON, LAT, LON, np.ones(40), "mag", name=np.arange(40), notes=("one",))
    again = pickle.loads(pickle.dumps(field))[:10].minus(1.0).with_errors(np.full(10, 2.0)).add_note("two")
    assert again.unit == "mag"
    assert again.notes == ("one", "two")
    assert list(again.name) == list(range(10))
    with pytest.raises(ValueError):
        again.values[0] = 1.0


@pytest.mark.parametrize(
    ("frame", "names"), [("galactic", ["l", "b"]), ("ecliptic", ["ecl_lon", "ecl_lat"]), ("icrs", ["ra", "dec"])]
)
def test_written_positions_have_the_names_of_their_axes(frame, names, tmp_path):
    """They stood as ra, dec, whatever they were."""
    field = ScalarField(LON, LAT, np.arange(40.0), np.ones(40), "uas", frame=frame)
    for path in (tmp_path / "scalars.csv", tmp_path / "scalars.fits"):
        field.write(path)
        assert Table.read(path).colnames[1:3] == names
        again = read_scalars(path, "value")
        assert again.frame == frame
        assert_allclose([again.lon, again.lat], [LON, LAT], rtol=1e-12)


def test_numbers_that_are_calculated_of_columns():
    table = QTable({"ra": [10.0, 20.0] * u.deg, "dec": [0.0, 1.0] * u.deg})
    table["parallax"], table["parallax_error"] = [-0.02, 0.01] * u.mas, [0.1, 0.2] * u.mas
    table["zero"], table["shift"] = [-17.0, -20.0] * u.uas, [0.001, 0.002]
    field = read_scalars(table, "parallax - zero")
    assert_allclose(field.values, [-3, 30])
    assert_allclose(field.sigma, [100, 200])
    assert field.unit == "µas"
    shifted = read_scalars(table, "parallax - shift")
    assert_allclose(shifted.values, [-21, 8])  # without a unit, as constants: that of the first
    assert "no unit in the table, so taken in mas: shift" in shifted.notes
    assert_allclose(read_scalars(table, "parallax + 0.017").values, [-3, 27])
    assert_allclose(read_scalars(table, "zero", "parallax_error").sigma, [100, 200])


def test_counts_are_those_of_pixels_over_their_selection():
    nside = 2
    lon, lat = centres(nside)
    times = np.arange(1, 49)
    selection = np.where(np.arange(48) < 40, 1.0 + times, 0.0)
    field = ScalarField.from_counts(np.repeat(lon, times), np.repeat(lat, times), nside, selection)
    expected = times[:40].sum() * selection[:40] / selection.sum()
    assert_allclose(field.values, times[:40] / expected - 1)
    assert_allclose(field.sigma, 1 / np.sqrt(expected))
    assert_allclose((field.lon, field.lat), (lon[:40], lat[:40]))
    assert field.notes == (
        "counts of 820 sources in 40 pixels of nside 2", "356 sources lie where the selection is zero and are not counted",
        "warning: 1128 of 1176 sources are at the place of another, and count each",
    )  # fmt: skip
    finer = np.repeat(selection, 4)[np.argsort(pixels_of(*centres(4), nside), kind="stable").argsort()]
    assert_allclose(
        ScalarField.from_counts(np.repeat(lon, times), np.repeat(lat, times), nside, finer).values, field.values
    )


def test_counts_of_a_part_of_the_sky_ask_for_its_selection():
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 5000), np.arcsin(rng.uniform(0.1, 1, 5000))
    with pytest.raises(ParameterError, match="give a selection"):
        ScalarField.from_counts(lon, lat)
    selection = (centres(4)[1] > 0).astype(float)
    assert len(ScalarField.from_counts(lon, lat, selection=selection)) < 192
    assert not any("selection" in note for note in ScalarField.from_counts(lon, np.sin(3 * lat), nside=1).notes)
    with pytest.raises(ParameterError, match="none of 5000 sources"):
        ScalarField.from_counts(lon, lat, selection=(centres(4)[1] < -0.2).astype(float))
    for wrong in (np.ones(13), -np.ones(48)):
        with pytest.raises(ParameterError, match="HEALPix map"):
            ScalarField.from_counts(lon, lat, selection=wrong)


def test_parallaxes_in_a_unit_that_was_lost_are_doubted():
    """Numbers in µas that a CSV file gives without a unit were taken in mas without a word."""
    rng = np.random.default_rng(1)
    table = {"ra": rng.uniform(0, 360, 50), "dec": rng.uniform(-80, 80, 50), "parallax": rng.normal(0, 0.3, 50)}
    table |= {"parallax_error": np.full(50, 0.3), "bias": np.full(50, -17.0)}
    lost = table | {name: 1000 * table[name] for name in ("parallax", "parallax_error")}
    for columns, value, is_doubted in (
        (table, "parallax", False),
        (lost, "parallax", True),
        (table, "parallax - bias", True),
    ):
        assert any("is the unit right" in note for note in read_scalars(columns, value).notes) == is_doubted
    joined = {
        "ra": table["ra"],
        "dec": table["dec"],
        "parallax_1": table["parallax"],
        "parallax_error_1": table["bias"] ** 2,
    }
    assert_allclose(read_scalars(joined, "parallax_1").sigma, 17.0**2)
    units = dict.fromkeys(("parallax", "parallax_error"), "uas")
    assert not any("is the unit right" in note for note in read_scalars(lost, units=units).notes)
    assert any("errors are below 0.3" in note for note in read_scalars(table, units=units).notes)
    units = dict.fromkeys(("parallax", "parallax_error"), "arcsec")
    assert any("are above 3e+05 µas" in note for note in read_scalars(table, units=units).notes)


def scalars_table(n=300, seed=3):
    """Parallaxes in mas with a bias, by random directions."""
    rng = np.random.default_rng(seed)
    columns = {"ra": rng.uniform(0, 360, n), "dec": np.degrees(np.arcsin(rng.uniform(-1, 1, n)))}
    columns |= {"parallax": rng.normal(-0.02, 0.3, n), "parallax_error": np.full(n, 0.3), "bias": np.full(n, -0.02)}
    return Table(columns, units={"parallax": "mas", "parallax_error": "mas", "bias": "mas"})


def test_masks_beside_columns_and_zeros_are_missing_values(tmp_path):
    """Parquet by astropy holds a mask as a column of its own; exact zeros in many rows are no measurements."""
    pytest.importorskip("pyarrow")
    table = Table(scalars_table(), masked=True)
    table["parallax"][:30], table["parallax"].mask[:30] = 1.5, True
    table.write(tmp_path / "a.parquet")
    for value in ("parallax", "parallax - bias"):
        assert len(read_scalars(tmp_path / "a.parquet", value, on_bad="drop")) == 270
    assert any("30 of 300 rows" in str(note) for note in read_scalars(tmp_path / "a.parquet").notes)
    zeros = scalars_table()
    zeros["parallax"][:40] = 0.0
    assert len(read_scalars(zeros, "parallax - bias", on_bad="drop")) == 260


@pytest.mark.parametrize("formula", ["parallax/parallax_error", "parallax*parallax", "parallax/bias - 1"])
def test_formulas_keep_the_unit(formula):
    with pytest.raises(TableError, match="is not in mas"):
        read_scalars(scalars_table(), formula)
    np.testing.assert_allclose(
        read_scalars(scalars_table(), "2*parallax - parallax").values, 1000 * scalars_table()["parallax"]
    )
