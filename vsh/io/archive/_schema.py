"""What an archive has now beside what our queries ask for: tables and columns, by TAP_SCHEMA."""

import csv
import io
import re
import time
from dataclasses import dataclass
from difflib import get_close_matches

from vsh.io import tables
from vsh.io.archive._queries import ASTROMETRY, DR4, QUERIES, RELEASES, of_table
from vsh.io.archive._tap import ESA, _open, _some
from vsh.tools.errors import ArchiveError
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import printable
from vsh.tools.types import Table

#: An answer that is larger is no list of columns. [bytes]
_MOST = 2**26
_NAME = re.compile(r"[A-Za-z_]\w*")
_TABLES = re.compile(r"\b(?:FROM|JOIN)\s+([A-Za-z_]\w*(?:\.\w+)+)(?:\s+AS\s+(\w+))?", re.IGNORECASE)
_COLUMNS = re.compile(r"\b([A-Za-z])\.([A-Za-z_]\w*)")


@dataclass(frozen=True)
class SchemaCheck(InNotebook):
    """Which of our queries run in a schema, and which names are not there.

    Attributes
    ----------
    schema : str
    n_tables, n_columns : int
        How many the schema has.
    missing : dict of str to tuple
        For each query the names that it asks for and the schema lacks, each with the nearest that it has, or None.
    """

    schema: str
    n_tables: int
    n_columns: int
    missing: dict[str, tuple[tuple[str, str | None], ...]]

    def report(self) -> str:
        """The queries as text, a line each, and below those that do not run the names that changed."""
        lines = [f"{self.schema}: {self.n_tables} tables, {self.n_columns} columns"]
        for name, absent in self.missing.items():
            lines.append(f"{name}: {'does not run' if absent else 'runs'}")
            lines += [f"  no {each}{f'; nearest: {near}' if near else ''}" for each, near in absent]
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """A row for each name that is missing, as an astropy Table."""
        rows = [(query, name, near or "") for query, absent in self.missing.items() for name, near in absent]
        columns = {head: [str(row[k]) for row in rows] for k, head in enumerate(("query", "missing", "nearest"))}
        return tables.table_of(columns, {"schema": self.schema})


def check_schema(schema: str = DR4.schema, url: str = ESA) -> SchemaCheck:
    """Ask an archive for its tables and columns, and hold our queries against them.

    Parameters
    ----------
    schema : str
        The schema, "gaiadr4" say.
    url : str
        Address of the TAP service.

    Raises
    ------
    ArchiveError
        If the service cannot be reached, knows no such schema, or sends no list of columns.
    """
    if not isinstance(schema, str) or not _NAME.fullmatch(schema):
        raise ArchiveError(f"{printable(schema)} is no name of a schema")
    known = _columns(schema, str(url).rstrip("/"))
    if not known:
        raise ArchiveError(f"{printable(url)} has no schema {schema}, or shows no columns of it")
    asked = {name: adql for name, adql in QUERIES.items() if f"{schema}." in adql}
    release = next((each for each in RELEASES.values() if each.schema == schema), None)
    if release is not None:
        variants = ASTROMETRY if release is DR4 else ASTROMETRY[:1]
        asked |= {
            f"a table of sources, --table {each}": of_table("t.t", release=release, astrometry=each)
            for each in variants
        }
    missing = {name: _missing(adql, schema, known) for name, adql in asked.items()}
    return SchemaCheck(schema, len(known), sum(map(len, known.values())), missing)


def _columns(schema, url):
    """The columns of each table of a schema."""
    adql = f"SELECT table_name, column_name FROM TAP_SCHEMA.columns WHERE table_name LIKE '{schema}.%'"
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": "csv", "QUERY": adql}
    with _open(f"{url}/sync", form) as answer:
        text = _some(answer, _MOST, time.monotonic() + 120).decode("utf-8", "replace")
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or [each.strip().lower() for each in rows[0]] != ["table_name", "column_name"]:
        raise ArchiveError(f"{url} sent no list of columns: {printable(text[:80])}")
    known: dict[str, set[str]] = {}
    for row in rows[1:]:
        if len(row) == 2:
            known.setdefault(row[0].strip().strip('"').lower(), set()).add(row[1].strip().strip('"').lower())
    return known


def _missing(adql, schema, known):
    """What a query asks of a schema that it lacks, with the nearest names."""
    absent: list[tuple[str, str | None]] = []
    places = {alias: table.lower() for table, alias in _TABLES.findall(adql) if table.lower().startswith(f"{schema}.")}
    for table in dict.fromkeys(places.values()):
        if table not in known:
            absent.append((table, _nearest(table, known)))
    for alias, column in dict.fromkeys(_COLUMNS.findall(adql)):
        table = places.get(alias, "")
        if table in known and column.lower() not in known[table]:
            near = _nearest(column.lower(), known[table])
            absent.append((f"{table}.{column}", near and f"{table}.{near}"))
    return tuple(absent)


def _nearest(name, names):
    return next(iter(get_close_matches(name, names, n=1, cutoff=0.5)), None)
