import numpy as np
import pytest
from conftest import nonuniform

import fit
from fit.correlation import influence_map, parameters_of, select_parameters
from fit.correlation._matrices import _differentiate_by_weight, _solve_and_select_rows
from vsh import Coefficients, Modes
from vsh.sky.pixels import pixels_of
from vsh.vector import correlation_of


def finite_difference(field, modes, pair, pixels, pixel, step=1e-4, quantity=None):
    values = []
    for sign in (1, -1):
        factor = np.where(pixels == pixel, 1 + sign * step, 1.0)
        weighted = field.with_errors(field.sigma / np.sqrt(factor))
        solution = fit.solve(fit.normal_equations(weighted, modes, method="design-matrix"))
        chosen = select_parameters((pair,) if isinstance(pair, str) else pair, modes)
        covariance = chosen.covariance(solution.covariance)
        if quantity == "value":
            values.append((chosen.rows @ solution.coefficients.values)[0])
        elif len(chosen) == 1:
            values.append(np.log(covariance[0, 0]))
        else:
            values.append(correlation_of(covariance)[0, 1])
    return (values[0] - values[1]) / (2 * step)


@pytest.mark.parametrize("seed", range(20))
def test_influence_against_finite_differences(seed):
    rng = np.random.default_rng(seed)
    field = nonuniform(800, seed)
    lmax = int(rng.integers(1, 4))
    names = [str(mode) for mode in Modes(lmax)] + list(parameters_of("spin+acceleration").names)
    pair = tuple(rng.choice(names, 2, replace=False))
    found = influence_map(field, lmax, pair, nside=2)
    pixels = pixels_of(field.lon, field.lat, 2)
    for pixel in rng.choice(np.unique(pixels), 3, replace=False):
        expected = finite_difference(field, Modes(lmax), pair, pixels, pixel)
        assert found[pixel] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_influence_on_variances_and_values():
    field = nonuniform(800, 3)
    field = field._derive(motion=np.random.default_rng(1).normal(size=(2, 800)) * field.sigma)
    pixels = pixels_of(field.lon, field.lat, 2)
    variance, value = influence_map(field, 2, "a_x", 2), influence_map(field, 2, "a_x", 2, quantity="value")
    for pixel in np.unique(pixels)[:4]:
        assert variance[pixel] == pytest.approx(finite_difference(field, Modes(2), "a_x", pixels, pixel), rel=1e-6)
        expected = finite_difference(field, Modes(2), "a_x", pixels, pixel, quantity="value")
        assert value[pixel] == pytest.approx(expected, rel=1e-5, abs=1e-8)
    assert variance.sum() == pytest.approx(-1)  # doubling everything halves a variance: d ln σ²/d ln w = −1
    assert value.sum() == pytest.approx(0, abs=1e-9)
    assert influence_map(field, "spin+acceleration", ("omega_x", "a_y"), 2).sum() == pytest.approx(0, abs=1e-12)


def test_thousands_of_sources_take_the_transform():
    field = nonuniform(12_000, 3)
    few = influence_map(field, 2, ("omega_x", "a_y"), 4)
    parts = [influence_of_part(field, keep) for keep in np.array_split(np.arange(12_000), 2)]
    np.testing.assert_allclose(sum(parts), few, atol=1e-11)


def influence_of_part(field, keep):
    """The same sum over some of the sources, evaluated by the harmonics."""
    covariance, first, second, chosen = _solve_and_select_rows(field, 2, ("omega_x", "a_y"))
    part = field[keep]
    g, h = (Coefficients(chosen.modes, covariance @ row).at(part.lon, part.lat) for row in (first, second))
    return np.bincount(
        pixels_of(part.lon, part.lat, 4), _differentiate_by_weight(covariance, first, second, g, h, part), 192
    )
