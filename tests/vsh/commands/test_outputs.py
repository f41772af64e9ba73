"""Folders and files of results: whole, old or new, and never another command's."""

import io
import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from dataclasses import replace

import numpy as np
import pytest
from conftest import POSIX, ROOT, random_field, run_python
from gaia_table import table

from fit.commands.fit import main
from vsh.commands import finishing, parsing
from vsh.tools.errors import VshError
from vsh.tools.files import atomic_folder, atomic_write, remove_unfinished_files


@pytest.fixture
def catalogue(tmp_path):
    table().write(tmp_path / "c.fits")
    return str(tmp_path / "c.fits")


def test_files_are_not_replaced_by_default(catalogue, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [catalogue, "--lmax", "1", "--output", str(out), "--format", "none"]
    assert main(arguments) == 0
    first = (out / "report.txt").read_text()
    assert main([*arguments[:2], "2", *arguments[3:]]) == 1
    assert "use --overwrite to replace them" in capsys.readouterr().err
    assert (out / "report.txt").read_text() == first
    assert main([*arguments[:2], "2", *arguments[3:], "--overwrite"]) == 0
    assert (out / "report.txt").read_text() != first
    (out / "mine.txt").write_text("x")
    assert main([*arguments, "--overwrite"]) == 1
    assert "files that vsh-fit did not write (mine.txt)" in capsys.readouterr().err
    page = [catalogue, "--lmax", "1", "--html", str(tmp_path / "page.html"), "--format", "none"]
    assert [main(page), main(page), main([*page, "--overwrite"])] == [0, 1, 0]


def test_other_commands_folders_are_left_alone(catalogue, tmp_path, capsys):
    from fit.commands.correlate import main as correlate

    out = str(tmp_path / "out")
    assert correlate([catalogue, "--output", out]) == 0
    assert main([catalogue, "--lmax", "1", "--output", out, "--overwrite"]) == 1
    assert "holds results of vsh-correlate" in capsys.readouterr().err
    (tmp_path / "own").mkdir()
    (tmp_path / "own" / "thesis.tex").write_text("x")
    assert main([catalogue, "--lmax", "1", "--output", str(tmp_path / "own"), "--overwrite"]) == 1
    assert "holds files that vsh-fit did not write" in capsys.readouterr().err
    assert [x.name for x in (tmp_path / "own").iterdir()] == ["thesis.tex"]


def test_provenance_is_kept(catalogue, tmp_path):
    assert main([catalogue, "--lmax", "1", "--output", str(tmp_path / "out")]) == 0
    mark = json.loads((tmp_path / "out" / "provenance.json").read_text())
    assert mark["command"] == "vsh-fit"
    assert mark["rows"] == 30
    assert set(mark["files"]) | {"provenance.json"} == {x.name for x in (tmp_path / "out").iterdir()}


def test_folder_that_fails_leaves_the_old_one(tmp_path):
    for content in ("old", "new"):
        with atomic_folder(tmp_path / "out") as folder:
            (folder / "x").write_text(content)
    with pytest.raises(ZeroDivisionError), atomic_folder(tmp_path / "out") as folder:
        (folder / "x").write_text(f"{1 / 0}")
    assert (tmp_path / "out" / "x").read_text() == "new"
    assert [x.name for x in tmp_path.iterdir()] == ["out"]


def test_many_writers_of_one_file(tmp_path):
    """Temporary names used the process alone: four threads, 18 to 28 errors in 60."""
    errors = []

    def write(text):
        for _ in range(15):
            try:
                with atomic_write(tmp_path / "x.txt", overwrite=True) as new:
                    new.write_text(text * 1000)
            except OSError as error:
                errors.append(error)

    threads = [threading.Thread(target=write, args=(letter,)) for letter in "abcd"]
    for each in threads:
        each.start()
    for each in threads:
        each.join()
    assert not errors
    assert len(set((tmp_path / "x.txt").read_text())) == 1
    assert [x.name for x in tmp_path.iterdir()] == ["x.txt"]


@POSIX
def test_links_and_permissions_stay(tmp_path):
    """--html replaced a link by a file."""
    (tmp_path / "real.txt").write_text("<!-- written by vsh-astrometry -->")
    (tmp_path / "real.txt").chmod(0o640)
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    with atomic_write(tmp_path / "link.txt", overwrite=True) as new:
        new.write_text("new")
    assert (tmp_path / "link.txt").is_symlink()
    assert (tmp_path / "real.txt").read_text() == "new"
    assert (tmp_path / "real.txt").stat().st_mode & 0o777 == 0o640


def test_only_our_own_leftovers_go(tmp_path):
    """Hidden files with a dash in their name were taken as ours."""
    for name in (".pre-commit-config.yaml", ".env-production", ".vsh-unfinished-1-x.json"):
        (tmp_path / name).write_text("x")
    remove_unfinished_files(tmp_path)
    assert {x.name for x in tmp_path.iterdir()} == {".pre-commit-config.yaml", ".env-production"}


#: A command that kills itself before it opens, renames or removes a file below a folder for the `at`-th time.
_KILLED = """
import os, signal, sys
folder, at, name, *sys.argv[1:] = sys.argv[1:]
moments = []

def kill(event, details):
    if event not in ("open", "os.rename", "os.chmod", "os.remove", "shutil.rmtree") or folder not in str(details[0]):
        return
    if event == "open" and not (details[2] or 0) & (os.O_WRONLY | os.O_RDWR):
        return
    if len(moments) == int(at):
        os.kill(os.getpid(), signal.SIGKILL)
    moments.append(event)

import vsh.__main__ as commands
sys.argv[0] = "vsh-" + name
sys.addaudithook(kill)
try:
    getattr(commands, name)()
finally:
    print("moments", *moments)
"""


def _kill_at_each(command, folder, number=12):
    """Kill a command at moments at which it writes, the last ones above all; yields after each kill."""
    moments = run_python("-c", _KILLED, folder, "-1", *command).stdout.split("moments ")[-1].split()
    last = range(max(len(moments) - number * 2 // 3, 0), len(moments))
    for k in sorted({*last, *np.linspace(0, len(moments) - 1, number - len(last), dtype=int).tolist()}):
        killed = run_python("-c", _KILLED, folder, k, *command, status=None)
        if killed.returncode == 0:  # it went on from a checkpoint, and wrote less
            continue
        assert killed.returncode == -signal.SIGKILL
        yield k


@POSIX
@pytest.mark.slow
def test_kills_leave_whole_folders(catalogue, tmp_path):
    """Of 12 kills over an old folder 8 left old and new files mixed."""
    out, page = tmp_path / "out", tmp_path / "page.html"
    command = ["fit", catalogue, "--output", str(out), "--html", str(page), "--overwrite", "--lmax"]
    states = {}
    for lmax in ("1", "2"):
        run_python("-m", "vsh", *command, lmax)
        states[lmax] = {x.name: x.read_bytes() for x in out.iterdir() if x.suffix in (".txt", ".ecsv")}
    shutil.copytree(out, tmp_path / "old")
    seen = set()
    for _ in _kill_at_each([*command, "1"], tmp_path):
        now = {x.name: x.read_bytes() for x in out.iterdir() if x.suffix in (".txt", ".ecsv")}
        assert now in states.values()
        mark = json.loads((out / "provenance.json").read_text())
        assert set(mark["files"]) | {"provenance.json"} == {x.name for x in out.iterdir()}
        assert all((out / name).stat().st_size > 5000 for name in mark["files"] if name.endswith(".png"))
        assert page.read_text(encoding="utf-8").rstrip().endswith("</html>")
        seen.add(now == states["1"])
        shutil.rmtree(out)
        shutil.copytree(tmp_path / "old", out)
    assert seen == {False, True}


def test_vectors_and_velocities_from_the_shell():
    """Three meanings of --velocity, and negative numbers behind a space."""
    from sim.commands import simulate
    from vsh.commands.reading import make_observer_velocity
    from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

    def parsed(*words):
        return parsing.parse_options(simulate, ["galaxies", "--output", "x.fits", *words])

    assert parsed("--spin", "-1,2,-3").spin == (-1, 2, -3)
    assert parsed("--spin", "-.5,2,3").spin == (-0.5, 2, 3)
    assert make_observer_velocity(parsed("--velocity", "planck").velocity) is CMB_VELOCITY_PLANCK18
    found = make_observer_velocity(parsed("--velocity", "369,264,48").velocity)
    assert found.amplitude == pytest.approx(369)
    assert found.direction == pytest.approx((264, 48))
    for wrong in ("-358,77,-45", "369,264,148", "358", "cobe", "0,1,2"):
        with pytest.raises(SystemExit):
            parsed("--velocity", wrong)


def test_page_does_not_show_where_its_author_works(catalogue, tmp_path):
    assert main([catalogue, "--lmax", "1", "--html", str(tmp_path / "page.html")]) == 0
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert str(tmp_path) not in page
    assert "c.fits" in page


def test_no_bar_in_a_log(capfd):
    """Progress bars filled log files."""
    from vsh.tools.parallel import progress_bar

    for _ in progress_bar(range(3), words="work"):
        time.sleep(0.01)
    bar = progress_bar(range(3), words="work")
    assert bar.disable
    assert capfd.readouterr().err == ""


class _Terminal(io.StringIO):
    def isatty(self):
        return True


@pytest.mark.parametrize("quiet", [False, True])
def test_terminal_is_told_what_is_at_work_and_since_when(catalogue, monkeypatch, capsys, quiet):
    """A fit of a large catalogue was silent until its answer; the line is gone before that is printed."""
    from vsh.io import catalogue as reader
    from vsh.tools import parallel

    def read_slowly(*arguments, **keywords):
        with parallel.name_step("reading"):
            time.sleep(1.1)
            return original(*arguments, **keywords)

    original = reader.read_field
    monkeypatch.setattr(reader, "read_field", read_slowly)
    monkeypatch.setattr(parallel, "_DELAY", 0.0)
    monkeypatch.setattr(sys, "stderr", terminal := _Terminal())
    monkeypatch.setattr("vsh.commands.running.printable", lambda text: f"{len(terminal.getvalue())}|{text}")
    assert main([catalogue, "--lmax", "1", *(["--quiet"] if quiet else [])]) == 0
    shown, printed = terminal.getvalue(), capsys.readouterr().out
    if quiet:
        assert shown == printed == ""
    else:
        assert "vsh-fit, reading: 00:01" in shown
        assert shown.endswith("\r"), "the line was not taken away"
        assert printed.startswith(f"{len(shown)}|acceleration"), "the answer came into the line"


def test_reader_that_has_seen_enough_is_no_error(catalogue):
    command = f"{sys.executable} -m vsh fit {catalogue} --lmax 1 | head -1"
    done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.stdout.startswith("acceleration ")
    assert "Traceback" not in done.stderr


def test_unwritable_outputs_are_errors_before_the_work(tmp_path, monkeypatch, capsys):
    """31 lines of traceback after the simulation."""
    import importlib.util

    from sim.commands.simulate import main as simulate

    original = importlib.util.find_spec
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None if name == "pyarrow" else original(name))
    assert simulate(["quasars", "--number", "10", "--output", str(tmp_path / "x.parquet")]) == 1
    assert "pip install 'vsh-astrometry[parquet]'" in capsys.readouterr().err


@pytest.mark.parametrize("ending", ["fits", "ecsv", "vot", "parquet", "csv"])
def test_truth_travels_or_its_loss_is_said(ending, tmp_path, capsys):
    """Lost without a word in .csv and .vot."""
    from sim.commands.simulate import main as simulate
    from vsh.io.catalogue import truth_of

    path = tmp_path / f"x.{ending}"
    assert simulate(f"quasars --number 20 --errors expected --spin -1,2,3 --output {path}".split()) == 0
    said = capsys.readouterr().out
    if ending == "csv":
        assert "CSV has no place for the truth" in said
        assert truth_of(path) is None
    else:
        np.testing.assert_array_equal(truth_of(path)["spin"].value, [-1, 2, 3])


@POSIX
def test_results_are_written_where_the_reader_has_seen_enough(tmp_path):
    """`vsh-fit … --output results | head` left no results."""
    command = [sys.executable, "-u", "-m", "vsh", "fit", str(ROOT / "fit" / "demo.fits"), "--lmax", "3", "--long"]
    process = subprocess.Popen(
        [*command, "--output", str(tmp_path / "out"), "--format", "none"], cwd=ROOT, stdout=subprocess.PIPE
    )
    process.stdout.readline()
    process.stdout.close()
    assert process.wait(timeout=120) == 0
    assert (tmp_path / "out" / "report.txt").exists()


@POSIX
def test_folders_that_cannot_be(tmp_path):
    if os.getuid() == 0:
        pytest.skip("root may write everywhere")
    (tmp_path / "shut").mkdir(mode=0o500)
    with pytest.raises(VshError, match="cannot be written to"):
        finishing.check_folder(tmp_path / "shut" / "out", "vsh-fit")


def interrupted(command, seconds):
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"  # before that it is Python itself that starts
    time.sleep(seconds)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=60)
    return process.returncode, errors


@POSIX
@pytest.mark.parametrize("tries", [1, pytest.param(10, marks=pytest.mark.slow)])
def test_interrupts_end_in_one_line(tries, catalogue, tmp_path):
    """4 of 24 ended in a traceback."""
    code = "import sys, vsh.__main__ as commands; print('begun', flush=True); sys.argv = ['vsh-sim', *sys.argv[1:]]; commands.sim()"
    rng = np.random.default_rng(1)
    for _ in range(tries):
        command = [sys.executable, "-c", code, "quasars", "--number", "1000000", "--output", str(tmp_path / "q.fits")]
        status, errors = interrupted(command, rng.uniform(0.1, 3.0))
        assert status == -signal.SIGINT  # so that a loop of the shell ends, too
        assert "Traceback" not in errors, errors
        assert errors.strip().endswith("interrupted")


@POSIX
@pytest.mark.slow
def test_kills_of_other_commands(tmp_path):
    """Every file whole, old or new; a chain goes on from its checkpoint."""
    galaxies = tmp_path / "galaxies.fits"
    make = ["sim", "galaxies", "--number", "2000", "--errors", "expected", "--velocity", "planck", "--overwrite",
            "--output", str(galaxies), "--seed"]  # fmt: skip
    wanted = set()
    for seed in "12":
        run_python("-m", "vsh", *make, seed)
        wanted.add(galaxies.read_bytes())
    for _ in _kill_at_each([*make, "1"], tmp_path, 4):
        assert galaxies.read_bytes() in wanted
    out, chain = tmp_path / "out", tmp_path / "chain.npz"
    drift = ["redshift", str(galaxies), "--h0", "67.4", "--bins", "2", "--flows", "no",
             "--posterior", "4000", "--checkpoint", str(chain), "--output", str(out), "--overwrite"]  # fmt: skip
    run_python("-m", "vsh", *drift)
    samples = (out / "samples.fits").read_bytes()
    kills = 0
    for _ in _kill_at_each(drift, tmp_path, 5):
        kills += 1
        mark = json.loads((out / "provenance.json").read_text())
        assert set(mark["files"]) | {"provenance.json"} == {x.name for x in out.iterdir()}
        assert (out / "samples.fits").read_bytes() == samples
        if kills % 2:
            chain.unlink(missing_ok=True)
    assert kills > 2


def test_no_option_shows_where_its_author_works(catalogue, tmp_path):
    """Not the catalogue's folder alone: that of a checkpoint, a map or a reconstruction, too."""
    from argparse import Namespace

    from vsh.commands import running

    (tmp_path / "sub").mkdir()
    told = {"catalogue": catalogue, "checkpoint": str(tmp_path / "sub" / "c.npz"), "units": {"a": "uas/yr"}}
    options = Namespace(**told, frame="icrs", html=None)
    told = running.provenance(catalogue, options)["options"]
    assert told == {"catalogue": "c.fits", "checkpoint": "c.npz", "units": {"a": "uas/yr"}, "frame": "icrs"}


def test_command_of_a_page_repeats_the_run(tmp_path):
    """Folders go, what only looks like a path stays: a quotient, a unit, an address."""
    from fit.commands import redshift

    where, units, address = "pmra / pmra_error < 5", "mu=uas/yr", "tcp://host:8786"
    words = [tmp_path / "c.fits", "--where", where, "--units", units, f"--checkpoint={tmp_path / 'k.npz'}"]
    words += ["--workers", address, "--posterior"]
    told = parsing.parse_options(redshift, list(map(str, words))).command
    assert told == ["vsh-redshift", "c.fits", *words[1:5], "--checkpoint=k.npz", *words[6:]]


def test_a_table_that_a_format_cannot_hold_is_told(tmp_path, capsys):
    """Names beyond ASCII ended a run after the fit, and nothing was kept."""
    field = random_field(60, 1)
    field = replace(field, name=np.array([f"Quäsar {k}" for k in range(len(field))]))
    field.write(tmp_path / "q.ecsv")
    out = tmp_path / "o"
    assert main(f"{tmp_path / 'q.ecsv'} --lmax 1 --format fits --output {out} --format none".split()) == 0
    assert "note: sources.ecsv is not written as fits: " in capsys.readouterr().out
    assert (out / "sources.ecsv").exists()
    assert (out / "vectors.fits").exists()
    assert not (out / "sources.fits").exists()


@pytest.mark.parametrize("name", ["result.json", "table.tex", "page.html"])
def test_folder_has_no_name_of_a_file(name, tmp_path, monkeypatch):
    """A folder of that name came out where somebody wanted a file."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(VshError, match="would be a folder.*--json and --latex print"):
        finishing.check_folder(name, "vsh-fit")
    finishing.check_folder("result.1", "vsh-fit")
