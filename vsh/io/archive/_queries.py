"""Queries that fetch the quasars and galaxies of a release of Gaia, checked against TAP_SCHEMA; epochs by DataLink.

Epoch astrometry comes in batches with their hashes, resumed where cut off.
"""

import csv
import hashlib
import io
import re
import tempfile
import time
import zipfile
from collections.abc import Iterable
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

import numpy as np

from vsh.io import tables
from vsh.io.archive._tap import ESA, SENT, _open, _read, _read_some, _write
from vsh.io.sections import Section, text_of
from vsh.tools.arguments import explained, positive, whole
from vsh.tools.errors import ArchiveError
from vsh.tools.files import atomic_write, digest, exclusive, remove_unfinished
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import progress_bar
from vsh.tools.printing import printable
from vsh.tools.types import PathName, Table


@dataclass(frozen=True)
class DataRelease(InNotebook):
    """A data release: the names of its tables, and its epoch.

    Attributes
    ----------
    name : str
    epoch : float
        Epoch of positions, a Julian year (TCB).
    months : int
        Months of observations.
    schema : str
        Schema of its tables in the archive.
    solution : str
        The column of gaia_source that says which astrometric model was solved for.
    accepted : dict of int to str
        Those of its values that are of use for quasars and galaxies, and what they are. All others are
        counted by value and left out.
    parallax_bias : str or None
        The column by which parallaxes can be corrected.

    Notes
    -----
    DR3: Lindegren et al. (2021, A&A 649, A2). DR4: ESA's pages on its content and the draft of its data model,
    which may change until it is out on 2 December 2026: gaia_source holds for each source the best model, those of
    stars that are not single among them. Its tables of quasars are not known yet, so no query for them is here.
    """

    name: str
    epoch: float
    months: int
    schema: str
    solution: str
    accepted: dict[int, str]
    parallax_bias: str | None = None


_SINGLE = {31: "position, parallax, proper motion", 95: "the same and a colour"}
DR3 = DataRelease("DR3", 2016.0, 34, "gaiadr3", "astrometric_params_solved", _SINGLE)
DR4 = DataRelease("DR4", 2017.5, 66, "gaiadr4", "astrometric_params", _SINGLE, "tentative_parallax_bias")
#: By name.
RELEASES = {release.name: release for release in (DR3, DR4)}
#: What a fit needs, what selections look at, and what tells of the quality.
_COLUMNS = (
    "source_id", "ra", "dec", "parallax", "parallax_error", "pmra", "pmdec", "pmra_error", "pmdec_error",
    "pmra_pmdec_corr", "parallax_pmra_corr", "parallax_pmdec_corr", "astrometric_params_solved",
    "nu_eff_used_in_astrometry", "pseudocolour", "ruwe", "astrometric_excess_noise", "visibility_periods_used",
    "matched_transits", "scan_direction_strength_k2", "scan_direction_mean_k2", "phot_g_mean_mag", "bp_rp",
)  # fmt: skip
#: What a release has besides.
_FURTHER = {"DR4": ("tentative_parallax_bias", "quality_flag")}
_NAME = re.compile(r"[A-Za-z_][\w]*(\.[A-Za-z_][\w]*){0,2}")


def _listed(release, prefix="g"):
    return ", ".join(f"{prefix}.{name}" for name in _columns_of(release))


def _columns_of(release):
    """The columns of a release, by its own name of the astrometric model."""
    columns = (release.solution if name == DR3.solution else name for name in _COLUMNS)
    return (*columns, *_FURTHER.get(release.name, ()))


def _solution_columns(release, prefix="g"):
    return f"{prefix}.{release.solution} IN ({', '.join(map(str, release.accepted))})"


#: The 1.6 million quasars of Gaia-CRF3 (Gaia Collaboration, Klioner et al. 2022, A&A 667, A148), five- and
#: six-parameter solutions, with the redshifts of DR3's own quasar module where there are any.
GAIA_CRF3 = f"""\
SELECT {_listed(DR3)}, q.redshift_qsoc, f.used_for_reference_frame_spin
FROM gaiadr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiadr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiadr3.qso_candidates AS q ON g.source_id = q.source_id
LEFT JOIN gaiadr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_solution_columns(DR3)}"""
#: The same sources as EDR3 had them: those of the acceleration paper (Gaia Collaboration, Klioner et al. 2021, A&A 649,
#: A9).
GAIA_EDR3_QSO = f"""\
SELECT {_listed(DR3)}, f.used_for_reference_frame_spin
FROM gaiaedr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiaedr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiaedr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_solution_columns(DR3)}"""
#: DR3's candidates for galaxies that have a redshift from its own spectra.
GAIA_DR3_GALAXIES = f"""\
SELECT {_listed(DR3)}, x.redshift_ugc AS redshift
FROM gaiadr3.gaia_source AS g
JOIN gaiadr3.galaxy_candidates AS x ON g.source_id = x.source_id
WHERE {_solution_columns(DR3)} AND x.redshift_ugc IS NOT NULL"""
#: By the names that `vsh-archive` takes.
QUERIES = {"gaia-crf3": GAIA_CRF3, "gaia-edr3-qso": GAIA_EDR3_QSO, "gaia-dr3-galaxies": GAIA_DR3_GALAXIES}


#: Where DR4 has its astrometry: the best model of each source, or the core solution of all sources.
ASTROMETRY = ("gaia_source", "all_source_astrometry")
#: Columns that are no astrometry, and the table of DR4 that has them for all sources: gaia_source lacks the magnitudes
#: of 800 million, among them faint and disturbed quasars.
_PHOTOMETRY, _PHOTOMETRY_OF_ALL = ("phot_g_mean_mag", "bp_rp"), "all_source_photometry"


def of_table(
    table: str, columns: Iterable[str] = (), *, release: DataRelease = DR3, astrometry: str = "gaia_source"
) -> str:
    """The query for sources of one's own, galaxies or stars: a table in the archive that names them by source_id.

    With ``astrometry="all_source_astrometry"`` (DR4), the core solution of each source: a quasar whose best model is
    that of a star with a companion is not lost.
    """
    if astrometry not in ASTROMETRY or (astrometry != "gaia_source" and release is DR3):
        raise ArchiveError(
            f"{release.name} has no table of astrometry called {astrometry!r}: {', '.join(ASTROMETRY)} (the latter DR4)"
        )
    columns = (columns,) if isinstance(columns, str) else tuple(columns)
    if not isinstance(release, DataRelease):
        raise ArchiveError(f"a release is a value such as vsh.io.archive.DR4, not {release!r}")
    ours = set(_columns_of(release))
    twice = sorted({name for name in columns if name in ours or columns.count(name) > 1})
    if twice:
        raise ArchiveError(f"columns that gaia_source gives already, or that are named twice: {', '.join(twice)}")
    for name in (table, *columns):
        if not isinstance(name, str) or not _NAME.fullmatch(name):
            raise ArchiveError(
                f"{name!r} is no name of a table or column: letters, digits and _, tables with their schema"
            )
    further = "".join(f", t.{name}" for name in columns)
    if astrometry == "gaia_source":
        return (
            f"SELECT {_listed(release)}{further}\nFROM {table} AS t\n"
            f"JOIN {release.schema}.gaia_source AS g ON g.source_id = t.source_id"
        )
    select_list = ", ".join(f"{'s' if name in _PHOTOMETRY else 'g'}.{name}" for name in _columns_of(release))
    return (
        f"SELECT {select_list}{further}\nFROM {table} AS t\n"
        f"JOIN {release.schema}.{astrometry} AS g ON g.source_id = t.source_id\n"
        f"LEFT JOIN {release.schema}.{_PHOTOMETRY_OF_ALL} AS s ON s.source_id = t.source_id"
    )


#: Sources that are matched by position lie closer than this. [arcsec]
MATCH_RADIUS = 1.0
#: The table that is sent with a query, by its name in ADQL.
UPLOADED = f"tap_upload.{SENT}"


def upload_of(source: Any) -> tuple[bytes, bool]:
    """Make the VOTable that is sent with a query from a list of sources of one's own.

    Parameters
    ----------
    source : path or table
        A list with a column source_id, a text with one a line, or positions: columns ra and dec in degrees.

    Returns
    -------
    bytes
        A VOTable with source_id, or with ra and dec (and name where there is one).
    bool
        Whether it names the sources by source_id.

    Raises
    ------
    ArchiveError
        If there is neither source_id nor ra and dec.
    """
    is_text = isinstance(source, (str, Path)) and Path(source).suffix.lower() in _TEXTS
    table = None if is_text else tables.open_table(source)
    if table is None or "source_id" in table.names:
        columns = {"source_id": np.array(read_ids(source), np.int64)}
        return _as_votable(columns), True
    missing = {"ra", "dec"} - set(table.names)
    if missing:
        raise ArchiveError(
            f"{table.label} has neither source_id nor ra and dec: the table has {', '.join(table.names[:50])}"
        )
    names = [name for name in ("name", "ra", "dec") if name in table.names]
    block = table.columns(names)
    if any(mask is not None and mask.any() for _, mask in block.values()):
        raise ArchiveError(f"{table.label}: positions or names are missing")
    return _as_votable({name: np.asarray(values) for name, (values, _) in block.items()}), False


def _as_votable(columns):
    """A VOTable of columns, as bytes."""
    table = tables.table_of(columns, {}, {name: "deg" for name in columns if name in ("ra", "dec")})
    with tempfile.TemporaryDirectory(prefix="vsh-") as folder:
        tables.write_table(table, Path(folder, "list.vot"))
        return Path(folder, "list.vot").read_bytes()


def of_positions(*, release: DataRelease = DR3) -> str:
    """The query for the sources within an arcsecond of the positions that are sent with it."""
    circle = f"CIRCLE('ICRS', t.ra, t.dec, {MATCH_RADIUS}/3600)"
    return (
        f"SELECT {_listed(release)}, t.ra AS list_ra, t.dec AS list_dec\nFROM {UPLOADED} AS t\n"
        f"JOIN {release.schema}.gaia_source AS g ON 1 = CONTAINS(POINT('ICRS', g.ra, g.dec), {circle})"
    )


#: An answer that is larger is no list of columns. [bytes]
_SCHEMA_BYTES = 2**26
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
        How many the schema has.
    missing : dict of str to tuple
        For each query the names that it asks for and the schema lacks, each with the nearest that it has, or None.
    """

    schema: str
    n_tables: int
    n_columns: int
    missing: dict[str, tuple[tuple[str, str | None], ...]]

    def sections(self) -> tuple[Section, ...]:
        """Sections on the queries that run and the names that changed."""
        facts = [(name, "does not run" if absent else "runs") for name, absent in self.missing.items()]
        table = self.to_table() if any(self.missing.values()) else None
        return (Section(f"{self.schema}: {self.n_tables} tables, {self.n_columns} columns", facts, table),)

    def report(self) -> str:
        """The queries as text, and below them the names that changed."""
        return text_of(self.sections())

    def to_table(self) -> Table:
        """A row for each name that is missing, as an astropy Table."""
        rows = [(query, name, nearest or "") for query, absent in self.missing.items() for name, nearest in absent]
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
    if not isinstance(schema, str) or not _SCHEMA_NAME.fullmatch(schema):
        raise ArchiveError(f"{printable(schema)} is no name of a schema")
    table_columns = _columns(schema, str(url).rstrip("/"))
    if not table_columns:
        raise ArchiveError(f"{printable(url)} has no schema {schema}, or shows no columns of it")
    queries = {name: adql for name, adql in QUERIES.items() if f"{schema}." in adql}
    release = next((candidate for candidate in RELEASES.values() if candidate.schema == schema), None)
    if release is not None:
        variants = ASTROMETRY if release is DR4 else ASTROMETRY[:1]
        queries |= {
            f"a table of sources, --table {candidate}": of_table("t.t", release=release, astrometry=candidate)
            for candidate in variants
        }
    missing = {name: _missing(adql, schema, table_columns) for name, adql in queries.items()}
    return SchemaCheck(schema, len(table_columns), sum(map(len, table_columns.values())), missing)


def _columns(schema, url):
    """The columns of each table of a schema."""
    adql = f"SELECT table_name, column_name FROM TAP_SCHEMA.columns WHERE table_name LIKE '{schema}.%'"
    form = {"REQUEST": "doQuery", "LANG": "ADQL", "FORMAT": "csv", "QUERY": adql}
    with _open(f"{url}/sync", form) as answer:
        text = _read_some(answer, _SCHEMA_BYTES, time.monotonic() + 120).decode("utf-8", "replace")
    rows = list(csv.reader(io.StringIO(text)))
    if not rows or [cell.strip().lower() for cell in rows[0]] != ["table_name", "column_name"]:
        raise ArchiveError(f"{url} sent no list of columns: {printable(text[:80])}")
    table_columns: dict[str, set[str]] = {}
    for row in rows[1:]:
        if len(row) == 2:
            table_columns.setdefault(row[0].strip().strip('"').lower(), set()).add(row[1].strip().strip('"').lower())
    return table_columns


def _missing(adql, schema, table_columns):
    """Names of a query that a schema lacks, with the nearest ones."""
    absent: list[tuple[str, str | None]] = []
    aliases = {alias: table.lower() for table, alias in _TABLES.findall(adql) if table.lower().startswith(f"{schema}.")}
    for table in dict.fromkeys(aliases.values()):
        if table not in table_columns:
            absent.append((table, _nearest(table, table_columns)))
    for alias, column in dict.fromkeys(_ALIASED.findall(adql)):
        table = aliases.get(alias, "")
        if table in table_columns and column.lower() not in table_columns[table]:
            nearest = _nearest(column.lower(), table_columns[table])
            absent.append((f"{table}.{column}", nearest and f"{table}.{nearest}"))
    return tuple(absent)


def _nearest(name, names):
    return next(iter(get_close_matches(name, names, n=1, cutoff=0.5)), None)


#: ESA's server of products that hang on a source.
DATA_SERVER = "https://gea.esac.esa.int/data-server/data"
#: The most sources that the server gives at once, and how large an answer of so many may be. [bytes]
BATCH, _MOST = 5000, 2**32


@explained
def fetch_epochs(
    ids: Iterable[int],
    folder: PathName,
    url: str = DATA_SERVER,
    *,
    retrieval_type: str = "EPOCH_ASTROMETRY",
    structure: str = "COMBINED",
    release: str = "Gaia DR4",
    batch: int = 500,
    patience: float = 7200.0,
    progress: bool = True,
) -> Path:
    """Fetch the epoch astrometry of sources into a folder that `read_epochs` and `vsh-waves` read.

    Parameters
    ----------
    ids : iterable of int
        source_id of each.
    folder : str or Path
        The folder, new or of an earlier call. A file of the same name with .json appended records the request and the
        SHA-256 checksum of every file.
    url : str
        Address of the data server.
    retrieval_type, structure, release : str
        What the server calls the product, how several sources come ("INDIVIDUAL", "COMBINED", "RAW") and the release.
    batch : int
        How many sources are asked for at once, 5000 at most.
    patience : float
        How long to wait for each batch. [s]
    progress : bool
        Show a bar, after two seconds.

    Returns
    -------
    Path
        The folder, with a file or more for each batch.

    Raises
    ------
    ArchiveError
        If the server cannot be reached, refuses, or sends nothing that can be unpacked; if the folder holds the answer
        to another list. Batches already received are kept; the same call resumes after them.
    """
    numbers = sorted({int(source_id) for source_id in ids})
    if not numbers or numbers[0] < 0:
        raise ArchiveError("there are no sources to ask for: source_id are whole numbers above zero")
    size = min(whole("batch", batch), BATCH)
    folder = Path(folder)
    note = folder.with_name(f"{folder.name}.json")
    checksum = hashlib.sha256("\n".join(map(str, numbers)).encode()).hexdigest()
    request = {
        "retrieval_type": retrieval_type, "structure": structure, "release": release, "url": str(url), "batch": size,
        "sources": len(numbers), "sha256_of_ids": checksum,
    }  # fmt: skip
    with exclusive(note):
        record = _read(note)
        if record and any(record.get(key) != value for key, value in request.items()):
            raise ArchiveError(f"{printable(folder)} holds the answer to another request: name another folder")
        if not record and folder.exists() and any(folder.iterdir()):
            raise ArchiveError(
                f"{printable(folder)} exists without its note, so its contents are unknown: name another"
            )
        files: dict[str, str] = dict(record.get("files", {}))
        if not record:  # first of all: who is killed in the first batch goes on as well
            _write(note, request | {"files": files})
        folder.mkdir(exist_ok=True)
        remove_unfinished(folder)
        batches = [numbers[k : k + size] for k in range(0, len(numbers), size)]
        with progress_bar(total=len(batches), words="fetching epochs", shown=progress) as bar:
            for k, batch_ids in enumerate(batches):
                batch_files = {name: sha for name, sha in files.items() if name.startswith(f"epochs-{k:05d}")}
                if not batch_files or any(not _is_whole(folder / name, sha) for name, sha in batch_files.items()):
                    files = {name: sha for name, sha in files.items() if name not in batch_files}
                    files |= _fetch_piece(batch_ids, k, folder, request, positive("patience", patience))
                    _write(note, request | {"files": files})
                bar.update(1)
    return folder


def _is_whole(path, sha):
    return path.is_file() and digest(path) == sha


def _fetch_piece(ids, k, folder, request, patience):
    """Fetch a batch: its files, and their hashes."""
    form = {
        "ID": ",".join(map(str, ids)), "RETRIEVAL_TYPE": request["retrieval_type"], "FORMAT": "votable",
        "DATA_STRUCTURE": request["structure"], "RELEASE": request["release"], "VALID_DATA": "false",
        "USE_ZIP_ALWAYS": "true",
    }  # fmt: skip
    end = time.monotonic() + patience
    with _open(request["url"], form, end) as answer:
        body = _read_some(answer, _MOST, end)
    files = {}
    for number, (name, content) in enumerate(_members(body, request["url"])):
        suffix = ".fits" if content[:9] == b"SIMPLE  =" else ".csv" if name.lower().endswith(".csv") else ".vot"
        path = folder / f"epochs-{k:05d}-{number:05d}{suffix}"
        if path.exists():
            path.unlink()  # of a batch that was not whole, or was changed: our own names in our own folder
        with atomic_write(path) as temporary_path:
            temporary_path.write_bytes(content)
        files[path.name] = digest(path)
    return files


def _members(body, url):
    """The files of an answer: those of a zip archive, or itself."""
    if body[:2] != b"PK":
        if b"<VOTABLE" not in body[:2000] and body[:9] != b"SIMPLE  =":
            text = re.sub(r"<[^>]+>", " ", body[:400].decode("utf-8", "replace"))
            raise ArchiveError(f"{url} sent no epochs: {printable(' '.join(text.split()))[:200]}")
        return [("answer", body)]
    try:
        with zipfile.ZipFile(io.BytesIO(body)) as archive:
            inside = [member for member in archive.infolist() if not member.is_dir()]
            if sum(member.file_size for member in inside) > _MOST:
                raise ArchiveError(f"{url} sent more than {_MOST} bytes in one batch: ask for fewer sources (batch)")
            members = [(member.filename, archive.read(member)) for member in inside]
    except (zipfile.BadZipFile, OSError, NotImplementedError, RuntimeError) as error:
        raise ArchiveError(f"{url} sent no whole archive ({error}): the same call fetches it again") from error
    if not members:
        raise ArchiveError(f"{url} sent an empty archive: none of these sources has epochs")
    return members


#: Endings of texts with a source_id a line.
_TEXTS = ("", ".txt", ".lis", ".list", ".ids")


def read_ids(source: Any) -> list[int]:
    """Read source_id from a table that has a column of that name, or from a text with one a line.

    Parameters
    ----------
    source : path or table
        The list.

    Raises
    ------
    ArchiveError
        If the list is empty, or some entries are not integers.
    """
    if isinstance(source, (str, Path)) and Path(source).suffix.lower() in _TEXTS:
        text = Path(source).read_text(encoding="utf-8-sig").splitlines()
        entries = [entry for line in text if (entry := line.partition("#")[0].strip())]
    else:
        table = tables.open_table(source)
        if "source_id" not in table.names:
            raise ArchiveError(f"{table.label} has no column source_id: the table has {', '.join(table.names[:50])}")
        values, mask = table.columns(("source_id",))["source_id"]
        entries = list(map(str, np.asarray(values) if mask is None else np.asarray(values)[~mask]))
    wrong = [entry for entry in entries if not re.fullmatch(r"\d{1,19}", entry)]
    if wrong or not entries:
        raise ArchiveError(
            f"{len(wrong)} of {len(entries)} source_id are no whole numbers"
            if wrong
            else "the list of source_id is empty"
        )
    return [int(entry) for entry in entries]
