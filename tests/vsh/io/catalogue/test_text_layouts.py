"""Layouts of small files as archives, journals and other programs write them: each is read as the plain table is."""

import numpy as np
import pytest
from astropy.io.votable import from_table
from astropy.io.votable.tree import Info
from astropy.table import Table
from gaia_table import NAMES, UNITS

from vsh import FieldError, TableError, read_field
from vsh.io.catalogue import parts
from vsh.io.tables import open_table

RNG = np.random.default_rng(1)
RA, DEC = RNG.uniform(0, 360, 40), np.degrees(np.arcsin(RNG.uniform(-1, 1, 40)))
MOTION = RNG.normal(0, 0.1, (2, 40)).round(5)
ROWS = np.column_stack([RA.round(6), DEC.round(6), *MOTION, np.full(40, 0.1), np.full(40, 0.2)])
GAIA = ",".join(NAMES) + "\n"


def body(delimiter, rows=ROWS):
    return "".join(delimiter.join(map(str, row)) + "\n" for row in rows)


def vizier(name, begin="#Table\t"):
    names = "RA_ICRS\tDE_ICRS\tpmRA\tpmDE\te_pmRA\te_pmDE\n"
    return f"{begin}{name}\n{names}deg\tdeg\tmas/yr\tmas/yr\tmas/yr\tmas/yr\n---\t---\t---\t---\t---\t---\n"


def test_lines_above_the_names_are_named(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("Table 3. Proper motions\n" + GAIA + body(","))
    assert "1 line above the names of the columns left out: Table 3. Proper motions" in read_field(path).notes


def test_one_of_several_tables_is_asked_for_and_chosen(tmp_path):
    path = tmp_path / "two.tsv"
    path.write_text(vizier("one") + body("\t", ROWS[:30]) + "\n\n" + vizier("two") + body("\t", ROWS[30:]))
    with pytest.raises(TableError, match=r"several tables; another begins in line 37: #Table.*two.*two.tsv#1"):
        read_field(path)
    assert [len(read_field(f"{path}#{k}")) for k in (1, 2)] == [30, 10]
    with pytest.raises(TableError, match="holds 2 tables of VizieR: there is no number 3"):
        read_field(f"{path}#3")


@pytest.mark.filterwarnings("ignore:warning. half of the errors are below")
def test_errors_have_the_unit_of_their_motion():
    table = dict(zip((*NAMES[:4], "pmra_err", "pmdec_err"), ROWS.T, strict=True))
    field = read_field(table, units={"pmra": "uas/yr", "pmdec": "uas/yr"})
    np.testing.assert_allclose(field.sigma, ROWS[:, 4:].T)
    assert "no unit in the table, so taken in uas/yr, the unit of pmra: pmra_err" in field.notes


@pytest.mark.parametrize("blank", ["", "NULL", "null"])
def test_motions_that_are_marked_missing_are_left_out_with_a_count(tmp_path, blank):
    path = tmp_path / "table.csv"
    path.write_text(GAIA + body(",") + "".join(f"10.0,{k}.0,{blank},{blank},{blank},{blank}\n" for k in range(5)))
    field = read_field(path)
    assert len(field) == 40
    assert any("left out 5 of 45 rows: proper motion missing: 5" in note for note in field.notes)
    path.write_text(GAIA + body(",") + f"10.0,3.0,{blank},0.1,0.1,0.1\n")  # one component alone is a mistake
    with pytest.raises(FieldError, match="pmra missing"):
        read_field(path)


def test_motions_without_errors_have_those_that_are_given(tmp_path):
    path = tmp_path / "table.csv"
    path.write_text("ra,dec,pmra,pmdec\n" + body(",", ROWS[:, :4]))
    with pytest.raises(TableError, match=r"--columns sigma=100\) gives all motions the same error"):
        read_field(path)
    field = read_field(path, sigma=30.0)
    np.testing.assert_allclose(field.sigma, 30)
    assert parts(path, sigma=30.0).sum(len) == 40
    np.testing.assert_array_equal(next(iter(parts(path, sigma=30.0))).sigma, field.sigma)


def test_ipac_tables_are_read(tmp_path):
    table = Table(ROWS, names=NAMES, units=UNITS)
    for name in ("table.tbl", "table"):
        table.write(tmp_path / name, format="ascii.ipac")
        np.testing.assert_allclose(read_field(tmp_path / name).motion, 1000 * MOTION, rtol=1e-9)


def test_overflow_is_accepted_in_so_many_words(tmp_path):
    document = from_table(Table(ROWS, names=NAMES))
    document.resources[0].infos.append(Info(name="QUERY_STATUS", value="OVERFLOW"))
    path = tmp_path / "part.vot"
    document.to_xml(str(path))
    with pytest.raises(TableError, match="--columns format=votable-overflow"):
        read_field(path)
    field = read_field(path, format="votable-overflow")
    assert len(field) == 40
    assert any("has a part of the rows of its query" in note for note in field.notes)


def test_distances_without_a_unit_may_be_of_any_length():
    table = dict(zip(NAMES, ROWS.T, strict=True)) | {"dist": np.ones(40), "e_dist": np.full(40, 0.1)}
    with pytest.raises(TableError, match=r"no unit: say which.*kpc, pc"):
        read_field(table, columns={"distance": "dist", "distance_error": "e_dist"})


def test_number_behind_a_file_name_is_not_a_table_where_such_a_file_is(tmp_path):
    path = tmp_path / "table.csv#1"
    path.write_text(GAIA + body(","))
    assert open_table(path, "csv").names == tuple(GAIA.strip().split(","))


def test_column_that_is_used_twice_is_noted(tmp_path):
    lines = ["ra,dec,pmra,pmdec,error", *(f"{i},{i - 5},{i},{-i},0.5" for i in range(10))]
    (tmp_path / "one.csv").write_text("\n".join(lines))
    columns = {"names": "gaia", "pmra_error": "error", "pmdec_error": "error"}
    field = read_field(tmp_path / "one.csv", columns, units={"error": "mas/yr"})
    assert "column error is used for pmra_error and pmdec_error" in field.notes
