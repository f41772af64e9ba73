"""Epoch astrometry by DataLink: in batches that are opened before they count, with hashes, resumed where cut off."""

import hashlib
import io
import re
import time
import zipfile
from collections.abc import Iterable
from functools import partial
from pathlib import Path

import numpy as np

from vsh.io import tables
from vsh.io.archive._tap import _extract_error, _open_url, _read_at_most, _read_note, _RefusedError, _write_note
from vsh.tools.arguments import positive, whole
from vsh.tools.errors import ArchiveError, VshError
from vsh.tools.files import atomic_write, digest, hold_lock, remove_unfinished_files
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: ESA's server of products that hang on a source.
DATA_SERVER = "https://gea.esac.esa.int/data-server/data"
#: The most sources that the server gives at once, and how large an answer of so many may be. [bytes]
BATCH, _LARGEST = 5000, 2**32
#: How several sources come, the first that the server knows: one file with an array for each transit, by DR4's word and
#: by that of earlier releases; or one file for each source. [astroquery 3629, 3012]
STRUCTURES = ("DATAMODEL_GAIA", "RAW", "DATAMODEL_STANDARD", "INDIVIDUAL")
#: What a file of epochs has at least, by its lower-case names.
_NEEDED_COLUMNS = ("source_id", "centroid_pos_al")


def fetch_epochs(
    ids: Iterable[int],
    folder: PathName,
    url: str = DATA_SERVER,
    *,
    retrieval_type: str = "EPOCH_ASTROMETRY",
    structure: str | None = None,
    release: str = "Gaia DR4",
    batch: int = 500,
    patience: float = 7200.0,
    progress: bool = True,
) -> Path:
    """Fetch the epoch astrometry of sources into a folder that `read_epochs` and `vsh-waves` read.

    Parameters
    ----------
    ids : iterable of int
        source_id of each.
    folder : str or Path
        The folder, new or of an earlier call. A file of the same name with .json appended records the request and the
        SHA-256 checksum of every file.
    url : str
        Address of the data server.
    retrieval_type, release : str
        What the server calls the product and the release. Bright sources and those of crowded fields have products of
        their own in DR4: EPOCH_ASTROMETRY_BRIGHT and EPOCH_ASTROMETRY_CROWDED_FIELD.
    structure : str, optional
        How several sources come. Unless given, "DATAMODEL_GAIA" is asked for, and what the server names as valid
        where it does not know it ("RAW", …).
    batch : int
        How many sources are asked for at once, 5000 at most.
    patience : float
        How long to wait for each batch. [s]
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Path
        The folder, with a file or more for each batch. Its note lists under "missing" the sources without epochs.

    Raises
    ------
    ArchiveError
        If the server cannot be reached, refuses, or sends something that is no table of epochs of these sources; if
        the folder holds the answer to another list, or a file that was changed since. Batches already received are
        kept; the same call resumes after them.
    """
    source_ids = sorted({int(source_id) for source_id in ids})
    if not source_ids or source_ids[0] < 0:
        raise ArchiveError("there are no sources to ask for: source_id are whole numbers above zero")
    n_batch = min(whole("batch", batch), BATCH)
    folder = Path(folder)
    note_path = folder.with_name(f"{folder.name}.json")
    checksum = hashlib.sha256("\n".join(map(str, source_ids)).encode()).hexdigest()
    request = {
        "retrieval_type": retrieval_type, "structure": structure, "release": release, "url": str(url), "batch": n_batch,
        "sources": len(source_ids), "sha256_of_ids": checksum,
    }  # fmt: skip
    with hold_lock(note_path):
        record = _read_note(note_path)
        if record and any(record.get(key) != value for key, value in request.items()):
            raise ArchiveError(f"{printable(folder)} holds the answer to another request: name another folder")
        if not record and folder.exists() and any(folder.iterdir()):
            raise ArchiveError(f"{printable(folder)} exists without its note, so its content is unknown: name another")
        files: dict[str, str] = dict(record.get("files", {}))
        missing: dict[str, list[int]] = dict(record.get("missing", {}))
        if not record:  # first of all: who is killed in the first batch goes on as well
            _write_note(note_path, request | {"files": files, "missing": missing})
        folder.mkdir(exist_ok=True)
        remove_unfinished_files(folder)
        _check_files_unchanged(folder, files)
        structures = [structure] if structure else list(STRUCTURES)
        fetch = partial(_fetch_epoch_answer, request, structures, positive("patience", patience))
        batches = [source_ids[k : k + n_batch] for k in range(0, len(source_ids), n_batch)]
        with progress_bar(total=len(batches), words="fetching epochs", shown=progress) as bar:
            for k, batch_ids in enumerate(batches):
                prefix = f"epochs-{k:05d}"
                names = [name for name in files if name.startswith(f"{prefix}-")]
                if (not names and prefix not in missing) or any(not (folder / name).is_file() for name in names):
                    files = {name: sha for name, sha in files.items() if name not in names}
                    added_files, missing_ids = _fetch_batch(fetch, request["url"], batch_ids, folder / prefix)
                    files |= added_files
                    missing.pop(prefix, None)
                    missing |= {prefix: missing_ids} if missing_ids else {}
                    _write_note(note_path, request | {"files": files, "missing": missing})
                bar.update(1)
    return folder


def sources_without_epochs(folder: PathName) -> list[int]:
    """The source_id that were asked for and of which the archive sent no epochs, by the note beside a folder."""
    folder = Path(folder)
    record = _read_note(folder.with_name(f"{folder.name}.json"))
    return sorted(source_id for missing_ids in record.get("missing", {}).values() for source_id in missing_ids)


def _check_files_unchanged(folder, files):
    """Raise ArchiveError where a file that was fetched is no longer as it was: it is somebody's work."""
    changed_names = [name for name, sha in files.items() if (folder / name).is_file() and digest(folder / name) != sha]
    if changed_names:
        raise ArchiveError(
            f"{printable(folder / changed_names[0])} is not as it was fetched"
            + (f", nor are {len(changed_names) - 1} others" if len(changed_names) > 1 else "")
            + ": somebody changed it. Move it elsewhere, and the same call fetches it again"
        )


def _fetch_epoch_answer(request, structures, patience, ids):
    """The body of the answer for some sources; of the `structures` those that the server knows are left."""
    form = {
        "ID": ",".join(map(str, ids)), "RETRIEVAL_TYPE": request["retrieval_type"], "FORMAT": "votable",
        "DATA_STRUCTURE": structures[0], "RELEASE": request["release"], "VALID_DATA": "false", "USE_ZIP_ALWAYS": "true",
    }  # fmt: skip
    deadline = time.monotonic() + patience
    try:
        with _open_url(request["url"], form, deadline) as answer:
            return _read_at_most(answer, _LARGEST, deadline)
    except _RefusedError as error:
        # ESA's server: "Invalid Data Structure parameter: 'X', valid ones are: RAW, INDIVIDUAL".
        if len(structures) == 1 or "data structure" not in str(error).lower():
            raise
        valid_names = re.findall(r"\w+", str(error).partition("valid ones are")[2])
        structures[:] = [name for name in STRUCTURES[1:] if not valid_names or name in valid_names]
        if not structures:
            raise
        return _fetch_epoch_answer(request, structures, patience, ids)


def _fetch_batch(fetch, url, ids, prefix):
    """Fetch a batch: its files with their hashes, and the sources that are in none of them."""
    members = _unpack_answer(fetch(ids), url)
    for old_path in prefix.parent.glob(f"{prefix.name}-*"):  # of an answer in other files, or of one that was no good
        old_path.unlink()
    files, received_ids = {}, set()
    for number, (name, content) in enumerate(members):
        suffix = ".fits" if content[:9] == b"SIMPLE  =" else ".csv" if name.lower().endswith(".csv") else ".vot"
        path = prefix.with_name(f"{prefix.name}-{number:05d}{suffix}")
        with atomic_write(path, overwrite=True) as temporary_path:
            temporary_path.write_bytes(content)
            received_ids |= _read_source_ids(temporary_path, name, content, url)
            files[path.name] = digest(temporary_path)
    foreign_ids = received_ids - set(ids)
    if foreign_ids:
        raise ArchiveError(
            f"{url} sent epochs of {len(foreign_ids)} sources that were not asked for, {min(foreign_ids)} for one"
        )
    return files, sorted(set(ids) - received_ids)


def _read_source_ids(path, name, content, url):
    """The source_id in a file of an answer, once it is known to hold epochs."""
    try:
        table = tables.open_table(path)
        name_by_lower = {column.lower(): column for column in table.names}
        absent_columns = [column for column in _NEEDED_COLUMNS if column not in name_by_lower]
        if not absent_columns:
            source_ids, mask = table.columns((name_by_lower["source_id"],))[name_by_lower["source_id"]]
            return set(map(int, np.asarray(source_ids) if mask is None else np.asarray(source_ids)[~np.asarray(mask)]))
        reason = f"it has no column {absent_columns[0]}"
    except (VshError, OSError, ValueError, TypeError) as error:
        reason = str(error).replace(str(path), name)
    message = _extract_error(content[:_MAX_MESSAGE_BYTES]) if b"ERROR" in content[:_MAX_MESSAGE_BYTES] else reason
    raise ArchiveError(f"{url} sent no epochs in {printable(name)}: {printable(message)[:200]}")


#: So much of a document is looked through for the reason of an error. [bytes]
_MAX_MESSAGE_BYTES = 2**20


def _unpack_answer(answer_bytes, url):
    """The files of an answer: those of a zip archive, or itself."""
    if answer_bytes[:2] != b"PK":
        if b"<VOTABLE" not in answer_bytes[:2000] and answer_bytes[:9] != b"SIMPLE  =":
            text = re.sub(r"<[^>]+>", " ", answer_bytes[:400].decode("utf-8", "replace"))
            raise ArchiveError(f"{url} sent no epochs: {printable(' '.join(text.split()))[:200]}")
        return [("answer", answer_bytes)]
    try:
        with zipfile.ZipFile(io.BytesIO(answer_bytes)) as archive:
            member_infos = [member for member in archive.infolist() if not member.is_dir()]
            if sum(member.file_size for member in member_infos) > _LARGEST:
                raise ArchiveError(f"{url} sent more than {_LARGEST} bytes in one batch: ask for fewer sources (batch)")
            members = [(member.filename, archive.read(member)) for member in member_infos]
    except (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise ArchiveError(f"{url} sent no whole archive ({error}): the same call fetches it again") from error
    if not members:
        raise ArchiveError(f"{url} sent an empty archive: are these sources of the release, and epochs of this type?")
    return members
