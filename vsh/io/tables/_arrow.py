"""Parquet files, folders of them, and everything that gives itself as an Arrow stream."""

import json
import os
import re
from codecs import getincrementaldecoder
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, closing
from typing import Any

import numpy as np

from vsh.io.tables._source import FRAME_KEY, TableSource, as_table_error, join_blocks, number_twins, unpack_file
from vsh.tools.errors import TableError
from vsh.tools.files import check_unpacked_size
from vsh.tools.printing import printable
from vsh.tools.types import PathName


def open_parquet(paths: PathName | Sequence[PathName], label: str) -> TableSource:
    """A Parquet file, or files with the same columns as one table."""
    _, dataset_module = _import_pyarrow(label)
    if isinstance(paths, (str, os.PathLike)):
        return _open_parquet_file(paths, label)
    with as_table_error(f"{label} cannot be read as Parquet"):
        options = dataset_module.ParquetFragmentScanOptions(page_checksum_verification=True)
        file_format = dataset_module.ParquetFileFormat(default_fragment_scan_options=options)
        dataset = dataset_module.dataset([str(path) for path in paths], format=file_format)
    return open_dataset(dataset, label, batch_readahead=1, fragment_readahead=1)


def _open_parquet_file(path, label):
    """Open a file; a dataset of it would take twice as long."""
    from pyarrow.parquet import ParquetFile

    with as_table_error(f"{label} cannot be read as Parquet"):
        unpacked = unpack_file(path, label)

    def open_file(footer=None):  # which keeps an unpacked copy for as long as it is read
        return ParquetFile(str(unpacked.name), metadata=footer, page_checksum_verification=True)

    with as_table_error(f"{label} cannot be read as Parquet"), open_file() as file:
        schema, footer = file.schema_arrow, file.metadata
    check_unpacked_size(label, 8 * footer.num_rows * min(len(schema.names), _FEWEST), os.path.getsize(unpacked.name))

    def read_batches(names, max_rows):
        with open_file(footer) as file:
            yield from file.iter_batches(max_rows, columns=list(names))

    return _make_table_source(label, schema, read_batches)


def open_parquet_at(filesystem: Any, path: str, label: str) -> TableSource:
    """A Parquet file of a pyarrow filesystem: of the columns that are expected, the byte ranges are fetched."""
    from pyarrow.parquet import ParquetFile

    def open_remote_file(footer=None):
        stream = filesystem.open_input_file(path)
        return ParquetFile(stream, metadata=footer, page_checksum_verification=True, pre_buffer=True)

    with as_table_error(f"{label} cannot be read as Parquet"):  # errors of Arrow, or of the library for the server
        file = open_remote_file()
        schema, footer = file.schema_arrow, file.metadata
        file.close(force=True)

    def read_batches(names, max_rows):
        file = open_remote_file(footer)
        try:
            with as_table_error(f"{label} cannot be read", ". Start again: it is fetched again"):
                yield from file.iter_batches(min(max_rows, 2**20), columns=list(names))
        finally:
            file.close(force=True)

    return _make_table_source(label, schema, read_batches)


def _check_fragments_alike(dataset, label):
    """Raise TableError where a file has other columns, kinds of numbers or units than the first."""
    reference = None
    for fragment in dataset.get_fragments():
        with as_table_error(f"{label} cannot be read as Parquet"):
            schema = fragment.physical_schema
        units = {name: str(unit) for name, unit in _read_schema_metadata(schema)[0].items()}
        columns = {field.name: (str(field.type), units.get(field.name)) for field in schema}
        reference = reference or (fragment, columns)
        differing = [name for name in {**reference[1], **columns} if columns.get(name) != reference[1].get(name)]
        differing = [name for name in differing if not name.endswith(".mask")]  # astropy writes it where it has one
        if differing:
            name = differing[0]
            form, other_form = (
                " in ".join(filter(None, type_and_unit)) if (type_and_unit := named_columns.get(name)) else "missing"
                for named_columns in (reference[1], columns)
            )
            raise TableError(
                f"{label}: its files differ in {', '.join(map(printable, differing[:5]))}: {printable(name)} is {form} "
                f"in {printable(_name_file(reference[0]))} and {other_form} in {printable(_name_file(fragment))}"
            )


def _name_file(fragment):
    return os.path.basename(getattr(fragment, "path", "") or "a part")


def open_dataset(dataset: Any, label: str, **options: Any) -> TableSource:
    """A pyarrow Dataset, wherever its files lie."""
    _check_fragments_alike(dataset, label)

    def read_batches(names, max_rows):
        return dataset.to_batches(columns=list(names), batch_size=min(max_rows, 2**17), **options)

    return _make_table_source(label, dataset.schema, read_batches)


def open_lazyframe(frame: Any, label: str) -> TableSource:
    """A LazyFrame of polars: what is expected of it is collected when it is."""
    _import_pyarrow(label)  # polars's own way to it, for pyarrow before 16 does not know polars
    with as_table_error(f"{label} cannot be collected"):  # whatever a plan that cannot be carried out raises
        frame.collect_schema()
        empty_table = frame.head(0).collect().to_arrow()

    def read_batches(names, max_rows):
        with as_table_error(f"{label} cannot be collected"):
            table = frame.select(list(names)).collect().to_arrow()
        return table.to_batches(max_chunksize=min(max_rows, 2**20))

    return _make_table_source(label, empty_table.schema, read_batches)


def open_stream(table: Any, label: str) -> TableSource:
    """An object with `__arrow_c_stream__` or `__arrow_c_array__`: of pyarrow, polars, DuckDB, …"""
    arrow, _ = _import_pyarrow(label)
    reader = _open_batch_reader(arrow, table, label)
    unread_readers = [reader]

    def read_batches(names, max_rows):
        # A table gives as many streams as are asked for; what streams once gives the one that is open.
        batch_reader = unread_readers.pop() if unread_readers else _open_batch_reader(arrow, table, label)
        for batch in batch_reader:
            yield batch.select(list(names))

    return _make_table_source(label, reader.schema, read_batches)


def _open_batch_reader(arrow, table, label):
    error_types = (arrow.ArrowException, ValueError, TypeError)
    with as_table_error(f"{label} is no table, or its stream was read before", kinds=error_types):
        if hasattr(table, "__arrow_c_stream__"):
            return arrow.RecordBatchReader.from_stream(table)
        batch = arrow.record_batch(table)
        return arrow.RecordBatchReader.from_batches(batch.schema, [batch])


def _import_pyarrow(label):
    try:
        import pyarrow
        import pyarrow.dataset
    except ImportError as error:
        raise TableError(
            f"{label} needs pyarrow. Install what is missing: pip install 'vsh-astrometry[parquet]' ({error})"
        ) from error
    return pyarrow, pyarrow.dataset


#: Columns that a catalogue has at least.
_FEWEST = 6


def _make_table_source(label, schema, read_batches):
    if twins := number_twins(schema.names)[1]:
        raise TableError(f"{label}: several columns are called {', '.join(map(repr, sorted(twins)))}")

    def read(names, max_rows):
        buffer, n_buffered, has_yielded_none = [], 0, True
        for batch in _yield_with_read_errors(read_batches(names, max_rows), label):
            while batch.num_rows:
                n_taken = min(max_rows - n_buffered, batch.num_rows)
                buffer.append(batch.slice(0, n_taken))
                n_buffered += n_taken
                batch = batch.slice(n_taken)
                if n_buffered == max_rows:
                    yield _convert_batches_to_columns(buffer, names, label)
                    buffer, n_buffered, has_yielded_none = [], 0, False
        if buffer or has_yielded_none:
            yield _convert_batches_to_columns(buffer, names, label)

    units, meta, descriptions = _read_schema_metadata(schema)
    return TableSource(label, tuple(schema.names), read, units, meta, descriptions=descriptions)


def _yield_with_read_errors(batches, label):
    with as_table_error(f"{label} cannot be read as Parquet"):
        yield from batches


def _convert_batches_to_columns(batches, names, label):
    if not batches:
        return {name: (np.empty(0), None) for name in names}
    return {name: join_blocks([_convert_array(batch.column(name), name, label) for batch in batches]) for name in names}


def _convert_array(array, name, label):
    """Convert an Arrow array to values, and a mask where some are missing; integers with missing ones stay integers."""
    import pyarrow as pa
    from pyarrow import types

    if isinstance(array, pa.ExtensionArray):
        array = array.storage
    if types.is_dictionary(array.type):
        array = array.dictionary_decode()
    mask = array.is_null().to_numpy(zero_copy_only=False) if array.null_count else None
    if types.is_null(array.type):
        return np.full(len(array), np.nan), mask
    if types.is_decimal(array.type):
        array = array.cast(pa.float64())
    with as_table_error(f"{label}: column {name!r} cannot be read", kinds=(pa.ArrowException, ValueError)):
        if types.is_integer(array.type):
            return array.fill_null(0).to_numpy(zero_copy_only=False), mask
        if types.is_boolean(array.type):
            return array.fill_null(False).to_numpy(zero_copy_only=False), mask
        if str(array.type) == "string_view":  # which fill_null does not know
            array = array.cast(pa.large_string())
        if types.is_string(array.type) or types.is_large_string(array.type):
            return np.array(array.fill_null("").to_pylist(), dtype=str), mask
        return array.to_numpy(zero_copy_only=False), mask


def _read_schema_metadata(schema):
    """Read units by column, metadata and descriptions, as astropy or the fields themselves have them."""
    units, descriptions = {}, {}
    for field in schema:
        for key in (b"unit", b"units"):
            if field.metadata and field.metadata.get(key):
                units[field.name] = field.metadata[key].decode("utf-8", "replace")
        if field.metadata and field.metadata.get(b"description"):
            descriptions[field.name] = field.metadata[b"description"].decode("utf-8", "replace")
    table_yaml = (schema.metadata or {}).get(b"table_meta_yaml")
    if not table_yaml:
        meta = _read_pandas_attributes(schema)
        return dict(meta.pop("units", {})) | units, meta, descriptions
    from astropy.table.meta import get_header_from_yaml

    with as_table_error("the metadata that astropy wrote are damaged"):
        header = get_header_from_yaml(re.split("\n", table_yaml.decode()))
        units |= {column["name"]: column["unit"] for column in header["datatype"] if "unit" in column}
        descriptions |= {
            column["name"]: str(column["description"]) for column in header["datatype"] if column.get("description")
        }
        return units, dict(header.get("meta") or {}), descriptions


def _read_pandas_attributes(schema):
    """Read the attributes of the DataFrame that a schema is made from, and a frame that stands there by itself."""
    metadata = schema.metadata or {}
    with as_table_error("the metadata that pandas wrote are damaged", kinds=(ValueError,)):
        attributes = dict(json.loads(metadata.get(b"PANDAS_ATTRS") or b"{}"))  # as pandas 2 has them
        attributes |= json.loads(metadata.get(b"pandas") or b"{}").get("attributes") or {}
    frame = metadata.get(FRAME_KEY.encode())
    return attributes | ({FRAME_KEY: frame.decode("utf-8", "replace")} if frame else {})


class NotPlain(Exception):
    """The rest of a table of text is more than rows of fields between delimiters, or is damaged."""


#: What Arrow reads of a table of text before it decides on types. [bytes]
_CSV_BLOCK = 2**24
#: From here on a double does not tell neighbouring integers apart.
_EXACT = 2.0**53
#: A field that is expected is a number or a name. [characters]
FIELD = 1000
#: What stands for a missing value; Gaia's archive writes null.
NULLS = ("", "null", "NULL", "--")


def read_csv_blocks(
    open_file: Callable[[], Any], layout: Any, dtypes: Mapping[str, str], wanted_names: Sequence[str], max_rows: int
) -> Iterator[dict[str, Any]]:
    """Rows of a table of text in blocks, four times as fast as line by line: masked numbers, or text.

    Raises
    ------
    NotPlain
        Where pyarrow is missing, or a row is not what the first ones are: whoever reads line by line says what it is.
    """
    try:
        import pyarrow as pa
        from pyarrow import csv
    except ImportError:
        raise NotPlain from None
    textual: set[str] = {name for name, datatype in dtypes.items() if not datatype.startswith(("int", "uint", "float"))}
    numeric = {name: pa.float64() if datatype.startswith("float") else pa.int64() for name, datatype in dtypes.items()}
    plain_types = (pa.int64(), pa.float64(), pa.string(), pa.null())
    try:
        with ExitStack() as files:
            while True:
                file = files.enter_context(closing(_CheckedTextStream(open_file(), layout.delimiter)))
                conversion = csv.ConvertOptions(
                    include_columns=list(wanted_names), null_values=list(NULLS), true_values=[], false_values=[],
                    column_types=numeric | dict.fromkeys(textual, pa.string()),
                )  # fmt: skip
                reading = csv.ReadOptions(column_names=layout.names, skip_rows=layout.skip, block_size=_CSV_BLOCK)
                reader = csv.open_csv(
                    pa.PythonFile(file, "r"), reading, csv.ParseOptions(delimiter=layout.delimiter), conversion
                )
                if not (time_names := {field.name for field in reader.schema if field.type not in plain_types}):
                    break
                textual |= time_names  # times, which are text to us
            batches: list[Any] = []
            for batch in reader:
                batches.append(batch)
                while sum(map(len, batches)) >= max_rows:
                    table = pa.Table.from_batches(batches)
                    yield _convert_columns_to_arrays(table.slice(0, max_rows), pa)
                    batches = table.slice(max_rows).to_batches()
            if any(map(len, batches)):
                yield _convert_columns_to_arrays(pa.Table.from_batches(batches), pa)
    except (pa.ArrowException, UnicodeDecodeError, OSError, EOFError) as error:
        raise NotPlain from error


class _CheckedTextStream:
    """A file whose bytes are UTF-8 as far as they are read, or UnicodeDecodeError; NotPlain where a number has a plus.

    Arrow takes an integer with a plus for a fraction.
    """

    closed = False

    def __init__(self, file: Any, delimiter: str) -> None:
        self.file, self.decoder, self.last_byte = file, getincrementaldecoder("utf-8")(), b"\n"
        self.plus_patterns = (delimiter.encode() + b"+", b"\n+")

    def read(self, n_bytes: int = -1) -> bytes:
        """Some bytes more."""
        chunk: bytes = self.file.read(n_bytes)
        self.decoder.decode(chunk, final=not chunk)
        if any(plus in self.last_byte + chunk for plus in self.plus_patterns):
            raise NotPlain
        self.last_byte = chunk[-1:]
        return chunk

    def close(self) -> None:
        """Close the file."""
        self.file.close()


def _convert_columns_to_arrays(table, pa):
    arrays = {}
    for name in table.column_names:
        column = table.column(name)
        if pa.types.is_string(column.type):
            values = column.to_numpy().astype(str)
            if values.dtype.itemsize > 4 * FIELD:
                raise NotPlain
            arrays[name] = values
            continue
        mask = column.is_null().to_numpy()
        if pa.types.is_null(column.type):
            arrays[name] = np.ma.MaskedArray(np.zeros(len(column)), mask)
            continue
        values = column.fill_null(0).to_numpy()
        if values.dtype.kind == "f":
            # Perhaps integers of more digits than a double has, or too long for one.
            is_large = np.abs(values) >= _EXACT
            if np.isinf(values).any() or (is_large.any() and (values == np.rint(values)).all()):
                raise NotPlain
        arrays[name] = np.ma.MaskedArray(values, mask)
    return arrays
