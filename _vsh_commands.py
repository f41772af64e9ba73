"""Where the commands begin: an interrupt ends them quietly from the first moment on, while libraries are still being imported."""

import os
import signal
import sys


def _run(module):
    def interrupted(*_):
        os.write(2, b"interrupted\n")
        os._exit(1)

    signal.signal(signal.SIGINT, interrupted)
    from importlib import import_module

    main = import_module(module).main
    signal.signal(signal.SIGINT, signal.default_int_handler)  # from here on `vsh.commands.running.guarded` sees it
    sys.exit(main())


def fit():
    """`vsh-fit`."""
    _run("fit.commands.fit")


def sim():
    """`vsh-sim`."""
    _run("sim.commands.simulate")


def agis():
    """`vsh-agis`."""
    _run("sim.commands.agis")


def redshift():
    """`vsh-redshift`."""
    _run("fit.commands.redshift")


def correlate():
    """`vsh-correlate`."""
    _run("fit.commands.correlate")


def study():
    """`vsh-study`."""
    _run("study.command")


def archive():
    """`vsh-archive`."""
    _run("vsh.commands.archive")


def pairs():
    """`vsh-pairs`."""
    _run("fit.commands.pairs")


def compare():
    """`vsh-compare`."""
    _run("fit.commands.compare")


def forecast():
    """`vsh-forecast`."""
    _run("study.forecast.command")
