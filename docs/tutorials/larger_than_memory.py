"""
A catalogue larger than memory
==============================

Gaia DR4 will have about two thousand million sources in thousands of files. A fit needs each of them only once,
because the normal equations of parts add up to those of the whole. A catalogue is therefore processed in parts, on
several cores or machines, each of which returns only some kilobytes.

This tutorial uses a folder of four files; nothing would change with four thousand.
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
# ``parts`` does not read anything yet; it lists the parts. Functions that accept a field accept parts as well.
sky = parts(folder, rows=20_000)
normal = fit.normal_equations(sky, 3)
solution = fit.solve(normal)
print(solution.report(check=fit.cross_check(sky), source="four files"))

# %%
# The result is that of a fit to the whole catalogue, to the rounding errors of floating-point sums:
whole = fit.fit_field(read_field(folder), 3)
print("largest difference in units of the error:", np.abs((solution.values - whole.values) / whole.sigma).max())

# %%
# Select, rotate, clip
# --------------------
#
# Operations such as a selection or a rotation to another frame are applied to each block. A median over the whole
# catalogue, which clipping needs, takes a few passes.
bright = sky.map(lambda field: field[field.magnitude < 19.5]).to_frame("galactic")
print(f"{bright.sum(len)} of {sky.sum(len)} sources are brighter than G = 19.5")
print(fit.robust.clip(sky, 1, kappa=4).n_clipped, "sources are clipped")

# %%
# One pass for every degree
# -------------------------
#
# If the maximum degree is not yet known, compute the moments of the catalogue: they serve for every degree up to
# their own, and can be saved.
moments = fit.Moments.of(sky, 10)
moments.write(folder / "moments.ecsv")
for lmax in (1, 3, 10):
    found = fit.solve(moments.normal_equations(lmax)).acceleration
    print(f"degree {lmax:2d}: {found.value.round(2)} ± {found.sigma.round(2)}")
print(f"{(folder / 'moments.ecsv').stat().st_size / 1e6:.2f} MB contain the moments of the catalogue to degree 10")
fit.solve(moments.normal_equations(10)).plot()

# %%
# A stream
# --------
#
# If a single file is too large, ``parts`` reads it in blocks.
counts = [len(field) for field in parts(folder / "part-0.fits", rows=15_000)]
print(counts)

# %%
# More machines
# -------------
#
# ``parts(folder, workers=8)`` uses processes, ``parts(folder, scheduler="tcp://…")`` a Dask cluster; catalogues of
# LSDB are accepted as well. An error names the part that failed; if a machine fails, its part is computed again. From
# the command line: ``vsh-fit folder --lmax 3 --workers 8``. Details: :doc:`../large_catalogues`.
