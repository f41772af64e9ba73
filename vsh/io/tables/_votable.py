"""VOTables, by astropy; sizes are held against the file first, and what an archive says of its query is read."""

import re
import warnings

import numpy as np

from vsh.io.tables._source import TableSource, as_table_error, unpack_file
from vsh.tools.errors import TableError, first_line
from vsh.tools.printing import printable
from vsh.tools.types import PathName

_SIZE_ATTRIBUTE = re.compile(rb"""\b(arraysize|nrows|width)\s*=\s*["']\s*([0-9][0-9x]*)""")
#: Encodings in which a byte of ASCII is itself, so that what is looked for in a file is what its parser sees.
_ASCII_ENCODINGS = ("utf-8", "utf8", "us-ascii", "ascii", "iso-8859-1", "latin-1", "latin1")
_ENCODING_DECLARATION = re.compile(rb"""\s*<\?xml\b[^>]*\bencoding\s*=\s*["']([^"']*)["']""")
#: Warnings of astropy's parser by which a value was changed or lost.
_LOSS_WARNINGS = re.compile(r"\b(E\d\d|W46|W51|W53)\b")


def open_truncated_votable(path: PathName, label: str) -> TableSource:
    """The first table of a VOTable that an archive cut off at its limit of rows, with a note."""
    return open_votable(path, label, overflow=True)


def open_votable(path: PathName, label: str, overflow: bool = False) -> TableSource:
    """The first table of a VOTable; one that was cut off by the archive where `overflow` accepts it."""
    from astropy.io import votable

    unpacked_file = unpack_file(path, label)
    _check_declarations(unpacked_file.name, label)
    wrapped_errors = as_table_error(f"{label} cannot be read as VOTable", ". It may be truncated: fetch it again")
    with warnings.catch_warnings(record=True) as warning_records, wrapped_errors:
        warnings.simplefilter("always")
        document = votable.parse(unpacked_file.name, verify="warn", invalid="mask")
        tables = list(document.iter_tables())
        statuses = [info for resource in document.resources for info in _infos(resource) if info.name == "QUERY_STATUS"]
    for warning in warning_records:
        if _LOSS_WARNINGS.search(str(warning.message)) or "truncated" in str(warning.message):
            raise TableError(f"{label} is damaged: {first_line(warning.message)}. Fetch it again")
    for info in statuses:
        if str(info.value).upper() == "OVERFLOW" and not overflow:
            raise TableError(
                f"{label} is a part of its query's result: the archive cut it off (QUERY_STATUS OVERFLOW). Ask again "
                "for more rows, or accept a part of the rows: --columns format=votable-overflow (format=)"
            )
        if str(info.value).upper() == "ERROR":
            raise TableError(f"{label} holds an archive's error, not a table: {first_line(info.content or info.value)}")
    if not tables:
        raise TableError(f"{label} holds no table")
    table = tables[0]
    names = _find_column_names(table)
    columns = dict(zip(names, table.fields, strict=True))
    alike = [other for other in tables if _find_column_names(other) == names]
    units = {name: str(column.unit) for name, column in columns.items() if column.unit is not None}
    notes: tuple[str, ...] = ()
    if len(tables) > 1:
        which_remark = "; the first was" if len(alike) == 1 else f"; {len(alike)} with the columns of the first were"
        notes = (f"{label} holds {len(tables)} tables{which_remark} read",)
    if overflow and any(str(info.value).upper() == "OVERFLOW" for info in statuses):
        notes += (f"warning: {label} has a part of the rows of its query (QUERY_STATUS OVERFLOW)",)

    def read(request, max_rows):
        for table_part in alike:
            _check_units_alike(table_part, units, label)
            fields = dict(zip(names, table_part.fields, strict=True))
            for start in range(0, max(1, len(table_part.array)), max_rows):
                chunk = table_part.array[start : start + max_rows]
                yield {name: _convert_votable_column(chunk[fields[name].ID]) for name in request}

    meta = {str(param.name): param.value for param in table.params}
    meta |= {str(info.name): info.value for info in table.infos}
    descriptions = {name: str(column.description) for name, column in columns.items() if column.description}
    systems = _find_coordinate_systems(document, columns)
    return TableSource(label, tuple(names), read, units, meta, notes, descriptions=descriptions, systems=systems)


def _find_coordinate_systems(document, columns):
    """Find the coordinate system of each column: that of its COOSYS, the only one there is, or by its UCD."""
    declared = {coosys.ID: (str(coosys.system), coosys.equinox) for coosys in document.iter_coosys()}
    only = next(iter(declared.values())) if len(declared) == 1 else None
    systems = {}
    for name, column in columns.items():
        ucd = str(column.ucd or "").lower()
        by_ucd = next((system for system in ("galactic", "ecliptic") if f"pos.{system}." in ucd), None)
        stated = declared.get(column.ref, (by_ucd, None) if by_ucd else only if "pos.eq" in ucd or not ucd else None)
        if stated and stated[0] != "None":
            systems[name] = stated
    return systems


def _find_column_names(table):
    """Find the names of the columns; their IDs where two have one name."""
    names = [column.name for column in table.fields]
    return names if len(set(names)) == len(names) else [column.ID for column in table.fields]


def _check_units_alike(table, units, label):
    """Raise TableError where a table of several has another unit than the first."""
    for name, column in zip(_find_column_names(table), table.fields, strict=True):
        first_unit, unit = units.get(name, "no unit"), "no unit" if column.unit is None else str(column.unit)
        if unit != first_unit:
            raise TableError(f"{label} holds tables with {name} in {first_unit} and in {unit}")


def _infos(resource):
    yield from resource.infos
    for table in resource.tables:
        yield from table.infos
    for subresource in resource.resources:
        yield from _infos(subresource)


def _convert_votable_column(column):
    values, mask = np.ma.getdata(column), np.ma.getmaskarray(column)
    if mask.ndim > 1:
        if values.dtype.kind == "f":  # a row may lack some of its numbers
            values = np.where(mask, np.nan, values)
        mask = np.asarray(mask.all(tuple(range(1, mask.ndim))))
    if values.dtype.kind == "f" and values.ndim == 1:
        mask = mask | np.isnan(values)
    return np.array(values), mask if mask.any() else None


def _check_declarations(path, label):
    """Raise TableError where a fixed size exceeds the file, or something would be read from elsewhere."""
    with open(path, "rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        carried_bytes, has_streams = b"", False
        while chunk := file.read(2**20):
            if not carried_bytes:
                _check_encoding(chunk, label)
            content = carried_bytes + chunk
            if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
                raise TableError(
                    f"{label} has a document type declaration, which a VOTable needs not and which may name other "
                    "files: take it out"
                )
            has_streams = has_streams or b"STREAM" in content
            for attribute, shape in _SIZE_ATTRIBUTE.findall(content):
                declared_size = 1
                for factor in shape.split(b"x"):
                    declared_size *= int(factor[:20] or 1)
                if declared_size > max(size, 1024):
                    raise TableError(
                        f"{label} is damaged: {attribute.decode()} = {shape.decode()[:30]} in a file of {size} bytes"
                    )
            carried_bytes = chunk[-512:]
    if has_streams:
        _check_streams(path, label)


def _check_encoding(first_bytes, label):
    """Raise TableError where the file is in an encoding whose bytes are not those of ASCII."""
    declaration = _ENCODING_DECLARATION.match(first_bytes.removeprefix(b"\xef\xbb\xbf"))
    name = declaration[1].decode("ascii", "replace").strip().lower() if declaration else "utf-8"
    if b"\x00" in first_bytes[:64]:
        name = "UTF-16 or UTF-32"
    if name not in _ASCII_ENCODINGS:
        raise TableError(f"{label} is in the encoding {printable(name)}: VOTables are read in UTF-8, save it so")


def _check_streams(path, label):
    """Raise TableError where a STREAM has its rows elsewhere, as the parser sees it and not by its spelling."""
    from xml.parsers import expat

    parser = expat.ParserCreate(namespace_separator=" ")

    def refuse_outside_rows(name, attributes):
        if name.rpartition(" ")[2].upper() == "STREAM" and any(
            attribute.rpartition(" ")[2].lower() == "href" for attribute in attributes
        ):
            raise TableError(
                f"{label} keeps its rows elsewhere (STREAM href), where nothing is fetched from: get a VOTable with "
                "the rows in it"
            )

    parser.StartElementHandler = refuse_outside_rows
    with as_table_error(f"{label} cannot be read as VOTable"), open(path, "rb") as file:
        parser.ParseFile(file)
