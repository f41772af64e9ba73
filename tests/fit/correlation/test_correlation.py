import numpy as np
import pytest
from conftest import nonuniform, random_field

import fit
import sim
from fit.correlation import correlation_matrices, influence_map, leakage, parameters_of, select_parameters
from vsh import Field
from vsh.sky.pixels import smooth_map
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, FieldError, FrameError, ModesError, ParameterError


def test_names_and_rows():
    assert parameters_of("spin+acceleration").names == ("omega_x", "omega_y", "omega_z", "a_x", "a_y", "a_z")
    assert parameters_of(2).names[:2] == ("t(1,0)", "t(1,1,re)")
    field = random_field(200, 1)
    solution = fit.fit_field(field, 3)
    chosen = select_parameters(("omega_y", "t(2,0)", "a_z"), 3)
    values = chosen.rows @ solution.coefficients.values
    np.testing.assert_allclose(values[[0, 2]], [solution.spin.value[1], solution.acceleration.value[2]])
    with pytest.raises(ParameterError, match="no parameter is called omega_w; there are omega_x"):
        select_parameters(("omega_w",), 1)
    with pytest.raises(ParameterError, match="'spin.acceleration', a degree or Modes"):
        parameters_of("vsh")


@pytest.mark.parametrize("even", [True, False])
def test_both_solvers_give_the_same_matrix(even):
    field = nonuniform(uniform_errors=even)
    one, two = correlation_matrices(field), correlation_matrices(field, solver="frame")
    assert one.names == two.names
    np.testing.assert_allclose(one.matrix(0), two.matrix(0), atol=1e-10)


def test_equal_weights_are_tied_by_the_dipole_to_second_order():
    """The block ω–ã is −(3/2)[r̄]ₓ: halving the non-uniformity quarters what is left."""
    rng = np.random.default_rng(1)
    lon, lat = sim.uniform_sky(400_000, rng)
    r = triad(lon, lat)[2]
    direction = np.array([0.3, -0.5, 0.8]) / np.linalg.norm([0.3, -0.5, 0.8])
    left = []
    for size in (0.4, 0.2):
        # Weights by 1/σ²: exact non-uniformity without the noise of counts.
        symmetric = np.concatenate([r, -r], axis=1)
        weight = 1 + size * (direction @ symmetric + 0.5 * (symmetric[2] ** 2 - 1 / 3))
        lon2, lat2 = np.concatenate([lon, lon + np.pi]), np.concatenate([lat, -lat])
        field = Field(lon2, lat2, np.zeros((2, lon2.size)), np.broadcast_to(1 / np.sqrt(weight), (2, lon2.size)))
        found = correlation_matrices(field)
        np.testing.assert_allclose(found.dipoles[0], size * direction / 3, atol=0.01)
        left.append(np.abs(found.matrix(0)[:3, 3:] - found.dipole_prediction(0)).max())
    assert left[0] < 0.1
    assert left[1] / left[0] < 0.35


def test_two_catalogues_in_one_matrix():
    a, b = nonuniform(uniform_errors=True), nonuniform(seed=2)
    both = correlation_matrices({"A": a, "B": b})
    matrix = both.combined()
    assert matrix[0, 4] == both.matrix(0)[0, 4]
    assert matrix[4, 0] == both.matrix(1)[4, 0]
    assert both.labels == ("A", "B")
    table = both.to_table()
    assert table.meta["upper"] == "A"
    np.testing.assert_allclose([table[name][0] for name in both.names], matrix[0])
    text = both.report(long=True)
    assert "above diagonal  A\nbelow diagonal  B" in text
    assert "is explained by the dipole along z" in text
    assert abs(both.largest(0)[0]) == pytest.approx(0.45, abs=0.08)
    assert "A, B" in repr(both)


def test_orientation_in_front():
    field, offsets = nonuniform(), nonuniform(200, 5)
    found = correlation_matrices(field, offsets=offsets)
    assert found.names[:3] == ("epsilon_x", "epsilon_y", "epsilon_z")
    np.testing.assert_allclose(found.matrix(0)[3:, 3:], correlation_matrices(field).matrix(0), atol=1e-10)
    np.testing.assert_array_equal(found.matrix(0)[:3, 3:].round(12), 0)


def test_positions_are_enough():
    quasars = sim.quasars(2000, 1, "igql")
    found = correlation_matrices(quasars, sigma=300.0)
    still = Field.from_positions(quasars, 300.0)
    np.testing.assert_allclose(found.matrix(0), correlation_matrices(still).matrix(0))
    with pytest.raises(FieldError, match="without errors need sigma="):
        correlation_matrices(quasars)


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda f: correlation_matrices([f, f.to_frame("icrs")]), FrameError, "galactic and icrs"),
        (lambda f: correlation_matrices(f, labels=["a", "b"]), ParameterError, "2 labels for 1"),
        (lambda f: correlation_matrices(f, 2, solver="frame"), ParameterError, r"used with parameters=.spin\+acc"),
        (lambda f: correlation_matrices(f, solver="qr"), ParameterError, 'solver is "harmonics" or "frame"'),
        (lambda f: correlation_matrices(f[:2]), DegeneracyError, "cannot separate"),
        (lambda f: influence_map(f, 1, ("a_x", "a_x")), ParameterError, "two different"),
        (lambda f: influence_map(f, 1, ("a_x", "t(2,0)")), ParameterError, r"no parameter is called t\(2,0\)"),
        (lambda f: influence_map(f, 1, "a_x", quantity="mean"), ParameterError, "quantity is None"),
        (lambda f: influence_map(f, 1, ("a_x", "a_y"), quantity="value"), ParameterError, "of one parameter"),
        (lambda f: influence_map(f, 1, "a_x", nside=3), FieldError, "power of two"),
        (lambda f: leakage(f, 3, 2), ModesError, "above the fitted degree 3"),
        (lambda f: leakage(f, 1, 3).bias([1.0]), ParameterError, "each degree 2 to 3"),
        (lambda f: leakage(f, 1, 3).bias({4: 1.0}), ParameterError, "degree 4 is none of"),
        (lambda f: leakage(f, 1, 3).bias(-1.0), ParameterError, "cannot be negative"),
    ],
)
def test_bad_input(call, error, words):
    with pytest.raises(error, match=words):
        call(nonuniform(300))


def test_figures():
    field = nonuniform(2000)
    from fit.correlation import plot_influence, symbol

    assert symbol("omega_y") == r"$\omega_y$"
    for found in (correlation_matrices([field, nonuniform(seed=2)]), correlation_matrices(field, 3)):
        axes = found.plot()
        image = axes.images[0]
        assert image.norm.vmin == -image.norm.vmax
        assert "galactic" in axes.figure.axes[1].get_xlabel()
    values = influence_map(field, 1, ("omega_y", "a_x"), 8)
    for smooth in (None, 0.0):
        image = plot_influence(values, field, "title", "label", smooth=smooth).images[0]
        assert image.norm.vmin == -image.norm.vmax
    assert smooth_map(values, 20.0).sum() == pytest.approx(values.sum(), abs=1e-3 * np.abs(values).sum())
    assert smooth_map(values, 20.0).std() < 0.8 * values.std()
    np.testing.assert_allclose(smooth_map(np.ones(192), 30.0), 1, atol=2e-3)  # healpy's transform
    assert len(leakage(field, 1, 3).plot()) == 2
