"""HEALPix maps in files (healpy)."""

import warnings

import numpy as np

from vsh.io.tables import fits_checked
from vsh.tools.arguments import explained
from vsh.tools.errors import TableError, first_line
from vsh.tools.printing import printable
from vsh.tools.types import FloatArray, PathName

__all__ = ["read_map"]


@explained
def read_map(path: PathName) -> tuple[FloatArray, str | None]:
    """A HEALPix map from a FITS file, in ring order, and the frame its header names (or None).

    Parameters
    ----------
    path : str or Path
        The file.

    Raises
    ------
    TableError
        If the file cannot be read, is damaged, or holds no map.
    """
    label = printable(path)
    try:
        import healpy
    except ImportError as error:
        raise TableError(f"{label}: maps need healpy, which is not installed; there is none for Windows") from error
    with fits_checked(path, label) as plain:
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                values, header = healpy.read_map(plain, h=True)
        except Exception as error:  # whatever a damaged file makes of healpy
            raise TableError(f"{label} cannot be read as a HEALPix map: {first_line(error)}") from error
    values = np.asarray(values)
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        raise TableError(f"{label} cannot be read as a HEALPix map: it holds {values.ndim} maps of {values.dtype}")
    frames = {"C": "icrs", "G": "galactic", "E": "ecliptic", "ICRS": "icrs", "GALACTIC": "galactic"}
    named = str(dict(header).get("COORDSYS", "")).strip().upper()
    return values, frames.get(named)
