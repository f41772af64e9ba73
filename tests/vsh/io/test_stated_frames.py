"""In which axes a table is: as asked, as it states of itself, or by the names of its columns; never taken silently."""

import warnings

import numpy as np
import pytest
from astropy.io import fits as astropy_fits
from astropy.io.votable.exceptions import VOWarning
from astropy.table import Table
from conftest import random_field

from vsh.io.catalogue import read_field, read_scalars, read_sources
from vsh.sky.frames import AXES
from vsh.tools.errors import TableError


def sky(frame="icrs"):
    return random_field(40, 1).to_frame(frame)


def plain(field):
    """A table in Gaia's names and without metadata, whatever the axes."""
    table = Table(field.to_table(), meta={})
    for other in ("galactic", "ecliptic"):
        for ours, theirs in zip(AXES[other], AXES["icrs"], strict=True):
            for ending in ("", "_error"):
                if ours + ending in table.colnames:
                    table.rename_column(ours + ending, theirs + ending)
    table.rename_column(next(name for name in table.colnames if name.endswith("_corr")), "pmra_pmdec_corr")
    return table


def votable(path, system, equinox=None, ucd="pos.eq.ra"):
    from astropy.io.votable import from_table
    from astropy.io.votable.tree import CooSys

    warnings.simplefilter("ignore", VOWarning)
    table = plain(sky({"galactic": "galactic", "ecl_FK5": "ecliptic"}.get(system, "icrs")))
    document = from_table(table)
    config = {"version_1_2_or_later": True}
    document.resources[0].coordinate_systems.append(CooSys(ID="sys", system=system, equinox=equinox, config=config))
    for column in document.get_first_table().fields:
        if column.name in AXES["icrs"]:
            column.ref = "sys"
    document.to_xml(str(path))
    return path


def fits_file(path, frame="icrs", **cards):
    table = plain(sky(frame))
    columns = [
        astropy_fits.Column(name, "D" if table[name].dtype.kind == "f" else "K", array=np.asarray(table[name]))
        for name in table.colnames
    ]
    unit = astropy_fits.BinTableHDU.from_columns(columns)
    for key, value in cards.items():
        unit.header[key] = value
    unit.writeto(path)
    return path


@pytest.mark.parametrize(("system", "frame"), [("galactic", "galactic"), ("ecl_FK5", "ecliptic"), ("ICRS", "icrs")])
def test_system_of_a_votable_is_taken(system, frame, tmp_path):
    read = read_field(votable(tmp_path / "t.vot", system))
    assert read.frame == frame
    np.testing.assert_allclose(read.to_frame("icrs").motion, sky().motion, rtol=1e-9)


@pytest.mark.parametrize(("frame", "name"), [("galactic", "GALACTIC"), ("ecliptic", "ECLIPTIC"), ("icrs", "ICRS")])
def test_system_of_a_fits_file_is_taken(frame, name, tmp_path):
    assert read_field(fits_file(tmp_path / "t.fits", frame, RADESYS=name)).frame == frame


def test_fk5_is_taken_with_a_note_and_fk4_is_not_taken(tmp_path):
    for path in (votable(tmp_path / "5.vot", "eq_FK5", "J2000"), fits_file(tmp_path / "5.fits", EQUINOX=2000.0)):
        read = read_field(path)
        assert read.frame == "icrs"
        assert any("FK5" in note for note in read.notes)
    wrong = [
        votable(tmp_path / "4.vot", "eq_FK4", "B1950"),
        votable(tmp_path / "5b.vot", "eq_FK5", "J1991.25"),
        fits_file(tmp_path / "4.fits", RADESYS="FK4"),
        fits_file(tmp_path / "old.fits", EQUINOX=1950.0),
    ]
    for path in wrong:
        with pytest.raises(TableError, match="which are not read"):
            read_field(path)
        with pytest.raises(TableError, match="which are not read"):
            read_scalars(path, "pmra", "pmra_error")
        assert read_field(path, frame="icrs").frame == "icrs"  # the remedy


def test_a_system_that_is_not_known_is_said(tmp_path):
    notes = read_field(fits_file(tmp_path / "t.fits", RADESYS="ITRF")).notes
    assert any("ITRF" in note and "not known" in note for note in notes)


@pytest.mark.parametrize("frame", ["galactic", "ecliptic"])
def test_positions_of_other_axes_beside_motions_of_icrs_are_turned(frame):
    """Gaia's tables have l, b, ecl_lon and ecl_lat beside pmra and pmdec."""
    truth, table = sky(), plain(sky())
    lon, lat = AXES[frame][:2]
    turned = sky(frame)
    table["ra"], table["dec"] = np.degrees(turned.lon), np.degrees(turned.lat)
    table.rename_columns(["ra", "dec"], [lon, lat])
    for options in ({}, {"frame": frame}):
        read = read_field(table, {"ra": lon, "dec": lat}, **options)
        assert read.frame == "icrs"
        np.testing.assert_allclose(read.motion, truth.motion, rtol=1e-12)
        np.testing.assert_allclose([read.lon, read.lat], [truth.lon, truth.lat], rtol=1e-9)
        assert any("turned to ICRS" in note for note in read.notes)
    # Both positions are there: those of the motions' axes are read.
    table["ra"], table["dec"] = np.degrees(truth.lon), np.degrees(truth.lat)
    np.testing.assert_allclose(read_field(table).lon, truth.lon, rtol=1e-12)


@pytest.mark.parametrize("frame", ["galactic", "ecliptic"])
def test_names_of_both_positions_and_motions_tell_the_axes(frame):
    table = Table(sky(frame).to_table(), meta={})
    read = read_field(table)
    assert read.frame == frame
    np.testing.assert_allclose(read.to_frame("icrs").motion, sky().motion, rtol=1e-9)
    assert read_sources(table).frame == frame
