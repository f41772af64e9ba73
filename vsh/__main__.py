"""Where the commands begin: `vsh-NAME`, and `python -m vsh NAME`.

Options are parsed before anything heavy is imported, and an interrupt ends a command quietly from the first moment on,
while libraries are still being imported.
"""

import atexit
import gc
import os
import re
import signal
import sys
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from types import ModuleType
from typing import NoReturn

from vsh.commands import COMMANDS
from vsh.tools.modules import import_hidden_packages

# Here and not in a function: processes that a command begins import this module before anything else.
import_hidden_packages()

_USAGE = """usage: python -m vsh COMMAND …

{commands}

Each is a command of its own, too: python -m vsh fit is vsh-fit. See python -m vsh COMMAND --help."""


def import_command_module(command: str) -> ModuleType:
    """The module of a command, with its parser: light, what it works with is imported when the work begins."""
    return import_module(COMMANDS[command].module)


def describe_command(command: str) -> str:
    """Describe a command in a few words."""
    return re.split(r"[:.] ", import_command_module(command).make_parser().description)[0].rstrip(".")


def run_command(command: str, arguments: Sequence[str] | None = None) -> NoReturn:
    """Parse the options of a command, run it, and exit with its status."""

    def exit_interrupted(*_):
        os.write(2, b"interrupted\n")
        signal.signal(signal.SIGINT, signal.SIG_DFL)
        os.kill(os.getpid(), signal.SIGINT)

    signal.signal(signal.SIGINT, exit_interrupted)
    atexit.register(gc.freeze)  # a search for garbage in all that ends anyhow takes a seventh of a small job
    sys.excepthook = _print_traceback_without_secrets
    from vsh.tools.printing import guard_printing

    with guard_printing():
        from vsh.commands.parsing import parse_options

        module = import_command_module(command)
        options = parse_options(module, arguments)
        signal.signal(signal.SIGINT, signal.default_int_handler)  # from here on `vsh.commands.running.guarded` sees it
        status = module.run(options)
    if signal_number := getattr(options, "interrupted_by", None):  # a shell's loop ends where a signal ended a command
        atexit._run_exitfuncs()
        sys.stdout.flush()
        sys.stderr.flush()
        signal.signal(signal_number, signal.SIG_DFL)
        os.kill(os.getpid(), signal_number)
    sys.exit(status)


def _print_traceback_without_secrets(error_type, error, traceback):
    """Print what went wrong with us, without the passwords of addresses that may stand in it."""
    from traceback import format_exception

    from vsh.tools.formats import hide_secrets

    sys.stderr.write(hide_secrets("".join(format_exception(error_type, error, traceback))))


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """`python -m vsh COMMAND …`"""
    import vsh

    tokens = list(sys.argv[1:] if arguments is None else arguments)
    command = tokens[0].removeprefix("vsh-") if tokens else "--help"
    if command == "--version":
        print(f"vsh-astrometry {vsh.__version__}")
        sys.exit(0)
    if command in ("-h", "--help"):
        print(_USAGE.format(commands="\n".join(f"  {name:10} {describe_command(name)}" for name in COMMANDS)))
        sys.exit(0)
    if command not in COMMANDS:
        sys.exit(f"python -m vsh: there is no command {tokens[0]!r}: {', '.join(COMMANDS)} are")
    run_command(command, tokens[1:])


def __getattr__(name: str) -> Callable[[], NoReturn]:
    """The entry points: `vsh.__main__:fit` is `vsh-fit`, and so on for every command."""
    if name in COMMANDS:
        return partial(run_command, name)
    raise AttributeError(name)


if __name__ == "__main__":
    main()
