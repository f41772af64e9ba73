"""The order of the rows, and the parts they are read in, carry nothing."""

import numpy as np
import pytest

import fit
import sim
from vsh import Field
from vsh.io.parts import as_parts
from vsh.sky.sphere import widest_gap
from vsh.tools.subsample import select_share

N = 60_000


@pytest.fixture(scope="module")
def interleaved():
    """Two samples row by row: every second source has errors that are five times too small, and heavy tails."""
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(N, rng)
    sigma = 300 * np.ones((2, N))
    noise = sigma * rng.normal(size=(2, N))
    noise[:, ::2] = 5 * sigma[:, ::2] * rng.standard_t(2, (2, N // 2))
    return Field(lon, lat, sim.acceleration((0, -4, -2))(lon, lat) + noise, sigma, redshift=rng.uniform(0.1, 2, N))


def numbers(result):
    vectors = [getattr(result, name) for name in ("spin", "acceleration")]
    values = np.concatenate([[*v.value, *v.sigma, v.amplitude, v.amplitude_limit()] for v in vectors])
    return np.append(values, result.solution.values), np.mean(vectors[0].sigma)


@pytest.mark.parametrize("method", ["recommended", "student"])
def test_any_order_and_any_parts_give_the_same_numbers(interleaved, method):
    usual, error = numbers(fit.estimate(interleaved, 1, method))
    ordered = np.concatenate([np.arange(0, N, 2), np.arange(1, N, 2)])
    shuffled = np.random.default_rng(2).permutation(N)
    for other in (interleaved[ordered], interleaved[shuffled], as_parts([interleaved[:1000], interleaved[1000:]])):
        np.testing.assert_allclose(numbers(fit.estimate(other, 1, method))[0], usual, atol=1e-6 * error)


def test_a_share_of_the_rows_is_chosen_by_what_they_hold():
    rng = np.random.default_rng(1)
    x, y = rng.normal(size=(2, 20_000))
    chosen = select_share(0.1, x, y)
    assert abs(chosen.mean() - 0.1) < 0.01
    order = rng.permutation(len(x))
    np.testing.assert_array_equal(select_share(0.1, x[order], y[order]), chosen[order])
    assert abs(np.mean(chosen[::2]) - np.mean(chosen[1::2])) < 0.02  # of either of two merged lists
    assert select_share(1.0, x).all()
    assert abs(select_share(0.1, x[chosen], y[chosen], draw=1).mean() - 0.1) < 0.04  # a sample of a sample
    assert not select_share(0.0, x).any()


def test_gap_in_the_sky_is_the_same_in_any_order(interleaved):
    north = interleaved[interleaved.lat > 0.2]
    order = np.random.default_rng(3).permutation(len(north))
    assert widest_gap(north.lon, north.lat) == widest_gap(north.lon[order], north.lat[order])


def test_gap_of_sources_on_one_meridian():
    """A selection by longitudes alone took all of them or none."""
    lat = np.linspace(-1.5, 1.5, 1000)
    radius, lon, _ = widest_gap(np.zeros(1000), lat, 400)
    assert radius == pytest.approx(np.pi / 2, abs=0.1)
    assert abs(lon - np.pi) < 1.7
    assert widest_gap(np.zeros(1000), np.zeros(1000), 1)[0] > 3.0
