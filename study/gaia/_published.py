"""The numbers of Gaia Collaboration, Klioner et al. (2021, A&A 649, A9), typed from its abstract, text and table 1."""

from __future__ import annotations

#: The acceleration by five-parameter solutions, clipped at κ = 3: components in ICRS, and their errors. [µas/yr]
COMPONENTS, ERRORS = (-0.07, -4.30, -2.64), (0.41, 0.35, 0.36)
#: The same as amplitude [µas/yr] and direction [deg], each with its error.
AMPLITUDE, RA, DEC = (5.05, 0.35), (269.1, 5.4), (-31.6, 4.1)
#: The degree of that fit.
LMAX = 3
#: Five-parameter sources up to each magnitude, all of them, and about how many the clipping leaves out.
COUNTS = {18.0: 29_200, 19.0: 175_814, 20.0: 665_975, 21.0: 1_215_942}
SOURCES, CLIPPED = 1_215_942, 3800
