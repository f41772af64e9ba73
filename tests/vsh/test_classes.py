"""Classes of sources: whoever asks for them, the same labels and the same sources."""

import numpy as np
import pytest
from conftest import random_field

from vsh import Classes
from vsh.io.catalogue import parts, read_field
from vsh.tools.errors import DegeneracyError, FrameError, ParameterError

VALUES = np.array([17.0, 18.0, 18.5, 19.0, 21.0, np.nan])


@pytest.fixture
def field():
    return random_field(400, 1)


def counts(classes):
    return [int(mask.sum()) for _, mask in classes]


def test_edges_belong_to_one_class():
    left, right = (Classes.by_edges("G", (18, 19), VALUES, closed=side) for side in ("left", "right"))
    assert left.labels == ("G < 18", "18 ≤ G < 19", "G ≥ 19")
    assert right.labels == ("G ≤ 18", "18 < G ≤ 19", "G > 19")
    assert counts(left) == [1, 2, 2]
    assert counts(right) == [2, 2, 1]


def test_bins_leave_out_what_is_outside():
    z = np.array([0.2, 0.5, 0.9, 1.0, 2.0, np.nan])
    classes = Classes.by_edges("z", (0.5, 1, 2), z, ends=False)
    assert classes.labels == ("0.5 ≤ z < 1", "1 ≤ z < 2")
    assert classes.masks.tolist() == [
        [False, True, True, False, False, False],
        [False, False, False, True, False, False],
    ]


def test_conditions_select_what_masks_do(field, tmp_path):
    """The same text of a command and edges of a column: no source in two classes, none without a value."""
    path = tmp_path / "c.fits"
    table = field.to_table()
    table["g"] = np.resize(VALUES, len(field))
    table.write(path)
    classes = Classes.from_text("g:18, 19")
    assert classes.labels == Classes.by_edges("g", (18, 19)).labels
    masks = Classes.by_edges("g", (18, 19), table["g"]).masks
    read = [read_field(path, where=condition) for condition in classes.conditions]
    assert [len(each) for each in read] == masks.sum(1).tolist()
    np.testing.assert_allclose(read[1].lon, field.lon[masks[1]], atol=1e-12)


def test_parts_have_as_many_sources_each():
    values = np.arange(1000.0)
    assert max(counts(Classes.by_parts("z", values, 4))) - min(counts(Classes.by_parts("z", values, 4))) <= 1
    assert Classes.by_parts("periods", np.array([1.0, 2, 2]), 4).labels == ("periods = 1", "periods = 2")
    with pytest.raises(DegeneracyError, match="z is the same for all sources"):
        Classes.by_parts("z", np.ones(5), 4)


def test_halves_in_memory_and_in_parts(field, tmp_path):
    halves = Classes.by_halves("galactic")
    assert halves.labels == ("northern galactic half", "southern galactic half")
    north, south = halves.split(field)
    assert (north.to_frame("galactic").lat >= 0).all()
    assert len(north) + len(south) == len(field)
    path = tmp_path / "c.fits"
    field.write(path)
    assert [each.sum(len) for each in halves.split(parts(path))] == [len(north), len(south)]
    assert counts(halves.of(field).within(field.lat > 0)) == [
        int(((field.to_frame("galactic").lat >= 0) == side)[field.lat > 0].sum()) for side in (True, False)
    ]


def test_small_classes_are_left_out():
    classes = Classes.by_edges("G", (18, 19), VALUES)
    assert classes.of_at_least(2).labels == ("18 ≤ G < 19", "G ≥ 19")
    assert len(classes.of_at_least(7)) == 0


@pytest.mark.parametrize(("make", "error", "words"), [
    (lambda: Classes.from_text("magnitude"), ParameterError, "COLUMN:EDGE"),
    (lambda: Classes.from_text("magnitude:19,18"), ParameterError, "edges that rise"),
    (lambda: Classes.by_edges("G", (19, 18)), ParameterError, "numbers that rise"),
    (lambda: Classes.by_halves("equatorial"), FrameError, "unknown frame"),
    (lambda: list(Classes.by_edges("G", (18,))), ParameterError, "have no masks"),
])  # fmt: skip
def test_messages_name_the_error(make, error, words):
    with pytest.raises(error, match=words):
        make()


def test_edges_that_were_computed_are_labelled_with_four_digits():
    """A quantile of redshifts in single precision had sixteen, and its figure no room for anything else."""
    edges = [float(np.float32(0.01)), 0.5368239283561707, 1.7367043495178223]
    classes = Classes.by_edges("z", edges, np.array([0.01, 0.53682, 0.53683, 1.7]), ends=False)
    assert classes.labels == ("0.01 ≤ z < 0.5368", "0.5368 ≤ z < 1.737")
    assert classes.masks.sum(axis=1).tolist() == [2, 2]  # by all digits
    close = Classes.by_edges("z", [0.5368239283, 0.5368239284])
    assert len(set(close.labels)) == 3
