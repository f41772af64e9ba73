"""Sources: where they are, how bright, how far."""

from sim.population._clustered import clustered_galaxies
from sim.population._draws import (
    CRF3_COUNTS,
    SIX_PARAMETERS,
    crf3_magnitudes,
    plane_avoiding_sky,
    quasar_magnitudes,
    quasar_redshifts,
    uniform_sky,
)
from sim.population._makers import STAR_COUNTS, galaxies, quasars, stars, vlbi_quasars
from sim.population._population import Population, from_table

__all__ = [
    "Population",
    "clustered_galaxies",
    "crf3_magnitudes",
    "from_table",
    "galaxies",
    "plane_avoiding_sky",
    "quasar_magnitudes",
    "quasar_redshifts",
    "quasars",
    "stars",
    "uniform_sky",
    "vlbi_quasars",
]
