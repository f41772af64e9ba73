"""Catalogues that are read and summed in parts: folders, files, partitions of LSDB and Dask, streams."""

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import chain
from pathlib import Path
from typing import Any

from vsh.field import Field
from vsh.io.catalogue._columns import as_columns
from vsh.io.catalogue._names import REQUIRED, Columns, Request, derived_from
from vsh.io.catalogue._read import open_positions, stream_fields
from vsh.io.parts import Dask, Engine, InProcess, Parts, Processes, delayed_of, is_delayed
from vsh.io.tables import Place, TableSource, Where, check_alike, files_of, is_address, open_table
from vsh.tools.arguments import whole
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.parallel import ahead
from vsh.tools.types import OnBad

#: Sources in a block of a part: some 200 MB while it is read and checked.
ROWS = 500_000


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
        The largest number of sources in memory at a time, for each process.
    motions : bool
        Whether there must be motions and errors: false for skies of which only positions, or errors, matter.
    sigma : float, optional
        One error for all motions, in place of the table's. [µas/yr]
    workers : int, optional
        So many processes on this machine; one, with a thread a core, unless given.
    scheduler : str, optional
        Address of a scheduler of Dask, or the path of its scheduler file. Files must lie where its workers see them.

    Returns
    -------
    Parts
        All that takes a stream of Fields takes it; `fit.normal_equations(parts, modes)` runs where the parts are,
        and ``parts.map(lambda field: field[field.magnitude < 20])`` chooses from them. What Dask's collections hold is
        summed by the client that is open, or by threads of this process.

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
    wanted = as_columns(columns)
    if workers is not None and scheduler is not None:
        raise ParameterError("workers are processes of this machine, a scheduler has its own: give one of the two")
    if where is not None:
        Where(where)  # its mistakes before anything is read
    read = Reader(wanted, units, on_bad, frame, whole("rows", rows), motions, sigma, where=where, format=format)
    pieces = _pieces(source, wanted, motions, format, where)
    files = [piece for piece in pieces if isinstance(piece, (Path, Place))]
    paths = {str(file) if isinstance(file, Path) else file.path for file in files}
    if len(paths) < len(files):
        raise ParameterError(f"{len(files) - len(paths)} of the parts are files that stand there twice")
    if len(files) > 1:
        first = open_table(files[0], format)
        read = replace(read, like=(first.label, _layout(first, wanted)))
    return Parts(pieces, read, engine=_engine(pieces, workers, scheduler))


#: A part whose first block is smaller is read through without a thread that reads ahead, which costs more.
_WORTH_A_THREAD = 2**15


@dataclass(frozen=True)
class Reader:
    """Reader of the fields of a piece, a block of sources at a time."""

    columns: Request
    units: Mapping[str, Any] | None
    on_bad: OnBad
    frame: str | None
    rows: int
    motions: bool = True
    sigma: float | None = None
    like: tuple[str, Any] | None = None
    where: str | None = None
    format: str | None = None

    def __call__(self, piece: Any, roles: tuple[str, ...]) -> Iterator[Field]:
        """The fields of a piece."""
        if isinstance(piece, Field):
            yield piece
            return
        columns = self.columns
        if isinstance(piece, (str, os.PathLike, Place)):
            piece = open_table(piece, self.format)
        if self.like is not None and isinstance(piece, TableSource):
            _check_same_columns(piece, columns, *self.like)
        notes: tuple[str, ...] = ()
        if not self.motions:
            piece, wanted, notes = open_positions(open_table(piece), columns, self.sigma)
        fields = stream_fields(
            piece,
            self.rows,
            columns=columns if self.motions else wanted,  # type: ignore[arg-type]
            units=self.units,
            on_bad=self.on_bad,
            frame=self.frame,
            roles=roles,
            where=self.where,
            sigma=self.sigma if self.motions else None,
        )
        first = next(fields)
        if len(first) >= _WORTH_A_THREAD:
            fields = ahead(fields)
        for field in chain([first], fields):
            yield field.add_note(*notes) if notes else field


def _layout(opened, columns):
    """Columns that a table has, and their units."""
    return _layout_of(tuple(opened.names), tuple((name, str(unit)) for name, unit in opened.units.items()), columns)


@lru_cache
def _layout_of(present, units, columns):
    named, known = dict(units), set(present)
    chosen, _ = columns.among((*present, *derived_from(present)))
    wanted = [name for role in Columns.__dataclass_fields__ for name in _candidates(chosen, role)]
    wanted += [name for made, inputs in derived_from(present).items() if made in wanted for name in inputs]
    return {name: named.get(name, "None") for name in wanted if name in known}


def _check_same_columns(opened, columns, label, wanted):
    """Raise TableError unless a file has the columns of the first, and no others that a field would use."""
    check_alike(opened, label, wanted)
    further = [name for name in _layout(opened, columns) if name not in wanted]
    if further:
        raise TableError(f"{label} has no column {', '.join(further)}, which {opened.label} has")


def _candidates(columns, role):
    given = getattr(columns, role)
    return (given,) if isinstance(given, str) else given or ()


def _engine(pieces, workers, scheduler) -> Engine:
    if scheduler is not None:
        return Dask(str(scheduler))
    if any(map(is_delayed, pieces)):
        return Dask(None, None if workers is None else whole("workers", workers))
    if workers is not None and whole("workers", workers) > 1:
        return Processes(workers)
    return InProcess()


def _pieces(source, columns, motions, format, where):
    """Pieces that the parts are read from, a tuple."""
    if isinstance(source, (str, os.PathLike)) or is_address(source):
        return tuple(files_of(source, format))
    if isinstance(source, Parts):
        raise ParameterError("this is a catalogue in parts already")
    if hasattr(type(source), "to_delayed"):
        return tuple(_partitions(source, columns, motions, where))
    if isinstance(source, list | tuple) and source:
        return tuple(
            piece
            for each in source
            for piece in (_pieces(each, columns, motions, format, where) if _has_parts(each) else (each,))
        )
    if isinstance(source, list | tuple):
        raise ParameterError("the list of parts is empty")
    if hasattr(type(source), "__next__") and not hasattr(type(source), "__arrow_c_stream__"):
        raise ParameterError(
            "what can be read only once is no catalogue in parts: give a list, or fit.normal_equations the stream"
        )
    if hasattr(type(source), "__next__"):
        return (OneStream(source),)
    return (source,)


class OneStream:
    """A stream that can be read once, and says so when it is asked again."""

    def __init__(self, stream: Any) -> None:
        self.stream: Any = stream

    def __arrow_c_stream__(self, requested_schema: Any = None) -> Any:
        if self.stream is None:
            raise TableError(
                "it can be read only once, and this needs several passes: give a table, files, or a list of them"
            )
        stream, self.stream = self.stream, None
        return stream.__arrow_c_stream__(requested_schema)


def _has_parts(thing):
    return isinstance(thing, (str, os.PathLike)) or is_address(thing) or hasattr(type(thing), "to_delayed")


def _partitions(collection, columns, motions, where):
    """The partitions of a collection with the columns that a field can use, so that nothing else is read."""
    names = tuple(map(str, getattr(collection, "columns", ())))
    if not names:
        return collection.to_delayed()
    made = derived_from(names)
    chosen, _ = columns.among((*names, *made))
    wanted = [name for name in (() if where is None else Where(where).names) if name in names]
    for role in Columns.__dataclass_fields__:
        given = getattr(chosen, role)
        present = [name for name in _candidates(chosen, role) if name in names or name in made]
        if role in (REQUIRED if motions else REQUIRED[:2]) and not present:
            raise TableError(
                f"the {type(collection).__name__} has no column {given!r} for {role}: it has {', '.join(names)}"
            )
        wanted += [name for one in present[:1] for name in made.get(one, (one,))]
    return delayed_of(collection, wanted)
