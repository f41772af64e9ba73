"""How a table of text is laid out, from its first lines: separators, names, units, and where the rows begin."""

import csv
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace

from vsh.tools.errors import TableError

#: Lines of comments above a table; VizieR writes one a column, and more.
MOST_COMMENTS = 20_000
#: Lines below the comments that are looked at.
_LOOK = 12
_DELIMITERS = (",", ";", "\t", "|")
_RULE = re.compile(r"[-=\s;|,\t+]*(--|==)[-=\s;|,\t+]*")
_DASHES = re.compile(r"-+")
_NUMBER = re.compile(r"[+-]?(\d+[.,]?\d*|[.,]\d+)([eEdD][+-]?\d+)?")
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

    def fields(self, line: str) -> list[str] | None:
        """The fields of a line that no delimiter divides; None where text stands outside the columns."""
        if not self.spans:
            return _fields(line, " ") if '"' in line else line.split()
        gaps = zip(self.spans, self.spans[1:])
        if line[: self.spans[0].start].strip() or any(line[a.stop : b.start].strip() for a, b in gaps):
            return None
        return [line[span].strip() for span in self.spans]


def layout_of(lines: Iterator[str], label: str) -> Layout:
    """The layout of the table whose lines these are."""
    comments: list[str] = []
    skip, body = 0, []
    for line in lines:
        text = line.lstrip("\ufeff").rstrip("\r\n")
        if not body and (not text.strip() or text.startswith("#")):
            comments += [text.lstrip("#")] if text.startswith("#") else []
            skip += 1
            if skip > MOST_COMMENTS:
                raise TableError(f"{label} is no table: {MOST_COMMENTS} lines of comments, and no row")
            continue
        body.append(text)
        if len(body) == _LOOK:
            break
    if not body:
        raise TableError(f"{label} is empty" if not comments else f"{label} has a header and no table")
    top = 1 if len(body) > 2 and _RULE.fullmatch(body[0]) else 0  # a rule above the names
    rule = next((k for k in range(top + 1, len(body)) if _RULE.fullmatch(body[k])), None)
    if rule is not None and rule - top <= 6:
        return _ruled(body[top:rule], body[rule], skip + rule + 1, label)
    return _plain(body, comments, skip, label)


def _ruled(above, rule, skip, label):
    """Names, units and a rule of dashes below them, as VizieR writes them."""
    delimiter = next((d for d in (";", "\t", "|", ",") if d in rule and d in above[0]), None)
    if delimiter:
        names, *units = (_fields(line, delimiter) for line in above)
        units = [" ".join(part).strip() for part in zip(*(_padded(row, len(names)) for row in units))]
        return _with_units(Layout(_named(names, label), skip, delimiter), units)
    spans = [slice(match.start(), match.end()) for match in _DASHES.finditer(rule.replace("=", "-"))]
    # The last column may be longer than its dashes; text between two columns belongs to none.
    spans[-1] = slice(spans[-1].start, None)
    names, *units = ([line[span].strip() for span in spans] for line in above)
    units = ["".join(part) for part in zip(*units)]
    return _with_units(Layout(_named(names, label), skip, "", tuple(spans)), units)


def _plain(body, comments, skip, label):
    """Names in the first line, behind a #, or nowhere."""
    rows = [line for line in body if line.strip()]
    delimiter = _delimiter(rows)
    first = _fields(rows[0], delimiter)
    if _looks_like_data(first) and not _quoted_name(rows[0]):
        names = _names_in_comment(comments, len(first), delimiter)
        notes: tuple[str, ...] = ()
        if names is None:
            names = [f"col{k + 1}" for k in range(len(first))]
            notes = (f"{label} has no line of names: its columns are called col1 to col{len(first)}",)
        return _with_comma(Layout(_named(names, label), skip, delimiter, notes=notes), rows)
    below = [_fields(line, delimiter) for line in rows[1:]]
    blank = bool(delimiter) and below and all(len(row) == 1 for row in below)
    if blank and all(len(line.split()) == len(first) for line in rows[1:]):  # names between ; over rows between blanks
        return Layout(_named(first, label), skip + 1, "")
    units = []
    if len(below) > 1 and len(below[0]) == len(first) and _are_units(below[0]) and _looks_like_data(below[1]):
        units, skip = below[0], skip + 1
        rows = [rows[0], *rows[2:]]
    return _with_units(_with_comma(Layout(_named(first, label), skip + 1, delimiter), rows[1:]), units)


def _delimiter(rows):
    """What stands between fields: the delimiter of which the lines have equally many, or blanks."""
    best = ""
    for delimiter in _DELIMITERS:
        counts = [len(_fields(line, delimiter)) for line in rows]
        if counts[0] < 2 or counts[0] <= (len(_fields(rows[0], best)) if best else 1):
            continue
        # A line that is damaged does not change what the others have.
        alike = sum(count == counts[0] for count in counts[1:])
        named = not _looks_like_data(_fields(rows[0], delimiter))
        if len(counts) == 1 or alike >= (len(counts) - 1) / 2 or named:
            best = delimiter
    return best


def _fields(line, delimiter):
    if not delimiter:
        return line.split()
    try:
        return [each.strip() for each in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]
    except csv.Error:
        return [each.strip() for each in line.split(delimiter)]


def _named(names, label):
    """Names without blanks around them; a column without one is called by its number."""
    names = [name.strip().strip('"').strip() or f"col{k + 1}" for k, name in enumerate(names)]
    check_repeated(names, label)
    return names


def check_repeated(names: Iterable[str], label: str) -> None:
    """Refuse columns of one name.

    Raises
    ------
    TableError
        If there are such.
    """
    repeated = sorted(name for name, times in Counter(names).items() if times > 1)
    if repeated:
        raise TableError(f"{label} is damaged: several columns are called {', '.join(map(repr, repeated))}")


def _names_in_comment(comments, count, delimiter):
    """The names behind a # right above the rows, where they are as many as the columns."""
    for comment in reversed(comments[-3:]):
        for names in (_fields(comment, delimiter), comment.split(), _fields(comment, ",")):
            if len(names) == count and not _looks_like_data(names):
                return names
    return None


def _looks_like_data(fields: Sequence[str]) -> bool:
    """Whether a third of the fields, and at least two, are numbers."""
    numbers = sum(bool(_NUMBER.fullmatch(each)) for each in fields)
    return numbers >= 2 and 3 * numbers >= len(fields)


def _quoted_name(line):
    return line.lstrip().startswith('"') and not any(_NUMBER.fullmatch(f) for f in line.split(","))


def _are_units(fields):
    """Whether a line below the names holds units: no numbers, and most of it units that astropy knows."""
    words = [each.strip('()[] "') for each in fields if each.strip('()[] "-')]
    if not words or any(_NUMBER.fullmatch(word) for word in words):
        return False
    return sum(_is_unit(word) for word in words) * 2 > len(words)


def _is_unit(word):
    if word in ("h:m:s", "d:m:s"):
        return True
    from astropy import units as u

    for form in ("generic", "cds"):
        try:
            u.Unit(word, format=form)
            return True
        except (ValueError, TypeError):
            continue
    return False


def _padded(row, count):
    return (row + [""] * count)[:count]


def _with_units(layout, units):
    words = [unit.strip().strip('"').strip() for unit in units]
    words = [unit[1:-1].strip() if unit[:1] + unit[-1:] in ("()", "[]") else unit for unit in words]
    return replace(layout, units={name: unit for name, unit in zip(layout.names, words) if unit.strip("-")})


def _with_comma(layout, rows):
    """The layout with decimal commas, where fields have them and none has a point."""
    if layout.delimiter in (",", ""):
        return layout
    values = [each for line in rows for each in _fields(line, layout.delimiter)]
    commas = sum(bool(_DECIMAL_COMMA.fullmatch(each)) for each in values)
    points = sum("." in each and bool(_NUMBER.fullmatch(each)) for each in values)
    if not commas or points:
        return layout
    notes = (*layout.notes, "numbers are written with decimal commas")
    return replace(layout, decimal_comma=True, notes=notes)
