"""A run as a TOML file: every run writes one (`run.toml`), and `--config` reads it."""

import argparse
import json
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from typing import Any

#: What says where results go and how they are told, not what they are.
NOT_KEPT = ("config", "output", "html", "overwrite", "json", "latex", "quiet", "log", "citation", "scheduler")
#: What a configuration may not say: where to write, what to replace, whom to connect to. It may be a stranger's.
_NOT_TAKEN = ("output", "html", "overwrite", "log", "scheduler")
#: What a run writes its configuration to, in its folder of results.
NAME = "run.toml"
NUMBER = re.compile(r"-?(0|[1-9]\d*)(\.\d+)?([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Configuration:
    """What a run was asked for."""

    command: str
    options: Mapping[str, Any]
    version: str = ""
    files: Mapping[str, str] = field(default_factory=dict)
    written: Mapping[str, str] = field(default_factory=dict)

    def text(self, name: str = NAME) -> str:
        """The file, as TOML."""
        lines = [f"# Repeats a run, from the folder that it was made in: {self.command} --config {name} --output NEW"]
        lines += [f"command = {_toml(self.command)}", f"version = {_toml(self.version)}", "", "[options]"]
        lines += [f"{name} = {_toml(value)}" for name, value in self.options.items() if name not in NOT_KEPT]
        if self.files:
            lines += ["", "# SHA-256 of what was read", "[files]"]
            lines += [f"{_quoted(name)} = {_toml(sha)}" for name, sha in self.files.items()]
        if self.written:
            lines += ["", "# SHA-256 of what was written: a file that was changed since is not replaced", "[written]"]
            lines += [f"{_quoted(name)} = {_toml(sha)}" for name, sha in self.written.items()]
        return "\n".join(lines) + "\n"


def configuration_of(path: str, command: str) -> Configuration:
    """The configuration in a file."""
    import tomllib

    try:
        with open(path, "rb") as file:
            raw = tomllib.loads(file.read(2**20).decode("utf-8"), parse_float=str)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"{path}: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise argparse.ArgumentTypeError(f"{path} is no TOML file: {error}") from None
    foreign = set(raw) - {"command", "version", "options", "files", "written"}
    if foreign or not all(isinstance(raw.get(name, {}), dict) for name in ("options", "files", "written")):
        what = ", ".join(sorted(foreign)) or "options and files"
        raise argparse.ArgumentTypeError(f"{path}: {what}? A configuration has command, version, [options] and [files]")
    if raw.get("command", command) != command:
        raise argparse.ArgumentTypeError(f"{path} is a configuration of {raw['command']}, not of {command}")
    options = {str(name): _said(path, name, value) for name, value in raw.get("options", {}).items()}
    return Configuration(command, options, str(raw.get("version", "")), raw.get("files", {}))


def given(parser: argparse.ArgumentParser, words: Sequence[str]) -> dict[str, Any]:
    """What words say, as text, by the names of options without their dashes; nothing is asked for or checked."""
    actions = parser._actions
    parser.usage = parser.format_usage().split(": ", 1)[1].strip()  # of the parser as it was
    for action in actions:
        action.type = action.choices = None
        action.default, action.required = argparse.SUPPRESS, False
        if not action.option_strings:
            action.nargs = "*" if action.nargs in ("*", "+") else "?"
        elif action.nargs == "?":
            action.const = True
    for exclusive in parser._mutually_exclusive_groups:
        exclusive.required = False
    options = vars(parser.parse_args(list(words)))
    named = {action.dest: name_of(action) for action in actions}
    return {
        named[dest]: True if isinstance(value, bool) else tuple(value) if isinstance(value, list) else value
        for dest, value in options.items()
    }


def merged(
    parser: argparse.ArgumentParser, make_parser: Callable[[], argparse.ArgumentParser], words: Sequence[str]
) -> tuple[list[str], Configuration]:
    """The words of the command line after those of its --config; what is on the line prevails."""
    here = given(make_parser(), words)
    try:
        kept = configuration_of(here["config"], parser.prog)
    except argparse.ArgumentTypeError as error:
        parser.error(f"--config {error}")
    known = {name_of(action): action for action in parser._actions}
    refused = [name for name in kept.options if name in _NOT_TAKEN]
    if refused:
        parser.error(
            f"--config {here['config']} names {', '.join(refused)}: where to write, and what to connect to, is taken "
            "from the command line alone"
        )
    for name in kept.options:
        if name not in known or name in ("config", "help", "version", "citation"):
            near = get_close_matches(name, [each for each in known if each not in ("help", "version")], n=3)
            hint = f"; nearest: {', '.join(near)}" if near else ""
            parser.error(f"--config {here['config']}: {parser.prog} has no option {name!r}{hint}")
    excluded = set(here)
    for exclusive in parser._mutually_exclusive_groups:
        names = {name_of(action) for action in exclusive._group_actions}
        excluded |= names if names & set(here) else set()
    options = {name: value for name, value in kept.options.items() if name not in excluded}
    return [word for name, value in options.items() for word in _words(known[name], value)] + list(words), kept


def name_of(action: argparse.Action) -> str:
    """What a configuration calls an option: its name without dashes."""
    return (
        action.option_strings[-1 if len(action.option_strings) < 2 else 0].lstrip("-")
        if action.option_strings
        else action.dest
    )


def _words(action, value):
    if not action.option_strings:
        return [value] if isinstance(value, str) else list(value)
    option = f"--{name_of(action)}"
    if value is True:
        return [option]
    if isinstance(value, tuple):
        repeats = isinstance(action, argparse._AppendAction)
        return [f"{option}={each}" for each in value] if repeats else [f"{option}={','.join(value)}"]
    return [f"{option}={value}"]


def _said(path, name, value):
    """A value of the file as words have it."""
    if value is True or isinstance(value, str):
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        return str(value)
    if isinstance(value, list):
        return tuple(str(_said(path, name, each)) for each in value)
    if isinstance(value, dict):
        return ",".join(f"{key}={_said(path, name, each)}" for key, each in value.items())
    raise argparse.ArgumentTypeError(
        f"{path}: {name} is text, a number, true, or several of them, not {value!r}; what is not wanted is left out"
    )


def _toml(value):
    if value is True:
        return "true"
    if isinstance(value, (tuple, list)):
        return f"[{', '.join(map(_toml, value))}]"
    return value if NUMBER.fullmatch(value) else _quoted(value)


def _quoted(text):
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
