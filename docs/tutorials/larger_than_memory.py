"""
A catalogue larger than memory
==============================

Gaia's fourth release will have some two thousand million sources, in thousands of files. A fit needs none of them twice: normal equations of parts add
up to those of the whole. So a catalogue is gone through in parts, on as many cores or machines as there are, and what is sent from each is
some kilobytes.

Here a folder of four files stands for it. Nothing below would change with four thousand.
"""

from dataclasses import replace
from pathlib import Path
from tempfile import mkdtemp

import numpy as np

import fit
import sim
from vsh.io.catalogue import parts, read_field

folder = Path(mkdtemp())
truth = sim.spin((1.0, -2.0, 0.5)) + sim.acceleration((-0.277, -4.411, -2.443))
for k in range(4):
    part = sim.observe(sim.quasars(50_000, rng=k), truth, rng=[k, 1], release="DR4")
    replace(part, name=np.arange(50_000) + 50_000 * k).write(folder / f"part-{k}.fits")
print(*(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB" for path in sorted(folder.iterdir())), sep="\n")

# %%
# In parts
# --------
#
# ``parts`` reads nothing yet: it knows where the pieces are. What takes a field takes it, too.
sky = parts(folder, rows=20_000)
normal = fit.normal_equations(sky, 3)
solution = fit.solve(normal)
print(solution.report(check=fit.cross_check(sky), source="four files"))

# %%
# It is the fit to the whole catalogue, to the last digits that sums of floating-point numbers have:
whole = fit.fit_field(read_field(folder), 3)
print("largest difference, in errors:", np.abs((solution.values - whole.values) / whole.sigma).max())

# %%
# Choose, turn, clip
# ------------------
#
# Steps work block by block: a choice of sources, another frame. A median over the whole catalogue takes a few passes, and so does clipping.
bright = sky.map(lambda field: field[field.magnitude < 19.5]).to_frame("galactic")
print(f"{bright.sum(len)} of {sky.sum(len)} sources are brighter than G = 19.5")
print(fit.robust.clip(sky, 1, kappa=4).n_clipped, "sources are clipped")

# %%
# One pass for every degree
# -------------------------
#
# Before you know which degree you want: the moments of a catalogue serve every degree up to their own, and can be kept.
moments = fit.Moments.of(sky, 10)
moments.write(folder / "moments.ecsv")
for lmax in (1, 3, 10):
    found = fit.solve(moments.normal_equations(lmax)).acceleration
    print(f"degree {lmax:2d}: {found.value.round(2)} ± {found.sigma.round(2)}")
print(f"{(folder / 'moments.ecsv').stat().st_size / 1e6:.2f} MB keep what the catalogue says up to degree 10")
fit.solve(moments.normal_equations(10)).plot()

# %%
# A stream
# --------
#
# Where a file is too large even for its own folder, ``parts`` hands it out in blocks.
counts = [len(field) for field in parts(folder / "part-0.fits", rows=15_000)]
print(counts)

# %%
# More machines
# -------------
#
# ``parts(folder, workers=8)`` uses processes, ``parts(folder, scheduler="tcp://…")`` a cluster of Dask, and catalogues of LSDB are taken as they are.
# A part that fails is named; one whose machine dies is done again. From a shell: ``vsh-fit folder --lmax 3 --workers 8``. All of it:
# :doc:`../large_catalogues`.
