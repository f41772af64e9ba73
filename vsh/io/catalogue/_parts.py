"""Catalogues that are read and summed in parts: folders, files, partitions of LSDB and Dask, streams."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from vsh.field import Field
from vsh.io.catalogue._columns import as_columns
from vsh.io.catalogue._names import ColumnRequest, Columns, find_derivable_columns, list_candidates
from vsh.io.catalogue._read import add_zero_motions, stream_fields
from vsh.io.columns import REQUIRED
from vsh.io.parts import Dask, Engine, InProcess, Parts, Processes, delay_partitions, is_delayed
from vsh.io.tables import RemotePath, TableSource, Where, check_layout, files_of, fingerprint_of, is_address, open_table
from vsh.tools.arguments import whole
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.files import check_unchanged, file_stamp
from vsh.tools.types import OnBad

#: Sources in a block of a part: some 200 MB while it is read and checked.
ROWS = 500_000
#: Files at an address that are opened and begun together: a server answers late, and sends several at once.
_READERS = 4


def parts(
    source: Any,
    *,
    columns: Columns | Mapping[str, str] | str | None = None,
    units: Mapping[str, Any] | None = None,
    on_bad: OnBad = "raise",
    frame: str | None = None,
    rows: int = ROWS,
    motions: bool = True,
    sigma: float | None = None,
    workers: int | None = None,
    scheduler: str | None = None,
    where: str | None = None,
    format: str | None = None,
) -> Parts:
    """A catalogue of any size in parts, which are read and summed where they are.

    Parameters
    ----------
    source : path, LSDB Catalog, Dask DataFrame, Arrow stream, DataFrame, Field, or a list
        A file; a folder of files, or a catalogue in HATS format, of which every file is a part; a collection with
        `to_delayed()` (LSDB's, also after a cone or a join, and Dask's), of which every partition is one; anything
        that `read_field` takes; or a list of paths, tables, Fields or delayed objects of Dask.
    columns, units, on_bad, frame, where, format
        As for `read_field`. Name, magnitude and redshift are read where a step or a sum wants them.
    rows : int
        The largest number of sources in a block. While a block is summed, the next block of the same part is read, and
        in this process also the first block of the next part (of the next four parts at an address); all of these are
        in memory.
    motions : bool
        Whether there must be motions and errors: false for skies of which only positions, or errors, matter.
    sigma : float, optional
        One error for all motions, in place of the table's. [µas/yr]
    workers : int, optional
        Number of processes on this machine. Default: one process with a thread for each core.
    scheduler : str, optional
        Address of a scheduler of Dask, or the path of its scheduler file. Files must lie where its workers see them.

    Returns
    -------
    Parts
        Every function that takes a stream of Fields accepts it; `fit.normal_equations(parts, modes)` runs where the
        parts are, and ``parts.map(lambda field: field[field.magnitude < 20])`` chooses from them. What Dask's
        collections hold is summed by the client that is open, or by threads of this process.

    Raises
    ------
    TableError
        If there is no such file or folder, or a column is missing from a collection.
    ParameterError
        If the source is a stream that can be read only once.

    Examples
    --------
    >>> table = {"ra": [10.0, 200.0], "dec": [-20.0, 5.0], "pmra": [0.1, 0.0], "pmdec": [0.2, 0.1],
    ...          "pmra_error": [0.05, 0.1], "pmdec_error": [0.05, 0.1]}
    >>> parts([table, table]).sum(len)
    4
    """
    request = as_columns(columns)
    if workers is not None and scheduler is not None:
        raise ParameterError("workers are processes of this machine, a scheduler has its own: give one of the two")
    if where is not None:
        Where(where)  # its mistakes before anything is read
    reader = Reader(request, units, on_bad, frame, whole("rows", rows), motions, sigma, where=where, format=format)
    pieces = _split(source, request, motions, format, where)
    files = [piece for piece in pieces if isinstance(piece, (Path, RemotePath))]
    paths = {str(file.resolve()) if isinstance(file, Path) else file.path for file in files}
    if len(paths) < len(files):
        raise ParameterError(f"{len(files) - len(paths)} of the parts are files that stand there twice")
    if len(files) > 1:
        first_table = open_table(files[0], format)
        reader = replace(reader, first_layout=(first_table.label, _find_table_layout(first_table, request)))
    stamps = {_get_file_name(file): _get_file_stamp(file) for file in files}
    return Parts(pieces, replace(reader, records=stamps), engine=_choose_engine(pieces, workers, scheduler))


@dataclass(frozen=True)
class Reader:
    """Reader of the fields of a piece, a block of sources at a time."""

    columns: ColumnRequest
    units: Mapping[str, Any] | None
    on_bad: OnBad
    frame: str | None
    rows: int
    motions: bool = True
    sigma: float | None = None
    first_layout: tuple[str, Any] | None = None
    where: str | None = None
    format: str | None = None
    #: By what each file is known, when it was opened first.
    records: Mapping[str, tuple[Any, ...]] = field(default_factory=dict)

    def __call__(self, piece: Any, roles: tuple[str, ...]) -> Iterator[Field]:
        """The fields of a piece."""
        if isinstance(piece, Field):
            yield piece
            return
        columns, file = self.columns, piece if isinstance(piece, (Path, RemotePath)) else None
        if isinstance(file, Path):
            self._check_unchanged(file)
        if isinstance(piece, (str, os.PathLike, RemotePath)):
            piece = open_table(piece, self.format)
        if self.first_layout is not None and isinstance(piece, TableSource):
            _check_same_columns(piece, columns, *self.first_layout)
        notes: tuple[str, ...] = ()
        if not self.motions:
            piece, position_columns, notes = add_zero_motions(open_table(piece), columns, self.sigma)
        options = {name: getattr(self, name) for name in ("units", "on_bad", "frame", "where")}
        options |= {"columns": columns, "sigma": self.sigma} if self.motions else {"columns": position_columns}
        for block_field in stream_fields(piece, self.rows, roles=roles, **options):
            yield block_field.add_note(*notes) if notes else block_field
        if file is not None:
            self._check_unchanged(file)

    def _check_unchanged(self, file):
        if (name := _get_file_name(file)) in self.records:
            check_unchanged(name, self.records[name], _get_file_stamp(file))


def _get_file_name(file):
    return file.label if isinstance(file, RemotePath) else str(file)


def _get_file_stamp(file):
    return fingerprint_of(file) if isinstance(file, RemotePath) else file_stamp(file)


def _find_table_layout(table, request):
    """Columns that a table has, and their units."""
    return _find_used_units(tuple(table.names), tuple((name, str(unit)) for name, unit in table.units.items()), request)


@lru_cache
def _find_used_units(names, units, request):
    column_units, present_set, derived = dict(units), set(names), find_derivable_columns(names)
    resolved_columns, _ = request.choose_names((*names, *derived))
    column_names = [name for names in vars(resolved_columns).values() for name in list_candidates(names)]
    column_names += [name for derived_name in derived if derived_name in column_names for name in derived[derived_name]]
    return {name: column_units.get(name, "None") for name in column_names if name in present_set}


def _check_same_columns(table, request, label, layout):
    """Raise TableError unless a file has the columns of the first, and no others that a field would use."""
    check_layout(table, label, layout)
    unshared_names = [name for name in _find_table_layout(table, request) if name not in layout]
    if unshared_names:
        raise TableError(f"{label} has no column {', '.join(unshared_names)}, which {table.label} has")


def _choose_engine(pieces, workers, scheduler) -> Engine:
    if scheduler is not None:
        return Dask(str(scheduler))
    if any(map(is_delayed, pieces)):
        return Dask(None, None if workers is None else whole("workers", workers))
    if workers is not None and whole("workers", workers) > 1:
        return Processes(workers)
    if len(pieces) > 1 and all(isinstance(piece, (Path, RemotePath)) for piece in pieces):
        return InProcess(_READERS if isinstance(pieces[0], RemotePath) else 1)
    return InProcess()


def _split(source, request, motions, format, condition):
    """Pieces that the parts are read from, a tuple."""
    if isinstance(source, (str, os.PathLike)) or is_address(source):
        return tuple(files_of(source, format))
    if isinstance(source, Parts):
        raise ParameterError("this is a catalogue in parts already")
    if hasattr(type(source), "to_delayed"):
        return tuple(_select_partitions(source, request, motions, condition))
    if isinstance(source, list | tuple) and source:
        return tuple(
            piece
            for element in source
            for piece in (_split(element, request, motions, format, condition) if _has_parts(element) else (element,))
        )
    if isinstance(source, list | tuple):
        raise ParameterError("the list of parts is empty")
    if hasattr(type(source), "__next__") and not hasattr(type(source), "__arrow_c_stream__"):
        raise ParameterError(
            "what can be read only once is no catalogue in parts: give a list, or fit.normal_equations the stream"
        )
    if hasattr(type(source), "__next__"):
        return (SingleUseStream(source),)
    return (source,)


class SingleUseStream:
    """A stream that can be read once, and says so when it is asked again."""

    def __init__(self, stream: Any) -> None:
        self.stream: Any = stream

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        if self.stream is None:
            raise TableError("it can be read only once, and this needs several passes: give a table or files")
        stream, self.stream = self.stream, None
        return stream.__arrow_c_stream__(requested_schema)


def _has_parts(source):
    return isinstance(source, (str, os.PathLike)) or is_address(source) or hasattr(type(source), "to_delayed")


def _select_partitions(collection, request, motions, condition):
    """The partitions of a collection with the columns that a field can use, so that nothing else is read."""
    names = tuple(map(str, getattr(collection, "columns", ())))
    if not names:
        return collection.to_delayed()
    derived_columns = find_derivable_columns(names)
    resolved_columns, _ = request.choose_names((*names, *derived_columns))
    column_names = [name for name in (() if condition is None else Where(condition).names) if name in names]
    for role in Columns.__dataclass_fields__:
        candidates = getattr(resolved_columns, role)
        present = [name for name in list_candidates(candidates) if name in names or name in derived_columns]
        if role in (REQUIRED if motions else REQUIRED[:2]) and not present:
            raise TableError(
                f"the {type(collection).__name__} has no column {candidates!r} for {role}: it has {', '.join(names)}"
            )
        column_names += [name for column in present[:1] for name in derived_columns.get(column, (column,))]
    return delay_partitions(collection, column_names)
