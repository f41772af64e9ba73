"""From the words of a command, or a TOML file of an earlier run, to its options; the types of their values.

Every run writes its options as `run.toml`, which `--config` reads; what it rests on is in `citations.bib`. This file
needs the standard library alone.
"""

import argparse
import json
import math
import os
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, field
from difflib import get_close_matches
from itertools import pairwise
from pathlib import Path
from typing import Any, NoReturn

import vsh
from vsh.commands import COMMANDS
from vsh.commands.renamed import GONE, renew_options, renew_words_and_settings
from vsh.tools.formats import BY_NAME, TITLES, hide_address_secrets, hide_secrets, is_address
from vsh.tools.printing import printable

_CITED_ALWAYS = ("vsh_astrometry", "harris2020", "virtanen2020", "astropy2022")
_PIXELS = ("gorski2005", "zonca2019")
#: What a run uses where it is asked for something, besides what its command rests on.
_CITATIONS_BY_OPTION = {
    "posterior": ("foremanmackey2013", "foremanmackey2016", "planck2020overview"),
    "waves": ("book2011",),
    "floor": ("lindegren2021",),
    "classes": ("lindegren2021",),
    "templates": ("lindegren2021", "nguyen2026"),
    "jackknife": _PIXELS,
    "influence": _PIXELS,
    "selection": _PIXELS,
    "gaia": ("gaia2016", "gaia2021acceleration", "gaia2022crf3", *_PIXELS),
    "workers": ("rocklin2015",),
    "output": ("hunter2007",),
    "html": ("hunter2007",),
}
#: Options that write what may hold figures.
_FIGURE_OPTIONS = ("output", "html")
#: The same for values of options.
_CITATIONS_BY_VALUE = {
    "planck": ("planck2020overview",),
    "student": ("lange1989",),
    "crf3": ("gaia2016", "gaia2022crf3"),
    "gaia-crf3": ("gaia2022crf3",),
    "gaia-edr3-qso": ("gaia2022crf3",),
    "solved": ("lindegren2012", "lam2015"),
}


def collect_citation_keys(command: str, given_options: Mapping[str, Any]) -> list[str]:
    """The keys of what a run uses, ours first."""
    keys = [*_CITED_ALWAYS, *COMMANDS[command.removeprefix("vsh-")].cites]
    has_figures = "none" not in str(given_options.get("format")) and command not in ("vsh-sim", "vsh-archive")
    for name, value in given_options.items():
        keys += _CITATIONS_BY_OPTION.get(name, ()) if has_figures or name not in _FIGURE_OPTIONS else ()
        keys += _CITATIONS_BY_VALUE.get(value, ()) if isinstance(value, str) else ()
    return list(dict.fromkeys(keys))


def bibtex(command: str, given_options: Mapping[str, Any]) -> str:
    """The entries of what a run uses."""
    from importlib.resources import files

    text = files("vsh.commands").joinpath("citations.bib").read_text("utf-8").replace("VERSION", vsh.__version__)
    entries = dict(re.findall(r"^(?=@\w+\{(\w+),)(.*?^\}$)", text, re.MULTILINE | re.DOTALL))
    return "\n\n".join(entries[key] for key in collect_citation_keys(command, given_options))


#: `vsh.sky.frames.FRAMES`
FRAMES = ("icrs", "galactic", "ecliptic")
#: `vsh.sky.frames.REDSHIFT_FRAME_NAMES`
REDSHIFT_FRAMES = ("heliocentric", "cmb", "local-group", "true")
#: The sets of names that `vsh.io.catalogue.as_columns` knows
COLUMNS = (
    "gaia", "vizier", "hipparcos", "icrf", "skycoord", "simbad", "ned", "galactic", "ecliptic", "lvdb",
    "err", "desi", "catwise", "rubin", "mu", "joined",
)  # fmt: skip
#: Formats of tables.
INPUT_FORMATS = tuple(BY_NAME)
#: The skies that `sim.skies.sky_map` knows.
SKIES = ("uniform", "plane-avoiding", "gums", "igql")
#: `vsh.models.cosmology.VELOCITIES`
VELOCITIES = ("planck", "paper")
#: `fit.pairs.TEMPLATES`
TEMPLATES = ("spin", "glide", "waves")
#: `fit.correlation.FRAME`: the six components of spin and acceleration.
FRAME = "spin+acceleration"
#: What a catalogue may be, for help texts.
A_TABLE = f"a table, a folder of them, or - for standard input | formats: {TITLES}"


def count(least: int, most: int = 10**12) -> Callable[[str], int]:
    """The type of a whole number of at least `least`."""

    def parse_whole_number(text):
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"a whole number of at least {least} is expected, not {text!r}")
        if len(text) > 30 or int(text) > most:
            raise argparse.ArgumentTypeError(f"a whole number of at most {most} is expected, not {text[:40]!r}")
        return int(text)

    return parse_whole_number


def parse_nside(text: str) -> int:
    """The type of a power of two from 1 to 8192."""
    if not text.isdecimal() or int(text) not in (2**k for k in range(14)):
        raise argparse.ArgumentTypeError(f"a power of two from 1 to 8192 is expected, not {text!r}")
    return int(text)


def parse_not_negative(text: str) -> float:
    """The type of a number of zero or more."""
    return _parse_valid_number(text, lambda x: x >= 0, "a number that is not negative")


def parse_positive(text: str) -> float:
    """The type of a number above zero."""
    return _parse_valid_number(text, lambda x: x > 0, "a positive number")


def _check_excess_noise_value(text):
    if text != "scale":
        raise argparse.ArgumentTypeError(f"excess-noise or excess-noise=scale is expected, not excess-noise={text}")


#: `fit.METHODS` with the types of the values of those that take one, `fit.methods.WITH_VALUE`.
METHODS: dict[str, Callable[[str], Any] | None] = {
    "recommended": None, "least-squares": None, "clip": parse_positive, "student": None,
    "excess-noise": _check_excess_noise_value, "bootstrap": count(2), "jackknife": parse_nside,
}  # fmt: skip


def check_method(text: str) -> str:
    """The type of an estimator, NAME or NAME=VALUE."""
    name, _, value = text.partition("=")
    if name not in METHODS:
        raise argparse.ArgumentTypeError(f"one of {', '.join(METHODS)} is expected, not {text!r}")
    check_value = METHODS[name]
    if value and check_value is None:
        raise argparse.ArgumentTypeError(f"{name} takes no value: {text!r}")
    if value and check_value is not None:
        check_value(value)
    return text


def split_method(text: str) -> tuple[str, str | None]:
    """The name of an estimator and its value, or None."""
    name, _, value = text.partition("=")
    return name, value or None


def _parse_valid_number(text, is_valid, description):
    parsed_numbers = _parse_finite_numbers(text)
    if len(parsed_numbers) != 1 or not is_valid(parsed_numbers[0]):
        raise argparse.ArgumentTypeError(f"{description} is expected, not {text!r}")
    return parsed_numbers[0]


def _parse_finite_numbers(text):
    """Numbers separated by commas; none where one of them is none, or not finite."""
    try:
        values = tuple(map(float, text.split(",")))
    except ValueError:
        return ()
    return values if all(map(math.isfinite, values)) else ()


def parse_numbers(text: str) -> tuple[float, ...]:
    """Numbers separated by commas."""
    if not (values := _parse_finite_numbers(text)):
        raise argparse.ArgumentTypeError(f"numbers separated by commas are expected, not {text!r}")
    return values


def parse_vector(text: str) -> tuple[float, ...]:
    """The type of three numbers separated by commas."""
    if len(components := _parse_finite_numbers(text)) != 3:
        raise argparse.ArgumentTypeError(f"three numbers separated by commas are expected, not {text!r}")
    return components


def parse_velocity(text: str) -> str | tuple[float, ...]:
    """Our velocity as every command takes it: a name, or SPEED,L,B."""
    if text in VELOCITIES:
        return text
    components = _parse_finite_numbers(text)
    speed, l, b = components if len(components) == 3 else (0.0, 0.0, 0.0)
    if not (0 < speed < 3e5 and abs(l) <= 360 and abs(b) <= 90):
        raise argparse.ArgumentTypeError(
            f"{' or '.join(VELOCITIES)}, or SPEED,L,B is expected (km/s above zero; Galactic longitude and latitude of "
            f"the apex, degrees), not {text!r}"
        )
    return speed, l, b


#: `vsh.figures.plot.FORMATS`, and the endings of tables that are written beside ECSV.
FIGURE_FORMATS, TABLE_FORMATS = ("png", "pdf", "svg"), ("fits", "vot", "csv")
#: Dots per inch of a figure, unless somebody says.
_DPI = 300.0


def check_formats(text: str) -> str:
    """Names of formats of figures, with @DPI behind one or not, and of tables, between commas; none: no figures."""
    for entry in text.split(","):
        name, at_sign, dpi = entry.strip().partition("@")
        if name not in ("none", "", *FIGURE_FORMATS, *TABLE_FORMATS) or not (name or at_sign):
            raise argparse.ArgumentTypeError(
                f"{entry!r} is no format: {', '.join(FIGURE_FORMATS)} of figures, @DPI behind it or not, or none; "
                f"{', '.join(TABLE_FORMATS)} of tables"
            )
        if at_sign and not 20 <= _parse_valid_number(dpi, math.isfinite, "a number of dots per inch") <= 2400:
            raise argparse.ArgumentTypeError(f"20 to 2400 dots an inch are expected, not {dpi!r}")
    return text


def parse_figure_formats_and_dpi(text: str) -> tuple[list[str], float]:
    """The formats of figures in a checked text, PNG where there is none, and their dots per inch; no format of none."""
    entries = [entry.strip().partition("@") for entry in text.split(",")]
    formats_given = list(dict.fromkeys(name for name, _, _ in entries if name in FIGURE_FORMATS))
    dpi = next((float(dpi) for _, at_sign, dpi in entries if at_sign), _DPI)
    return [] if any(name == "none" for name, _, _ in entries) else formats_given or ["png"], dpi


def parse_table_formats(text: str) -> list[str]:
    """The formats of tables in a text that `check_formats` takes."""
    names_given = [entry.partition("@")[0].strip() for entry in text.split(",")]
    return list(dict.fromkeys(name for name in names_given if name in TABLE_FORMATS))


def parse_names(text: str) -> list[str]:
    """Names between commas."""
    entries = [name.strip() for name in text.split(",")]
    if not all(entries):
        raise argparse.ArgumentTypeError(f"{text!r} are no names between commas")
    return entries


def parse_pairs(text: str) -> dict[str, str]:
    """NAME=VALUE,… as a dict."""
    assignments = [token.partition("=") for token in text.split(",")]
    pairs_by_name = {name.strip(): value.strip() for name, _, value in assignments}
    if not all(pairs_by_name) or not all(pairs_by_name.values()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form name=value,name=value")
    return pairs_by_name


def _make_choice_type(choices):
    """The type of one of some words."""

    def check_choice(text):
        if text not in choices:
            raise argparse.ArgumentTypeError(f"one of {', '.join(choices)} is expected, not {text!r}")
        return text

    return check_choice


#: What --columns says of a table besides names: its name among the options, and how it is checked.
_TABLE_FACTS: dict[str, tuple[str, Callable[[str], Any]]] = {
    "frame": ("catalogue_frame", _make_choice_type(FRAMES)),
    "format": ("input_format", _make_choice_type(INPUT_FORMATS)),
    "sigma": ("sigma", parse_positive),
}


def parse_columns(text: str) -> dict[str, Any]:
    """NAME=VALUE,… with one of the sets of names before it, or not."""
    columns_by_role = _parse_set_and_pairs(text)
    for name in {*columns_by_role} & {*_TABLE_FACTS}:
        columns_by_role[name] = _TABLE_FACTS[name][1](columns_by_role[name] or "")
    return columns_by_role


def set_table_options(options: argparse.Namespace) -> None:
    """Take what --columns says besides names to options of their own: frame, format and error of a table."""
    given_columns = dict(options.columns or {})
    for name, (dest, _) in _TABLE_FACTS.items():
        setattr(options, dest, given_columns.pop(name, None))
    options.columns = given_columns.get("names") if given_columns.keys() == {"names"} else given_columns or None


def _parse_set_and_pairs(text):
    first_entry, _, remainder = text.partition(",")
    if "=" in first_entry:
        return _parse_pairs_with_none(text)
    if first_entry.strip() not in COLUMNS:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither name=value,name=value nor a set of names: {', '.join(COLUMNS)}"
        )
    return {"names": first_entry.strip()} | (_parse_pairs_with_none(remainder) if remainder else {})


def _parse_pairs_with_none(text):
    """NAME=VALUE,… with None where nothing stands behind the equals sign: no such column is looked for."""
    empty_names = {token.partition("=")[0].strip() for token in text.split(",") if token.strip().endswith("=")}
    remainder = ",".join(token for token in text.split(",") if not token.strip().endswith("="))
    return (parse_pairs(remainder) if remainder else {}) | dict.fromkeys(empty_names - {""})


#: Options that name what is written, and those that name whom to connect to.
WRITTEN, CONNECTED = ("output", "html", "log", "checkpoint"), ("workers", "url")
#: What a configuration may not say: where to write, what to replace, whom to connect to. It may be a stranger's.
_REFUSED = (*WRITTEN, "overwrite", *CONNECTED)
#: What says where results go and how they are told, not what they are.
NOT_KEPT = ("config", "output", "html", "checkpoint", "overwrite", "url", "json", "latex", "quiet")
#: What a run writes its configuration to, in its folder of results.
CONFIGURATION_NAME = "run.toml"
#: How such a file begins.
REPEATS = "# Repeats a run"
NUMBER = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Configuration:
    """Options of a run that can be written and read."""

    command: str
    options: Mapping[str, Any]
    version: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)

    def as_toml(self, file_name: str = CONFIGURATION_NAME) -> str:
        """The file, as TOML."""
        lines = [f"{REPEATS}, from the folder that it was made in: {self.command} --config {file_name} --output NEW"]
        lines += [f"command = {_format_toml(self.command)}", f"version = {_format_toml(self.version)}", "", "[options]"]
        kept = {name: value for name, value in self.options.items() if name not in NOT_KEPT}
        if not _is_worker_count("workers", kept.get("workers")):
            kept.pop("workers", None)
        lines += [f"{name} = {_format_toml(value)}" for name, value in kept.items()]
        if self.files:
            lines += ["", "# SHA-256 of what was read", "[files]"]
            lines += [f"{_quote_toml_text(name)} = {_format_toml(sha)}" for name, sha in self.files.items()]
        if self.written:
            lines += ["", "# SHA-256 of what was written: a file that was changed since is not replaced", "[written]"]
            lines += [f"{_quote_toml_text(name)} = {_format_toml(sha)}" for name, sha in self.written.items()]
        return "\n".join(lines) + "\n"


def read_configuration(path: str, command: str) -> Configuration:
    """The configuration in a file."""
    import tomllib

    try:
        with open(path, "rb") as file:
            raw = tomllib.loads(file.read(2**20).decode("utf-8"), parse_float=str)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{path} is no TOML file: {error}") from None
    unknown_entries = set(raw) - {"command", "version", "options", "files", "written"}
    if unknown_entries or not all(isinstance(raw.get(name, {}), dict) for name in ("options", "files", "written")):
        entries = ", ".join(sorted(unknown_entries)) or "options and files"
        raise argparse.ArgumentTypeError(f"{path}: {entries}? A configuration has command, version, [options], [files]")
    if raw.get("command", command) != command:
        raise argparse.ArgumentTypeError(f"{path} is a configuration of {raw['command']}, not of {command}")
    options: dict[str, Any] = {}
    settings = {str(name): _format_setting(path, name, value) for name, value in raw.get("options", {}).items()}
    for name, value in renew_options(command, settings):
        options[name] = f"{options[name]},{value}" if isinstance(options.get(name), str) else value
    return Configuration(command, options, str(raw.get("version", "")), raw.get("files", {}))


def parse_options_as_text(parser: argparse.ArgumentParser, words: Sequence[str]) -> dict[str, Any]:
    """Collect the options of a command line as text, by name, without checking values; the parser is changed."""
    actions = parser._actions
    parser.usage = parser.format_usage().split(": ", 1)[1].strip()  # of the parser as it was
    for action in actions:
        action.type = action.choices = None
        action.default, action.required = argparse.SUPPRESS, False
        if not action.option_strings:
            action.nargs = "*" if action.nargs in ("*", "+") else "?"
        elif action.nargs == "?":
            action.const = True
    for exclusive_group in parser._mutually_exclusive_groups:
        exclusive_group.required = False
    options = vars(parser.parse_args(list(words)))
    option_names = {action.dest: option_name(action) for action in actions}
    return {
        option_names[dest]: True if isinstance(value, bool) else tuple(value) if isinstance(value, list) else value
        for dest, value in options.items()
    }


def merge_configuration(
    parser: argparse.ArgumentParser, make_parser: Callable[[], argparse.ArgumentParser], words: Sequence[str]
) -> tuple[list[str], Configuration]:
    """The words of the command line after those of its --config; what is on the line prevails."""
    settings = parse_options_as_text(make_parser(), words)
    try:
        configuration = read_configuration(settings["config"], parser.prog)
    except argparse.ArgumentTypeError as error:
        parser.error(f"--config {error}")
    actions = {option_name(action): action for action in parser._actions}
    violations = [
        name for name, value in configuration.options.items() if name in _REFUSED and not _is_worker_count(name, value)
    ]
    if violations:
        parser.error(
            f"--config {settings['config']} names {', '.join(violations)}: where to write, and what to connect to, is "
            "taken from the command line alone"
        )
    for name in configuration.options:
        if name not in actions or name in ("config", "help", "help-all", "version"):
            suggestions = get_close_matches(
                name, [candidate for candidate in actions if candidate not in ("help", "version")], n=3
            )
            hint = f"; nearest: {', '.join(suggestions)}" if suggestions else ""
            parser.error(f"--config {settings['config']}: {parser.prog} has no option {name!r}{hint}")
    overridden_names = set(settings)
    for exclusive_group in parser._mutually_exclusive_groups:
        group_names = {option_name(action) for action in exclusive_group._group_actions}
        overridden_names |= group_names if group_names & set(settings) else set()
    options = {name: value for name, value in configuration.options.items() if name not in overridden_names}
    earlier_words = [token for name, value in options.items() for token in _format_option_words(actions[name], value)]
    return [*earlier_words, *words], configuration


def _is_worker_count(name, value):
    """Return whether an option is a number of processes, which connects to nobody."""
    return name == "workers" and isinstance(value, str) and value.isdecimal()


def option_name(action: argparse.Action) -> str:
    """Name of an option in a configuration, without dashes."""
    return (action.option_strings or [action.dest])[0].lstrip("-")


def _format_option_words(action, value):
    if not action.option_strings:
        return [value] if isinstance(value, str) else list(value)
    option = f"--{option_name(action)}"
    if value is True:
        return [option]
    if isinstance(value, tuple):
        is_repeatable = isinstance(action, argparse._AppendAction)
        return [f"{option}={entry}" for entry in value] if is_repeatable else [f"{option}={','.join(value)}"]
    return [f"{option}={value}"]


def _format_setting(path, name, value):
    """A value of the file as words have it."""
    if value is True or isinstance(value, str):
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if isinstance(value, list):
        return tuple(str(_format_setting(path, name, entry)) for entry in value)
    if isinstance(value, dict):
        return ",".join(f"{key}={_format_setting(path, name, entry)}" for key, entry in value.items())
    raise argparse.ArgumentTypeError(
        f"{path}: {name} is text, a number, true, or several of them, not {value!r}; what is not wanted is left out"
    )


def _format_toml(value):
    if value is True:
        return "true"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(_format_toml, value))}]"
    return value if NUMBER.fullmatch(value) else _quote_toml_text(value)


def _quote_toml_text(text):
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


_NEGATIVE = re.compile(r"-[\d.]")


def parse_options(module: Any, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of a command; a negative number behind an option is its value, with or without an equals sign.

    Among them `program`, its name; `given`, what was said by name, as `--config` takes it; `expected`,
    hashes of the files that a configuration was written for; and `command`, the words that repeat the run as a
    page may hold them: names of files, not where they lie.
    """
    parser = module.make_parser()
    tokens = list(sys.argv[1:] if arguments is None else map(str, arguments))
    command_line: list[str] = []
    for token in tokens:
        if _NEGATIVE.match(token) and command_line and re.fullmatch("--[^=]*", command_line[-1]):
            command_line[-1] += f"={token}"
        else:
            command_line.append(token)
    for token in command_line:
        if token.startswith("--") and token.endswith("=--"):  # which argparse of Python 3.11 takes for nothing at all
            parser.error(f"argument {token[:-3]}: '--' is no value")
    configuration = None
    command_line, settings_of_process = renew_words_and_settings(parser.prog, command_line)
    exit_options = {"-h", "--help", "--help-all", "--version"} & set(command_line)
    if hasattr(module, "narrow") and exit_options - {"--version"}:
        module.narrow(parser, command_line)
    if settings_of_process.get("citation") and not exit_options:
        print(bibtex(parser.prog, parse_options_as_text(module.make_parser(), command_line)))
        parser.exit()
    if _is_option_given("--config", command_line) and not exit_options:
        command_line, configuration = merge_configuration(parser, module.make_parser, command_line)
    command_line = _move_bare_options_last(parser, command_line)
    options = parser.parse_args(command_line)
    options.log = settings_of_process.get("log", os.environ.get("VSH_LOG") or None)
    options.threads = _parse_thread_count(parser, settings_of_process.get("threads"))
    if hasattr(options, "columns"):
        set_table_options(options)
    if hasattr(module, "check"):
        module.check(parser, options)
    options.program = parser.prog
    options.expected = {} if configuration is None else dict(configuration.files)
    settings = parse_options_as_text(module.make_parser(), command_line)
    options.given = {name: _hide_secrets_in_value(value) for name, value in settings.items()}
    command_words = tokens if configuration is None else _drop_config_words(command_line)
    options.command = [parser.prog, *map(_hide_folder_in_word, command_words)]
    return options


def _move_bare_options_last(parser, words):
    """The words with the options last whose value is optional, where what follows is none: --waves catalogue.fits."""
    kept_words, bare_options = [], []
    for word, following in pairwise([*words, ""]):
        action = parser._option_string_actions.get(word)
        is_bare = action is not None and action.nargs == "?" and not _is_valid_value(action, following)
        (bare_options if is_bare else kept_words).append(word)
    return kept_words + [word for word in bare_options if not any(other.startswith(f"{word}=") for other in kept_words)]


def _is_valid_value(action, text):
    try:
        return text in action.choices if action.choices else bool(action.type is None or action.type(text) is not None)
    except (argparse.ArgumentTypeError, ValueError):
        return False


def _parse_thread_count(parser, text):
    """The number of threads that --threads asks for, or None."""
    if text is None:
        return None
    try:
        return count(1)(text)
    except argparse.ArgumentTypeError as error:
        parser.error(f"argument --threads: {error}")


def hide_folder(text: str) -> str:
    """The name of a file without its folder, an address without its password; any other text as it is."""
    if is_address(text):
        return hide_address_secrets(text)
    path = Path(text)
    return path.name if path.is_absolute() or ("/" in text and os.path.lexists(path)) else text


def _is_option_given(option, words):
    """Return whether an option is among the words, perhaps shortened."""
    option_names = {token.partition("=")[0] for token in words}
    return any(len(head) > 3 and option.startswith(head) for head in option_names)


def _drop_config_words(words):
    """The words, without those that name a configuration: what it says is among them."""
    kept_words, skips_value = [], False
    for word in words:
        if skips_value or _is_option_given("--config", [word]):
            skips_value = not skips_value and "=" not in word  # its value is the next word
        else:
            kept_words.append(word)
    return kept_words


def _hide_folder_in_word(word):
    """A word of the command as a page may hold it, the value of --option=value too."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + hide_folder(value)


def _hide_secrets_in_value(value):
    """Value of an option, its addresses without their passwords."""
    if isinstance(value, tuple):
        return tuple(map(hide_address_secrets, value))
    return hide_address_secrets(value) if isinstance(value, str) else value


class _ExampleFormatter(argparse.HelpFormatter):
    """Help in which examples stand a line each."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith((_EXAMPLES, _EXAMPLE)):
            return text
        return super()._fill_text(text, width, indent)


_EXAMPLES, _EXAMPLE = "examples:\n", "example:\n"
#: What stands between the words of an option that every help has, and those of --help-all.
MORE = " | "


def make_parser(prog: str, description: str, examples: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of a command, whose help ends with examples and the place of its page."""
    example_lines = "".join(f"  {example}\n" for example in examples)
    epilog = f"{_EXAMPLES}{example_lines}\nfull documentation: docs/commands/{prog}.md"
    return _Parser(prog=prog, description=description, epilog=epilog, formatter_class=_ExampleFormatter)


class JoinValues(argparse.Action):
    """An option that may be repeated: texts are joined with commas, dicts are merged, and the later prevails."""

    def __call__(self, parser: Any, namespace: argparse.Namespace, values: Any, option_string: Any = None) -> None:
        earlier_value = getattr(namespace, self.dest, None)
        is_first = earlier_value in (None, self.default)
        if isinstance(values, dict):
            values = values if earlier_value is None else {**earlier_value, **values}
        elif not is_first:
            values = f"{earlier_value},{values}"
        setattr(namespace, self.dest, values)


def adder(parser: Any) -> Callable[..., None]:
    """A function that adds an option to a parser or a group of its options.

    It takes the names of the option and of its value in one text ("--stars N"), the help, the type or the choices of
    the value, the default, which is added to the help, and what else argparse takes. An option without a value is a
    switch. What stands behind `MORE` in the help is for --help-all.
    """

    def add(names: str, help: str | None = None, kind: Any = None, default: Any = None, **options: Any) -> None:
        flags = [name for name in names.split() if name.startswith("-")]
        metavar = names.split()[len(flags) :]
        if flags and metavar:
            options["metavar"] = metavar[0]
        if kind is not None:
            options["type" if callable(kind) else "choices"] = kind
        elif flags and default is None and not options.keys() & {"metavar", "action", "nargs"}:
            options["action"] = "store_true"
        if default is not None:
            options["default"] = default
            if isinstance(default, str | int | float) and help is not None and "default" not in help:
                brief_help, separator, details = help.partition(MORE)
                default_text = default if isinstance(default, str) else format(default, "g")
                help = f"{brief_help} (default: {default_text}){separator}{details}"
        full_help = help and help.replace(MORE, "; ")
        parser.add_argument(*(flags or metavar), help=full_help, **options).brief = help and help.partition(MORE)[0]

    return add


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are two lines, and name the option that was meant.

    Its help has the options of the task, that of --help-all everything.
    """

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{**options, "add_help": False})
        self.add_argument("-h", "--help", action="help", help="show the options of the task, and exit")
        self.add_argument("--help-all", action=_HelpAll, nargs=0, help="show all options, and exit")

    def format_help(self) -> str:
        """The help of --help: what the task needs."""
        formatter = self._get_formatter()
        positionals = [action for action in self._actions if not action.option_strings]
        names_with_nargs = [(str(action.metavar or action.dest).upper(), action.nargs) for action in positionals]
        shown_positionals = [f"[{word}]" if nargs in ("?", "*") else word for word, nargs in names_with_nargs]
        formatter.add_usage(f"%(prog)s {' '.join(shown_positionals)} [options]", [], [])
        formatter.add_text(re.split(r"(?<=[.:]) ", self.description or "")[0].rstrip(":"))
        example = (self.epilog or "").removeprefix(_EXAMPLES).splitlines()[0]
        formatter.add_text(f"{_EXAMPLE}{example}")
        shared_options = get_shared_group(self)._group_actions
        excluded = (*shared_options, *self._actions[:2])  # --help itself
        options = [action for action in self._actions if action not in excluded and action.help != argparse.SUPPRESS]
        formatter.start_section("options")
        formatter.add_arguments(list(map(_copy_with_brief_help, options)))
        formatter.end_section()
        names = ", ".join(f"--{option_name(action)}" for action in shared_options)
        formatter.add_text(f"And --help-all has details, and as every command {names}.")
        return formatter.format_help()

    def format_help_all(self) -> str:
        """The help of --help-all."""
        return super().format_help()

    def error(self, message: str) -> NoReturn:
        hints = []
        for option in re.findall(r"--[\w-]+", message.partition("unrecognized arguments:")[2]):
            replacement = GONE.get(f"{self.prog} {option.removeprefix('--')}")
            nearest = get_close_matches(option, self._option_string_actions, n=1)
            hints += [f"in Python: {replacement}"] if replacement else [f"is it {nearest[0]}?"] if nearest else []
        hint = f" ({'; '.join(dict.fromkeys(hints))})" if hints else ""
        safe_message = printable(hide_secrets(f"{message}{hint}"))
        self.exit(2, f"{self.prog}: error: {safe_message}\n{self.prog} --help lists the options\n")


class _HelpAll(argparse.Action):
    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: Any = None) -> None:
        print(parser.format_help_all(), end="")
        parser.exit()


#: Options of every command: --help leaves them to --help-all.
_SHARED_TITLE = "options of every command"


def _copy_with_brief_help(action):
    """An option with the first words of its help."""
    brief_action = copy(action)
    brief_action.help = action.brief
    return brief_action


def get_shared_group(parser: argparse.ArgumentParser) -> Any:
    """The group of the options that several commands have."""
    groups = [group for group in parser._action_groups if group.title == _SHARED_TITLE]
    return groups[0] if groups else parser.add_argument_group(_SHARED_TITLE)


def add_common(parser: argparse.ArgumentParser, result_noun: str = "report") -> argparse.ArgumentParser:
    """The parser with the options that every command has: repeat a run, print it for other programs."""
    group = get_shared_group(parser)
    add, add_output = adder(group), adder(group.add_mutually_exclusive_group())
    add(
        "--config FILE",
        "read options from a TOML file, such as the run.toml that every run with --output writes; options on the "
        "command line take precedence",
    )
    add_output("--json", f"print the result as JSON instead of the {result_noun}")
    add_output("--latex", "print the result as LaTeX tables (booktabs)")
    add_output("--long", f"print the full {result_noun}, as it is written to the folder of results")
    add_output("--quiet", "print only error messages, and no progress bars")
    group.add_argument("--version", action="version", version=f"{parser.prog} {vsh.__version__}")
    return parser


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add the option without which no earlier result is replaced."""
    adder(get_shared_group(parser))("--overwrite", "replace existing results of the same command")
