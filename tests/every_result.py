"""A result of every kind, by name and made when it is asked for; what a kind of result must do is tested on each.

`RESULTS` is the one list: where a kind goes or comes, it changes here alone (`test_every_kind_of_result_is_tried`).
"""

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from conftest import random_field

import fit
import sim
from fit import in_time
from fit.correlation import correlation_matrices, leakage, predict_covariance
from fit.posterior import grid, sample
from fit.redshift import binned
from fit.secular_parallax import hubble_constant, observer_velocity
from vsh import Field, ScalarField, Vector
from vsh.io.epochs import read_observations
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

field = random_field(200, 1)
galaxies = sim.observe(sim.galaxies(200, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
binning = galaxies.add_note("a note: ã in µas/yr")
scalars = ScalarField(field.lon, field.lat, field.motion[0], field.sigma[0], "µas")
spin = Vector([0.1, 0.2, 0.3], 0.01 * np.eye(3))


def two_catalogues(field):
    """The same sources twice, three of them far off in the second."""
    noise = field.sigma * np.random.default_rng(3).normal(size=(2, len(field)))
    off = np.where(np.arange(len(field)) < 3, 1e5, 0.0)
    named = {"sigma": field.sigma, "rho": field.rho, "name": np.arange(len(field))}
    return Field(field.lon, field.lat, field.motion, **named), Field(field.lon, field.lat, noise + off, **named)


def epochs():
    law = sim.NominalScanningLaw(years=2.0)
    table = sim.epochs(sim.quasars(40, 1), sim.spin((0, 0, 0)), 1, mission=law)
    return read_observations(table).by_transit()


def in_time_equations():
    return in_time.normal_equations(epochs(), 2, in_time.waves(2.0, 3.0, span=(-2.8, -0.7)), attitude="known")


def cross_of(field):
    template = fit.background.Template.density("density", field, 4)
    normal = fit.normal_equations(field, 3, templates=[template])
    return fit.background.cross_powers(fit.solve(normal), normal.templates)


def clusters(field):
    """Sources of a field at measured distances."""
    distance = np.random.default_rng(1).uniform(1e-3, 1e-2, len(field))
    return replace(field, distance=distance, distance_error=0.1 * distance)


RESULTS: dict[str, Callable[[], Any]] = {
    "solution": lambda: fit.fit_field(field.add_note("left out µ"), 3),
    "clipped": lambda: fit.robust.clip(field, fit.fit_field(field, 2).modes).solution,
    "cross": lambda: cross_of(field),
    "shared": lambda: fit.background.shared([fit.normal_equations(field[k::2], 3) for k in range(2)], draws=60),
    "kinematics": lambda: fit.kinematics(clusters(field)),
    "prediction": lambda: predict_covariance(field, 2),
    "frame": lambda: fit.solve_frame(field, random_field(50, 2)),
    "velocity": lambda: observer_velocity(galaxies, 67.3, spin=spin),
    "velocity and spin": lambda: observer_velocity(galaxies, 67.3, spin="free"),
    "hubble": lambda: hubble_constant(galaxies, CMB_VELOCITY_PLANCK18),
    "forecast": lambda: fit.secular_parallax.forecast_velocity({"one": galaxies}, (0.03,), n_modes=9),
    "velocity and flow": lambda: observer_velocity(galaxies, 67.3, flows="linear", n_modes=30),
    "flow": lambda: observer_velocity(galaxies, 67.3, flows="linear", n_modes=30).flow,
    "velocity to come": lambda: fit.secular_parallax.predict_errors(galaxies)[0],
    "hubble to come": lambda: fit.secular_parallax.predict_errors(galaxies)[1],
    "bins": lambda: binned(binning, 2, 2),
    "with a floor": lambda: fit.solve(
        fit.normal_equations(field, 3), floor=fit.background.floor(fit.normal_equations(field, 3))
    ),
    "scalars": lambda: fit.fit_field(ScalarField(field.lon, field.lat, field.motion[0], field.sigma[0], "mag"), 2),
    "pairs": lambda: fit.pairs.correlation_function(field, np.radians([0, 40, 80, 120, 180]), nside=1),
    "templates": lambda: fit.pairs.correlation_function(field, np.radians([0, 40, 80, 120, 180]), nside=1).fit(),
    "shear": lambda: fit.shear.expansion(fit.fit_field(field, 2)),
    "shears": lambda: fit.shear.compare_expansions([fit.normal_equations(field, 4)] * 2, labels=["a", "b"], draws=100),
    "orbit": lambda: fit.galaxy.orbit(Vector([5.0, 0.1, 0.2], 0.1 * np.eye(3), "galactic")),
    "frames": lambda: fit.compare.compare_catalogues(*two_catalogues(field), 1, labels=("one", "two"))[0],
    "chain": lambda: fit.chain.combine_frames(dict(zip("ab", two_catalogues(field), strict=True)), 1),
    "in time": lambda: in_time.solve(in_time_equations()),
    "link": lambda: fit.link.link(sim.link(1, 12), excess=False),
    "steps": lambda: fit.link.find_step(sim.link(1, 24), [9.0, 13.0], excess=False, robust=False),
    "plan": lambda: fit.link.forecast(fit.link.link(sim.link(1, 12), robust=False), sim.link(2, 3)),
    "waves by frequency": lambda: fit.waves.search_in_time(
        epochs(), [1.5, 2.0], attitude="known", lmax=2, nside=2, n_skies=5
    ),
    "one wave": lambda: fit.waves.search(fit.fit_field(field, 2), nside=2, n_skies=5),
    "recommended": lambda: fit.recommended(field, 3),
    "estimate": lambda: fit.estimate(field, 3, "student"),
    "floor": lambda: fit.background.floor(fit.normal_equations(field, 3)),
    "floor of a scalar field": lambda: fit.recommended(scalars).floor,
    "waves": lambda: fit.background.wave_limit(fit.normal_equations(field, 2)),
    "common": lambda: binned(binning, 2, 2, shared_higher_degrees=True),
    "correlations": lambda: correlation_matrices({"one": field, "two": random_field(300, 3)}, 2),
    "leakage": lambda: leakage(field, 1, 3),
    "clipping": lambda: fit.robust.clip(field, 1),
    "reweighting": lambda: fit.robust.student_t(field, 1),
    "excess noise": lambda: fit.robust.excess_noise(field, 1),
    "cross-check": lambda: fit.cross_check(field),
    "trend": lambda: binned(binning, 1, 3).trend(),
    "bootstrap": lambda: fit.resample.bootstrap(field, 1, 12, 1, progress=False),
    "moments": lambda: fit.Moments.of(field, 2),
    "grid": lambda: grid(galaxies, CMB_VELOCITY_PLANCK18, n_points=12),
    "samples": lambda: sample(
        galaxies, CMB_VELOCITY_PLANCK18, n_samples=20_000, rng=1, n_walkers=20, progress=False
    ).kept(),
}


@cache
def result_of(name: str) -> Any:
    """One of them, made once in a process."""
    return RESULTS[name]()
