"""What is written is opened by other programs, and read back as what it was."""

import shutil
import subprocess

import numpy as np
import pytest
from astropy.io import votable
from astropy.table import Table
from conftest import random_field

import fit
import vsh
from fit.commands.fit import main
from vsh import Field, TableError
from vsh.io import tables


def test_results_fields_and_tables_come_back(tmp_path):
    field = random_field(300, 1)
    solution = fit.fit_field(field, 2)
    for name in ("solution.ecsv", "solution.fits"):
        solution.write(tmp_path / name)
        assert vsh.read(tmp_path / name) == solution
    frame = fit.solve_frame(field)
    frame.write(tmp_path / "frame.ecsv")
    assert vsh.read(tmp_path / "frame.ecsv") == frame
    field.write(tmp_path / "field.fits")
    assert isinstance(vsh.read(tmp_path / "field.fits"), Field)
    tables.write_columns(tmp_path / "t.csv", {"a": np.arange(3)})
    assert vsh.read(tmp_path / "t.csv")["a"].tolist() == [0, 1, 2]
    text = (tmp_path / "frame.ecsv").read_text()
    (tmp_path / "older.ecsv").write_text(text.replace("fit.direct", "fit.solving.frame"))  # its name once
    assert vsh.read(tmp_path / "older.ecsv") == frame
    (tmp_path / "other.ecsv").write_text(text.replace("fit.direct", "os.path"))
    with pytest.raises(TableError, match="not known here, or is damaged"):
        vsh.read(tmp_path / "other.ecsv")


def test_votable_says_what_its_columns_are(tmp_path):
    random_field(5, 1).write(tmp_path / "t.vot")
    fields = votable.parse(tmp_path / "t.vot").get_first_table().fields
    ucds = {entry.name: entry.ucd for entry in fields}
    assert ucds["ra"] == "pos.eq.ra;meta.main"
    assert ucds["pmdec_error"] == "stat.error;pos.pm;pos.eq.dec"
    assert votable.ucd.check_ucd(ucds["pmra_pmdec_corr"], check_controlled_vocabulary=True)
    assert all(votable.ucd.check_ucd(ucd, check_controlled_vocabulary=True) for ucd in ucds.values())


def test_tables_in_other_formats_beside_ecsv(tmp_path, capsys):
    random_field(200, 3).write(tmp_path / "f.fits")
    out = tmp_path / "out"
    words = [str(tmp_path / "f.fits"), "--lmax", "1", "--format", "none", "--output", str(out)]
    assert main([*words, "--format", "fits,vot,csv"]) == 0
    for ending in ("fits", "vot", "csv"):
        copy = tables.read_table(out / f"solution.{ending}")
        np.testing.assert_allclose(copy["value"], Table.read(out / "solution.ecsv")["value"], rtol=1e-12)
    assert vsh.read(out / "solution.fits") == vsh.read(out / "solution.ecsv")
    assert main([*words, "--format", "fits,vot,csv", "--overwrite"]) == 0  # what it wrote, it may replace
    with pytest.raises(SystemExit):
        main([*words, "--format", "xls"])
    assert "'xls' is no format: png, pdf, svg of figures, " in capsys.readouterr().err


@pytest.mark.skipif(shutil.which("stilts") is None, reason="STILTS is not installed")
def test_stilts_reads_what_is_written(tmp_path):
    random_field(200, 3).write(tmp_path / "f.fits")
    out = tmp_path / "out"
    assert main([str(tmp_path / "f.fits"), "--lmax", "1", "--format", "none", "--output", str(out), "--format", "fits,vot,csv"]) == 0  # fmt: skip
    random_field(20, 1).write(out / "field.vot")
    written = [path for path in sorted(out.iterdir()) if path.suffix in (".fits", ".vot", ".csv")]
    assert len(written) >= 7
    for path in written:
        form = {".fits": "fits", ".vot": "votable", ".csv": "csv"}[path.suffix]
        asked = ["stilts", "tpipe", f"in={path}", f"ifmt={form}", "omode=count"]
        answer = subprocess.run(asked, capture_output=True, text=True, check=True).stdout
        assert f"rows: {len(tables.read_table(path))}" in answer, path
