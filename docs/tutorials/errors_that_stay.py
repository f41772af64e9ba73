"""
Errors that more sources do not remove
======================================

Formal errors decrease as one over the square root of the number of sources. Systematic errors that are common to
neighbouring sources, such as a pattern caused by the scanning law or by the attitude of the satellite, do not: beyond
some number of sources the true error remains constant while the formal error continues to decrease. This tutorial
demonstrates the effect, and how to include it in the errors.
"""

import matplotlib.pyplot as plt
import numpy as np

import fit
import sim
from fit.background import Spectrum
from vsh.figures.plot import COLOURS, STYLE, set_log_ticks

# %%
# A pattern on the sky
# --------------------
#
# The systematic errors are a random field of degrees 1 to 6 with the same power in each mode: 3.2 µas/yr rms in every
# coefficient. They cannot be seen in a single source, whose error is thirty times as large.
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
# The true acceleration is zero, so the estimate is the error. With 100 000 sources it is about three times the error
# that the plain fit quotes.
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
axes.set_xlabel("number of sources")
axes.set_ylabel("error of the acceleration  [µas/yr]")
set_log_ticks(axes.yaxis, *axes.get_ylim())
axes.legend()

# %%
# How the floor is estimated
# --------------------------
#
# No signal is expected in degrees 2 to 6, so their power above that of noise is attributed to systematic errors. If
# degree 1 has systematic errors of the same spectrum, as here, this determines the floor. It is an assumption, which
# the report states. If another spectrum is known to be appropriate, pass it: ``floor(normal, spectrum)``.
print(floor.report())
floor.plot()

# %%
# Two other indications
# ---------------------
#
# *Blocks of the sky.* A jackknife over large blocks uses the scatter between regions, and is sensitive to systematic
# errors within a region.
#
# *The spin.* A significant spin that is not expected, of the size of the floor of the acceleration, indicates
# systematic errors: real catalogues are adjusted so that quasars do not rotate, and what remains is the error of the
# adjustment.
#
# From the command line: ``vsh-fit catalogue.fits --lmax 6``. Formulas and coverage: :doc:`../backgrounds`.
