"""What the commands share: arguments and their types, exit status, folders, provenance."""

import argparse
import hashlib
import platform
import sys
import warnings
from pathlib import Path

import numpy as np

from vsh.errors import VshError, VshWarning
from vsh.frames import FRAMES


def guarded(program, action):
    """Run an action; returns the exit status: 0, or 1 with one line that says what was wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VshWarning)  # the report's notes say it
            action()
    except MemoryError:
        return _failed(program, "error: not enough memory: lower the degree, or read fewer sources")
    except (VshError, OSError, ValueError) as error:
        return _failed(program, f"error: {error}")
    except KeyboardInterrupt:
        return _failed(program, "interrupted")
    return 0


def _failed(program, said):
    print(f"{program}: {said}", file=sys.stderr)
    return 1


def folder(path):
    """A folder to write to, made before the work rather than after it."""
    try:
        Path(path).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise VshError(f"--output {path} cannot be made a folder: {error.strerror}") from error
    return Path(path)


def written(path):
    """What the last line of a command says of its folder."""
    return f"written to {path}: {', '.join(sorted(x.name for x in path.iterdir() if x.is_file()))}"


def provenance(paths, options, versions, **counts):
    """Where a result comes from: files and their hashes, counts of rows, options, versions.

    Parameters
    ----------
    paths : path or list of paths
    options : argparse.Namespace
    versions : dict — of this program and whatever else matters
    """
    import astropy
    import scipy

    paths = [Path(str(path)) for path in (paths if isinstance(paths, list) else [paths])]
    hashes = [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths]
    one = len(paths) == 1
    return {
        "catalogue": paths[0].name if one else [path.name for path in paths],
        "sha256": hashes[0] if one else hashes,
        **counts,
        "options": {key: _plain(value) for key, value in vars(options).items() if value is not None and key != "output"},
        "versions": versions | {
            "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
            "astropy": astropy.__version__,
        },
    }  # fmt: skip


def _plain(value):
    return value if isinstance(value, (str, int, float, tuple, list, dict)) else str(value)


def add_reading(parser):
    """The options of every command that reads a catalogue."""
    parser.add_argument("--frame", choices=list(FRAMES), default="icrs", help="axes of the result (default: icrs)")
    parser.add_argument(
        "--columns", type=pairs, metavar="ROLE=NAME,…", help="where the table keeps what: pmra=mu_ra,redshift=z"
    )
    parser.add_argument("--units", type=pairs, metavar="NAME=UNIT,…", help="units of columns: mu_ra=uas/yr")
    parser.add_argument(
        "--on-bad", choices=["raise", "drop"], default="raise", help="rows that cannot be used (default: raise)"
    )
    parser.add_argument("--output", metavar="DIR", type=_named, help="write report, tables and figures to this folder")


def count(least):
    """The type of a whole number of at least `least`."""

    def whole(text):
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"a whole number of at least {least} is wanted, not {text!r}")
        return int(text)

    return whole


def nside(text):
    if not text.isdecimal() or int(text) not in (2**k for k in range(14)):
        raise argparse.ArgumentTypeError(f"a power of two from 1 to 8192 is wanted, not {text!r}")
    return int(text)


def not_negative(text):
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 <= number < float("inf"):
        raise argparse.ArgumentTypeError(f"a number that is not negative is wanted, not {text!r}")
    return number


def positive(text):
    try:
        number = float(text)
    except ValueError:
        number = -1.0
    if not 0 < number < float("inf"):
        raise argparse.ArgumentTypeError(f"a positive number is wanted, not {text!r}")
    return number


def numbers(text):
    """Numbers separated by commas."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = (float("nan"),)
    if not np.isfinite(found).all():
        raise argparse.ArgumentTypeError(f"numbers separated by commas are wanted, not {text!r}")
    return found


def vector(text):
    try:
        found = numbers(text)
    except argparse.ArgumentTypeError:
        found = ()
    if len(found) != 3:
        raise argparse.ArgumentTypeError(f"three numbers x,y,z are wanted, not {text!r}")
    return found


def pairs(text):
    """NAME=VALUE,… as a dict."""
    found = dict(map(str.strip, part.partition("=")[::2]) for part in text.split(","))
    if not all(found) or not all(found.values()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value,name=value")
    return found


def _named(text):
    if not text:
        raise argparse.ArgumentTypeError("names no folder")
    return text
