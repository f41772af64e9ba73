"""From the words of a command to its options, as `vsh.commands.options` with the standard library alone."""

import argparse
import os
import re
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from pathlib import Path
from typing import Any, NoReturn, Protocol

import vsh
from vsh.commands import citing, configuration, values
from vsh.tools.formats import is_address, shown_address, shown_addresses
from vsh.tools.printing import printable

_NEGATIVE = re.compile(r"-[\d.]")


class Words(Protocol):
    """A module of `vsh.commands.options`; its `check(parser, options)` refuses options that contradict each other."""

    def make_parser(self) -> argparse.ArgumentParser:
        """The parser of its options."""


def parse(options_module: Any, arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The options of a command; a negative number behind an option is its value, with or without an equals sign.

    Among them `program`, its name; `given`, what was said by name, as `--config` takes it; `expected`,
    hashes of the files that a configuration was written for; and `command`, the words that repeat the run as a
    page may hold them: names of files, not where they lie.
    """
    parser = options_module.make_parser()
    words = list(sys.argv[1:] if arguments is None else map(str, arguments))
    joined: list[str] = []
    for word in words:
        if joined and _NEGATIVE.match(word) and joined[-1].startswith("--") and "=" not in joined[-1]:
            joined[-1] += f"={word}"
        else:
            joined.append(word)
    for word in joined:
        if word.startswith("--") and word.endswith("=--"):  # which argparse of Python 3.11 takes for nothing at all
            parser.error(f"argument {word[:-3]}: '--' is no value")
    kept = None
    asks = {"-h", "--help", "--version"} & set(joined)
    if _says("--citation", joined) and not asks:
        print(citing.bibtex(parser.prog, configuration.given(options_module.make_parser(), joined)))
        parser.exit()
    if _says("--config", joined) and not asks:
        joined, kept = configuration.merged(parser, options_module.make_parser, joined)
    options = parser.parse_args(joined)
    if hasattr(options_module, "check"):
        options_module.check(parser, options)
    options.program = parser.prog
    options.expected = {} if kept is None else dict(kept.files)
    given = configuration.given(options_module.make_parser(), joined)
    options.given = {name: _without_secrets(value) for name, value in given.items()}
    options.command = [parser.prog, *map(_told, words if kept is None else _without_config(joined))]
    return options


def without_folder(text: str) -> str:
    """The name of a file without its folder, an address without its password; any other text as it is."""
    if is_address(text):
        return shown_address(text)
    path = Path(text)
    return path.name if path.is_absolute() or ("/" in text and os.path.lexists(path)) else text


def _says(option, words):
    """Whether an option is among the words, perhaps shortened."""
    heads = {word.partition("=")[0] for word in words}
    return any(len(head) > 4 and option.startswith(head) for head in heads)


def _without_config(words):
    """The words, without those that name a configuration: what it says is among them."""
    left, skip = [], False
    for word in words:
        if skip or _says("--config", [word]):
            skip = not skip and "=" not in word  # its value is the next word
        else:
            left.append(word)
    return left


def _told(word):
    """A word of the command as a page may hold it, the value of --option=value too."""
    option, equals, value = word.partition("=") if word.startswith("--") else ("", "", word)
    return option + equals + without_folder(value)


def _without_secrets(value):
    """What an option was given, its addresses without their passwords."""
    if isinstance(value, tuple):
        return tuple(map(shown_address, value))
    return shown_address(value) if isinstance(value, str) else value


class _Lines(argparse.HelpFormatter):
    """Help in which examples stand a line each."""

    def _fill_text(self, text: str, width: int, indent: str) -> str:
        if text.startswith(_EXAMPLES):
            return text
        return super()._fill_text(text, width, indent)


_EXAMPLES = "examples:\n"


def make(prog: str, description: str, examples: Sequence[str]) -> argparse.ArgumentParser:
    """The parser of a command, whose help ends with examples and the place of its page."""
    lines = "".join(f"  {example}\n" for example in examples)
    epilog = f"{_EXAMPLES}{lines}\nmore of it: docs/commands/{prog}.md"
    return _Parser(prog=prog, description=description, epilog=epilog, formatter_class=_Lines)


class _Parser(argparse.ArgumentParser):
    """A parser whose errors are two lines, and name the option that was meant."""

    def error(self, message: str) -> NoReturn:
        near = []
        for word in re.findall(r"--[\w-]+", message.partition("unrecognized arguments:")[2]):
            near += get_close_matches(word, self._option_string_actions, n=1)
        meant = f" (is it {' or '.join(dict.fromkeys(near))}?)" if near else ""
        words = printable(shown_addresses(f"{message}{meant}"))
        self.exit(2, f"{self.prog}: error: {words}\n{self.prog} --help lists the options\n")


def add_common(parser: argparse.ArgumentParser, tells: str = "report") -> None:
    """Add the options that every command has: repeat a run, print it for other programs, keep a log, list citations."""
    group = parser.add_argument_group("every command")
    group.add_argument(
        "--config",
        metavar="FILE",
        help="options from a TOML file, as every run writes one (run.toml); those on the command line take precedence",
    )
    how = group.add_mutually_exclusive_group()
    how.add_argument("--json", action="store_true", help=f"print the result as JSON in place of the {tells}")
    how.add_argument("--latex", action="store_true", help="print the result as LaTeX tables (booktabs)")
    how.add_argument("--long", action="store_true", help=f"print the whole {tells}, as the folder of results has it")
    how.add_argument("--quiet", action="store_true", help="print nothing but errors, and show no progress")
    group.add_argument("--log", metavar="FILE", help="append what is done and how long it takes to this file")
    group.add_argument(
        "--citation",
        action="store_true",
        help="print BibTeX entries for the software and papers that such a run uses, and exit",
    )
    group.add_argument("--version", action="version", version=f"{parser.prog} {vsh.__version__}")


def add_threads(parser: argparse.ArgumentParser) -> None:
    """Add the number of threads."""
    parser.add_argument(
        "--threads",
        type=values.count(1),
        metavar="N",
        help="number of threads (default: one per core); does not affect the results",
    )


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add the option without which no earlier result is replaced."""
    parser.add_argument("--overwrite", action="store_true", help="replace existing results of the same command")
