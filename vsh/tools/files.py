"""The gate for all writing: files and folders are whole or not there, and nothing is replaced that nobody named.

A file that is there is an error without `overwrite`. What a run reads is never written to (`protect_files`), and what
two processes must not write at once is locked (`hold_lock`).

Tables are written with units and provenance by astropy.table, VOTables as the IVOA defines them: UCDs, coordinate frame
and epoch, time scale, and metadata as parameters.
"""

import ctypes
import glob
import gzip
import hashlib
import json
import logging
import os
import platform
import re
import shutil
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.sky.frames import AXES, FRAME_KEY, MEASURED_KEY, REDSHIFT_FRAME_COLUMN, REDSHIFT_FRAME_KEY
from vsh.tools.errors import ParameterError, TableError, WriteError
from vsh.tools.formats import BY_KIND, PACKED, WRITTEN, find_column_meaning
from vsh.tools.parallel import set_variable_meanwhile
from vsh.tools.printing import printable
from vsh.tools.types import FloatArray, PathName, Table

#: Columns of positions and motions, and of times, in the order of barycentric coordinate time since 2010 (Gaia DR4).
_SKY_COLUMNS = ("lon", "lat", "ra0", "dec0", *(name for names in AXES.values() for name in names))
_SKY_COLUMNS += tuple(f"{name}_error" for names in AXES.values() for name in names[2:])
_TIME_COLUMNS = ("obs_time_tcb",)
#: IVOA's names of the frames (COOSYS of VOTable 1.4), and the Julian date (TCB) that DR4's times are counted from.
_IVOA_FRAMES = {"icrs": "ICRS", "galactic": "galactic", "ecliptic": "ecl_FK5"}
_DR4_ORIGIN = 2455197.5
_UCD_OF_FRAME = {
    "galactic": {"pos.eq.ra": "pos.galactic.lon", "pos.eq.dec": "pos.galactic.lat"},
    "ecl_FK5": {"pos.eq.ra": "pos.ecliptic.lon", "pos.eq.dec": "pos.ecliptic.lat"},
}
#: What the epoch of positions is called in metadata.
_EPOCH_KEYS = ("REFEPOCH", "REF_EPOCH", "EPOCH")
#: Names within the file that no column and no parameter has.
_FRAME_ID, _TIME_ID = "vsh_frame", "vsh_time"


def write_votable(table: Table, path: Path) -> None:
    """Write a VOTable 1.4, its metadata as parameters, which astropy leaves out: lists and dicts as JSON."""
    from astropy.io.votable import from_table
    from astropy.io.votable.tree import Param

    document = from_table(table)
    document.version = "1.4"
    table_node = document.get_first_table()
    for field in table_node.fields:
        column_meaning = find_column_meaning(str(field.name), field.unit)
        field.ucd = column_meaning and column_meaning.ucd
        field.unit = _convert_to_vounit(field.unit)
        if field.arraysize == "1" and field.datatype in ("char", "unicodeChar"):
            field.arraysize = "*"  # a single character has no array size since erratum 3 of VOTable 1.3
    _add_frame_and_time_scale(document, table_node, table.meta)
    for key, value in table.meta.items():
        type_options = {"datatype": "unicodeChar", "arraysize": "*"}
        if isinstance(value, (list, tuple, dict)):
            value = json.dumps(value, ensure_ascii=False, default=str)
        elif isinstance(value, (int, np.integer)) and not isinstance(value, bool) and abs(int(value)) < 2**63:
            type_options = {"datatype": "long"}
        elif isinstance(value, (float, np.floating)):
            type_options = {"datatype": "double"}
        elif value is None:
            continue
        else:
            value = str(value)
        table_node.params.append(Param(document, name=key, value=value, **type_options))
    # The compiled writer writes beyond its buffer where the text of a row just fills it (astropy issue 20419).
    document.to_xml(str(path), _debug_python_based_parser=True)
    if not len(table):  # astropy leaves the data out; STILTS then finds no table
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("</TABLE>", "<DATA><TABLEDATA/></DATA></TABLE>"), encoding="utf-8")


def _convert_to_vounit(unit):
    """A unit in the words of VOUnit, which knows uarcsec and not uas."""
    from astropy.units import CompositeUnit, uarcsec, uas

    if unit is None or uas not in unit.bases:
        return unit
    bases = [uarcsec if base == uas else base for base in unit.bases]
    return CompositeUnit(unit.scale, bases, unit.powers)


def _add_frame_and_time_scale(document, table_node, meta):
    """State the coordinate frame, its epoch where it is known, and the time scale of a VOTable."""
    from astropy.io.votable.tree import CooSys, TimeSys

    resource = document.resources[0]
    # `l` is a degree as well as a longitude: its UCD says which.
    sky_columns = [column for column in table_node.fields if column.name in _SKY_COLUMNS and "pos." in str(column.ucd)]
    metadata = {str(key).upper(): value for key, value in meta.items()}
    if sky_columns:
        epoch = next((metadata[key] for key in _EPOCH_KEYS if metadata.get(key)), None)
        system = _IVOA_FRAMES.get(str(metadata.get("FRAME", "icrs")).lower(), "ICRS")
        epoch_option = {}
        with suppress(TypeError, ValueError):  # none, or no number
            epoch_option = {"epoch": f"J{float(str(epoch)):.3f}"}
        config = {"version_1_2_or_later": True, "version_1_4_or_later": True}
        resource.coordinate_systems.append(CooSys(ID=_FRAME_ID, system=system, config=config, **epoch_option))
        frame_ucds = _UCD_OF_FRAME.get(system, {})
        for column in sky_columns:
            column.ref = _FRAME_ID
            for equatorial_ucd, frame_ucd in frame_ucds.items():
                column.ucd = column.ucd and column.ucd.replace(equatorial_ucd, frame_ucd)
    time_columns = [column for column in table_node.fields if column.name in _TIME_COLUMNS]
    if time_columns:
        config = {"version_1_4_or_later": True}
        resource.time_systems.append(TimeSys(ID=_TIME_ID, timeorigin=_DR4_ORIGIN, timescale="TCB",
                                             refposition="TOPOCENTER", config=config))  # fmt: skip
        for column in time_columns:
            column.ref = _TIME_ID


if os.name == "posix":
    import fcntl
else:  # nothing is locked there
    fcntl = None  # type: ignore[assignment]

_LOG = logging.getLogger(__name__)
#: By what files were made: in the metadata of tables, pictures and pages.
MARK = "vsh-astrometry"
#: What the run reads.
_PROTECTED: ContextVar[frozenset[Path]] = ContextVar("read", default=frozenset())
#: How the names of files that are being written begin; nobody else's files do.
UNFINISHED = ".vsh-unfinished-"
#: This machine, in such names, and the age at which what another one left is taken for abandoned. [s]
_MACHINE = hashlib.sha256(platform.node().encode()).hexdigest()[:8]
_MAX_AGE = 86400
_LOCK = f"{UNFINISHED}lock-"


def check_overwrite_allowed(path: PathName, overwrite: bool) -> None:
    """Raise WriteError where a file is there that nobody asked to replace."""
    if os.path.lexists(path) and not overwrite:
        raise WriteError(f"{printable(path)} exists already: overwrite=True replaces it, or name another file")


@contextmanager
def atomic_write(path: PathName, overwrite: bool = False) -> Iterator[Path]:
    """A name to write a new file under, which takes the place of `path` once it is complete.

    A process killed at any moment leaves the old file or the new one, never a part of either; any number of writers may
    write to one path at once, and one of them wins. A link stays a link: the file it names is replaced. Without
    `overwrite` a file that is there, or that comes there meanwhile, is an error.
    """
    path = Path(os.path.realpath(path))
    check_not_read(path)
    check_overwrite_allowed(path, overwrite)
    _remove_abandoned_writes(path)
    descriptor, temporary_name = tempfile.mkstemp(prefix=_make_prefix(), suffix=f"-{path.name[-100:]}", dir=path.parent)
    os.close(descriptor)
    temporary_path = Path(temporary_name)
    try:
        yield temporary_path
        with temporary_path.open("rb") as file:
            os.fsync(file.fileno())  # else a power cut could leave an empty file under the name
        os.chmod(temporary_path, _find_permissions(path))
        if overwrite or not _try_link_new(temporary_path, path):
            check_overwrite_allowed(path, overwrite)
            os.replace(temporary_path, path)
        if UNFINISHED not in str(path):  # of a folder the whole is told
            _LOG.info("written: %s", path)
    finally:
        temporary_path.unlink(missing_ok=True)


def _try_link_new(temporary_path, path):
    """Give a file its name where no other has it; False where the system cannot."""
    try:
        os.link(temporary_path, path)
    except FileExistsError:
        check_overwrite_allowed(path, overwrite=False)
        raise
    except OSError:
        return False
    return True


def _make_prefix():
    """The beginning of the names of unfinished files of this process."""
    return f"{UNFINISHED}{_MACHINE}-{os.getpid()}-"


def file_stamp(path: PathName) -> tuple[int, int]:
    """The size and time of change of a file, by which it is known again on any machine that sees it."""
    try:
        status = Path(path).stat()
    except OSError as error:
        raise TableError(f"{printable(path)} cannot be read: {error.strerror}") from error
    return status.st_size, status.st_mtime_ns


def check_unchanged(label: PathName, opened_stamp: Any, current_stamp: Any) -> None:
    """Raise TableError where a file is not the one that was opened: numbers of two catalogues would be added up."""
    if current_stamp != opened_stamp:
        raise TableError(f"{printable(label)} changed since it was opened: start again, when nobody writes to it")


#: Catalogues are at most so many times larger than their files, or so large. [bytes]
_MAX_PACKING, _SMALL_SIZE = 200, 2**26


def check_unpacked_size(label: str, unpacked_bytes: float, file_bytes: int) -> None:
    """Raise TableError where a file says of itself that it holds much more than a catalogue could be packed into it."""
    if unpacked_bytes > max(_MAX_PACKING * file_bytes, _SMALL_SIZE):
        raise TableError(
            f"{label} would be {unpacked_bytes / 2**30:.2g} GiB or more, from a file of {file_bytes} bytes: measured "
            "numbers do not pack so tightly, so it is damaged, or no catalogue"
        )


def digest(path: PathName) -> str:
    """SHA-256 of a file, or of the names and hashes of all files of a folder."""
    path = Path(path)
    if not path.exists():  # one of several tables in a file, by its number
        path = Path(re.sub(r"#[^#]+$", "", str(path)))
    if path.is_dir():
        files = sorted(file for file in path.rglob("*") if file.is_file())
        return hashlib.sha256("\n".join(f"{f.relative_to(path)} {digest(f)}" for f in files).encode()).hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_values(values: Iterable[Any]) -> str:
    """A hash of arrays and plain values."""
    hasher = hashlib.sha256()
    for item in values:
        hasher.update(np.ascontiguousarray(item).tobytes() if isinstance(item, np.ndarray) else repr(item).encode())
    return hasher.hexdigest()


def protect_files(paths: Iterable[PathName]) -> AbstractContextManager[None]:
    """Meanwhile nothing is written to these files, into these folders, nor to a folder with one of them in it."""
    return set_variable_meanwhile(_PROTECTED, _PROTECTED.get() | {Path(os.path.realpath(path)) for path in paths})


def check_not_read(path: PathName, label: str | None = None) -> None:
    """Raise WriteError where a path is, holds or lies in what the run reads."""
    path = Path(os.path.realpath(path))
    for read_path in _PROTECTED.get():
        if path == read_path or path in read_path.parents or (read_path in path.parents and read_path.is_dir()):
            relation = "is" if path == read_path else "lies in" if read_path in path.parents else "holds"
            raise WriteError(f"{label or path.name} {relation} what is read, {read_path.name}: name another place")


@contextmanager
def hold_lock(path: PathName) -> Iterator[None]:
    """Meanwhile no other process that asks may write to this path."""
    path = Path(os.path.realpath(path))
    if fcntl is None:
        yield
        return
    lock_path = path.with_name(f"{_LOCK}{path.name[-100:]}")
    while True:
        descriptor = os.open(lock_path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            os.close(descriptor)
            raise WriteError(f"another process is writing {path.name}: wait for it, or name another") from None
        if os.path.exists(lock_path) and os.path.samestat(os.fstat(descriptor), os.stat(lock_path)):
            break
        os.close(descriptor)  # whoever held it took its name away
    try:
        yield
    finally:
        lock_path.unlink(missing_ok=True)
        os.close(descriptor)


def write_arrays(path: PathName, arrays: Mapping[str, Any], *, compress: bool = False, overwrite: bool = False) -> None:
    """Write arrays by name as NumPy's .npz."""
    save: Any = np.savez_compressed if compress else np.savez
    with atomic_write(path, overwrite) as temporary_path, temporary_path.open("wb") as file:
        save(file, **arrays)


def make_scratch_array(folder: PathName | None, shape: tuple[int, ...]) -> FloatArray:
    """Zeros in memory; or, in a folder, in a file without a name that goes with the array.

    The room is taken at once: a disk that is full says so here, and not by a signal when the array is written to.
    """
    if folder is None:
        return np.zeros(shape)
    n_bytes = 8 * int(np.prod(shape))
    with tempfile.TemporaryFile(dir=folder, prefix=UNFINISHED) as file:
        if n_bytes and hasattr(os, "posix_fallocate"):
            os.posix_fallocate(file.fileno(), 0, n_bytes)
        return np.memmap(file, float, "w+", shape=shape) if n_bytes else np.zeros(shape)


def read_arrays(path: PathName) -> dict[str, Any]:
    """The arrays by name of a file of `write_arrays`; whatever NumPy raises on a damaged one."""
    with Path(path).open("rb") as stream, np.load(stream, allow_pickle=False) as file:
        unpacked_bytes = sum(member.file_size for member in file.zip.infolist()) if hasattr(file, "zip") else 0
        check_unpacked_size(printable(path), unpacked_bytes, Path(path).stat().st_size)
        return dict(file.items())


def remove_unfinished_files(folder: PathName) -> None:
    """Remove what killed writers left in a folder and below: files by the names that only `atomic_write` gives."""
    for file in Path(folder).rglob(f"{UNFINISHED}*"):
        if file.is_file() and not file.is_symlink() and not file.name.startswith(_LOCK):
            file.unlink(missing_ok=True)


@contextmanager
def atomic_folder(path: PathName) -> Iterator[Path]:
    """A new, empty folder that takes the place of `path` once complete; killed, the old one or the new is there."""
    path = Path(os.path.realpath(path))
    check_not_read(path)
    _remove_abandoned_writes(path)
    temporary_path = Path(tempfile.mkdtemp(prefix=_make_prefix(), suffix=f"-{path.name[-100:]}", dir=path.parent))
    try:
        yield temporary_path
        os.chmod(temporary_path, 0o777 & ~_read_umask())
        if path.exists():
            _exchange_folders(temporary_path, path)
        else:
            os.replace(temporary_path, path)
        _LOG.info("written: %s", path)
    finally:
        shutil.rmtree(temporary_path, ignore_errors=True)


def _exchange_folders(temporary_path, path):
    """Let two folders change names, in one step where the system can."""
    libc = ctypes.CDLL(None, use_errno=True)
    encoded_paths = os.fsencode(temporary_path), os.fsencode(path)
    if hasattr(libc, "renameat2"):  # Linux: AT_FDCWD, RENAME_EXCHANGE
        if libc.renameat2(-100, encoded_paths[0], -100, encoded_paths[1], 2) == 0:
            return
    elif hasattr(libc, "renamex_np") and libc.renamex_np(*encoded_paths, 2) == 0:  # macOS: RENAME_SWAP
        return
    backup = path.with_name(f"{temporary_path.name}-old")  # elsewhere, in two steps
    os.replace(path, backup)
    os.replace(temporary_path, path)
    shutil.rmtree(backup, ignore_errors=True)


def _remove_abandoned_writes(path):
    """Remove what killed writers of this file or folder left beside it: of this machine, or a day ago and earlier."""
    for candidate in path.parent.glob(f"{UNFINISHED}*-{glob.escape(path.name[-100:])}"):
        if candidate.name.startswith(_LOCK):
            continue
        machine, _, remainder = candidate.name.removeprefix(UNFINISHED).partition("-")
        try:
            age = time.time() - candidate.stat().st_mtime
            if candidate.is_symlink() or not (_is_process_gone(machine, remainder.partition("-")[0]) or age > _MAX_AGE):
                continue
            shutil.rmtree(candidate) if candidate.is_dir() else candidate.unlink()
        except OSError:
            continue


def _is_process_gone(machine, process_id):
    """Return whether the process of this number was one of this machine, and has ended."""
    if machine != _MACHINE or not process_id.isdecimal() or os.name != "posix":
        return False
    try:
        os.kill(int(process_id), 0)
    except ProcessLookupError:
        return True
    except OSError:  # somebody else's
        return False
    return False


def _find_permissions(path):
    """The permissions of the file that is replaced, or those a new one would have."""
    try:
        return path.stat().st_mode & 0o7777
    except OSError:
        return 0o666 & ~_read_umask()


def _read_umask():
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


#: In the metadata of every table that is written: by what; and in that of a result: what is needed to read it again.
CREATOR, RESULT_MARK = "CREATOR", "RESULT"


def format_of(path: PathName, formats_by_ending: Mapping[str, str] = WRITTEN) -> str:
    """Return astropy's name of the format of a file name extension; raise TableError if it is unknown."""
    path = Path(path)
    suffixes = [suffix.lower() for suffix in path.suffixes]
    compressions = PACKED[:1] if formats_by_ending is WRITTEN else PACKED
    if suffixes and suffixes[-1] in compressions:
        suffixes.pop()
    if not suffixes or suffixes[-1] not in formats_by_ending:
        raise TableError(
            f"{printable(path)}: unrecognised format. Known endings: {', '.join(formats_by_ending)}, each also with "
            f"{', '.join(compressions)}"
        )
    return formats_by_ending[suffixes[-1]]


def table_of(
    columns: Mapping[str, Any], meta: dict[str, Any] | None = None, units: Mapping[str, str] | None = None
) -> Table:
    """Return an astropy Table of named columns, with metadata and units, in which µ may stand; "" is none."""
    from astropy.table import Table

    table = Table({name: np.asarray(values) for name, values in columns.items()}, meta=meta or {})
    for name, unit in (units or {}).items():
        table[name].unit = unit.replace("µ", "u") or None
    return table


def table_of_rows(column_names: Sequence[str], rows: Sequence[Sequence[Any]], *meta_and_units: Any) -> Table:
    """Return an astropy Table of rows under heads, with metadata and units as of `table_of`."""
    return table_of({name: [row[k] for row in rows] for k, name in enumerate(column_names)}, *meta_and_units)


def write_columns(
    path: PathName,
    columns: Mapping[str, Any],
    meta: dict[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
    overwrite: bool = False,
) -> None:
    """Write columns as a table to `path`; the file has this name only once it is complete."""
    write_table(table_of(columns, meta, units), path, overwrite=overwrite)


def write_table(table: Table, path: PathName, meta: dict[str, Any] | None = None, *, overwrite: bool = False) -> None:
    """Write an astropy Table with more metadata to `path`; the file has this name only once it is complete."""
    if not hasattr(table, "colnames"):
        raise ParameterError(f"table must be an astropy Table, not {type(table).__name__}")
    path = Path(path)
    check_writable(path)
    metadata = {CREATOR: f"{MARK} {vsh.__version__}"}
    metadata |= {key: value for key, value in table.meta.items() if key != CREATOR}
    table = table.copy(copy_data=False)
    table.meta = type(table.meta)(_convert_to_plain_types(metadata | (meta or {})))
    for name in table.colnames:
        info = table[name].info
        if not info.description and (column_meaning := find_column_meaning(name, info.unit)):
            info.description = column_meaning.meaning
    format_name = format_of(path)
    _adapt_to_format(table, format_name, path)
    with atomic_write(path, overwrite) as temporary_path, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy warns about units that a format spells in its own way
        if format_name == "votable":
            write_votable(table, temporary_path)
        elif format_name == "hdf5":
            table.write(temporary_path, format=format_name, path="table", serialize_meta=True, overwrite=True)
        elif format_name == "fits":
            _write_fits(table, temporary_path)
        else:
            table.write(temporary_path, format=format_name, overwrite=True)
        # astropy compresses FITS and VOTables alone.
        if format_name.startswith("ascii") and path.suffix.lower() == ".gz":
            temporary_path.write_bytes(gzip.compress(temporary_path.read_bytes(), mtime=0))


def _write_fits(table, path):
    """Write a FITS table whose columns are described as other readers expect it, by TCOMM."""
    from astropy.io.fits import table_to_hdu

    meanings = {name: table[name].info.description for name in table.colnames}
    for name in table.colnames:  # or astropy adds a comment in YAML that is longer than many a table
        table[name].info.description = None
    hdu = table_to_hdu(table)
    for column_number, meaning in enumerate(meanings.values(), 1):
        if meaning:
            comment = " ".join(meaning.translate(_TO_ASCII).encode("ascii", "replace").decode().split())
            hdu.header.set(f"TCOMM{column_number}", comment, after=f"TFORM{column_number}")
    hdu.writeto(path, overwrite=True)


def _adapt_to_format(table, format_name, path):
    """Say in columns what a format without metadata would lose, and raise TableError where it cannot hold the rest."""
    if format_name == "ascii.csv":
        if (frame := table.meta.get("frame")) not in (None, "icrs") and "frame" not in table.colnames:
            table["frame"] = np.full(len(table), str(frame))
        if redshift_frame := table.meta.get(REDSHIFT_FRAME_KEY):
            table[REDSHIFT_FRAME_COLUMN] = np.full(len(table), str(redshift_frame))
        lost_metadata = {key: str(table.meta[key]) for key in _ESSENTIAL_KEYS if key in table.meta}
        if "ra" not in table.colnames:
            lost_metadata.pop(FRAME_KEY, None)  # the names of the columns say it
        if lost_metadata:
            lost_text = ", ".join(f"{key} = {value}" for key, value in lost_metadata.items())
            raise TableError(
                f"{printable(path)}: CSV keeps no metadata, and {lost_text} would be lost: write .ecsv, .fits, .vot or "
                ".parquet"
            )
    if format_name == "fits":
        for key, value in table.meta.items():
            if isinstance(value, (list, tuple)):  # each of which would be a card of the same name
                table.meta[key] = "; ".join(map(str, value))
        if any(isinstance(value, str) and len(value) > _CARD_LENGTH for value in table.meta.values()):
            table.meta["LONGSTRN"] = "OGIP 1.0"  # by which readers know that texts go on in further cards
        if RESULT_MARK not in table.meta:  # of a result the names are read again
            for name in filter(_COEFFICIENT_NAME.fullmatch, table.colnames):
                table.rename_column(name, re.sub(r"\W+", "_", name).strip("_"))
        for name in [name for name in table.colnames if table[name].dtype.kind in "UO"]:
            if _is_column_ascii(np.ma.getdata(table[name])):
                continue
            texts = [str(text).translate(_TO_ASCII) for text in np.ma.getdata(table[name])]
            rows = [row for row, text in enumerate(texts) if not text.isascii()]
            if rows:
                raise TableError(
                    f"{printable(path)}: FITS holds ASCII alone, and {len(rows)} rows of column {name!r} have more, "
                    f"{texts[rows[0]]!r} in row {rows[0]} say: write .ecsv, .vot or .parquet"
                )
            if table[name].dtype.kind == "U":
                table[name] = type(table[name])(texts, mask=table[name].mask) if hasattr(table[name], "mask") else texts


def _is_column_ascii(texts):
    """Return whether a column of text holds ASCII alone; at once, for catalogues have millions of names."""
    try:
        np.asarray(texts).astype("S")
    except UnicodeEncodeError:
        return False
    return True


#: The longest text that one card of a FITS header holds.
_CARD_LENGTH = 68
#: Columns of coefficients, t(2,1,re), whose names FITS would have without brackets: t_2_1_re.
_COEFFICIENT_NAME = re.compile(r"[a-z]\(\d+,\d+(,re|,im)?\)")
#: What labels of ours have beyond ASCII.
_TO_ASCII = str.maketrans({"≥": ">=", "≤": "<=", "−": "-", "µ": "u", "°": "deg", "δ": "delta", "α": "alpha"})
#: Metadata without which a table says something else.
_ESSENTIAL_KEYS = (FRAME_KEY, MEASURED_KEY)


def _convert_to_plain_types(value: Any) -> Any:
    """Metadata with subclasses of str, such as counted notes, as the str that YAML can represent."""
    if isinstance(value, dict):
        return {key: _convert_to_plain_types(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_convert_to_plain_types(item) for item in value]
    return str(value) if isinstance(value, str) else value


def check_writable(path: PathName) -> None:
    """Raise TableError now if a table could not be written to `path` later."""
    path = Path(path)
    format_name = format_of(path)
    if not path.absolute().parent.is_dir():
        raise TableError(f"{printable(path)}: there is no such folder")
    library = {"parquet": "pyarrow", "hdf5": "h5py"}.get(format_name)
    if library:
        if path.suffix.lower() == ".gz":
            title = BY_KIND[format_name].title
            raise TableError(f"{printable(path)}: {title} is compressed by itself: leave out the .gz")
        from importlib.util import find_spec

        if find_spec(library) is None:
            raise TableError(
                f"{printable(path)} cannot be written. Install what is missing: pip install "
                f"'vsh-astrometry[{format_name}]'"
            )
