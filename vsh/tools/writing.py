"""Tables into files: columns, units and provenance, written whole or not at all (astropy.table)."""

import gzip
import json
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import vsh
from vsh.tools.arguments import explained
from vsh.tools.errors import ParameterError, TableError
from vsh.tools.files import MARK, atomic_write
from vsh.tools.formats import BY_KIND, PACKED, WRITTEN
from vsh.tools.printing import printable
from vsh.tools.types import PathName, Table

#: In the metadata of every table that is written: by what.
CREATOR = "CREATOR"


def format_of(path: PathName, known: Mapping[str, str] = WRITTEN) -> str:
    """astropy's name of the format that the ending of a name tells; TableError where it tells none."""
    path = Path(path)
    suffixes = [suffix.lower() for suffix in path.suffixes]
    packed = PACKED[:1] if known is WRITTEN else PACKED
    if suffixes and suffixes[-1] in packed:
        suffixes.pop()
    if not suffixes or suffixes[-1] not in known:
        raise TableError(
            f"{printable(path)}: unrecognised format. Known endings: {', '.join(known)}, each also with "
            f"{', '.join(packed)}"
        )
    return known[suffixes[-1]]


def table_of(
    columns: Mapping[str, Any], meta: dict[str, Any] | None = None, units: Mapping[str, str] | None = None
) -> Table:
    """Return an astropy Table of named columns, with metadata and units."""
    from astropy.table import Table

    table = Table({name: np.asarray(values) for name, values in columns.items()}, meta=meta or {})
    for name, unit in (units or {}).items():
        table[name].unit = unit
    return table


def write(
    path: PathName,
    columns: Mapping[str, Any],
    meta: dict[str, Any] | None = None,
    units: Mapping[str, str] | None = None,
) -> None:
    """Write columns as a table to `path`; the file has this name only once it is complete."""
    write_table(table_of(columns, meta, units), path)


@explained
def write_table(table: Table, path: PathName, meta: dict[str, Any] | None = None) -> None:
    """Write an astropy Table with more metadata to `path`; the file has this name only once it is complete."""
    if not hasattr(table, "colnames"):
        raise ParameterError(f"table must be an astropy Table, not {type(table).__name__}")
    path = Path(path)
    check_writable(path)
    metadata = {CREATOR: f"{MARK} {vsh.__version__}"}
    metadata |= {key: value for key, value in table.meta.items() if key != CREATOR}
    table = table.copy(copy_data=False)
    table.meta = type(table.meta)(_plain(metadata | (meta or {})))
    kind = format_of(path)
    with atomic_write(path) as new, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # astropy warns about units that a format spells in its own way
        if kind == "votable":
            _write_votable(table, new)
        elif kind == "hdf5":
            table.write(new, format=kind, path="table", serialize_meta=True, overwrite=True)
        else:
            table.write(new, format=kind, overwrite=True)
        if kind.startswith("ascii") and path.suffix.lower() == ".gz":  # astropy compresses FITS and VOTables alone
            new.write_bytes(gzip.compress(new.read_bytes(), mtime=0))


def _plain(value: Any) -> Any:
    """Metadata with subclasses of str, such as counted notes, as the str that YAML can represent."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return str(value) if isinstance(value, str) else value


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


def _write_votable(table, path):
    """A VOTable with metadata as parameters, which astropy's own writer leaves out: lists and dicts as JSON."""
    from astropy.io.votable import from_table
    from astropy.io.votable.tree import Param

    document = from_table(table)
    element = document.get_first_table()
    for entry in element.fields:
        entry.ucd = UCDS.get(str(entry.name))
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


def check_writable(path: PathName) -> None:
    """Raise TableError now if a table could not be written to `path` later."""
    path = Path(path)
    kind = format_of(path)
    if not path.absolute().parent.is_dir():
        raise TableError(f"{printable(path)}: there is no such folder")
    library = {"parquet": "pyarrow", "hdf5": "h5py"}.get(kind)
    if library:
        if path.suffix.lower() == ".gz":
            title = BY_KIND[kind].title
            raise TableError(f"{printable(path)}: {title} is compressed by itself: leave out the .gz")
        from importlib.util import find_spec

        if find_spec(library) is None:
            raise TableError(
                f"{printable(path)} cannot be written. Install what is missing: pip install 'vsh-astrometry[{kind}]'"
            )
