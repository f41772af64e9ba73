"""Where the commands begin.

Options are parsed before anything heavy is imported, and an interrupt ends a command quietly from the first moment on, while libraries are
still being imported.
"""

import os
import re
import signal
import sys
from importlib import import_module

#: Commands by name: the module with their options in `vsh.commands.options`, and the one whose `run` does the work.
COMMANDS = {
    "fit": ("fit", "fit.commands.fit"),
    "redshift": ("redshift", "fit.commands.redshift"),
    "correlate": ("correlate", "fit.commands.correlate"),
    "pairs": ("pairs", "fit.commands.pairs"),
    "compare": ("compare", "fit.commands.compare"),
    "sim": ("simulate", "sim.commands.simulate"),
    "agis": ("agis", "sim.commands.agis"),
    "study": ("study", "study.command"),
    "forecast": ("forecast", "study.forecast.command"),
    "archive": ("archive", "vsh.commands.archive"),
}
_USAGE = """usage: python -m vsh COMMAND …

{commands}

Each is a command of its own, too: python -m vsh fit is vsh-fit. Say python -m vsh COMMAND --help."""


def words_of(command):
    """The module with the options of a command: light, it loads nothing but the standard library."""
    return import_module(f"vsh.commands.options.{COMMANDS[command][0]}")


def about(command):
    """What a command does, in a few words."""
    return re.split(r"[:.] ", words_of(command).make_parser().description)[0].rstrip(".")


def run(command, arguments=None):
    """Parse the options of a command, run it, and exit with its status."""

    def interrupted(*_):
        os.write(2, b"interrupted\n")
        os._exit(1)

    signal.signal(signal.SIGINT, interrupted)
    from vsh.tools.printing import printing

    with printing():
        from vsh.commands.parsing import parse

        options = parse(words_of(command), arguments)
        program = import_module(COMMANDS[command][1])
        signal.signal(signal.SIGINT, signal.default_int_handler)  # from here on `vsh.commands.running.guarded` sees it
        status = program.run(options)
    sys.exit(status)


def main(arguments=None):
    """`python -m vsh COMMAND …`"""
    import vsh

    words = list(sys.argv[1:] if arguments is None else arguments)
    first = words[0].removeprefix("vsh-") if words else "--help"
    if first == "--version":
        print(f"vsh-astrometry {vsh.__version__}")
        sys.exit(0)
    if first in ("-h", "--help"):
        print(_USAGE.format(commands="\n".join(f"  {name:10} {about(name)}" for name in COMMANDS)))
        sys.exit(0)
    if first not in COMMANDS:
        sys.exit(f"python -m vsh: there is no command {words[0]!r}: {', '.join(COMMANDS)} are")
    run(first, words[1:])


def fit():
    """`vsh-fit`."""
    run("fit")


def sim():
    """`vsh-sim`."""
    run("sim")


def agis():
    """`vsh-agis`."""
    run("agis")


def redshift():
    """`vsh-redshift`."""
    run("redshift")


def correlate():
    """`vsh-correlate`."""
    run("correlate")


def study():
    """`vsh-study`."""
    run("study")


def archive():
    """`vsh-archive`."""
    run("archive")


def pairs():
    """`vsh-pairs`."""
    run("pairs")


def compare():
    """`vsh-compare`."""
    run("compare")


def forecast():
    """`vsh-forecast`."""
    run("forecast")
