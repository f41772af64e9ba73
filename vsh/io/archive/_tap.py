"""The Table Access Protocol with the standard library: ask, wait, keep the answer as a file.

A job runs at the server (IVOA's TAP 1.1 and UWS 1.1). Beside the file that is to come stands a note of the job, so that
whoever was interrupted waits on for the same one; a file that is there is the answer, and nothing is asked.
"""

import csv
import hashlib
import http.client
import io
import json
import queue
import shutil
import threading
import time
import urllib.error
import urllib.parse
import urllib.request
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

from vsh.io import tables
from vsh.tools.arguments import positive, whole
from vsh.tools.errors import ArchiveError, TableError, first_line
from vsh.tools.files import MARK, atomic_write, digest, hold_lock
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: ESA's archive of Gaia.
ESA = "https://gea.esac.esa.int/tap-server/tap"
#: The table that is sent with a query, by its name in the form.
SENT = "list"
#: Answers that are larger are no lists of names. [bytes]
_MAX_LIST_BYTES = 2**26
#: Synchronous answers of a multiple of so many rows may have been cut off.
_CUT_OFF_MULTIPLE = 1000
#: What ESA's archive gives somebody who is not logged in, at most; an answer of exactly so many rows was cut off.
_ROW_LIMITS = (2_000_000, 3_000_000)
_WAITING_PHASES = ("PENDING", "QUEUED", "EXECUTING", "HELD", "SUSPENDED", "UNKNOWN")
#: Phases of a job that waits to be told to run, and in which it has ended (UWS 1.1, section 2.1.3).
_STOPPED_PHASES, _ENDED_PHASES = ("PENDING", "HELD"), ("COMPLETED", "ERROR", "ABORTED", "ARCHIVED")
_BLOCK_BYTES = 2**20
_TIMEOUT = 60.0


def query(
    adql: str,
    path: PathName,
    url: str = ESA,
    *,
    patience: float = 7200.0,
    interval: float = 2.0,
    max_rows: int | None = None,
    max_bytes: float = 1e11,
    overwrite: bool = False,
    progress: bool = True,
    upload: bytes | None = None,
) -> Path:
    """Fetch the answer to a query as a FITS file, unless it is there already.

    Parameters
    ----------
    adql : str
        The query: one of `vsh.io.archive.GAIA_CRF3`, …, or one's own.
    path : str or Path
        The file, .fits. Its neighbour, with .json behind the name, says what it is the answer to.
    url : str
        Address of the service: what /async is put behind.
    patience : float
        How long to wait for the job, and then once more for its answer. [s]
    interval : float
        How long to wait before asking again, more as time goes by. [s]
    max_rows : int, optional
        The most rows; the server's own limit unless given.
    max_bytes : float
        The largest answer that is fetched.
    overwrite : bool
        Ask again though the file is there; one that is not as it was fetched is never replaced.
    progress : bool
        Show bars, after two seconds.
    upload : bytes, optional
        A VOTable that is sent with the query, which calls it tap_upload.list: `make_upload(…)`.

    Returns
    -------
    Path
        Path of the file, which is whole.

    Raises
    ------
    ArchiveError
        If the server cannot be reached, refuses the query, ends the job with an error, is too slow, or does not send a
        whole table; if the answer was cut off at a limit, or is too large; if the file is the answer to another query,
        of another service, or not as it was fetched. What was asked for is kept: the same call goes on where it was.
    WriteError
        If another process fetches the same file.

    Examples
    --------
    >>> query(GAIA_CRF3, "crf3.fits")  # doctest: +SKIP
    PosixPath('crf3.fits')
    """
    if not isinstance(adql, str) or not adql.strip():
        raise ArchiveError(f"a query is text in ADQL, not {adql!r}")
    path, adql, url = Path(path), adql.strip(), str(url).rstrip("/")
    if tables.format_of(path) != "fits" or path.suffix == ".gz":
        raise ArchiveError(f"{printable(path)}: answers are kept as .fits")
    if not path.absolute().parent.is_dir():
        raise ArchiveError(f"{printable(path)}: there is no such folder")
    if not url.startswith(("http://", "https://")):
        raise ArchiveError(f"{printable(url)} is no address of a service: https://…/tap")
    request = {"query": adql, "url": url, "max_rows": max_rows}
    if upload is not None:
        request["upload"] = hashlib.sha256(upload).hexdigest()
    with hold_lock(path):
        note_path = path.with_name(f"{path.name}.json")
        record = _read_note(note_path)
        if path.exists():
            _check_as_fetched(path, record)
            if not overwrite:
                _check_same_request(path, record, request)
                _check_whole_table(path)
                return path
        old_hash = {"sha256": record["sha256"]} if path.exists() and "sha256" in record else {}
        record = {} if overwrite else record
        job = record.get("job") if all(record.get(key) == value for key, value in request.items()) else None
        job = job if _is_job_of_service(job, url) else None
        row_limit = None if max_rows is None else whole("max_rows", max_rows)
        job = _keep_usable_job(job) or _submit_job(adql, url, row_limit, upload)
        _write_note(note_path, request | {"job": job} | old_hash)
        _wait_for_job(job, positive("patience", patience), positive("interval", interval), progress)
        with atomic_write(path, overwrite) as temporary_path:
            deadline = time.monotonic() + patience
            _download(f"{job}/results/result", temporary_path, deadline, positive("max_bytes", max_bytes), progress)
            n_rows, sha = _count_complete_rows(temporary_path, max_rows), digest(temporary_path)
            timestamp = time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())
            _write_note(note_path, request | {"rows": n_rows, "fetched": timestamp, "sha256": sha})
        return path


def _check_as_fetched(path, record):
    """Raise ArchiveError where a file is not the one that its note is about."""
    for key, reason in (
        ("query", "exists without its note, so its query is unknown"),
        ("sha256", "is there, and its note has no hash of it"),
    ):
        if not record.get(key):
            raise ArchiveError(f"{printable(path)} {reason}: choose another name, or delete it")
    if digest(path) != record["sha256"]:
        raise ArchiveError(
            f"{printable(path)} is not as it was fetched: somebody changed it. Name another, or delete it"
        )


def _check_same_request(path, record, request):
    """Raise ArchiveError where a file is the answer to something else."""
    for key, difference in (
        ("query", "is the answer to another query"),
        ("url", f"is the answer of {printable(record.get('url'))}"),
        ("upload", "is the answer for another list of sources"),
        ("max_rows", "was asked for with another limit of rows"),
    ):
        if record.get(key) != request.get(key):
            raise ArchiveError(f"{printable(path)} {difference}: choose another name, or overwrite it")


def _check_whole_table(path):
    """Count the rows of a file that is there; raise ArchiveError where it is not whole."""
    try:
        return tables.count_fits_rows(path, path.name)
    except TableError as error:
        raise ArchiveError(
            f"{printable(path)} is there, but no whole FITS table ({error}): overwrite it, or choose another name"
        ) from error


def query_rows(adql: str, names: tuple[str, ...], url: str) -> list[list[str]]:
    """The rows of a short answer, in lower case: at once, or by a job where it may have been cut off.

    Parameters
    ----------
    adql : str
        The query.
    names : tuple of str
        The columns that are expected first in each row.
    url : str
        Address of the service.
    """
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": "csv", "QUERY": adql}
    with _open_url(f"{url}/sync", form) as answer:
        rows = _parse_csv_rows(_read_at_most(answer, _MAX_LIST_BYTES, time.monotonic() + 120), names, url)
    if rows and len(rows) % _CUT_OFF_MULTIPLE == 0:
        job = _submit_job(adql, url, None, table_format="csv")
        _wait_for_job(job, 600.0, 1.0, False)
        with _open_url(f"{job}/results/result") as answer:
            rows = _parse_csv_rows(_read_at_most(answer, _MAX_LIST_BYTES, time.monotonic() + 120), names, url)
    return rows


def _parse_csv_rows(body, names, url):
    """The first columns of an answer in CSV."""
    rows = list(csv.reader(io.StringIO(body.decode("utf-8", "replace"))))
    if not rows or [cell.strip().lower() for cell in rows[0]][: len(names)] != list(names):
        raise ArchiveError(f"{url} sent no list of columns: {printable(body[:80].decode('utf-8', 'replace'))}")
    whole_rows = [row[: len(names)] for row in rows[1:] if len(row) >= len(names)]
    return [[cell.strip().strip('"').lower() for cell in row] for row in whole_rows]


def _submit_job(adql, url, max_rows, upload=None, table_format="fits"):
    """The address of a new job."""
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": table_format, "QUERY": adql, "PHASE": "RUN"}
    if max_rows is not None:
        form["MAXREC"] = str(max_rows)
    if upload is not None:
        form["UPLOAD"] = f"{SENT},param:{SENT}"
    with _open_url(f"{url}/async", form, upload=upload) as answer:
        job = answer.geturl()
    if job.rstrip("/").endswith("/async"):
        raise ArchiveError(f"{url} took no job: is it the address of a TAP service?")
    return job


def _is_job_of_service(job, url):
    """Return whether an address is one of a service: a note may have been written by anybody."""
    if not isinstance(job, str):
        return False
    address, service = urllib.parse.urlsplit(job), urllib.parse.urlsplit(url)
    return (address.scheme, address.netloc) == (service.scheme, service.netloc)


def _keep_usable_job(job):
    """A job of before, if the server still knows it and it did not fail."""
    if job is None:
        return None
    try:
        return job if _read_job_phase(job) in (*_WAITING_PHASES, "COMPLETED") else None
    except _RefusedError:
        return None


def _read_job_phase(job, deadline=None):
    with _open_url(f"{job}/phase", deadline=deadline) as answer:
        phase = _read_at_most(answer, 1000, _compute_short_deadline(deadline)).decode("utf-8", "replace").strip()
    if phase not in (*_WAITING_PHASES, *_ENDED_PHASES):
        raise ArchiveError(f"{job}/phase sent {printable(phase[:80])!r}, which is no phase of a job")
    return phase


def _compute_short_deadline(deadline=None):
    """Until when a short answer is waited for, by the monotonic clock."""
    soon = time.monotonic() + _TIMEOUT
    return soon if deadline is None else min(soon, max(deadline, time.monotonic() + 1.0))


def _read_at_most(answer, max_bytes, deadline):
    """Read a limited number of bytes of an answer, until `deadline` at the latest; all that it announced, or none."""
    body = bytearray()
    try:
        while len(body) < max_bytes and (block := answer.read1(max_bytes - len(body))):
            body += block
            if time.monotonic() > deadline:
                raise ArchiveError("the server sends too slowly: the same call later waits on")
    except (OSError, http.client.HTTPException) as error:
        raise ArchiveError(f"{answer.geturl()}: the connection broke ({first_line(error)}); try again") from error
    if answer.length and len(body) < max_bytes:
        raise ArchiveError(
            f"{answer.geturl()}: {len(body)} of {len(body) + answer.length} bytes came; the same call fetches it again"
        )
    return bytes(body)


def _wait_for_job(job, patience, interval, progress):
    deadline, n_failures, is_started = time.monotonic() + patience, 0, False
    with progress_bar(words="the archive is at work", shown=progress, unit=" s", bar_format="{desc}: {elapsed}") as bar:
        while True:
            try:
                phase = _read_job_phase(job, deadline)
                if phase in _STOPPED_PHASES and not is_started:
                    _open_url(f"{job}/phase", {"PHASE": "RUN"}, deadline).close()
                    is_started = True
                n_failures = 0
            except _RefusedError:
                raise
            except ArchiveError:
                n_failures += 1
                if n_failures > 3:  # a network may be away for a moment
                    raise
                phase = "UNKNOWN"
            if phase not in _WAITING_PHASES:
                break
            if time.monotonic() > deadline:
                raise ArchiveError(f"{job} is {phase.lower()} after {patience:g} s: the same call later waits on")
            bar.set_description(f"the archive is at work ({phase.lower()})")
            bar.update(0)
            time.sleep(interval)
            interval = min(1.3 * interval, 30.0)
    if phase != "COMPLETED":
        with _open_url(f"{job}/error") as answer:
            message = _extract_error(_read_at_most(answer, _BLOCK_BYTES, _compute_short_deadline()))
        raise ArchiveError(f"the query ended {phase.lower()}: {message or 'the server does not say why'}")


def _download(address, path, deadline, max_bytes, progress):
    """An answer into a file: until `deadline` by the monotonic clock, and of at most so many bytes."""
    with _open_url(address, deadline=deadline) as answer, path.open("wb") as file:
        length = answer.headers.get("Content-Length") or ""
        n_bytes = int(length) if length.isascii() and length.isdigit() else 0
        _check_answer_fits(n_bytes, path, max_bytes)
        with progress_bar(total=n_bytes or None, words="fetching", shown=progress, unit="B", unit_scale=True) as bar:
            while True:
                try:
                    block = answer.read1(_BLOCK_BYTES)
                except (OSError, http.client.HTTPException) as error:
                    raise ArchiveError(f"{address}: the connection was cut ({error}); call it again") from error
                if not block:
                    break
                file.write(block)  # what the disk says of it is its own, not the network's
                bar.update(len(block))
                if time.monotonic() > deadline:
                    raise ArchiveError(
                        f"{address}: {file.tell()} bytes came within the time (patience): the same call later fetches "
                        "it again"
                    )
                if file.tell() > max_bytes:
                    raise ArchiveError(f"{address}: the answer is above {max_bytes:g} bytes (max_bytes): ask for less")
        if n_bytes and file.tell() != n_bytes:
            raise ArchiveError(f"{address}: {file.tell()} of {n_bytes} bytes came; the same call fetches it again")


def _check_answer_fits(n_bytes, path, max_bytes):
    """Raise ArchiveError before the first byte of an answer that is too large."""
    if n_bytes > max_bytes:
        raise ArchiveError(f"the answer has {n_bytes} bytes, more than {max_bytes:g} (max_bytes): ask for less")
    free_space = shutil.disk_usage(path.parent).free
    if n_bytes > free_space:
        raise ArchiveError(f"the answer has {n_bytes} bytes, and the disk has room for {free_space}")


def _count_complete_rows(path, max_rows):
    """Count the rows of the table, once it is known to be complete."""
    with path.open("rb") as file:
        first_block = file.read(_BLOCK_BYTES)
    if first_block.lstrip()[:5] in (b"<?xml", b"<VOTA"):  # TAP's way to say that something is wrong
        raise ArchiveError(f"the server sent no FITS table: {_extract_error(first_block) or 'a VOTable'}")
    try:
        rows = tables.count_fits_rows(path, path.name)
    except TableError as error:
        raise ArchiveError(f"the server sent no whole FITS table ({error}); the same call fetches it again") from error
    limit = max_rows if max_rows is not None and rows >= max_rows else next((n for n in _ROW_LIMITS if rows == n), None)
    if limit:
        raise ArchiveError(
            f"the answer was cut off at {limit} rows: ask for more (max_rows, or log in and hand over the file), or for"
            " a part of the sources at a time (… AND random_index BETWEEN …)"
        )
    return rows


class _RefusedError(ArchiveError):
    """The server was there and said no."""


def _encode_multipart(form, upload):
    """Body and type of a form with a file, as browsers send them (RFC 7578)."""
    boundary = f"vsh{hashlib.sha256(upload).hexdigest()}"
    form_fields = [(f'form-data; name="{name}"', "", str(value).encode()) for name, value in form.items()]
    form_fields.append(
        (f'form-data; name="{SENT}"; filename="{SENT}.vot"', "Content-Type: application/x-votable+xml\r\n", upload)
    )
    body_parts = [
        f"--{boundary}\r\nContent-Disposition: {head}\r\n{content_type}\r\n".encode() + value + b"\r\n"
        for head, content_type, value in form_fields
    ]
    return b"".join([*body_parts, f"--{boundary}--\r\n".encode()]), f"multipart/form-data; boundary={boundary}"


def _open_url(url, form=None, deadline=None, upload=None):
    """The answer to a request, once its head is there; in a thread, since a head that trickles obeys no time limit."""
    if urllib.parse.urlsplit(url).scheme not in ("http", "https"):
        raise ArchiveError(f"{printable(url)} is no address of a service: https://…")
    headers = {"User-Agent": "vsh-astrometry"}
    body = None if form is None else urllib.parse.urlencode(form).encode()
    if upload is not None:
        body, headers["Content-Type"] = _encode_multipart(form, upload)
    request = urllib.request.Request(url, body, headers)
    answers: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def send_request():
        try:
            answers.put(urllib.request.urlopen(request, timeout=_TIMEOUT))
        except BaseException as error:  # handed on to whoever waits
            answers.put(error)

    threading.Thread(target=send_request, daemon=True).start()
    try:
        answer = answers.get(timeout=max(_compute_short_deadline(deadline) - time.monotonic(), 0.1))
    except queue.Empty:
        raise ArchiveError(f"{url} does not answer in time") from None
    if not isinstance(answer, BaseException):
        return answer
    if isinstance(answer, urllib.error.HTTPError):
        with answer:
            message = _extract_error(_read_at_most(answer, _BLOCK_BYTES, _compute_short_deadline()))
        raise _RefusedError(f"{url} answered {answer.code}: {message or answer.reason}") from answer
    if isinstance(answer, (OSError, http.client.HTTPException, ValueError)):
        reason = getattr(answer, "reason", None) or answer
        raise ArchiveError(f"{url} cannot be reached: {reason}. Are you online, and is the archive?") from answer
    raise answer


def _extract_error(body):
    """Extract the error message of a VOTable, XML or plain text, in one line."""
    text = body.decode("utf-8", "replace")
    try:
        elements = list(ElementTree.fromstring(text).iter())
    except ElementTree.ParseError:
        return " ".join(text.split())[:500] if "<" not in text else ""
    infos = [node for node in elements if node.tag.endswith("INFO") and node.get("value") in ("ERROR", "OVERFLOW")]
    messages = [
        node.text or node.get("value") or ""
        for node in infos or elements
        if node.tag.endswith(("INFO", "message", "detail"))
    ]
    return " ".join(" ".join(messages).split())[:500]


def _read_note(path) -> dict[str, Any]:
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return record if isinstance(record, dict) else {}


def _write_note(path, facts):
    with atomic_write(path, overwrite=True) as temporary_path:
        Path(temporary_path).write_text(json.dumps({"program": MARK} | facts, indent=1), encoding="utf-8")
