from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context

import numpy as np
import pytest
from scipy.stats import chi2, kstest

import sim
from fit.posterior import Density, Flat, Normal, Samples, grid, read_samples, sample
from fit.posterior._model import make_parallax_model
from fit.posterior._priors import Priors, check_priors
from fit.secular_parallax import DistanceModel, observer_velocity
from vsh import Vector
from vsh.models.cosmology import BACHCHAN_2016, CMB_VELOCITY_PLANCK18
from vsh.tools.errors import ConvergenceError, DegeneracyError, ParameterError

VELOCITY = BACHCHAN_2016.to_frame("icrs").value
SETTINGS: dict = {"rng": 5, "progress": False, "flows": None}


def galaxies(n=2000, seed=1, sigma=5.0, velocity=VELOCITY, spread=0.0, hubble=67.3):
    truth = sim.secular_parallax(velocity, hubble=hubble) + sim.acceleration((-0.236, -3.756, -2.08))
    if spread:
        truth += sim.peculiar(spread, rng=[seed, 1], hubble=hubble)
    return sim.observe(sim.galaxies(n, rng=seed), truth, rng=[seed, 2], sigma=sigma, rho=0.3)


def closed_form(field, prior, hubble, peculiar, n_points=4001):
    """Means and widths of H0 and v from the least-squares velocity and a one-dimensional integral.

    u | data ~ N(û, C_u), v ~ N(m, C_v), H0 ~ N: with r = H0/H_ref, û ~ N(r m, C_u + r² C_v).
    """
    found = observer_velocity(field, 67.3, peculiar_dispersion=peculiar, flows=None).velocity
    prior = prior.to_frame(field.frame)
    h = np.linspace(max(hubble[0] - 7 * hubble[1], 0.5), hubble[0] + 7 * hubble[1], n_points)
    log, means, spreads = [], [], []
    for r in h / 67.3:
        total = found.covariance + r**2 * prior.covariance
        away = found.value - r * prior.value
        log.append(-away @ np.linalg.solve(total, away) / 2 - np.linalg.slogdet(total)[1] / 2)
        gain = r * prior.covariance @ np.linalg.inv(total)
        means.append(prior.value + gain @ away)
        spreads.append(prior.covariance - r * gain @ prior.covariance)
    p = np.exp(np.array(log) - max(log) - ((h - hubble[0]) / hubble[1]) ** 2 / 2)
    p /= p.sum()
    mean = p @ np.array(means)
    away = np.array(means) - mean
    spread = np.einsum("n,nij->ij", p, spreads) + np.einsum("n,ni,nj->ij", p, away, away)
    centre = p @ h
    return centre, np.sqrt(p @ (h - centre) ** 2), mean, np.sqrt(np.diag(spread))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (1, 2, 3, 4))])
def test_against_the_closed_form_and_the_grid(seed):
    rng = np.random.default_rng(seed)
    prior = Vector(VELOCITY + rng.normal(0, 60, 3), np.diag(rng.uniform(20, 120, 3) ** 2), unit="km/s")
    hubble, peculiar = (rng.uniform(60, 80), rng.uniform(4, 15)), rng.uniform(0, 900)
    field = galaxies(seed=seed, sigma=rng.uniform(3, 12), spread=peculiar)
    centre, width, mean, sigma = closed_form(field, prior, hubble, peculiar)
    found = sample(field, prior, hubble, n_samples=300_000, peculiar_dispersion=peculiar, **SETTINGS)
    on_grid = grid(field, prior, hubble, peculiar_dispersion=peculiar, flows=None)
    for h, s, v in (
        (found.samples["H0"].mean(), found.samples["H0"].std(), found.velocity),
        (on_grid.mean("H0"), on_grid.sigma("H0"), on_grid.velocity),
    ):
        assert abs(h - centre) < 0.02 * width
        assert s == pytest.approx(width, rel=0.02)
        assert np.abs((v.value - mean) / sigma).max() < 0.02
        np.testing.assert_allclose(v.sigma, sigma, rtol=0.02)
    # The acceleration drawn along is that of the least squares, where the priors leave it alone.
    least = observer_velocity(field, 67.3, peculiar_dispersion=peculiar, flows=None)
    assert found.acceleration.sigma.max() < 1.05 * least.acceleration.sigma.max()


@pytest.mark.slow
def test_ridge_with_flat_priors():
    """Flat in v, flat in H0 between limits: p(H0) ∝ H0⁻³ whatever the data, and u is as by least squares."""
    field = galaxies(sigma=3.0)
    found = sample(field, "flat", Flat(40, 100), n_samples=1_500_000, peculiar_dispersion=0.0, **SETTINGS)
    h = found.samples["H0"]
    quantiles = np.array([0.1, 0.3, 0.5, 0.7, 0.9])
    expected = (40**-2.0 - quantiles * (40**-2.0 - 100**-2.0)) ** -0.5
    np.testing.assert_allclose(np.quantile(h, quantiles), expected, rtol=0.015)
    assert h.min() >= 40
    assert h.max() <= 100
    least = observer_velocity(field, 67.3, peculiar_dispersion=0.0, flows=None).velocity
    u = np.stack([found.samples[f"v_{axis}"] * h / 67.3 for axis in "xyz"])
    assert np.abs((u.mean(1) - least.value) / least.sigma).max() < 0.02
    np.testing.assert_allclose(u.std(1), least.sigma, rtol=0.02)


@pytest.mark.slow
def test_chain_with_free_dispersion_against_the_grid():
    field = galaxies(sigma=2.0, spread=700.0)
    priors, settings = (CMB_VELOCITY_PLANCK18, Normal(67, 5)), {"peculiar_dispersion": Flat(100, 1500)}
    found = sample(field, *priors, n_samples=1_500_000, **settings, **SETTINGS)
    on_grid = grid(field, *priors, **settings, flows=None)
    for name in ("H0", "peculiar_dispersion"):
        x = found.samples[name]
        assert abs(x.mean() - on_grid.mean(name)) < 0.02 * on_grid.sigma(name)
        assert x.std() == pytest.approx(on_grid.sigma(name), rel=0.02)
    product = found.samples["H0"] * found.samples["peculiar_dispersion"]
    assert product.std() / product.mean() < 0.05  # the scatter tells the product well
    assert abs(product.mean() / (700 * 67.3) - 1) < 0.15


@pytest.mark.slow
def test_excess_noise_is_found():
    field = galaxies(sigma=3.0)
    quieter = field.with_errors(field.sigma / 2)  # 3 in truth, 1.5 as told: √(9 − 2.25) is missing
    on_grid = grid(
        quieter, CMB_VELOCITY_PLANCK18, Flat(20, 150), peculiar_dispersion=0.0, excess_noise=Flat(0, 20), flows=None
    )
    assert on_grid.mean("excess_noise") == pytest.approx(np.sqrt(6.75), abs=4 * on_grid.sigma("excess_noise"))
    assert on_grid.sigma("excess_noise") < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_table_is_the_likelihood(seed):
    """Interpolated against the full covariance, source by source, at random parameters."""
    rng = np.random.default_rng(seed)
    field = galaxies(60, seed=seed, sigma=4.0, spread=500.0)
    rows = DistanceModel(flows=None).equations(field)
    given = check_priors(Priors("flat", Flat(30, 120), Flat(0, 1500), Flat(0, 30)), "icrs")
    model = make_parallax_model(rows, given)
    theta = np.column_stack([rng.normal(0, 400, (40, 3)), rng.uniform(30, 120, 40), rng.uniform(0, 1500, 40),
                             rng.uniform(0, 30, 40)])  # fmt: skip
    found = model.log_probability(theta)
    expected = []
    for u1, u2, u3, h, pec, excess_noise in theta:
        variance = rows.variance + (pec * h / 67.3 * rows.rate) ** 2 + excess_noise**2
        design, y = rows.design[:, :6], rows.motion
        residual = y - design[:, :3] @ [u1, u2, u3]
        normal = design[:, 3:].T @ (design[:, 3:] / variance[:, None])
        b = design[:, 3:].T @ (residual / variance)
        log = -(residual @ (residual / variance) - b @ np.linalg.solve(normal, b)) / 2
        log -= np.log(variance).sum() / 2 + np.linalg.slogdet(normal)[1] / 2
        expected.append(log - 3 * np.log(h / 67.3))
    difference = found - expected
    depth = 1 + 0.01 * (max(expected) - np.array(expected))
    assert (np.abs(difference - difference[np.argmax(expected)]) / depth).max() < 1e-4


@pytest.mark.slow
def test_callable_prior_is_the_gaussian_it_computes():
    field = galaxies()
    turned = Vector(CMB_VELOCITY_PLANCK18.value, 1600 * np.eye(3), "galactic", "km/s").to_frame("icrs")

    def by_hand(v):
        return -np.sum((v - turned.value) ** 2, axis=1) / 3200

    hubble = Density(lambda h: -((h - 70) ** 2) / 50, 30, 110)
    one = sample(field, turned, Normal(70, 5), n_samples=150_000, **SETTINGS)
    two = sample(field, by_hand, hubble, n_samples=150_000, **SETTINGS)
    for name in ("H0", "v_x"):
        a, b = one.summary()[name], two.summary()[name]
        assert abs(a.mean - b.mean) < 0.05 * a.sigma
        assert a.sigma == pytest.approx(b.sigma, rel=0.05)
    with pytest.raises(ParameterError, match="must be Gaussian or flat"):
        grid(field, by_hand, hubble)


def test_spin_with_errors_is_a_prior():
    field = galaxies(500)
    options = {"peculiar_dispersion": 0.0, "flows": None}
    spins = [Vector([0, 0, 0], variance * np.eye(3)) for variance in (1e8, 1e-10, 0.0)]
    loose, tight, fixed, free, none = (
        grid(field, "flat", Normal(67.3, 1e-3), spin=spin, **options).velocity.value for spin in (*spins, "free", None)
    )
    np.testing.assert_allclose(loose, free, rtol=1e-4)
    np.testing.assert_allclose(tight, none, rtol=1e-4)
    np.testing.assert_allclose(fixed, none, rtol=1e-9)
    for spin, value in ((None, none), ("free", free)):
        least = observer_velocity(field, 67.3, spin=spin, **options).velocity.value
        np.testing.assert_allclose(value, least, rtol=1e-3)


@pytest.mark.parametrize(("n", "steps"), [(5000, 40), (256, 2)])  # of two steps, by walkers that never moved
def test_short_chain_reports_nothing_but_keeps_its_samples(n, steps):
    found = sample(galaxies(300), CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=n, max_samples=n, **SETTINGS)
    assert found.chain.shape == (steps, 128, 4)
    for report in (found.summary, found.report, found.to_arviz, found.corner, lambda: found.samples):
        with pytest.raises(ConvergenceError, match=rf"{steps} steps are .*; 50 times are needed.*Ask for \d+ samples"):
            report()


@pytest.mark.slow
def test_figures_and_tables():
    found = sample(galaxies(300), CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=100_000, **SETTINGS)
    text = found.report()
    assert "toward the apex" in text
    assert "H0" in text
    drawn = found.corner(truths={"H0": 70.0, "v_x": 100.0})
    assert found.corner(["v_x", "H0"]).shape == (2, 2)
    assert drawn.shape == (4, 4)  # H0 and the acceleration: of the velocity the data say no more than the prior
    # Nothing is cut: neither the truth nor all but the last samples.
    assert drawn[0, 0].get_xlim()[0] < 70 < drawn[0, 0].get_xlim()[1]
    drawn[0, 0].figure.canvas.draw()
    words = [axes.yaxis.label for axes in drawn[1:, 0]] + [axes.xaxis.label for axes in drawn[-1]]
    assert all(word.get_window_extent().x0 >= 0 and word.get_window_extent().y0 >= 0 for word in words)
    with pytest.raises(ParameterError, match="no quantity is called H1"):
        found.corner(["H1"])
    traces = found.trace()
    assert len(traces) == 4
    assert "R̂ = 1.0" in traces[0].get_title(loc="right")
    assert all(1 <= value < 1.1 for value in found.r_hat.values())
    steps = len(found.chain) - found.burn_in
    assert found.effective_size["H0"] == pytest.approx(steps * 128 / found.autocorrelation["H0"])
    assert set(found.samples) >= {"v_x", "v_y", "v_z", "H0", "speed", "a_x"}
    row = found.summary()["H0"]
    assert row.low95 < row.low68 < row.median < row.high68 < row.high95
    assert "128 walkers" in repr(found)
    assert set(found.autocorrelation) == {"v_x", "v_y", "v_z", "H0"}


def samples_of(**drawn):
    return Samples(samples=drawn, frame="galactic", notes=(), priors={}, seed=1)


@pytest.mark.slow
def test_axis_of_what_is_never_negative_begins_at_zero():
    rng = np.random.default_rng(1)
    weak = samples_of(H0=rng.exponential(30, 4000), v_x=rng.normal(0, 30, 4000))
    drawn = weak.plot()
    assert drawn[0, 0].get_xlim()[0] == 0
    assert drawn[1, 1].get_xlim()[0] < -90


@pytest.mark.slow
@pytest.mark.parametrize("ending", ["fits", pytest.param("ecsv", marks=pytest.mark.slow)])
def test_samples_travel(ending, tmp_path):
    found = sample(galaxies(300), CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=300_000, **SETTINGS)
    found.write(tmp_path / f"samples.{ending}")
    back = read_samples(tmp_path / f"samples.{ending}")
    assert set(back) == set(found.samples)
    for name, values in found.samples.items():
        np.testing.assert_array_equal(back[name], values)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_arviz():
    found = sample(galaxies(300), CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=100_000, **SETTINGS)
    data = found.to_arviz()
    posterior = data["posterior"]
    assert float(posterior["H0"].mean()) == pytest.approx(found.summary()["H0"].mean)
    assert posterior["v_x"].shape[0] == 128
    velocity = posterior["velocity"]
    assert velocity.dims == ("chain", "draw", "axis")
    for axis in "xyz":
        np.testing.assert_array_equal(velocity.sel(axis=axis), posterior[f"v_{axis}"])
    assert velocity.attrs == {"unit": "km/s", "frame": found.frame}
    assert posterior["H0"].attrs["unit"] == "km/s/Mpc"
    assert data["sample_stats"]["lp"].shape == posterior["H0"].shape
    kept = found.kept().to_arviz()["posterior"]  # of what a file keeps
    assert kept["velocity"].shape == (*posterior["H0"].shape, 3)
    np.testing.assert_array_equal(kept["H0"].values, posterior["H0"].values)


@pytest.mark.slow
def test_posterior_without_limits_says_so():
    field = galaxies(30, sigma=200.0)
    found = sample(field, CMB_VELOCITY_PLANCK18, "flat", n_samples=400_000, **SETTINGS)
    assert "next to H0 = 1000, a limit of the sampler" in found.report()


@pytest.mark.parametrize(
    ("options", "error", "words"),
    [
        ({"velocity_prior": "flat", "hubble_prior": "flat"}, ParameterError, "only the product v · H0"),
        ({"velocity_prior": "flat", "hubble_prior": Flat(1)}, ParameterError, "must be proper"),
        ({"velocity_prior": "cobe"}, ParameterError, "a velocity prior is 'planck', 'flat'"),
        ({"velocity_prior": BACHCHAN_2016}, ParameterError, "needs errors in all three"),
        ({"hubble_prior": "shoes"}, ParameterError, "no prior on H0 is called 'shoes'"),
        ({"hubble_prior": (70, -1)}, ParameterError, "σ > 0"),
        ({"hubble_prior": (70, 1, 2)}, ParameterError, "the prior on H0 must be Flat"),
        ({"hubble_prior": Flat(-5, 0)}, ParameterError, "leaves nothing above zero"),
        ({"peculiar_dispersion": -1}, ParameterError, "peculiar_dispersion cannot be -1"),
        ({"peculiar_dispersion": Flat(0)}, ParameterError, "needs an upper limit"),
        ({"outliers": Flat(0, 0.5)}, ParameterError, "no prior is called outliers"),
        ({"n_walkers": 6}, ParameterError, "6 walkers are too few"),
        ({"n_samples": 100}, ParameterError, "ask for at least 256"),
        ({"velocity_prior": lambda v: np.full(len(v), -np.inf)}, ParameterError, "zero wherever it was tried"),
        ({"spin": "none"}, ParameterError, "spin is None, 'free' or a Vector"),
        ({"spin": Vector([0, 0, 0], np.diag([1.0, 1, 0]))}, ParameterError, "needs errors in all three"),
    ],
)
def test_bad_input(options, error, words):
    with pytest.raises(error, match=words):
        sample(galaxies(50), **{"hubble_prior": Flat(20, 150)} | options)


def test_too_few_sources():
    with pytest.raises(DegeneracyError, match="2 sources cannot separate v_x"):
        sample(galaxies(2), "planck", "planck")
    with pytest.raises(ParameterError, match="fix all but two"):
        grid(galaxies(50), "planck", Flat(20, 90), peculiar_dispersion=Flat(0, 300), excess_noise=Flat(0, 9))
    with pytest.raises(ParameterError, match="limits that rise"):
        Flat(3, 3)


def calibrate(seed):
    """Ranks of the truth among 99 samples of its posterior, for one universe drawn from the priors."""
    rng = np.random.default_rng([seed, 9])
    prior = Vector(VELOCITY, 120.0**2 * np.eye(3), unit="km/s")
    velocity = prior.value + 120.0 * rng.normal(size=3)
    hubble, spread = rng.normal(70, 8), rng.uniform(200, 1200)
    field = galaxies(500, seed=10_000 + seed, sigma=3.0, velocity=velocity, spread=spread, hubble=hubble)
    found = sample(
        field, prior, Normal(70, 8), n_samples=350_000, peculiar_dispersion=Flat(200, 1200), threads=1,
        **SETTINGS | {"rng": seed},
    )  # fmt: skip
    named = found.samples
    chosen = rng.choice(len(named["H0"]), 99, replace=False)
    truths = {"v_x": velocity[0], "v_y": velocity[1], "v_z": velocity[2], "H0": hubble, "peculiar_dispersion": spread}
    return [int((named[name][chosen] < value).sum()) for name, value in truths.items()]


@pytest.mark.study
@pytest.mark.slow
def test_simulation_based_calibration():
    """Ranks in 300 posteriors are uniform: χ² over ten bins and Kolmogorov–Smirnov, each p > 0.001."""
    with ProcessPoolExecutor(4, mp_context=get_context("spawn")) as pool:
        ranks = np.array(list(pool.map(calibrate, range(300), chunksize=5)))
    for column in ranks.T:
        counts = np.bincount(column // 10, minlength=10)
        assert chi2.sf(np.sum((counts - 30) ** 2 / 30), 9) > 1e-3
        assert kstest((column + 0.5) / 100, "uniform").pvalue > 1e-3


def test_chain_that_is_too_short_goes_on():
    field = galaxies(300)
    found = sample(field, CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=6000, **SETTINGS)
    steps = len(found.chain)
    assert steps > 6000 / 128
    assert steps >= 50 * max(found.autocorrelation.values())
    again = sample(field, CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=6000, **SETTINGS)
    assert (again.chain == found.chain).all()


@pytest.mark.slow
def test_digits_are_those_that_the_sample_has():
    """15.31 was printed of a sample whose own exact line says 15.23, with a Monte Carlo error of 0.06."""
    found = sample(galaxies(300), CMB_VELOCITY_PLANCK18, Flat(20, 150), n_samples=200_000, **SETTINGS)
    text = found.report()
    assert "independent samples at least, R̂ 1.0" in text
    row = next(line for line in text.splitlines() if line.startswith("  H0   ")).split()
    digits = len(row[1].partition(".")[2])
    error = 1.25 * found.samples["H0"].std() / np.sqrt(found._compute_effective_sizes()["H0"])
    assert 0.1 * 10.0**-digits < error <= 10.0**-digits
    kept = found.kept()
    assert row in [line.split() for line in kept.report().splitlines()]
    assert kept._compute_effective_sizes() == found._compute_effective_sizes()


@pytest.mark.parametrize("velocity", ["flat", "flat-product"])
def test_conditional_is_the_integral_over_velocities(velocity):
    """ln of a Gaussian's integral over u is its density at the peak less half of ln det: for each H0, up to one constant."""
    field = galaxies(300)
    calibration = DistanceModel(peculiar_dispersion=300.0, flows=None).equations(field)
    model = make_parallax_model(calibration, check_priors(Priors(velocity, Flat(40, 120)), "icrs"))
    hubble = np.array([[45.0], [70.0], [110.0]])
    log, mean, _ = model.marginalise_velocity(hubble)
    ratio = hubble / model.likelihood.hubble
    coordinates = np.column_stack([mean * ratio if model.letter == "u" else mean, hubble])
    _, _, matrix = model.likelihood(model.compute_likelihood_arguments(hubble)[0])
    if model.letter == "v":
        matrix = matrix * ratio[:, :, None] ** 2
    by_hand = model.log_probability(coordinates) - np.linalg.slogdet(matrix)[1] / 2
    np.testing.assert_allclose(np.diff(log), np.diff(by_hand), atol=1e-9)


def test_samples_are_taken_by_name(tmp_path):
    rng = np.random.default_rng(1)
    drawn = {"H0": rng.exponential(30, 400), "v_x": rng.normal(0, 30, 400)}
    samples = samples_of(**drawn)
    assert samples["H0"] is drawn["H0"]
    assert len(samples) == 400
    assert samples.to_pandas()["v_x"].tolist() == drawn["v_x"].tolist()
    with pytest.raises(ParameterError, match="no quantity is called 'h0': there are H0, v_x"):
        samples["h0"]
    assert samples == replace(samples, samples={name: values.copy() for name, values in drawn.items()})
    assert samples != replace(samples, samples=drawn | {"H0": drawn["H0"] + 1})
    row = samples.summary()["H0"]
    assert (row.low95, row.high95) == tuple(np.percentile(drawn["H0"], [2.5, 97.5]))


def test_constant_without_an_end_has_no_upper_limit():
    """Samples that reach the end of an infinite prior were quoted as a limit of 95 %, at 952."""
    rng = np.random.default_rng(1)
    endless = samples_of(H0=rng.uniform(1, 1000, 4000))
    assert endless.hubble_limits[1] == np.inf
    assert 40 < endless.hubble_limits[0] < 60
    assert samples_of(H0=rng.exponential(50, 4000)).hubble_limits[1] < 200
    cut_off = samples_of(H0=1000 - rng.exponential(30, 4000))
    assert cut_off.hubble_limits == pytest.approx((910, np.inf), abs=5)


def test_limits_that_are_given_are_kept():
    given = check_priors(Priors("flat-product", Flat(1, 5000)), "icrs", DistanceModel())
    assert given.limits("H0") == (1, 5000)
    assert check_priors(Priors(), "icrs", DistanceModel()).limits("H0")[1] == 1000
