"""All results on frames give their pairs, vectors, answer and table alike."""

import numpy as np
import pytest

import sim
from fit.frames.chain import combine_frames
from fit.frames.compare import compare_catalogues
from fit.frames.link import find_step, link
from vsh import Coefficients, Modes

TURNED = (0, 0, 5.0)


@pytest.fixture(scope="module")
def catalogues():
    quasars, names = sim.quasars(400, rng=1), np.arange(400).astype(str)
    spins = {"a": TURNED, "b": (0, 0, 0), "c": TURNED}
    fields = (sim.observe(quasars, sim.spin(spin), rng=k, sigma=1.0) for k, spin in enumerate(spins.values()))
    return {label: field._derive(name=names) for label, field in zip(spins, fields, strict=True)}


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


@pytest.mark.parametrize("errors", [1.0, 0.1])
def test_systematic_errors_leave_the_covariance_with_higher_degrees(catalogues, errors):
    """They add to the variances of rotation and glide; where these become smaller, correlations stay."""
    north = [field[np.flatnonzero(field.lat > -0.3)] for field in catalogues.values()]
    wave = Coefficients(Modes(5), np.r_[np.zeros(16), np.full(54, 3.0 * (errors < 1))]).at(north[0].lon, north[0].lat)
    a, b = north[0]._derive(motion=north[0].motion + wave), north[1]
    plain, with_floor = (compare_catalogues(a, b, 2, floor=floor)[0].best for floor in (False, True))
    block = np.ix_(*(np.flatnonzero(plain.modes.degrees == degree) for degree in (1, 2)))
    if errors < 1:
        np.testing.assert_array_equal(with_floor.covariance[block], plain.covariance[block])
        assert with_floor.spin.sigma.min() > 1.2 * plain.spin.sigma.max()
    assert np.abs(with_floor.correlation[block]).max() > 0.15
    assert np.linalg.eigvalsh(with_floor.covariance)[0] > 0
