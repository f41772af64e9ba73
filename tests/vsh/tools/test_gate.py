"""The gate for all that is written: what is read, what is somebody else's, and what two processes share."""

import subprocess
import sys
from functools import partial
from multiprocessing import get_context

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, random_field

import fit
from vsh import WriteError
from vsh.figures.page import write_page
from vsh.figures.plot import save_figures
from vsh.io import tables
from vsh.models.flows import VelocityGrid
from vsh.tools.files import UNFINISHED, atomic_folder, atomic_write, check_not_read, hold_lock, protect_files


def test_foreign_files_are_not_replaced(tmp_path):
    for name, content in (("a.txt", b"mine"), ("q.fits", b"SIMPLE  ="), ("x.npz", b"PK")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(WriteError, match=f"{name} exists already"), atomic_write(path) as new:
            new.write_text("ours")
        assert path.read_bytes() == content
        with atomic_write(path, overwrite=True) as new:
            new.write_text("ours")
        assert path.read_bytes() == b"ours"
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.txt", "q.fits", "x.npz"]


def test_every_writer_asks_before_it_replaces(tmp_path):
    """A user's own table that was made from one of ours carries our mark, and was replaced."""
    solution, grid = fit.fit_field(random_field(50, 1), 1), VelocityGrid(np.zeros((3, 4, 4, 4)), 50.0)
    for name, write in {
        "power.png": partial(save_figures, {"power": solution.plot()}, tmp_path, dpi=40, close=False),
        "p.html": partial(write_page, tmp_path / "p.html", "<html></html>"),
        "t.ecsv": partial(tables.write_table, Table({"a": [1]}), tmp_path / "t.ecsv"),
        "f.ecsv": partial(random_field(5, 1).write, tmp_path / "f.ecsv"),
        "s.ecsv": partial(solution.write, tmp_path / "s.ecsv"),
        "g.npz": partial(grid.write, tmp_path / "g.npz"),
    }.items():
        write()
        if name.endswith("ecsv"):
            mine = Table.read(tmp_path / name)
            mine["my_notes"] = "mine"
            mine.write(tmp_path / name, overwrite=True)
        before = {path: path.read_bytes() for path in tmp_path.iterdir()}
        with pytest.raises(WriteError, match=f"{name} exists already: .*overwrite=True"):
            write()
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
        write(overwrite=True)
        assert not name.endswith("ecsv") or (tmp_path / name).read_bytes() != before[tmp_path / name]


def test_a_file_that_comes_while_another_is_written_stays(tmp_path):
    path = tmp_path / "x.txt"
    with pytest.raises(WriteError, match="exists already"), atomic_write(path):
        path.write_text("theirs")
    assert path.read_text() == "theirs"
    assert list(tmp_path.iterdir()) == [path]


def test_what_a_killed_run_left_is_cleared_by_the_next(tmp_path):
    """By the process that is in its name; what one that runs, or another machine, is writing stays."""
    code = (
        "import os, sys\nfrom pathlib import Path\nfrom vsh.tools.files import atomic_folder, atomic_write\n"
        "with atomic_folder(sys.argv[1]) as folder, atomic_write(sys.argv[2]):\n"
        "    (folder / 'half').write_text('')\n    os.kill(os.getpid(), 9)"
    )
    folder, path = tmp_path / "o", tmp_path / "x.txt"
    killed = subprocess.Popen([sys.executable, "-c", code, str(folder), str(path)], cwd=ROOT)
    killed.wait()
    left = sorted(each.name for each in tmp_path.iterdir())
    assert len(left) == 2
    assert all(name.startswith(UNFINISHED) for name in left)
    elsewhere = tmp_path / f"{UNFINISHED}00000000-{killed.pid}-abc-x.txt"
    elsewhere.write_text("")
    with atomic_folder(folder) as first, atomic_write(path):
        (first / "a").write_text("")
        with atomic_folder(folder), atomic_write(path, overwrite=True):
            pass
        assert (first / "a").exists()
        path.unlink()
    assert sorted(tmp_path.iterdir()) == sorted([elsewhere, folder, path])


def test_inputs_are_not_overwritten(tmp_path):
    source = tmp_path / "folder" / "q.fits"
    source.parent.mkdir()
    random_field(5, 1).write(source)
    before = source.read_bytes()
    with protect_files([source]):
        with pytest.raises(WriteError, match="is what is read"):
            tables.write_table(Table({"a": [1]}), source)
        with pytest.raises(WriteError, match="holds what is read"):
            check_not_read(tmp_path)
        check_not_read(tmp_path / "folder" / "other.fits")
    with protect_files([source.parent]), pytest.raises(WriteError, match="lies in|holds"):
        check_not_read(source.parent / "new.fits")
    assert source.read_bytes() == before
    tables.write_table(Table({"a": [1]}), source, overwrite=True)  # no longer read


def _hold(path, begun, finish):
    with hold_lock(path):
        begun.set()
        finish.wait(20)


@pytest.mark.slow
def test_two_processes_lock_each_other_out(tmp_path):
    context = get_context("spawn")
    begun, finish = context.Event(), context.Event()
    other = context.Process(target=_hold, args=(tmp_path / "x", begun, finish))
    other.start()
    assert begun.wait(30)
    with pytest.raises(WriteError, match="another process is writing x"), hold_lock(tmp_path / "x"):
        pass
    other.kill()  # a lock goes with its process
    other.join()
    with hold_lock(tmp_path / "x"):
        pass
    assert list(tmp_path.iterdir()) == []
