"""Draws from a grid, and chains whose moves are such draws."""

import numpy as np
import pytest
from conftest import few_or_many
from scipy.stats import chi2, kstest
from test_posterior import galaxies

from fit.posterior import Flat, Normal, grid, sample
from fit.posterior._posterior import Cells, make_cells_if_possible
from fit.posterior._sampling import Run
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.tools.errors import ParameterError

FREE = {
    "known velocity": {"velocity_prior": CMB_VELOCITY_PLANCK18},
    "free velocity": {"velocity_prior": "flat", "hubble_prior": Normal(70, 8, low=20)},
    "free dispersion": {"velocity_prior": CMB_VELOCITY_PLANCK18, "peculiar_dispersion": Flat(0, 900)},
}
COMMON: dict = {"progress": False, "flows": None}


@pytest.fixture(scope="module")
def field():
    return galaxies(1000, spread=300.0)


@pytest.fixture(params=["known velocity", "free velocity", pytest.param("free dispersion", marks=pytest.mark.slow)])
def free(request):
    return FREE[request.param]


@few_or_many(2, 30, "seeds")
@pytest.mark.parametrize("method", ["grid", "emcee"])
def test_both_ways_are_the_grid(field, free, method, seeds):
    """Means of H0 within their Monte Carlo errors, by χ²; its σ as well as a heavy tail allows."""
    exact = grid(field, n_points=400, flows=None, **free)
    away, widths = [], []
    for seed in range(seeds):
        found = sample(field, method=method, n_samples=20_000, rng=seed, **COMMON, **free)
        error = exact.sigma("H0") / np.sqrt(found.effective_size["H0"])
        away.append((np.mean(found.samples["H0"]) - exact.mean("H0")) / error)
        widths.append(np.std(found.samples["H0"]) / exact.sigma("H0"))
        np.testing.assert_allclose(found.velocity.sigma, exact.velocity.sigma, rtol=0.05)
    assert chi2.sf(np.sum(np.square(away)), seeds) > 1e-3, away
    assert abs(np.mean(widths) - 1) < 0.06 / np.sqrt(seeds)


def test_draws_are_independent_and_of_the_posterior(field):
    """H0 by its whole distribution; the chain that they fill says one autocorrelation time a step."""
    exact = grid(field, CMB_VELOCITY_PLANCK18, n_points=2000, flows=None)
    x, p = exact.marginal("H0")
    found = sample(field, CMB_VELOCITY_PLANCK18, method="grid", n_samples=20_000, rng=3, **COMMON)
    share = np.cumsum(p) - p / 2
    assert kstest(found.samples["H0"], lambda h: np.interp(h, x, share)).pvalue > 1e-3
    assert max(found.autocorrelation.values()) < 1.2
    assert found.burn_in == 0
    assert len(found.samples["H0"]) == found.chain.shape[0] * found.chain.shape[1]
    assert "independent draws from a grid" in found.report(long=True)
    chain = sample(field, CMB_VELOCITY_PLANCK18, n_samples=20_000, rng=3, **COMMON)
    mean, sigma = chain.cells.hubble
    away = (chain.samples["H0"].mean() - mean) / (sigma / np.sqrt(chain.effective_size["H0"]))
    assert f"mean H0 is {away:+.1f} of its Monte Carlo errors" in chain.report(long=True)
    np.testing.assert_array_equal(
        found.log_probability.ravel(), found.model.log_probability(found.chain.reshape(-1, 4))
    )


def test_cells_may_be_coarse(field):
    """What varies within a cell is allowed for: draws of few cells are those of the posterior, too."""
    model = sample(field, CMB_VELOCITY_PLANCK18, method="grid", n_samples=2000, rng=3, **COMMON).model
    cells = Cells.of(model, 6)
    assert [len(edge) for edge in cells.edges] == [7]
    draws = cells.draw_independent(np.random.default_rng(1), 20_000)[0][:, 3]
    exact = grid(field, CMB_VELOCITY_PLANCK18, n_points=2000, flows=None)
    assert draws.std() == pytest.approx(exact.sigma("H0"), rel=0.03)
    assert abs(draws.mean() - exact.mean("H0")) < 0.03 * exact.sigma("H0")


def test_density_of_draws_is_what_they_are_drawn_with(field, free):
    """What `draw` says of its draws is what `log_density` says; and it integrates to one along H0."""
    cells = sample(field, n_samples=2000, max_samples=2000, rng=1, **COMMON, **free).cells
    theta, log = cells.draw(np.random.default_rng(1), 500)
    np.testing.assert_allclose(cells.log_density(theta), log, rtol=0, atol=1e-6)
    assert cells.probability.sum() == pytest.approx(1)
    theta[:, 3] = 1e9
    assert np.isneginf(cells.log_density(theta)).all()


@pytest.mark.slow
def test_chain_mends_what_the_draws_do_not_know(field):
    """Moves to draws of another posterior, twice as wide: the chain is still that of this one."""
    exact = grid(field, CMB_VELOCITY_PLANCK18, n_points=400, flows=None)
    found = sample(field, CMB_VELOCITY_PLANCK18, n_samples=2000, max_samples=2000, rng=1, **COMMON)
    share = found.cells.probability * np.linspace(1, 30, found.cells.probability.size)
    wrong = Cells(found.model, found.cells.edges, share / share.sum(), found.cells.mean, found.cells.covariance)

    begin = wrong.draw(np.random.default_rng(2), 128)[0]
    chain, _ = Run(found.model, begin, 1, 1500, False, 1e9, 0, wrong.propose).run()
    hubble = chain[200:, :, 3]
    assert abs(hubble.mean() - exact.mean("H0")) < 0.05 * exact.sigma("H0")
    assert hubble.std() == pytest.approx(exact.sigma("H0"), rel=0.05)


@pytest.mark.parametrize("setting", FREE)
def test_other_priors_begin_with_the_one_that_was_given(setting):
    """The table integrates over what else is free: its first row is the posterior above it."""
    weak = galaxies(400, spread=300.0, sigma=20.0)
    known = {"hubble_prior": Flat(10, 300)} | FREE[setting]
    found = sample(weak, method="grid", n_samples=40_000, rng=1, **COMMON, **known)
    row = next(line for line in found.report(long=True).splitlines() if line.startswith("  as given")).split()
    numbers = [float(each) for each in row[2:6] if each != "…"]
    mine = found.summary()["H0"]
    width = mine.high68 - mine.low68
    np.testing.assert_allclose(numbers, [mine.median, mine.low68, mine.high68], atol=0.02 * width)


def test_grids_have_limits(field):
    wide = {"peculiar_dispersion": Flat(0, 900), "excess_noise": Flat(0, 20)}
    with pytest.raises(ParameterError, match="is too large: fix all but two, or sample with emcee"):
        sample(field, method="grid", rng=1, **COMMON, **wide)
    with pytest.raises(ParameterError, match="must be Gaussian or flat"):
        sample(field, lambda v: -np.sum(v**2, 1) / 1e6, (70, 2), method="grid", rng=1, **COMMON)
    with pytest.raises(ParameterError, match="take no checkpoint"):
        sample(field, method="grid", rng=1, checkpoint="chain.npz", **COMMON)
    with pytest.raises(ParameterError, match="method"):
        sample(field, method="nuts", rng=1, **COMMON)
    three = sample(
        field, CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=1280, max_samples=1280, rng=1, **COMMON, **wide
    )
    assert three.cells is None
    assert make_cells_if_possible(three.model) is None


@pytest.mark.slow
def test_chain_that_is_too_short_goes_on(field):
    """Three free numbers are moved by differential evolution: a hundred steps are some three autocorrelation times."""
    wide = {"peculiar_dispersion": Flat(0, 900), "excess_noise": Flat(0, 20)}
    chain = sample(field, CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=12_800, rng=1, **COMMON, **wide).chain
    assert len(chain) >= 150
