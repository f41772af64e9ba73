"""DR4's first day against servers on this machine: a schema whose names changed, epochs in batches that are cut off."""

import io
import json
import zipfile

import numpy as np
import pytest
from astropy.table import Table
from tap_server import posting as serving

import sim
from vsh.commands.archive import main
from vsh.io import archive
from vsh.io.archive import DR3, DR4, GAIA_CRF3, check_schema, fetch_epochs, of_table, read_ids
from vsh.io.epochs import epoch_files, read_observations
from vsh.tools.errors import ArchiveError

QUASARS = 7


def columns_of(*changed):
    """A gaiadr4 that has all that we ask for but for three names."""
    known = {"gaia_source": set(), "all_source_astrometry": set(), "all_source_photometry": {"source_id"}}
    known["dr3_neighbourhood"] = {"dr3_source_id", "dr4_source_id", "angular_distance", "magnitude_difference"}
    for each in archive.ASTROMETRY:
        adql = of_table("t.t", release=DR4, astrometry=each)
        for alias, name in [word.strip(",").split(".") for word in adql.split() if word[:2] in ("g.", "s.")]:
            known["all_source_photometry" if alias == "s" else each].add(name)
    for table, old, new in changed:
        if old is None:
            known[new] = known.pop(table)
        else:
            known[table] = {new if name == old else name for name in known[table]}
    rows = [f"gaiadr4.{table},{name}" for table, names in known.items() for name in sorted(names)]
    return "\n".join(["table_name,column_name", *rows]).encode()


def test_check_names_what_changed(capsys):
    body = columns_of(
        ("gaia_source", "tentative_parallax_bias", "parallax_bias"),
        ("gaia_source", "visibility_periods_used", "visibility_periods_used_al"),
        ("all_source_photometry", None, "all_sources_photometry"),
    )
    with serving(lambda path, form: (200, body)) as (url, asked):
        checked = check_schema("gaiadr4", f"{url}/tap")
        assert main(["--check", "gaiadr4", "--url", f"{url}/tap"]) == 0  # dr3-neighbourhood runs
    assert asked[0][0] == "/tap/sync"
    assert "TAP_SCHEMA.columns" in asked[0][1]["QUERY"]
    best, core = (checked.missing[f"a table of sources, --table {each}"] for each in archive.ASTROMETRY)
    assert set(best) == {
        ("gaiadr4.gaia_source.tentative_parallax_bias", "gaiadr4.gaia_source.parallax_bias"),
        ("gaiadr4.gaia_source.visibility_periods_used", "gaiadr4.gaia_source.visibility_periods_used_al"),
    }
    assert core == (("gaiadr4.all_source_photometry", "gaiadr4.all_sources_photometry"),)
    text = " ".join(capsys.readouterr().out.split())
    assert "--table gaia_source does not run" in text
    assert "gaiadr4.gaia_source.tentative_parallax_bias gaiadr4.gaia_source.parallax_bias" in text
    assert len(checked.to_table()) == 3


def test_check_of_a_schema_as_we_know_it():
    with serving(lambda path, form: (200, columns_of())) as (url, _):
        assert not any(check_schema("gaiadr4", url).missing.values())
        with pytest.raises(ArchiveError, match="no name of a schema"):
            check_schema("gaiadr4'; DROP", url)
    for body, words in ((b"table_name,column_name\n", "has no schema gaiadr4"), (b"<html>", "sent no list of columns")):
        with serving(lambda path, form, body=body: (200, body)) as (url, _), pytest.raises(ArchiveError, match=words):
            check_schema("gaiadr4", url)


def test_check_asks_for_the_tables_of_the_queries_and_again_where_it_is_cut(capsys):
    """Synchronous answers are cut at 2000 rows without a word: the schema has 7000 columns."""
    with serving(lambda path, form: (200, columns_of())) as (url, asked):
        check_schema("gaiadr4", url)
    (form,) = [form for _, form in asked]
    assert "WHERE table_name IN ('gaiadr4.all_source_astrometry', " in form["QUERY"]
    many = b"table_name,column_name\n" + b"".join(b"gaiadr4.aa_table,c%d\n" % k for k in range(2000))
    with serving(lambda path, form: (200, many)) as (url, asked):
        assert main(["--check", "gaiadr4", "--url", f"{url}/tap"]) == 1  # asked as a job, which this server lacks
    assert [path for path, _ in asked] == ["/tap/sync", "/tap/async"]
    assert asked[1][1]["FORMAT"] == "csv"
    nothing = columns_of(
        ("gaia_source", None, "a"), ("all_source_astrometry", None, "b"), ("dr3_neighbourhood", None, "c")
    )
    with serving(lambda path, form: (200, nothing)) as (url, _):
        assert main(["--check", "gaiadr4", "--url", f"{url}/tap"]) == 1
    assert "no query runs in gaiadr4" in capsys.readouterr().err


def test_queries_fetch_what_the_referee_looks_at():
    """Three checks of the referee could not be answered by a catalogue that vsh-archive fetched."""
    wanted = [
        "visibility_periods_used",
        "matched_transits",
        "scan_direction_strength_k2",
        "scan_direction_mean_k2",
        "ruwe",
    ]
    for adql in (GAIA_CRF3, of_table("a.b", release=DR3), of_table("a.b", release=DR4)):
        assert all(f"g.{name}" in adql for name in wanted)


@pytest.fixture(scope="module")
def transits():
    return sim.epochs(sim.quasars(QUASARS, rng=1), sim.spin((0, 0, 100)), rng=2)


def packed(transits, ids):
    """The server's answer: a zip archive with a VOTable of these sources."""
    rows = transits[np.isin(transits["source_id"], [int(each) for each in ids])]
    table, body = io.BytesIO(), io.BytesIO()
    rows.write(table, format="votable")
    with zipfile.ZipFile(body, "w") as archive_:
        archive_.writestr("EPOCH_ASTROMETRY_COMBINED.xml", table.getvalue())
    return body.getvalue()


def test_epochs_come_in_batches_and_are_resumed(transits, tmp_path):
    ids, cut = list(range(1, QUASARS + 1)), [True]

    def reply(path, form):
        chosen = form["ID"].split(",")
        if chosen == ["4", "5", "6"] and cut[0]:
            return 500, b"the server is tired"
        return 200, packed(transits, chosen)

    with serving(reply) as (url, asked):
        with pytest.raises(ArchiveError, match="answered 500: the server is tired"):
            fetch_epochs(ids, tmp_path / "epochs", f"{url}/data", batch=3, progress=False)
        cut[0] = False
        folder = fetch_epochs(ids, tmp_path / "epochs", f"{url}/data", batch=3, progress=False)
        assert [form["ID"] for _, form in asked] == ["1,2,3", "4,5,6", "4,5,6", "7"]  # the first batch was kept
        before = len(asked)
        assert fetch_epochs(ids, folder, f"{url}/data", batch=3, progress=False) == folder
        assert len(asked) == before
        (folder / "epochs-00002-00000.vot").unlink()  # fetched again
        fetch_epochs(ids, folder, f"{url}/data", batch=3, progress=False)
        assert len(asked) == before + 1
        whole = (folder / "epochs-00002-00000.vot").read_bytes()
        (folder / "epochs-00002-00000.vot").write_text("changed")  # somebody's work, which is not deleted
        with pytest.raises(ArchiveError, match=r"epochs-00002-00000.vot is not as it was fetched: somebody changed it"):
            fetch_epochs(ids, folder, f"{url}/data", batch=3, progress=False)
        assert (folder / "epochs-00002-00000.vot").read_text() == "changed"
        (folder / "epochs-00002-00000.vot").write_bytes(whole)
        with pytest.raises(ArchiveError, match="answer to another request"):
            fetch_epochs(ids[:3], folder, f"{url}/data", batch=3, progress=False)
    form = asked[0][1]
    assert form["RETRIEVAL_TYPE"] == "EPOCH_ASTROMETRY"
    assert form["RELEASE"] == "Gaia DR4"
    note = json.loads((tmp_path / "epochs.json").read_text())
    assert len(note["files"]) == 3
    names = np.concatenate([read_observations(each).name for each in epoch_files(folder)])
    assert sorted(names) == ids


def test_run_that_was_killed_in_its_first_batch_goes_on(transits, tmp_path, monkeypatch):
    """A file was there and no note of it, or half a file under its unfinished name: refused, or left for ever."""

    def killed(path):
        raise KeyboardInterrupt

    with serving(lambda path, form: (200, packed(transits, form["ID"].split(",")))) as (url, _):
        with monkeypatch.context() as patch:
            patch.setattr("vsh.io.archive._epochs.digest", killed)
            with pytest.raises(KeyboardInterrupt):
                fetch_epochs([1, 2, 3], tmp_path / "epochs", f"{url}/data", batch=2, progress=False)
        (tmp_path / "epochs" / ".vsh-unfinished-abc-epochs-00000-00000.vot").write_text("hal")
        folder = fetch_epochs([1, 2, 3], tmp_path / "epochs", f"{url}/data", batch=2, progress=False)
    assert {path.name for path in folder.iterdir()} == {"epochs-00000-00000.vot", "epochs-00001-00000.vot"}


def test_epochs_on_the_command_line(transits, tmp_path, capsys):
    Table({"source_id": [3, 1, 2]}).write(tmp_path / "list.fits")
    with serving(lambda path, form: (200, packed(transits, form["ID"].split(",")))) as (url, asked):
        words = f"epochs --ids {tmp_path / 'list.fits'} --output {tmp_path / 'out'} --url {url}/data"
        assert main([*words.split(), "--structure", "INDIVIDUAL"]) == 0
    assert "1 files of 3 sources" in capsys.readouterr().out
    assert {form["DATA_STRUCTURE"] for _, form in asked} == {"INDIVIDUAL"}
    for wrong in (["epochs", "--output", "x"], ["gaia-crf3", "--ids", "x", "--show"], []):
        with pytest.raises(SystemExit):
            main(wrong)


def test_structure_is_what_the_server_knows(transits, tmp_path):
    """ESA's server refuses structures that it does not know, and lists those that it does."""

    def reply(path, form):
        if form["DATA_STRUCTURE"] not in ("RAW", "INDIVIDUAL"):
            words = f"Invalid Data Structure parameter: '{form['DATA_STRUCTURE']}', valid ones are: RAW, INDIVIDUAL"
            return 500, f"Error 500:\n{words}\n".encode()
        return 200, packed(transits, form["ID"].split(","))

    with serving(reply) as (url, asked):
        fetch_epochs([1, 2, 3], tmp_path / "epochs", url, batch=2, progress=False)
        assert [form["DATA_STRUCTURE"] for _, form in asked] == ["DATAMODEL_GAIA", "RAW", "RAW"]
        with pytest.raises(ArchiveError, match="valid ones are: RAW, INDIVIDUAL"):
            fetch_epochs([1], tmp_path / "own", url, structure="COMBINED", progress=False)


def test_sources_without_epochs_are_listed(transits, tmp_path, capsys):
    (tmp_path / "ids.txt").write_text("1\n2\n99\n")
    words = ["epochs", "--ids", str(tmp_path / "ids.txt"), "--output", str(tmp_path / "out")]
    with serving(lambda path, form: (200, packed(transits, form["ID"].split(",")))) as (url, asked):
        assert main([*words, "--url", url]) == 0
        assert "1 of 3 sources have no epochs: 99" in capsys.readouterr().out
        assert main([*words, "--url", url]) == 0  # nothing is asked again
    assert len(asked) == 1
    assert json.loads((tmp_path / "out.json").read_text())["missing"] == {"epochs-00000": [99]}


def test_zip_as_it_was_downloaded_is_read(transits, tmp_path):
    """astroquery leaves one archive with a file for each source."""
    with zipfile.ZipFile(tmp_path / "datalink_output.zip", "w") as archive_:
        for source_id in (2, 5):
            body = io.BytesIO()
            transits[transits["source_id"] == source_id].write(body, format="votable")
            archive_.writestr(f"EPOCH_ASTROMETRY-Gaia DR4 {source_id}.xml", body.getvalue())
    (path,) = epoch_files(tmp_path / "datalink_output.zip")
    np.testing.assert_array_equal(read_observations(path).name, [2, 5])


def zipped(content, name="x.vot"):
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w") as archive_:
        archive_.writestr(name, content)
    return body.getvalue()


FOREIGN = b"<VOTABLE version='1.4'><RESOURCE><TABLE><FIELD name='a' datatype='int'/><DATA><TABLEDATA><TR><TD>1</TD></TR></TABLEDATA></DATA></TABLE></RESOURCE></VOTABLE>"
NO = b"<VOTABLE><RESOURCE><INFO name='QUERY_STATUS' value='ERROR'>no such product</INFO></RESOURCE></VOTABLE>"


@pytest.mark.parametrize(("body", "words"), [
    (FOREIGN, "it has no column source_id"),
    (NO, "no such product"),
    (zipped(b"<html>log in</html>"), "sent no epochs in x.vot"),
    (zipped(b""), "sent no epochs in x.vot"),
    (zipped(NO), "no such product"),
    (b"PK\x05\x06" + bytes(18), "sent an empty archive"),
    (b"PK\x03\x04damaged", "sent no whole archive"),
    (b"<html>log in</html>", "sent no epochs: log in"),
])  # fmt: skip
def test_answers_that_are_none(body, words, tmp_path):
    with serving(lambda path, form: (200, body)) as (url, _), pytest.raises(ArchiveError, match=words):
        fetch_epochs([1], tmp_path / "epochs", url, progress=False)
    assert not list((tmp_path / "epochs").iterdir())


def test_lists_of_sources(tmp_path):
    (tmp_path / "ids.txt").write_text("# mine\n4318465066420528000\n12  # another\n")
    assert read_ids(tmp_path / "ids.txt") == [4318465066420528000, 12]
    (tmp_path / "ids.txt").write_text("quasar\n")
    with pytest.raises(ArchiveError, match="1 of 1 source_id are no whole numbers"):
        read_ids(tmp_path / "ids.txt")
    with pytest.raises(ArchiveError, match="has no column source_id"):
        read_ids(Table({"name": [1]}))
