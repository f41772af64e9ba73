"""
Skies in place of a likelihood
==============================

Where errors are wrong by an unknown factor, the likelihood of the motions is not known, but skies can be drawn. Each is
kept as the coefficients and the reduced χ² of a plain fit; here the parameters follow from these by a regression, and
in `the recipe for sbi <../../further.html#sbi>`_ by a network.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from vsh.figures.plot import COLOURS, STYLE

plt.rcParams.update(STYLE)

# %%
# The catalogue: 3000 quasars, a glide of (4, -3, 2) µas/yr, and errors that are 1.3 times as large as they say.
TRUTH, FACTOR = np.array([4.0, -3.0, 2.0]), 1.3
quasars = sim.quasars(3000, 1)
field = sim.observe(quasars, sim.acceleration(TRUTH), 2, sigma=60.0)
field = field.with_errors(field.sigma / FACTOR)


def statistics(motion):
    """What is kept of a sky."""
    solution = fit.fit_field(field.minus(field.motion - motion), 1)
    return np.r_[solution.values, np.sqrt(solution.reduced_chi2)]


def draw(rng):
    """Parameters from their prior, and the statistics of a sky with them."""
    glide, factor = rng.uniform(-10, 10, 3), rng.uniform(0.8, 1.8)
    noise = factor * field.sigma * rng.standard_normal(field.sigma.shape)
    return np.r_[glide, factor], statistics(sim.acceleration(glide)(field.lon, field.lat) + noise)


# %%
# A thousand skies; the parameters by the statistics, and the scatter of what the regression leaves.
skies = [draw(rng) for rng in np.random.default_rng(3).spawn(1000)]
parameters, values = (np.array(column) for column in zip(*skies, strict=True))
rows = np.column_stack([values, np.ones(len(values))])
weights, *_ = np.linalg.lstsq(rows, parameters, rcond=None)
residual = parameters - rows @ weights
estimate = np.r_[statistics(field.motion), 1.0] @ weights
for name, value, error, true in zip(
    ("g_x", "g_y", "g_z", "factor"), estimate, residual.std(0), [*TRUTH, FACTOR], strict=True
):
    print(f"{name:8}{value:7.2f} ± {error:.2f}   truth {true:.2f}")

# %%
# The noise of the skies that were drawn has the factors of the prior: errors are those of the average sky.
figure, axes = plt.subplots(2, 2, figsize=(5, 4), layout="constrained")
names = ("glide x  [µas/yr]", "glide y  [µas/yr]", "glide z  [µas/yr]", "error factor")
for ax, name, column, off in zip(axes.flat, names, residual.T, estimate - [*TRUTH, FACTOR], strict=True):
    ax.hist(column, 30, color="0.75", label="skies that were drawn")
    ax.axvline(0, color="0.2", lw=0.8)
    ax.axvline(-off, color=COLOURS[1], ls="--", label="the catalogue")
    ax.set(xlabel=f"truth − estimate: {name}", ylabel="skies")
figure.legend(*axes[0, 0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
figure.savefig("skies_in_place_of_a_likelihood.png", dpi=150)
