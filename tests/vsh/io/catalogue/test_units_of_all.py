"""Units of every column are converted or refused: nobody sees that kpc were taken as Mpc."""

import astropy.units as u
import numpy as np
import pytest
from astropy.table import Table
from gaia_table import NAMES
from gaia_table import table as table_of_gaia

import fit
from vsh import Field, FieldError, TableError, VshWarning
from vsh.io.catalogue import read_field
from vsh.tools.notes import DOUBT, CodedNote, doubts_of

N = 4
PLAIN = {"ra": np.arange(N) * 40.0, "dec": np.arange(N) * 10.0} | {name: np.ones(N) for name in NAMES[2:]}
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


@pytest.mark.parametrize(("unit", "words"), [
    ("mas", "cannot be turned into Mpc: if it is a parallax, say so, --columns parallax=dist"),
    ("mag", "not a length: if it is a distance modulus, say so, --units dist=mag"),
    ("furlong", "no unit that astropy knows|cannot be turned into"),
    (None, r"'dist', 'disterr' have no unit: say which.*--units dist=Mpc,disterr=Mpc"),
])  # fmt: skip
def test_units_that_are_no_length_are_refused(unit, words):
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


ROLES = {
    "ra": ("deg", "rad", "mas/yr"), "dec": ("deg", "arcsec", "s"), "pmra": ("mas/yr", "uas/yr", "mas"),
    "pmdec": ("mas/yr", "deg/s", "km/s"), "pmra_error": ("mas/yr", "arcsec/yr", "mag"),
    "pmdec_error": ("mas/yr", "mas/d", ""), "pmra_pmdec_corr": ("", "percent", "mas/yr"),
    "magnitude": ("mag", "mag(AB)", "Jy"), "redshift": ("", "percent", "km/s"), "redshift_error": ("", "percent", "mag"),
    "distance": ("Mpc", "kpc", "s"), "distance_error": ("Mpc", "lyr", "mas"), "parallax": ("mas", "uas", "pc"),
    "parallax_error": ("mas", "arcsec", "mag"),
}  # fmt: skip


@pytest.mark.parametrize("role", ROLES)
def test_every_role_with_every_kind_of_unit(role):
    """Right, convertible, wrong and nonsense: as it is, converted, refused by name, refused by name."""
    right, other, wrong = ROLES[role]
    made = Table(PLAIN | {"ra": np.arange(N) * 0.5} | {name: np.full(N, 0.2) for name in ROLES if name not in PLAIN})
    columns = {name: name for name in ROLES}
    for name, (unit, *_) in ROLES.items():
        made[name].unit = unit or None

    def value(unit):
        made[role].unit = unit or None
        field = read_field(made, columns)
        where = {"ra": "lon", "dec": "lat", "pmra_pmdec_corr": "rho"}
        if role.startswith("pm") and role != "pmra_pmdec_corr":
            return (field.sigma if role.endswith("error") else field.motion)[int("dec" in role), 1]
        return getattr(field, where.get(role, role))[1]

    plain = value(right)
    if role in ("redshift", "redshift_error"):  # a percentage is no redshift
        with pytest.raises(TableError, match=f"column {role!r} is in '%', not a redshift"):
            value(other)
    else:
        factor = 1.0 if role == "magnitude" else (1 * u.Unit(other)).to_value(u.Unit(right))
        assert value(other) == pytest.approx(plain * factor, rel=1e-9)
    for unit in (wrong, "blurb/fortnight"):
        if unit:
            with pytest.raises(TableError, match=role):
                value(unit)


def test_one_question_for_all_motions_with_a_wrong_unit():
    """Where a table says mas for mas/yr, one answer is for the four columns."""
    made, names = table_of_gaia(30), NAMES[2:6]
    for name in names:
        made[name].unit = "mas"
    with pytest.raises(TableError) as caught:
        read_field(made)
    assert f"--units '{','.join(f'{name}=…' for name in names)}'" in str(caught.value)
    assert len(read_field(made, units=dict.fromkeys(names, "mas/yr"))) == 30


def test_nonlinear_units_are_requested():
    made = Table(PLAIN | {"cz": np.full(N, 2997.92458), "mu": np.full(N, 30.0), "e_mu": np.full(N, 0.1)})
    made["cz"].unit, made["mu"].unit, made["e_mu"].unit = "km/s", "mag", "mag"
    with pytest.raises(TableError, match=r"if it is c z, say so, --units cz=km/s"):
        read_field(made, {"redshift": "cz"})
    assert read_field(made, {"redshift": "cz"}, {"cz": "km/s"}).redshift[0] == pytest.approx(0.01)
    made["percent"] = np.full(N, 1.0)
    assert read_field(made, {"redshift": "percent"}, {"percent": "percent"}).redshift[0] == pytest.approx(0.01)
    moduli = {"distance": "mu", "distance_error": "e_mu"}
    field = read_field(made, moduli, {"mu": "mag", "e_mu": "mag"})
    np.testing.assert_allclose(field.distance, 10.0)
    np.testing.assert_allclose(field.distance_error, np.log(10) / 5)
    made["e_mu"].unit = "Mpc"
    with pytest.raises(TableError, match="both in mag"):
        read_field(made, moduli, {"mu": "mag"})


@pytest.mark.parametrize(("change", "words"), [
    ({"pmra_error": 300.0, "pmdec_error": 300.0}, "errors are above 3e.05 µas/yr, .*µas/yr read as mas/yr"),
    ({"pmra_error": 1e-6, "pmdec_error": 1e-6}, "below 0.001 µas/yr, .*mas/yr read as µas/yr"),
    ({"pmra": 5000.0, "pmdec": 5000.0}, "half of the motions are above 5e.06 µas/yr"),
    ({"redshift": 900.0}, "40 values of redshift beyond -1 … 20 taken as missing: velocities in km/s"),
])  # fmt: skip
def test_sizes_that_no_survey_has_are_doubted_and_not_changed(change, words):
    made = {name: np.tile(values, 10) for name, values in PLAIN.items()} | {
        name: np.full(10 * N, value) for name, value in change.items()
    }
    with pytest.warns(match=words):
        field = read_field(made)
    assert any("warning: half of" in note for note in field.notes) == ("redshift" not in change)
    plain = {name: np.tile(values, 10) for name, values in PLAIN.items()}
    assert not any("half of" in note for note in read_field(plain).notes)
    if "redshift" not in change:
        name = next(iter(change))
        kept = field.sigma if name.endswith("error") else field.motion
        np.testing.assert_allclose(kept, 1000 * change[name])


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


def test_marks_of_missing_values_in_one_component_are_said():
    odd = {**PLAIN, "pmra": np.array([1.0, -999.0, 99.99, 1.0])}
    field = Field.from_columns(**odd)
    assert "2 rows have a motion of -999, 99.99 in one component: a mark of missing values? It is used" in " ".join(
        map(str, field.notes)
    )


def test_what_is_assumed_of_motions_stands_in_the_first_lines():
    """Positions had a unit and motions none; motions had one and errors another: it was a note at the end."""
    made = table_of_gaia(units=False)
    made["ra"].unit = made["dec"].unit = "deg"
    assert "taken in mas / yr" in dict(fit.recommended(read_field(made)).answer.lines)["units"]
    mixed = read_field(made, units=dict(zip(NAMES[2:], ("mas/yr", "uas/yr") * 2)))
    assert "in different units: is that so?" in dict(fit.fit_field(mixed, 1).answer.lines)["units"]


def test_numbers_of_another_kind_are_named():
    """Correlations in per cent lost 97 % of the rows to --on-bad drop, and variances were asked for as errors."""
    made = Table(PLAIN)
    made["pmra_pmdec_corr"] = np.linspace(-60.0, 60.0, N)
    with pytest.raises(
        FieldError, match=r"beyond ±1: are they in per cent\? Say so, units=\{'pmra_pmdec_corr': 'percent'\}"
    ):
        read_field(made)
    assert read_field(made, units={"pmra_pmdec_corr": "percent"}).rho[0] == pytest.approx(-0.6)
    made["pmra_pmdec_corr"] = np.linspace(-0.6, 1.2, N)  # a few are errors of rows
    with pytest.raises(FieldError, match="rows cannot be used"):
        read_field(made)
    made = Table(PLAIN)
    made["pmra_error"].unit = "mas2/yr2"
    with pytest.raises(TableError, match="column 'pmra_error' is in 'mas2 / yr2', a variance: give its root"):
        read_field(made)


def test_distances_beside_redshifts_are_said_to_be_unread():
    made = Table(PLAIN | {"redshift": np.full(N, 0.01), "distance": np.full(N, 40.0), "e": np.full(N, 4.0)})
    made["distance"].unit = made["e"].unit = "Mpc"
    assert any("column distance is not used: --columns distance=" in str(note) for note in read_field(made).notes)
    read = read_field(made, {"distance": "distance", "distance_error": "e"})
    assert not any("is not used" in str(note) for note in read.notes)
    assert read.distance[0] == 40.0


def test_redshifts_of_one_value_are_doubted():
    """300 of 3000 redshifts of exactly one halved the velocity of the galaxies without a word."""
    rng = np.random.default_rng(2)
    made = Table({"ra": rng.uniform(0, 360, 200), "dec": rng.uniform(-80, 80, 200)})
    for name in NAMES[2:]:
        made[name] = rng.uniform(0.1, 0.3, 200)
    made["redshift"] = np.random.default_rng(1).uniform(0.01, 0.3, 200)
    assert not [note for note in read_field(made).notes if "exactly" in note]
    made["redshift"][:30] = 1.0
    with pytest.warns(VshWarning, match="30 redshifts are exactly 1: a mark of missing ones"):
        field = read_field(made)
    assert (field.redshift == 1.0).sum() == 30  # they are used
    made["redshift"] = np.maximum(
        np.random.default_rng(1).uniform(-0.05, 0.3, 200), 0.01
    )  # nor is a limit of the sample
    assert not [note for note in read_field(made).notes if "exactly" in note]
    made["redshift"] = np.round(np.random.default_rng(1).uniform(0.01, 0.3, 200), 1)  # rounded ones are none
    assert not [note for note in read_field(made).notes if "exactly" in note]


def test_doubts_of_many_parts_are_one_line():
    """Parts count for themselves: twenty of them were twenty lines before the result."""
    notes = [CodedNote(f"warning: {n} redshifts are exactly 1: a mark?", DOUBT) for n in (30, 31, 29)]
    other = CodedNote("warning: half of the errors are above 4e+05 µas/yr", DOUBT)
    lines = doubts_of([*notes, "a note", other])
    assert lines == [("doubt", f"30 redshifts are exactly 1: a mark?; {other.removeprefix('warning: ')}")]
    assert doubts_of(["a note"]) == []
