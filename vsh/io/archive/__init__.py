"""Data from archives: releases as values, queries, epochs by DataLink, and a client of the Table Access Protocol."""

from vsh.io.archive._queries import (
    ASTROMETRY,
    DATA_SERVER,
    DR3,
    DR4,
    GAIA_CRF3,
    GAIA_DR3_GALAXIES,
    GAIA_EDR3_QSO,
    QUERIES,
    RELEASES,
    UPLOADED,
    DataRelease,
    SchemaCheck,
    check_schema,
    fetch_epochs,
    of_positions,
    of_table,
    read_ids,
    upload_of,
)
from vsh.io.archive._tap import ESA, query

__all__ = [
    "DR3",
    "DR4",
    "GAIA_CRF3",
    "GAIA_EDR3_QSO",
    "QUERIES",
    "DataRelease",
    "check_schema",
    "fetch_epochs",
    "query",
]
