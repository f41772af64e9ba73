"""All results on frames give their pairs, vectors, answer and table alike."""

import numpy as np
import pytest

import sim
from fit.frames.chain import combine_frames
from fit.frames.compare import compare_catalogues
from fit.frames.link import find_step, link

TURNED = (0, 0, 5.0)


@pytest.fixture(scope="module")
def catalogues():
    quasars, names = sim.quasars(400, rng=1), np.arange(400).astype(str)
    spins = {"a": TURNED, "b": (0, 0, 0), "c": TURNED}
    fields = (sim.observe(quasars, sim.spin(spin), rng=k, sigma=1.0) for k, spin in enumerate(spins.values()))
    return {label: field._with(name=names) for label, field in zip(spins, fields, strict=True)}


@pytest.fixture(scope="module")
def results(catalogues):
    a, b, _ = catalogues.values()
    stars = sim.link(1, 60, spin=TURNED)
    return {
        "compare": compare_catalogues(a, b, 1, labels=("a", "b"))[0],
        "chain": combine_frames(catalogues, 1, floor=False),
        "link": link(stars),
        "steps": find_step(stars, [12.0, 13.0]),
    }


@pytest.mark.parametrize("name", ["compare", "chain", "link", "steps"])
def test_frame_result_gives_every_pair(name, results):
    result = results[name]
    assert len(result.pairs) == (3 if name == "chain" else 1)
    assert result.verdict == result.answer.sentence
    assert all(len(result.vectors(one, two)) == 2 for one, two in result.pairs)
    assert len(result.answer.lines) >= 2 * len(result.pairs)


def test_chain_and_comparison_find_one_rotation(results):
    for name in ("compare", "chain"):
        rotation = results[name].vectors()["rotation"]
        assert np.abs((rotation.value - TURNED) / rotation.sigma).max() < 4
    assert np.abs(results["chain"].vectors("c", "a")["rotation"].value).max() < 1
    assert [label for label, _ in results["chain"].answer.lines][:2] == ["a − b: rotation", "a − b: glide"]


def test_systematic_errors_leave_the_covariance_with_higher_degrees(catalogues):
    """They add to the variances of rotation and glide, and make no correlation zero."""
    north = {label: field[np.flatnonzero(field.lat > -0.3)] for label, field in catalogues.items()}
    plain, with_floor = (compare_catalogues(north["a"], north["b"], 2, floor=floor)[0].best for floor in (False, True))
    first, second = (np.flatnonzero(plain.modes.degrees == degree) for degree in (1, 2))
    block = np.ix_(first, second)
    np.testing.assert_array_equal(with_floor.covariance[block], plain.covariance[block])
    assert np.abs(with_floor.correlation[block]).max() > 0.2
