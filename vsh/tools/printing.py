"""What is printed reaches its reader, or the command ends in one line; what `logging` is told: steps and seconds.

This file needs the standard library alone.
"""

import contextlib
import errno
import logging
import os
import re
import sys
import textwrap
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from importlib import import_module
from typing import Any, ParamSpec, TypeVar

from vsh.tools.parallel import name_step, set_variable_meanwhile

_CONTROL = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069]")


def printable(text: object) -> str:
    """Text without the control characters that a terminal would obey: \\x1b in place of an escape."""
    return _CONTROL.sub(lambda match: match.group().encode("unicode_escape").decode(), str(text))


def format_labelled_lines(lines: Iterable[tuple[str, str]]) -> str:
    """Lines of text behind their labels, which stand in a column."""
    pairs = list(lines)
    width = max([15, *(len(label) + 2 for label, _ in pairs)])
    return "\n".join(f"{label:{width}}{text}" for label, text in pairs)


#: What stands before the text of a line: blanks, a mark of a list, or a label in a column.
_LINE_PREFIX = re.compile(r"( *(?:- |\S+(?: \S+)* {2,}(?=\S))?)(.*)")


def wrap_lines(text: str, width: int) -> str:
    """Lines no longer than this, broken between words below where their text begins; rows of tables stay whole."""
    return "\n".join(_wrap_line(line, width) if len(line) > width else line for line in text.split("\n"))


def _wrap_line(line, width):
    ((prefix, words),) = _LINE_PREFIX.findall(line)[:1]
    if "  " in words or len(prefix) > width // 2:
        return line
    unbreakable = re.sub(r" ([±=<]) ", "\u00a0\\1\u00a0", words)  # a number stays with its error and its name
    lines = textwrap.wrap(unbreakable, max(width - len(prefix), 20), break_long_words=False, break_on_hyphens=False)
    return prefix + ("\n" + " " * len(prefix)).join(lines).replace("\u00a0", " ")


#: Signs of a text in LaTeX; longer ones first.
_TEX = {
    "µas/yr": r"$\mu$as\,yr$^{-1}$", "µas": r"$\mu$as", "χ²": r"$\chi^2$",
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$",
    "±": r"$\pm$", "µ": r"\textmu{}", "²": "$^2$", "°": r"$^\circ$", "≤": r"$\leq$", "≥": r"$\geq$", "−": "$-$",
    "–": "--", "…": r"\ldots ", "Λ": r"$\Lambda$", "Σ": r"$\Sigma$", "Ω": r"$\Omega$", "α": r"$\alpha$",
    "β": r"$\beta$", "δ": r"$\delta$", "ε": r"$\epsilon$", "λ": r"$\lambda$", "ν": r"$\nu$", "σ": r"$\sigma$",
    "ϖ": r"$\varpi$", "ω": r"$\omega$", "ã": r"$\tilde a$", "|": "$|$", "∫": r"$\int$", "√": r"$\surd$",
} | {letter: f"\\{letter}" for letter in "&%$#_{}"}  # fmt: skip
_TEX_SIGN = re.compile("|".join(map(re.escape, _TEX)))
_POWER_OF_TEN = re.compile(r"\b(\d+(?:\.\d+)?)e([+-]\d+)\b")


def latex_text(text: object) -> str:
    """Text that LaTeX prints as it is, with its own minus and powers of ten for numbers."""
    with_minuses = re.sub(r"(?<![\w-])-(?=\d)", "−", printable(text))
    pieces = _POWER_OF_TEN.split(with_minuses)
    texts = [_TEX_SIGN.sub(lambda sign: _TEX[sign[0]], piece) for piece in pieces[::3]]
    numbers = zip(pieces[1::3], pieces[2::3], texts[1:], strict=True)
    return texts[0] + "".join(rf"${value} \times 10^{{{int(power)}}}${piece}" for value, power, piece in numbers)


def one_line_text(name: object) -> str:
    """A name out of somebody's table, printable, its line breaks too: it cannot look like a line of ours."""
    return printable(name).replace("\n", "\\n")


@contextmanager
def guard_printing() -> Iterator[None]:
    """Print letters that standard output cannot take as ?, report a full disk, end quietly where a pipe closes."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):
            stream.reconfigure(errors="replace")
    try:
        try:
            yield
        finally:
            if sys.stdout is not None:
                sys.stdout.flush()
    except BrokenPipeError:
        mute_output()
        raise SystemExit(0) from None
    except OSError as error:
        mute_output()
        if sys.stderr is not None:
            print(f"vsh: error: not all could be printed: {format_os_error(error)}", file=sys.stderr)
        raise SystemExit(1) from None


def mute_output() -> None:
    """Discard what is or waits to be written to standard output, also when Python ends."""
    null_descriptor = os.open(os.devnull, os.O_WRONLY)
    with contextlib.suppress(OSError, ValueError, AttributeError):
        os.dup2(null_descriptor, sys.stdout.fileno())
    os.close(null_descriptor)


def mute_if_broken() -> None:
    """After an error in printing: do not try, and fail, again with what still waits for standard output."""
    try:
        if sys.stdout is not None:
            sys.stdout.flush()
    except OSError:
        mute_output()


def format_os_error(error: OSError) -> str:
    """Message of the system, with its file."""
    suffix = f": {error.filename}" if error.filename else ""
    if error.errno == errno.ENOSPC:
        return f"the disk is full{suffix}"
    if error.errno == errno.EFBIG:
        return f"a file would be larger than is allowed here{suffix}"
    if error.strerror and error.filename:
        return f"{error.filename}: {error.strerror}"
    return error.strerror or str(error) or type(error).__name__


def import_quietly(name: str, tries: int = 5) -> Any:
    """Import a library, and show none of its warnings.

    arviz, which corner imports too, warns of its own next version once a day by a stamp in the
    user's cache: a test run that passed yesterday would fail today, and a report begin with it.
    Two processes that write the stamp at once are in each other's way; the second try finds it there.
    """
    for attempt in range(tries):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return import_module(name)
        except FileNotFoundError:
            if attempt == tries - 1:
                raise
            time.sleep(0.2)


#: Within a step that tells of itself its own steps do not.
_IS_WITHIN_STEP: ContextVar[bool] = ContextVar("inside", default=False)
_P = ParamSpec("_P")
_T = TypeVar("_T")

#: Packages with loggers; nothing is printed unless somebody listens to them.
PACKAGES = ("vsh", "sim", "fit", "study")
for _name in PACKAGES:
    logging.getLogger(_name).addHandler(logging.NullHandler())


def log_calls(step_name: str) -> Callable[[Callable[_P, _T]], Callable[_P, _T]]:
    """A decorator: at level INFO the logger of a function's module says what came out of it, and how long it took.

    Examples
    --------
    >>> import logging, sys
    >>> logger = logging.getLogger(__name__)
    >>> @log_calls("half")
    ... def half(x):
    ...     return x / 2
    >>> half(4)
    2.0
    """

    def decorate(function: Callable[_P, _T]) -> Callable[_P, _T]:
        logger = logging.getLogger(function.__module__)

        @wraps(function)
        def call_and_log(*args: _P.args, **options: _P.kwargs) -> _T:
            with name_step(step_name):
                if not logger.isEnabledFor(logging.INFO):
                    return function(*args, **options)
                start_time = time.perf_counter()
                with set_variable_meanwhile(_IS_WITHIN_STEP, True):
                    result = function(*args, **options)
            return log_result(logger, step_name, result, start_time)

        return call_and_log

    return decorate


def log_result(logger: logging.Logger, step_name: str, result: _T, start_time: float) -> _T:
    """Log a result, and give it back, where a decorator would stand between a warning and its caller."""
    if not _IS_WITHIN_STEP.get():
        logger.info("%s: %s, %.3g s", step_name, _format_short_repr(result), time.perf_counter() - start_time)
    return result


def _format_short_repr(result):
    """The repr of a result where it is one short line; otherwise the name of its type."""
    lines = repr(result).strip("<>").splitlines()
    return lines[0] if len(lines) == 1 and len(lines[0]) < 200 else type(result).__name__
