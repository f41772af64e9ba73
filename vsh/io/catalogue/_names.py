"""How tables of this field call their columns: sets of names, units within names, and columns made from others."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from difflib import SequenceMatcher
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from vsh.io.archive import DR3, DR4
from vsh.io.columns import REQUIRED
from vsh.io.tables import TableSource
from vsh.sky.frames import AXES
from vsh.tools.bad_rows import floats_or_nan
from vsh.tools.notebook import InNotebook

#: Names that belong together: where a set has several, those of one place are taken.
_PAIRS = (("ra", "dec"), ("pmra", "pmdec"), ("pmra_error", "pmdec_error"))


@dataclass(frozen=True)
class Columns(InNotebook):
    """Names of the columns that a field needs. Tables of another survey need another `Columns`.

    The first six must be there. The others may be left out with None; of several names in a tuple the first that the
    table has is taken, and none need be there. Where there is a `solution`, sources whose astrometry is not that of a
    single source with a parallax (31 or 95, `vsh.io.archive.DR4`) cannot be used; a source whose `solution` is null is
    used if it has a motion. Nor can sources whose `quality` is a flag other than zero, as DR4's quality_flag.

    Examples
    --------
    >>> Columns(pmra="mu_ra", pmdec="mu_dec").pmra
    'mu_ra'
    """

    ra: str | tuple = "ra"
    dec: str | tuple = "dec"
    pmra: str | tuple = "pmra"
    pmdec: str | tuple = "pmdec"
    pmra_error: str | tuple = "pmra_error"
    pmdec_error: str | tuple = "pmdec_error"
    pmra_pmdec_corr: str | tuple | None = ("pmra_pmdec_corr",)
    name: str | tuple | None = ("source_id", "name", "designation", "source_name")
    magnitude: str | tuple | None = ("phot_g_mean_mag",)
    redshift: str | tuple | None = ("redshift", "z", "redshift_quaia", "redshift_qsoc", "z_ph")
    redshift_error: str | tuple | None = ("redshift_error", "z_error", "e_z", "redshift_quaia_err", "z_ph_err")
    distance: str | tuple | None = None
    distance_error: str | tuple | None = None
    parallax: str | tuple | None = None
    parallax_error: str | tuple | None = None
    solution: str | tuple | None = (DR4.solution, DR3.solution)
    quality: str | tuple | None = ("quality_flag",)


def name_written_columns(frame: str) -> dict[str, str]:
    """Role to name of the columns that a field of this frame is written with."""
    lon, lat, east, north = AXES[frame]
    names = {"ra": lon, "dec": lat, "pmra": east, "pmdec": north}
    names |= {f"{role}_error": f"{names[role]}_error" for role in ("pmra", "pmdec")}
    return names | {"pmra_pmdec_corr": f"{east}_{north}_corr"}


def has_field_columns(names: Iterable[str]) -> bool:
    """Return whether a table has all columns of positions, motions and errors that a field of some axes writes."""
    present = set(names)
    return any({name_written_columns(frame)[role] for role in REQUIRED} <= present for frame in AXES)


#: Gaia's archive names.
GAIA = Columns()
_VIZIER = Columns(
    ra=("RA_ICRS", "RAICRS", "RAdeg", "RArad", "_RA.icrs", "_RA_icrs", "_RAJ2000", "RAJ2000", "_RA", "RA",
        "X_RA.icrs", "X_RA_icrs", "X_RAJ2000", "ra"),
    dec=("DE_ICRS", "DEICRS", "DEdeg", "DErad", "_DE.icrs", "_DE_icrs", "_DEJ2000", "DEJ2000", "_DE", "DE",
         "X_DE.icrs", "X_DE_icrs", "X_DEJ2000", "dec"),
    pmra=("pmRA", "pmRA*"), pmdec=("pmDE", "pmDE"), pmra_error=("e_pmRA", "e_pmRA*", "pmRA_error", "pmRA_err"),
    pmdec_error=("e_pmDE", "e_pmDE", "pmDE_error", "pmDE_err"),
    pmra_pmdec_corr=("pmRApmDEcor", "pmDE:pmRA", "pmRA:pmDE", "pmRApmDEcorr", "r_pmRApmDE"),
    name=("Source", "ID", "HIP", "ICRF", "IERS", "Name"), magnitude=("Gmag", "Hpmag"),
    redshift=("z", "zsp", "Redshift"), redshift_error=("e_z", "e_zsp"), solution=("Solved",),
)  # fmt: skip
#: Positions in other axes, and motions there or along α and δ.
_OTHER_AXES = {
    frame: replace(GAIA, **{
        role: name if role in ("ra", "dec") else (name,) if role.endswith("corr") else (name, getattr(GAIA, role))
        for role, name in name_written_columns(frame).items()
    })
    for frame in AXES if frame != "icrs"
}  # fmt: skip
_SHARED_ROLES = ("pmra_pmdec_corr", "name", "magnitude", "redshift", "redshift_error")
#: Sets of names that are called by one; where none is asked for, the first that a table has.
NAMED = {
    "gaia": GAIA,
    "vizier": _VIZIER,
    "hipparcos": _VIZIER,
    "icrf": replace(GAIA, name=("iers", "icrf")),
    "skycoord": replace(
        GAIA, pmra="pm_ra_cosdec", pmdec="pm_dec",
        pmra_error=("pm_ra_cosdec_error", "pm_ra_cosdec_err", "e_pm_ra_cosdec"),
        pmdec_error=("pm_dec_error", "pm_dec_err", "e_pm_dec"),
        pmra_pmdec_corr=("pm_ra_cosdec_pm_dec_corr", "pm_corr", "pmra_pmdec_corr"),
    ),
    "simbad": replace(GAIA, name=("main_id", "MAIN_ID"), redshift=("rvz_redshift", "Z_VALUE")),
    "ned": replace(GAIA, name=("Object Name",), redshift=("Redshift",)),
    **_OTHER_AXES,
    "lvdb": replace(GAIA, name=("key", "name")),
    "err": replace(
        GAIA, pmra_error=("pmra_err", "e_pmra", "pmra_e", "epmra", "pmra_unc", "sigma_pmra", "pmra_sigma"),
        pmdec_error=("pmdec_err", "e_pmdec", "pmdec_e", "epmdec", "pmdec_unc", "sigma_pmdec", "pmdec_sigma"),
        pmra_pmdec_corr=("pmra_pmdec_corr", "pmra_pmdec_correlation", "corr_pmra_pmdec", "pmra_pmdec_cor", "pm_corr",
                         "rho_pm", "pmcorr"),
    ),
    # Redshift catalogues of DESI, and its targets, with inverse variances of the Legacy Surveys.
    "desi": replace(
        GAIA, ra=("TARGET_RA", "RA"), dec=("TARGET_DEC", "DEC"), pmra="PMRA", pmdec="PMDEC",
        pmra_error=("PMRA_ERROR", "PMRA_IVAR^-1/2"), pmdec_error=("PMDEC_ERROR", "PMDEC_IVAR^-1/2"),
        name=("TARGETID",), redshift=("Z",), redshift_error=("ZERR",),
    ),
    "catwise": replace(
        GAIA, pmra="PMRA", pmdec="PMDec", pmra_error="sigPMRA", pmdec_error="sigPMDec",
        name=("source_name", "source_id"),
    ),
    "rubin": replace(
        GAIA, ra=("ra", "coord_ra"), dec=("dec", "coord_dec"), pmra=("pmRa",), pmdec=("pmDec",),
        pmra_error=("pmRaErr", "pmRaSigma"), pmdec_error=("pmDecErr", "pmDecSigma"), name=("diaObjectId", "objectId"),
    ),
    "mu": replace(
        GAIA, pmra=("mu_ra", "mu_alpha_star", "mu_alpha"), pmdec=("mu_dec", "mu_delta", "mu_delta"),
        pmra_error=("mu_ra_error", "mu_ra_err", "e_mu_ra", "mu_alpha_star_error", "mu_alpha_error"),
        pmdec_error=("mu_dec_error", "mu_dec_err", "e_mu_dec", "mu_delta_error", "mu_delta_error"),
    ),
    # Tables that somebody joined: Gaia's columns by a mark of their own; SIMPLE, ATNF, the exoplanet archive, clusters.
    "joined": replace(
        GAIA, ra=("ra", "ra_gaia", "gaia_ra", "raj", "icrsra"), dec=("dec", "dec_gaia", "gaia_dec", "decj", "icrsdec"),
        pmra=("pmra", "pmra_gaia", "gaia_pmra", "sy_pmra", "pmra_val", "mura", "mua", "pmra_radio"),
        pmdec=("pmdec", "pmdec_gaia", "gaia_pmdec", "sy_pmdec", "pmdec_val", "mudec", "mud", "pmdec_radio"),
        pmra_error=("pmra_error", "pmra_error_gaia", "gaia_pmra_error", "sy_pmraerr1", "pmra_err", "mura_err",
                    "muaerr"),
        pmdec_error=("pmdec_error", "pmdec_error_gaia", "gaia_pmdec_error", "sy_pmdecerr1", "pmdec_err", "mudec_err",
                     "muderr"),
    ),
}  # fmt: skip
#: Units that the makers of a catalogue publish for its motions, where a table has none.
USUAL_UNITS = dict.fromkeys((*_OTHER_AXES, "desi", "rubin"), "mas / yr") | {"catwise": "arcsec / yr"}

#: What need not be there may also have Gaia's names, in a table that has others for the rest.
NAMED = {
    known: replace(
        names, **{role: tuple(dict.fromkeys((*getattr(names, role), *getattr(GAIA, role)))) for role in _SHARED_ROLES}
    )
    for known, names in NAMED.items()
}

#: A unit behind a name: RA (deg), RA(deg), pmra [mas/yr].
_UNIT_IN_BRACKETS = re.compile(r"(.*\S)\s*[\(\[]\s*([^()\[\]]+?)\s*[\)\]]\s*")
#: What stands there instead: an equinox, an epoch or a system.
_EQUINOX = re.compile(r"[JB]?\d{4}(\.\d+)?|ICRS|FK[45]|ep=.*", re.IGNORECASE)
#: The same with underscores: dist_kpc, pmra_mas_yr.
_UNIT_BEHIND = re.compile(r"(.+)_(deg|rad|kpc|mpc|pc|(?:mas|uas|arcsec)(?:_?p?e?r?_?yr))", re.IGNORECASE)
_CORRELATION = re.compile(
    r"^(?!.*corrected)(?=.*(corr?|rho|:|cov)|c_)(.*(pm|mu).*(pm|mu)|.*(pm|mu)_?(ra_?de|l_?b)|.*(pm|mu)_?(corr?|rho|cov)"
    r"|.*(corr?|rho|cov)_?(pm|mu)|(corr?|rho)$)",
    re.IGNORECASE,
)
_OF_PARALLAX = re.compile("par|plx", re.IGNORECASE)
_UNIT_SPELLINGS = {"mpc": "Mpc", "kpc": "kpc", "pc": "pc", "deg": "deg", "rad": "rad"}


def split_name_and_unit(name: str) -> tuple[str, str | None]:
    """A name without the unit that stands in it, and the unit."""
    if match := _UNIT_IN_BRACKETS.fullmatch(name):
        return match[1].strip(), None if _EQUINOX.fullmatch(match[2]) else match[2]
    if match := _UNIT_BEHIND.fullmatch(name):
        unit = match[2].lower()
        return match[1], _UNIT_SPELLINGS.get(unit, re.sub(r"_?(per)?_?yr$", "/yr", unit))
    return name, None


class ColumnRequest(NamedTuple):
    """The names that a user wants: those of a set, or of whatever set a table has where none was asked for."""

    columns: Columns = GAIA
    #: Roles whose names are the user's; None where all are.
    asked_roles: tuple[str, ...] | None = ()

    def choose_names(self, names: Iterable[str]) -> tuple[Columns, str | None]:
        """The names that a table has for each role, and the set that was chosen, where it is not Gaia's."""
        return _choose_names(self, tuple(names))


@lru_cache
def _choose_names(request, names):
    names_by_form = _index_names_by_form(names)
    if request.asked_roles is None:
        return _resolve_names(request.columns, names, names_by_form), None
    user_names = {role: getattr(request.columns, role) for role in request.asked_roles}
    best_set, best_count, best_columns = "gaia", -1, _resolve_names(request.columns, names, names_by_form)
    for set_name, column_set in NAMED.items():
        resolved_columns = _resolve_names(replace(column_set, **user_names), names, names_by_form)
        count = sum(getattr(resolved_columns, role) in names for role in REQUIRED)
        if {resolved_columns.ra, resolved_columns.dec} <= set(names) and count > best_count:
            best_set, best_count, best_columns = set_name, count, resolved_columns
    is_gaia = all(getattr(best_columns, role) == getattr(GAIA, role) for role in REQUIRED if role not in user_names)
    return best_columns, None if is_gaia else best_set


def _resolve_names(columns, names, names_by_form):
    """Columns with one name a role: that of the table where it has one of those wanted, in pairs."""
    replacements: dict[str, Any] = {}
    for roles in _PAIRS:
        candidate_lists = [list_candidates(getattr(columns, role)) for role in roles]
        present = [[_match_name(name, names, names_by_form) for name in candidates] for candidates in candidate_lists]
        pairs = zip(*present, strict=True) if len(present[0]) == len(present[1]) else ()
        best_pair = next((pair for pair in pairs if all(pair)), None)
        best_pair = best_pair or tuple(next(filter(None, matches), None) for matches in present)
        for role, name, candidates in zip(roles, best_pair, candidate_lists, strict=True):
            replacements[role] = name or (candidates[0] if candidates else getattr(columns, role))
    pm_affixes, ra_affixes = find_affixes(replacements.get("pmra"), "pmra"), find_affixes(replacements.get("ra"), "ra")
    for role in Columns.__dataclass_fields__:
        candidates = getattr(columns, role)
        if role not in REQUIRED and isinstance(candidates, tuple):
            base_names = [name for name in candidates if name not in _CASE_SENSITIVE]
            # In joined tables those of the motions come first; flags may have the suffix of the positions.
            if any(pm_affixes):
                candidates = (*(name.join(pm_affixes) for name in base_names), *candidates)
            if any(ra_affixes) and role in ("solution", "quality"):
                candidates = (*candidates, *(name.join(ra_affixes) for name in base_names))
            name = next(filter(None, (_match_name(candidate, names, names_by_form) for candidate in candidates)), None)
            replacements[role] = (name, *candidates) if name else getattr(columns, role)
    redshifts = list_candidates(replacements.get("redshift", columns.redshift))
    if isinstance(columns.redshift_error, tuple) and not any(name in names for name in redshifts):
        replacements["redshift_error"] = None  # what has no redshift has no error of one
    return replace(columns, **replacements)


def find_affixes(name: Any, role: str) -> tuple[str, str]:
    """The text before and after a role in the name of its column, as joined tables have it: pmra_2, gaia_ra."""
    before, separator, after = str(name or "").partition(role)
    return (before, after) if separator else ("", "")


def list_candidates(names: Any) -> tuple[str, ...]:
    """The names that a role may have, of one, of several or of none."""
    return (names,) if isinstance(names, str) else names or ()


def _index_names_by_form(names):
    """Names as they are compared where no name is the same."""
    names_by_form: dict[str, list[str]] = {}
    for name in names:
        names_by_form.setdefault(_normalize_name(name), []).append(name)
    return names_by_form


def _normalize_name(name):
    """A name without its unit, case and what stands between words: PM RA (mas/yr), pm-ra and pmRA are one."""
    return re.sub(r"(?<=\w)[\s_.-]+(?=\w)", "", split_name_and_unit(name)[0].lower())


#: Names that are found as they are written alone: Z is a coordinate or a metallicity, and E_Z an energy.
_CASE_SENSITIVE = ("z", "z_error", "e_z", "z_err", "zerr")


def _match_name(name, names, names_by_form):
    """The name as the table has it: as it is, or the only one that is compared alike; or None."""
    if name in names:
        return name
    matches = [] if name in _CASE_SENSITIVE else names_by_form.get(_normalize_name(name), [])
    return matches[0] if len(matches) == 1 else None


def find_correlation_columns(source: TableSource) -> list[str]:
    """Columns that may be the correlation of the proper motions, by their names."""
    return [name for name in source.names if _CORRELATION.search(name) and not _OF_PARALLAX.search(name)]


_MOTION, _ERROR = re.compile("pm|mu"), re.compile("err|sig|unc|std|^e_|_e$")
_LONGITUDE = re.compile("(?<![a-z])(ra(?![dntw])|l(?![a-z]))|alpha|lon")
_LATITUDE = re.compile("(?<![a-z])(de(?![fgnprt])|b(?![a-z]))|delta|lat")


def guess_missing_columns(column_of: Mapping[str, str], names: Iterable[str]) -> dict[str, str]:
    """Guess, for a question, the columns of the roles that none is known for."""
    guesses = dict(column_of)
    kinds = {name: _classify_name(name.lower()) for name in names}
    for role in REQUIRED:
        unused = [name for name, kind in kinds.items() if kind == _classify_name(role) and name not in guesses.values()]
        if role not in guesses and unused:
            like = guesses.get(role.removesuffix("_error") if role.endswith("error") else role.replace("dec", "ra"), "")
            guesses[role] = max(unused, key=lambda name: (SequenceMatcher(None, like, name).ratio(), -len(name)))
    return {role: name for role, name in guesses.items() if role not in column_of}


def _classify_name(name):
    """Return whether a name is of a motion, of an error and of a longitude; None where it tells no single axis."""
    axis = re.sub("^.*?(pm|mu)_?", "", name)
    is_longitude, is_latitude = (bool(pattern.search(axis)) for pattern in (_LONGITUDE, _LATITUDE))
    if is_longitude == is_latitude:
        return None
    return bool(_MOTION.search(name)), bool(_ERROR.search(name)), is_longitude


_ELLIPSES = (("pm_err_maj", "pm_err_min", "pm_err_angle"), ("PM_ERR_MAJA", "PM_ERR_MINA", "PM_ERR_ANGLE"))


@lru_cache
def find_derivable_columns(names: tuple[str, ...]) -> dict[str, tuple[str, ...]]:
    """The columns that can be made of those of a table, and of which: errors of two sides, error ellipses."""
    present = set(names)
    bases = [name[:-3] for name in names if name.endswith("_em")]
    asymmetric_errors = {f"{base}_error": (f"{base}_em", f"{base}_ep") for base in bases if f"{base}_ep" in present}
    ellipse = next((candidate for candidate in _ELLIPSES if present.issuperset(candidate)), None)
    ellipse_columns = dict.fromkeys(("pmra_error", "pmdec_error", "pmra_pmdec_corr"), ellipse) if ellipse else {}
    inverse_variances = {f"{name}^-1/2": (name,) for name in names if name in ("PMRA_IVAR", "PMDEC_IVAR")}
    derivable = asymmetric_errors | ellipse_columns | inverse_variances
    return {name: inputs for name, inputs in derivable.items() if name not in present}


def add_derived_columns(source: TableSource) -> TableSource:
    """A table with the columns that can be made of its own: of errors of two sides, ellipses, inverse variances."""
    derived_columns = find_derivable_columns(source.names)
    if not derived_columns:
        return source
    recipes: dict[str, Any] = {}
    notes = []
    for name, inputs in derived_columns.items():
        unit = None if name == "pmra_pmdec_corr" else source.units.get(inputs[0])
        if len(inputs) == 1:
            recipes[name] = inputs, lambda values: 1 / np.sqrt(values), _derive_error_unit(unit)
            continue
        recipes[name] = inputs, partial(_derive_from_ellipse, name) if len(inputs) == 3 else _take_larger_error, unit
    if asymmetric_errors := [
        name
        for name, inputs in derived_columns.items()
        if len(inputs) == 2 and name[:-6] in ("pmra", "pmdec", "distance")
    ]:
        notes.append(f"of errors of two sides the larger is taken: {', '.join(asymmetric_errors)}")
    if ellipse := next((inputs for inputs in derived_columns.values() if len(inputs) == 3), None):
        notes.append(f"errors and correlations of the motions by the ellipses {', '.join(ellipse)}")
    return derive_columns(source, recipes, notes)


def derive_columns(source: TableSource, recipes: Mapping[str, Any], notes: Iterable[str] = ()) -> TableSource:
    """A table with further columns: name → (the columns it is made of, function of their values, unit)."""

    def read_blocks(names, rows):
        inputs = [name for column in names if column in recipes for name in recipes[column][0]]
        source_names = tuple(dict.fromkeys([name for name in names if name not in recipes] + inputs))
        for block in source.blocks(source_names or source.names[:1], rows):
            n = len(next(iter(block.values()))[0])
            yield {name: _apply_recipe(recipes[name], block, n) if name in recipes else block[name] for name in names}

    units = source.units | {name: unit for name, (_, _, unit) in recipes.items() if unit}
    names = (*source.names, *(name for name in recipes if name not in source.names))
    return replace(source, names=names, read=read_blocks, units=units, notes=(*source.notes, *notes))


def _apply_recipe(recipe, block, n_rows):
    inputs, function, _ = recipe
    masks = [block[name][1] for name in inputs if block[name][1] is not None]
    with np.errstate(all="ignore"):
        numbers = [floats_or_nan(name, np.asarray(block[name][0])) for name in inputs]
        values = np.broadcast_to(function(*numbers), n_rows).copy()
    return values, np.logical_or.reduce(masks) if masks else None


def _derive_error_unit(unit):
    """The unit of an error, from that of its inverse variance."""
    if not unit:
        return None
    from astropy.units import Unit

    try:
        return (Unit(str(unit)) ** -0.5).to_string()
    except (ValueError, TypeError):
        return None


def _take_larger_error(minus_error, plus_error):
    return np.maximum(np.abs(minus_error), np.abs(plus_error))


def _derive_from_ellipse(name, major, minor, angle):
    """The error or correlation that an ellipse is; its major axis points `angle` degrees from north through east."""
    sin, cos = np.sin(np.radians(angle)), np.cos(np.radians(angle))
    east, north = np.hypot(major * sin, minor * cos), np.hypot(major * cos, minor * sin)
    cross = (major**2 - minor**2) * sin * cos
    return {"pmra_error": east, "pmdec_error": north, "pmra_pmdec_corr": cross / (east * north)}[name]
