"""VOTables that are written: version, units, UCDs, coordinate frame, epoch and time scale, without violations."""

import contextlib
import io
import re
import shutil
import subprocess

import numpy as np
import pytest
from astropy.io import votable
from astropy.table import Table

import sim
from vsh import read_field
from vsh.sky.frames import AXES
from vsh.tools.files import write_table


def written(table, path, meta=None):
    write_table(table, path, meta)
    with contextlib.redirect_stdout(io.StringIO()):
        assert votable.validate(path, output=None) is not None
    return votable.parse(path, verify="exception")


@pytest.mark.parametrize(
    ("frame", "system", "ucd"),
    [("icrs", "ICRS", "pos.eq.ra;meta.main"), ("galactic", "galactic", "pos.galactic.lon;meta.main"),
     ("ecliptic", "ecl_FK5", "pos.ecliptic.lon;meta.main")],
)  # fmt: skip
def test_catalogue_states_its_frame(tmp_path, frame, system, ucd):
    field = sim.observe(sim.quasars(20, rng=1), sim.spin((0, 0, 3)), rng=2, release="DR5").to_frame(frame)
    document = written(field.to_table(), tmp_path / "field.vot", {"REF_EPOCH": 2016.0})
    (coordinates,) = document.resources[0].coordinate_systems
    assert (document.version, coordinates.system, coordinates.epoch) == ("1.4", system, "J2016.000")
    fields = {each.name: each for each in document.get_first_table().fields}
    lon = fields[AXES[frame][0]]
    assert (lon.ucd, lon.ref, str(lon.unit)) == (ucd, "vsh_frame", "deg")
    assert fields["redshift"].ref is None
    motions = [name for name in fields if name.startswith("pm") and "corr" not in name]
    assert len(motions) == 4  # with their errors
    assert all(fields[name].ref == "vsh_frame" for name in motions)
    np.testing.assert_allclose(read_field(tmp_path / "field.vot").motion, field.motion, rtol=1e-12)


def test_epochs_state_their_time_scale(tmp_path):
    document = written(Table({"obs_time_tcb": [1.0, 2.0]}), tmp_path / "epochs.vot")
    (times,) = document.resources[0].time_systems
    assert (times.timescale, times.refposition, float(times.timeorigin)) == ("TCB", "TOPOCENTER", 2455197.5)
    assert not document.resources[0].coordinate_systems


def test_units_are_those_of_vounit(tmp_path):
    table = Table({"power": [1.0], "motion": [2.0], "kind": ["T"]})
    table["power"].unit, table["motion"].unit = "uas2 / yr2", "uas / yr"
    write_table(table, tmp_path / "units.vot")
    text = (tmp_path / "units.vot").read_text()
    units = re.findall(r'unit="([^"]*)"', text)  # of VOUnit, or of older versions of astropy
    assert set(units) in ({"uarcsec**2.yr**-2", "uarcsec.yr**-1"}, {"uarcsec2.yr-2", "uarcsec.yr-1"})
    assert 'arraysize="1"' not in text
    read = Table.read(tmp_path / "units.vot")
    assert read["power"].quantity.to_value("uas2 / yr2") == [1.0]
    assert read["kind"].tolist() == ["T"]


@pytest.mark.skipif(shutil.which("stilts") is None, reason="STILTS is not installed")
@pytest.mark.slow
def test_stilts_reads_what_commands_write(tmp_path):
    """Without an error of its checker, and with as many rows."""
    from vsh.__main__ import import_command_module

    galaxies, quasars = str(tmp_path / "galaxies.vot"), str(tmp_path / "quasars.vot")
    common = ["--format", "vot", "--format", "none", "--quiet", "--output"]
    for command, *words in (
        ["sim", "galaxies", "--number", "800", "--errors", "expected", "--quiet", "--output", galaxies],
        ["sim", "quasars", "--number", "300", "--quiet", "--output", quasars],
        ["sim", "epochs", "--number", "5", "--quiet", "--output", str(tmp_path / "epochs.vot")],
        ["fit", quasars, *common, str(tmp_path / "fit")],
        ["compare", quasars, quasars, *common, str(tmp_path / "compare")],
        ["pairs", quasars, *common, str(tmp_path / "pairs")],
        ["correlate", quasars, "--leakage", "2", *common, str(tmp_path / "correlate")],
        ["redshift", galaxies, "--on-bad", "drop", "--bins", "2", "--flows", "no", *common, str(tmp_path / "redshift")],
    ):
        assert import_command_module(command).main(words) == 0
    files = sorted(tmp_path.rglob("*.vot"))
    assert len(files) > 12
    for path in files:
        done = subprocess.run(["stilts", "votlint", f"votable={path}"], capture_output=True, text=True, check=True)
        assert done.stdout + done.stderr == "", path.name
        command = ["stilts", "tpipe", f"in={path}", "omode=count"]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        assert done.stdout.split()[-1] == str(len(Table.read(path))), path.name


def test_table_without_rows_has_data_all_the_same(tmp_path):
    """Without an element of data some readers find no table in the file."""
    write_table(Table({"ra": np.zeros(0), "name": np.zeros(0, "U3")}), tmp_path / "none.xml")
    assert "<DATA><TABLEDATA/></DATA>" in (tmp_path / "none.xml").read_text(encoding="utf-8")
    read = Table.read(tmp_path / "none.xml")
    assert (len(read), read.colnames) == (0, ["ra", "name"])


def test_counts_are_numbers_up_to_the_largest_that_a_long_holds(tmp_path):
    path = tmp_path / "counts.vot"
    document = written(Table({"a": [1.0]}), path, {"ROWS": 2**62, "MORE": 2**70})
    kinds = {each.name: each.datatype for each in (*document.resources[0].params, *document.get_first_table().params)}
    assert kinds["ROWS"] == "long"
    assert kinds["MORE"] != "long"
