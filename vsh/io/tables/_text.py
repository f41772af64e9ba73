"""Tables of text: their layout from the first lines (separators, names, units), then CSV and ECSV line by line.

Only the fields that are expected become values, and no line is longer than it may be.

Lists of positions from VLBI (ICRF2 and ICRF3, the .crf and .sou of IVS analysis centres, RFC, VieVS) have a source in a
line: names and flags, right ascension in hours and declination in degrees, each as three numbers, and behind them the
errors of both and their correlation. Errors of right ascension are without cos δ in all of them.

References: IERS Technical Note 35 (ICRF2); Charlot et al. 2020, A&A 644, A159 (ICRF3); Petrov & Kovalev 2025, ApJS 276,
38 (RFC); for getpar's .sou and the .crf of the IVS, what their headers say.
"""

import csv
import io
import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from itertools import chain, islice, zip_longest
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from vsh.io.tables._arrow import FIELD, NULLS, NotPlain, read_csv_blocks
from vsh.io.tables._source import TableSource, TemporaryPath, number_twins, open_dict_or_array, open_unpacked, unpacking
from vsh.tools.errors import TableError, first_line
from vsh.tools.notes import DOUBT, CodedNote
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: Lines of comments above a table; VizieR writes one a column, and more.
MOST_COMMENTS = 20_000
#: Lines below the comments that are looked at.
_LINES_OF_LAYOUT = 12
_DELIMITERS = (",", ";", "\t", "|")
_RULE = re.compile(r"[-=\s;|,\t+]*(--|==)[-=\s;|,\t+]*")
_DASHES = re.compile(r"-+")
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eEdD][+-]?\d+)?")
_ANGLE = re.compile(r"[+-]?\d{1,3}[:hd ]\s?\d{1,2}[:m ]\s?\d{1,2}(\.\d*)?s?")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Layout:
    """The layout of a table of text.

    Rows are fields between a delimiter, or between blanks (delimiter ""), or stand in fixed columns (`spans`).
    """

    names: list[str]
    skip: int
    delimiter: str = ","
    spans: tuple[slice, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    decimal_comma: bool = False
    notes: tuple[str, ...] = ()
    twins: tuple[str, ...] = ()

    def split_line(self, line: str) -> list[str] | None:
        """The fields of a line that no delimiter divides; None where text stands outside the columns."""
        if not self.spans:
            return _split_fields(line, " ") if '"' in line else line.split()
        gaps = zip(self.spans, self.spans[1:])
        if line[: self.spans[0].start].strip() or any(line[left.stop : right.start].strip() for left, right in gaps):
            return None
        return [line[span].strip() for span in self.spans]


def find_layout(lines: Iterator[str], label: str) -> Layout:
    """Find the layout of the table whose lines these are."""
    comments: list[str] = []
    skip, body_lines = 0, []
    for line in lines:
        text = line.lstrip("\ufeff").rstrip("\r\n")
        if not body_lines and (not text.strip() or text.startswith("#")):
            comments += [text.lstrip("#")] if text.startswith("#") else []
            skip += 1
            if skip > MOST_COMMENTS:
                raise TableError(f"{label} is no table: {MOST_COMMENTS} lines of comments, and no row")
            continue
        body_lines.append(text)
        if len(body_lines) == _LINES_OF_LAYOUT:
            break
    if not body_lines:
        raise TableError(f"{label} is empty" if not comments else f"{label} has a header and no table")
    top = 1 if len(body_lines) > 2 and _RULE.fullmatch(body_lines[0]) else 0  # a rule above the names
    rule_row = next((k for k in range(top + 1, len(body_lines)) if _RULE.fullmatch(body_lines[k])), None)
    if rule_row is not None and rule_row - top <= 6:
        return _read_layout_with_rule(body_lines[top:rule_row], body_lines[rule_row], skip + rule_row + 1, label)
    return _read_layout_without_rule(body_lines, comments, skip, label)


def _read_layout_with_rule(heading, rule, skip, label):
    """Names, units and a rule of dashes below them, as VizieR writes them."""
    delimiter = next((d for d in (";", "\t", "|", ",") if d in rule and d in heading[0]), None)
    if delimiter:
        names, *units = (_split_fields(line, delimiter) for line in heading)
        units = [" ".join(unit_parts).strip() for unit_parts in zip_longest(*units, fillvalue="")]
        return _add_layout_units(_make_layout(names, skip, delimiter), units)
    spans = [slice(match.start(), match.end()) for match in _DASHES.finditer(rule.replace("=", "-"))]
    # The last column may be longer than its dashes; text between two columns belongs to none.
    spans[-1] = slice(spans[-1].start, None)
    names, *units = ([line[span].strip() for span in spans] for line in heading)
    units = ["".join(unit_parts) for unit_parts in zip(*units)]
    return _add_layout_units(_make_layout(names, skip, "", tuple(spans)), units)


def _read_layout_without_rule(body, comments, skip, label):
    """Names in the first line, behind a #, or nowhere; lines above the names are left out with a note."""
    count = _count_title_lines(body)
    if count:
        layout = _read_layout_without_rule(body[count:], comments, skip + count, label)
        remark = f"{count} line{'s' * (count > 1)} above the names of the columns left out: {printable(body[0][:60])}"
        return replace(layout, notes=(*layout.notes, remark))
    lines = [line for line in body if line.strip()]
    delimiter = _find_delimiter(lines)
    fields = _split_fields(lines[0], delimiter)
    names = _find_names_in_comments(comments, len(fields), delimiter)
    # Where a comment has names, a row is one with few numbers as well.
    if _is_data_like(fields, 1 if names else 2) and not _is_line_of_quoted_names(lines[0]):
        notes: tuple[str, ...] = ()
        if names is None:
            names = [f"col{k + 1}" for k in range(len(fields))]
            notes = (
                f"{label} has no line of as many names as values: its columns are called col1 to col{len(fields)}",
            )
        layout = _mark_decimal_commas(_make_layout(names, skip, delimiter, notes=notes), lines)
        return _add_layout_units(layout, _find_units_in_comments(comments, len(fields), delimiter))
    below = [_split_fields(line, delimiter) for line in lines[1:]]
    is_blank = bool(delimiter) and below and all(len(entries) == 1 for entries in below)
    if is_blank and all(len(line.split()) == len(fields) for line in lines[1:]):  # names between ;, rows between blanks
        return _make_layout(fields, skip + 1, "")
    units = []
    if len(below) > 1 and len(below[0]) == len(fields) and _is_line_of_units(below[0]) and _is_data_like(below[1]):
        units, skip = below[0], skip + 1
        lines = [lines[0], *lines[2:]]
    return _add_layout_units(_mark_decimal_commas(_make_layout(fields, skip + 1, delimiter), lines[1:]), units)


def _count_title_lines(body):
    """Number of lines above the names: a title, or headings of several columns, where the rows have more fields."""
    for k, line in enumerate(body[1:6], 1):
        following_lines = [row for row in body[k:] if row.strip()]
        if not following_lines:
            return 0
        delimiter = _find_delimiter(following_lines)
        fields = _split_fields(line, delimiter)
        if not _is_data_like(fields) or len(fields) < 4:
            continue
        name_line = k - 1
        if name_line and _is_line_of_units(_split_fields(body[name_line], delimiter)):
            name_line -= 1
        title_fields, names = _split_fields(body[0], delimiter), _split_fields(body[name_line], delimiter)
        is_named = len(names) == len(fields) and all(names[1:]) and not _is_data_like(names)
        is_title = len(title_fields) != len(fields) or not all(title_fields[1:])
        return name_line if name_line and is_named and is_title and not _is_data_like(title_fields) else 0
    return 0


def _find_delimiter(lines):
    """Find the delimiter that all lines have equally often, or blanks."""
    best = ""
    for delimiter in _DELIMITERS:
        counts = [len(_split_fields(line, delimiter)) for line in lines]
        if counts[0] < 2 or counts[0] <= (len(_split_fields(lines[0], best)) if best else 1):
            continue
        # A line that is damaged does not change what the others have.
        n_matches = sum(count == counts[0] for count in counts[1:])
        has_names = not _is_data_like(_split_fields(lines[0], delimiter))
        if len(counts) == 1 or n_matches >= (len(counts) - 1) / 2 or has_names:
            best = delimiter
    return best


def _split_fields(line, delimiter):
    if not delimiter:
        return line.split()
    try:
        return [entry.strip() for entry in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [entry.strip() for entry in line.split(delimiter)]


def _make_layout(names, skip, delimiter, spans=(), notes=()):
    """Make a layout with names without blanks around them; a column without one is called by its number."""
    names = [name.strip().strip('"').strip() or f"col{k + 1}" for k, name in enumerate(names)]
    unique_names, twins = number_twins(names)
    return Layout(unique_names, skip, delimiter, spans, notes=notes, twins=twins)


#: A line of the header of IVS catalogues: number, unit and meaning of a column.
_NUMBERED_COLUMN = re.compile(r"\s*(\d+)\s+(\S+)\s+(.+?)\s*")
#: What these meanings are called here; errors of right ascension only where they include cos δ.
_NAME_OF_MEANING = {
    "IERS designation": "iers", "IVS designation": "ivs", "Right ascension": "ra", "Declination": "dec",
    "Formal uncertainty of the right ascension (*cos(Dec))": "ra_error",
    "Formal uncertainty of the declination": "dec_error",
    "Correlation between right ascension and declination": "ra_dec_corr",
}  # fmt: skip


def _find_numbered_names_and_units(comments, n_columns):
    """Find names and units in a header that numbers its columns; none where it does not have all of them."""
    matches = [match for match in map(_NUMBERED_COLUMN.fullmatch, comments) if match]
    if [int(match[1]) for match in matches] != list(range(1, n_columns + 1)):
        return None, []
    return [_NAME_OF_MEANING.get(match[3], match[3]) for match in matches], [match[2] for match in matches]


def _find_names_in_comments(comments, n_columns, delimiter):
    """Find the names behind a # right above the rows, where they are as many as the columns."""
    if names := _find_numbered_names_and_units(comments, n_columns)[0]:
        return names
    for comment in reversed(comments[-5:]):
        for names in (_split_fields(comment, delimiter), comment.split(), _split_fields(comment, ",")):
            if len(names) == n_columns and not _is_data_like(names) and not _is_line_of_units(names):
                return names
    return None


def _find_units_in_comments(comments, n_columns, delimiter):
    """Find the units behind a # right above the rows, where they are as many as the columns."""
    if units := _find_numbered_names_and_units(comments, n_columns)[1]:
        return units
    for comment in reversed(comments[-3:]):
        for units in (_split_fields(comment, delimiter), comment.split()):
            if len(units) == n_columns and _is_line_of_units(units):
                return units
    return []


def _is_data_like(fields: Sequence[str], min_numbers: int = 2) -> bool:
    """Return whether at least two of the fields, and a third of them unless one is enough, are numbers."""
    n_numbers = sum(bool(_NUMBER.fullmatch(entry) or _ANGLE.fullmatch(entry)) for entry in fields)
    return n_numbers >= min_numbers and (3 * n_numbers >= len(fields) or min_numbers == 1)


def _is_line_of_quoted_names(line):
    return line.lstrip().startswith('"') and not any(_NUMBER.fullmatch(entry) for entry in line.split(","))


def _is_line_of_units(fields):
    """Return whether a line below the names holds units: no numbers, and most of it units that astropy knows."""
    candidates = [entry.strip('()[] "') for entry in fields if entry.strip('()[] "-')]
    if not candidates or any(_NUMBER.fullmatch(candidate) for candidate in candidates):
        return False
    return sum(_is_unit_name(candidate) for candidate in candidates) * 2 > len(candidates)


def _is_unit_name(candidate):
    from astropy import units as u

    units = [u.Unit(candidate, format=unit_format, parse_strict="silent") for unit_format in ("generic", "cds")]
    return candidate in ("h:m:s", "d:m:s") or not all(isinstance(unit, u.UnrecognizedUnit) for unit in units)


def _add_layout_units(layout, units):
    unit_names = [unit.strip().strip('"').strip() for unit in units]
    unit_names = [unit[1:-1].strip() if unit[:1] + unit[-1:] in ("()", "[]") else unit for unit in unit_names]
    return replace(layout, units={name: unit for name, unit in zip(layout.names, unit_names) if unit.strip("-")})


def _mark_decimal_commas(layout, lines):
    """Return the layout with decimal commas, where fields have them and none has a point."""
    if layout.delimiter in (",", ""):
        return layout
    values = [value for line in lines for value in _split_fields(line, layout.delimiter)]
    n_commas = sum(bool(_DECIMAL_COMMA.fullmatch(value)) for value in values)
    n_points = sum("." in value and bool(_NUMBER.fullmatch(value)) for value in values)
    if not n_commas or n_points:
        return layout
    notes = (*layout.notes, "numbers are written with decimal commas")
    return replace(layout, decimal_comma=True, notes=notes)


#: Longer lines are damage, or no table. [characters]
LINE = 2**22
#: Files of fewer bytes are read before pyarrow is imported.
LARGE = 2**22
_INTEGERS = {f"{sign}int{bits}" for sign in ("", "u") for bits in (8, 16, 32, 64)}


def open_text(path: PathName, label: str) -> TableSource:
    """A table of text: ECSV where its first line says so, whatever its name; else as its first lines are laid out."""
    with open_lines(path, label) as lines:
        top_line = next(lines, "")
        # A mark of the byte order, which spreadsheets write, is no part of the first name.
        is_ecsv = top_line.lstrip("\ufeff").replace(" ", "").upper().startswith("#%ECSV")
        if is_ecsv:
            layout, dtypes, meta, descriptions = _read_ecsv_header(top_line, lines, label)
        else:
            layout, dtypes, meta, descriptions = find_layout(chain([top_line], lines), label), {}, {}, {}
    names, n_columns = layout.names, len(layout.names)

    def read(request, max_rows):
        column_indices = [names.index(name) for name in request]
        n_rows = 0
        if layout.delimiter and not layout.decimal_comma and os.path.getsize(path) >= LARGE:
            with suppress(NotPlain):
                for columns in read_csv_blocks(lambda: open_unpacked(path, label), layout, dtypes, request, max_rows):
                    block = {name: _convert_arrow_column(column, dtypes.get(name)) for name, column in columns.items()}
                    yield block
                    n_rows += len(next(iter(block.values()))[0])
                if n_rows:
                    return
        with open_lines(path, label) as lines:
            for _ in islice(lines, layout.skip):
                pass
            if layout.delimiter:
                records = _iterate_records(lines, column_indices, n_columns, layout.delimiter, label, layout.skip)
            else:
                records = _iterate_records_between_blanks(lines, column_indices, layout, label)
            for _ in islice(records, n_rows):
                pass
            while block_records := list(islice(records, max_rows)):
                yield _parse_records(request, block_records, dtypes, label, layout.skip + n_rows, layout.decimal_comma)
                n_rows += len(block_records)
            if not n_rows:
                yield {name: (np.empty(0), None) for name in request}

    return TableSource(
        label, tuple(names), read, layout.units, meta, layout.notes, descriptions=descriptions, twins=layout.twins
    )


def _read_ecsv_header(top_line, lines, label):
    """Read layout, types, metadata and descriptions from the header of an ECSV file."""
    comments, header_line = [], top_line
    while header_line.lstrip("\ufeff").startswith("#"):
        comments.append(header_line.lstrip("\ufeff")[1:].strip("\n\r").removeprefix(" "))
        header_line = next(lines, "")
    if not header_line.strip():
        raise TableError(f"{label} has a header and no table")
    from astropy.table.meta import get_header_from_yaml

    try:
        header = get_header_from_yaml(comments[1:])
        columns = header["datatype"]
        datatypes = {column["name"]: column["datatype"] for column in columns}
        units = {column["name"]: column["unit"] for column in columns if column.get("unit")}
        descriptions = {column["name"]: str(column["description"]) for column in columns if column.get("description")}
        has_subtypes = any(column.get("subtype") for column in columns)
        delimiter = header.get("delimiter", " ")
        meta = dict(header.get("meta") or {})
    except Exception as error:  # whatever a damaged header makes of YAML
        raise TableError(f"{label} cannot be read as ECSV: its header is damaged ({first_line(error)})") from error
    if delimiter not in (" ", ","):
        raise TableError(f"{label} cannot be read as ECSV: its fields are separated by {delimiter!r}")
    if has_subtypes or "__serialized_columns__" in meta:
        meta["__special__"] = True
    names = _split_line_strictly(header_line, delimiter, label)
    if list(datatypes) != names:
        raise TableError(f"{label} is damaged: its header describes other columns than the line of names")
    if repeated := number_twins(names)[1]:
        raise TableError(f"{label} is damaged: several columns are called {', '.join(map(repr, repeated))}")
    return Layout(names, len(comments) + 1, delimiter, units=units), datatypes, meta, descriptions


@contextmanager
def open_lines(path: PathName, label: str) -> Iterator[Iterator[str]]:
    """The lines of a file, packed or not; as a context, so that a file is always closed."""
    with io.TextIOWrapper(open_unpacked(path, label), encoding="utf-8", newline="\n") as stream:
        yield _read_lines(stream, label)


def _read_lines(stream, label):
    with unpacking(label):
        try:
            while line := stream.readline(LINE):
                if len(line) == LINE:
                    raise TableError(f"{label} is damaged, or no table: it has a line of more than {LINE} characters")
                yield line
        except UnicodeDecodeError as error:
            raise TableError(f"{label} is no text in UTF-8: {error.reason} at byte {error.start}") from error


def _split_line_strictly(line, delimiter, label):
    try:
        return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, strict=True), [])
    except csv.Error as error:
        raise TableError(f"{label} cannot be read: {error}") from None


def _iterate_records(lines, indices, n_columns, delimiter, label, line_number):
    """Iterate over the wanted fields of each row: tuples of text."""
    select_fields = itemgetter(*indices) if len(indices) > 1 else lambda row: (row[indices[0]],)
    n_splits = max(indices) + 1
    for line in lines:
        line_number += 1
        has_quotes = '"' in line
        if line.count(delimiter) == n_columns - 1 and (not has_quotes or _has_no_quoted_delimiter(line, delimiter)):
            row = line.rstrip("\r\n").split(delimiter, n_splits)
            wanted_fields = select_fields(row)
            yield tuple(_unquote_field(value) for value in wanted_fields) if has_quotes else wanted_fields
            continue
        if not line.strip() or line.startswith("#"):  # VizieR ends with #END#
            _refuse_second_table(line, line_number, label)
            continue
        start_number = line_number
        while line.count('"') % 2:  # a field may hold line breaks
            continuation = next(lines, "")
            line_number += 1
            if not continuation or len(line) > LINE:
                raise TableError(f"{label}, line {start_number}: a quotation mark is not closed")
            line += continuation
        row = _split_line_strictly(line, delimiter, f"{label}, line {start_number}")
        if len(row) != n_columns:
            raise TableError(
                f"{label}, line {start_number} is damaged: {len(row)} fields where the table has {n_columns} "
                "columns. Complete the line, or delete it"
            )
        yield select_fields(row)


def _iterate_records_between_blanks(lines, column_indices, layout, label):
    """Iterate over the wanted fields of each row of fields between blanks, or in fixed columns."""
    for number, line in enumerate(lines, layout.skip + 1):
        if not line.strip() or line.startswith("#"):
            _refuse_second_table(line, number, label)
            continue
        row = layout.split_line(line.rstrip("\r\n"))
        if row is None:
            raise TableError(f"{label}, line {number} is damaged: text stands between the columns")
        if len(row) != len(layout.names):
            raise TableError(
                f"{label}, line {number} is damaged: {len(row)} fields where the table has {len(layout.names)} columns"
                + (
                    ". Complete the line, or delete it"
                    if layout.spans
                    else ". Blanks do not tell which value is missing: put commas between the fields"
                )
            )
        yield tuple(row[index] for index in column_indices)


#: The line with which VizieR begins each table of a file.
_TABLE_LINE = re.compile(r"#\s*Table\b", re.IGNORECASE)


def _refuse_second_table(line, number, label):
    """Raise TableError where another table of VizieR begins below the rows."""
    if _TABLE_LINE.match(line):
        raise TableError(
            f"{label} holds several tables; another begins in line {number}: {printable(line.strip()[:60])}. Say which "
            f"is meant, by its number: {label}#1"
        )


def open_numbered_table(path: PathName, number: int, label: str) -> TableSource:
    """Open one of several tables that VizieR writes into a file, by its number from 1."""
    temporary_path = TemporaryPath("table.tsv")
    n_tables = 0
    with open_lines(path, label) as lines, open(temporary_path.name, "w", encoding="utf-8") as file:
        for line in lines:
            n_tables += bool(_TABLE_LINE.match(line))
            if n_tables == number:
                file.write(line)
    if n_tables < number or number < 1:
        raise TableError(f"{label} holds {n_tables} tables of VizieR: there is no number {number}")
    source = open_text(Path(temporary_path.name), label)
    return replace(source, read=lambda names, rows: source.read(names, rows) if temporary_path.name else iter(()))


def _has_no_quoted_delimiter(line, delimiter):
    """Return whether no delimiter of a line stands between quotation marks."""
    return all(field.count('"') % 2 == 0 for field in line.split(delimiter))


def _unquote_field(field):
    if len(field) > 1 and field[0] == field[-1] == '"':
        return field[1:-1].replace('""', '"')
    return field


def _parse_records(names, records, datatypes, label, first_line_number, decimal_comma=False):
    block = {}
    for name, column in zip(names, zip(*records, strict=True), strict=True):
        longest = max(map(len, column))
        if longest > FIELD:
            number = first_line_number + 1 + max(range(len(column)), key=lambda i: len(column[i]))
            raise TableError(
                f"{label}, line {number}: a field of {longest} characters in column {name!r}, at most {FIELD} are read"
            )
        block[name] = _parse_text_column(np.array(column), datatypes.get(name), decimal_comma)
    return block


def _parse_text_column(texts, datatype, decimal_comma=False):
    """Parse a column of text as values and mask, whose header says a type or not."""
    values, mask = _parse_numbers_or_text(np.char.replace(texts, ",", ".") if decimal_comma else texts, datatype)
    if values.dtype.kind == "U" and datatype is None:  # blanks around a field are no part of it
        stripped_text = np.char.strip(texts)
        if decimal_comma or (stripped_text != texts).any():
            return _parse_numbers_or_text(stripped_text, None)
    return values, mask


def _convert_arrow_column(column, datatype):
    """Convert to values and mask a column that Arrow read as numbers, or as text where it is not sure of numbers."""
    if column.dtype.kind == "U":
        return _parse_text_column(column, datatype)
    mask = np.ma.getmaskarray(column)
    if mask.all():
        return np.full(len(column), np.nan), mask
    return column.data, mask if mask.any() else None


def _parse_numbers_or_text(texts, datatype):
    """Parse text as numbers where all are numbers; else it stays text. With the mask of what is missing, or None."""
    mask = np.isin(texts, NULLS)
    if mask.all() and datatype not in ("string", "str"):
        return np.full(len(texts), np.nan), mask
    missing_mask = mask if mask.any() else None
    if datatype in ("string", "str"):
        return texts, missing_mask
    if datatype == "bool":
        is_true, is_false = np.char.lower(texts) == "true", np.char.lower(texts) == "false"
        return is_true if (is_true | is_false | mask).all() else texts, missing_mask
    filled_text = texts if missing_mask is None else np.where(mask, "0", texts)
    if (np.char.find(filled_text, "_") >= 0).any():  # which Python leaves out of numbers: 1_2 is a name
        return texts, missing_mask
    for dtype in (np.int64, float) if datatype is None or datatype in _INTEGERS else (float,):
        try:
            return filled_text.astype(dtype), missing_mask
        except (ValueError, OverflowError):
            if dtype is np.int64 and all(value.lstrip("+-").isdigit() for value in filled_text):
                break  # as text, they keep all their digits
    return texts, missing_mask


#: Names and flags, hours, minutes and seconds, sign, degrees, minutes and seconds, and the rest.
_POSITION_ROW = re.compile(
    r"(?P<names>.*?)(?:^|\s)(?P<h>\d+)[ :]+(?P<m>\d+)[ :]+(?P<s>\d+(?:\.\d*)?)\s+"
    r"(?P<sign>[-+]?)\s*(?P<d>\d+)[ :]+(?P<dm>\d+)[ :]+(?P<ds>\d+(?:\.\d*)?)(?P<rest>.*)"
)
#: The lines of getpar: SOU_GCO:  0002+051  R: 00_05_20.21559171 -+  0.1234  D: +05_24_10.8001234 -+  0.1234  C: 0.12 …
_GETPAR_ROW = re.compile(
    r"SOU_GCO:\s+(?P<names>\S+)\s+R:\s*(?P<h>\d+)_(?P<m>\d+)_(?P<s>[\d.]+)\s+-\+\s+(?P<e1>\S+)\s+"
    r"D:\s*(?P<sign>[-+]?)(?P<d>\d+)_(?P<dm>\d+)_(?P<ds>[\d.]+)\s+-\+(?P<rest>.*)"
)
_THREE_WORDS = re.compile(r"\s*\S+\s+\S+\s+\S+")
_SIGNED = re.compile(r"[-+]?\d*\.?\d+")
_COMMENT_MARKS = ("#", "*", "!", "%", "$")
_COLUMN_PLACE = re.compile(r"#\s*(\d+)\s*-\s*(\d+)\s+(redshift from|object primary type)")
_DESIGNATION = re.compile(r"J\d{4}\S*")
_MAS_WORDS = ("VLBI SOURCE POSITION CATALOGUE", "Radio Fundamental Catalogue", "RFC J")
#: No list in the layout of ICRF is as uncertain as this in the median: its errors are in mas. [arcsec]
_MOST_ARCSEC = 0.1
#: A heading with (mas) is of the errors where they are at least so large. [mas]
_LEAST_MAS = 0.005
#: And none of compact radio sources as this. [mas]
_MOST_MAS = 2000.0


def open_vlbi(path: PathName, label: str) -> TableSource:
    """A list of positions as a table: names, D marks, degrees, and errors in mas, of right ascension times cos δ."""
    with open_lines(path, label) as line_reader:
        lines = list(line_reader)
    numbered_lines = [(number, line.rstrip("\r\n")) for number, line in enumerate(lines, 1)]
    is_getpar = any(line.startswith("SOU_GCO:") for _, line in numbered_lines)
    pattern = _GETPAR_ROW if is_getpar else _POSITION_ROW
    rows = [(number, line) for number, line in numbered_lines if line.strip() and not line.startswith(_COMMENT_MARKS)]
    start = next((i for i, (_, line) in enumerate(rows) if pattern.match(line) or _is_source_like(line)), None)
    if start is None:
        raise TableError(f"{label} has no line with a position in hours and degrees: is it a list of VLBI positions?")
    # Above the first source is the heading; below it, every line that is not blank is a source.
    rows = [(number, line) for number, line in rows[start:] if any(map(str.isalnum, line))]
    is_icrf = rows[0][1].startswith("ICRF J")
    sources = [_parse_source_line(label, number, line, pattern, is_icrf) for number, line in rows]
    heading = numbered_lines[: rows[0][0] - 1]
    is_in_mas = is_getpar or any(phrase in line for _, line in numbered_lines for phrase in _MAS_WORDS)
    described = _read_described_columns(heading, rows)
    return _make_vlbi_table(label, rows, sources, is_in_mas, any("(mas)" in line for _, line in heading), described)


def _read_described_columns(heading, rows):
    """Read redshifts and types where the heading says in which characters they stand, as that of OCARS does."""
    slices: dict[str, list[slice]] = {"redshift from": [], "object primary type": []}
    for _, line in heading:
        if match := _COLUMN_PLACE.match(line):
            slices[match[3]].append(slice(int(match[1]) - 1, int(match[2])))
    redshifts, (type_at, *_) = slices["redshift from"], [*slices["object primary type"], None]
    columns: dict[str, Any] = {} if type_at is None else {"type": np.array([line[type_at].strip() for _, line in rows])}
    if redshifts:  # the first that is known, of NED, SIMBAD or SDSS; behind it c or d marks a limit
        candidates = ((line[span] for span in redshifts if _is_known_redshift(line, span)) for _, line in rows)
        columns["redshift"] = np.array([float(next(texts, "nan")) for texts in candidates])
    return columns


def _is_source_like(line):
    """Return whether a line is a source, perhaps a damaged one, and no heading: so many numbers stand in no heading."""
    return line.startswith("ICRF J") or sum(_SIGNED.fullmatch(token) is not None for token in line.split()) > 6


def _is_known_redshift(line, span):
    """Return whether a number stands in a span of a line, and no mark of a limit behind it."""
    return _SIGNED.fullmatch(line[span].strip()) and line[span.stop : span.stop + 1] not in ("c", "d")


def _make_vlbi_table(label, rows, sources, is_stated_in_mas, is_mas_in_heading, described_columns):
    names, positions, remainder_texts, remainders = zip(*sources, strict=True)
    if len(remainders) > 2 and len(remainders[-1]) < min(map(len, remainders[:-1])):
        line_number, line = rows[-1]
        excerpt = printable(line.strip()[:80])
        raise TableError(f"{label}, line {line_number} is damaged: the list ends within it: {excerpt!r}")
    lon, lat = np.array(positions).T
    columns = {
        "icrf": np.array([icrf for icrf, _, _ in names]),
        "iers": np.array([name for _, name, _ in names]),
        "defining": np.where([mark for *_, mark in names], "D", ""),
        "ra": lon,
        "dec": lat,
        **described_columns,
    }
    units = {"ra": "deg", "dec": "deg"}
    notes: tuple[str, ...] = ()
    has_epoch = [len(words) > 0 and re.fullmatch(r"(19|20)\d\d(\.\d*)?", words[0]) is not None for words in remainders]
    error_words, n_blank = _fill_blank_errors(remainder_texts, remainders)
    file = Path(label).name  # pages and files do not say where a catalogue lies
    errors = None if all(has_epoch) or not any(remainders) else _parse_errors_of_all(label, rows, error_words)
    if errors is None:  # the catalogue of VieVS has an epoch there, JVAS nothing, AT20G fluxes
        notes = (f"{file} has no errors",)
    else:
        median = np.nanmedian(errors[:, 1])
        is_in_mas = is_stated_in_mas or median > (_LEAST_MAS if is_mas_in_heading else _MOST_ARCSEC)
        unit_text = "mas" if is_in_mas else "seconds of time and arcsec"
        scale, ra_factor = (1.0, 1.0) if is_in_mas else (1000.0, 15.0)
        if median * scale > _MOST_MAS:
            raise TableError(
                f"{label}: errors of declination are {median * scale / 1000:.3g} arcsec in the median if in "
                f"{'mas' if scale == 1.0 else 'arcsec'}: another unit? Make it a table with units (CSV, ECSV)"
            )
        ra_errors = errors[:, 0] * scale * ra_factor * np.cos(np.radians(lat))
        columns |= {"ra_error": ra_errors, "dec_error": errors[:, 1] * scale, "ra_dec_corr": errors[:, 2]}
        units |= {"ra_error": "mas", "dec_error": "mas"}
        doubt = f"warning: {file}: no unit of the errors is stated; their median of {median:.3g} is too large in arcsec"
        notes = (
            *([CodedNote(doubt, DOUBT)] if is_in_mas and not (is_stated_in_mas or is_mas_in_heading) else []),
            f"{file}: errors are read in {unit_text}; those of right ascension do not include cos δ and were "
            "multiplied by it",
            *([f"{n_blank} sources have errors and no correlation, which was taken as zero"] if n_blank else []),
        )
    return replace(open_dict_or_array(columns), label=label, units=units, notes=notes)


def _parse_errors_of_all(label, rows, error_words):
    """Parse errors and correlations of all sources, (n, 3); None where most lines have something else there."""
    parsed_errors, first_error = [], None
    for (line_number, line), words in zip(rows, error_words, strict=True):
        try:
            parsed_errors.append(_parse_source_errors(label, line_number, line, words))
        except TableError as error:
            first_error = first_error or error
    if 2 * len(parsed_errors) < len(rows) or np.isnan(parsed_errors).all():
        return None
    if first_error is not None:
        raise first_error
    return np.array(parsed_errors)


def _fill_blank_errors(remainder_texts, remainder_words):
    """Fill the words behind each position with nan where errors are blank, 0 where correlations are; count those."""
    # Where the words of most rows end: one that is blank up to there has none, whatever stands behind.
    ends = Counter(match.end() for match in map(_THREE_WORDS.match, remainder_texts) if match)
    usual_end = max(ends, key=ends.__getitem__, default=0)
    error_words, n_blank = [], 0
    for text, words in zip(remainder_texts, remainder_words, strict=True):
        leading_words = text[:usual_end].split()
        if not leading_words and text.strip():
            words = ["nan"] * 3
        elif len(leading_words) == 2 and not text[usual_end - 2 : usual_end].strip():
            words, n_blank = [*leading_words, "0"], n_blank + 1
        error_words.append(words)
    return error_words, n_blank


def _parse_source_line(label, line_number, line, pattern, is_icrf):
    """Parse names, the position [deg], and what is behind it, as text and as words."""
    excerpt = printable(line.strip()[:80])
    if is_icrf and not re.match(r"\s*(ICRF(\s|$)|-\s|\s)", line + " "):
        raise TableError(f"{label}, line {line_number} is damaged: it does not begin with 'ICRF J': {excerpt!r}")
    match = pattern.match(line)
    if match is None:
        raise TableError(f"{label}, line {line_number} is damaged: {excerpt!r}")
    hours, minutes, degrees, arcmin = (int(match[group]) for group in ("h", "m", "d", "dm"))
    seconds, arcsec = float(match["s"]), float(match["ds"])
    lon = 15 * (hours + minutes / 60 + seconds / 3600)
    abs_lat = degrees + arcmin / 60 + arcsec / 3600
    in_range = hours < 24 and minutes < 60 and seconds < 60 and arcmin < 60 and arcsec < 60
    if not (in_range and abs_lat <= 90):
        raise TableError(f"{label}, line {line_number} has no position on the sky: {excerpt!r}")
    words = match["rest"].split()
    if pattern is _GETPAR_ROW:
        words = [match["e1"], *(token for token in words if token != "C:")]
    return _parse_identity(match["names"]), (lon, -abs_lat if match["sign"] == "-" else abs_lat), match["rest"], words


def _parse_identity(names_text):
    """Parse the designation by J2000.0 coordinates, the other name, and whether the source is defining."""
    tokens = [token for token in names_text.split() if token not in ("ICRF", "RFC", "-")]
    is_defining = "D" in tokens[1:]
    tokens = [token for k, token in enumerate(tokens) if k == 0 or len(token) > 1]
    tokens = [token for k, token in enumerate(tokens) if len(token) > 1 or len(tokens) == 1]
    designation = next((token for token in tokens if _DESIGNATION.fullmatch(token)), "")
    other_names = [token for token in tokens if token != designation]
    return designation, other_names[-1] if other_names else designation, is_defining


def _parse_source_errors(label, line_number, line, words):
    excerpt = printable(line.strip()[:80])
    # Where a list has a band or a mark in place of a correlation, there is none.
    tokens = [*words[:2], "0"] if re.fullmatch(r"[-*A-Z]", "".join(words[2:3])) else words[:3]
    try:
        errors = [float(token) for token in tokens]
        east, north, rho = errors
    except ValueError:
        raise TableError(f"{label}, line {line_number} is damaged: {excerpt!r}") from None
    if east == 0 or north == 0:  # rounded away: nobody knows how large it is
        return [np.nan] * 3
    if not np.isnan(errors).all() and not (np.isfinite(errors).all() and east > 0 and north > 0 and abs(rho) < 1):
        raise TableError(f"{label}, line {line_number} has no usable errors: {excerpt!r}")
    return errors
