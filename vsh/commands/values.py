"""The types of the values that options have."""

import argparse
import math
from collections.abc import Callable

from vsh.tools.formats import BY_NAME, TITLES

#: `vsh.sky.frames.FRAMES`
FRAMES = ("icrs", "galactic", "ecliptic")
#: `vsh.sky.frames.REDSHIFT_FRAME_NAMES`
REDSHIFT_FRAMES = ("heliocentric", "cmb", "local-group", "true")
#: The sets of names that `vsh.io.catalogue.as_columns` knows
COLUMNS = (
    "gaia", "vizier", "hipparcos", "icrf", "skycoord", "simbad", "ned", "lvdb", "err", "desi", "catwise", "rubin", "mu",
)  # fmt: skip
#: `fit.METHODS`, and those of them that take a value, `fit.methods.WITH_VALUE`.
METHODS = (
    "recommended", "least-squares", "clip", "student", "permissive", "excess-noise", "bootstrap", "jackknife",
)  # fmt: skip
WITH_VALUE = ("clip", "excess-noise", "bootstrap", "jackknife")
#: Formats of tables.
INPUT_FORMATS = tuple(BY_NAME)
#: The skies that `sim.skies.sky_map` knows.
SKIES = ("uniform", "plane-avoiding", "gums", "igql")
#: `vsh.models.cosmology.VELOCITIES`
VELOCITIES = ("planck", "paper")
#: `sim.observing.REDSHIFT_ERRORS`
REDSHIFT_ERRORS = ("spectroscopic", "photometric")
#: `fit.pairs.TEMPLATES`
TEMPLATES = ("spin", "glide", "waves")
#: `fit.correlation.FRAME`: the six components of spin and acceleration.
FRAME = "spin+acceleration"
#: `vsh.io.archive.QUERIES`
QUERIES = ("gaia-crf3", "gaia-edr3-qso", "gaia-dr3-galaxies")
#: `vsh.io.archive.ASTROMETRY`: tables of astrometry in DR4.
ASTROMETRY = ("gaia_source", "all_source_astrometry")
#: `vsh.io.archive.RELEASES`
RELEASES = ("DR3", "DR4")
#: `vsh.io.archive.ESA`
ESA = "https://gea.esac.esa.int/tap-server/tap"
#: What a catalogue may be, for help texts.
A_TABLE = f"a table ({TITLES}), a folder of them, or - for standard input"


def count(least: int, most: int = 10**12) -> Callable[[str], int]:
    """The type of a whole number of at least `least`."""

    def whole(text):
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"a whole number of at least {least} is wanted, not {text!r}")
        if len(text) > 30 or int(text) > most:
            raise argparse.ArgumentTypeError(f"a whole number of at most {most} is wanted, not {text[:40]!r}")
        return int(text)

    return whole


def method(text: str) -> str:
    """The type of an estimator, NAME or NAME=VALUE."""
    name, _, value = text.partition("=")
    if name not in METHODS:
        raise argparse.ArgumentTypeError(f"one of {', '.join(METHODS)} is wanted, not {text!r}")
    if not value:
        return name
    if name not in WITH_VALUE:
        raise argparse.ArgumentTypeError(f"{name} takes no value: {text!r}")
    if name == "excess-noise":
        if value != "scale":
            raise argparse.ArgumentTypeError(f"excess-noise or excess-noise=scale is wanted, not {text!r}")
    else:
        {"clip": positive, "bootstrap": count(2), "jackknife": nside}[name](value)
    return text


def method_and_value(text: str) -> tuple[str, str | None]:
    """The name of an estimator and its value, or None."""
    name, _, value = text.partition("=")
    return name, value or None


def nside(text: str) -> int:
    """The type of a power of two from 1 to 8192."""
    if not text.isdecimal() or int(text) not in (2**k for k in range(14)):
        raise argparse.ArgumentTypeError(f"a power of two from 1 to 8192 is wanted, not {text!r}")
    return int(text)


def not_negative(text: str) -> float:
    """The type of a number of zero or more."""
    return _number(text, lambda x: 0 <= x < math.inf, "a number that is not negative")


def fraction(text: str) -> float:
    """From 0 to 1."""
    return _number(text, lambda value: 0 <= value <= 1, "a share from 0 to 1 is wanted")


def positive(text: str) -> float:
    """The type of a number above zero."""
    return _number(text, lambda x: 0 < x < math.inf, "a positive number")


def _number(text, fits, wanted):
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not fits(number):
        raise argparse.ArgumentTypeError(f"{wanted} is wanted, not {text!r}")
    return number


def numbers(text: str) -> tuple[float, ...]:
    """Numbers separated by commas."""
    try:
        parts = tuple(float(part) for part in text.split(","))
    except ValueError:
        parts = (float("nan"),)
    if not all(map(math.isfinite, parts)):
        raise argparse.ArgumentTypeError(f"numbers separated by commas are wanted, not {text!r}")
    return parts


def vector(text: str) -> tuple[float, ...]:
    """The type of three numbers separated by commas."""
    try:
        components = numbers(text)
    except argparse.ArgumentTypeError:
        components = ()
    if len(components) != 3:
        raise argparse.ArgumentTypeError(f"three numbers separated by commas are wanted, not {text!r}")
    return components


def velocity(text: str) -> str | tuple[float, ...]:
    """Our velocity as every command takes it: a name, or SPEED,L,B."""
    if text in VELOCITIES:
        return text
    try:
        speed, l, b = vector(text)
    except argparse.ArgumentTypeError:
        speed, l, b = 0.0, 0.0, 0.0
    if not (0 < speed < 3e5 and abs(l) <= 360 and abs(b) <= 90):
        raise argparse.ArgumentTypeError(
            f"{' or '.join(VELOCITIES)}, or SPEED,L,B is wanted (km/s above zero; Galactic longitude and latitude of "
            f"the apex, degrees), not {text!r}"
        )
    return speed, l, b


#: `vsh.figures.plot.FORMATS`, and the endings of tables that are written beside ECSV.
FIGURE_FORMATS, TABLE_FORMATS = ("png", "pdf", "svg"), ("fits", "vot", "csv")


def formats(text: str) -> str:
    """Names of formats of figures and of tables, between commas."""
    names = [name.strip() for name in text.split(",")]
    wrong = [name for name in names if name not in (*FIGURE_FORMATS, *TABLE_FORMATS)]
    if wrong:
        raise argparse.ArgumentTypeError(
            f"{wrong[0]!r} is no format: {', '.join(FIGURE_FORMATS)} of figures, {', '.join(TABLE_FORMATS)} of tables"
        )
    return ",".join(dict.fromkeys(names))


def figure_formats(text: str) -> list[str]:
    """Those of `formats` that figures have; PNG where none is said."""
    return [name for name in text.split(",") if name in FIGURE_FORMATS] or ["png"]


def table_formats(text: str) -> list[str]:
    """Those of `formats` that tables have."""
    return [name for name in text.split(",") if name in TABLE_FORMATS]


def names(text: str) -> list[str]:
    """Names between commas."""
    listed = [name.strip() for name in text.split(",")]
    if not all(listed):
        raise argparse.ArgumentTypeError(f"{text!r} are no names between commas")
    return listed


def pairs(text: str) -> dict[str, str]:
    """NAME=VALUE,… as a dict."""
    split = [part.partition("=") for part in text.split(",")]
    pairs_by_name = {name.strip(): value.strip() for name, _, value in split}
    if not all(pairs_by_name) or not all(pairs_by_name.values()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value,name=value")
    return pairs_by_name


def columns(text: str) -> dict[str, str | None]:
    """NAME=VALUE,… with one of the sets of names before it, or not."""
    first, _, rest = text.partition(",")
    if "=" in first:
        return _with_none(text)
    if first.strip() not in COLUMNS:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form name=value,name=value, {' or '.join(COLUMNS)} before it or not"
        )
    return {"names": first.strip()} | (_with_none(rest) if rest else {})


def _with_none(text):
    """NAME=VALUE,… with None where nothing stands behind the equals sign: no such column is looked for."""
    empty = {part.partition("=")[0].strip() for part in text.split(",") if part.strip().endswith("=")}
    kept = ",".join(part for part in text.split(",") if not part.strip().endswith("="))
    return (pairs(kept) if kept else {}) | dict.fromkeys(empty - {""})
