"""Odd surroundings, odd options, odd files: one line of ours, never a traceback."""

import io
import json
import os
import signal
import subprocess
import sys
import time
from configparser import ConfigParser
from dataclasses import replace

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, random_field, run_python

import sim
import vsh.__main__ as commands
from fit.commands.fit import main
from vsh.commands import running
from vsh.io.catalogue import read_field
from vsh.io.quantities import latex_table
from vsh.tools.errors import TableError


@pytest.fixture
def catalogue(tmp_path):
    random_field(80, 1).write(tmp_path / "q.fits")
    return str(tmp_path / "q.fits")


def shell(*words, **options):
    return run_python("-m", "vsh", *words, **options)


needs_full_disk = pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no full disk to write to")


@needs_full_disk
@pytest.mark.parametrize(
    "words", [("--citation",), ("--lmax", "1"), ("--lmax", "1", "--json"), ("--lmax", "6", "--json")]
)
def test_full_disk_is_said_in_one_line(words, catalogue):
    with open("/dev/full", "w") as full:
        done = shell("fit", catalogue, *words, stdout=full, status=1)
    assert len(done.stderr.splitlines()) == 1
    assert "the disk is full" in done.stderr


@needs_full_disk
@pytest.mark.parametrize("letters", [10, 3000, 8190, 8193, 20000])  # shorter than what Python holds back, and longer
def test_full_disk_is_not_said_again_by_what_waits_to_be_printed(letters):
    code = (
        "import argparse, sys\nfrom vsh.commands.running import run_safely\nfrom vsh.tools.printing import guard_printing\n"
        "options = argparse.Namespace(program='vsh-fit', log=None, quiet=True, expected={})\n"
        f"with guard_printing():\n    sys.exit(run_safely(options, lambda: print('x' * {letters}, flush=True)))"
    )
    with open("/dev/full", "w") as full:
        done = run_python("-c", code, stdout=full, status=1, environment={"PYTHONUNBUFFERED": None})
    assert done.stderr == "vsh-fit: error: the disk is full\n"


@pytest.mark.slow
def test_letters_that_a_terminal_cannot_take(catalogue):
    assert shell("fit", catalogue, "--lmax", "1", environment={"PYTHONIOENCODING": "ascii"}).stderr == ""
    told = shell("fit", catalogue, "--lmax", "1", "--json", environment={"PYTHONIOENCODING": "ascii"})
    here = shell("fit", catalogue, "--lmax", "1", "--json")
    assert json.loads(told.stdout) == json.loads(here.stdout)  # escaped, and the same


@pytest.mark.slow
def test_backend_that_there_is_not(catalogue, tmp_path):
    words = ["fit", catalogue, "--lmax", "1", "--output", tmp_path / "out", "--dpi", "40"]
    assert shell(*words, environment={"MPLBACKEND": "nonsense"}).stderr == ""


@pytest.mark.parametrize(("options", "status", "words"), [
    (["--dpi", "1"], 2, "20 to 2400 dots an inch"),
    (["--lmax=--"], 2, "argument --lmax: '--' is no value"),
    (["--workers", "{q}"], 1, "is no file of a scheduler"),
    (["--output", "/proc/x"], 1, "the folder /proc cannot be written to"),
    (["--html", "/proc/x.html"], 1, "the folder /proc cannot be written to"),
])  # fmt: skip
def test_options_that_cannot_be(options, status, words, catalogue, capsys):
    told = [each.format(q=catalogue) for each in options]
    try:
        found = main([catalogue, "--lmax", "1", *told])
    except SystemExit as stop:
        found = stop.code
    assert found == status
    assert words in capsys.readouterr().err


def test_no_column_may_be_named(catalogue, capsys):
    assert main([catalogue, "--lmax", "1", "--columns", "solution=,magnitude="]) == 0


def test_mark_of_the_byte_order_before_ecsv(tmp_path):
    field = random_field(10, 1)
    field.write(tmp_path / "t.ecsv")
    (tmp_path / "b.ecsv").write_bytes(b"\xef\xbb\xbf" + (tmp_path / "t.ecsv").read_bytes())
    assert (read_field(tmp_path / "b.ecsv").motion == read_field(tmp_path / "t.ecsv").motion).all()
    np.testing.assert_allclose(read_field(tmp_path / "b.ecsv").motion, field.motion, rtol=1e-14)  # by way of mas/yr


def test_rows_that_stand_elsewhere_are_not_fetched(tmp_path):
    table = io.BytesIO()
    random_field(3, 1).to_table().write(table, format="votable", tabledata_format="binary2")
    (tmp_path / "elsewhere").write_bytes(b"AAAA" * 100)
    stream = b'<STREAM encoding="base64"'
    text = table.getvalue().replace(stream, stream + f' href="file://{tmp_path}/elsewhere"'.encode())
    assert b"/elsewhere" in text
    (tmp_path / "t.vot").write_bytes(text)
    with pytest.raises(TableError, match="keeps its rows elsewhere"):
        read_field(tmp_path / "t.vot")


def test_more_values_than_any_file_has(tmp_path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "t.h5", "w") as file:
        for name in ("ra", "dec"):
            file.create_dataset(name, shape=(10**12,), dtype="f8", chunks=(1000,))
    with pytest.raises(TableError, match="7.5e\\+03 GiB or more"):
        read_field(tmp_path / "t.h5")


def test_tables_that_are_plans():
    class LazyFrame:
        def collect_schema(self):
            raise ValueError("no column x")

    with pytest.raises(TableError, match="the LazyFrame cannot be collected: no column x"):
        read_field(LazyFrame())


def test_latex_prints_names_as_they_are():
    text = latex_table(Table({"a_b": ["50 % & {x}_1 #$ ~^ \\"]}), "A_B, χ²")
    assert r"\caption{A\_B, $\chi^2$}" in text
    assert "\na b " in text  # a head is words
    assert r"50 \% \& \{x\}\_1 \#\$ \textasciitilde{}\textasciicircum{} \textbackslash{}" in text


def test_every_command_can_be_called():
    """By its entry point, by its function, and found in the lists that name commands."""
    config = ConfigParser()
    config.read(ROOT / "setup.cfg", encoding="utf-8")
    scripts = [line.split("=") for line in config["options.entry_points"]["console_scripts"].strip().splitlines()]
    assert {name.strip(): target.strip() for name, target in scripts} == {
        f"vsh-{name}": f"vsh.__main__:{name}" for name in commands.COMMANDS
    }
    for name in commands.COMMANDS:
        assert callable(getattr(commands, name))
        assert f"vsh-{name}" in (ROOT / "README.md").read_text(encoding="utf-8"), name


def test_names_of_sources_are_neither_escapes_nor_lines_of_ours(tmp_path, capsys):
    """A name out of a stranger's table may hold a terminal's escapes, a line of its own, a tag."""
    hostile = ["\x1b[31mred", "a\nacceleration   9 µas/yr", "<script>alert(1)</script>", "=cmd|' /C calc'!A0"]
    field = sim.observe(sim.quasars(60, 1), sim.spin((0, 0, 100)), rng=2, sigma=200.0)
    names = np.array([f"{hostile[k % 4]} {k}" for k in range(len(field))])
    replace(field, name=names).write(tmp_path / "h.parquet")
    page, out = tmp_path / "p.html", tmp_path / "out"
    words = ["--lmax", "1", "--html", str(page), "--output", str(out), "--format", "none"]
    assert main([str(tmp_path / "h.parquet"), *words]) == 0
    report = (out / "report.txt").read_text(encoding="utf-8")
    for text in (capsys.readouterr().out, report, page.read_text(encoding="utf-8")):
        assert "\x1b" not in text
        assert sum(line.startswith("acceleration   9") for line in text.splitlines()) == 0
    assert "<script>alert" not in page.read_text(encoding="utf-8")
    assert any(each[:10] in report.replace("\\x1b", "\x1b") for each in hostile)


@pytest.mark.parametrize("option", ["--output", "--html"])
def test_results_go_to_no_address(option, catalogue, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main([catalogue, "--lmax", "1", option, "s3://me:secret@bucket/out"]) == 1
    said = capsys.readouterr().err
    assert "is an address" in said
    assert "secret" not in said
    assert [path.name for path in tmp_path.iterdir()] == ["q.fits"]


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_a_batch_system_ends_a_run_and_nothing_stays(tmp_path):
    """SIGTERM left the unpacked copy of a packed input, and an unfinished folder."""
    field = random_field(2000, 1)
    field.write(tmp_path / "q.ecsv.gz")
    (tmp_path / "tmp").mkdir()
    command = [sys.executable, "-m", "vsh", "fit", str(tmp_path / "q.ecsv.gz"), "--lmax", "5", "--format", "none"]
    process = subprocess.Popen(
        [*command, "--method", "bootstrap=100000", "--output", str(tmp_path / "o"), "--log", str(tmp_path / "log")],
        env=os.environ | {"TMPDIR": str(tmp_path / "tmp")}, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
    )  # fmt: skip
    deadline = time.monotonic() + 60
    while not (tmp_path / "log").exists() or "read " not in (tmp_path / "log").read_text():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    process.terminate()
    _, said = process.communicate(timeout=60)
    assert process.returncode == -signal.SIGTERM
    assert b"interrupted" in said
    assert list((tmp_path / "tmp").iterdir()) == []
    assert sorted(path.name for path in tmp_path.iterdir()) == ["log", "q.ecsv.gz", "tmp"]


def test_wrong_number_of_threads_is_said_before_the_run(monkeypatch, capsys):
    monkeypatch.setenv("OMP_NUM_THREADS", "abc")
    assert main(["--demo"]) == 1
    assert "OMP_NUM_THREADS is 'abc', which is no number of threads" in capsys.readouterr().err


def test_a_singular_matrix_is_one_line(capsys):
    def singular(options):
        np.linalg.inv(np.zeros((2, 2)))

    run = running.make_entry("fit.commands.fit", singular)[0]
    assert run(["--demo"]) == 1
    assert "a matrix cannot be solved with" in capsys.readouterr().err
