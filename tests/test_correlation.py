import numpy as np
import pytest
from conftest import random_field

import fit
import sim
from fit.correlation import (
    blamed,
    correlation_map,
    eigenmodes,
    gain,
    influence,
    leakage,
    lmax_table,
    plan,
    predict,
    predict_drift,
    recommend_lmax,
    thin,
)
from fit.drift import hubble_constant, observer_velocity
from fit.parameters import correlation_of, named, parameters
from fit.predict import as_field, reweighted
from vsh import Field, Modes
from vsh.errors import DegeneracyError, FieldError, FrameError, ModesError, ParameterError
from vsh.pixels import pixels_of
from vsh.sphere import triad


def patchy(n=3000, seed=1, even=False, frame="galactic"):
    """Quasars of the patchy list, with unequal errors unless `even`."""
    quasars = sim.quasars(n, seed, "igql")
    rng = np.random.default_rng([seed, 7])  # a stream of its own: errors that know nothing of places
    sigma = np.full((2, n), 300.0) if even else 10 ** rng.uniform(2, 3, (2, n))
    rho = np.zeros(n) if even else rng.uniform(-0.8, 0.8, n)
    return Field(quasars.lon, quasars.lat, np.zeros((2, n)), sigma, rho).to_frame(frame)


def test_names_and_rows():
    assert parameters("frame").names == ("omega_x", "omega_y", "omega_z", "a_x", "a_y", "a_z")
    assert parameters(2).names[:2] == ("t(1,0)", "t(1,1,re)")
    field = random_field(200, 1)
    solution = fit.fit_field(field, 3)
    chosen = named(("omega_y", "t(2,0)", "a_z"), 3)
    values = chosen.rows @ solution.coefficients.values
    np.testing.assert_allclose(values[[0, 2]], [solution.spin.value[1], solution.acceleration.value[2]])
    with pytest.raises(ParameterError, match="no parameter is called omega_w; there are omega_x"):
        named(("omega_w",), 1)
    with pytest.raises(ParameterError, match='"frame", a degree or Modes'):
        parameters("vsh")


@pytest.mark.parametrize("even", [True, False])
def test_both_solvers_give_the_same_matrix(even):
    field = patchy(even=even)
    one, two = correlation_map(field), correlation_map(field, solver="frame")
    assert one.names == two.names
    np.testing.assert_allclose(one.matrix(0), two.matrix(0), atol=1e-10)


def test_equal_weights_are_tied_by_the_dipole_to_second_order():
    """The block ω–ã is −(3/2)[r̄]ₓ: halving the unevenness quarters what is left."""
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(400_000, rng)
    r = triad(lon, lat)[2]
    direction = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    left = []
    for size in (0.4, 0.2):
        # Weights by 1/σ²: exact unevenness without the noise of counts.
        symmetric = np.concatenate([r, -r], axis=1)
        weight = 1 + size * (direction @ symmetric + 0.5 * (symmetric[2] ** 2 - 1 / 3))
        lon2, lat2 = np.concatenate([lon, lon + np.pi]), np.concatenate([lat, -lat])
        field = Field(lon2, lat2, np.zeros((2, lon2.size)), np.broadcast_to(1 / np.sqrt(weight), (2, lon2.size)))
        found = correlation_map(field)
        np.testing.assert_allclose(found.dipoles[0], size * direction / 3, atol=0.01)
        left.append(np.abs(found.matrix(0)[:3, 3:] - found.explained(0)).max())
    assert left[0] < 0.1
    assert left[1] / left[0] < 0.35


def test_two_catalogues_in_one_matrix():
    a, b = patchy(even=True), patchy(seed=2)
    both = correlation_map({"A": a, "B": b})
    matrix = both.both()
    assert matrix[0, 4] == both.matrix(0)[0, 4]
    assert matrix[4, 0] == both.matrix(1)[4, 0]
    assert both.labels == ("A", "B")
    table = both.table()
    assert table.meta["upper"] == "A"
    np.testing.assert_allclose([table[name][0] for name in both.names], matrix[0])
    text = both.text()
    assert "upper A, lower B" in text
    assert "by the dipole along z" in text
    assert abs(both.worst(0)[0]) == pytest.approx(0.45, abs=0.08)
    assert "A, B" in repr(both)


def test_orientation_in_front():
    field, offsets = patchy(), patchy(200, 5)
    found = correlation_map(field, offsets=offsets)
    assert found.names[:3] == ("epsilon_x", "epsilon_y", "epsilon_z")
    np.testing.assert_allclose(found.matrix(0)[3:, 3:], correlation_map(field).matrix(0), atol=1e-10)
    np.testing.assert_array_equal(found.matrix(0)[:3, 3:].round(12), 0)


def test_positions_are_enough():
    quasars = sim.quasars(2000, 1, "igql")
    found = correlation_map(quasars, sigma=300.0)
    still = as_field(quasars, 300.0)
    np.testing.assert_allclose(found.matrix(0), correlation_map(still).matrix(0))
    with pytest.raises(FieldError, match="without errors need sigma="):
        correlation_map(quasars)


# Influence


def finite_difference(field, modes, pair, pixels, pixel, step=1e-4, of=None):
    values = []
    for sign in (1, -1):
        factor = np.where(pixels == pixel, 1 + sign * step, 1.0)
        solution = fit.solve(fit.normal_equations(reweighted(field, factor), modes, method="direct"))
        chosen = named((pair,) if isinstance(pair, str) else pair, modes)
        covariance = chosen.covariance(solution.covariance)
        if of == "value":
            values.append((chosen.rows @ solution.coefficients.values)[0])
        elif len(chosen) == 1:
            values.append(np.log(covariance[0, 0]))
        else:
            values.append(correlation_of(covariance)[0, 1])
    return (values[0] - values[1]) / (2 * step)


@pytest.mark.parametrize("seed", range(20))
def test_influence_against_finite_differences(seed):
    rng = np.random.default_rng(seed)
    field = patchy(800, seed)
    lmax = int(rng.integers(1, 4))
    names = [str(mode) for mode in Modes(lmax)] + list(parameters("frame").names)
    pair = tuple(rng.choice(names, 2, replace=False))
    found = influence(field, lmax, pair, nside=2)
    pixels = pixels_of(field.lon, field.lat, 2)
    for pixel in rng.choice(np.unique(pixels), 3, replace=False):
        expected = finite_difference(field, Modes(lmax), pair, pixels, pixel)
        assert found[pixel] == pytest.approx(expected, rel=1e-6, abs=1e-9)


def test_influence_on_variances_and_values():
    field = patchy(800, 3)
    field = field._with(motion=np.random.default_rng(1).normal(size=(2, 800)) * field.sigma)
    pixels = pixels_of(field.lon, field.lat, 2)
    variance, value = influence(field, 2, "a_x", 2), influence(field, 2, "a_x", 2, of="value")
    for pixel in np.unique(pixels)[:4]:
        assert variance[pixel] == pytest.approx(finite_difference(field, Modes(2), "a_x", pixels, pixel), rel=1e-6)
        expected = finite_difference(field, Modes(2), "a_x", pixels, pixel, of="value")
        assert value[pixel] == pytest.approx(expected, rel=1e-5, abs=1e-8)
    assert variance.sum() == pytest.approx(-1)  # doubling everything halves a variance: d ln σ²/d ln w = −1
    assert value.sum() == pytest.approx(0, abs=1e-9)
    assert influence(field, "frame", ("omega_x", "a_y"), 2).sum() == pytest.approx(0, abs=1e-12)


def test_thousands_of_sources_take_the_transform():
    field = patchy(12_000, 3)
    few = influence(field, 2, ("omega_x", "a_y"), 4)
    parts = [influence_of_part(field, keep) for keep in np.array_split(np.arange(12_000), 2)]
    np.testing.assert_allclose(sum(parts), few, atol=1e-11)


def influence_of_part(field, keep):
    """The same sum over some of the sources, evaluated by the harmonics."""
    from fit.influence import _change, _prepared
    from vsh import Coefficients

    covariance, first, second, chosen = _prepared(field, 2, ("omega_x", "a_y"))
    part = field[keep]
    g, h = (Coefficients(chosen.modes, covariance @ row).at(part.lon, part.lat) for row in (first, second))
    a, b, c = part.weights

    def product(x, y):
        return a * x[0] * y[0] + b * x[1] * y[1] + c * (x[0] * y[1] + x[1] * y[0])

    return np.bincount(pixels_of(part.lon, part.lat, 4), _change(covariance, first, second, g, h, product), 192)


def test_removing_the_blamed_region_lowers_the_correlation_as_foretold():
    field = patchy(20_000, 4, even=True)
    before = correlation_map(field).matrix(0)[0, 4]
    values = influence(field, 1, ("omega_x", "a_y"), 4)
    pixels = pixels_of(field.lon, field.lat, 4)
    mask = blamed(values, 0.3)
    assert 1 < mask.sum() < 96
    # A tenth of its weight: what the derivative foretells; all of it: lower still.
    factor = np.where(mask[pixels], 0.9, 1.0)
    after = correlation_map(reweighted(field, factor)).matrix(0)[0, 4]
    assert after - before == pytest.approx(-0.1 * values[mask].sum(), rel=0.05)
    assert after < before
    assert abs(correlation_map(field[~mask[pixels]]).matrix(0)[0, 4]) < before - 0.1


def test_adding_sources_does_what_was_foretold():
    field = patchy(20_000, 4, even=True)
    values = gain(field, 1, ("omega_x", "a_y"), 2, new=200)
    from vsh.pixels import centres

    lon, lat = (x[int(values.argmin())] for x in centres(2))
    rng = np.random.default_rng(1)
    more = [np.concatenate([old, np.full(200, new) + 1e-3 * rng.normal(size=200)])
            for old, new in ((field.lon, lon), (field.lat, lat))]  # fmt: skip
    richer = Field(*more, np.zeros((2, 20_200)), np.full((2, 20_200), 300.0), frame="galactic")
    change = correlation_map(richer).matrix(0)[0, 4] - correlation_map(field).matrix(0)[0, 4]
    assert change == pytest.approx(values.min(), rel=0.05)
    assert (gain(field, 1, "a_x", 2) <= 0).all()


# Leakage


def test_leakage_is_the_bias_of_a_noiseless_fit():
    field = patchy(1000, 5)
    rng = np.random.default_rng(1)
    from vsh import Coefficients

    modes = Modes(5)
    c = rng.normal(size=len(modes))
    c[[mode.l <= 2 for mode in modes]] = 0
    truth = Coefficients(modes, c)
    found = leakage(field, 2, 5)
    biased = fit.fit_field(field._with(motion=truth.at(field.lon, field.lat)), 2)
    np.testing.assert_allclose(found.of(truth).values, biased.coefficients.values, atol=1e-9)
    assert found.matrix.shape == (16, 54)
    assert found.names[0] == "t(1,0)"
    assert found.unmodelled_names[0] == "t(3,0)"
    assert len(found.table()) == 16


def test_mean_squared_bias_of_2000_skies():
    """200 would tell the mean square of six components to 4 % only."""
    field = patchy(500, 6)
    power = np.array([3.0, 2.0, 1.0, 0.5, 0.25])
    found = leakage(field, 1, 6)
    expected = found.bias(power)
    squares = np.zeros(6)
    for seed in range(2000):
        truth = sim.isotropic(np.r_[0.0, power], rng=seed)
        solution = fit.fit_field(field._with(motion=truth(field.lon, field.lat)), 1)
        squares += solution.coefficients.values**2 / 2000
    assert np.mean(squares / expected**2) == pytest.approx(1, abs=0.05)
    np.testing.assert_allclose(found.bias({2: 3.0, 3: 2.0, 4: 1.0, 5: 0.5, 6: 0.25}), expected)
    np.testing.assert_allclose(found.bias(np.stack([power, power])), expected)
    np.testing.assert_allclose(found.bias(4 * power), 2 * expected)
    vector = found.bias_of(("a_x", "a_y", "a_z"), power)
    assert set(vector) == {"a_x", "a_y", "a_z"}


def test_an_even_sky_leaks_nothing():
    from vsh.pixels import centres

    lon, lat = centres(16)
    field = Field(lon, lat, np.zeros((2, lon.size)), np.ones((2, lon.size)))
    assert np.abs(leakage(field, 2, 4).matrix).max() < 2e-3
    np.testing.assert_allclose(eigenmodes(field, 2).information, 1, atol=5e-3)
    assert predict(field, 1).efficiency == pytest.approx(1, abs=1e-3)
    assert recommend_lmax(field, highest=4) == 4


def test_recommended_degree():
    field = patchy(20_000, 1, even=True)
    rows = lmax_table(field, 4)
    for lmax, condition, correlation in rows:
        solution = fit.solve(fit.normal_equations(field, Modes(lmax)))
        assert correlation == pytest.approx(np.abs(solution.correlation - np.eye(len(solution.modes))).max(), rel=1e-8)
        diagonal = 1 / np.sqrt(np.diag(fit.normal_equations(field, Modes(lmax)).matrix))
        scaled = fit.normal_equations(field, Modes(lmax)).matrix * np.outer(diagonal, diagonal)
        assert condition == pytest.approx(np.linalg.cond(scaled), rel=1e-6)
    assert recommend_lmax(field, rows[2][1] * 1.01, 0.99) == 3
    assert recommend_lmax(field, 1e9, rows[0][2] * 1.01) == 1
    with pytest.raises(DegeneracyError, match="not even degree 1"):
        recommend_lmax(field, 1.5, 0.1)
    assert lmax_table(field[:10], 4)[-1] == (4, np.inf, 1.0)


def test_eigenmodes_are_measured_apart():
    field = patchy(3000, 2)
    found = eigenmodes(field, 2)
    assert (np.diff(found.information) >= 0).all()
    normal = fit.normal_equations(field, Modes(2)).matrix
    vectors = np.stack([each.values for each in found.fields])
    product = vectors @ normal @ vectors.T
    np.testing.assert_allclose(product / np.sqrt(np.outer(np.diag(product), np.diag(product))), np.eye(16), atol=1e-9)
    for each in found.fields[:3]:
        total = sum(each.power(kind, l) for kind in "TS" for l in (1, 2))
        assert total == pytest.approx(1)


# Planning


def test_a_prediction_is_the_covariance_of_the_fit_to_come():
    field = patchy()
    found, solution = predict(field, 3), fit.fit_field(field, 3)
    np.testing.assert_array_equal(found.covariance, solution.covariance)
    np.testing.assert_allclose(found.spin.sigma, solution.spin.sigma)
    assert np.isnan(found.coefficients.values).all()
    assert np.isnan(found.chi2)
    assert 0 < found.efficiency < 1
    assert "Prediction: degree 3" in repr(found)
    value, pair = predict(field, 1).worst
    assert value == pytest.approx(correlation_map(field).worst(0)[0])
    assert pair == correlation_map(field).worst(0)[1]


def test_plans_side_by_side():
    field = patchy()
    north = field.lat > 0
    table = plan(field, {"all": None, "north": north, "half the weight": np.full(len(field), 0.5)})
    assert list(table["case"]) == ["all", "north", "half the weight"]
    assert table["sources"][1] == north.sum()
    assert table["sigma_spin"][2] == pytest.approx(np.sqrt(2) * table["sigma_spin"][0])
    assert table["efficiency"][1] < table["efficiency"][0]
    for bad, words in ((np.ones(3), "one value a source"), (np.full(len(field), -1.0), "finite and not negative")):
        with pytest.raises(FieldError, match=words):
            plan(field, {"bad": bad})


def test_predicted_velocity_and_hubble():
    galaxies = sim.galaxies(500, rng=1)
    velocity, hubble = predict_drift(galaxies, 70.0, sigma=5.0, peculiar=300.0)
    field = as_field(galaxies, 5.0)
    np.testing.assert_allclose(velocity.sigma, observer_velocity(field, 70.0, peculiar=300.0).sigma)
    assert hubble.hubble_error == pytest.approx(
        hubble_constant(field, "planck", peculiar=300.0, hubble=70.0).hubble_error, rel=1e-3
    )
    assert np.isnan(velocity.velocity.value).all()


@pytest.mark.parametrize("bound", [0.3, 0.1])
def test_thinning_reaches_its_bound_at_little_cost(bound):
    field = patchy(20_000, 1)
    found = thin(field, bound)
    assert abs(found.before.worst[0]) > 0.35
    assert abs(found.after.worst[0]) <= bound + 1e-3
    assert np.nanmin(found.keep) >= 0
    assert np.nanmax(found.keep) <= 1
    # Against the plain way, all pixels cut down to one density: the same bound costs less.
    ratio = np.sqrt(np.mean(found.after.acceleration.sigma**2) / np.mean(found.before.acceleration.sigma**2))
    pixels = pixels_of(field.lon, field.lat, 4)
    weight = np.bincount(pixels, field.weights[:2].sum(0), 192)
    flat = np.minimum(1, np.quantile(weight[weight > 0], 0.5) / weight[pixels])
    plain = predict(reweighted(field, flat), 1)
    assert ratio < 1.35
    if abs(plain.worst[0]) >= bound:
        assert ratio < np.sqrt(np.mean(plain.acceleration.sigma**2) / np.mean(found.before.acceleration.sigma**2)) * 1.2
    mask = found.mask(rng=1)
    assert mask.mean() == pytest.approx(found.factors.mean(), abs=0.02)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda f: correlation_map([f, f.to_frame("icrs")]), FrameError, "galactic and icrs"),
        (lambda f: correlation_map(f, labels=["a", "b"]), ParameterError, "2 labels for 1"),
        (lambda f: correlation_map(f, 2, solver="frame"), ParameterError, "parameters of the frame"),
        (lambda f: correlation_map(f, solver="qr"), ParameterError, 'solver is "harmonics" or "frame"'),
        (lambda f: correlation_map(f[:2]), DegeneracyError, "cannot separate"),
        (lambda f: influence(f, 1, ("a_x", "a_x")), ParameterError, "two different"),
        (lambda f: influence(f, 1, ("a_x", "t(2,0)")), ParameterError, r"no parameter is called t\(2,0\)"),
        (lambda f: influence(f, 1, "a_x", of="mean"), ParameterError, "of is None"),
        (lambda f: influence(f, 1, ("a_x", "a_y"), of="value"), ParameterError, "of one parameter"),
        (lambda f: influence(f, 1, "a_x", nside=3), FieldError, "power of two"),
        (lambda f: gain(f, 1, "a_x", of="value"), ParameterError, "no motions"),
        (lambda f: leakage(f, 3, 2), ModesError, "above degree 3"),
        (lambda f: leakage(f, 1, 3).bias([1.0]), ParameterError, "each degree from 2 to 3"),
        (lambda f: leakage(f, 1, 3).bias({4: 1.0}), ParameterError, "degree 4 is not among"),
        (lambda f: leakage(f, 1, 3).bias(-1.0), ParameterError, "cannot be negative"),
        (lambda f: thin(f, 1.5), ParameterError, "between 0 and 1"),
        (lambda f: blamed(np.ones(12), 0.0), FieldError, "share"),
    ],
)
def test_bad_input(call, error, words):
    with pytest.raises(error, match=words):
        call(patchy(300))


def test_figures():
    field = patchy(2000)
    from fit.plot_correlation import plot_influence, pretty

    assert pretty("omega_y") == r"$\omega_y$"
    for found in (correlation_map([field, patchy(seed=2)]), correlation_map(field, 3)):
        figure = found.plot()
        image = figure.axes[0].images[0]
        assert image.norm.vmin == -image.norm.vmax
        assert "galactic" in figure.axes[1].get_ylabel()
    figure = plot_influence(influence(field, 1, ("omega_y", "a_x"), 8), field, "title", "label")
    mesh = figure.axes[0].collections[0]
    assert mesh.norm.vmin == -mesh.norm.vmax
    assert len(leakage(field, 1, 3).plot().axes) == 2
    assert len(eigenmodes(field, 1).plot().axes) == 4
