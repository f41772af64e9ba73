"""Which of our queries a schema of an archive answers: its tables and columns, asked of TAP_SCHEMA."""

import re
from dataclasses import dataclass
from difflib import get_close_matches

from vsh.io import tables
from vsh.io.archive._queries import ASTROMETRY, DR4, NEIGHBOURS, QUERIES, RELEASES, of_table
from vsh.io.archive._tap import ESA, query_rows
from vsh.io.sections import Section, text_of
from vsh.tools.errors import ArchiveError
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import printable
from vsh.tools.types import Table

_SCHEMA_NAME = re.compile(r"[A-Za-z_]\w*")
_TABLES = re.compile(r"\b(?:FROM|JOIN)\s+([A-Za-z_]\w*(?:\.\w+)+)(?:\s+AS\s+(\w+))?", re.IGNORECASE)
_ALIASED = re.compile(r"\b([A-Za-z])\.([A-Za-z_]\w*)")


@dataclass(frozen=True)
class SchemaCheck(InNotebook):
    """Check of a schema: which queries run, and which names are missing.

    Attributes
    ----------
    schema : str
    n_tables, n_columns : int
        How many of the tables that the queries name the schema has, and their columns.
    missing : dict of str to tuple
        For each query the names that it asks for and the schema lacks, each with the nearest that it has, or None.
    """

    schema: str
    n_tables: int
    n_columns: int
    missing: dict[str, tuple[tuple[str, str | None], ...]]

    @property
    def any_runs(self) -> bool:
        """Return whether at least one of the queries runs."""
        return not all(self.missing.values())

    def sections(self) -> tuple[Section, ...]:
        """Sections on the queries that run and the names that changed."""
        facts = [(name, "does not run" if absent else "runs") for name, absent in self.missing.items()]
        table = self.to_table() if any(self.missing.values()) else None
        title = f"{self.schema}: {self.n_tables} tables that the queries name, {self.n_columns} columns"
        return (Section(title, facts, table),)

    def report(self) -> str:
        """The queries as text, and below them the names that changed."""
        return text_of(self.sections())

    def to_table(self) -> Table:
        """A row for each name that is missing, as an astropy Table."""
        rows = [(query, name, nearest or "") for query, absent in self.missing.items() for name, nearest in absent]
        return tables.table_of_rows(("query", "missing", "nearest"), rows, {"schema": self.schema})


def check_schema(schema: str = DR4.schema, url: str = ESA) -> SchemaCheck:
    """Ask an archive for the tables of our queries and their columns, and hold the queries against them.

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

    Notes
    -----
    Only the tables that the queries name are asked for: answers to synchronous queries may be cut off at 2000 rows,
    and a schema has more columns. A list of a suspicious length is asked for again, asynchronously.
    """
    if not isinstance(schema, str) or not _SCHEMA_NAME.fullmatch(schema):
        raise ArchiveError(f"{printable(schema)} is no name of a schema")
    queries = {name: adql for name, adql in QUERIES.items() if f"{schema}." in adql}
    release = next((candidate for candidate in RELEASES.values() if candidate.schema == schema), None)
    if release is not None:
        variants = ASTROMETRY if release is DR4 else ASTROMETRY[:1]
        queries |= {
            f"a table of sources, --table {candidate}": of_table("t.t", release=release, astrometry=candidate)
            for candidate in variants
        }
    if release is DR4:
        queries["dr3-neighbourhood"] = NEIGHBOURS
    url = str(url).rstrip("/")
    used_tables = sorted({table for adql in queries.values() for table in _find_tables_by_alias(adql, schema).values()})
    quoted_tables = ", ".join(f"'{table}'" for table in used_tables) or f"'{schema}'"
    table_columns: dict[str, set[str]] = {}
    adql = f"SELECT table_name, column_name FROM TAP_SCHEMA.columns WHERE table_name IN ({quoted_tables})"
    for table, column in query_rows(adql, ("table_name", "column_name"), url):
        table_columns.setdefault(table, set()).add(column)
    table_names = set(table_columns)
    if not table_names.issuperset(used_tables) or not used_tables:  # what is missing may have another name
        adql = f"SELECT table_name FROM TAP_SCHEMA.tables WHERE table_name LIKE '{schema}.%'"
        table_names |= {row[0] for row in query_rows(adql, ("table_name",), url) if row[0].startswith(f"{schema}.")}
    if not table_names:
        raise ArchiveError(f"{printable(url)} has no schema {schema}, or shows no columns of it")
    missing = {name: _find_missing_names(adql, schema, table_columns, table_names) for name, adql in queries.items()}
    present_tables = [table for table in used_tables if table in table_columns]
    return SchemaCheck(schema, len(present_tables), sum(len(table_columns[table]) for table in present_tables), missing)


def _find_tables_by_alias(adql, schema):
    """The tables of a schema that a query names, by their aliases."""
    return {alias: table.lower() for table, alias in _TABLES.findall(adql) if table.lower().startswith(f"{schema}.")}


def _find_missing_names(adql, schema, table_columns, table_names):
    """Names of a query that a schema lacks, with the nearest ones; `table_names` are those of its tables."""
    aliases = _find_tables_by_alias(adql, schema)
    unknown_tables = [table for table in dict.fromkeys(aliases.values()) if table not in table_columns]
    absent: list[tuple[str, str | None]] = [(table, _find_nearest_name(table, table_names)) for table in unknown_tables]
    for alias, column in dict.fromkeys(_ALIASED.findall(adql)):
        table = aliases.get(alias, "")
        if table in table_columns and column.lower() not in table_columns[table]:
            nearest = _find_nearest_name(column.lower(), table_columns[table])
            absent.append((f"{table}.{column}", nearest and f"{table}.{nearest}"))
    return tuple(absent)


def _find_nearest_name(name, names):
    return next(iter(get_close_matches(name, names, n=1, cutoff=0.5)), None)
