"""Tables of every kind give the same field."""

import numpy as np
import pytest
from astropy import units as u
from astropy.table import MaskedColumn
from gaia_table import N, table

from vsh import VshWarning
from vsh.io.catalogue import Columns, read_field, truth_of
from vsh.tools.errors import TableError


def test_gaias_null(tmp_path):
    """The archive writes null for what is missing; the column stays one of numbers."""
    path = tmp_path / "gaia.csv"
    table(units=False).write(path, format="ascii.csv")
    lines = path.read_text().splitlines()
    cells = lines[3].split(",")
    cells[3] = cells[-1] = "null"
    lines[3] = ",".join(cells)
    path.write_text("\n".join(lines))
    field = read_field(path, on_bad="drop")
    assert len(field) == N - 1
    assert "pmra missing: 1" in field.notes[-1]
    assert field.name[-1] == 4_000_000_000_000_000_030


def test_identifiers_keep_their_digits():
    t = table()
    t["source_id"] = MaskedColumn(t["source_id"], mask=np.arange(N) == 0)
    field = read_field(t)
    assert field.name[0] == ""
    assert field.name[-1] == "4000000000000000030"
    t["source_id"] = np.asarray(t["source_id"], float) * 2 ** np.arange(N)
    with pytest.warns(VshWarning, match="lost digits"):
        assert any("lost digits" in note for note in read_field(t).notes)


def test_columns_and_units_of_another_survey():
    t = table(units=False)
    t["mu"] = t["pmra"] * 1000
    t["mu"].unit = None
    columns = Columns(pmra="mu", name=None)
    with pytest.raises(TableError, match="column 'mu' has no unit"):
        read_field(t, columns)
    field = read_field(t, columns, units={"mu": "uas/yr"})
    np.testing.assert_allclose(field.motion[0], 1000 * t["pmra"].value)
    assert field.name is None
    same = read_field(t, {"pmra": "mu"}, units={"mu": u.uas / u.yr})
    np.testing.assert_array_equal(same.motion, field.motion)


def test_given_units_override_the_tables():
    t = table()
    field = read_field(t, units={"pmra": "uas/yr"})
    np.testing.assert_allclose(field.motion[0], t["pmra"].value)


def test_simulated_tables_tell_their_truth():
    t = table()
    assert truth_of(t) is None
    t.meta |= {f"{name}_{axis}": i for i, axis in enumerate("XYZ") for name in ("spin", "ACC")}
    np.testing.assert_array_equal(truth_of(t)["spin"].value, [0, 1, 2])


def test_names_of_vizier():
    """I/355/gaiadr3 as VizieR hands it round, alone and with a column of one's own."""
    rng = np.random.default_rng(1)
    table = {"RA_ICRS": rng.uniform(0, 360, 50), "DE_ICRS": rng.uniform(-60, 60, 50), "Source": np.arange(50), "pmRA": rng.normal(size=50), "pmDE": rng.normal(size=50),
             "e_pmRA": np.full(50, 0.1), "e_pmDE": np.full(50, 0.2), "pmRApmDEcor": np.full(50, 0.3), "Gmag": np.full(50, 18.0), "zq": np.ones(50), "Solved": np.full(50, 31)}  # fmt: skip
    units = {name: "deg" for name in ("RA_ICRS", "DE_ICRS")} | {
        name: "mas/yr" for name in ("pmRA", "pmDE", "e_pmRA", "e_pmDE")
    }
    field = read_field(table, "vizier", units)
    np.testing.assert_allclose(field.motion, 1000 * np.array([table["pmRA"], table["pmDE"]]))
    assert (field.rho == 0.3).all()
    assert (field.magnitude == 18).all()
    assert field.redshift is None
    assert (read_field(table, {"names": "vizier", "redshift": "zq"}, units).redshift == 1).all()
    table["Solved"][:3] = 3
    assert len(read_field(table, "vizier", units, on_bad="drop")) == 47
    with pytest.raises(TableError, match="no set of names is called 'sdss'; there are gaia, vizier"):
        read_field(table, "sdss", units)


@pytest.mark.parametrize(("typed", "meant"), [
    ("vizier", {"names": "vizier"}),
    ("vizier,redshift=zq", {"names": "vizier", "redshift": "zq"}),
    ("pmra=mu", {"pmra": "mu"}),
])  # fmt: skip
def test_columns_as_they_are_typed(typed, meant):
    from fit.commands.fit import make_parser

    assert make_parser().parse_args(["x.fits", "--columns", typed]).columns == meant
