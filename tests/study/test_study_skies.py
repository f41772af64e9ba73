"""Skies as a few numbers: the statistics of a plain fit, streams of their own, and what an inference makes of them."""

import numpy as np
import pytest

import fit
import sim
from study import SkyStatistics, simulate_skies
from vsh import ParameterError
from vsh.classes import Classes


@pytest.fixture(scope="module")
def field():
    quasars = sim.quasars(3000, 1)
    return sim.observe(quasars, sim.spin((5.0, 0.0, 0.0)), 2, release="DR3", rho=0.3)


def test_statistics_are_those_of_a_fit(field):
    classes = Classes.by_edges("G", (19.5,), field.magnitude)
    statistics = SkyStatistics(field, 2, classes)
    values = statistics(field.motion)
    assert len(statistics) == len(values) == len(statistics.names) == 2 * (16 + 1)
    for k, (label, mask) in enumerate(classes):
        solution = fit.fit_field(field[mask], 2)
        np.testing.assert_allclose(values[17 * k : 17 * k + 16], solution.values, rtol=1e-8, atol=1e-8)
        assert values[17 * k + 16] == pytest.approx(solution.reduced_chi2, rel=1e-8)
        assert statistics.names[17 * k + 16] == f"reduced χ² ({label})"
    np.testing.assert_allclose(SkyStatistics(field, 2)(field.motion)[:16], fit.fit_field(field, 2).values, rtol=1e-8)


def draw_of(field):
    def draw(rng):
        glide, factor = rng.uniform(-10, 10, 3), rng.uniform(0.8, 1.5)
        noise = factor * field.sigma * rng.standard_normal(field.sigma.shape)
        return np.r_[glide, factor], sim.acceleration(glide)(field.lon, field.lat) + noise

    return draw


def test_skies_do_not_depend_on_threads(field):
    statistics = SkyStatistics(field, 1)
    one, two = (simulate_skies(draw_of(field), statistics, 9, 4, threads=each) for each in (1, 2))
    for first, second in zip(one, two, strict=True):
        np.testing.assert_array_equal(first, second)
    assert len(np.unique(one[0][:, 0])) == 9
    longer = simulate_skies(draw_of(field), statistics, 12, 4)
    np.testing.assert_array_equal(longer[0][:9], one[0])


def test_statistics_tell_of_the_parameters(field):
    """By regression: the glide from degree 1, how wrong the errors are from χ²."""
    field = field.with_errors(field.sigma / 5)  # and without correlations, as the noise here
    parameters, values = simulate_skies(draw_of(field), SkyStatistics(field, 1), 120, 5)
    columns = np.column_stack([values, np.sqrt(values[:, -1]), np.ones(len(values))])
    for k, error in ((0, 2.0), (1, 2.0), (2, 2.0), (3, 0.02)):
        residual = parameters[:, k] - columns @ np.linalg.lstsq(columns, parameters[:, k], rcond=None)[0]
        assert residual.std() < error


def test_what_cannot_be_simulated(field):
    with pytest.raises(ParameterError, match=r"shape \(2, 3000\), not \(3000,\)"):
        simulate_skies(lambda rng: (np.zeros(1), np.zeros(3000)), SkyStatistics(field, 1), 2, 1)
    with pytest.raises(ParameterError, match="has no sources"):
        SkyStatistics(field, 1, Classes.by_edges("G", (10.0,), field.magnitude))
    assert repr(SkyStatistics(field, 1)) == "<SkyStatistics: 7 of 3000 sources in 1 classes>"
