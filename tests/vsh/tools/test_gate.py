"""The gate for all that is written: what is read, what is somebody else's, and what two processes share."""

import os
import subprocess
import sys
from multiprocessing import get_context

import numpy as np
import pytest
from astropy.table import Table
from conftest import ROOT, random_field

import fit
from vsh import WriteError
from vsh.figures.page import is_page, write_page
from vsh.io import tables
from vsh.models.flows import VelocityGrid
from vsh.tools.files import MARK, as_recorded, atomic_write, check_not_read, exclusive, is_ours, read_arrays, reading


def test_foreign_files_are_not_replaced(tmp_path):
    for name, content in (("a.txt", b"mine"), ("q.fits", b"SIMPLE  ="), ("x.npz", b"PK")):
        path = tmp_path / name
        path.write_bytes(content)
        with pytest.raises(WriteError, match=f"{name} was not written by this program"), atomic_write(path) as new:
            new.write_text("ours")
        assert path.read_bytes() == content
    assert sorted(each.name for each in tmp_path.iterdir()) == ["a.txt", "q.fits", "x.npz"]
    empty = tmp_path / "empty"
    empty.touch()
    with atomic_write(empty) as new:
        new.write_text("anything")
    with atomic_write(empty) as new:  # this process wrote it
        new.write_text("again")
    empty.write_text("changed by somebody")
    with pytest.raises(WriteError), atomic_write(empty):
        pass


@pytest.mark.parametrize("ending", ["fits", "ecsv", "vot", "parquet", "h5", "csv"])
def test_our_tables_carry_our_mark(tmp_path, ending):
    """In a process of its own, which remembers nothing of the one that wrote."""
    if ending == "h5":
        pytest.skip("HDF5 is read, not written")
    path = tmp_path / f"t.{ending}"
    random_field(5, 1).write(path)
    code = f"import sys; from vsh.tools.files import is_ours; sys.exit(not is_ours({str(path)!r}))"
    told = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
    assert told == (ending != "csv")  # which has no place for it: it is ours where the note beside it has its hash
    if ending == "csv":
        from vsh.tools.files import digest

        (tmp_path / "t.csv.run.toml").write_text(f'"t.csv" = "{digest(path)}"')
        assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
        assert as_recorded(path) is True
        path.write_text("changed")
        assert as_recorded(path) is False


def test_other_writers_leave_the_mark_as_well(tmp_path):
    VelocityGrid(np.zeros((3, 4, 4, 4)), 50.0).write(tmp_path / "grid.npz")
    fit.fit_field(random_field(50, 1), 1).write(tmp_path / "solution.ecsv")
    from vsh.figures.plot import save_figures

    (figure,) = save_figures({"power": fit.fit_field(random_field(50, 1), 1).plot()}, tmp_path, dpi=40)
    for path in (tmp_path / "grid.npz", tmp_path / "solution.ecsv", figure):
        os.utime(path, (1, 1))  # no longer as this process left it
        assert is_ours(path), path
    assert MARK not in read_arrays(tmp_path / "grid.npz")


def test_inputs_are_not_overwritten(tmp_path):
    source = tmp_path / "folder" / "q.fits"
    source.parent.mkdir()
    random_field(5, 1).write(source)
    before = source.read_bytes()
    with reading([source]):
        with pytest.raises(WriteError, match="is what is read"):
            tables.write_table(Table({"a": [1]}), source)
        with pytest.raises(WriteError, match="holds what is read"):
            check_not_read(tmp_path)
        check_not_read(tmp_path / "folder" / "other.fits")
    with reading([source.parent]), pytest.raises(WriteError, match="lies in|holds"):
        check_not_read(source.parent / "new.fits")
    assert source.read_bytes() == before
    tables.write_table(Table({"a": [1]}), source)  # ours, and no longer read


def _hold(path, begun, finish):
    with exclusive(path):
        begun.set()
        finish.wait(20)


@pytest.mark.slow
def test_two_processes_lock_each_other_out(tmp_path):
    context = get_context("spawn")
    begun, finish = context.Event(), context.Event()
    other = context.Process(target=_hold, args=(tmp_path / "x", begun, finish))
    other.start()
    assert begun.wait(30)
    with pytest.raises(WriteError, match="another process is writing x"), exclusive(tmp_path / "x"):
        pass
    other.kill()  # a lock goes with its process
    other.join()
    with exclusive(tmp_path / "x"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_page_knows_that_it_was_changed(tmp_path):
    path = tmp_path / "p.html"
    write_page(path, "<html><body>one</body></html>\n")
    assert is_page(path)
    path.write_text(path.read_text().replace("one", "two"))
    assert not is_page(path)
    path.write_text("<html></html>")
    assert not is_page(path)


def test_a_file_that_is_there_is_replaced_only_where_that_is_asked_for(tmp_path):
    """A user's own table that was made from one of ours carries our mark, and was replaced."""
    field = random_field(5, 1)
    grid = VelocityGrid(np.zeros((3, 4, 4, 4)), 50.0)
    for thing, name in ((field, "f.ecsv"), (fit.fit_field(random_field(50, 1), 1), "s.ecsv"), (grid, "g.npz")):
        path = tmp_path / name
        thing.write(path)
        if name.endswith("ecsv"):
            mine = Table.read(path)
            mine["my_notes"] = "mine"
            mine.write(path, overwrite=True)
        before = path.read_bytes()
        with pytest.raises(WriteError, match=f"{name} exists already: overwrite=True replaces it"):
            thing.write(path)
        assert path.read_bytes() == before
        thing.write(path, overwrite=True)
        assert name.endswith("npz") or path.read_bytes() != before
