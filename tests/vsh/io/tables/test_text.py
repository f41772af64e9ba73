"""Tables of text by Arrow and line by line: the same values, types and masks, whatever stands in them."""

import gzip

import numpy as np
import pytest

from vsh.io import tables
from vsh.io.tables import _arrow, _text
from vsh.tools.errors import TableError

MANY = 300_000
TABLES = {
    "numbers": "a,b\n1,1.5\n2,-2e-3\n",
    "missing": "a,b,c\n1,,x\n,null,\n3,NULL,null\n",
    "nothing but missing": "a,b\n,1\n,2\n",
    "signs and zeros": "a,b\n+1,007\n-2,00\n",
    "too long for 64 bits": "a,b\n123456789012345678901,1\n2,2\n",
    "more digits than a double": "a,b\n" + "1" * 400 + ",1\n2,2\n",
    "integers among fractions": "a,b\n9007199254740993,1\n0.5,2\n",
    "no truth values": "a,b\ntrue,1\nfalse,2\n",
    "times": "a,b,c\n2026-12-02,2016-01-01T00:00:00,12:30:00\n2016-01-01,2016-01-01T00:00:01,12:30:01\n",
    "blanks around": "a,b,c\n 1 , 2.5, x\n2 ,3.5 ,y \n",
    "infinite": "a,b\n1,inf\n2,nan\n",
    "quotes": 'a,b\n"x, y",1\n"he said ""no""",2\n"z",3\n',
    "a line break": 'a,b\n"two\nlines",1\nx,2\n',
    "comments and blank lines": "# made today\n\na,b\n1,2\n\n3,4\n#END#\n",
    "semicolons": "a;b\n1;2.5\n3;4.5\n",
    "tabs": "a\tb\tc\n1\t2\tx\n3\t4\ty\n",
    "integers at first": "a,b\n" + "1,2\n" * MANY + "1.5,x\n" + "2,3\n" * 5,
    "greek": "α,β\n1,µas\n2,δ\n",
    "returns": "a,b\r\n1,2\r\n3,4\r\n",
    "ecsv": (
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: a, datatype: float64}\n# - {name: b, datatype: string}\n"
        '# - {name: c, datatype: bool}\n# - {name: d, datatype: int32}\n# schema: astropy-2.0\na b c d\n1 12 True 3\n"" "" False 4\n'
    ),
}  # fmt: skip


@pytest.fixture(autouse=True)
def of_any_size(monkeypatch):
    monkeypatch.setattr(_text, "LARGE", 0)
    monkeypatch.setattr(_arrow, "_CSV_BLOCK", 2**18)


def read(path, rows=None):
    source = tables.open_table(path)
    return list(source.blocks(rows=rows)) if rows else [source.columns()]


def line_by_line(*_):
    raise _text.NotPlain
    yield


@pytest.mark.parametrize("rows", [None, 2, 100_000])
@pytest.mark.parametrize("text", TABLES.values(), ids=TABLES)
def test_both_ways_read_the_same(text, rows, tmp_path, monkeypatch):
    if rows == 2 and len(text) > 10_000:
        pytest.skip("so many blocks take long")
    path = tmp_path / ("t.ecsv" if text.startswith("# %ECSV") else "t.csv")
    path.write_bytes(text.encode())
    fast = read(path, rows)
    monkeypatch.setattr(_text, "read_csv_blocks", line_by_line)
    slow = read(path, rows)
    for name in slow[0]:
        one, two = (np.concatenate([np.asarray(block[name][0]) for block in blocks]) for blocks in (fast, slow))
        np.testing.assert_array_equal(one, two)
        assert one.dtype.kind == two.dtype.kind
        masks = [
            [np.zeros(len(v), bool) if m is None else m for v, m in (b[name] for b in blocks)]
            for blocks in (fast, slow)
        ]
        np.testing.assert_array_equal(*map(np.concatenate, masks))


def test_damage_below_many_rows_is_named_by_its_line(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n" + "1,2\n" * MANY + "1,2,3\n" + "1,2\n")
    with pytest.raises(TableError, match=rf"line {MANY + 2} is damaged: 3 fields where the table has 2 columns"):
        read(path)


def test_number_of_too_many_digits_is_refused(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("a,b\n" + "1" * 1500 + ",1\n2.5,2\n")
    with pytest.raises(TableError, match="line 2: a field of 1500 characters in column 'a'"):
        read(path)


def test_bytes_that_are_no_text_are_refused_in_a_column_that_nobody_asks_for(tmp_path):
    path = tmp_path / "t.csv"
    path.write_bytes(b"a,b,c\n" + b"1,2,x\n" * 1000 + b"1,2,\xff\n")
    with pytest.raises(TableError, match="no text in UTF-8"):
        tables.open_table(path).columns(["a"])


def test_packed_tables_go_the_same_way(tmp_path, monkeypatch):
    path = tmp_path / "t.csv.gz"
    path.write_bytes(gzip.compress(TABLES["missing"].encode()))
    seen = []
    fast = _text.read_csv_blocks
    monkeypatch.setattr(_text, "read_csv_blocks", lambda *given: seen.append(1) or fast(*given))
    assert read(path)[0]["a"][0].tolist() == [1, 0, 3]
    assert seen
