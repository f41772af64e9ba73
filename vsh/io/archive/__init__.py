"""Data from archives: releases as values, queries, and a client of the Table Access Protocol."""

from vsh.io.archive._tap import (
    ASTROMETRY,
    DR3,
    DR4,
    ESA,
    GAIA_CRF3,
    GAIA_DR3_GALAXIES,
    GAIA_EDR3_QSO,
    QUERIES,
    RELEASES,
    DataRelease,
    of_table,
    query,
)

__all__ = ["DR3", "DR4", "GAIA_CRF3", "GAIA_EDR3_QSO", "QUERIES", "DataRelease", "query"]
