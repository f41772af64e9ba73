"""Frames of redshifts: from one to another, and how tables say them."""

from dataclasses import replace

import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from astropy.table import Table

import sim
from vsh import Field
from vsh.io import catalogue
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, LOCAL_GROUP, REDSHIFT_FRAMES, to_cmb, with_redshift
from vsh.sky.frames import check_redshift_frame, parse_redshift_frame
from vsh.tools.errors import FieldError, ParameterError

C = 299792.458


def test_heliocentric_redshifts_grow_toward_the_apex():
    apex = CMB_VELOCITY_PLANCK18.to_frame("icrs").direction
    lon, lat = np.radians([[apex[0], apex[0] + 180], [apex[1], -apex[1]]])
    found = to_cmb(np.array([0.01, 0.01]), lon, lat, "icrs", "heliocentric")
    expected = 1.01 * (1 + np.array([1, -1]) * 369.82 / C) - 1
    np.testing.assert_allclose(found, expected, rtol=1e-9)


def test_frame_of_the_positions_does_not_matter():
    lon, lat = sim.uniform_sky(50, 1)
    z = np.full(50, 0.02)
    galactic = SkyCoord(lon, lat, unit="rad").galactic
    for name in ("heliocentric", "local-group", "cmb"):
        here = to_cmb(z, lon, lat, "icrs", name)
        there = to_cmb(z, galactic.l.rad, galactic.b.rad, "galactic", name)
        np.testing.assert_allclose(here, there, rtol=1e-9)
    np.testing.assert_allclose(to_cmb(z, lon, lat, "icrs", "cmb"), z, rtol=1e-13)
    np.testing.assert_array_equal(to_cmb(z, lon, lat, "icrs", "true"), z)


def test_local_group_by_the_sun_in_it():
    """The Sun's velocity in the Local Group and the Group's in the background add up to the Sun's."""
    sun, group = REDSHIFT_FRAMES["local-group"].value, LOCAL_GROUP.value
    assert np.abs(sun + group - CMB_VELOCITY_PLANCK18.value).max() < 80  # two measurements, some tens of km/s apart


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Heliocentric redshift", "heliocentric"), ("barycentric velocity / c", "heliocentric"), ("z in the CMB frame", "cmb"),
        ("redshift in the Local Group frame", "local-group"), ("photometric redshift", None), (None, None),
        ("heliocentric redshift, before the correction to the CMB frame", None),
    ],
)  # fmt: skip
def test_descriptions(text, name):
    assert parse_redshift_frame(text) == name


def test_names():
    assert check_redshift_frame("CMB") == "cmb"
    assert check_redshift_frame("barycentric") == "heliocentric"
    assert check_redshift_frame("local_group") == "local-group"
    for wrong in ("galactic", 3, None):
        with pytest.raises(ParameterError, match="heliocentric, cmb, local-group, true"):
            check_redshift_frame(wrong)


@pytest.mark.parametrize("ending", ["ecsv", "vot", "parquet", "fits"])
def test_description_of_a_column_tells_the_frame(ending, tmp_path):
    field = sim.observe(sim.galaxies(20, 1), sim.spin((0, 0, 1)), 2)
    field.write(tmp_path / "galaxies.ecsv")
    table = Table.read(tmp_path / "galaxies.ecsv")
    del table.meta["ZFRAME"]
    table["redshift"].description = "Spectroscopic redshift (heliocentric)"
    path = tmp_path / f"described.{ending}"
    table.write(path, **({"format": "votable"} if ending == "vot" else {}))
    if ending == "fits":  # astropy keeps no descriptions there; the archive's files have them so
        from astropy.io import fits

        with fits.open(path, mode="update") as hdus:
            hdus[1].header[f"TCOMM{table.colnames.index('redshift') + 1}"] = "Spectroscopic redshift (heliocentric)"
    assert catalogue.read_field(path).redshift_frame == "heliocentric"
    assert catalogue.read_field(table).redshift_frame == "heliocentric"


def test_usable_redshifts_are_those_in_the_frame_of_the_background():
    apex = np.radians(CMB_VELOCITY_PLANCK18.to_frame("icrs").direction)
    lon, lat = np.array([apex[0], apex[0] + np.pi]), np.array([apex[1], -apex[1]])
    field = Field(
        lon, lat, np.zeros((2, 2)), np.ones((2, 2)), redshift=[-0.0005, 0.0005], redshift_frame="heliocentric"
    )
    kept = with_redshift(field)
    assert kept.redshift.tolist() == [-0.0005]  # M31 is one of those
    assert "1 zero or negative" in str(kept.notes[0])
    bare = replace(field, redshift_frame=None)
    assert with_redshift(bare).redshift.tolist() == [0.0005]
    assert with_redshift(bare, redshift_frame="heliocentric").redshift.tolist() == [-0.0005]


@pytest.mark.parametrize(("columns", "words"), [
    ({"distance": [10.0, np.nan]}, "1 of 1 distances have no errors"),
    ({"distance": [10.0, -3.0], "distance_error": [1.0, 1.0]}, "distance .*row 1.* not above zero"),
    ({"distance": [10.0, 3.0], "distance_error": [1.0, 0.0]}, "distance_error .* not above zero"),
    ({"redshift_error": [-1e-3, 0.0]}, "redshift_error .*row 0.* not zero or more"),
    ({"redshift_frame": "galactic"}, "a redshift's frame is heliocentric"),
])  # fmt: skip
def test_field_refuses_unknown_frames(columns, words):
    given = {"redshift": [0.01, 0.02]} | columns
    with pytest.raises((FieldError, ParameterError), match=words):
        Field([0.1, 0.2], [0.0, 0.1], np.zeros((2, 2)), np.ones((2, 2)), **given)


def test_implausible_values_are_counted():
    numbers = {name: [1.0, 2.0] for name in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")}
    field = Field.from_columns(
        **numbers, redshift=[0.01, 0.02], redshift_error=[1e-4, -999.0], distance=[0.0, 30.0], distance_error=[1.0, 2.0]
    )
    assert any("1 values of redshift_error" in note for note in field.notes)
    assert any("1 values of distance" in note for note in field.notes)
    assert np.isnan(field.redshift_error[1])
    with pytest.raises(FieldError, match="no column is called colour"):
        Field.from_columns(**numbers, colour=[1, 2])
