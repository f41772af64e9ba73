"""Options of the commands: those that several share, and the types of their values."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Sequence

import numpy as np

from vsh.cosmology import VELOCITIES, velocity_from_apex
from vsh.errors import ParameterError
from vsh.system.files import without_folder
from vsh.vector import Vector

_NEGATIVE = re.compile(r"-[\d.]")


def parse(parser: argparse.ArgumentParser, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of a command; a negative number behind an option is its value, with or without an equals sign.

    Among them `command`, the words that repeat the run as a page may hold them: names of files, not where they lie.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        To which options are added.
    arguments : list of str, optional
        In place of those of the command line.
    """
    words = list(sys.argv[1:] if arguments is None else map(str, arguments))
    joined: list[str] = []
    for word in words:
        if joined and _NEGATIVE.match(word) and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    options = parser.parse_args(joined)
    options.command = [parser.prog, *map(_told, words)]
    return options


def _told(word):
    """A word of the command as a page may hold it, the value of --option=value too."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + without_folder(value)


def add_threads(parser: argparse.ArgumentParser) -> None:
    """How many threads, in every command that uses several.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        To which options are added.
    """
    parser.add_argument(
        "--threads", type=count(1), metavar="N", help="one a core unless given; changes no digit of the results"
    )


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """The option without which no result of before is replaced.

    Parameters
    ----------
    parser : argparse.ArgumentParser
        To which options are added.
    """
    parser.add_argument("--overwrite", action="store_true", help="replace results of the same command that are there")


def count(least: int) -> Callable[[str], int]:
    """The type of a whole number of at least `least`.

    Parameters
    ----------
    least : int
        The smallest that is taken.

    Raises
    ------
    argparse.ArgumentTypeError
        The type, if a text is no such number.
    """

    def whole(text):
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"a whole number of at least {least} is wanted, not {text!r}")
        return int(text)

    return whole


def nside(text: str) -> int:
    """The type of a power of two from 1 to 8192.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is not.
    """
    if not text.isdecimal() or int(text) not in (2**k for k in range(14)):
        raise argparse.ArgumentTypeError(f"a power of two from 1 to 8192 is wanted, not {text!r}")
    return int(text)


def not_negative(text: str) -> float:
    """The type of a number of zero or more.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is not.
    """
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"a number that is not negative is wanted, not {text!r}")
    return number


def positive(text: str) -> float:
    """The type of a number above zero.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is not.
    """
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"a positive number is wanted, not {text!r}")
    return number


def numbers(text: str) -> tuple[float, ...]:
    """Numbers separated by commas.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If they are none.
    """
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = (float("nan"),)
    if not np.isfinite(found).all():
        raise argparse.ArgumentTypeError(f"numbers separated by commas are wanted, not {text!r}")
    return found


def vector(text: str) -> tuple[float, ...]:
    """The type of three numbers separated by commas.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is not.
    """
    try:
        found = numbers(text)
    except argparse.ArgumentTypeError:
        found = ()
    if len(found) != 3:
        raise argparse.ArgumentTypeError(f"three numbers separated by commas are wanted, not {text!r}")
    return found


def velocity(text: str) -> Vector:
    """Our velocity as every command takes it: a name, or SPEED,L,B.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If it is neither.
    """
    if text in VELOCITIES:
        return VELOCITIES[text]
    try:
        return velocity_from_apex(*vector(text))
    except (argparse.ArgumentTypeError, ParameterError):
        raise argparse.ArgumentTypeError(
            f"{' or '.join(VELOCITIES)}, or SPEED,L,B is wanted (km/s above zero; Galactic longitude and latitude of the apex, "
            f"degrees), not {text!r}"
        ) from None


def pairs(text: str) -> dict[str, str]:
    """NAME=VALUE,… as a dict.

    Parameters
    ----------
    text : str
        As it was typed.

    Raises
    ------
    argparse.ArgumentTypeError
        If the text is not of that form.
    """
    split = [part.partition("=") for part in text.split(",")]
    found = {name.strip(): value.strip() for name, _, value in split}
    if not all(found) or not all(found.values()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value,name=value")
    return found
