"""What is said of sources that see one side of the sky, of one that has all weight, or of what stands there twice."""

import numpy as np
import pytest
from conftest import random_field

import fit
import vsh
from fit.normal import _coverage
from vsh.io.catalogue import parts


def told(notes):
    return sorted(str(note) for note in notes if str(note).startswith("warning"))


@pytest.mark.parametrize("case", ["half", "heavy", "right"])
def test_parts_have_the_warnings_of_the_whole(case, monkeypatch):
    """Warnings were those of a field in memory: a catalogue in parts had none."""
    field = random_field(3000, 1)
    field = field[field.lat > 0.3] if case == "half" else field
    sigma = np.array(field.sigma)
    sigma[:, 17] = 1e-3 if case == "heavy" else sigma[:, 17]
    names = np.array([f"S{i:04d}" for i in range(len(field))])
    field = vsh.Field(field.lon, field.lat, field.motion, sigma, name=names)
    pieces = parts([field[:900].to_table(), field[900:].to_table()])
    expected = told(fit.fit_field(field, 1).notes)
    assert len(expected) == (case != "right")
    assert told(fit.fit_field(pieces, 1).notes) == expected
    assert told(fit.estimate(pieces, 1, "student").solution.notes) == told(
        fit.estimate(field, 1, "student").solution.notes
    )


@pytest.mark.parametrize("kind", ["numbers", "text"])
@pytest.mark.parametrize("most", [4_000_000, 400])
def test_sources_in_two_parts_are_told_of(kind, most, monkeypatch):
    monkeypatch.setattr(_coverage, "_MAX_NAMES", most)
    field = random_field(3000, 1)
    names = 6_917_528_997_577_384_320 + 7 * np.arange(3000)
    names = names if kind == "numbers" else names.astype(str)
    field = vsh.Field(field.lon, field.lat, field.motion, field.sigma, name=names)
    one, two = field[:2000].to_table(), field[1500:].to_table()
    (note,) = told(fit.fit_field(parts([one, two]), 1).notes)
    count = int(note.removeprefix("warning: ").removeprefix("about ").split()[0])
    if most > 3000:
        assert count == 500
        assert "about" not in note
    else:
        assert 300 < count < 700
        assert "about" in note
    assert told(fit.fit_field(parts([field[:1500].to_table(), field[1500:].to_table()]), 1).notes) == []
