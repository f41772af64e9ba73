"""
What a calibrated basic angle leaves of a wave
==============================================

The attitude of Gaia and its basic angle are solved from the same observations as the sources, and absorb a part of every
motion that changes within the mission. How much is left for a search depends on how often the basic angle is calibrated, and
on its harmonics with the spin of the satellite. A limit on gravitational waves holds only for the calibration that was used.
"""

import matplotlib.pyplot as plt
import numpy as np

import sim
from fit import in_time
from sim import agis
from vsh import Modes
from vsh.basis import harmonics
from vsh.figures.plot import COLOURS, STYLE, figure_of
from vsh.io.epochs import make_design_rows

# %%
# The transits of a hundred sources in the 5.5 years of DR4.
law = sim.NominalScanningLaw(years=5.5)
rng = np.random.default_rng(1)
lon, lat = rng.uniform(0, 2 * np.pi, 100), np.arcsin(rng.uniform(-1, 1, 100))
transits = law.transits(lon, lat)
time, source = transits.time - law.years / 2, transits.source
design = make_design_rows(transits.angle, transits.parallax_factor, time)
own = [np.flatnonzero(source == k) for k in range(len(lon))]
modes = Modes(2)
along = np.einsum("pck,ck->pk", harmonics(lon[source], lat[source], modes), design[:2])

# %%
# A pattern of degree 2, the largest of a wave, that goes as cosine and sine of time: what is left of it along the scan when
# attitude, basic angle and the five parameters of every source are solved together.


def share_left(response, frequency):
    """Share (rms) of degree 2 at a frequency that is left."""
    functions = in_time.waves(frequency, span=(-law.years / 2, law.years / 2))
    where = lon[source], lat[source], design[:2], time, modes, functions
    left = response.left(*where, view=transits.view.astype(int))
    for mine in own:
        root = np.linalg.qr(design[:, mine].T)[0]
        left[mine] -= root @ (root.T @ left[mine])
    # The same without any attitude: every function of time times every mode along the scan.
    whole = np.einsum("fk,pk->kfp", functions(time), along).reshape(len(time), -1)
    two = np.tile(modes.degrees == 2, 2)
    return np.sqrt(np.sum(left[:, two] ** 2) / np.sum(whole[:, two] ** 2))


calibrations = (
    "none",
    "constant to order 8",
    "free every 90 days to order 2",
    "free every 5 days to order 1",
    "free every 5 days to order 1, known to 1 µas",
    "free every 5 days to order 2",
)
frequencies = np.array([0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.2, 6.8])
shares = {}
for words in calibrations:
    response = agis.Response(law, nside=4, steps=100_000, calibration=words)
    shares[words] = [share_left(response, f) for f in frequencies]
    print(f"{words:46} {np.median(shares[words]):.2f} (median)")

# %%
# Constant harmonics absorb next to nothing, except at 2 per year. Harmonics of order 1 that are free every five days leave
# two thirds of the pattern, those of order 2 a fifth. A prior of 1 µas does not help: the stars determine the harmonics ten
# times as well.
plt.rcParams.update(STYLE)
fig, ax = plt.subplots(figsize=(7, 4.2))
for marker, colour, (words, values) in zip("osD^v*", COLOURS, shares.items(), strict=True):
    # What lies on another line is seen beside it: open marks, and dashes.
    style = {"ls": "--", "mfc": "w"} if "known" in words or "constant" in words else {"ls": "-"}
    ax.plot(frequencies, values, marker=marker, color=colour, label=words, **style)
ax.set_ylim(0, 1)
ax.set_xlabel("frequency [1/yr]")
ax.set_ylabel("share of a wave's motions of degree 2 that is left (rms)")
fig.legend(title="variations of the basic angle that are solved for", ncols=2, loc="outside upper center")
figure_of(ax).savefig("calibrated_basic_angle.png")
