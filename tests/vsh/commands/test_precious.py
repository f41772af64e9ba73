"""No command changes a file that is not its own, whatever it is told."""

import json
import os

import pytest

from fit.commands.fit import main as fit_main
from sim.commands.simulate import main as simulate
from vsh.tools.files import digest


@pytest.fixture
def catalogue(tmp_path):
    path = tmp_path / "q.fits"
    assert simulate(["quasars", "--number", "60", "--errors", "expected", "--output", str(path), "--quiet"]) == 0
    return path


@pytest.mark.parametrize(("options", "words"), [
    (["--log", "{q}"], "is what is read"),
    (["--html", "{q}", "--overwrite"], "is what is read"),
    (["--output", "{folder}", "--overwrite", "--format", "none"], "holds"),
    (["--log", "{mine}"], "holds something else than a log"),
    (["--html", "{mine}"], "exists already: use --overwrite"),
    (["--log", "{pipe}"], "is a pipe"),
    (["--output", "{folder}/out", "--log", "{folder}/out/log.txt", "--format", "none"], "which the run writes"),
])  # fmt: skip
def test_inputs_and_foreign_files_stay(options, words, catalogue, tmp_path, capsys):
    mine = tmp_path / "mine.txt"
    mine.write_text("precious")
    before = digest(catalogue)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    told = [each.format(q=catalogue, folder=tmp_path, mine=mine, pipe=pipe) for each in options]
    assert fit_main([str(catalogue), "--lmax", "1", *told]) == 1
    assert words in capsys.readouterr().err
    assert digest(catalogue) == before
    assert mine.read_text() == "precious"
    assert not (tmp_path / "out").exists()


def test_simulation_replaces_the_table_that_is_named_alone(catalogue, tmp_path, capsys):
    again = ["quasars", "--number", "50", "--errors", "expected", "--output"]
    before = catalogue.read_bytes()
    assert simulate([*again, str(catalogue)]) == 1
    assert "exists already: use --overwrite" in capsys.readouterr().err
    assert catalogue.read_bytes() == before
    assert simulate([*again, str(catalogue), "--overwrite"]) == 0
    assert catalogue.read_bytes() != before
    assert simulate([*again, str(tmp_path / "q.vot")]) == 0  # beside q.fits and its configuration
    (tmp_path / "n.ecsv.run.toml").write_text("mine")  # which nobody named
    assert simulate([*again, str(tmp_path / "n.ecsv"), "--overwrite"]) == 1
    assert not (tmp_path / "n.ecsv").exists()
    assert (tmp_path / "n.ecsv.run.toml").read_text() == "mine"


def test_results_that_were_changed_stay(catalogue, tmp_path, capsys):
    command = [str(catalogue), "--lmax", "1", "--format", "none", "--output", str(tmp_path / "out")]
    assert fit_main(command) == 0
    assert fit_main([*command, "--overwrite"]) == 0
    report = tmp_path / "out" / "report.txt"
    report.write_text("my remarks")
    assert fit_main([*command, "--overwrite"]) == 1
    assert "changed since vsh-fit wrote them (report.txt)" in capsys.readouterr().err
    assert report.read_text() == "my remarks"
    provenance = tmp_path / "out" / "provenance.json"
    facts = json.loads(provenance.read_text(encoding="utf-8"))
    provenance.write_text(json.dumps(facts | {"files": list(facts["files"])}))  # no hashes: nobody knows whose they are
    assert fit_main([*command, "--overwrite"]) == 1
    assert "files that vsh-fit did not write" in capsys.readouterr().err


def test_folder_and_page_are_there_together(catalogue, tmp_path, monkeypatch):
    """A run that ended between them left a folder, and the same call was refused."""
    from vsh.figures import page

    command = [str(catalogue), "--lmax", "1", "--format", "none"]
    command += ["--output", str(tmp_path / "out"), "--html", str(tmp_path / "p.html")]
    monkeypatch.setattr(page, "write_page", lambda *_, **__: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        fit_main(command)
    assert sorted(tmp_path.iterdir()) == [catalogue, tmp_path / "q.fits.run.toml"]
    monkeypatch.undo()
    assert fit_main(command) == 0
    assert {"out", "p.html"} <= {each.name for each in tmp_path.iterdir()}


def test_log_goes_on_and_says_where_it_could_not(catalogue, tmp_path, capsys):
    log = tmp_path / "log.txt"
    for _ in range(2):
        assert fit_main([str(catalogue), "--lmax", "1", "--log", str(log)]) == 0
    assert log.read_text().count("vsh-fit is done") == 2
    capsys.readouterr()
    assert fit_main([str(catalogue), "--lmax", "1", "--log", "/dev/full"]) == 0
    assert capsys.readouterr().err == "vsh-fit: the log is not complete: the disk is full\n"


def test_a_simulation_that_another_run_wrote_meanwhile_stays(tmp_path, monkeypatch, capsys):
    """Two runs on one output, neither with --overwrite: both ended with status 0, and one sky was gone."""
    from sim.commands import simulate

    path = tmp_path / "q.fits"
    observe = simulate.sim.observe

    def slow(*arguments, **options):
        path.write_bytes(b"the sky of another run")
        return observe(*arguments, **options)

    monkeypatch.setattr(simulate.sim, "observe", slow)
    assert simulate.main(["quasars", "--number", "20", "--errors", "expected", "--output", str(path)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert path.read_bytes() == b"the sky of another run"
