"""A field on the sky: what is coloured, named and explained."""

import matplotlib as mpl
import numpy as np
import pytest
from conftest import random_field
from matplotlib.figure import Figure
from scipy.stats import chi2

import fit
from vsh import Coefficients, Field, Modes, ParameterError
from vsh.basis import harmonics
from vsh.figures.plot import FADED, SkyAxes, arrow_grid, draw_matrix, even_grid, plot_field
from vsh.figures.plot._field import SURE, compute_significance, compute_smallest_chance


@pytest.mark.parametrize("frame", ["icrs", "galactic", "ecliptic"])
def test_maps_name_their_frame(frame):
    field = random_field(100, seed=1).to_frame(frame)
    axes = plot_field(field, fit.fit_field(field, 2).coefficients)
    words = [text.get_text() for text in axes.texts]
    assert any(word.startswith("ICRS" if frame == "icrs" else frame) for word in words)
    still = plot_field(field, Coefficients(Modes(1), np.zeros(6)))  # nothing to draw is no crash
    still.figure.canvas.draw()


def test_arrows_are_as_dark_as_they_are_sure():
    field = random_field(2000, seed=1)
    solution = fit.fit_field(field, 3)
    axes = plot_field(field, solution.coefficients, covariance=solution.covariance)
    assert isinstance(axes, SkyAxes)
    grid = arrow_grid(axes)
    motion, basis = solution.coefficients.at(*grid), harmonics(*grid, solution.modes)
    sure = compute_significance(motion, basis, solution.covariance)
    # By hand, for one arrow.
    block = basis[:, :, 7].T @ solution.covariance @ basis[:, :, 7]
    assert sure[7] == pytest.approx(np.sqrt(motion[:, 7] @ np.linalg.solve(block, motion[:, 7])))
    shafts = next(each for each in axes.collections if isinstance(each, mpl.collections.LineCollection))
    grey = np.all(np.isclose(shafts.get_colors(), mpl.colors.to_rgba(FADED)), axis=1)
    np.testing.assert_array_equal(grey, sure < SURE)
    light = np.dot(shafts.get_colors()[:, :3], [0.2, 0.7, 0.1])
    order = np.argsort(np.clip(sure[~grey], 0, 6))
    assert (np.diff(light[~grey][order]) <= 1e-9).all()
    with pytest.raises(ParameterError, match="covariance has shape"):
        plot_field(field, solution.coefficients, covariance=np.eye(3))


@pytest.mark.parametrize(("size", "top"), [(20.0, 6.0), (400.0, 100.0)])
def test_colours_reach_as_far_as_the_arrows(size, top):
    """All arrows of a sure field were of the one colour beyond six errors."""
    coefficients = Coefficients.from_vectors(glide=(0, 0, size))
    axes = plot_field(None, coefficients, covariance=np.diag(np.full(6, 100.0)))
    (bar,) = [child for child in axes.figure.axes if child is not axes]
    assert max(bar.get_xlim()) == top
    motion, basis = coefficients.at(*arrow_grid(axes)), harmonics(*arrow_grid(axes), Modes(1))
    beyond = np.mean(compute_significance(motion, basis, np.diag(np.full(6, 100.0))) > top)
    assert beyond <= 0.05


def test_few_draws_give_a_covariance_that_is_singular():
    """As of a bootstrap of ten draws: noise stays grey, and a motion of five errors does not."""
    field = random_field(2000, seed=1)
    solution = fit.fit_field(field, 2)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(16), solution.covariance, 10)
    covariance = np.cov(draws.T)
    assert np.linalg.matrix_rank(covariance) == 9

    def colours(values):
        axes = plot_field(field, Coefficients(solution.modes, values), covariance=covariance)
        shafts = next(each for each in axes.collections if isinstance(each, mpl.collections.LineCollection))
        return len(np.unique(shafts.get_colors(), axis=0))

    assert colours(draws[0]) == 1
    assert colours(20 * draws[0]) > 1


def test_stars_are_explained():
    field = random_field(2000, seed=1)

    def words(lmax, coefficients=None):
        solution = fit.fit_field(field, lmax)
        axes = plot_field(field, coefficients or solution.coefficients, covariance=solution.covariance)
        return axes.get_legend()

    assert "need not meet" in words(3).get_title().get_text()
    alone = words(1, Coefficients.from_vectors(glide=(0, 1, 0)))
    assert "need not" not in alone.get_title().get_text()


def test_spectrum_has_limits_where_there_is_no_signal():
    solution = fit.fit_field(random_field(3000, seed=1), 4)
    axes = fit.output.plot_spectrum(solution)
    names = [text.get_text() for text in axes.get_legend().get_texts()]
    assert any("95 % limit" in name for name in names)
    assert axes.child_axes[0].get_ylabel() == "√power  [µas/yr]"
    shown = sum(len(each.lines[2][0].get_segments()) for each in axes.containers)
    assert shown == 8  # each kind and degree once, as a point or as a limit


def test_correlations_have_names_a_reader_knows():
    for lmax in (1, 2, 5):
        axes = fit.output.plot_correlation(fit.fit_field(random_field(3000, seed=1), lmax))
        labels = [label.get_text() for label in axes.get_yticklabels()]
        assert ("T5" in labels) if lmax == 5 else (r"$\omega_x$" in labels and r"$\tilde a_y$" in labels)
        numbers = [text.get_text() for text in axes.texts]
        assert len(numbers) == (30 if lmax == 1 else 0)
        image = axes.images[0]
        assert image.norm.vmin == -image.norm.vmax


def test_degree_one_of_the_matrix_is_that_of_the_vectors():
    from fit.results.output._figures import _name_and_correlate_coefficients

    solution = fit.fit_field(random_field(3000, seed=1), 2)
    names, matrix, _ = _name_and_correlate_coefficients(solution)
    i, j = names.index(r"$\omega_x$"), names.index(r"$\omega_z$")
    spin = solution.spin
    assert matrix[i, j] == pytest.approx(spin.covariance[0, 2] / (spin.sigma[0] * spin.sigma[2]))


def test_residuals_by_significance():
    """Right errors give a normal deviate; errors that are too small by a fifth stand out."""
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 20_000), np.arcsin(rng.uniform(-1, 1, 20_000))
    field = Field(lon, lat, rng.normal(0, 3, (2, 20_000)), np.full((2, 20_000), 3.0))
    deviates = fit.output.plot_residuals(fit.fit_field(field, 1), field, nside=4).images[0].get_array()
    values = np.unique(deviates.compressed() if np.ma.isMaskedArray(deviates) else deviates[np.isfinite(deviates)])
    assert len(values) == 192
    assert abs(values.mean()) < 0.25
    assert values.std() == pytest.approx(1, abs=0.15)
    small = field.with_errors(field.sigma / 1.2, field.rho)
    deviates = fit.output.plot_residuals(fit.fit_field(small, 1), small, nside=4).images[0].get_array()
    assert np.nanmean(np.asarray(deviates)[np.isfinite(deviates)]) > 3


def test_noise_colours_one_arrow_in_twenty():
    """|v| over its error along itself exceeds 2 in 13 % of arrows of noise."""
    coloured = []
    solution = fit.fit_field(random_field(500, seed=1), 3)
    lon, lat = even_grid(20)
    basis = harmonics(lon, lat, solution.modes)
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(30), solution.covariance, 400)
    for values in draws:
        motion = np.tensordot(values, basis, 1)
        coloured.append(np.mean(compute_significance(motion, basis, solution.covariance) > SURE))
    assert abs(np.mean(coloured) - 0.05) < 0.01


def test_spin_is_seen_among_coefficients_that_a_floor_holds_back():
    """Higher degrees are then small by their errors: χ² of all would call a spin of seven errors noise."""
    modes = Modes(5)
    values, errors = np.full(len(modes), 0.3), np.ones(len(modes))
    assert compute_smallest_chance(Coefficients(modes, values), np.diag(errors)) > 0.5
    values[modes.slice_of("T", 1)] = 4.0
    assert compute_smallest_chance(Coefficients(modes, values), np.diag(errors)) == pytest.approx(chi2.sf(48, 3))
    values[modes.slice_of("T", 1)], values[modes.slice_of("S", 3)] = 0.3, 9.0
    assert compute_smallest_chance(Coefficients(modes, values), np.diag(errors)) < 1e-9


def test_matrix_of_many_modes_of_one_degree_has_its_name():
    axes = Figure().subplots()
    draw_matrix(axes, np.eye(33), [f"s(16,{m})" for m in range(33)], ["S16"] * 33)
    assert [label.get_text() for label in axes.get_xticklabels()] == ["S16"]
