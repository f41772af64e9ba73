"""Queries that fetch the quasars and galaxies of a release of Gaia, and sources of one's own."""

import re
import tempfile
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vsh.io import tables
from vsh.io.archive._tap import SENT
from vsh.tools.errors import ArchiveError, first_line
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import printable


@dataclass(frozen=True)
class DataRelease(InNotebook):
    """A data release: the names of its tables, and its epoch.

    Attributes
    ----------
    name : str
    epoch : float
        Epoch of positions, a Julian year (TCB).
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
    schema: str
    solution: str
    accepted: dict[int, str]
    parallax_bias: str | None = None


_ACCEPTED_MODELS = {31: "position, parallax, proper motion", 95: "the same and a colour"}
EDR3 = DataRelease("EDR3", 2016.0, "gaiaedr3", "astrometric_params_solved", _ACCEPTED_MODELS)
DR3 = DataRelease("DR3", 2016.0, "gaiadr3", "astrometric_params_solved", _ACCEPTED_MODELS)
DR4 = DataRelease("DR4", 2017.5, "gaiadr4", "astrometric_params", _ACCEPTED_MODELS, "tentative_parallax_bias")
#: By name.
RELEASES = {release.name: release for release in (EDR3, DR3, DR4)}
#: What a fit needs, what selections look at, and what tells of the quality.
_COLUMNS = (
    "source_id", "ref_epoch", "ra", "dec", "ra_error", "dec_error", "ra_dec_corr", "parallax", "parallax_error", "pmra",
    "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr", "parallax_pmra_corr", "parallax_pmdec_corr",
    "astrometric_params_solved", "nu_eff_used_in_astrometry", "pseudocolour", "ruwe", "astrometric_excess_noise",
    "visibility_periods_used", "matched_transits", "scan_direction_strength_k2", "scan_direction_mean_k2",
    "phot_g_mean_mag", "bp_rp",
)  # fmt: skip
#: What a release has besides.
_FURTHER_COLUMNS = {"DR4": ("tentative_parallax_bias", "quality_flag")}
_ADQL_NAME = re.compile(r"[A-Za-z_][\w]*(\.[A-Za-z_][\w]*){0,2}")


def _format_column_list(release):
    return ", ".join(f"g.{name}" for name in _list_gaia_columns(release))


def _list_gaia_columns(release):
    """The columns of a release, by its own name of the astrometric model."""
    columns = (release.solution if name == DR3.solution else name for name in _COLUMNS)
    return (*columns, *_FURTHER_COLUMNS.get(release.name, ()))


def _format_solution_condition(release):
    return f"g.{release.solution} IN ({', '.join(map(str, release.accepted))})"


#: The 1.6 million quasars of Gaia-CRF3 (Gaia Collaboration, Klioner et al. 2022, A&A 667, A148), five- and
#: six-parameter solutions, with the redshifts of DR3's own quasar module where there are any.
GAIA_CRF3 = f"""\
SELECT {_format_column_list(DR3)}, q.redshift_qsoc, f.used_for_reference_frame_spin
FROM gaiadr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiadr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiadr3.qso_candidates AS q ON g.source_id = q.source_id
LEFT JOIN gaiadr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_format_solution_condition(DR3)}"""
#: The same sources as EDR3 had them: those of the acceleration paper (Gaia Collaboration, Klioner et al. 2021, A&A 649,
#: A9).
GAIA_EDR3_QSO = f"""\
SELECT {_format_column_list(EDR3)}, f.used_for_reference_frame_spin
FROM gaiaedr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiaedr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiaedr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_format_solution_condition(EDR3)}"""
#: DR3's candidates for galaxies that have a redshift from its own spectra.
GAIA_DR3_GALAXIES = f"""\
SELECT {_format_column_list(DR3)}, x.redshift_ugc AS redshift
FROM gaiadr3.gaia_source AS g
JOIN gaiadr3.galaxy_candidates AS x ON g.source_id = x.source_id
WHERE {_format_solution_condition(DR3)} AND x.redshift_ugc IS NOT NULL"""
#: By the names that `vsh-archive` takes.
QUERIES = {"gaia-crf3": GAIA_CRF3, "gaia-edr3-qso": GAIA_EDR3_QSO, "gaia-dr3-galaxies": GAIA_DR3_GALAXIES}


#: Where DR4 has its astrometry: the best model of each source, or the core solution of all sources.
ASTROMETRY = ("gaia_source", "all_source_astrometry")
#: Columns that are no astrometry, and the table of DR4 that has them for all sources: gaia_source lacks the magnitudes
#: of 800 million, among them faint and disturbed quasars.
_PHOTOMETRY, _PHOTOMETRY_OF_ALL = ("phot_g_mean_mag", "bp_rp"), "all_source_photometry"


def find_table_release(table: str, release: DataRelease | None = None) -> DataRelease:
    """The release that a table belongs to, by its schema: gaiadr4.qso_candidates is of DR4.

    Parameters
    ----------
    table : str
        Name of the table, with its schema.
    release : DataRelease, optional
        The release of a table of one's own, whose schema says nothing; DR3 unless given.

    Raises
    ------
    ArchiveError
        If the schema is that of another release than the one given, or of a release that is not known: identifiers
        and motions differ between releases, so that a list of one never goes with the astrometry of another.
    """
    if release is not None and not isinstance(release, DataRelease):
        raise ArchiveError(f"a release is a value such as vsh.io.archive.DR4, not {release!r}")
    schema = str(table).partition(".")[0].lower()
    by_schema = next((candidate for candidate in RELEASES.values() if candidate.schema == schema), None)
    if by_schema is None and re.fullmatch(r"gaiae?f?dr\d+\w*", schema):
        known_schemas = ", ".join(candidate.schema for candidate in RELEASES.values())
        raise ArchiveError(f"{table} is of a release that is not known: {known_schemas} are. Write the query in a file")
    if by_schema is not None and release is not None and release is not by_schema:
        raise ArchiveError(
            f"{table} is a table of {by_schema.name}, and {release.name} is asked for: identifiers and motions of the "
            f"two differ. Leave the release out, or name a table of {release.name}"
        )
    return by_schema or release or DR3


def of_table(
    table: str,
    columns: Iterable[str] = (),
    *,
    release: DataRelease | None = None,
    astrometry: str = "gaia_source",
    where: str | None = None,
) -> str:
    """The query for sources of one's own, galaxies or stars: a table in the archive that names them by source_id.

    Parameters
    ----------
    table : str
        Name of the table, with its schema.
    columns : iterable of str
        Columns of that table that come with the astrometry: redshifts, probabilities.
    release : DataRelease, optional
        The release of a table of one's own. A table of the archive's has that of its schema.
    astrometry : {"gaia_source", "all_source_astrometry"}
        The latter (DR4) is the core solution of each source: a quasar whose best model is that of a star with a
        companion is not lost.
    where : str, optional
        A condition in ADQL on the rows, in which t is the table and g the astrometry:
        "t.classprob_dsc_combmod_quasar > 0.9".

    Raises
    ------
    ArchiveError
        If the schema of the table contradicts the release, or a name is none.
    """
    release = find_table_release(table, release)
    columns = (columns,) if isinstance(columns, str) else tuple(columns)
    astrometry_columns = set(_list_gaia_columns(release))
    repeated = sorted({name for name in columns if name in astrometry_columns or columns.count(name) > 1})
    if repeated:
        raise ArchiveError(f"columns that gaia_source gives already, or that are named twice: {', '.join(repeated)}")
    for name in (table, *columns):
        if not isinstance(name, str) or not _ADQL_NAME.fullmatch(name):
            raise ArchiveError(f"{name!r} is no name of a table or column: letters, digits and _, with the schema")
    table_columns = [f"t.{name}" for name in columns]
    adql = _make_astrometry_query(release, astrometry, table_columns, f"FROM {table} AS t", "g.source_id = t.source_id")
    return adql if where is None else f"{adql}\nWHERE {where.strip()}"


def _make_astrometry_query(release, astrometry, further_columns, from_clause, join_condition):
    """The query that joins the astrometry of a release to a source of rows: `join_condition` says which."""
    if astrometry not in ASTROMETRY or (astrometry != "gaia_source" and release is not DR4):
        raise ArchiveError(
            f"{release.name} has no table of astrometry called {astrometry!r}: {', '.join(ASTROMETRY)} (the latter DR4)"
        )
    is_core = astrometry != "gaia_source"
    select_list = [f"{'s' if is_core and name in _PHOTOMETRY else 'g'}.{name}" for name in _list_gaia_columns(release)]
    lines = [
        f"SELECT {', '.join([*select_list, *further_columns])}",
        from_clause,
        f"JOIN {release.schema}.{astrometry} AS g ON {join_condition}",
    ]
    if is_core:
        lines.append(f"LEFT JOIN {release.schema}.{_PHOTOMETRY_OF_ALL} AS s ON s.source_id = g.source_id")
    return "\n".join(lines)


#: Sources that are matched by position lie closer than this. [arcsec]
MATCH_RADIUS = 1.0
#: The table that is sent with a query, by its name in ADQL.
UPLOADED = f"tap_upload.{SENT}"


def make_upload(source: Any) -> tuple[bytes, bool]:
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
    is_text = isinstance(source, (str, Path)) and Path(source).suffix.lower() in _TEXT_ENDINGS
    table = None if is_text else tables.open_table(source)
    if table is None or "source_id" in table.names:
        return _encode_votable({"source_id": np.array(read_ids(source), np.int64)}), True
    if {"ra", "dec"} - set(table.names):
        raise ArchiveError(f"{table.label} has neither source_id nor ra and dec: it has {', '.join(table.names[:50])}")
    columns = table.columns([name for name in ("name", "ra", "dec") if name in table.names])
    if any(mask is not None and mask.any() for _, mask in columns.values()):
        raise ArchiveError(f"{table.label}: positions or names are missing")
    return _encode_votable({name: np.asarray(values) for name, (values, _) in columns.items()}), False


def _encode_votable(columns):
    """A VOTable of columns, as bytes."""
    table = tables.table_of(columns, {}, {name: "deg" for name in columns if name in ("ra", "dec")})
    with tempfile.TemporaryDirectory(prefix="vsh-") as folder:
        tables.write_table(table, Path(folder, "list.vot"))
        return Path(folder, "list.vot").read_bytes()


def query_near_positions(*, release: DataRelease = DR3, astrometry: str = "gaia_source") -> str:
    """The query for the sources within an arcsecond of the positions that are sent with it."""
    circle = f"CIRCLE('ICRS', t.ra, t.dec, {MATCH_RADIUS}/3600)"
    join_condition = f"1 = CONTAINS(POINT('ICRS', g.ra, g.dec), {circle})"
    further_columns = ["t.ra AS list_ra", "t.dec AS list_dec"]
    return _make_astrometry_query(release, astrometry, further_columns, f"FROM {UPLOADED} AS t", join_condition)


#: DR4's names of the sources of DR3 that are sent with the query (`gaiadr4.dr3_neighbourhood`): a source may have
#: several neighbours, each with its distance and difference of magnitude.
NEIGHBOURS = f"""\
SELECT n.dr3_source_id, n.dr4_source_id, n.angular_distance, n.magnitude_difference
FROM {UPLOADED} AS t
JOIN gaiadr4.dr3_neighbourhood AS n ON n.dr3_source_id = t.source_id"""


#: Endings of texts with a source_id a line.
_TEXT_ENDINGS = ("", ".txt", ".lis", ".list", ".ids")


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
    if isinstance(source, (str, Path)) and Path(source).suffix.lower() in _TEXT_ENDINGS:
        try:
            lines = Path(source).read_text(encoding="utf-8-sig").splitlines()
        except (OSError, UnicodeDecodeError) as error:
            raise ArchiveError(f"{printable(source)} cannot be read: {first_line(error)}") from None
        entries = [entry for line in lines if (entry := line.partition("#")[0].strip())]
    else:
        table = tables.open_table(source)
        if "source_id" not in table.names:
            raise ArchiveError(f"{table.label} has no column source_id: the table has {', '.join(table.names[:50])}")
        values, mask = table.columns(("source_id",))["source_id"]
        entries = list(map(str, np.asarray(values) if mask is None else np.asarray(values)[~mask]))
    invalid_entries = [entry for entry in entries if not (re.fullmatch(r"\d{1,19}", entry) and int(entry) < 2**63)]
    if not entries:
        raise ArchiveError("the list of source_id is empty")
    if invalid_entries:
        raise ArchiveError(f"{len(invalid_entries)} of {len(entries)} source_id are no whole numbers")
    return [int(entry) for entry in entries]
