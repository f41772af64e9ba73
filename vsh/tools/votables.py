"""VOTables as the IVOA defines them: UCDs, coordinate frame and epoch, time scale, and metadata as parameters."""

import json
from pathlib import Path

import numpy as np

from vsh.tools.types import Table

#: What columns are, in the words of the IVOA (UCD1+ controlled vocabulary 1.5).
UCDS = {
    "source_id": "meta.id;meta.main", "name": "meta.id;meta.main", "ra": "pos.eq.ra;meta.main",
    "dec": "pos.eq.dec;meta.main", "pmra": "pos.pm;pos.eq.ra", "pmdec": "pos.pm;pos.eq.dec",
    "pmra_error": "stat.error;pos.pm;pos.eq.ra", "pmdec_error": "stat.error;pos.pm;pos.eq.dec",
    "pmra_pmdec_corr": "stat.correlation;pos.pm;pos.eq.ra;pos.pm;pos.eq.dec", "phot_g_mean_mag": "phot.mag;em.opt",
    "redshift": "src.redshift", "redshift_error": "stat.error;src.redshift", "distance": "pos.distance",
    "distance_error": "stat.error;pos.distance", "parallax": "pos.parallax",
    "parallax_error": "stat.error;pos.parallax", "parameter": "meta.id", "value": "stat.fit.param",
    "sigma": "stat.error;stat.fit.param", "covariance": "stat.covariance", "correlation": "stat.correlation",
}  # fmt: skip
#: Columns of positions and motions, and of times, in the order of barycentric coordinate time since 2010 (Gaia DR4).
_ON_THE_SKY = ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "lon", "lat")
_TIMES = ("obs_time_tcb",)
#: IVOA's names of the frames (COOSYS of VOTable 1.4), and the Julian date (TCB) that DR4's times are counted from.
_SYSTEMS = {"icrs": "ICRS", "galactic": "galactic", "ecliptic": "ecl_FK5"}
_DR4_ORIGIN = 2455197.5
_UCD_OF_FRAME = {
    "galactic": {"pos.eq.ra": "pos.galactic.lon", "pos.eq.dec": "pos.galactic.lat"},
    "ecl_FK5": {"pos.eq.ra": "pos.ecliptic.lon", "pos.eq.dec": "pos.ecliptic.lat"},
}
#: Names within the file that no column and no parameter has.
_FRAME, _TIME = "vsh_frame", "vsh_time"


def write_votable(table: Table, path: Path) -> None:
    """Write a VOTable 1.4, its metadata as parameters, which astropy leaves out: lists and dicts as JSON."""
    from astropy.io.votable import from_table
    from astropy.io.votable.tree import Param

    document = from_table(table)
    document.version = "1.4"
    element = document.get_first_table()
    for entry in element.fields:
        entry.ucd = UCDS.get(str(entry.name))
        entry.unit = _standard_unit(entry.unit)
        if entry.arraysize == "1" and entry.datatype in ("char", "unicodeChar"):
            entry.arraysize = "*"  # a single character has no array size since erratum 3 of VOTable 1.3
    _add_systems(document, element, table.meta)
    for key, value in table.meta.items():
        options = {"datatype": "unicodeChar", "arraysize": "*"}
        if isinstance(value, (list, tuple, dict)):
            value = json.dumps(value, ensure_ascii=False, default=str)
        elif isinstance(value, (int, np.integer)) and not isinstance(value, bool) and abs(int(value)) < 2**63:
            options = {"datatype": "long"}
        elif isinstance(value, (float, np.floating)):
            options = {"datatype": "double"}
        elif value is None:
            continue
        else:
            value = str(value)
        element.params.append(Param(document, name=key, value=value, **options))
    # The compiled writer writes beyond its buffer where the text of a row just fills it (astropy issue 20419).
    document.to_xml(str(path), _debug_python_based_parser=True)
    if not len(table):  # astropy leaves the data out; STILTS then finds no table
        text = path.read_text(encoding="utf-8")
        path.write_text(text.replace("</TABLE>", "<DATA><TABLEDATA/></DATA></TABLE>"), encoding="utf-8")


def _standard_unit(unit):
    """A unit in the words of VOUnit, which knows uarcsec and not uas."""
    from astropy.units import CompositeUnit, uarcsec, uas

    if unit is None or uas not in unit.bases:
        return unit
    bases = [uarcsec if base == uas else base for base in unit.bases]
    return CompositeUnit(unit.scale, bases, unit.powers)


def _add_systems(document, element, meta):
    """State the coordinate frame, its epoch where it is known, and the time scale of a VOTable."""
    from astropy.io.votable.tree import CooSys, TimeSys

    resource = document.resources[0]
    sky_columns = [column for column in element.fields if column.name in _ON_THE_SKY]
    facts = {str(key).upper(): value for key, value in meta.items()}
    if sky_columns:
        epoch = facts.get("REF_EPOCH") or facts.get("EPOCH")
        system = _SYSTEMS.get(str(facts.get("FRAME", "icrs")).lower(), "ICRS")
        options = {"epoch": f"J{float(epoch):.3f}"} if isinstance(epoch, (int, float)) else {}
        config = {"version_1_2_or_later": True, "version_1_4_or_later": True}
        resource.coordinate_systems.append(CooSys(ID=_FRAME, system=system, config=config, **options))
        axes = _UCD_OF_FRAME.get(system, {})
        for column in sky_columns:
            column.ref = _FRAME
            for ours, theirs in axes.items():
                column.ucd = column.ucd and column.ucd.replace(ours, theirs)
    times = [column for column in element.fields if column.name in _TIMES]
    if times:
        config = {"version_1_4_or_later": True}
        resource.time_systems.append(TimeSys(ID=_TIME, timeorigin=_DR4_ORIGIN, timescale="TCB",
                                             refposition="BARYCENTER", config=config))  # fmt: skip
        for column in times:
            column.ref = _TIME
