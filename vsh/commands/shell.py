"""What the commands share: arguments and their types, exit status, provenance."""

import argparse
import hashlib
import platform
import re
import sys
import warnings
from pathlib import Path

import numpy as np

from vsh.checks.notes import printable
from vsh.cosmology import VELOCITIES, velocity_from_apex
from vsh.errors import ParameterError, VshError, VshWarning
from vsh.sky.frames import FRAMES

_NEGATIVE = re.compile(r"-[\d.]")


def parse(parser, arguments=None):
    """The options of a command; a negative number behind an option is its value, with or without an equals sign."""
    words = list(sys.argv[1:] if arguments is None else map(str, arguments))
    joined = []
    for word in words:
        if joined and _NEGATIVE.match(word) and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    return parser.parse_args(joined)


def guarded(program, action):
    """Run an action; returns the exit status: 0, or 1 with one line that says what was wrong."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", VshWarning)  # the report's notes say it
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


def _failed(program, said):
    print(f"{program}: {printable(said)}", file=sys.stderr)
    return 1


def say(text):
    """Print text without the control characters that file and column names may bring along."""
    print("\n".join(printable(line) for line in str(text).split("\n")))


def written(path, files):
    """What the last line of a command says of its folder."""
    return f"written to {path}: {', '.join(sorted(files))}"


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
    hashes = [_hash(path) for path in paths]
    one = len(paths) == 1
    return {
        "catalogue": paths[0].name if one else [path.name for path in paths],
        "sha256": hashes[0] if one else hashes,
        **counts,
        "options": {key: _plain(value, paths) for key, value in vars(options).items() if value is not None and key not in ("output", "html", "overwrite")},
        "versions": versions | {
            "python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__,
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
    if isinstance(value, str) and value in map(str, paths):
        return Path(value).name  # results are handed round: names of files, not where they lie on this disk
    return value if isinstance(value, (str, int, float, tuple, list, dict)) else str(value)


def add_reading(parser):
    """The options of every command that reads a catalogue."""
    parser.add_argument("--frame", choices=list(FRAMES), default="icrs", help="axes of the result (default: icrs)")
    parser.add_argument(
        "--catalogue-frame", choices=list(FRAMES), help="axes of the catalogue's positions and motions (default: icrs)"
    )
    parser.add_argument(
        "--columns", type=pairs, metavar="ROLE=NAME,…", help="where the table keeps what: pmra=mu_ra,redshift=z"
    )
    parser.add_argument("--units", type=pairs, metavar="NAME=UNIT,…", help="units of columns: mu_ra=uas/yr")
    parser.add_argument(
        "--on-bad", choices=["raise", "drop"], default="raise", help="rows that cannot be used (default: raise)"
    )
    parser.add_argument("--output", metavar="DIR", type=_named, help="write report, tables and figures to this folder")
    add_overwrite(parser)


def add_overwrite(parser):
    """The option without which no result of before is replaced."""
    parser.add_argument("--overwrite", action="store_true", help="replace results of the same command that are there")


def reading(options):
    """The arguments of `read_field` that `add_reading` asks for."""
    return {
        "columns": options.columns,
        "units": options.units,
        "on_bad": options.on_bad,
        "frame": options.catalogue_frame,
    }


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
        raise argparse.ArgumentTypeError(f"three numbers separated by commas are wanted, not {text!r}")
    return found


def velocity(text):
    """Our velocity as every command takes it: a name, or SPEED,L,B."""
    if text in VELOCITIES:
        return VELOCITIES[text]
    try:
        return velocity_from_apex(*vector(text))
    except (argparse.ArgumentTypeError, ParameterError):
        raise argparse.ArgumentTypeError(
            f"{' or '.join(VELOCITIES)}, or SPEED,L,B is wanted (km/s above zero; Galactic longitude and latitude of the apex, "
            f"degrees), not {text!r}"
        ) from None


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
