"""
A real catalogue
================

Spin and acceleration from a file of proper motions::

    python examples/real_catalogue.py vlba.ecsv

On this page it is a simulated twin of a VLBI catalogue, ``make_vlbi_twin.py``, whose true acceleration is 5.05 µas/yr towards
the Galactic centre. Where to find a real one:

*VLBA*: 713 radio sources with proper motions (Truebenbach & Darling 2017, ApJS 233, 3), from
VizieR with astroquery (``pip install astroquery``)::

    from astroquery.vizier import Vizier
    table = Vizier(columns=["**"], row_limit=-1).get_catalogs("J/ApJS/233/3")["J/ApJS/233/3/table6"]
    table.write("vlba.ecsv")

and name its columns in `Columns` below. *Gaia*: the 1.6 million quasars that made its
celestial frame, from its archive::

    from astroquery.gaia import Gaia
    job = Gaia.launch_job_async('''
        SELECT source_id, ra, dec, pmra, pmdec, pmra_error, pmdec_error, pmra_pmdec_corr,
               phot_g_mean_mag, redshift_qsoc
        FROM gaiadr3.gaia_source JOIN gaiadr3.qso_candidates USING (source_id)
        WHERE gaia_crf_source = 'true' ''')
    job.get_results().write("gaia_crf.fits")

whose names are the default.
"""

import sys
from pathlib import Path

import matplotlib.pyplot as plt

import fit
from vsh import Modes
from vsh.figures.plot import plot_field
from vsh.io.catalogue import Columns, read_field

if len(sys.argv) != 2:
    sys.exit("usage: python examples/real_catalogue.py PATH")

# %%
# Another survey is another value of `Columns`; units come from the table. Rows that cannot
# be used are counted and said.
field = read_field(sys.argv[1], columns=Columns(), on_bad="drop")

# %%
# Proper motions of real sources have heavy tails: leave out what lies farther from the fit
# than three times the median.
clipped = fit.robust.clip(field, Modes(1), kappa=3)
kept = field[clipped.kept]
print(clipped.solution.report(check=fit.cross_check(kept), source=Path(sys.argv[1]).name))

acceleration = clipped.solution.acceleration
lon, lat = acceleration.to_frame("galactic").direction
print(
    f"acceleration {acceleration.amplitude:.2f} ± {acceleration.amplitude_error:.2f} µas/yr toward l = {lon:.1f}°, b = {lat:.1f}°"
)

plot_field(kept, clipped.solution.coefficients, covariance=clipped.solution.covariance)
plt.savefig("real_catalogue.png", dpi=300)
