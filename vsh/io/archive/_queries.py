"""Releases of Gaia as values, and the queries that fetch their quasars and galaxies."""

import re
from collections.abc import Iterable
from dataclasses import dataclass

from vsh.tools.errors import ArchiveError
from vsh.tools.notebook import InNotebook


@dataclass(frozen=True)
class DataRelease(InNotebook):
    """What one release calls things, and when it was observed.

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


def _solved(release, prefix="g"):
    return f"{prefix}.{release.solution} IN ({', '.join(map(str, release.accepted))})"


#: The 1.6 million quasars of Gaia-CRF3 (Gaia Collaboration, Klioner et al. 2022, A&A 667, A148), five- and
#: six-parameter solutions, with the redshifts of DR3's own quasar module where there are any.
GAIA_CRF3 = f"""\
SELECT {_listed(DR3)}, q.redshift_qsoc, f.used_for_reference_frame_spin
FROM gaiadr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiadr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiadr3.qso_candidates AS q ON g.source_id = q.source_id
LEFT JOIN gaiadr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_solved(DR3)}"""
#: The same sources as EDR3 had them: those of the acceleration paper (Gaia Collaboration, Klioner et al. 2021, A&A 649,
#: A9).
GAIA_EDR3_QSO = f"""\
SELECT {_listed(DR3)}, f.used_for_reference_frame_spin
FROM gaiaedr3.gaia_source AS g
JOIN (SELECT DISTINCT source_id FROM gaiaedr3.agn_cross_id) AS c ON g.source_id = c.source_id
LEFT JOIN gaiaedr3.frame_rotator_source AS f ON g.source_id = f.source_id
WHERE {_solved(DR3)}"""
#: DR3's candidates for galaxies that have a redshift from its own spectra.
GAIA_DR3_GALAXIES = f"""\
SELECT {_listed(DR3)}, x.redshift_ugc AS redshift
FROM gaiadr3.gaia_source AS g
JOIN gaiadr3.galaxy_candidates AS x ON g.source_id = x.source_id
WHERE {_solved(DR3)} AND x.redshift_ugc IS NOT NULL"""
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
    listed = ", ".join(f"{'s' if name in _PHOTOMETRY else 'g'}.{name}" for name in _columns_of(release))
    return (
        f"SELECT {listed}{further}\nFROM {table} AS t\n"
        f"JOIN {release.schema}.{astrometry} AS g ON g.source_id = t.source_id\n"
        f"LEFT JOIN {release.schema}.{_PHOTOMETRY_OF_ALL} AS s ON s.source_id = t.source_id"
    )
