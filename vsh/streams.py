"""Tables too large for memory: FITS and Parquet in blocks of rows."""

from pathlib import Path

import numpy as np
from astropy.io import fits
from astropy.table import MaskedColumn, Table
from astropy.table.meta import get_header_from_yaml

from vsh.errors import TableError


def iter_tables(path, rows):
    """Yield a table of at most `rows` rows at a time.

    Parameters
    ----------
    path : str or Path — a FITS file, a Parquet file, or a folder of Parquet files
    rows : int

    Yields
    ------
    astropy.table.Table

    Raises
    ------
    TableError
        If the path is neither, or damaged; or a collection that counts sources twice.
    """
    path = Path(path)
    if rows < 1:
        raise TableError(f"rows must be at least 1, not {rows}")
    if not path.exists():
        raise TableError(f"{path}: no such file or folder")
    suffixes = [suffix.lower() for suffix in path.suffixes if suffix.lower() != ".gz"]
    if path.is_dir() or suffixes[-1:] in ([".parquet"], [".pq"]):
        return _parquet_blocks(path, rows)
    if suffixes[-1:] in ([".fits"], [".fit"]):
        return _fits_blocks(path, rows)
    raise TableError(f"{path}: only FITS and Parquet can be read in blocks; read the whole with read_field")


def _fits_blocks(path, rows):
    try:
        with fits.open(path, memmap=True) as hdus:
            hdu = next((hdu for hdu in hdus if isinstance(hdu, fits.BinTableHDU)), None)
            if hdu is None:
                raise TableError(f"{path} holds no table")
            for start in range(0, max(1, len(hdu.data)), rows):
                part = hdu.data[start : start + rows]
                yield Table({column.name: _fits_column(part, column) for column in hdu.columns})
    except (OSError, ValueError, TypeError) as error:
        raise TableError(f"{path} cannot be read as fits: {error}") from error


def _fits_column(part, column):
    values = np.array(part[column.name])  # a copy: the file's memory is not held
    mask = values == column.null if column.null not in (None, "") and values.dtype.kind in "iu" else False
    return MaskedColumn(values, mask=mask, unit=column.unit or None)


def _parquet_blocks(path, rows):
    if path.is_dir():
        if (path / "collection.properties").exists():
            raise TableError(
                f"{path} is a HATS collection, whose margin cache repeats sources: name the folder of its main catalogue"
            )
        files = sorted(f for f in path.rglob("*.parquet") if not f.name.startswith(("_", ".")))
        if not files:
            raise TableError(f"{path} holds no .parquet files")
    else:
        files = [path]
    try:
        import pyarrow.dataset as arrow
    except ImportError as error:
        raise TableError(f"Parquet needs pyarrow: pip install 'vsh-astrometry[parquet]' ({error})") from error
    try:
        dataset = arrow.dataset([str(f) for f in files], format="parquet")
        units = _parquet_units(dataset.schema.metadata or {})
        held, count = [], 0
        for batch in dataset.to_batches(batch_size=min(rows, 2**17), batch_readahead=1, fragment_readahead=1):
            while batch.num_rows:
                take = min(rows - count, batch.num_rows)
                held.append(batch.slice(0, take))
                count += take
                batch = batch.slice(take)
                if count == rows:
                    yield _arrow_table(held, units)
                    held, count = [], 0
        if held:
            yield _arrow_table(held, units)
    except (OSError, ValueError) as error:  # pyarrow's errors are ValueErrors
        raise TableError(f"{path} cannot be read as parquet: {error}") from error


def _arrow_table(batches, units):
    columns = {}
    for name in batches[0].schema.names:
        parts = [_arrow_column(batch.column(name)) for batch in batches]
        columns[name] = [np.concatenate(each) for each in zip(*parts, strict=True)]
    masks = {name: values for name, (values, _) in columns.items() if name.endswith(".mask")}
    return Table(
        {
            # astropy keeps a mask as a column of its own beside the values.
            name: MaskedColumn(values, mask=mask | masks.get(f"{name}.mask", False), unit=units.get(name))
            for name, (values, mask) in columns.items()
            if name not in masks
        }
    )


def _arrow_column(array):
    """Values and mask; integers with missing values stay integers."""
    mask = array.is_null().to_numpy(zero_copy_only=False)
    if array.null_count and array.type in _arrow_integers():
        array = array.fill_null(0)
    return array.to_numpy(zero_copy_only=False), mask


def _arrow_integers():
    import pyarrow as pa

    return {pa.int8(), pa.int16(), pa.int32(), pa.int64(), pa.uint8(), pa.uint16(), pa.uint32(), pa.uint64()}


def _parquet_units(metadata):
    """Units that astropy wrote into the file, by column."""
    text = metadata.get(b"table_meta_yaml")
    if not text:
        return {}
    header = get_header_from_yaml(text.decode().split("\n"))
    return {column["name"]: column["unit"] for column in header["datatype"] if "unit" in column}
