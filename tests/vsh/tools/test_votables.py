"""VOTables that are written: version, units, UCDs, coordinate frame, epoch and time scale, without violations."""

import contextlib
import io

import numpy as np
import pytest
from astropy.io import votable
from astropy.table import Table

import sim
from vsh import read_field
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
def test_a_catalogue_states_its_frame(tmp_path, frame, system, ucd):
    field = sim.observe(sim.quasars(20, rng=1), sim.spin((0, 0, 3)), rng=2, release="DR5").to_frame(frame)
    document = written(field.to_table(), tmp_path / "field.vot", {"REF_EPOCH": 2016.0})
    (coordinates,) = document.resources[0].coordinate_systems
    assert (document.version, coordinates.system, coordinates.epoch) == ("1.4", system, "J2016.000")
    fields = {each.name: each for each in document.get_first_table().fields}
    assert (fields["ra"].ucd, fields["ra"].ref, str(fields["ra"].unit)) == (ucd, "frame", "deg")
    assert fields["redshift"].ref is None
    np.testing.assert_allclose(read_field(tmp_path / "field.vot").motion, field.motion, rtol=1e-12)


def test_epochs_state_their_time_scale(tmp_path):
    document = written(Table({"obs_time_tcb": [1.0, 2.0]}), tmp_path / "epochs.vot")
    (times,) = document.resources[0].time_systems
    assert (times.timescale, times.refposition, float(times.timeorigin)) == ("TCB", "BARYCENTER", 2455197.5)
    assert not document.resources[0].coordinate_systems
