"""Values are checked by what they are used for, never by the names of their columns; a remedy cannot do harm."""

import re
import shlex

import numpy as np
import pytest
from astropy.table import Table

import fit
import vsh
from vsh import Field
from vsh.io.catalogue import read_field, read_sources
from vsh.tools.errors import FieldError, TableError, VshError, VshWarning

N = 300
NAMES = [("ra", "dec"), ("RA", "DEC"), ("RA_ICRS", "DE_ICRS"), ("RAJ2000", "DEJ2000"), ("alpha", "delta")]


def sky():
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(0, 2 * np.pi, N), np.arcsin(rng.uniform(-1, 1, N))
    return Field(lon, lat, rng.normal(0, 300, (2, N)), np.full((2, N), 300.0))


def table(field=None, names=("ra", "dec"), units=False):
    made = (field or sky()).to_table()
    if not units:
        for name in made.colnames:
            made[name].unit = None
    made.rename_columns(["ra", "dec"], names)
    if names[1].startswith("DE") and names[1] != "DEC":  # as VizieR has them
        made.rename_columns(["pmra", "pmdec", "pmra_error", "pmdec_error"], ["pmRA", "pmDE", "e_pmRA", "e_pmDE"])
        for name in ("pmRA", "pmDE", "e_pmRA", "e_pmDE"):
            made[name].unit = "mas/yr"
    return made


def columns(names):
    return None if names != ("alpha", "delta") else {"ra": names[0], "dec": names[1]}


@pytest.mark.parametrize("names", NAMES)
@pytest.mark.parametrize("read", [read_field, read_sources])
def test_hours_and_radians_under_every_name_are_asked_for(names, read):
    made = table(names=names)
    made[names[0]] /= 15
    with pytest.raises(FieldError, match=f"is {names[0]} in hours"):
        read(made, columns(names))
    made = table(names=names)
    for name in names:
        made[name] = np.radians(made[name])
    with pytest.raises(FieldError, match="radians"):
        read(made, columns(names))


@pytest.mark.parametrize("unit", ["h", "hr", "hour", "hourangle", "hours"])
def test_hours_of_a_right_ascension_are_read(unit):
    made = table()
    made["ra"] /= 15
    read = read_field(made, units={"ra": unit})
    np.testing.assert_allclose(read.lon, sky().lon, rtol=1e-12)
    assert read_field(made, units={"ra": "deg"}).lon.max() < 0.5  # who says so may have a narrow field
    with pytest.raises(TableError, match="cannot be turned into deg"):
        read_field(made, units={"ra": "hourangle", "dec": "h"})


@pytest.mark.parametrize("label", ["RA (J2000)", "RA [2000]", "RA(ICRS)", "RA (ep=2016.0)"])
def test_what_stands_in_brackets_may_be_an_equinox(label):
    made = table(names=(label, label.replace("RA", "Dec")))
    read = read_field(made, {"ra": label, "dec": label.replace("RA", "Dec")})
    np.testing.assert_allclose(read.lon, sky().lon, rtol=1e-12)


def test_positions_of_1950_are_refused():
    with pytest.raises(TableError, match="B1950"):
        read_field(table(names=("RAB1950", "DEB1950")), {"ra": "RAB1950", "dec": "DEB1950"})


@pytest.mark.parametrize("zeros", [4, 200])
def test_motions_of_exactly_zero_are_missing(zeros):
    made = table()
    for name in ("pmra", "pmdec"):
        made[name][:zeros] = 0.0
    read = read_field(made)
    assert len(read) == N - zeros
    assert any("exactly 0" in str(note) and f"{zeros} of {N}" in str(note) for note in read.notes)
    for name in ("pmra_error", "pmdec_error"):
        made[name][:zeros] = 0.0
    assert len(read_field(made, sigma=100.0)) == N - zeros  # where our own message leads


def test_rounded_motions_and_sources_at_rest_are_kept():
    made = table()
    for name in ("pmra", "pmdec"):
        made[name] = np.round(made[name])
    assert len(read_field(made)) == N
    assert len(read_field(Field(sky().lon, sky().lat, np.zeros((2, N)), np.full((2, N), 9.0)).to_table())) == N
    assert len(read_sources(made["ra", "dec"])) == N


@pytest.mark.parametrize("mark", [9.99e9, -1e31, -32768.0, 2147483647.0, -9999.0])
@pytest.mark.parametrize("name", ["pmra", "pmdec_error"])
def test_usual_marks_of_missing_values_are_left_out(mark, name):
    made = table()
    made[name][7] = mark
    assert len(read_field(made, on_bad="drop")) == N - 1


def test_motions_far_below_their_errors_are_no_result():
    made = table()
    for name in ("pmra", "pmdec"):
        made[name] /= 3.6e6
    with pytest.warns(VshWarning, match="no motion is above"):
        field = read_field(made, sigma=4000.0)
    result = fit.recommended(field)
    assert result.verdict.startswith("acceleration   no result: residuals are far below the errors")
    assert not any("no motion is above" in str(note) for note in read_field(table()).notes)


def test_a_bad_angle_is_named_and_can_be_left_out(tmp_path):
    rows = [f"{k % 24:02d}:10:00.0,-{k % 80:02d}:00:30,1.0,{k}.5,0.3,0.3" for k in range(40)]
    rows[29] = "C11 " + rows[29]
    path = tmp_path / "t.csv"
    path.write_text("ra,dec,pmra,pmdec,pmra_error,pmdec_error\n" + "\n".join(rows) + "\n")
    with pytest.raises(FieldError, match="row 29"):
        read_field(path)
    assert len(read_field(path, on_bad="drop")) == 39


def test_names_behind_a_hash_over_angles_lose_no_source(tmp_path):
    rows = [f"s{k}, {k % 24:02d}:10:00.0, -{k % 80:02d}:00:30" for k in range(30)]
    path = tmp_path / "t.csv"
    path.write_text("#name,RA2000,Dec2000\n" + "\n".join(rows) + "\n")
    assert len(read_sources(path, {"ra": "RA2000", "dec": "Dec2000"})) == 30


@pytest.mark.parametrize(
    ("unit", "factor"),
    [("muas/yr", 1e-3), ("microarcsec/yr", 1e-3), ("milliarcsec/yr", 1), ("mas/y", 1), ("MAS/YR", 1),
     ("arcsec/century", 10), ("Angular Velocity[mas/year]", 1), ("[mas/yr]", 1)],
)  # fmt: skip
def test_units_as_tables_write_them(unit, factor):
    made = table()
    for name in ("pmra", "pmdec", "pmra_error", "pmdec_error"):
        made[name] /= factor
    read = read_field(made, units=dict.fromkeys(("pmra", "pmdec", "pmra_error", "pmdec_error"), unit))
    np.testing.assert_allclose(read.motion, sky().motion, rtol=1e-12)


# What our own messages propose, done as they say.


def _hours():
    made = table(names=("RA", "DEC"))
    made["RA"] /= 15
    return made


def _radians():
    made = table()
    for name in ("ra", "dec"):
        made[name] = np.radians(made[name])
    return made


def _without_errors():
    made = table(units=True)
    made.remove_columns(["pmra_error", "pmdec_error", "pmra_pmdec_corr"])
    return made


def _galactic():
    field = sky().to_frame("galactic")
    made = Table({"l": np.degrees(field.lon), "b": np.degrees(field.lat)})
    for name, values in zip(("east", "north", "e_east", "e_north"), (*field.motion, *field.sigma), strict=True):
        made[name] = values / 1000
    return made


_NAMED = {"ra": "l", "dec": "b", "pmra": "east", "pmdec": "north", "pmra_error": "e_east", "pmdec_error": "e_north"}


@pytest.mark.parametrize(
    ("make", "options"),
    [(_hours, {}), (_radians, {}), (_without_errors, {}),
     (_galactic, {"columns": _NAMED, "units": dict.fromkeys(list(_NAMED.values())[2:], "mas/yr")})],
)  # fmt: skip
def test_the_remedy_in_a_message_gives_the_truth(make, options):
    made = make()
    with pytest.raises(VshError) as caught:
        read_field(made, **options)
    read = read_field(made, **_proposal(str(caught.value), options))
    np.testing.assert_allclose(read.to_frame("icrs").motion, sky().motion, rtol=1e-9)
    np.testing.assert_allclose(read.to_frame("icrs").lon, sky().lon, rtol=1e-9)


def _proposal(message, options):
    """The options that a message proposes for the shell, as arguments."""
    name, value = re.search(r"\(--([a-z-]+) (\S+|'[^']*')\)?", message).groups()
    value = shlex.split(value.rstrip("),"))[0]
    if name == "units":
        return options | {"units": options.get("units", {}) | dict(pair.split("=") for pair in value.split(","))}
    name, _, value = value.partition("=")  # --columns frame=galactic
    return options | {name: float(re.match(r"[\d.]+", value)[0]) if name == "sigma" else value}


@pytest.mark.parametrize("unit", ["parsnips", "mag"])
@pytest.mark.parametrize("role", ["ra", "pmra"])
def test_no_unit_is_proposed_that_nobody_knows(unit, role):
    """The proposal was always mas / yr: a factor of 1000 for who copied it."""
    made = table()
    with pytest.raises(TableError) as caught:
        read_field(made, units={role: unit})
    assert f"--units {role}=…" in str(caught.value).replace("'", "")


def test_distance_moduli_are_of_luminosity():
    z = np.full(N, 0.1)
    modulus = 5 * np.log10(430 * 1.1) + 25
    made = table()
    made["mu"], made["e_mu"], made["z"] = modulus, 0.1, z
    roles = {"distance": "mu", "distance_error": "e_mu", "redshift": "z"}
    read = read_field(made, roles, {"mu": "mag", "e_mu": "mag"})
    np.testing.assert_allclose(read.distance, 430, rtol=1e-12)
    made.remove_column("z")
    del roles["redshift"]
    read = read_field(made, roles, {"mu": "mag", "e_mu": "mag"})
    assert any("not divided by 1 + z" in note for note in read.notes)
    assert vsh.read_field(table()).distance is None


def test_units_that_are_assumed_of_a_table_without_any_stand_in_the_first_lines():
    """A DataFrame forgets units: 2289 for 2.29, and only the notes said so."""
    first = [fit.recommended(made).verdict for made in (table(), table(units=True))]
    assert "units" in first[0]
    assert "taken in mas / yr: pmra, pmdec" in first[0]
    assert "icrs axes" in first[0]
    assert "taken in" not in first[1]


def test_a_list_of_positions_is_told_as_one():
    made = table()["source_id", "ra", "dec"]
    with pytest.raises(TableError, match="is a list of positions, without motions.*vsh-compare.*vsh-correlate"):
        read_field(made)


def test_zeros_are_missing_values_where_one_motion_is_along_an_axis():
    """72 pulsars of which one has a measured motion, in right ascension alone."""
    n = 72
    motion = np.zeros((2, n))
    motion[0, 3] = -25.4
    table = {"ra": np.linspace(1, 359, n), "dec": np.linspace(-60, 60, n), "pmra": motion[0], "pmdec": motion[1]}
    read = read_field(table, sigma=100.0)
    assert len(read) == 1
    assert any("71 of 72" in str(note) for note in read.notes)


@pytest.mark.parametrize("names", [("sgl", "sgb"), ("SGLON", "SGLAT"), ("SuperGalacticL", "SuperGalacticB")])
def test_supergalactic_axes_are_refused_by_their_names(names):
    with pytest.raises(TableError, match="supergalactic"):
        read_field(table(names=names), {"ra": names[0], "dec": names[1]})
    assert len(read_field(table(names=names), {"ra": names[0], "dec": names[1]}, frame="icrs")) == N


@pytest.mark.parametrize("name", ["mu", "DM", "dist_mod", "modulus", "mu0"])
def test_moduli_are_asked_for_their_unit(name):
    made = table()
    made[name], made[f"e_{name}"] = np.full(N, 31.0), np.full(N, 0.1)
    with pytest.raises(TableError, match=f"{name}=mag"):
        read_field(made, {"distance": name, "distance_error": f"e_{name}"})


def test_sexagesimal_degrees_are_not_hours():
    """Where right ascensions go beyond 24 hours they are degrees; as hours a few rows were left, at wrong places."""
    made = table()
    degrees = np.asarray(made["ra"]) % 360
    whole = degrees.astype(int)
    minutes = ((degrees - whole) * 60).astype(int)
    seconds = ((degrees - whole) * 60 - minutes) * 60
    made.replace_column("ra", [f"{d:03d}:{m:02d}:{s:09.6f}" for d, m, s in zip(whole, minutes, seconds, strict=True)])
    with pytest.raises(FieldError, match="goes beyond 24 hours in .*--units ra=deg"):
        read_field(made)
    read = read_field(made, units={"ra": "deg"})
    np.testing.assert_allclose(np.degrees(read.lon) % 360, degrees, atol=1e-8)
