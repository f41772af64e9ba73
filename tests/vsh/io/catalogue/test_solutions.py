"""Which astrometric solutions are taken: Gaia's releases say so by a number."""

import numpy as np
import pytest

from vsh.io.catalogue import parts, read_field
from vsh.tools.errors import FieldError, TableError
from vsh.tools.notes import count_dropped

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
    assert len(VALUES) == 19
    values = np.repeat(VALUES, np.arange(1, 20))
    field = read_field(table("astrometric_params", values))
    assert len(field) == 2 + 3  # of 31 and 95
    assert count_dropped(field.notes) == 190 - 5
    (note,) = [note for note in field.notes if note.startswith("left out")]
    for value, count in zip(VALUES, range(1, 20), strict=True):
        words = "position alone" if value == 3 else "not of 5 or 6 parameters"
        assert (f"astrometric_params = {value} ({words}): {count}" in note) == (value not in (31, 95))
    with pytest.raises(
        FieldError, match=r"2 of 2 rows cannot be used: astrometric_params = 3 \(position alone\): 1 \(row 0\)"
    ):
        read_field(table("astrometric_params", [3, 101]))


def test_solutions_of_parts_add_up():
    several = parts([table("astrometric_params", [31, 31, 103]), table("astrometric_params", [95, 103, 104])])
    assert several.counted() == 3
    (note,) = {note for field in several for note in field.notes if note.startswith("left out")} - {
        "left out 1 of 3 rows: astrometric_params = 103 (not of 5 or 6 parameters): 1"
    }
    assert note == (
        "left out 2 of 3 rows: astrometric_params = 103 (not of 5 or 6 parameters): 1; astrometric_params = 104 (not of 5 "
        "or 6 parameters): 1"
    )


def test_missing_solution_and_words():
    values = np.ma.MaskedArray([31, 31, 95], [False, True, False])
    assert len(read_field(table("astrometric_params_solved", values))) == 3  # which one it was is not known: used
    with pytest.raises(TableError, match="not numbers of astrometric models"):
        read_field(table("astrometric_params", np.array(["five", "six"])))


def test_all_can_be_asked_for():
    assert len(read_field(table("astrometric_params", [31, 3, 120]), columns={"solution": None})) == 3


def test_flagged_rows_are_counted_and_left_out():
    """DR4's quality_flag was fetched and never looked at."""
    flag = np.ma.MaskedArray([0, 1, 0, 2, 0], [False, False, False, False, True])
    field = read_field(table("quality_flag", flag))
    assert list(field.name) == [0, 2, 4]
    assert count_dropped(field.notes) == 2
    assert any("quality_flag is not 0" in note for note in field.notes)
    assert len(read_field(table("quality_flag", flag), columns={"quality": None})) == 5  # as the note says
