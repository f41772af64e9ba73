"""CSV and ECSV, line by line: only the fields that are wanted become values, and no line is longer than it may be."""

import csv
import io
from itertools import chain, islice
from operator import itemgetter

import numpy as np

from vsh.io.tables._layout import Layout, check_repeated, layout_of
from vsh.io.tables._packed import DAMAGE, unpacked
from vsh.io.tables._source import TableSource
from vsh.tools.errors import TableError, first_line
from vsh.tools.types import PathName

#: Longer lines are damage, or no table. [characters]
LINE = 2**22
#: A field that is wanted is a number or a name. [characters]
FIELD = 1000
#: What stands for a missing value; Gaia's archive writes null.
NULLS = ("", "null", "NULL")
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def open_text(path: PathName, label: str) -> TableSource:
    """A table of text: ECSV where its first line says so, whatever its name; else as its first lines are laid out."""
    with open_lines(path, label) as lines:
        first = next(lines, "")
        # A mark of the byte order, which spreadsheets write, is no part of the first name.
        ecsv = first.lstrip("\ufeff").replace(" ", "").upper().startswith("#%ECSV")
        if ecsv:
            layout, types, meta, descriptions = _ecsv(first, lines, label)
        else:
            layout, types, meta, descriptions = layout_of(chain([first], lines), label), {}, {}, {}
    names, width = layout.names, len(layout.names)

    def read(wanted, rows):
        places = [names.index(name) for name in wanted]
        with open_lines(path, label) as lines:
            for _ in islice(lines, layout.skip):
                pass
            if layout.delimiter:
                records = _records(lines, places, width, layout.delimiter, label, layout.skip)
            else:
                records = _columned(lines, places, layout, label)
            count = 0
            while picked := list(islice(records, rows)):
                yield _block(wanted, picked, types, label, layout.skip + count, layout.decimal_comma)
                count += len(picked)
            if not count:
                yield {name: (np.empty(0), None) for name in wanted}

    return TableSource(label, tuple(names), read, layout.units, meta, layout.notes, descriptions=descriptions)


def _ecsv(first, lines, label):
    """Layout, types, metadata and descriptions, from the header of an ECSV file."""
    comments, line = [], first
    while line.lstrip("\ufeff").startswith("#"):
        comments.append(line.lstrip("\ufeff")[1:].strip("\n\r").removeprefix(" "))
        line = next(lines, "")
    if not line.strip():
        raise TableError(f"{label} has a header and no table")
    types, units, meta, delimiter, descriptions = _ecsv_header(comments, label)
    names = _split(line, delimiter, label)
    if list(types) != names:
        raise TableError(f"{label} is damaged: its header describes other columns than the line of names")
    check_repeated(names, label)
    return Layout(names, len(comments) + 1, delimiter, units=units), types, meta, descriptions


class open_lines:
    """The lines of a file, packed or not; as a context, so that a file is always closed."""

    def __init__(self, path, label):
        self.path, self.label = path, label

    def __enter__(self):
        self.text = io.TextIOWrapper(unpacked(self.path, self.label), encoding="utf-8", newline="\n")
        return self._guarded()

    def __exit__(self, *_):
        self.text.close()

    def _guarded(self):
        try:
            while line := self.text.readline(LINE):
                if len(line) == LINE:
                    raise TableError(
                        f"{self.label} is damaged, or no table: it has a line of more than {LINE} characters"
                    )
                yield line
        except UnicodeDecodeError as error:
            raise TableError(f"{self.label} is no text in UTF-8: {error.reason} at byte {error.start}") from error
        except TableError:
            raise
        except DAMAGE as error:
            raise TableError(f"{self.label} cannot be unpacked: {first_line(error)}. Fetch it again") from error


def _split(line, delimiter, label):
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, strict=True), [])
    except csv.Error as error:
        raise TableError(f"{label} cannot be read: {error}") from None


def _records(lines, places, width, delimiter, label, number):
    """The wanted fields of each row: tuples of text."""
    pick = itemgetter(*places) if len(places) > 1 else lambda row: (row[places[0]],)
    last = max(places) + 1
    for line in lines:
        number += 1
        quotes = '"' in line
        if line.count(delimiter) == width - 1 and (not quotes or line.count('"') % 2 == 0):
            row = line.rstrip("\r\n").split(delimiter, last)
            picked = pick(row)
            # Quoted fields without a delimiter within, which the count has just shown.
            yield tuple(_unquoted(each) for each in picked) if quotes else picked
            continue
        if not line.strip() or line.startswith("#"):  # VizieR ends with #END#
            continue
        start = number
        while line.count('"') % 2:  # a field may hold line breaks
            more = next(lines, "")
            number += 1
            if not more or len(line) > LINE:
                raise TableError(f"{label}, line {start}: a quotation mark is not closed")
            line += more
        row = _split(line, delimiter, f"{label}, line {start}")
        if len(row) != width:
            raise TableError(f"{label}, line {start} is damaged: {len(row)} fields where the table has {width} columns")
        yield pick(row)


def _columned(lines, places, layout, label):
    """The wanted fields of each row of fields between blanks, or in fixed columns."""
    for number, line in enumerate(lines, layout.skip + 1):
        if not line.strip() or line.startswith("#"):
            continue
        row = layout.fields(line.rstrip("\r\n"))
        if row is None:
            raise TableError(f"{label}, line {number} is damaged: text stands between the columns")
        if len(row) != len(layout.names):
            raise TableError(
                f"{label}, line {number} is damaged: {len(row)} fields where the table has {len(layout.names)} columns"
            )
        yield tuple(row[place] for place in places)


def _unquoted(field):
    if len(field) > 1 and field[0] == field[-1] == '"':
        return field[1:-1].replace('""', '"')
    return field


def _block(names, picked, types, label, first_line_number, decimal_comma=False):
    block = {}
    for name, column in zip(names, zip(*picked, strict=True), strict=True):
        longest = max(map(len, column))
        if longest > FIELD:
            row = first_line_number + 1 + max(range(len(column)), key=lambda i: len(column[i]))
            raise TableError(
                f"{label}, line {row}: a field of {longest} characters in column {name!r}, at most {FIELD} are read"
            )
        text = np.array(column)
        values, mask = _values(np.char.replace(text, ",", ".") if decimal_comma else text, types.get(name))
        if values.dtype.kind == "U" and name not in types:  # blanks around a field are no part of it
            stripped = np.char.strip(text)
            values, mask = (values, mask) if (stripped == text).all() and not decimal_comma else _values(stripped, None)
        block[name] = values, mask
    return block


def _values(text, kind):
    """Numbers where all are numbers, else text; the mask of what is missing."""
    mask = np.isin(text, NULLS)
    if mask.all() and kind not in ("string", "str"):
        return np.full(len(text), np.nan), mask
    if kind in ("string", "str"):
        return text, mask if mask.any() else None
    if kind == "bool":
        true, false = np.char.lower(text) == "true", np.char.lower(text) == "false"
        return (true, mask if mask.any() else None) if (true | false | mask).all() else (text, mask)
    filled = np.where(mask, "0", text) if mask.any() else text
    for dtype in (np.int64, float):
        if dtype is np.int64 and kind is not None and kind not in _INTEGERS:
            continue
        try:
            values = filled.astype(dtype)
        except (ValueError, OverflowError):
            if dtype is np.int64 and _long_integers(filled):
                break  # as text, they keep all their digits
            continue
        return values, mask if mask.any() else None
    return text, mask if mask.any() else None


def _long_integers(text):
    return all(each.lstrip("+-").isdigit() for each in text)


def _ecsv_header(comments, label):
    """Types and units by column, metadata, delimiter, and descriptions by column."""
    from astropy.table.meta import get_header_from_yaml

    try:
        header = get_header_from_yaml(comments[1:])
        columns = header["datatype"]
        types = {column["name"]: column["datatype"] for column in columns}
        units = {column["name"]: column["unit"] for column in columns if column.get("unit")}
        descriptions = {column["name"]: str(column["description"]) for column in columns if column.get("description")}
        special = any(column.get("subtype") for column in columns)
        delimiter = header.get("delimiter", " ")
        meta = dict(header.get("meta") or {})
    except Exception as error:  # whatever a damaged header makes of YAML
        raise TableError(f"{label} cannot be read as ECSV: its header is damaged ({first_line(error)})") from error
    if delimiter not in (" ", ","):
        raise TableError(f"{label} cannot be read as ECSV: its fields are separated by {delimiter!r}")
    if special or "__serialized_columns__" in meta:
        meta["__special__"] = True
    return types, units, meta, delimiter, descriptions
