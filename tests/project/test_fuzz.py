"""A hundred damaged files of every reader; `make fuzz` gives thousands."""

import signal

import fuzz
import pytest
from conftest import few_or_many


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    signal.signal(signal.SIGALRM, fuzz._alarm)
    return fuzz.make_files(tmp_path_factory.mktemp("whole"))


@few_or_many(1, 100, "number")
def test_mutants_of_each(files, number):
    broken = []
    for name, (path, read) in files.items():
        whole, damaged = fuzz.describe(read(path)), path.with_name(f"mutant-{path.name}")
        assert fuzz.outcome(read, path, whole) == "same"
        for k, mutant in fuzz.mutants(7, name, path.read_bytes(), number):
            damaged.write_bytes(mutant)
            signal.setitimer(signal.ITIMER_REAL, fuzz.SECONDS)
            try:
                said = fuzz.outcome(read, damaged, whole)
            except TimeoutError:
                said = "hang"
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0)
            if said.split(":")[0] not in ("refused", "same", "changed"):
                broken.append((name, k, said))
    assert not broken


def test_fuzzer_sees_what_breaks(tmp_path):
    (tmp_path / "x").write_bytes(b"content")

    def careless(path):
        raise KeyError("x")

    assert fuzz.outcome(careless, tmp_path / "x", b"").startswith("traceback: KeyError")
    assert fuzz.outcome(lambda path: path.read_bytes(), tmp_path / "x", b"other").startswith("changed")
