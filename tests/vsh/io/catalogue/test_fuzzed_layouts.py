"""Ten kinds of damage to every layout: an error of ours that names the file, or the numbers that stand there."""

import gzip

import numpy as np
import pytest
from test_layouts import LAYOUTS, listed

from vsh.io.catalogue import read_field, read_positions
from vsh.tools.errors import VshError

DAMAGE = {
    "cut in the middle": lambda data, rng: data[: len(data) // 2],
    "cut by a few bytes": lambda data, rng: data[: -rng.integers(2, 30)],
    "a byte changed": lambda data, rng: _changed(data, rng, 1),
    "ten bytes changed": lambda data, rng: _changed(data, rng, 10),
    "a line twice": lambda data, rng: _lines(data, rng, lambda lines, k: [*lines[: k + 1], lines[k], *lines[k + 1 :]]),
    "a line lost": lambda data, rng: _lines(data, rng, lambda lines, k: lines[:k] + lines[k + 1 :]),
    "a line cut": lambda data, rng: _lines(data, rng, lambda lines, k: [*lines[:k], lines[k][: len(lines[k]) // 2], *lines[k + 1 :]]),
    "junk in a line": lambda data, rng: _lines(data, rng, lambda lines, k: [*lines[:k], b"junk " + lines[k], *lines[k + 1 :]]),
    "zero bytes": lambda data, rng: data[: len(data) // 3] + bytes(40) + data[len(data) // 3 :],
    "packed and cut": lambda data, rng: gzip.compress(data)[:-20],
}  # fmt: skip


def _changed(data, rng, count):
    out = bytearray(data)
    for place in rng.integers(0, len(out), count):
        out[place] = rng.integers(1, 256)
    return bytes(out)


def _lines(data, rng, change):
    lines = data.split(b"\n")
    return b"\n".join(change(lines, int(rng.integers(0, len(lines)))))


def tried(read, path, whole):
    """What is read of a damaged file is finite, and of as many sources at most as before and one more."""
    try:
        result = read(path)
    except VshError:
        return "refused"
    assert np.isfinite(result.lon).all()
    assert (result.sigma > 0).all()
    assert len(result) <= whole + 1
    return "read"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("damage", DAMAGE)
def test_damaged_layouts(damage, tmp_path):
    for number, (name, (file, text)) in enumerate(LAYOUTS.items()):
        for seed in range(3):
            rng = np.random.default_rng([seed, number])
            path = tmp_path / f"{seed}{file}"
            path.write_bytes(DAMAGE[damage](text.encode(), rng))
            tried(read_field, path, 41), name


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("kind", ["crf", "globl", "getpar", "rfc", "icrf with flags"])
def test_damaged_lists(kind, damage, tmp_path):
    outcomes = []
    for seed in range(6):
        path = tmp_path / f"{seed}.crf"
        path.write_bytes(DAMAGE[damage](listed(kind).encode(), np.random.default_rng(seed)))
        outcomes.append(tried(read_positions, path, 3))
    if damage in ("packed and cut",):
        assert outcomes == ["refused"] * 6
