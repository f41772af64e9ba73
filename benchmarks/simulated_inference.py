"""Inference from simulated skies in place of a likelihood.

`python benchmarks/simulated_inference.py speed`: skies of 100 000 quasars an hour on two cores, shared errors and traps in, beside a plain
fit of one.

`python benchmarks/simulated_inference.py quaia MAP [SKIES] [SOURCES]`: the acceleration from a sky with the density of MAP (the selection
function of Quaia, FITS) and the errors of DR3, by neural posteriors (sbi) of simulated skies whose errors and systematics are unknown: its
errors beside those of Nguyen & Murray (2026), and coverage over skies that were not trained on.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
import time

import numpy as np

import fit
import sim
from vsh import Coefficients, Modes
from vsh.basis import harmonics
from vsh.classes import Classes
from vsh.field import multiply_weights
from vsh.io.maps import read_map
from vsh.modes import as_modes
from vsh.tools.parallel import map_blocks

#: Errors of the acceleration by Nguyen & Murray (2026), abstract. [µas/yr]
PUBLISHED = np.array([0.70, 0.54, 0.575])


class SkyStatistics:
    """Coefficients and reduced χ² of each class of sources, of motions with the errors of a field."""

    def __init__(self, field, lmax=3, classes=None):
        self.modes, self.n_sources = as_modes(lmax), len(field)
        labelled = [("", np.ones(len(field), bool))] if classes is None else list(classes)
        self._parts = []
        names = []
        for label, mask in labelled:
            chosen = field[mask]
            basis = harmonics(chosen.lon, chosen.lat, self.modes)
            weighted = multiply_weights(chosen.weights, basis).reshape(len(self.modes), -1)
            inverse = fit.solve(fit.normal_equations(chosen, self.modes)).covariance
            self._parts.append((mask, weighted, inverse, chosen.weights))
            names += [f"{mode}{label and f' ({label})'}" for mode in self.modes]
            names.append(f"reduced χ²{label and f' ({label})'}")
        self.names = tuple(names)

    def __call__(self, motion):
        """Compute the statistics of motions, (2, n): coefficients [µas/yr] and reduced χ² of each class, (q,)."""
        values = []
        for mask, weighted, inverse, weights in self._parts:
            own = motion[:, mask]
            rhs = weighted @ own.ravel()
            coefficients = inverse @ rhs
            chi2 = np.sum(own * multiply_weights(weights, own)) - rhs @ coefficients
            values += [coefficients, np.array([chi2 / (own.size - len(rhs))])]
        return np.concatenate(values)


def simulate_skies(draw, statistics, n, rng, threads=None):
    """Parameters and statistics of n skies, each with a stream of its own."""
    streams = np.random.default_rng(rng).spawn(n)

    def simulate(block):
        skies = [draw(stream) for stream in streams[block]]
        return [(parameters, statistics(motion)) for parameters, motion in skies]

    rows = [row for block in map_blocks(simulate, n, 4, threads) for row in block]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


class Universe:
    """Skies of given sources: glide, spin, shared errors of an unknown power, errors that are wrong, stars."""

    def __init__(self, field, lmax=5, star_motion=3000.0):
        self.field, self.modes, self.star_motion = field, Modes(lmax), star_motion
        self.basis = harmonics(field.lon, field.lat, self.modes).reshape(len(self.modes), -1).astype(np.float32)
        # The same power in each kind of every degree: rms motion of one for one unit of floor in each.
        self.root = np.sqrt(4 * np.pi / (2 * self.modes.degrees + 1) / 2)
        self.names = ("g_x", "g_y", "g_z", "floor", "factor", "stars")

    def draw(self, rng):
        g, spin = rng.uniform(-10, 10, 3), rng.normal(0, 10, 3)
        floor, factor, stars = rng.uniform(0, 2), rng.uniform(0.9, 1.2), rng.uniform(0, 0.001)
        values = floor * self.root * rng.standard_normal(len(self.modes))
        motion = (values.astype(np.float32) @ self.basis).reshape(2, -1).astype(float)
        motion += (sim.acceleration(g) + sim.spin(spin))(self.field.lon, self.field.lat)
        motion += factor * self.field.sigma * rng.standard_normal(self.field.sigma.shape, dtype=np.float32)
        which = np.flatnonzero(rng.random(len(self.field)) < stars)
        motion[:, which] += self.star_motion * rng.standard_normal((2, len(which)))
        return np.r_[g, floor, factor, stars], motion


def _quasars(n, seed=1, selection=None):
    quasars = sim.quasars(n, seed) if selection is None else sim.quasars(n, seed, selection)
    field = sim.observe(quasars, sim.spin((0.0, 0.0, 0.0)), seed + 1, release="DR3")
    return field.with_errors(field.sigma)


def speed(n=100_000, skies=200):
    field = _quasars(n)
    universe = Universe(field)
    statistics = SkyStatistics(field, 5, Classes.by_edges("G", (18.0, 19.5), field.magnitude))
    start, cpu = time.perf_counter(), time.process_time()
    simulate_skies(universe.draw, statistics, skies, 1, threads=2)
    wall, cpu = (time.perf_counter() - start) / skies, (time.process_time() - cpu) / skies
    start = time.process_time()
    for _ in range(5):
        fit.fit_field(field, 5)
    print(
        f"{3600 / wall:.0f} skies of {n} quasars an hour, {cpu:.3f} CPU s each; a plain fit of one {(time.process_time() - start) / 5:.3f}"
    )


def _summaries(statistics, x):
    """The fitted glides, and what tells of their errors: the power of each kind and degree above 1, and χ²."""
    modes = statistics.modes
    to_glide = np.array([Coefficients(modes, unit).glide for unit in np.eye(len(modes))])
    coefficients = x[:, : len(modes)]
    powers = [
        np.sum(coefficients[:, modes.slice_of(kind, l)] ** 2, 1) for kind in "TS" for l in range(2, modes.lmax + 1)
    ]
    return coefficients @ to_glide, np.column_stack([*np.log(powers), np.log(x[:, len(modes) :])])


def quaia(selection, skies=4000, sources=200_000):
    import torch
    from sbi.inference import NPE
    from sbi.utils import BoxUniform

    torch.manual_seed(1)
    torch.set_num_threads(2)
    field = _quasars(int(sources), selection=np.clip(np.nan_to_num(read_map(selection)[0]), 0, None))
    # As many sources as Quaia has: the same information from fewer that are more exact, and stars that are as much slower.
    root = np.sqrt(int(sources) / 755_850)
    field = field.with_errors(field.sigma * root)
    universe = Universe(field, 3, 3000 * root)
    statistics = SkyStatistics(field, 3)
    start = time.perf_counter()
    theta, x = simulate_skies(universe.draw, statistics, int(skies), 1, threads=2)
    print(f"{skies} skies in {time.perf_counter() - start:.0f} s", flush=True)
    glide, summaries = _summaries(statistics, x)
    mean, scale = summaries.mean(0), summaries.std(0)
    # Flat in g: what is inferred is how far the truth is from the fitted glide, whose scale is that of the errors.
    prior = BoxUniform(torch.tensor([-10.0] * 3 + [0, 0.9, 0]), torch.tensor([10.0] * 3 + [2, 1.2, 0.001]))
    inference = NPE(prior=prior, density_estimator="maf")
    inference.append_simulations(
        torch.tensor(np.c_[theta[:, :3] - glide, theta[:, 3:]], dtype=torch.float32),
        torch.tensor((summaries - mean) / scale, dtype=torch.float32),
    )
    start = time.perf_counter()
    inference.train()
    posterior = inference.build_posterior()
    print(f"\ntrained in {time.perf_counter() - start:.0f} s", flush=True)
    true, seen = simulate_skies(universe.draw, statistics, 400, 2, threads=2)
    inside, below, errors = [], [], []
    for parameters, own_glide, values in zip(true, *_summaries(statistics, seen), strict=True):
        data = torch.tensor((values - mean) / scale, dtype=torch.float32)
        draws = own_glide + posterior.sample((500,), x=data, show_progress_bars=False).numpy()[:, :3]
        low, up = np.quantile(draws, [0.16, 0.84], axis=0)
        inside.append((low < parameters[:3]) & (parameters[:3] < up))
        below.append(np.mean(draws < parameters[:3], axis=0))
        errors.append(np.r_[draws.std(0), parameters[3]])
    errors = np.array(errors)
    print(
        "68 % of g_x, g_y, g_z hold",
        np.mean(inside, 0).round(3),
        "| 95 %",
        np.mean((np.array(below) > 0.025) & (np.array(below) < 0.975), 0).round(3),
    )
    for low, high in ((0, 0.5), (0.5, 1), (1, 1.5), (1.5, 2)):
        mine = (errors[:, 3] >= low) & (errors[:, 3] < high)
        print(
            f"floor {low} to {high} µas/yr: errors of g {np.median(errors[mine, :3], 0).round(2)}; published {PUBLISHED}"
        )


if __name__ == "__main__":
    {"speed": speed, "quaia": quaia}[sys.argv[1]](*sys.argv[2:])
