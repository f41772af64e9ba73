"""Tables of which a value was misread without a word, one for each way."""

from dataclasses import replace

import numpy as np
import pytest
from astropy import units as u
from astropy.io.votable import from_table
from astropy.table import Table
from conftest import random_field

from vsh import read_field
from vsh.io import tables
from vsh.io.catalogue import match, parts, read_positions, read_scalars, rename_sources
from vsh.io.sections import format_table
from vsh.sky.frames import Positions
from vsh.tools.errors import FieldError, TableError, VshError

MOTIONS = {name: np.full(60, value) for name, value in
           {"pmra": 0.1, "pmdec": 0.2, "pmra_error": 0.1, "pmdec_error": 0.1}.items()}  # fmt: skip


def _sky(**columns):
    rng = np.random.default_rng(1)
    return {"ra": rng.uniform(0, 360, 60), "dec": rng.uniform(-80, 80, 60)} | MOTIONS | columns


def test_radians_are_seen_beside_a_missing_position():
    rng = np.random.default_rng(1)
    ra, dec = rng.uniform(0, 6.28, 60), rng.uniform(-1.4, 1.4, 60)
    ra[3] = np.nan
    with pytest.raises(FieldError, match="radians"):
        read_field(_sky(ra=ra, dec=dec), on_bad="drop")


@pytest.mark.parametrize(
    ("text", "units", "degrees"),
    [("10:30:00", None, 157.5), ("10h30m00s", None, 157.5), ("10d30m00s", None, 10.5), ("10:30:00", "d:m:s", 10.5)],
)
def test_right_ascension_in_degrees_and_minutes(text, units, degrees):
    table = _sky(ra=np.full(60, text))
    field = read_field(table, units=units and {"ra": units})
    assert np.degrees(field.lon[0]) == pytest.approx(degrees)


def test_names_with_an_underscore_are_text(tmp_path):
    (tmp_path / "c.csv").write_text("name,ra,dec\n1_1,1,2\n1_2,3,4\n")
    values, _ = tables.open_table(tmp_path / "c.csv").columns(("name",))["name"]
    assert values.tolist() == ["1_1", "1_2"]


def test_a_delimiter_in_quotes_is_no_delimiter(tmp_path):
    (tmp_path / "c.csv").write_text('name,ra,dec\n"5,6",7\n')
    with pytest.raises(TableError, match="2 fields where the table has 3"):
        tables.open_table(tmp_path / "c.csv").columns(("dec",))
    (tmp_path / "c.csv").write_text('name,ra,dec\n"5,6",7,8\n"5",9,10\n')
    assert tables.open_table(tmp_path / "c.csv").columns(("dec",))["dec"][0].tolist() == [8, 10]


@pytest.mark.parametrize(("condition", "rows"), [("a in (b, 5)", [1]), ("a not in (b, 5)", [3])])
def test_a_missing_member_of_a_list_is_not_known(condition, rows):
    b = np.ma.MaskedArray(np.zeros(60), np.arange(60) != 3)  # 0 below its mask
    a = np.where(np.arange(60) == 1, 5.0, np.where(np.arange(60) == 3, 7.0, 0.0))
    field = read_field(Table(_sky(a=a, b=b, source_id=np.arange(60))), where=condition)
    assert field.name.tolist() == rows


def test_units_of_several_tables_are_alike(tmp_path):
    one, two = Table(_sky()), Table(_sky())
    two["pmra"].unit = "arcsec / yr"
    file = from_table(one)
    file.resources[0].tables.append(from_table(two).resources[0].tables[0])
    file.to_xml(str(tmp_path / "t.vot"))
    with pytest.raises(TableError, match="no unit and in arcsec"):
        read_field(tmp_path / "t.vot")


def test_marks_of_icrf_stay_where_rows_are_selected():
    table = Table({"icrf": ["a", "b", "c"], "iers": ["A", "B", "C"], "defining": ["D", "", "D"], "ra": [1.0, 2, 3],
                   "dec": [1.0, 2, 3], "ra_error": [0.1] * 3, "dec_error": [0.1] * 3, "ra_dec_corr": [0.0] * 3})  # fmt: skip
    for column in ("ra", "dec"):
        table[column].unit = "deg"
    for options in ({"where": "dec > 1.5"}, {"sigma": 100.0, "where": "dec > 1.5"}):
        assert read_positions(table, **options).defining.tolist() == [False, True]


def test_positions_say_which_names_a_crosswalk_has_not():
    n = 3
    here = Positions(np.arange(n) / 10.0, np.zeros(n), np.ones((2, n)), np.zeros(n), name=np.array([1, 2, 3]))
    neighbours = Table({"dr3_source_id": [1, 2, 3], "dr4_source_id": np.ma.MaskedArray([11, 12, 0], [0, 0, 1]),
                        "angular_distance": [0.1, 0.1, 0.0]})  # fmt: skip
    there = rename_sources(here, neighbours)
    assert there.name.tolist() == [11, 12]
    assert any("2 of 3 sources have a name" in note for note in there.notes)


def test_only_repeated_names_with_a_counterpart_are_ambiguous():
    field = replace(random_field(4, 1), name=np.array(["a", "a", "b", "c"]))
    note = match(field, replace(field[2:], name=np.array(["b", "c"]))).notes[-1]
    assert "0 of them with several counterparts" in note


def test_parts_without_a_selected_source_are_passed_over():
    south, north = (_sky(dec=np.full(60, value)) for value in (-10.0, 10.0))
    sky = parts([south, north], where="dec > 0")
    assert [len(field) for field in sky] == [60]
    assert not sky.has("redshift")


def test_text_in_tables_of_scalars():
    table = {"ra": ["x", "y"], "dec": [1.0, 2.0], "parallax": [0.1, 0.2], "parallax_error": [0.1, 0.1]}
    with pytest.raises(VshError, match="ra holds text"):
        read_scalars(table)


def test_errors_in_radians_are_printed_in_degrees():
    table = Table({"lon": [1.0] * u.rad, "lon_error": [0.1] * u.rad})
    assert format_table(table)[1][0][0].endswith("± 5.7")
    assert table["lon_error"][0] == 0.1


@pytest.mark.parametrize("names", [
    ("RA (deg)", "Dec (deg)", "PM RA (mas/yr)", "PM Dec (mas/yr)", "PM RA error", "PM Dec error"),  # ExoFOP
    ("Gaia-RA", "Gaia-DEC", "pmra", "pmdec", "pmra-err", "pmdec-err"),
    ("ra_gaia", "dec_gaia", "pmra", "pmdec", "pmra_error", "pmdec_error"),
    ("ra", "dec", "muRA_masyr", "muDEC_masyr", "muRA_err", "muDEC_err"),  # SIMPLE
    ("ra", "dec", "sy_pmra", "sy_pmdec", "sy_pmraerr1", "sy_pmdecerr1"),  # exoplanet archive
    ("raj", "decj", "pmra", "pmdec", "pmra_err", "pmdec_err"),
])  # fmt: skip
def test_names_that_people_give(names):
    table = Table([np.full(60, value) for value in (10.0, 20.0, 0.1, 0.2, 0.3, 0.4)], names=names)
    for name in names[2:]:
        table[name].unit = "mas/yr"
    field = read_field(table)
    assert [field.ra[0], field.pmra[0], field.pmdec_error[0]] == pytest.approx([10.0, 0.1, 0.4])


def test_a_coordinate_is_not_a_redshift_by_its_case():
    field = read_field(Table(_sky(Z=np.full(60, 0.5), _RA=np.full(60, 1.0))))
    assert field.redshift is None
    assert np.ptp(field.ra) > 100
