"""The archive, against a server on this machine: nothing here asks anybody else."""

import json
import re

import numpy as np
import pytest
from tap_server import VOTABLE, serving

import fit
from vsh import Field
from vsh.commands.archive import main
from vsh.io import archive
from vsh.io.archive import DR3, DR4, GAIA_CRF3, GAIA_DR3_GALAXIES, GAIA_EDR3_QSO, of_table, query
from vsh.io.catalogue import read_field
from vsh.tools.errors import ArchiveError

ADQL = "SELECT * FROM sky"


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    rng = np.random.default_rng(1)
    path = tmp_path_factory.mktemp("table") / "sky.fits"
    lon, lat = rng.uniform(0, 6, 400), rng.uniform(-1, 1, 400)
    Field(lon, lat, rng.normal(size=(2, 400)), np.ones((2, 400))).write(path)
    return path.read_bytes()


@pytest.fixture
def tap(table):
    with serving(table) as found:
        yield found


def ask(url, path, adql=ADQL, **options):
    return query(adql, path, url, **({"interval": 0.01, "progress": False} | options))


@pytest.mark.filterwarnings("ignore:warning. half of the errors are below")
def test_success_and_the_second_run_offline(tap, table, tmp_path):
    url, service = tap
    service.phases = ["PENDING", "QUEUED", "EXECUTING", "COMPLETED"]
    path = ask(url, tmp_path / "sky.fits")
    assert path.read_bytes() == table
    assert fit.fit_field(read_field(path), 1).n_data == 800
    (form,) = service.submitted()
    assert form == {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": "fits", "QUERY": ADQL, "PHASE": "RUN"}
    note = json.loads((tmp_path / "sky.fits.json").read_text())
    assert (note["query"], note["url"], note["rows"]) == (ADQL, url, 400)
    before = len(service.asked)
    assert ask(url, path) == path
    assert len(service.asked) == before
    assert ask(url, path, overwrite=True) == path
    assert len(service.submitted()) == 2
    assert sorted(each.name for each in tmp_path.iterdir()) == ["sky.fits", "sky.fits.json"]


def test_query_that_is_refused(tap, tmp_path):
    url, service = tap
    service.refuse = "table gaiadr4.nosuch not found"
    with pytest.raises(ArchiveError, match="answered 400: table gaiadr4.nosuch not found"):
        ask(url, tmp_path / "sky.fits")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("phase", ["ERROR", "ABORTED"])
def test_job_that_fails(tap, tmp_path, phase):
    url, service = tap
    service.phases = ["EXECUTING", phase]
    with pytest.raises(ArchiveError, match=f"the query ended {phase.lower()}: no such column"):
        ask(url, tmp_path / "sky.fits")
    service.phases = [phase, "COMPLETED"]  # of the failed job, then of a new one
    ask(url, tmp_path / "sky.fits")
    assert len(service.submitted()) == 2


def test_answer_that_was_cut_off(tap, tmp_path, monkeypatch):
    url, service = tap
    with pytest.raises(ArchiveError, match="cut off at 400 rows: ask for more"):
        ask(url, tmp_path / "sky.fits", max_rows=400)
    assert service.submitted()[0]["MAXREC"] == "400"
    assert not (tmp_path / "sky.fits").exists()
    monkeypatch.setattr("vsh.io.archive._tap._ROW_LIMITS", (400,))
    with pytest.raises(ArchiveError, match="cut off at 400 rows"):
        ask(url, tmp_path / "sky.fits")
    service.table = VOTABLE.format(value="OVERFLOW", text="more than 400 rows").encode()
    with pytest.raises(ArchiveError, match="sent no FITS table: more than 400 rows"):
        ask(url, tmp_path / "sky.fits")
    monkeypatch.setattr("vsh.io.archive._tap._ROW_LIMITS", ())


def test_server_that_is_away(tmp_path):
    with pytest.raises(ArchiveError, match=r"127\.0\.0\.1:9/tap/async cannot be reached: .*refused.*Are you online"):
        ask("http://127.0.0.1:9/tap", tmp_path / "sky.fits")


def test_connection_that_is_cut_and_goes_on(tap, table, tmp_path):
    url, service = tap
    service.send = 3000
    with pytest.raises(ArchiveError, match="bytes came|connection was cut"):
        ask(url, tmp_path / "sky.fits")
    service.send = None
    assert not (tmp_path / "sky.fits").exists()
    assert not (tmp_path / "sky.fits.part").exists()
    assert ask(url, tmp_path / "sky.fits").read_bytes() == table
    assert len(service.submitted()) == 1  # the same job was fetched again


def test_half_a_file(tap, table, tmp_path):
    """Short, though the server says that this is all."""
    url, service = tap
    service.table = table[: len(table) // 2]
    with pytest.raises(ArchiveError, match=r"no whole FITS table .*truncated"):
        ask(url, tmp_path / "sky.fits")
    assert [each.name for each in tmp_path.iterdir()] == ["sky.fits.json"]
    service.table = b"hello"
    with pytest.raises(ArchiveError, match="no whole FITS table"):
        ask(url, tmp_path / "sky.fits")


def test_patience_ends_and_the_same_job_is_waited_for(tap, tmp_path):
    url, service = tap
    service.phases = ["EXECUTING"]
    with pytest.raises(ArchiveError, match=r"async/1 is executing after 0\.05 s: the same call later waits on"):
        ask(url, tmp_path / "sky.fits", patience=0.05)
    service.phases = ["EXECUTING", "COMPLETED"]
    ask(url, tmp_path / "sky.fits")
    assert len(service.submitted()) == 1


def test_job_that_the_server_forgot_is_sent_again(tap, tmp_path):
    url, service = tap
    (tmp_path / "sky.fits.json").write_text(
        json.dumps({"program": "vsh-astrometry", "query": ADQL, "url": url, "max_rows": None, "job": f"{url}/async/77"})
    )
    ask(url, tmp_path / "sky.fits")
    assert len(service.submitted()) == 1


def test_invalid_queries_are_refused(tap, tmp_path):
    url, _ = tap
    path = ask(url, tmp_path / "sky.fits")
    for wrong, said in [
        ({"adql": "SELECT 1"}, "the answer to another query"), ({"adql": " "}, "a query is text"),
        ({"path": tmp_path / "sky.csv"}, r"kept as \.fits"), ({"path": tmp_path / "no" / "sky.fits"}, "no such folder"),
        ({"url": "ftp://somewhere"}, "no address of a service"),
    ]:  # fmt: skip
        with pytest.raises(ArchiveError, match=said):
            ask(**({"url": url, "path": path} | wrong))


def test_queries():
    for adql in (GAIA_CRF3, GAIA_EDR3_QSO, GAIA_DR3_GALAXIES, of_table("user_me.stars", release=DR4)):
        for name in ("pmra_pmdec_corr", "pmra_error", "phot_g_mean_mag"):
            assert f"g.{name}" in adql
    assert "IN (31, 95)" in GAIA_CRF3
    core = of_table("user_me.quasars", release=DR4, astrometry="all_source_astrometry")
    for words in (
        "JOIN gaiadr4.all_source_astrometry AS g", "LEFT JOIN gaiadr4.all_source_photometry AS s", "g.pmra,",
        "s.phot_g_mean_mag, s.bp_rp", "g.tentative_parallax_bias, g.quality_flag",
    ):  # fmt: skip
        assert words in core
    with pytest.raises(ArchiveError, match="DR3 has no table of astrometry called 'all_source_astrometry'"):
        of_table("user_me.quasars", astrometry="all_source_astrometry")
    with pytest.raises(ArchiveError, match="no name of a table"):
        of_table("stars; DROP TABLE x")
    assert of_table("user_me.x", "redshift") == of_table("user_me.x", ["redshift"])
    for wrong, said in [(["ra"], "gives already, or that are named twice: ra"), (["z", "z"], "named twice: z")]:
        with pytest.raises(ArchiveError, match=said):
            of_table("user_me.x", wrong)
    with pytest.raises(ArchiveError, match="a release is a value"):
        of_table("user_me.x", release="DR4")


def test_file_that_is_there_but_no_answer(tap, tmp_path, capsys):
    url, service = tap
    path = tmp_path / "sky.fits"
    for overwrite in (False, True):  # a file that somebody else put there is neither believed nor replaced
        path.write_bytes(service.table)
        with pytest.raises(ArchiveError, match="exists without its note"):
            ask(url, path, overwrite=overwrite)
    path.unlink()
    ask(url, path)
    with pytest.raises(ArchiveError, match="is the answer of http://127"):
        ask("http://127.0.0.1:9/other", path)
    with pytest.raises(ArchiveError, match="with another limit of rows"):
        ask(url, path, max_rows=5000)
    path.write_bytes(service.table[:-1] + b"x")
    for overwrite in (False, True):
        with pytest.raises(ArchiveError, match="is not as it was fetched"):
            ask(url, path, overwrite=overwrite)
    path.unlink()
    assert main(["gaia-crf3", "--output", str(path), "--url", url]) == 0
    assert (DR3.epoch, DR4.epoch) == (2016.0, 2017.5)
    assert archive.RELEASES["DR4"].parallax_bias == "tentative_parallax_bias"


def test_command(tap, tmp_path, capsys):
    url, service = tap
    path = tmp_path / "qso.fits"
    assert main(["gaia-crf3", "--output", str(path), "--url", url]) == 0
    assert service.submitted()[0]["QUERY"] == GAIA_CRF3
    assert "written to" in capsys.readouterr().out
    assert main(["gaia-crf3", "--output", str(path), "--url", url]) == 0
    assert "nothing was asked" in capsys.readouterr().out
    assert main(["gaia-edr3-qso", "--output", str(path), "--url", url]) == 1
    assert "the answer to another query" in capsys.readouterr().err
    (tmp_path / "own.adql").write_text(ADQL)
    assert main([str(tmp_path / "own.adql"), "--output", str(tmp_path / "own.fits"), "--url", url]) == 0
    assert service.submitted()[-1]["QUERY"] == ADQL
    assert main(["nothing.adql", "--output", str(path)]) == 1
    assert "neither a query of ours (gaia-crf3" in capsys.readouterr().err
    assert main(["gaia-crf3", "--show"]) == 0
    assert "FROM gaiadr3.gaia_source" in capsys.readouterr().out
    with pytest.raises(SystemExit):
        main(["gaia-crf3"])


@pytest.mark.parametrize("phase", ["PENDING", "HELD"])
def test_job_that_waits_is_told_to_run(tap, tmp_path, phase):
    """UWS 1.1 does not oblige a server to start a job whose first form says PHASE=RUN."""
    url, service = tap
    if phase == "PENDING":
        service.needs_run = True
    else:
        service.phases = ["HELD", "EXECUTING", "COMPLETED"]
    ask(url, tmp_path / "sky.fits", patience=5)
    told = [form for method, path, form in service.asked if method == "POST" and path.endswith("/phase")]
    assert told == [{"PHASE": "RUN"}]


@pytest.mark.parametrize("body", ["EXECU", "<html>log in</html>"])
def test_phase_that_is_none(tap, tmp_path, body):
    url, service = tap
    service.phases = [body]
    with pytest.raises(ArchiveError, match="which is no phase of a job"):
        ask(url, tmp_path / "sky.fits")


def test_note_of_a_stranger_names_no_other_server(tap, table, tmp_path):
    """A note beside the file named a job at file:///…, whose phase and result were then read from the disk."""
    url, service = tap
    (tmp_path / "job" / "results").mkdir(parents=True)
    (tmp_path / "job" / "phase").write_text("COMPLETED")
    (tmp_path / "job" / "results" / "result").write_bytes(table)
    for job in (f"file://{tmp_path}/job", "http://127.0.0.2:9/tap/async/1"):
        note = {"program": "vsh-astrometry", "query": ADQL, "url": url, "max_rows": None, "job": job}
        (tmp_path / "sky.fits.json").write_text(json.dumps(note))
        ask(url, tmp_path / "sky.fits")
        (tmp_path / "sky.fits").unlink()
    assert len(service.submitted()) == 2


def test_release_follows_from_the_schema():
    """A list of DR4 was joined to DR3's motions, which the archive holds as well."""
    assert "JOIN gaiadr4.gaia_source AS g" in of_table("gaiadr4.qso_candidates")
    assert "g.astrometric_params," in of_table("gaiadr4.qso_candidates")
    assert "JOIN gaiaedr3.gaia_source AS g" in of_table("gaiaedr3.agn_cross_id")
    assert "JOIN gaiadr3.gaia_source AS g" in of_table("gaiadr3.qso_candidates")
    assert "JOIN gaiadr4.gaia_source AS g" in of_table("user_me.stars", release=DR4)
    with pytest.raises(ArchiveError, match="is a table of DR4, and DR3 is asked for"):
        of_table("gaiadr4.qso_candidates", release=DR3)
    with pytest.raises(ArchiveError, match="of a release that is not known"):
        of_table("gaiadr5.qso_candidates")


def test_columns_and_condition_of_a_list():
    adql = of_table("gaiadr4.qso", ["redshift_qsoc"], astrometry="all_source_astrometry", where="t.prob > 0.9")
    assert ", t.redshift_qsoc\nFROM gaiadr4.qso AS t" in adql
    assert adql.endswith("\nWHERE t.prob > 0.9")


@pytest.mark.parametrize("words", [
    "gaia-crf3 --release DR4", "gaia-crf3 --table all_source_astrometry", "own.adql --release DR4",
    "own.adql --with redshift", "gaia-crf3 --where t.x>1", "--check gaiadr4 --table gaia_source",
    "--check gaiadr4 --max-rows 3", "epochs --ids a.txt --release DR4", "--upload a.csv --with redshift",
    "--upload a.csv --where t.x>1", "gaiadr4.qso --upload a.csv", "gaiadr4.qso --ids a.txt", "dr3-neighbourhood",
    "dr3-neighbourhood --upload a.csv --table gaia_source",
])  # fmt: skip
def test_options_that_would_be_ignored_are_errors(words, capsys):
    with pytest.raises(SystemExit):
        main([*words.split(), *([] if words.startswith("epochs") else ["--output", "x.fits"])])
    assert re.search("does not go with|goes with|go into|those of a list|is asked for", capsys.readouterr().err)


def test_positions_of_the_core_solution(tap, tmp_path, capsys):
    """--table was ignored for a list of positions."""
    (tmp_path / "mine.csv").write_text("ra,dec\n10.5,-3.25\n")
    words = ["--upload", str(tmp_path / "mine.csv"), "--release", "DR4", "--table", "all_source_astrometry", "--show"]
    assert main(words) == 0
    assert "JOIN gaiadr4.all_source_astrometry AS g ON 1 = CONTAINS(" in capsys.readouterr().out


def test_neighbours_of_dr3(tap, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("12\n")
    assert main(["dr3-neighbourhood", "--upload", str(tmp_path / "mine.txt"), "--show"]) == 0
    out = capsys.readouterr().out
    assert "JOIN gaiadr4.dr3_neighbourhood AS n ON n.dr3_source_id = t.source_id" in out
    (tmp_path / "mine.csv").write_text("ra,dec\n10.5,-3.25\n")
    assert main(["dr3-neighbourhood", "--upload", str(tmp_path / "mine.csv"), "--show"]) == 1


def test_pyvo_is_served_as_well(tap, table, tmp_path):
    """The server of these tests follows UWS 1.1: a client that is not ours understands it."""
    pyvo = pytest.importorskip("pyvo", reason="pyvo is not installed: make test-oracles")
    import urllib.request

    url, service = tap
    service.needs_run = True
    job = pyvo.dal.TAPService(url).submit_job(ADQL)
    job.run()
    job.wait(phases=["COMPLETED"], timeout=10)
    assert job.phase == "COMPLETED"
    with urllib.request.urlopen(job.result_uri) as answer:
        assert answer.read() == table


def test_list_is_sent_with_the_query(tap, table, tmp_path):
    from io import BytesIO

    from astropy.table import Table

    url, service = tap
    (tmp_path / "mine.txt").write_text("12\n34  # the second\n")
    assert main(["--upload", str(tmp_path / "mine.txt"), "--output", str(tmp_path / "a.fits"), "--url", url]) == 0
    (form,) = service.submitted()
    assert form["UPLOAD"] == "list,param:list"
    assert "FROM tap_upload.list AS t" in form["QUERY"]
    assert "g.source_id = t.source_id" in form["QUERY"]
    np.testing.assert_array_equal(Table.read(BytesIO(form["list"]), format="votable")["source_id"], [12, 34])
    assert (tmp_path / "a.fits").read_bytes() == table
    (tmp_path / "mine.txt").write_text("12\n35\n")  # another list is another question
    assert main(["--upload", str(tmp_path / "mine.txt"), "--output", str(tmp_path / "a.fits"), "--url", url]) == 1


def test_positions_are_sent_with_the_query(tap, tmp_path, capsys):
    url, service = tap
    (tmp_path / "mine.csv").write_text("name,ra,dec\na,10.5,-3.25\n")
    assert main(["--upload", str(tmp_path / "mine.csv"), "--output", str(tmp_path / "a.fits"), "--url", url]) == 0
    (form,) = service.submitted()
    assert "CIRCLE('ICRS', t.ra, t.dec, 1.0/3600)" in form["QUERY"]
    assert b"-3.25" in form["list"]
    (tmp_path / "none.csv").write_text("a,b\n1,2\n")
    assert main(["--upload", str(tmp_path / "none.csv"), "--output", str(tmp_path / "b.fits"), "--url", url]) == 1
    assert "has neither source_id nor ra and dec" in capsys.readouterr().err
