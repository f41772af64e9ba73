"""The table of what columns are: words of the IVOA, and a meaning for every column that is written."""

import numpy as np
import pytest
from astropy.io import fits, votable
from astropy.io.votable.ucd import parse_ucd
from astropy.table import Table
from conftest import random_field
from every_result import RESULTS

import fit
import sim
from vsh import Coefficients
from vsh.io.tables import open_table
from vsh.tools.files import write_table
from vsh.tools.formats import _read_column_meanings, find_column_meaning

#: Columns without a meaning of their own: rows of matrices, and what is called as a user calls it.
OF_USERS = ("H0", "seen", "of", "real", "imaginary", "n", "less", "gain", "norm", "rate", "shear", "slope",
            "harmonics", "frame_solver", "galaxies", "quasars", "waves", "place", "r0", "t(", "s(", "omega_", "a_",
            "matrix_", "sigma_omega_", "sigma_epsilon_")  # fmt: skip


@pytest.mark.parametrize(
    ("pattern", "column"), _read_column_meanings(), ids=lambda each: each if isinstance(each, str) else ""
)
def test_words_are_those_of_the_ivoa(pattern, column):
    assert parse_ucd(column.ucd, check_controlled_vocabulary=True), pattern
    assert column.meaning.endswith(".")
    assert column.meaning[0].isupper() or column.meaning[0].isdigit()


@pytest.mark.slow
@pytest.mark.parametrize("kind", sorted(RESULTS))
def test_columns_of_every_result_have_a_meaning(kind):
    table = RESULTS[kind]().to_table()
    unknown = [name for name in table.colnames if find_column_meaning(name, table[name].unit) is None]
    assert [name for name in unknown if not name.startswith(OF_USERS)] == []


def test_errors_are_those_of_what_has_them():
    assert find_column_meaning("pmra_error").ucd == "stat.error;pos.pm;pos.eq.ra"
    assert find_column_meaning("sigma_x", "uas / yr").ucd == "stat.error;pos.cartesian.x"
    assert find_column_meaning("pmra_error").meaning == f"Standard error of this: {find_column_meaning('pmra').meaning}"
    assert find_column_meaning("nothing_error") is None
    assert find_column_meaning("l").meaning == "Degree."
    assert find_column_meaning("l", "deg").ucd == "pos.galactic.lon;meta.main"


@pytest.mark.parametrize(("simulate", "epoch"), [(sim.crf3, "J2016.000"), (sim.crf4, "J2017.500")])
def test_simulated_catalogues_state_the_epoch_of_positions(tmp_path, simulate, epoch):
    write_table(simulate(1, n_five=20, n_six=5), tmp_path / "c.vot")
    (system,) = votable.parse(tmp_path / "c.vot").resources[0].coordinate_systems
    assert system.epoch == epoch


@pytest.mark.parametrize("ending", ["ecsv", "fits", "vot", "parquet"])
def test_files_say_what_columns_are(tmp_path, ending):
    write_table(Table({"pmra": [1.0], "mine": [2.0]}), tmp_path / f"c.{ending}")
    descriptions = open_table(tmp_path / f"c.{ending}").descriptions
    assert descriptions == {"pmra": find_column_meaning("pmra").meaning}


def test_degree_is_no_longitude(tmp_path):
    """TOPCAT would take it for a position."""
    fit.fit_field(random_field(50, 1), 1).to_table().write(tmp_path / "plain.ecsv")
    write_table(Table.read(tmp_path / "plain.ecsv"), tmp_path / "solution.vot")
    document = votable.parse(tmp_path / "solution.vot")
    (degree,) = (entry for entry in document.get_first_table().fields if entry.name == "l")
    assert (degree.ucd, degree.ref) == ("meta.number", None)
    assert not document.resources[0].coordinate_systems


def test_own_descriptions_stay(tmp_path):
    table = Table({"pmra": [1.0]})
    table["pmra"].description = "mine"
    write_table(table, tmp_path / "c.ecsv")
    assert Table.read(tmp_path / "c.ecsv")["pmra"].description == "mine"


def test_fits_has_names_and_headers_that_checkers_like(tmp_path):
    write_table(Table({"t(2,2,im)": [1.0], "s(1,0)": [2.0]}), tmp_path / "c.fits", {"LONG": 100 * "x", "SHORT": "y"})
    assert Table.read(tmp_path / "c.fits").colnames == ["t_2_2_im", "s_1_0"]
    header = fits.getheader(tmp_path / "c.fits", 1)
    assert (header["LONGSTRN"], header["LONG"]) == ("OGIP 1.0", 100 * "x")
    write_table(Table({"x": [1.0]}), tmp_path / "d.fits", {"SHORT": "y"})
    assert "LONGSTRN" not in fits.getheader(tmp_path / "d.fits", 1)


def test_field_has_the_shape_of_the_places():
    field = Coefficients.from_vectors((1, 2, 3), (4, 5, 6))
    flat = field.at([0.1, 0.2, 0.3, 0.4], 0.5)
    np.testing.assert_allclose(field.at(0.1, 0.5), flat[:, 0], rtol=1e-14)
    assert field.at(0.1, 0.5).shape == (2,)
    assert field.at([[0.1, 0.2], [0.3, 0.4]], 0.5).tolist() == flat.reshape(2, 2, 2).tolist()
