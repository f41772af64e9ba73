"""Conditions on a table's columns: what they select, what they never do, and what is said of the rest."""

import json
import time

import numpy as np
import pytest
from astropy.table import MaskedColumn, Table

import fit
from fit.commands.fit import main
from vsh import EmptySelectionError, Field, FieldError, TableError, VshError
from vsh.io.catalogue import parts, read_field, read_positions, read_sources, stream_fields
from vsh.io.catalogue._columns import RowSelection
from vsh.io.tables import Where, open_table
from vsh.tools.notes import UnselectedRows, count_unselected

N = 200


def table():
    rng = np.random.default_rng(1)
    columns = {
        "name": [f"J{i:04d}" for i in range(N)], "ra": rng.uniform(0, 360, N), "dec": rng.uniform(-80, 80, N),
        "pmra": rng.normal(0, 0.1, N), "pmdec": rng.normal(0, 0.1, N), "pmra_error": np.full(N, 0.1),
        "pmdec_error": np.full(N, 0.1), "g": rng.uniform(15, 21, N), "e_pm-RA": rng.uniform(0, 1, N),
        "flag": np.arange(N) % 2 == 0, "source_id": 4611686018427387904 + np.arange(N),
    }  # fmt: skip
    made = Table(columns)
    made["z"] = MaskedColumn(rng.uniform(0, 3, N), mask=np.arange(N) % 10 == 0)
    return made


TABLE = table()
G, Z, GAP = np.array(TABLE["g"]), np.array(TABLE["z"].filled(-1)), np.array(TABLE["z"].mask)


@pytest.mark.parametrize(("text", "expected"), [
    ("g < 19", G < 19),
    ("g < 19 and 0.5 < z < 2", (G < 19) & (Z > 0.5) & (Z < 2) & ~GAP),
    ("(g < 19) & (z > 2.5)", (G < 19) & (Z > 2.5) & ~GAP),
    ("not z < 1", (Z >= 1) & ~GAP),
    ("z != 1", ~GAP),
    ("g > 20 or z > 1", (G > 20) | ((Z > 1) & ~GAP)),
    ("~(g < 19 and z < 1)", (G >= 19) | ((Z >= 1) & ~GAP)),
    ("ismissing(z)", GAP),
    ("not ismissing(z)", ~GAP),
    ("flag", np.arange(N) % 2 == 0),
    ("not flag and g < 18", (np.arange(N) % 2 == 1) & (G < 18)),
    ("name == 'J0007'", np.arange(N) == 7),
    ("name in ('J0007', 'J0009') or name == 'J0011'", np.isin(np.arange(N), [7, 9, 11])),
    ("name not in ['J0007']", np.arange(N) != 7),
    ("source_id == 4611686018427387905", np.arange(N) == 1),  # beyond what a double holds
    ("source_id % 2 == 1", np.arange(N) % 2 == 1),  # of integers
    ('column("e_pm-RA") < 0.5', np.array(TABLE["e_pm-RA"]) < 0.5),
    ("abs(dec) > 30", np.abs(TABLE["dec"]) > 30),
    ("hypot(pmra, pmdec) / pmra_error < 2", np.hypot(TABLE["pmra"], TABLE["pmdec"]) / 0.1 < 2),
    ("sqrt(g - 18) >= 0", G >= 18),  # the root of what is below zero is missing
    ("-g > -(2 ** 4)", G < 16),
    ("log10(z) > 0", (Z > 1) & ~GAP),
])  # fmt: skip
def test_conditions_select_rows(text, expected):
    where = Where(text)
    selected, unknown = where.select_rows(
        {name: (np.ma.getdata(TABLE[name]), np.ma.getmaskarray(TABLE[name])) for name in where.names}
    )
    np.testing.assert_array_equal(selected, expected)
    assert not (selected & unknown).any()


def test_nan_and_none_are_missing():
    where = Where("not x < 1 or not t == 'a'")
    block = {"x": (np.array([np.nan, 2.0, np.nan]), None), "t": (np.array(["a", None, None], object), None)}
    selected, unknown = where.select_rows(block)
    assert selected.tolist() == [False, True, False]
    assert unknown.tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("g.__class__ == 1", "not allowed"), ("__import__('os').system('true')", "not allowed"), ("open('/etc/passwd') == 1", "not allowed"),
        ("(lambda: 1)() == 1", "not allowed"), ("[x for x in ().__class__.__base__.__subclasses__()]", "not allowed"), ("g[0] < 1", "not allowed"),
        ("f'{g}' == 'a'", "not allowed"), ("exec('1') < 1", "not allowed"), ("g if g < 1 else z", "not allowed"), ("(g := 3) < 4", "not allowed"),
        ("9 ** 9 ** 9 > 1", "a power is"), ("g ** z < 1", "a power is"), ("2 ** 1e9 > g", "a power is"), ("abs(g, z) < 1", "takes 1 argument"),
        ("abs(x=g) < 1", "not allowed"), ("g in z", "a list"), ("g is None", "not allowed"), ("column(g) < 1", "not allowed"), ("1j < g", "not allowed"),
        ("g <", "cannot be understood"), ("", "at most"), ("g < 1" + " and g < 1" * 4000, "at most 2000 parts"), ("(" * 900 + "g" + ")" * 900 + " < 1", "cannot be understood"),
        ("-" * 1900 + "g < 1", "100 within each other|cannot be understood"), ("-" * 500_000 + "g", "cannot be understood|within each other"), ("import os", "cannot be understood"), ("g < 1; g", "cannot be understood"), ("None == g", "not allowed"),
        ("g\x00 < 1", "cannot be understood"), ("b'a' == name", "not allowed"), ("... < g", "not allowed"),
    ],
)  # fmt: skip
def test_conditions_allow_no_other_syntax(text, said):
    """Attributes, calls, huge powers, deep nesting: refused at once, and in words."""
    start = time.process_time()
    with pytest.raises(TableError, match=said):
        Where(text)
    assert time.process_time() - start < 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("gg < 19", "no column 'gg'"), ("pm_ra < 1", "nearest: pmra"), ("G < 19", "nearest: g"), ("name < 3", "compares a text with a number"),
        ("g", "a number or a text, not a condition"), ("g < 19 & z > 1", "put parentheses"), ("sqrt(name) < 1", "is text, not a number"),
        ("g and z", "is no condition"), ("name", "not a condition"), ("g == 'bright'", "compares a text with a number"),
    ],
)  # fmt: skip
def test_mistakes_are_named(text, said):
    with pytest.raises(TableError, match=said):
        read_field(TABLE, where=text)


@pytest.mark.parametrize("ending", ["fits", "ecsv", "csv", "vot", "parquet"])
def test_every_format(ending, tmp_path):
    path = tmp_path / f"t.{ending}"
    TABLE.write(path, **({"format": "votable"} if ending == "vot" else {}))
    field = read_field(path, where="g < 19 and 0.5 < z < 2")
    expected = (G < 19) & (Z > 0.5) & (Z < 2) & ~GAP
    np.testing.assert_allclose(np.degrees(field.lon), np.array(TABLE["ra"])[expected])
    assert count_unselected(field.notes) == N - expected.sum()


def test_magnitude_that_marks_a_missing_one_is_above_no_edge():
    made = TABLE.copy()
    made["g"][:7] = 999.0
    selected = read_field(made, {"magnitude": "g"}, where="g > 15")
    assert len(selected) == N - 7
    assert "7 of the others with a value missing" in " ".join(map(str, selected.notes))
    assert len(read_field(made, {"magnitude": None}, where="g > 15")) == N  # another column may have 999 of anything


def test_redshift_that_marks_a_missing_one_is_beyond_no_edge():
    made = TABLE.copy()
    made["z"] = np.where(GAP, 0.1, Z)
    made["z"][:7] = 99.0
    made["z"][7:10] = -9.0
    for condition, expected in (("z > 0.5", Z > 0.5), ("z < 3", Z < 3)):
        expected = expected & ~GAP | (GAP & (condition == "z < 3"))
        expected[:10] = False
        selected = read_field(made, {"redshift": "z"}, where=condition)
        assert len(selected) == expected.sum()
        assert "10 of the others with a value missing" in " ".join(map(str, selected.notes))
    made["z"] = 3e3 * Z
    with pytest.raises(EmptySelectionError, match="z beyond -1 … 20 counts as missing"):
        read_field(made, {"redshift": "z"}, where="z > 1000 and z < 1e6")
    velocities = read_field(made, {"redshift": "z"}, units={"z": "km/s"}, where="z > 1000")
    assert len(velocities) == (3e3 * Z > 1000).sum()


def test_flags_that_are_words_are_conditions(tmp_path):
    """What FITS has as a flag is True and False in CSV: `used` and `not used` select there too."""
    made = TABLE.copy()
    made["used"] = G < 18
    made.write(tmp_path / "a.csv"), made.write(tmp_path / "a.fits")
    for name in ("a.csv", "a.fits"):
        for condition, expected in (
            ("used", G < 18),
            ("not used", G >= 18),
            ("used and z > 0.5", (G < 18) & (Z > 0.5)),
        ):
            assert len(read_field(tmp_path / name, where=condition)) == np.sum(
                expected & (~GAP | ("z" not in condition))
            )
    made["used"] = np.where(G < 18, "yes", "no")
    with pytest.raises(TableError, match="not a condition"):
        read_field(made, where="used")


def test_rest_is_counted():
    field = read_field(TABLE, where="0.5 < z < 2")
    note = next(note for note in field.notes if isinstance(note, UnselectedRows))
    kept = ((Z > 0.5) & (Z < 2) & ~GAP).sum()
    assert note == f"selected {kept} of {N} rows, where 0.5 < z < 2, 20 of the others with a value missing"
    assert len(field) == kept
    with pytest.raises(EmptySelectionError, match="selected 0 of 200 rows, where g < 3"):
        read_field(TABLE, where="g < 3")


def test_bad_rows_keep_their_numbers_and_count_only_where_selected():
    broken, bright = TABLE.copy(), G < 19
    broken["pmra"][~bright] = np.nan
    assert len(read_field(broken, where="g < 19")) == bright.sum()
    row = np.flatnonzero(bright)[7]
    broken["pmra"][row] = np.nan
    with pytest.raises(FieldError, match=rf"proper motion not finite: 1 \(row {row}\)"):
        read_field(broken, where="g < 19")


def test_parts_and_blocks_give_what_the_whole_gives(tmp_path):
    for i in range(4):
        TABLE[50 * i : 50 * (i + 1)].write(tmp_path / f"{i}.fits")
    text = "g < 19 and (z > 1 or flag)"
    whole = read_field(TABLE, where=text)
    blocks = list(stream_fields(TABLE, 7, where=text))
    np.testing.assert_array_equal(np.concatenate([block.lon for block in blocks]), whole.lon)
    one = fit.normal_equations(whole, 1)
    for fields in (blocks, parts(tmp_path, where=text), parts(tmp_path, where=text, rows=9)):
        other = fit.normal_equations(fields, 1)
        np.testing.assert_allclose(other.matrix, one.matrix, atol=1e-12 * np.abs(one.matrix).max())
        assert other.n_data == one.n_data
        assert count_unselected(other.notes) == count_unselected(whole.notes)
    # Most parts are empty, and one is not.
    few = parts(tmp_path, where="name == 'J0007'")
    assert few.counted() == 1
    with pytest.raises(VshError, match="selected 0 of 200"):
        fit.normal_equations(parts(tmp_path, where="g < 3"), 1)
    with pytest.raises(TableError, match="not allowed"):
        parts(tmp_path, where="g.x < 3")


def test_positions_and_sources_too():
    made = TABLE.copy()
    made["ra_error"], made["dec_error"] = 0.1, 0.1
    assert len(read_positions(made, where="g < 19")) == (G < 19).sum()
    with pytest.raises(TableError, match="no set of names of positions is called 'vizier'; there are gaia, icrf"):
        read_positions(made, {"names": "vizier"})
    assert len(read_sources(TABLE["ra", "dec", "g"], where="g < 19")) == (G < 19).sum()


def test_roles_stand_for_columns():
    """`redshift` for the column that holds it, where none is called so."""
    made = TABLE.copy()
    made.rename_column("z", "redshift_qsoc")
    wanted = (Z < 1.5) & ~GAP
    assert len(read_field(made, where="redshift < 1.5")) == wanted.sum()
    assert len(read_field(made, where="redshift < 1.5 and redshift_qsoc < 1.5")) == wanted.sum()
    assert len(read_field(made, {"magnitude": "g"}, where="magnitude < 19")) == (G < 19).sum()
    with pytest.raises(TableError, match=r"no column 'redshif'; nearest: .*Conditions take the table's own names"):
        read_field(made, where="redshif < 1")


def test_on_the_command_line(tmp_path, capsys):
    TABLE.write(tmp_path / "t.fits")
    words = [str(tmp_path / "t.fits"), *f"--lmax 1 --format none --output {tmp_path / 'out'} --where".split()]
    assert main([*words, "g < 20 and z < 2.9"]) == 0
    kept = ((G < 20) & (Z < 2.9) & ~GAP).sum()
    assert f"selected {kept} of {N} rows, where g < 20 and z < 2.9" in capsys.readouterr().out
    told = json.loads((tmp_path / "out" / "provenance.json").read_text())
    assert told["rows"] == N
    assert told["rows_used"] == kept
    assert told["rows_not_selected"] == N - kept
    assert main([*words, "g < 2", "--overwrite"]) == 1
    assert "no row is left by --where" in capsys.readouterr().err


def test_names_in_a_file(tmp_path):
    path = tmp_path / "defining sources.txt"
    chosen = [str(name) for name in np.array(TABLE["name"])[[3, 5, 8]]]
    path.write_text("# names, one a line\n\n" + "\n".join(chosen) + "  # the last\n")
    field = read_field(TABLE, {"name": "name"}, where=f"name in file({str(path)!r})")
    assert field.name.tolist() == chosen
    others = read_field(TABLE, where=f"name not in file({str(path)!r})")
    assert len(field) + len(others) == len(read_field(TABLE))
    numbers = tmp_path / "ids.txt"
    ids = np.arange(5) + 2**60
    made = TABLE[:5]
    made["source_id"] = ids
    numbers.write_text(f"{ids[3]}\n{ids[1]}\n")
    np.testing.assert_array_equal(read_field(made, where=f"source_id in file('{numbers}')").name, ids[[1, 3]])
    numbers.write_text("3C273\n")
    with pytest.raises(TableError, match="the column holds numbers, and .*ids.txt has lines that are none"):
        read_field(made, where=f"source_id in file('{numbers}')")
    for wrong, words in (("none.txt", "cannot be read"), (".", "is no list of names")):
        with pytest.raises(TableError, match=words):
            Where(f"name in file('{tmp_path / wrong}')")
    (tmp_path / "empty.txt").write_text("\n# nothing\n")
    with pytest.raises(TableError, match="holds no names"):
        Where(f"name in file('{tmp_path / 'empty.txt'}')")


def test_long_lists_are_fast_and_right():
    many = ", ".join(repr(f"source {k}") for k in range(50_000))
    first = str(np.array(TABLE["name"])[0])
    field = read_field(TABLE, {"name": "name"}, where=f"name in ({many}, {first!r})")
    assert field.name.tolist() == [first]
    assert len(Where(f"name in ({many})").shown) < 250


def test_select():
    field = read_field(TABLE, {"name": "name"})
    name = str(field.name[2])
    assert field.select([name]).name.tolist() == [name]
    assert read_field(TABLE).select([4611686018427387907]).name.tolist() == [4611686018427387907]
    mask = field.lat > 0
    np.testing.assert_array_equal(field.select(mask).lat, field.lat[mask])
    assert len(field.select(slice(3))) == 3
    for wrong, words in (
        (mask[:-1], "one value a source"),
        (["no such"], "1 of 1 names are not among the sources: no such"),
    ):
        with pytest.raises(FieldError, match=words):
            field.select(wrong)
    with pytest.raises(FieldError, match="have no names"):
        Field(field.lon, field.lat, field.motion, field.sigma).select([name])


def test_scalars_and_two_catalogues(tmp_path, capsys):
    from fit.commands.compare import main
    from vsh.io.catalogue import read_scalars

    made = TABLE.copy()
    made["g"], made["parallax"], made["parallax_error"] = np.arange(N), 1.0, 1.0
    assert len(read_scalars(made, where="g < 4")) == 4
    made.write(tmp_path / "a.fits")
    made["pmra"] += np.random.default_rng(1).normal(size=N)
    made.write(tmp_path / "b.fits")
    paths = [str(tmp_path / "a.fits"), str(tmp_path / "b.fits"), "--what", "motions", "--lmax", "1"]
    assert main([*paths, "--where", "g < 150"]) == 0
    assert "matched 150 sources" in capsys.readouterr().out
    assert main([*paths, "--where", "g < 150", "--where2", "g >= 50"]) == 0
    assert "matched 100 sources" in capsys.readouterr().out


def test_long_identifiers_keep_their_digits():
    """Remainders of a source_id were those of a float, which has no room for its last three digits."""
    ids = np.random.default_rng(1).integers(2**60, 2**62, 500)
    source = open_table(Table({"source_id": ids, "x": np.arange(500.0)}))

    def selected(condition):
        block, _, _ = RowSelection(condition, source).select_rows(source.columns(), 0)
        return set(block["source_id"][0].tolist())

    assert selected("source_id % 1000 < 500") == set(ids[ids % 1000 < 500].tolist())
    assert selected("source_id // 34359738368 % 2 == 0") == set(ids[(ids // 2**35) % 2 == 0].tolist())
    assert selected("source_id < 3e18") == set(ids[ids < 3 * 10**18].tolist())
    assert selected("-source_id < -3e18") == set(ids[ids > 3 * 10**18].tolist())
    assert selected("x * 1e17 > 3e17") == set(ids[4:].tolist())
    assert selected("x % 7 == 2 and x // 100 == 3") == set(ids[303:400:7].tolist())
    for condition in ("source_id + 1 > 5", "floor(source_id) > 3", "source_id * 2 > x"):
        with pytest.raises(TableError, match="more than 53 bits"):
            selected(condition)


def test_masked_divisors_and_sizes_change_nothing_for_other_rows():
    """One null in a block made doubles of all its identifiers, and a null of −2⁶³ refused the calculation."""
    n = np.ma.MaskedArray([2, 2, 0, 7], [False, False, True, False])
    null = np.ma.MaskedArray([5, 1, -(2**63), 9], [False, False, True, False])
    ids = np.array([2**62 + 1, 2**62 + 3, 5, 8])
    for kind in (np.int64, np.uint64):
        source = open_table(Table({"id": ids.astype(kind), "n": n, "null": null, "row": np.arange(4)}))

        def selected(condition, source=source):
            return RowSelection(condition, source).select_rows(source.columns(), 0)[0]["row"][0].tolist()

        assert selected("id % n == 1") == [0, 1, 3]
        assert selected("id % 2 == 1") == [0, 1, 2]
        assert selected("null + 1 > 3") == [0, 3]
        assert selected("abs(null) > 3") == [0, 3]
