"""The Table Access Protocol with the standard library: ask, wait, keep the answer as a file.

A job runs at the server (IVOA's TAP 1.1 and UWS 1.1). Beside the file that is to come stands a note of the job, so that
whoever was interrupted waits on for the same one; a file that is there is the answer, and nothing is asked.
"""

from __future__ import annotations

import http.client
import json
import os
import time
import urllib.error
import urllib.parse
import urllib.request
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from vsh import tables
from vsh.checks.arguments import positive, whole
from vsh.checks.notes import printable
from vsh.checks.types import PathName
from vsh.errors import ArchiveError, TableError
from vsh.system.files import atomic_write
from vsh.system.progress import progress_bar

#: ESA's archive of Gaia.
ESA = "https://gea.esac.esa.int/tap-server/tap"
#: What ESA's archive gives somebody who is not logged in, at most; an answer of exactly so many rows was cut off.
_LIMITS = (2_000_000, 3_000_000)
_WAITING = ("PENDING", "QUEUED", "EXECUTING", "HELD", "SUSPENDED", "UNKNOWN")
_BLOCK = 2**20
_TIMEOUT = 60.0


def query(
    adql: str,
    path: PathName,
    url: str = ESA,
    *,
    patience: float = 7200.0,
    interval: float = 2.0,
    max_rows: int | None = None,
    overwrite: bool = False,
    progress: bool = True,
) -> Path:
    """Fetch the answer to a query as a FITS file, unless it is there already.

    Parameters
    ----------
    adql : str
        The query: one of `vsh.archive.GAIA_CRF3`, …, or one's own.
    path : str or Path
        The file, .fits. Its neighbour, with .json behind the name, says what it is the answer to.
    url : str
        Of the service: what /async is put behind.
    patience : float
        How long to wait for the job. [s]
    interval : float
        How long to wait before asking again, more as time goes by. [s]
    max_rows : int, optional
        The most rows; the server's own limit unless given.
    overwrite : bool
        Ask again though the file is there.
    progress : bool
        Show bars, after two seconds.

    Returns
    -------
    Path
        Of the file, which is whole.

    Raises
    ------
    ArchiveError
        If the server cannot be reached, refuses the query, ends the job with an error, or does not send a whole table; if
        the answer was cut off at a limit; if the file is the answer to another query. What was asked for is kept:
        the same call goes on where it was.

    Examples
    --------
    >>> query(GAIA_CRF3, "crf3.fits")  # doctest: +SKIP
    PosixPath('crf3.fits')
    """
    path, adql, url = Path(path), _checked(adql), str(url).rstrip("/")
    if tables.format_of(path) != "fits" or path.suffix == ".gz":
        raise ArchiveError(f"{printable(path)}: answers are kept as .fits")
    if not path.absolute().parent.is_dir():
        raise ArchiveError(f"{printable(path)}: there is no such folder")
    if not url.startswith(("http://", "https://")):
        raise ArchiveError(f"{printable(url)} is no address of a service: https://…/tap")
    note, asked = path.with_name(f"{path.name}.json"), {"query": adql, "url": url, "max_rows": max_rows}
    known = {} if overwrite else _read(note)
    if path.exists() and not overwrite:
        if known and known.get("query") != adql:
            raise ArchiveError(f"{printable(path)} is the answer to another query: take another name, or overwrite it")
        _rows_of(path)
        return path
    job = known.get("job") if all(known.get(key) == value for key, value in asked.items()) else None
    job = _still_there(job) or _submitted(adql, url, None if max_rows is None else whole("max_rows", max_rows))
    _write(note, asked | {"job": job})
    _wait(job, positive("patience", patience), positive("interval", interval), progress)
    part = path.with_name(f"{path.name}.part")
    try:
        _fetch(f"{job}/results/result", part, progress)
        rows = _rows(part, max_rows)
    except ArchiveError:
        part.unlink(missing_ok=True)
        raise
    os.replace(part, path)
    _write(note, asked | {"rows": rows, "fetched": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())})
    return path


def _rows_of(path):
    """The rows of a file that is there, once it is known to be whole."""
    try:
        return tables.fits_rows(path, path.name)
    except TableError as error:
        raise ArchiveError(
            f"{printable(path)} is there, but no whole FITS table ({error}): overwrite it, or take another name"
        ) from error


def _checked(adql):
    if not isinstance(adql, str) or not adql.strip():
        raise ArchiveError(f"a query is text in ADQL, not {adql!r}")
    return adql.strip()


def _submitted(adql, url, max_rows):
    """The address of a new job."""
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": "fits", "QUERY": adql, "PHASE": "RUN"}
    if max_rows is not None:
        form["MAXREC"] = str(max_rows)
    with _open(f"{url}/async", form) as answer:
        job = answer.geturl()
    if job.rstrip("/").endswith("/async"):
        raise ArchiveError(f"{url} took no job: is it the address of a TAP service?")
    return job


def _still_there(job):
    """A job of before, if the server still knows it and it did not fail."""
    if not isinstance(job, str):
        return None
    try:
        return job if _phase(job) in (*_WAITING, "COMPLETED") else None
    except _RefusedError:
        return None


def _phase(job):
    with _open(f"{job}/phase") as answer:
        return answer.read(1000).decode("utf-8", "replace").strip()


def _wait(job, patience, interval, progress):
    end, failures = time.monotonic() + patience, 0
    with progress_bar(words="the archive is at work", shown=progress, unit=" s", bar_format="{desc}: {elapsed}") as bar:
        while True:
            try:
                phase, failures = _phase(job), 0
            except _RefusedError:
                raise
            except ArchiveError:
                failures += 1
                if failures > 3:  # a network may be away for a moment
                    raise
                phase = "UNKNOWN"
            if phase not in _WAITING:
                break
            if time.monotonic() > end:
                raise ArchiveError(f"{job} is {phase.lower()} after {patience:g} s: the same call later waits on")
            bar.set_description(f"the archive is at work ({phase.lower()})")
            bar.update(0)
            time.sleep(interval)
            interval = min(1.3 * interval, 30.0)
    if phase != "COMPLETED":
        with _open(f"{job}/error") as answer:
            said = _message(answer.read(_BLOCK))
        raise ArchiveError(f"the query ended {phase.lower()}: {said or 'the server does not say why'}")


def _fetch(address, part, progress):
    with _open(address) as answer, part.open("wb") as file:
        size = int(answer.headers.get("Content-Length") or 0)
        with progress_bar(total=size or None, words="fetching", shown=progress, unit="B", unit_scale=True) as bar:
            try:
                while block := answer.read(_BLOCK):
                    file.write(block)
                    bar.update(len(block))
            except (OSError, http.client.HTTPException) as error:
                raise ArchiveError(
                    f"{address}: the connection was cut ({error}); the same call fetches it again"
                ) from error
        if size and file.tell() != size:
            raise ArchiveError(f"{address}: {file.tell()} of {size} bytes came; the same call fetches it again")


def _rows(part, max_rows):
    """How many rows the table has, once it is known to be whole."""
    with part.open("rb") as file:
        start = file.read(_BLOCK)
    if start.lstrip()[:5] in (b"<?xml", b"<VOTA"):  # TAP's way to say that something is wrong
        raise ArchiveError(f"the server sent no FITS table: {_message(start) or 'a VOTable'}")
    try:
        rows = tables.fits_rows(part, part.name)
    except TableError as error:
        raise ArchiveError(f"the server sent no whole FITS table ({error}); the same call fetches it again") from error
    limit = max_rows if max_rows is not None and rows >= max_rows else next((n for n in _LIMITS if rows == n), None)
    if limit:
        raise ArchiveError(
            f"the answer was cut off at {limit} rows: ask for more (max_rows, or log in and hand over the file), or for a part of "
            "the sources at a time (… AND random_index BETWEEN …)"
        )
    return rows


class _RefusedError(ArchiveError):
    """The server was there and said no."""


def _open(url, form=None):
    body = None if form is None else urllib.parse.urlencode(form).encode()
    request = urllib.request.Request(url, body, {"User-Agent": "vsh-astrometry"})
    try:
        return urllib.request.urlopen(request, timeout=_TIMEOUT)
    except urllib.error.HTTPError as error:
        with error:
            said = _message(error.read(_BLOCK))
        raise _RefusedError(f"{url} answered {error.code}: {said or error.reason}") from error
    except (OSError, http.client.HTTPException, ValueError) as error:
        reason = getattr(error, "reason", None) or error
        raise ArchiveError(f"{url} cannot be reached: {reason}. Are you online, and is the archive?") from error


def _message(body):
    """What a VOTable, XML or plain text says of an error, in one line."""
    text = body.decode("utf-8", "replace")
    try:
        elements = list(ElementTree.fromstring(text).iter())
    except ElementTree.ParseError:
        return " ".join(text.split())[:500] if "<" not in text else ""
    infos = [each for each in elements if each.tag.endswith("INFO") and each.get("value") in ("ERROR", "OVERFLOW")]
    said = [
        each.text or each.get("value") or ""
        for each in infos or elements
        if each.tag.endswith(("INFO", "message", "detail"))
    ]
    return " ".join(" ".join(said).split())[:500]


def _read(path) -> dict[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _write(path, facts):
    with atomic_write(path) as new:
        Path(new).write_text(json.dumps(facts, indent=1), encoding="utf-8")
