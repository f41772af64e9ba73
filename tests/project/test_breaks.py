"""The deliberate breaks of `tests/mutate.py`: each has its place in the code, and a test that there is one of."""

from breaks import BREAKS
from conftest import ROOT


def test_every_place_to_break_is_there():
    assert [(name, old) for name, old, _, _ in BREAKS if old not in (ROOT / name).read_text(encoding="utf-8")] == []


def test_tests_of_breaks_are_found_by_their_names():
    files = {test.split("::")[0] for *_, tests in BREAKS for test in tests.split()}
    assert {name: len(list((ROOT / "tests").rglob(name))) for name in files} == dict.fromkeys(files, 1)
