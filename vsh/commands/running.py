"""How a command runs: exit status, what it prints, where its results come from."""

import argparse
import logging
import os
import platform
import re
import shlex
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.commands.parsing import NOT_KEPT, WRITTEN, hide_folder, parse_options
from vsh.commands.reading import prepare_input_catalogues
from vsh.tools.errors import VshError, VshWarning
from vsh.tools.files import check_not_read, digest, protect_files
from vsh.tools.formats import hide_address_secrets, hide_secrets, is_address
from vsh.tools.parallel import hide_elapsed_time, limit_threads, show_elapsed_time, without_progress_bars
from vsh.tools.printing import PACKAGES, format_os_error, guard_printing, mute_if_broken, mute_output, printable

#: Options that change no result, and what the parser found besides.
NOT_TOLD = (*sorted({*NOT_KEPT} - {"checkpoint", "url"}), "log", "threads", "command", "given", "program", "expected")
_LOG = logging.getLogger(__name__)
#: What else of the namespace names no file that is read.
_NOT_INPUTS = ("command", "given", "program", "expected", "show", "url")
_LOG_LINE = re.compile(
    rb"\d{4}-\d\d-\d\d \d\d:\d\d:\d\d,\d{3} (DEBUG|INFO|WARNING|ERROR|CRITICAL) +(vsh|sim|fit|study)\b"
)


class _OneLineFormatter(logging.Formatter):
    """Records without the control characters and line breaks that names of files and columns may bring along."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        record.message = printable(hide_secrets(record.message))
        return super().formatMessage(record)

    def formatException(self, error: Any) -> str:
        return hide_secrets(super().formatException(error))


def make_entry(
    module: str, action: Callable[[argparse.Namespace], object]
) -> tuple[Callable[..., int], Callable[[argparse.Namespace], int]]:
    """The two ways into a command of a module: `main(arguments)`, and `run(options)` for options that are parsed."""

    def run(options: argparse.Namespace) -> int:
        return run_safely(options, lambda: action(options))

    def main(arguments: Sequence[str] | None = None) -> int:
        with guard_printing():
            return run(parse_options(sys.modules[module], arguments))

    return main, run


def _describe_absent_options(options, message):
    """Words on options of reading that a message names and a command, such as vsh-link, does not have."""
    names = [name for name in ("where", "units", "columns", "on-bad") if f"--{name}" in message]
    absent = " and ".join(f"--{name}" for name in names if not hasattr(options, name.replace("-", "_")))
    return f" ({options.program} has no {absent}: change the table, or read it in Python)" if absent else ""


def run_safely(options: argparse.Namespace, action: Callable[[], object]) -> int:
    """Run an action; returns the exit status: 0, or 1 with one line that says what was wrong."""
    program = options.program
    names = [name for name in _THREAD_VARIABLES if not os.environ.get(name, "1").strip().isdecimal()]
    if names:
        return _report_failure(program, f"error: {names[0]} is {os.environ[names[0]]!r}, which is no number of threads")
    os.environ["MPLBACKEND"] = "agg"  # a command writes files only, where there may be no screen
    try:
        with (
            warnings.catch_warnings(),
            limit_threads(getattr(options, "threads", None)),
            protect_files(_list_input_paths(options)),
            write_log(options),
            without_progress_bars(options.quiet),
            prepare_input_catalogues(options),
            _interrupt_on_terminate(),
            show_elapsed_time(program),
        ):
            warnings.simplefilter("ignore", VshWarning)  # the report's notes say it
            _print_changed_file_notes(options)
            action()
    except MemoryError:
        return _report_failure(program, "error: not enough memory: lower the degree, or read fewer sources")
    except np.linalg.LinAlgError as error:
        text = f"error: a matrix cannot be solved with ({error}): too few sources, or motions or errors in a wrong unit"
        return _report_failure(program, f"{text}, so that they differ by many powers of ten (--units)")
    except BrokenPipeError:  # whoever read our output has seen enough
        mute_output()
        return 0
    except OSError as error:
        mute_if_broken()
        return _report_failure(program, f"error: {format_os_error(error)}")
    except VshError as error:
        return _report_failure(program, f"error: {error}{_describe_absent_options(options, str(error))}")
    except KeyboardInterrupt as error:
        options.interrupted_by = error.args[0] if error.args else signal.SIGINT
        return _report_failure(program, "interrupted")
    return 0


#: By which libraries are told how many threads to use.
_THREAD_VARIABLES = ("OMP_NUM_THREADS", "DUCC0_NUM_THREADS")


@contextmanager
def _interrupt_on_terminate():
    """Meanwhile SIGTERM ends the run as Ctrl-C does, so that what is unfinished is taken away."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    process_id = os.getpid()

    def interrupt(signal_number, frame):
        if os.getpid() == process_id:
            raise KeyboardInterrupt(signal_number)
        os._exit(128 + signal_number)  # a worker that was forked

    previous_handler = signal.signal(signal.SIGTERM, interrupt)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, previous_handler)


def _list_input_paths(options):
    """List the files and folders that a run reads."""
    values = [value for name, value in vars(options).items() if name not in (*WRITTEN, *_NOT_INPUTS)]
    texts = [entry for value in values for entry in (value if isinstance(value, (tuple, list)) else (value,))]
    return [text for text in texts if isinstance(text, (str, Path)) and text not in ("", "-") and os.path.lexists(text)]


class _LogHandler(logging.FileHandler):
    """A log that says once where it could not be written on, and does not end the run for it."""

    failure: str | None = None

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        self.failure = self.failure or (format_os_error(error) if isinstance(error, OSError) else str(error))

    def close(self) -> None:
        try:
            super().close()
        except OSError as error:
            self.failure = self.failure or format_os_error(error)


def _check_log(options):
    """Raise VshError where a log is no place of its own: what is read or written, or a file that is no log of ours."""
    path, label = Path(options.log), f"the log {printable(options.log)}"
    check_not_read(path, label)
    outputs = [getattr(options, name, None) for name in WRITTEN if name != "log"]
    for output in filter(None, outputs):
        log_path, output_path = Path(os.path.realpath(path)), Path(os.path.realpath(output))
        if log_path == output_path or output_path in log_path.parents:
            raise VshError(f"{label} is in {printable(output)}, which the run writes: name another file")
    if path.is_dir():
        raise VshError(f"{label} is a folder, not a file")
    if path.is_fifo():
        raise VshError(f"{label} is a pipe, whose other end the run would wait for: name a file")
    if path.is_file() and path.stat().st_size:
        with path.open("rb") as file:
            if not _LOG_LINE.match(file.read(200)):
                raise VshError(f"{label} holds something else than a log of this program: name another file")


@contextmanager
def write_log(options: argparse.Namespace) -> Iterator[None]:
    """Write the log of our packages to the file of VSH_LOG, with the command and how it ended."""
    if options.log is None:
        yield
        return
    _check_log(options)
    try:
        handler = _LogHandler(options.log, encoding="utf-8")
    except OSError as error:
        raise VshError(f"the log {printable(options.log)}: {error.strerror}") from None
    handler.setFormatter(_OneLineFormatter("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
    loggers = [logging.getLogger(name) for name in PACKAGES]
    levels = [logger.level for logger in loggers]
    for logger in loggers:
        logger.addHandler(handler)
        logger.setLevel(logging.DEBUG)
    try:
        _LOG.info("%s", shlex.join(options.command))
        yield
        _LOG.info("%s is done", options.program)
    except BaseException as error:
        _LOG.error(
            "%s: %s", type(error).__name__, printable(error), exc_info=not isinstance(error, (VshError, OSError))
        )
        raise
    finally:
        for logger, level in zip(loggers, levels, strict=True):
            logger.removeHandler(handler)
            logger.setLevel(level)
        handler.close()
        if handler.failure:
            print(f"{options.program}: the log is not complete: {printable(handler.failure)}", file=sys.stderr)


def _print_changed_file_notes(options):
    """Print a note on each file that is not the one that the configuration was written for."""
    values = vars(options).values() if options.expected else ()
    paths_given = [text for value in values for text in (value if isinstance(value, list) else [value])]
    for path in [Path(text) for text in paths_given if isinstance(text, str)]:
        checksum = options.expected.get(path.name)
        if checksum is not None and path.exists() and digest(path) != checksum:
            line = f"{options.program}: note: {path.name} is not the file that the configuration was written for"
            print(printable(line), file=sys.stderr)


def _report_failure(program, reason):
    # One line, whatever a name holds.
    print(f"{program}: {printable(hide_secrets(str(reason)))}".replace("\n", r"\n"), file=sys.stderr)
    return 1


def print_text(text: object) -> None:
    """Print text without the control characters that file and column names may bring along."""
    hide_elapsed_time()
    print("\n".join(printable(line) for line in hide_secrets(str(text)).split("\n")))


def provenance(
    paths: Any, options: argparse.Namespace, opened: Mapping[str, tuple[str, Any]] | None = None, **counts: Any
) -> dict[str, Any]:
    """Provenance of a result: files and their hashes when they were opened, counts of rows, options, versions."""
    import astropy
    import scipy

    locations = [str(path) for path in (paths if isinstance(paths, list) else [paths])]
    paths = [Path(hide_address_secrets(path)) for path in locations]
    # What lies at an address is not fetched once more for its hash.
    opened_files = opened or {}
    hashes = [
        "" if is_address(name) else opened_files[name][0] if name in opened_files else digest(path)
        for name, path in zip(locations, paths, strict=True)
    ]
    is_single = len(paths) == 1
    return {
        "catalogue": paths[0].name if is_single else [path.name for path in paths],
        "sha256": hashes[0] if is_single else hashes,
        **counts,
        "options": {
            key: _format_provenance_value(value, paths)
            for key, value in vars(options).items()
            if value is not None and key not in NOT_TOLD and not (key == "workers" and isinstance(value, str))
        },
        "versions": {
            "vsh-astrometry": vsh.__version__,
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "astropy": astropy.__version__,
        },
    }


def _format_provenance_value(value, paths):
    if isinstance(value, str):
        return Path(value).name if value in map(str, paths) else hide_folder(value)
    return value if isinstance(value, (int, float, tuple, list, dict)) else str(value)
