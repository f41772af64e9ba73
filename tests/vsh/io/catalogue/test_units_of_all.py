"""Units of every column are converted or refused: nobody sees that kpc were taken for Mpc."""

import astropy.units as u
import numpy as np
import pytest
from astropy.table import Table

from vsh import Field, FieldError, TableError
from vsh.io.catalogue import read_field

N = 4
PLAIN = {"ra": np.arange(N) * 40.0, "dec": np.arange(N) * 10.0} | {
    name: np.ones(N) for name in ("pmra", "pmdec", "pmra_error", "pmdec_error")
}
TOLD = {"distance": "dist", "distance_error": "disterr"}


def table(unit=None, error=None):
    made = Table(PLAIN | {"dist": np.array([4.52, 8.99, 8.83, 30.0]), "disterr": np.full(N, 0.1)})
    made["dist"].unit, made["disterr"].unit = unit, error or unit
    return made


@pytest.mark.parametrize(
    ("unit", "factor"), [("Mpc", 1.0), ("kpc", 1e-3), ("pc", 1e-6), ("Gpc", 1e3), ("lyr", 3.0660139e-07)]
)
def test_lengths_are_converted(unit, factor):
    for source, given in ((table(unit), None), (table(), {"dist": unit, "disterr": unit})):
        field = read_field(source, TOLD, units=given)
        np.testing.assert_allclose(field.distance, factor * np.array([4.52, 8.99, 8.83, 30.0]), rtol=1e-7)
        np.testing.assert_allclose(field.distance_error, factor * 0.1, rtol=1e-7)
    mixed = read_field(table("Mpc", "kpc"), TOLD)
    np.testing.assert_allclose(mixed.distance_error, 1e-4)


@pytest.mark.parametrize(
    ("unit", "words"),
    [
        ("mas", "cannot be turned into Mpc"),
        ("mag", "cannot be turned into Mpc|a logarithm"),
        ("furlong", "no unit that astropy knows|cannot be turned into"),
        (None, "'dist' has no unit: say which"),
    ],
)
def test_what_is_no_length_is_refused(unit, words):
    given = {"dist": unit, "disterr": unit} if unit == "furlong" else None
    with pytest.raises(TableError, match=words):
        read_field(table(None if given else unit), TOLD, units=given)


@pytest.mark.parametrize(
    ("role", "unit"), [("redshift", "km/s"), ("redshift_error", "mag"), ("magnitude", "Jy"), ("pmra_pmdec_corr", "mas")]
)
def test_pure_numbers_and_magnitudes(role, unit):
    made = Table(PLAIN | {"x": np.full(N, 0.1)})
    made["x"].unit = unit
    with pytest.raises(TableError, match="column 'x' is in"):
        read_field(made, {role: "x"})
    made["x"].unit = "mag" if role == "magnitude" else None
    assert getattr(read_field(made, {role: "x"}), "rho" if role == "pmra_pmdec_corr" else role)[0] == pytest.approx(0.1)


def test_quantities():
    field = Field.from_columns(
        **PLAIN, distance=np.arange(1, 5) * u.kpc, distance_error=np.ones(N) * u.pc, magnitude=np.ones(N) * u.mag
    )
    np.testing.assert_allclose(field.distance, np.arange(1, 5) * 1e-3)
    for wrong in (
        {"distance": np.ones(N) * u.mas},
        {"magnitude": np.ones(N) * u.Jy},
        {"redshift": np.ones(N) * u.km / u.s},
    ):
        with pytest.raises(FieldError, match="cannot be converted"):
            Field.from_columns(**PLAIN, **wrong)


def test_written_and_read_back(tmp_path):
    field = Field.from_columns(**PLAIN, distance=np.arange(1, 5) * u.kpc, distance_error=np.ones(N) * u.pc)
    for ending in ("fits", "ecsv", "vot", "parquet"):
        field.write(tmp_path / f"t.{ending}")
        back = read_field(tmp_path / f"t.{ending}", {"distance": "distance", "distance_error": "distance_error"})
        np.testing.assert_allclose(back.distance, field.distance)


def test_marks_of_missing_values_in_one_component_are_said():
    odd = {**PLAIN, "pmra": np.array([1.0, -999.0, 99.99, 1.0])}
    field = Field.from_columns(**odd)
    assert "2 rows have a motion of -999, 99.99 in one component: a mark of missing values? It is used" in " ".join(
        map(str, field.notes)
    )
