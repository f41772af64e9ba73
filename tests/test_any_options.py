"""Random combinations of all options of all commands, in a folder of precious files: none is changed, and no command ends in a traceback."""

import argparse
import contextlib
import os
import random
import shutil
import sys
import traceback

import pytest
from conftest import POSIX

import sim
from vsh.__main__ import COMMANDS, import_command_module, run_command
from vsh.tools.files import digest

#: Values that make sense, by option; others are given any of `ODD`.
VALUES = {
    "lmax": "1 2 3", "number": "10 60", "quasars": "40", "years": "0.1 1", "knots": "2000", "h0": "67.4", "bins": "2 0.001,0.01,0.03", "velocity": "planck 370,264,48",
    "output": "out o.fits o.ecsv mine.txt g.fits . dir /nope/x", "html": "p.html mine.html g.fits mine.txt", "log": "log.txt mine.txt g.fits /dev/full out/log.txt",
    "checkpoint": "chain.npz mine.npz g.fits", "config": "c.toml bad.toml mine.txt", "where": "pmra>0 redshift<0.02 nosuch>1", "columns": "gaia redshift=ra solution=",
    "units": "pmra=uas/yr pmra=mag", "selection": "map.fits mine.txt", "reconstruction": "mine.npz nothere", "gaia": "g.fits", "url": "http://127.0.0.1:9/tap",
    "patience": "1", "n-samples": "300", "n-realisations": "1", "bootstrap": "5", "n-bootstrap": "3", "n-modes": "9", "nside": "1 2", "dpi": "40", "threads": "1",
    "workers": "1", "scheduler": "mine.txt nothere", "seed": "1 0", "redshift-range": "0.001,0.03", "survey": "me=500,3", "peculiar-dispersion": "150 free 900",
    "iterations": "2", "jackknife": "1", "leakage": "2", "influence": "omega_x,a_y", "h0-range": "50,90", "h0-error": "1",
}  # fmt: skip
ODD = ["", "-1", "0", "1e400", "nan", "x", "1,2,3", "a=b", "=", "é", "9" * 30, "--", "1,nan,2", "a\nb", "\x1b[31m"]
CATALOGUES = ["g.fits", "g.fits", "g.ecsv", "dir", "mine.txt", "nothere.fits", "-", "."]
#: Options that would only print, or take long.
RARE = {"help", "version", "citation", "show", "paper", "exact", "map", "plan", "quiet"}


@pytest.fixture(scope="module")
def precious(tmp_path_factory):
    """A folder of files that are read, and of files that are somebody's."""
    import healpy
    import numpy as np

    folder = tmp_path_factory.mktemp("precious")
    field = sim.observe(sim.galaxies(60, 1), sim.spin((1, 2, 3)), rng=2, sigma=50.0)
    for name in ("g.fits", "g.ecsv"):
        field.write(folder / name)
    for place in ("dir", "theirs"):
        (folder / place).mkdir()
    field.write(folder / "dir" / "a.parquet")
    healpy.write_map(str(folder / "map.fits"), np.arange(12.0), dtype=float)
    for name in ("mine.txt", "mine.html", "mine.npz", "theirs/notes.txt", "o.fits.run.toml", "o.fits.json", "q.adql"):
        (folder / name).write_text("SELECT 1" if name == "q.adql" else f"precious: {name}")
    (folder / "c.toml").write_text("command = 'vsh-fit'\n[options]\nlmax = 2\n")
    (folder / "bad.toml").write_text("[options]\nlmax = [[1]]\n")
    return folder


def drawn(chance, command):
    """Words for a command."""
    parser, words = import_command_module(command).make_parser(), []
    for action in parser._actions:
        name = (action.option_strings or [action.dest])[-1].lstrip("-")
        if isinstance(action, argparse._HelpAction | argparse._VersionAction) or (
            name in RARE and chance.random() < 0.95
        ):
            continue
        if not action.option_strings:
            if action.choices:
                words.append(chance.choice(list(action.choices)))
            elif command == "archive":
                words.append(chance.choice(["gaia-crf3", "q.adql", "mine.txt"]))
            elif action.nargs != "?" or chance.random() < 0.6:
                words.append(chance.choice(CATALOGUES))
            continue
        needed = action.required or name in ("output", "number", "quasars", "years", "url", "overwrite")
        if chance.random() > (0.8 if needed else 0.12):
            continue
        value = chance.choice(VALUES.get(name, "1 2").split() if chance.random() < 0.9 else ODD)
        if action.choices and chance.random() < 0.95:
            value = str(chance.choice(list(action.choices)))
        words.append(f"--{name}" if action.nargs == 0 else f"--{name}={value}")
    return (
        words
        if command != "archive"
        else [*(x for x in words if not x.startswith("--url")), "--url", "http://127.0.0.1:9/tap"]
    )


def snapshot(folder):
    return {path.relative_to(folder): digest(path) for path in folder.rglob("*") if path.is_file()}


def child(command, words, folder, told):
    """The command in a process of its own, what it prints in files; never returns."""
    with contextlib.suppress(BaseException):
        os.chdir(folder)
        for number, name in ((1, "out"), (2, "err")):
            os.dup2(os.open(told / name, os.O_CREAT | os.O_TRUNC | os.O_WRONLY), number)
        sys.stdin, sys.stdout, sys.stderr = open(folder / "g.ecsv"), open(1, "w"), open(2, "w")  # noqa: SIM115
        import resource

        resource.setrlimit(resource.RLIMIT_CPU, (100, 110))
        resource.setrlimit(resource.RLIMIT_AS, (8 * 2**30,) * 2)
        status = 99
        try:
            run_command(command, words)
        except SystemExit as stop:
            status = stop.code if isinstance(stop.code, int) else int(stop.code is not None)
        except BaseException:
            traceback.print_exc()
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(status)
    os._exit(98)


@POSIX
@pytest.mark.parametrize("n", [int(os.environ.get("OPTION_RUNS", "14")), pytest.param(300, marks=pytest.mark.slow)])
def test_no_combination_hurts_a_file_or_ends_in_a_traceback(n, precious, tmp_path, monkeypatch):
    for name in ("http_proxy", "https_proxy"):
        monkeypatch.setenv(name, "http://127.0.0.1:9")  # nobody outside is ever asked
    wrong = []
    for k in range(n):
        chance = random.Random(1000 * n + k)
        command = chance.choice(list(COMMANDS))
        words = drawn(chance, command)
        folder = tmp_path / "here"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(precious, folder)
        if chance.random() < 0.3:
            shutil.move(folder / "theirs", folder / "out")
        before = snapshot(folder)
        process = os.fork()
        if not process:
            child(command, words, folder, tmp_path)
        status = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
        errors = (tmp_path / "err").read_text(errors="replace")
        after = snapshot(folder)
        hurt = [str(name) for name in before if after.get(name) != before[name]]
        if "--overwrite" in words:  # the file that is named, and no other
            hurt = [name for name in hurt if f"--html={name}" not in words]
        left = [str(name) for name in after if "unfinished" in str(name) and "checkpoint" not in str(name)]
        said = [line for line in errors.splitlines() if line.strip() and "log is not complete" not in line]
        bad = status not in (0, 1, 2) or "Traceback" in errors or hurt or left or (status == 1 and len(said) != 1)
        if bad:
            wrong.append((k, command, words, status, hurt, left, errors[-300:]))
    assert not wrong, "\n".join(map(repr, wrong))
