"""Tables in FITS files. Every size that a header declares is held against the file before astropy allocates it."""

import re
import warnings
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from typing import Any

import numpy as np

from vsh.io.tables._source import TableSource, as_table_error, number_twins, unpack_file
from vsh.tools.errors import TableError, first_line
from vsh.tools.parallel import thread_count
from vsh.tools.types import PathName

_BLOCK, _CARD = 2880, 80
_BYTES_BY_CODE = {"L": 1, "B": 1, "I": 2, "J": 4, "K": 8, "A": 1, "E": 4, "D": 8, "C": 8, "M": 16, "P": 8, "Q": 16}
_CODE = re.compile(r"\s*(\d*)([LXBIJKAEDCMPQ])")


def read_checked_headers(path: PathName, label: str) -> Any:
    """Walk through the headers of a FITS file; a list of dicts of keywords, one a unit."""
    headers = []
    with open(path, "rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        while file.tell() < size:
            header = _read_header(file, label, is_first=not headers)
            if header is None:  # blocks of nothing behind the last unit are allowed
                break
            headers.append(header)
            n_axes = header.get("NAXIS", 0)
            if not (isinstance(n_axes, int) and 0 <= n_axes <= 999):
                raise TableError(f"{label} is damaged: NAXIS = {n_axes}")
            lengths = [header.get(f"NAXIS{i + 1}", -1) for i in range(n_axes)]
            n_extra, groups = header.get("PCOUNT", 0), header.get("GCOUNT", 1)
            bits = header.get("BITPIX", 8)
            if not all(isinstance(x, int) and x >= 0 for x in (*lengths, n_extra, groups)) or not isinstance(bits, int):
                raise TableError(f"{label} is damaged: a header declares sizes of {lengths}")
            n_elements = int(np.prod([int(x) for x in lengths], dtype=object)) if n_axes else 0
            extent = abs(bits) // 8 * groups * (n_extra + n_elements) if n_axes else 0
            start = file.tell()
            if extent > size - start:
                raise TableError(
                    f"{label} is truncated or damaged: a header declares {extent} bytes where {size - start} are left. "
                    "Fetch it again"
                )
            if header.get("XTENSION") == "BINTABLE":
                _check_row_width(header, lengths, label)
            padded_size = -(-extent // _BLOCK) * _BLOCK
            file.seek(start + extent)
            padding = file.read(min(padded_size - extent, size - start - extent))
            if padding.strip(b"\x00 "):
                raise TableError(f"{label} is damaged: there are data behind the last of the declared rows")
            file.seek(start + padded_size)
    if not headers:
        raise TableError(f"{label} is empty")
    return headers


def _read_header(file, label, is_first):
    header, n_cards = {}, 0
    start = file.tell()
    while True:
        block = file.read(_BLOCK)
        if not block.strip(b"\x00") and not header and not is_first:
            return None
        for k in range(0, len(block), _CARD):
            card = block[k : k + _CARD]
            keyword = card[:8].strip().decode("latin-1")
            if not n_cards and keyword not in ("SIMPLE", "XTENSION"):
                raise TableError(f"{label} is damaged or not FITS: a header begins with {keyword!r} at byte {start}")
            n_cards += 1
            if keyword == "END" and not card[3:].strip():
                return header
            if card[8:10] == b"= ":
                header.setdefault(keyword, _parse_header_value(card[10:].decode("latin-1")))
        if len(block) < _BLOCK or n_cards > 200_000:
            raise TableError(f"{label} is truncated or damaged: the header at byte {start} does not end")


def _parse_header_value(value_text):
    value_text = value_text.strip()
    if value_text.startswith("'"):
        quoted = re.match(r"'((?:[^']|'')*)'", value_text)
        return quoted.group(1).replace("''", "'").rstrip() if quoted else value_text
    token = value_text.split("/")[0].strip()
    try:
        return int(token)
    except ValueError:
        return token


def _check_row_width(header, lengths, label):
    """Raise TableError unless the columns of a binary table make up its rows."""
    if header.get("BITPIX") != 8 or len(lengths) != 2:
        raise TableError(f"{label} is damaged: its table is not made of bytes in rows")
    row_width, n_fields = 0, header.get("TFIELDS", 0)
    for i in range(1, (n_fields if isinstance(n_fields, int) else 0) + 1):
        match = _CODE.match(str(header.get(f"TFORM{i}", "")))
        if match is None:
            raise TableError(f"{label} is damaged: column {i} has the format {header.get(f'TFORM{i}')!r}")
        repeat = int(match.group(1) or 1)
        row_width += -(-repeat // 8) if match.group(2) == "X" else repeat * _BYTES_BY_CODE[match.group(2)]
    if row_width != lengths[0]:
        raise TableError(f"{label} is damaged: its columns take {row_width} bytes, its rows {lengths[0]}")


def count_fits_rows(path: PathName, label: str) -> int:
    """Count the rows of the first table of a FITS file, once the file is known to be complete."""
    for header in read_checked_headers(path, label):
        if header.get("XTENSION") in ("BINTABLE", "TABLE"):
            return int(header["NAXIS2"])
    raise TableError(f"{label} holds no table")


#: What astropy says of a file that is not as it was written.
_DAMAGE = re.compile(r"truncat|checksum|datasum|corrupt|invalid|illegal|extra bytes", re.IGNORECASE)


def open_fits(path: PathName, label: str, table: str | None = None) -> TableSource:
    """A table of a FITS file, packed with gzip or not: the first, or that of a number from 1 or of a name (EXTNAME)."""
    unpacked_file = unpack_file(path, label)
    headers = read_checked_headers(unpacked_file.name, label)
    numbers = [number for number, header in enumerate(headers) if header.get("XTENSION") in ("BINTABLE", "TABLE")]
    if not numbers:
        raise TableError(f"{label} holds no table")
    table_names = [str(headers[number].get("EXTNAME", "")).strip() for number in numbers]
    identifiers = [[str(k), name.lower()] for k, name in enumerate(table_names, 1)]
    matching = [k for k, table_words in enumerate(identifiers) if table is None or table.lower() in table_words]
    listing = ", ".join(f"#{k}" + f" ({name})" * bool(name) for k, name in enumerate(table_names, 1))
    if not matching:
        raise TableError(f"{label}: there is no such table; the file holds {listing}")
    extension = numbers[matching[0]]
    header = headers[extension]
    names, twins = number_twins([str(header.get(f"TTYPE{i}", "")) for i in range(1, int(header.get("TFIELDS", 0)) + 1)])
    with _wrap_read_errors(label), _open_hdus(unpacked_file.name, extension, names if twins else ()) as hdus:
        columns, cards = list(hdus[extension].columns), hdus[extension].header
        meta = _select_metadata(cards)
        descriptions = {c.name: str(cards[f"TCOMM{i}"]) for i, c in enumerate(columns, 1) if f"TCOMM{i}" in cards}
    definitions = {column.name: column for column in columns}
    names = [column.name for column in columns]
    if not names or not all(names):
        raise TableError(f"{label} is damaged: {'its table has no columns' if not names else 'a column has no name'}")

    def read(request, max_rows):
        # `unpacked_file` is kept by this function: the unpacked copy goes when nobody reads it any more.
        with _wrap_read_errors(label):
            hdus = _open_hdus(unpacked_file.name, extension, names if twins else ())
        with hdus:
            for start in range(0, max(1, headers[extension]["NAXIS2"]), max_rows):
                with _wrap_read_errors(label):
                    if hdus[extension].data is None:
                        raise TableError(f"{label} is damaged: its table holds no data")
                    chunk = hdus[extension].data[start : start + max_rows]
                    # Views of the file's bytes, one after the other; turned into numbers side by side.
                    views = [np.asarray(chunk[name]) for name in request]
                    fields = [definitions[name] for name in request]
                    with ThreadPoolExecutor(thread_count()) as pool:
                        block = dict(zip(request, pool.map(partial(_convert_view, chunk), views, fields), strict=True))
                    del chunk, views
                    for column in hdus[extension].columns:  # or astropy copies them all when the file is closed
                        column.array = None
                yield block

    notes: tuple[str, ...] = ()
    n_alike = sum(
        [headers[number].get(f"TTYPE{i}") for i in range(1, headers[number].get("TFIELDS", 0) + 1)] == names
        for number in numbers
    )
    if n_alike > 1 and table is None:
        raise TableError(
            f"{label} holds {n_alike} tables with the same columns, of one source each perhaps: join them "
            "(astropy.table.vstack), or write a file for each into a folder"
        )
    others = f"; the file holds {len(numbers)} tables, {listing}: {label}#2 is the second" if len(numbers) > 1 else ""
    if others and table is None:
        notes = (f"{label} holds {len(numbers)} tables; the first was read (extension {extension})",)
    # Rows in one block are at most as many as the file holds, whose size has been looked at.
    units = {c.name: c.unit for c in columns if c.unit and c.unit.strip()}
    n_rows = max(1, headers[extension]["NAXIS2"])  # the file holds as many: `read_checked_headers` has looked
    others = "" if table else others
    return TableSource(label, tuple(names), read, units, meta, notes, n_rows, descriptions, twins=twins, others=others)


@contextmanager
def _wrap_read_errors(label):
    """Whatever goes wrong within, and whatever astropy says of damage, is a TableError."""
    with warnings.catch_warnings(record=True) as warning_records, as_table_error(f"{label} cannot be read as FITS"):
        warnings.simplefilter("always")
        yield
    for warning in warning_records:
        if _DAMAGE.search(str(warning.message)):
            raise TableError(f"{label} is damaged: {first_line(warning.message)}. Fetch it again")


def _open_hdus(path, extension, column_names):
    """Open the units of a file; where astropy could not tell its columns apart, they have other names."""
    from astropy.io import fits

    hdus = fits.open(path, memmap=True, checksum=True)
    for i, name in enumerate(column_names, 1):
        hdus[extension].header[f"TTYPE{i}"] = name
    return hdus


def _convert_view(chunk, values, column):
    """Convert values to native byte order, and find the mask of what is null."""
    values = np.array(values, dtype=values.dtype.newbyteorder("=") if values.dtype.kind in "iufc" else None)
    if values.dtype.kind in "SU":
        values = np.char.rstrip(values)
        return values, values == values.dtype.type() if values.ndim == 1 else None
    mask = None  # a nan stays one: what is not finite is counted apart from what is null
    if column.null not in (None, "") and values.ndim == 1:
        # The null is what the file holds, before scale and zero point.
        raw_values = chunk.view(np.ndarray)[column.name]
        mask = raw_values == column.null if raw_values.dtype.kind in "iu" else _find_text_nulls(raw_values, column.null)
    return values, mask


def _find_text_nulls(raw_values, null):
    """Find the null values of text columns: a word or blanks."""
    if raw_values.dtype.kind != "S":
        return np.zeros(len(raw_values), bool)
    stripped = np.char.strip(raw_values)
    return (stripped == str(null).strip().encode()) | (stripped == b"")


def _select_metadata(header):
    structural_key = re.compile(
        r"(XTENSION|BITPIX|NAXIS\d*|PCOUNT|GCOUNT|TFIELDS|EXTNAME|CHECKSUM|DATASUM|T(TYPE|FORM|UNIT|NULL|SCAL|ZERO|DISP|DIM|BCOL)\d+)$"
    )
    return {keyword: value for keyword, value in header.items() if keyword and not structural_key.match(keyword)}


@contextmanager
def open_checked_fits(path: PathName, label: str) -> Iterator[str]:
    """The name of a FITS file, unpacked where it was packed, whose layout has been checked."""
    try:
        unpacked_file = unpack_file(path, label)
        read_checked_headers(unpacked_file.name, label)
    except OSError as error:
        raise TableError(f"{label} cannot be read: {error.strerror or error}") from error
    yield unpacked_file.name
