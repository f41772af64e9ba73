"""Epoch astrometry of listed sources, by DataLink: in batches with their hashes, resumed where cut off."""

import hashlib
import io
import re
import time
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from vsh.io import tables
from vsh.io.archive._tap import _open, _read, _some, _write
from vsh.tools.arguments import explained, positive, whole
from vsh.tools.errors import ArchiveError
from vsh.tools.files import atomic_write, digest, exclusive, remove_unfinished
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: ESA's server of products that hang on a source.
DATA_SERVER = "https://gea.esac.esa.int/data-server/data"
#: The most sources that the server gives at once, and how large an answer of so many may be. [bytes]
BATCH, _MOST = 5000, 2**32


@explained
def fetch_epochs(
    ids: Iterable[int],
    folder: PathName,
    url: str = DATA_SERVER,
    *,
    retrieval_type: str = "EPOCH_ASTROMETRY",
    structure: str = "COMBINED",
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
        The folder, new or of an earlier call. Its neighbour, with .json behind the name, has what was asked and the
        SHA-256 of every file.
    url : str
        Address of the data server.
    retrieval_type, structure, release : str
        What the server calls the product, how several sources come ("INDIVIDUAL", "COMBINED", "RAW") and the release.
    batch : int
        How many sources are asked for at once, 5000 at most.
    patience : float
        How long to wait for each batch. [s]
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Path
        The folder, with a file or more for each batch.

    Raises
    ------
    ArchiveError
        If the server cannot be reached, refuses, or sends nothing that can be unpacked; if the folder holds the answer
        to another list. What has come is kept: the same call goes on where it was.
    """
    numbers = sorted({int(each) for each in ids})
    if not numbers or numbers[0] < 0:
        raise ArchiveError("there are no sources to ask for: source_id are whole numbers above zero")
    size = min(whole("batch", batch), BATCH)
    folder = Path(folder)
    note = folder.with_name(f"{folder.name}.json")
    listed = hashlib.sha256("\n".join(map(str, numbers)).encode()).hexdigest()
    asked = {
        "retrieval_type": retrieval_type, "structure": structure, "release": release, "url": str(url), "batch": size,
        "sources": len(numbers), "sha256_of_ids": listed,
    }  # fmt: skip
    with exclusive(note):
        known = _read(note)
        if known and any(known.get(key) != value for key, value in asked.items()):
            raise ArchiveError(f"{printable(folder)} holds the answer to another request: name another folder")
        if not known and folder.exists() and any(folder.iterdir()):
            raise ArchiveError(f"{printable(folder)} is there, and no note beside it says what it holds: name another")
        files: dict[str, str] = dict(known.get("files", {}))
        if not known:  # first of all: who is killed in the first batch goes on as well
            _write(note, asked | {"files": files})
        folder.mkdir(exist_ok=True)
        remove_unfinished(folder)
        batches = [numbers[k : k + size] for k in range(0, len(numbers), size)]
        with progress_bar(total=len(batches), words="fetching epochs", shown=progress) as bar:
            for k, part in enumerate(batches):
                own = {name: sha for name, sha in files.items() if name.startswith(f"epochs-{k:05d}")}
                if not own or any(not _is_whole(folder / name, sha) for name, sha in own.items()):
                    files = {name: sha for name, sha in files.items() if name not in own}
                    files |= _one(part, k, folder, asked, positive("patience", patience))
                    _write(note, asked | {"files": files})
                bar.update(1)
    return folder


def _is_whole(path, sha):
    return path.is_file() and digest(path) == sha


def _one(ids, k, folder, asked, patience):
    """One batch: its files, and their hashes."""
    form = {
        "ID": ",".join(map(str, ids)), "RETRIEVAL_TYPE": asked["retrieval_type"], "FORMAT": "votable",
        "DATA_STRUCTURE": asked["structure"], "RELEASE": asked["release"], "VALID_DATA": "false",
        "USE_ZIP_ALWAYS": "true",
    }  # fmt: skip
    end = time.monotonic() + patience
    with _open(asked["url"], form, end) as answer:
        body = _some(answer, _MOST, end)
    written = {}
    for number, (name, content) in enumerate(_members(body, asked["url"])):
        kind = ".fits" if content[:9] == b"SIMPLE  =" else ".csv" if name.lower().endswith(".csv") else ".vot"
        path = folder / f"epochs-{k:05d}-{number:05d}{kind}"
        if path.exists():
            path.unlink()  # of a batch that was not whole, or was changed: our own names in our own folder
        with atomic_write(path) as new:
            new.write_bytes(content)
        written[path.name] = digest(path)
    return written


def _members(body, url):
    """The files of an answer: those of a zip archive, or itself."""
    if body[:2] != b"PK":
        if b"<VOTABLE" not in body[:2000] and body[:9] != b"SIMPLE  =":
            words = re.sub(r"<[^>]+>", " ", body[:400].decode("utf-8", "replace"))
            raise ArchiveError(f"{url} sent no epochs: {printable(' '.join(words.split()))[:200]}")
        return [("answer", body)]
    try:
        with zipfile.ZipFile(io.BytesIO(body)) as packed:
            inside = [each for each in packed.infolist() if not each.is_dir()]
            if sum(each.file_size for each in inside) > _MOST:
                raise ArchiveError(f"{url} sent more than {_MOST} bytes in one batch: ask for fewer sources (batch)")
            members = [(each.filename, packed.read(each)) for each in inside]
    except (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise ArchiveError(f"{url} sent no whole archive ({error}): the same call fetches it again") from error
    if not members:
        raise ArchiveError(f"{url} sent an empty archive: none of these sources has epochs")
    return members


def read_ids(source: Any) -> list[int]:
    """Read source_id from a table that has a column of that name, or from a text with one a line.

    Parameters
    ----------
    source : path or table
        The list.

    Raises
    ------
    ArchiveError
        If there are none, or some are no whole numbers.
    """
    if isinstance(source, (str, Path)) and Path(source).suffix.lower() in ("", ".txt", ".lis", ".list", ".ids"):
        text = Path(source).read_text(encoding="utf-8-sig").splitlines()
        words = [word for line in text if (word := line.partition("#")[0].strip())]
    else:
        opened = tables.open_table(source)
        if "source_id" not in opened.names:
            raise ArchiveError(f"{opened.label} has no column source_id: the table has {', '.join(opened.names[:50])}")
        values, mask = opened.columns(("source_id",))["source_id"]
        words = list(map(str, np.asarray(values) if mask is None else np.asarray(values)[~mask]))
    wrong = [word for word in words if not re.fullmatch(r"\d{1,19}", word)]
    if wrong or not words:
        raise ArchiveError(
            f"{len(wrong)} of {len(words)} source_id are no whole numbers"
            if wrong
            else "the list of source_id is empty"
        )
    return [int(word) for word in words]
