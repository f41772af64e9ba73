"""Which astrometric solutions are taken: Gaia's releases say so by a number."""

import warnings

import numpy as np
import pytest
from astropy import units as u
from astropy.table import Table
from conftest import for_each

import sim
from vsh.io.catalogue import parts, read_field, read_positions
from vsh.tools.errors import FieldError, TableError, VshWarning
from vsh.tools.notes import DOUBT, count_dropped, has_code

#: As many as the draft of DR4's data model has; what they stand for beyond 3, 31 and 95 is not published.
VALUES = [3, 31, 95, *range(101, 117)]


def table(column, values):
    rng = np.random.default_rng(1)
    n = len(values)
    return {
        "source_id": np.arange(n), "ra": rng.uniform(0, 360, n), "dec": rng.uniform(-80, 80, n), "pmra": rng.normal(size=n),
        "pmdec": rng.normal(size=n), "pmra_error": rng.uniform(0.1, 1, n), "pmdec_error": rng.uniform(0.1, 1, n),
        column: values, "tentative_parallax_bias": np.zeros(n),
    }  # fmt: skip


def test_all_values_of_the_draft_are_counted():
    values = np.repeat(VALUES, np.arange(1, 20))
    field = read_field(table("astrometric_params", values))
    assert len(field) == 2 + 3  # of 31 and 95
    assert count_dropped(field.notes) == 190 - 5
    (note,) = [note for note in field.notes if note.startswith("left out")]
    for value, count in zip(VALUES, range(1, 20), strict=True):
        words = "position alone" if value == 3 else "not of 5 or 6 parameters"
        assert (f"astrometric_params = {value} ({words}): {count}" in note) == (value not in (31, 95))
    with pytest.raises(FieldError, match=r"2 of 2 rows .*astrometric_params = 3 \(position alone\): 1 \(row 0\)"):
        read_field(table("astrometric_params", [3, 101]))


def test_solutions_of_parts_add_up():
    several = parts([table("astrometric_params", [31, 31, 103]), table("astrometric_params", [95, 103, 104])])
    assert several.counted() == 3
    notes = sorted(str(note) for field in several for note in field.notes if note.startswith("left out"))
    model = "astrometric_params = {} (not of 5 or 6 parameters): 1".format
    assert notes == [f"left out 1 of 3 rows: {model(103)}", f"left out 2 of 3 rows: {model(103)}; {model(104)}"]


def test_missing_solution_and_words():
    values = np.ma.MaskedArray([31, 31, 95], [False, True, False])
    assert len(read_field(table("astrometric_params_solved", values))) == 3  # which one it was is not known: used
    with pytest.raises(TableError, match="holds text, such as 'five'"):
        read_field(table("astrometric_params", np.array(["five", "six"])))


def test_model_under_a_mask_is_no_model():
    """Parquet as astropy writes it keeps the number that is masked: it was read as a model of two parameters."""
    values = np.ma.MaskedArray([31, 127, 95, 127], [False, True, False, False])
    assert list(read_field(table("astrometric_params", values)).name) == [0, 1, 2]


def test_motions_of_nan_are_missing_as_those_with_a_mask_are():
    """FITS has no other way to say so: the two forms of one table have one answer."""
    masked = Table(table("ruwe", np.ones(6)))
    for name in ("pmra", "pmdec"):
        masked[name] = np.ma.MaskedArray(masked[name], np.arange(6) < 2)
    bare = Table({name: np.ma.filled(column, np.nan) for name, column in masked.items()})
    both = bare.copy()  # one is masked, the other nan
    for name in ("pmra", "pmdec"):
        both[name] = np.ma.MaskedArray(bare[name], np.arange(6) == 0)
    fields = [read_field(each) for each in (masked, bare, both)]
    assert fields[0] == fields[1] == fields[2]
    assert list(fields[1].name) == [2, 3, 4, 5]
    bare["pmdec"][0] = 1.0
    with pytest.raises(FieldError, match="not finite"):
        read_field(bare)


def test_all_can_be_asked_for():
    assert len(read_field(table("astrometric_params", [31, 3, 120]), columns={"solution": None})) == 3


FLAGS = [0, 1, 0, 2, 0]


@for_each(
    [
        np.array(FLAGS, "i2"),
        np.array([0.0, 1.0, np.nan, 2.0, 0.0]),
        np.array(FLAGS) > 0,
        np.array(["0", "1", "0", "2", "0"]),
        np.array(["False", "True", "", "true", "F"]),
        np.array([b"0", b"1", b" 0", b"2.0", b"0"]),
        np.array([0, 1, None, 2, False], object),
        np.ma.MaskedArray(FLAGS, [False, False, True, False, False]),
        np.ma.MaskedArray(FLAGS, [False, False, False, False, True]),
    ],
    lambda values: str(values.dtype),
)
def test_flags_are_read_however_a_table_holds_them(values):
    """A left join makes floats of flags, a CSV makes words of them: all sources were used then, without a word."""
    field = read_field(table("quality_flag", values))
    missing = np.ma.getmaskarray(values) | np.array([str(value) in ("nan", "", "None") for value in values])
    assert list(field.name) == [k for k in (0, 2, 4) if not missing[k]]
    assert count_dropped(field.notes) == 2 + missing.sum()
    assert any("quality_flag is missing" in note for note in field.notes) == missing.any()
    assert any("quality_flag is not 0" in note for note in field.notes)
    assert len(read_field(table("quality_flag", values), columns={"quality": None})) == 5  # as the note says


def test_flags_that_are_words_are_asked_about():
    with pytest.raises(TableError, match=r"such as 'good'.*--columns quality="):
        read_field(table("quality_flag", np.array(["good", "poor", "good"])))
    assert len(read_field(table("quality_flag", np.array(["good", "poor"])), columns={"quality": None})) == 2


def joined(suffixes=("_1", "_2"), bare=()):
    """Two releases of one catalogue side by side, as TOPCAT and astropy join them; the second is right."""
    rng = np.random.default_rng(2)
    one, two = (
        table("astrometric_params", np.full(5, 31))
        | {"quality_flag": flags, "pmra_pmdec_corr": rng.uniform(-0.9, 0.9, 5)}
        for flags in ([1, 0, 0, 0, 0], [0, 0, 0, 0, 1])
    )
    tables = zip((one, two), suffixes, strict=True)
    columns = {
        (name if name in bare else f"{name}{end}"): values for each, end in tables for name, values in each.items()
    }
    return columns, one, two


@for_each([0, 1])
def test_flags_and_correlations_are_those_of_the_table_of_the_motions(which):
    columns, *releases = joined()
    suffix = f"_{which + 1}"
    names = {role: f"{role}{suffix}" for role in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")}
    field = read_field(columns, columns=names, units=dict.fromkeys(list(names.values())[2:], "mas/yr"))
    release = releases[which]
    good = np.array(release["quality_flag"]) == 0
    assert len(field) == 4
    np.testing.assert_allclose(field.rho, release["pmra_pmdec_corr"][good])


def test_positions_alone_may_have_a_suffix():
    """Following the answer to the question for ra and dec used sources of every model, with every flag."""
    columns, one, _ = joined(bare=("pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr", "source_id"))
    columns["quality_flag_1"] = one["quality_flag"]
    with pytest.raises(TableError, match="ra=ra_1,dec=dec_1"):
        read_field(columns)
    assert count_dropped(read_field(columns, columns={"ra": "ra_1", "dec": "dec_1"}).notes) == 1


def test_flags_under_other_names_are_told_of():
    with pytest.warns(VshWarning, match="my_quality_flag"):
        field = read_field(table("my_quality_flag", FLAGS))
    assert len(field) == 5
    (note,) = [note for note in field.notes if "my_quality_flag" in note]
    assert has_code(note, DOUBT)
    assert "--columns quality=my_quality_flag" in note
    assert len(read_field(table("my_quality_flag", FLAGS), columns={"quality": "my_quality_flag"})) == 3


def test_correlations_of_another_table_are_not_proposed():
    columns, *_ = joined()
    del columns["pmra_pmdec_corr_2"]
    names = {role: f"{role}_2" for role in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")}
    notes = read_field(columns, columns=names, units=dict.fromkeys(list(names.values())[2:], "mas/yr")).notes
    assert not any("pmra_pmdec_corr_1" in note for note in notes)
    assert any("correlations taken as zero" in note for note in notes)


@for_each([("pm_l_cosb", "pm_b"), ("pmGLON", "pmGLAT"), ("pml", "pmb")])
def test_errors_of_other_axes_than_the_motions_are_refused(motions):
    """Gaia's table with motions turned to Galactic axes beside it: errors and correlations were not turned."""
    columns = table("random_index", np.arange(5)) | {"l": np.arange(5.0), "b": np.arange(5.0)}
    columns |= {name: np.ones(5) for name in motions}
    names = {"ra": "l", "dec": "b", "pmra": motions[0], "pmdec": motions[1]}
    with pytest.raises(TableError, match="errors and correlations have to be turned"):
        read_field(columns, columns=names, frame="galactic")
    errors = {f"{name}_error": np.ones(5) for name in motions}
    roles = {"pmra_error": f"{motions[0]}_error", "pmdec_error": f"{motions[1]}_error"}
    units = dict.fromkeys([*motions, *errors], "mas/yr")
    assert read_field(columns | errors, columns=names | roles, frame="galactic", units=units).frame == "galactic"


@for_each([("raj2000", "pmra", "pm_corr"), ("ra", "pmra_cosdec", "corr_pm"), ("ra", "pmra", "pm_corr"),
           ("ra", "pmra", "rho"), ("ra", "pmra", "muRA_muDE_corr"), ("ra", "pmra", "rho_mu"), ("ra", "pmra", "c_pmra_pmdec")])  # fmt: skip
def test_correlations_under_other_names_are_told_of(names):
    """A suffix of a name that is no join's (J2000, cos δ) takes no correlations away."""
    ra, motion, correlation = names
    columns = {"dec": np.arange(5.0), "pmdec": np.ones(5), "pmra_error": np.ones(5), "pmdec_error": np.ones(5)}
    columns |= {ra: np.arange(5.0), motion: np.ones(5), correlation: np.zeros(5)}
    units = dict.fromkeys([motion, "pmdec", "pmra_error", "pmdec_error"], "mas/yr")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        notes = read_field(columns, columns={"ra": ra, "pmra": motion}, units=units).notes
    assert any(f"pmra_pmdec_corr={correlation}" in note for note in notes)


@for_each(["pml_pmb_corr", "pmlb_corr", "pmLpmBcor", "pml_pmb_correlation"])
def test_correlations_of_galactic_motions_are_told_of(name):
    columns = {"l": np.arange(5.0), "b": np.arange(5.0)}
    columns |= {motion: np.ones(5) for motion in ("pml", "pmb", "pml_error", "pmb_error")} | {name: np.zeros(5)}
    names = {
        "ra": "l",
        "dec": "b",
        "pmra": "pml",
        "pmdec": "pmb",
        "pmra_error": "pml_error",
        "pmdec_error": "pmb_error",
    }
    with pytest.warns(VshWarning, match=name):
        read_field(
            columns,
            columns=names,
            frame="galactic",
            units=dict.fromkeys(names.values(), "mas/yr") | {"l": "deg", "b": "deg"},
        )


def test_galactic_positions_beside_motions_in_the_icrs():
    """Gaia's l and b without ra and dec: a list of positions, it was said, though pmra stands in the table."""
    field = sim.observe(sim.quasars(40, 1), sim.spin((1, 2, 3)), rng=1)
    galactic = field.to_skycoord().galactic
    table = field.to_table()
    table["l"], table["b"] = galactic.l.deg, galactic.b.deg
    table.remove_columns(["ra", "dec"])
    again = read_field(table)
    np.testing.assert_allclose(again.motion, field.motion)
    np.testing.assert_allclose([again.lon, again.lat], [field.lon, field.lat], atol=1e-9)


def test_hours_whose_unit_says_degrees_are_doubted():
    table = sim.observe(sim.quasars(100, 1), sim.spin((1, 2, 3)), rng=1).to_table()
    table["ra"] /= 15
    with pytest.warns(VshWarning, match="is ra in hours"):
        field = read_field(table)
    assert has_code(next(note for note in field.notes if "hours" in note), DOUBT)
    positions = {
        "ra": table["ra"],
        "dec": table["dec"],
        "ra_error": np.full(100, 0.1) * u.mas,
        "dec_error": np.full(100, 0.1) * u.mas,
    }
    assert any("hours" in note for note in read_positions(Table(positions)).notes)
    assert not any("hours" in note for note in read_positions(positions, units={"ra": "deg", "dec": "deg"}).notes)


def test_rows_set_aside_are_no_errors():
    """Rows with another solution are left out anyway: the number of those that cannot be used is not theirs."""
    table = sim.observe(sim.quasars(100, 1), sim.spin((1, 2, 3)), rng=1).to_table()
    table["astrometric_params_solved"] = np.where(np.arange(100) < 30, 3, 31)
    table["pmra"][50] = np.nan
    with pytest.raises(FieldError, match=r"(?<!\d)1 of 100 rows cannot be used"):
        read_field(table)
