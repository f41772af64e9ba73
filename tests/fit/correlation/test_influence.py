import numpy as np
import pytest
from conftest import nonuniform

import fit
from fit.correlation import correlation_matrices, gain_of_sources, influence_map, most_influential, named, parameters_of
from fit.correlation._forecast import reweight_field
from vsh import Field, Modes
from vsh.sky.pixels import pixels_of
from vsh.vector import correlation_of


def finite_difference(field, modes, pair, pixels, pixel, step=1e-4, quantity=None):
    values = []
    for sign in (1, -1):
        factor = np.where(pixels == pixel, 1 + sign * step, 1.0)
        solution = fit.solve(fit.normal_equations(reweight_field(field, factor), modes, method="design-matrix"))
        chosen = named((pair,) if isinstance(pair, str) else pair, modes)
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
    field = field._with(motion=np.random.default_rng(1).normal(size=(2, 800)) * field.sigma)
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
    from fit.correlation._matrices import _change, _prepare_influence
    from vsh import Coefficients

    covariance, first, second, chosen = _prepare_influence(field, 2, ("omega_x", "a_y"))
    part = field[keep]
    g, h = (Coefficients(chosen.modes, covariance @ row).at(part.lon, part.lat) for row in (first, second))
    return np.bincount(pixels_of(part.lon, part.lat, 4), _change(covariance, first, second, g, h, part), 192)


def test_removing_the_most_influential_region_lowers_the_correlation_as_predicted():
    field = nonuniform(20_000, 4, uniform_errors=True)
    before = correlation_matrices(field).matrix(0)[0, 4]
    values = influence_map(field, 1, ("omega_x", "a_y"), 4)
    pixels = pixels_of(field.lon, field.lat, 4)
    mask = most_influential(values, 0.3)
    assert 1 < mask.sum() < 96
    # A tenth of its weight: what the derivative predicts; all of it: lower still.
    factor = np.where(mask[pixels], 0.9, 1.0)
    after = correlation_matrices(reweight_field(field, factor)).matrix(0)[0, 4]
    assert after - before == pytest.approx(-0.1 * values[mask].sum(), rel=0.05)
    assert after < before
    assert abs(correlation_matrices(field[~mask[pixels]]).matrix(0)[0, 4]) < before - 0.1


def test_adding_sources_does_what_was_predicted():
    field = nonuniform(20_000, 4, uniform_errors=True)
    values = gain_of_sources(field, 1, ("omega_x", "a_y"), 2, n_sources=200)
    from vsh.sky.pixels import centres

    lon, lat = (x[int(values.argmin())] for x in centres(2))
    rng = np.random.default_rng(1)
    more = [np.concatenate([old, np.full(200, new) + 1e-3 * rng.normal(size=200)])
            for old, new in ((field.lon, lon), (field.lat, lat))]  # fmt: skip
    richer = Field(*more, np.zeros((2, 20_200)), np.full((2, 20_200), 300.0), frame="galactic")
    change = correlation_matrices(richer).matrix(0)[0, 4] - correlation_matrices(field).matrix(0)[0, 4]
    assert change == pytest.approx(values.min(), rel=0.05)
    assert (gain_of_sources(field, 1, "a_x", 2) <= 0).all()


@pytest.mark.parametrize("parameters", ["a_x", ("omega_x", "a_y"), ("t(2,1,re)", "s(1,0)")])
def test_gain_is_exact_for_any_number_of_sources(parameters):
    """To first order, 1000 sources changed ln σ² by −42 where −1.75 came out."""
    from vsh.sky.pixels import centres

    field = nonuniform(500, 2)
    values = gain_of_sources(field, 2, parameters, 2, n_sources=1000, sigma=200.0)
    names = (parameters,) if isinstance(parameters, str) else parameters

    def of(field):
        covariance = named(names, 2).covariance(fit.fit_field(field, 2).covariance)
        return np.log(covariance[0, 0]) if len(names) == 1 else correlation_of(covariance)[0, 1]

    for pixel in (0, 20, 47):
        lon, lat = (
            np.append(old, np.full(1000, new[pixel]))
            for old, new in zip((field.lon, field.lat), centres(2), strict=True)
        )
        sigma = np.concatenate([field.sigma, np.full((2, 1000), 200.0)], axis=1)
        richer = Field(lon, lat, np.zeros((2, 1500)), sigma, np.append(field.rho, np.zeros(1000)), frame=field.frame)
        assert values[pixel] == pytest.approx(of(richer) - of(field), rel=1e-8)
