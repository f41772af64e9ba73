"""
Errors that more sources do not remove
======================================

A catalogue whose errors share a pattern over the sky quotes errors that fall with the number of its sources, while the
true ones stay. The power of the higher degrees tells of the pattern: a prior on them, with its power estimated from the
same sky, and the floor that it implies for spin and acceleration, bring quoted and true errors together.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from fit.background import Spectrum, floor
from vsh import Modes
from vsh.figures.plot import COLOURS, STYLE, set_log_ticks

# %%
# One sky: the normal equations of 20 000 quasars; with more of them only their information grows.
rng = np.random.default_rng(1)
quasars = sim.quasars(20_000, rng=1, sky="plane-avoiding", max_magnitude=20.5)
one = fit.normal_equations(sim.observe(quasars, sim.spin((0, 0, 0)), rng=2, release="DR3"), 8)
pattern = np.exp(-np.maximum(np.arange(12) - 6, 0) / 3) * (
    2 * np.arange(12) + 3
)  # to degree 7 one power a mode, then less
systematics = Spectrum.given(20 * pattern).only("odd") + Spectrum.given(5 * pattern).only("even")
sigma = np.sqrt(systematics.variances(Modes(8)))


def sky(normal, root):
    """The normal equations of such systematics and of noise: b = N c + N^½ e, to degree 6."""
    c, e = sigma * rng.standard_normal(len(sigma)), rng.standard_normal(len(sigma))
    chi2 = c @ normal.matrix @ c + 2 * c @ root @ e + e @ e + rng.chisquare(normal.n_data - len(e))
    low = normal.modes.degrees <= 6
    return replace(
        normal,
        modes=Modes(6),
        matrix=normal.matrix[np.ix_(low, low)],
        rhs=(normal.matrix @ c + root @ e)[low],
        chi2_null=chi2,
    )


# %%
# 8 skies for each number of sources, fitted to degree 6 with and without the floor.
numbers, rows = np.geomspace(2e4, 2e7, 5), []
for number in numbers:
    more = number / 20_000
    normal = replace(one, matrix=more * one.matrix, n_data=int(more * one.n_data))
    found, root = [], np.linalg.cholesky(normal.matrix)
    for _ in range(8):
        seen = sky(normal, root)
        for solution in (fit.solve(seen), fit.solve(seen, floor=floor(seen))):
            found.append([np.mean(solution.acceleration.value**2), np.mean(solution.acceleration.sigma**2)])
    rows.append(np.sqrt(np.reshape(found, (8, 4)).mean(0)))
plain_true, plain_quoted, true, quoted = np.transpose(rows)
print("    sources   plain: true quoted   with the floor: true quoted   [µas/yr]")
for number, values in zip(numbers, rows, strict=True):
    print(f"{number:11.0f}{values[0]:14.2f}{values[1]:7.2f}{values[2]:24.2f}{values[3]:7.2f}")

# %%
# The figure: what a plain fit quotes falls as 1/√N, and the truth does not.
plt.rcParams.update(STYLE)
figure, axes = plt.subplots()
axes.loglog(numbers, plain_quoted, "--", color=COLOURS[1], label="plain fit, quoted")
axes.loglog(numbers, plain_true, "o", color=COLOURS[1], label="plain fit, true")
axes.loglog(numbers, quoted, "-", color=COLOURS[0], label="prior and floor, quoted")
axes.loglog(numbers, true, "s", color=COLOURS[0], markerfacecolor="none", label="prior and floor, true")
axes.set_xlabel("number of sources")
axes.set_ylabel("error of the acceleration  [µas/yr]")
set_log_ticks(axes.yaxis, *axes.get_ylim())
axes.legend()
plt.savefig("shared_errors.png", dpi=300)
