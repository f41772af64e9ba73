"""Data from archives: releases as values, queries, epochs by DataLink, and a client of the Table Access Protocol."""

from vsh.io.archive._epochs import DATA_SERVER, fetch_epochs, sources_without_epochs
from vsh.io.archive._queries import (
    ASTROMETRY,
    DR3,
    DR4,
    GAIA_CRF3,
    GAIA_DR3_GALAXIES,
    GAIA_EDR3_QSO,
    NEIGHBOURS,
    QUERIES,
    RELEASES,
    UPLOADED,
    DataRelease,
    make_upload,
    of_table,
    query_near_positions,
    read_ids,
)
from vsh.io.archive._schema import SchemaCheck, check_schema
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
