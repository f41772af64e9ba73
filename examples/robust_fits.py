"""
When some errors are wrong
==========================

Real proper motions have heavy tails, and least squares believes every error bar. This
script fits spin and acceleration to one catalogue in five ways and sets the accelerations
side by side::

    python examples/robust_fits.py vlba.ecsv

On this page the catalogue is a simulated twin of one of VLBI, ``make_vlbi_twin.py``: 713 sources, whose structure moves them by more than
their errors say, and an acceleration of 5.05 µas/yr towards the Galactic centre. Plain least squares is off by many of its errors.

On the VLBA proper motions of Truebenbach & Darling (2017), who published 1.69 ± 0.27 µas/yr
toward α = 275.2 ± 10.0°, δ = −29.4 ± 8.8°, plain least squares claims an error half as
large as the scatter bears. The two robust likelihoods keep every source and weigh it by
what its residual says.
"""

import sys

import matplotlib.pyplot as plt
import numpy as np

import fit
from vsh import Modes
from vsh.figures.plot import COLOURS, STYLE
from vsh.io.catalogue import read_field

if len(sys.argv) != 2:
    sys.exit("usage: python examples/robust_fits.py PATH")

field, modes = read_field(sys.argv[1], on_bad="drop"), Modes(1)

# %%
# The ways. The jackknife leaves out one part of the sky after the other; it asks nothing of
# the error bars, but the fit it repeats still believes them, so it runs on what a clip left.
clipped = fit.robust.clip(field, modes, kappa=3)
kept = field[clipped.kept]
ways = {
    "least squares": fit.fit_field(field, 1),
    "clip at 3 medians": clipped.solution,
    "the same, jackknife": fit.resample.jackknife(kept, modes, nside=4).resampled_solution,
    "Student-t": fit.robust.student_t(field, modes).solution,
    "excess noise, clipped": fit.robust.excess_noise(kept, modes).solution,
}

# %%
# Side by side, with the angle to the Galactic centre.
print(f"{'':22}{'ã [µas/yr]':>15}{'α':>16}{'δ':>16}{'from l = b = 0':>16}")
for name, solution in ways.items():
    a = solution.acceleration
    (lon, lat), (lon_error, lat_error) = a.direction, a.direction_error
    away = np.degrees(np.arccos(a.to_frame("galactic").value[0] / a.amplitude))
    print(
        f"{name:22}{a.amplitude:8.2f} ± {a.amplitude_error:.2f}{lon:9.1f} ± {lon_error:4.1f}°"
        f"{lat:+9.1f} ± {lat_error:4.1f}°{away:15.1f}°"
    )

# %%
# The components, with the truth of the simulated twin.
plt.rcParams.update(STYLE)
figure, axes = plt.subplots(figsize=(3.54, 3.0))
for i, ((name, solution), colour) in enumerate(zip(ways.items(), COLOURS)):
    a = solution.acceleration.to_frame("galactic")
    axes.errorbar(np.arange(3) + (i - 2) * 0.13, a.value, a.sigma, fmt="os^Dv"[i], color=colour, label=name)
if "twin" in sys.argv[1]:
    axes.hlines([5.05, 0, 0], np.arange(3) - 0.4, np.arange(3) + 0.4, color="0.3", linestyle="--", label="truth")
axes.axhline(0, color="0.6", linewidth=0.8)
axes.set_xticks(range(3), ["towards the\nGalactic centre", "along Galactic\nrotation", "to the Galactic\nnorth pole"])
axes.set_ylabel("acceleration ã  [µas/yr]")
axes.legend(ncols=2, loc="lower center", bbox_to_anchor=(0.5, 1.0))
plt.savefig("robust_fits.png", dpi=300)
