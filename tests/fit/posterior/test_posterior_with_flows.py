"""Posteriors with redshifts as they are and flows: ranks of the truth, and the parts they are made of."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many
from scipy.stats import kstest

import sim
from fit.posterior import Flat, Normal, grid, sample
from fit.secular_parallax import hubble_constant
from vsh import Field, Vector
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, to_cmb
from vsh.tools.errors import ParameterError, VshWarning

OURS = CMB_VELOCITY_PLANCK18.to_frame("icrs")
GLIDE = np.array([-0.236, -3.756, -2.080])


def seen(rng, n=150, velocity=OURS.value, hubble=67.3, amplitude=1.0, glide=GLIDE, excess=0.0, sigma=3.0):
    """Galaxies as they are seen, with flows of that size."""
    population = sim.galaxies(6 * n, rng, min_redshift=2e-4, max_redshift=0.05)
    flow = sim.peculiar(0.0, rng, flow="linear", n_modes=600, hubble=hubble).parts[0]
    random = sim.peculiar(150.0, rng, hubble=hubble)

    def scaled(lon, lat, z):
        return amplitude * flow(lon, lat, z)

    scaled.radial = lambda lon, lat, z: amplitude * flow.radial(lon, lat, z)
    signal = sim.secular_parallax(velocity, hubble=hubble) + sim.acceleration(glide) + random + scaled
    field = sim.observe(
        population, signal, rng, sigma=np.hypot(sigma, excess), redshifts="heliocentric", redshift_error=1e-4
    )
    z = to_cmb(field.redshift, field.lon, field.lat, "icrs", "heliocentric")
    field = field[np.flatnonzero((z > 0.003) & (z < 0.03))[:n]]
    return field.with_errors(np.full((2, len(field)), sigma))


def luminosity(magnitude):
    return -((magnitude + 18) ** 2) / 4.5


OPTIONS = {"flows": "linear", "n_modes": 120, "luminosity": luminosity, "progress": False}


def ranks(seed):
    """Where the truth stands among the samples, everything drawn from the priors."""
    rng = np.random.default_rng([77, seed])
    prior = Vector(OURS.value, 60.0**2 * np.eye(3), "icrs", "km/s")
    truth = {"H0": rng.normal(70, 12), "flow_amplitude": rng.normal(1, 0.15), "excess_noise": rng.uniform(0, 3)}
    velocity, glide = prior.value + 60 * rng.standard_normal(3), GLIDE + 0.5 * rng.standard_normal(3)
    field = seen(rng, 150, velocity, truth["H0"], truth["flow_amplitude"], glide, truth["excess_noise"])
    found = sample(
        field, prior, Normal(70, 12), n_samples=120_000, n_walkers=60, rng=seed, flow_amplitude=Normal(1, 0.15),
        excess_noise=Flat(0, 3), acceleration=Vector(GLIDE, 0.25 * np.eye(3)), **OPTIONS,
    )  # fmt: skip
    truth |= dict(zip(("v_x", "v_y", "v_z", "a_x", "a_y", "a_z"), [*velocity, *glide], strict=True))
    return {name: float(np.mean(found.samples[name] < value)) for name, value in truth.items()}


@pytest.mark.slow
@few_or_many(12, 300, "skies")
def test_ranks_of_the_truth_are_uniform(skies):
    found = [ranks(seed) for seed in range(skies)]
    for name in found[0]:
        assert kstest([each[name] for each in found], "uniform").pvalue > 1e-3, name


@pytest.mark.slow
def test_sample_and_a_grid_with_flows():
    field = seen(np.random.default_rng(1), 300)
    options = OPTIONS | {"acceleration": Vector(GLIDE, 0.04 * np.eye(3))}
    found = sample(field, "planck", Normal(70, 20, low=0), n_samples=200_000, rng=1, **options)
    options.pop("progress")
    on_grid = grid(field, "planck", Normal(70, 20, low=0), **options)
    assert found.samples["H0"].mean() == pytest.approx(on_grid.mean("H0"), abs=0.05 * on_grid.sigma("H0"))
    assert found.samples["H0"].std() == pytest.approx(on_grid.sigma("H0"), rel=0.05)
    # Without the prior on H0 it is the least squares: a Gaussian, flow and all.
    least = hubble_constant(field, "planck", **options)
    flat = grid(field, "planck", Flat(-0.0, 1000), **options)
    h = np.linspace(0.5, 1000, 20_000)
    weight = np.exp(-(((h - least.hubble) / least.hubble_error) ** 2) / 2)
    assert flat.mean("H0") == pytest.approx(h @ weight / weight.sum(), abs=0.05 * least.hubble_error)


@pytest.mark.slow
def test_amplitude_of_the_flow_is_a_ruler_only_where_it_is_asked_for():
    field = seen(np.random.default_rng(2), 400, sigma=0.3)
    options = {key: value for key, value in OPTIONS.items() if key != "progress"}
    off, on = (
        grid(field, "planck", Flat(1, 400), **options | extra) for extra in ({}, {"flow_amplitude": Normal(1, 0.05)})
    )
    assert on.sigma("H0") < 0.5 * off.sigma("H0")
    assert abs(on.mean("H0") - 67.3) < 4 * on.sigma("H0")
    assert on.mean("flow_amplitude") == pytest.approx(1, abs=0.2)


@pytest.mark.slow
def test_report_says_the_prior_and_shows_others_beside_it():
    field = seen(np.random.default_rng(3), 200)
    found = sample(field, "planck", "flat", n_samples=100_000, rng=1, **OPTIONS)
    text = found.report(long=True)
    for words in ("flat from 0 to inf", "119 modes of linear", "v · H0", "one-sided", "H0 under other priors"):
        assert words in text
    (others,) = [section for section in found.sections(long=True) if "other priors" in section.title]
    rows = {line[:17].strip(): line[17:].split() for line in str(replace(others, remarks=())).splitlines()[2:]}
    assert set(rows) == {"as given", "flat in H0", "flat in v H0", "flat in log H0"}
    assert rows["as given"] == rows["flat in H0"]
    assert float(rows["flat in log H0"][0]) < float(rows["flat in H0"][0]) < float(rows["flat in v H0"][0])
    low, middle, high = np.percentile(found.samples["H0"], [15.9, 50, 84.1])
    assert float(rows["as given"][0]) == pytest.approx(middle, abs=0.1 * (high - low))
    narrow = sample(field, "planck", Normal(70, 5), n_samples=120_000, rng=1, **OPTIONS).report(long=True)
    assert "twice as wide" in narrow
    assert "v · H0:" not in narrow


def test_flows_that_are_refused_or_requested():
    field = seen(np.random.default_rng(4), 100)
    with pytest.raises(ParameterError, match="needs a flow"):
        sample(field, flow_amplitude=Normal(1, 0.1), n_samples=1000, progress=False, flows=None)
    with pytest.raises(ParameterError, match="counts them twice"):
        sample(field, peculiar_dispersion=750.0, n_samples=1000, **OPTIONS)
    bare = Field(field.lon, field.lat, field.motion, field.sigma, redshift=np.abs(field.redshift))
    with pytest.warns(VshWarning, match="the frame of the redshifts is not given"):
        grid(bare, "planck", Flat(10, 200), n_points=20)


def test_local_group_says_the_same_as_in_least_squares():
    velocity = 10 * OURS.value  # H0 to a tenth, so that its distribution is nearly Gaussian
    field = seen(np.random.default_rng(5), 300, velocity, sigma=0.3)
    group = Vector(np.array([150.0, -300.0, 100.0]), 20.0**2 * np.eye(3), "icrs", "km/s")
    ours = Vector(velocity, 1e-6 * np.eye(3), "icrs", "km/s")
    found = {}
    for known in (None, group):
        least = hubble_constant(field, velocity, flows="linear", n_modes=120, local_group=known)
        given = {"flows": "linear", "n_modes": 120, "local_group": known}
        exact = grid(field, ours, Flat(5.0, 500.0), **given)
        found[known is None] = least.hubble
        assert exact.mean("H0") == pytest.approx(least.hubble, abs=0.1 * least.hubble_error)
        assert exact.sigma("H0") == pytest.approx(least.hubble_error, rel=0.1)
        drawn = sample(field, ours, Flat(5.0, 500.0), n_samples=20_000, rng=1, progress=False, **given)
        assert np.mean(drawn.samples["H0"]) == pytest.approx(exact.mean("H0"), abs=0.1 * exact.sigma("H0"))
        assert any("use the Local Group's motion" in note for note in drawn.notes) == (known is None)
    assert abs(found[True] - found[False]) > 1
    with pytest.raises(ParameterError, match="leave out local_group or flow_amplitude"):
        grid(field, ours, Flat(5.0, 500.0), flow_amplitude=Normal(1, 0.1), local_group=group)
