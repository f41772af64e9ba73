"""How a command runs: exit status, what it prints, where its results come from."""

from __future__ import annotations

import argparse
import hashlib
import logging
import platform
import shlex
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.checks.notes import printable
from vsh.commands.configuration import NOT_KEPT
from vsh.commands.parsing import parse, without_folder
from vsh.commands.reading import standard_input
from vsh.errors import VshError, VshWarning
from vsh.system.logs import PACKAGES
from vsh.system.parallel import limited
from vsh.system.progress import without_bars

#: Options that change no result, and what the parser found besides.
NOT_TOLD = (*NOT_KEPT, "command", "given", "program", "expected")
_LOG = logging.getLogger(__name__)


def entry(
    words: Any, act: Callable[[argparse.Namespace], object]
) -> tuple[Callable[..., int], Callable[[argparse.Namespace], int]]:
    """The two ways into a command: `main(arguments)`, and `run(options)` for options that are parsed already.

    Parameters
    ----------
    words : module of `vsh.commands.options`
        Its options.
    act : function of the options
        What it does.

    Returns
    -------
    main, run : functions
        Both return the exit status: 0 or 1 (bad data); `main` exits with 2 on bad usage.
    """

    def run(options: argparse.Namespace) -> int:
        return guarded(options, lambda: act(options))

    def main(arguments: Sequence[str] | None = None) -> int:
        return run(parse(words, arguments))

    return main, run


def guarded(options: argparse.Namespace, action: Callable[[], object]) -> int:
    """Run an action; returns the exit status: 0, or 1 with one line that says what was wrong.

    Parameters
    ----------
    options : argparse.Namespace
        Of `vsh.commands.parsing.parse`.
    action : function without arguments
        What the command does.

    Returns
    -------
    int
    """
    program = options.program
    try:
        with (
            warnings.catch_warnings(),
            limited(getattr(options, "threads", None)),
            logged(options),
            without_bars(options.quiet),
            standard_input(options),
        ):
            warnings.simplefilter("ignore", VshWarning)  # the report's notes say it
            _say_what_changed(options)
            action()
    except MemoryError:
        return _failed(program, "error: not enough memory: lower the degree, or read fewer sources")
    except BrokenPipeError:  # whoever read our output has seen enough
        sys.stdout = None
        return 0
    except (VshError, OSError) as error:
        return _failed(program, f"error: {error}")
    except KeyboardInterrupt:
        return _failed(program, "interrupted")
    return 0


@contextmanager
def logged(options: argparse.Namespace) -> Iterator[None]:
    """What our packages log goes to the file of --log meanwhile, begun by the command and ended by how it ended.

    Parameters
    ----------
    options : argparse.Namespace
        With `log`, `program` and `command`.

    Raises
    ------
    VshError
        If the file cannot be written.
    """
    if options.log is None:
        yield
        return
    try:
        handler = logging.FileHandler(options.log, encoding="utf-8")
    except OSError as error:
        raise VshError(f"--log {printable(options.log)}: {error.strerror}") from None
    handler.setFormatter(logging.Formatter("%(asctime)s %(levelname)-7s %(name)s: %(message)s"))
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


def _say_what_changed(options):
    """Files that are not those that a configuration was written for."""
    for path in [Path(value) for value in vars(options).values() if options.expected and isinstance(value, str)]:
        known = options.expected.get(path.name)
        if known is not None and path.exists() and _hash(path) != known:
            said = f"{options.program}: note: {path.name} is not the file that the configuration was written for"
            print(printable(said), file=sys.stderr)


def _failed(program, said):
    print(f"{program}: {printable(said)}", file=sys.stderr)
    return 1


def say(text: object) -> None:
    """Print text without the control characters that file and column names may bring along.

    Parameters
    ----------
    text : object
        What to print.
    """
    print("\n".join(printable(line) for line in str(text).split("\n")))


def written(path: object, files: Iterable[str]) -> str:
    """What the last line of a command says of its folder.

    Parameters
    ----------
    path : str or Path
        The folder.
    files : iterable of str
        In it.
    """
    return f"written to {path}: {', '.join(sorted(files))}"


def provenance(paths: Any, options: argparse.Namespace, **counts: Any) -> dict[str, Any]:
    """Where a result comes from: files and their hashes, counts of rows, options, versions.

    Parameters
    ----------
    paths : path or list of paths
        The files.
    options : argparse.Namespace
        The other arguments.
    **counts
        Rows by what became of them.
    """
    import astropy
    import scipy

    paths = [Path(str(path)) for path in (paths if isinstance(paths, list) else [paths])]
    hashes = [_hash(path) for path in paths]
    one = len(paths) == 1
    return {
        "catalogue": paths[0].name if one else [path.name for path in paths],
        "sha256": hashes[0] if one else hashes,
        **counts,
        "options": {key: _plain(value, paths) for key, value in vars(options).items() if value is not None and key not in NOT_TOLD},
        "versions": {
            "vsh-astrometry": vsh.__version__, "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
            "astropy": astropy.__version__,
        },
    }  # fmt: skip


def _hash(path):
    """SHA-256 of a file, or of the names and hashes of all files of a folder."""
    if path.is_dir():
        inside = sorted(file for file in path.rglob("*") if file.is_file())
        digest = hashlib.sha256("\n".join(f"{f.relative_to(path)} {_hash(f)}" for f in inside).encode())
        return digest.hexdigest()
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _plain(value, paths):
    if isinstance(value, str):
        return Path(value).name if value in map(str, paths) else without_folder(value)
    return value if isinstance(value, (int, float, tuple, list, dict)) else str(value)
