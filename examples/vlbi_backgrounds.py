"""
What a VLBI catalogue says of floors, waves and degrees
=======================================================

Three questions about one table of proper motions::

    python examples/vlbi_backgrounds.py vlba.ecsv

On this page the table is a simulated twin of a real one, ``make_vlbi_twin.py``: it has neither a floor nor waves, and its limits say so.

713 radio sources with proper motions from VLBA observations (Truebenbach & Darling 2017, ApJS 233, 3) are at VizieR,
J/ApJS/233/3; `real_catalogue.py` tells how to get them. With them, the floor of the acceleration is some 0.4 µas/yr in each
component, h70² Ω of gravitational waves below 0.036 (95 %, flat in Ω; 0.023 where every coefficient is equally likely
beforehand, as Jaraba et al. 2023 have it: 0.024), and degree 3 is wanted.
"""

import sys
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.special import logsumexp

import fit
from fit.background import Spectrum, floor, wave_limit
from vsh.io.catalogue import read_field

if len(sys.argv) != 2:
    sys.exit("usage: python examples/vlbi_backgrounds.py PATH")

# %%
# Errors that sources share: the power of degrees 2 and 3, after a fit that does not trust every source, and what it implies
# for degree 1.
field = read_field(sys.argv[1], on_bad="drop")
robust = fit.robust.student_t(field, 3)
shared = floor(robust)
print(shared.report())

# %%
# Put into the errors of the fit:
solution = fit.solve(fit.background.equations_of(robust), floor=shared)
print(solution.report(source=Path(sys.argv[1]).name))

# %%
# Gravitational waves longer than the observations move sources in degree 2. The scale of the errors is marginalised; the
# three limits differ by what they take for equally likely.
limit = wave_limit(fit.normal_equations(field, 2))
print(replace(limit, years=22.6).report())
limit.plot()
plt.savefig("vlbi_waves.png", dpi=300)

# %%
# Which degree does the catalogue want? With coefficients c ~ N(0, D) and K = I + D^½ N D^½, z = D^½ b, the evidence relative to
# that of no coefficients is ln Z = ½ zᵀ K⁻¹ z − ½ ln|K|. It depends on the power that is expected a priori, so it is
# marginalised between 1 and 1000 (µas/yr)² in each kind and degree, evenly in its logarithm.
kept = field[fit.clip(field, 2, kappa=2).kept]
normal = fit.normal_equations(kept, 4)
variances = Spectrum.power_law(0).variances(normal.modes)


def log_evidence(lmax):
    """ln Z of coefficients to a degree, the others zero, over the powers."""
    keep = normal.modes.degrees <= lmax
    found = []
    for power in np.geomspace(1, 1000, 61):
        root = np.sqrt(power * variances[keep])
        matrix = np.eye(keep.sum()) + root[:, None] * normal.matrix[np.ix_(keep, keep)] * root
        z = root * normal.rhs[keep]
        found.append((z @ np.linalg.solve(matrix, z) - np.linalg.slogdet(matrix)[1]) / 2)
    return logsumexp(found) - np.log(len(found))


evidences = np.array([log_evidence(lmax) for lmax in (1, 2, 3, 4)])
for lmax, (each, chance) in enumerate(zip(evidences, np.exp(evidences - logsumexp(evidences)), strict=True), 1):
    print(f"to degree {lmax}: ln Z = {each:.3f}, probability {chance:.3f}")
