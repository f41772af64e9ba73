"""The help of every command ends with three examples that are understood, and that run."""

import re
import shlex

import numpy as np
import pytest
from conftest import DATA, POSIX, run_python

import sim
from vsh.__main__ import import_command_module
from vsh.commands import COMMANDS, parsing
from vsh.io.astrometry import write_astrometry

MODULES = {name.removeprefix("vsh-"): each.module for name, each in COMMANDS.items()}


def examples(command):
    options = import_command_module(command)
    lines = options.make_parser().epilog.splitlines()
    assert lines[-1] == f"full documentation: docs/commands/vsh-{command}.md"
    return [line.strip() for line in lines if line.startswith("  vsh-")]


@pytest.mark.parametrize("command", MODULES)
def test_three_examples_that_are_understood(command):
    listed = examples(command)
    assert len(listed) == 3
    for line in listed:
        program, *words = shlex.split(line)
        assert program == f"vsh-{command}"
        assert parsing.parse_options(import_command_module(command), words) is not None
        assert line in import_command_module(command).make_parser().format_help_all()


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """What the examples read."""
    folder = tmp_path_factory.mktemp("examples")
    quasars, rng = sim.quasars(400, 1), np.random.default_rng(1)
    for name in ("catalogue", "catalogue2", "one", "two", "three"):
        field = sim.observe(quasars, sim.spin((1, 2, 3)), int(rng.integers(1000)), sigma=50.0)
        field.write(folder / f"{name}.fits")
    galaxies = sim.galaxies(600, 1)
    sim.observe(galaxies, sim.secular_parallax((300.0, 0, 0)), 2, sigma=20.0).write(folder / "galaxies.fits")
    sim.crf3(1, n_five=2000, n_six=100).write(folder / "crf3.fits")
    sim.crf4(1, n_five=2000).write(folder / "crf4.fits")
    sim.epochs(sim.quasars(40, 1), sim.spin((1, 2, 3)), 2, complete=True).write(folder / "epochs.fits")
    stars = sim.link(1, 20)
    for name in ("gaia", "vlbi"):
        write_astrometry(stars[stars.catalogue == name], folder / f"{name}.csv")
    for name in ("icrf3sx.txt", "icrf2-all.txt"):
        if (DATA / name).exists():
            (folder / name).write_bytes((DATA / name).read_bytes())
    return folder


@POSIX
@pytest.mark.slow
@pytest.mark.parametrize("line", [line for command in MODULES for line in examples(command)])
def test_examples_run(line, folder, tmp_path):
    if line.startswith("vsh-archive") and "--show" not in line:
        pytest.skip("it asks the archive")
    few = {"n-samples": 4000}
    options = r"--(number|quasars|stars|n-samples) \d+"
    words = shlex.split(re.sub(options, lambda found: f"--{found[1]} {few.get(found[1], 200)}", line))
    if any(word.endswith(".txt") and not (folder / word).exists() for word in words):
        pytest.skip("real catalogues are not at hand")
    made = {words[i + 1] for i, word in enumerate(words) if word == "--output"}
    for path in folder.iterdir():
        if path.name not in made:
            (tmp_path / path.name).symlink_to(path)
    run_python("-m", "vsh", words[0].removeprefix("vsh-"), *words[1:], folder=tmp_path)


@pytest.mark.parametrize("command", MODULES)
def test_help_is_a_screen_and_help_all_is_everything(command, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    parser = import_command_module(command).make_parser()
    assert len(parser.format_help().splitlines()) <= 40
    options = [option for action in parser._actions for option in action.option_strings if option.startswith("--")]
    assert len(options) <= {"redshift": 30, "fit": 26, "sim": 26}.get(command, 25)  # parallaxes; units of --positions
    assert all(option in parser.format_help_all() for option in options)


def test_error_of_use_is_two_lines(capsys):
    with pytest.raises(SystemExit) as end:
        parsing.parse_options(import_command_module("fit"), ["catalogue.fits", "--lmx", "3"])
    assert end.value.code == 2
    assert capsys.readouterr().err.splitlines() == [
        "vsh-fit: error: unrecognized arguments: --lmx 3 (is it --lmax?)",
        "vsh-fit --help lists the options",
    ]


@pytest.mark.parametrize(("kind", "there", "not_there"), [
    ("link", ["--spin", "--orientation"], ["--wave", "--flow", "--release", "--traps"]),
    ("galaxies", ["--flow", "--velocity"], ["--wave", "--traps", "--orientation"]),
    ("crf4", ["--traps", "--seed"], ["--sky", "--flow"]),
    ("epochs", ["--wave", "--release"], ["--flow", "--positions", "--orientation"]),
])  # fmt: skip
def test_help_of_a_kind_shows_its_options(kind, there, not_there, capsys):
    with pytest.raises(SystemExit):
        import_command_module("sim").main([kind, "--help"])
    text = capsys.readouterr().out
    assert all(option in text for option in there)
    assert not [option for option in not_there if re.search(rf"{option}\b", text.partition("options:")[2])]
