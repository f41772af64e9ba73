"""Options are parsed before anything heavy is imported, under every name that a command has."""

import os

import pytest
from conftest import run_python

import fit.correlation
import fit.pairs
import vsh.__main__ as commands
import vsh.io.archive
from vsh.commands import parsing as names
from vsh.io.catalogue import NAMED
from vsh.models.cosmology import VELOCITIES
from vsh.sky.frames import FRAMES, REDSHIFT_FRAME_NAMES
from vsh.tools import formats

#: What takes long to import; NumPy comes with every command.
HEAVY = ("scipy", "astropy", "matplotlib", "healpy", "emcee")


#: One command of each package; the others among the slow tests.
FEW = [
    pytest.param(each, marks=[pytest.mark.slow] * (each not in ("fit", "sim", "referee"))) for each in commands.COMMANDS
]


def modules_after(words):
    """What is loaded when a command has printed what it was asked for, and ended."""
    code = (
        "import sys, vsh.__main__ as commands\n"
        "try: commands.main(sys.argv[1:])\n"
        "except SystemExit as end: assert not end.code, end.code\n"
        "print('loaded', *sys.modules)"
    )
    alone = {name: None for name in os.environ if name.startswith("COVERAGE")}
    return run_python("-c", code, *words, environment=alone).stdout.split("loaded ")[-1].split()


@pytest.mark.parametrize("command", FEW)
@pytest.mark.parametrize("asked", ["--help", "--version", "--citation"])
def test_options_without_data_load_no_library(command, asked):
    """NumPy, and of ours what tells the options of a command: a third of a second in place of one."""
    loaded = modules_after([command, asked])
    assert not {each.split(".")[0] for each in loaded} & set(HEAVY)
    assert len([each for each in loaded if each.split(".")[0] in ("vsh", "fit", "sim", "study")]) < 43


def test_file_that_is_not_there_is_told_before_anything_is_loaded_that_fits(tmp_path):
    code = "import sys; from fit.commands.fit import main; code = main([sys.argv[1]]); print(code, *sys.modules)"
    for content in (None, b"no table"):
        path = tmp_path / "c.fits"
        if content:
            path.write_bytes(content)
        run = run_python("-c", code, path)
        status, *loaded = run.stdout.split()
        assert status == "1"
        assert "c.fits" in run.stderr
        assert not {"vsh.io.catalogue", "fit.normal", "matplotlib", "scipy.special"} & set(loaded)


def test_names_that_options_choose_from_are_those_of_the_packages():
    assert tuple(FRAMES) == names.FRAMES
    assert names.REDSHIFT_FRAMES == REDSHIFT_FRAME_NAMES
    assert set(names.COLUMNS) == set(NAMED)
    assert set(names.INPUT_FORMATS) == {*formats.BY_NAME, "icrf"}
    assert tuple(VELOCITIES) == names.VELOCITIES
    assert tuple(fit.pairs.TEMPLATES) == names.TEMPLATES
    assert tuple(fit.METHODS) == tuple(names.METHODS)
    assert tuple(name for name, kind in names.METHODS.items() if kind) == fit.methods.WITH_VALUE
    assert names.FRAME == fit.correlation.FRAME


def test_every_command_by_its_short_name():
    listed = run_python("-m", "vsh").stdout
    for command in commands.COMMANDS:
        assert f"\n  {command} " in listed
    assert run_python("-m", "vsh", "fit", "--version").stdout == f"vsh-fit {vsh.__version__}\n"
    assert "there is no command 'fits': fit, redshift" in run_python("-m", "vsh", "fits", status=1).stderr
