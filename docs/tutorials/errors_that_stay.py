"""
Errors that more sources do not remove
======================================

Formal errors fall as one over the root of the number of sources. If all sources share an error, a pattern left by the scanning law or by the attitude, the
true error does not follow: at some number it stays where it is, and quoted errors go on falling. This page shows it happen, and what to do.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from fit.background import Spectrum
from vsh.figures.plot import COLOURS, STYLE

# %%
# A pattern on the sky
# --------------------
#
# A random field of degrees 1 to 6, the same power in each mode: rms 3.2 µas/yr in every coefficient. Nobody sees it in a single source, whose
# error is thirty times as large.
PATTERN = 10 * Spectrum.flat()
numbers, skies = (1_000, 10_000, 100_000), 12


def squares(solution):
    """True and quoted: the mean square of the acceleration, which is all error, and of its errors."""
    found = solution.acceleration
    return np.mean(found.value**2), np.mean(found.sigma**2)


rows = []
for number in numbers:
    quasars, found = sim.quasars(number, rng=1), []
    for seed in range(skies):
        shared = sim.systematics(PATTERN, 100 + seed, lmax=6)
        normal = fit.normal_equations(sim.observe(quasars, shared, rng=200 + seed, sigma=100.0), 6)
        floor = fit.background.floor(normal)
        found.append([*squares(fit.solve(normal)), *squares(fit.solve(normal, floor=floor))])
    rows.append(np.sqrt(np.mean(found, axis=0)))
means = np.array(rows)

# %%
# The truth is no acceleration at all: what is found is the error. With 100 000 sources it is about three times what the plain fit quotes.
print("    sources   plain: true  quoted   with the floor: true  quoted   [µas/yr]")
for number, (true, quoted, kept, known) in zip(numbers, means, strict=True):
    print(f"{number:11d}{true:14.2f}{quoted:8.2f}{kept:23.2f}{known:8.2f}")

# %%
plt.rcParams.update(STYLE)
figure, axes = plt.subplots()
axes.loglog(numbers, means[:, 1], "--", color=COLOURS[1], label="plain fit, quoted")
axes.loglog(numbers, means[:, 0], "o", color=COLOURS[1], label="plain fit, true")
axes.loglog(numbers, means[:, 3], "-", color=COLOURS[0], label="with the floor, quoted")
axes.loglog(numbers, means[:, 2], "s", color=COLOURS[0], label="with the floor, true")
axes.set_xlabel("sources")
axes.set_ylabel("error of the acceleration  [µas/yr]")
axes.legend()

# %%
# How the floor is known
# ----------------------
#
# Degrees 2 to 6 hold no signal that anybody expects: what power they have above noise is the pattern's. If degree 1 has its share of it, as here, that
# is the floor. It is an assumption, and the report says so; where the pattern is known to be of another shape, say it: ``floor(normal, spectrum)``.
print(floor.report())
floor.plot()

# %%
# Two more witnesses
# ------------------
#
# *Blocks of the sky.* A jackknife over large blocks asks the scatter between regions, and sees the systematic errors within one.
#
# *The other kind.* A spin that nobody expects, as large as the acceleration's floor, says that the pattern is there: a rotating frame is
# adjusted away in real catalogues, so what is left is the adjustment's error.
#
# From a shell: ``vsh-fit catalogue.fits --lmax 6``. The formulas, and how well the floor is calibrated: :doc:`../backgrounds`.
