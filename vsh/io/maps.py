"""HEALPix maps in files (healpy)."""

import warnings

import numpy as np

from vsh.field import Field
from vsh.io.tables import as_table_error, open_checked_fits
from vsh.sky.pixels import centres, is_valueless
from vsh.tools.arguments import positive
from vsh.tools.errors import TableError
from vsh.tools.printing import printable
from vsh.tools.types import FloatArray, PathName

__all__ = ["read_density", "read_map"]


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
    error_context = as_table_error(f"{label} cannot be read as a HEALPix map")
    with open_checked_fits(path, label) as unpacked_path, error_context, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        values, header = healpy.read_map(unpacked_path, h=True)
    values = np.asarray(values)
    if values.ndim != 1 or values.dtype.kind not in "fiu":
        raise TableError(f"{label} cannot be read as a HEALPix map: it holds {values.ndim} maps of {values.dtype}")
    coordinate_system = str(dict(header).get("COORDSYS", "")).strip().upper()
    return values, _FRAME_OF_SYSTEM.get(coordinate_system)


#: What headers of maps call the axes.
_FRAME_OF_SYSTEM = {
    "C": "icrs", "ICRS": "icrs", "CELESTIAL": "icrs", "EQUATORIAL": "icrs", "EQ": "icrs", "RADEC": "icrs",
    "G": "galactic", "GAL": "galactic", "GALACTIC": "galactic",
    "E": "ecliptic", "ECL": "ecliptic", "ECLIPTIC": "ecliptic",
}  # fmt: skip


def read_map_with_frame(path: PathName, frame: str | None, remedy: str) -> tuple[FloatArray, str]:
    """A HEALPix map and its frame: the one given, or that of its header; without either it is asked for."""
    values, header_frame = read_map(path)
    if frame is None and header_frame is None:
        raise TableError(f"{printable(path)} does not state its frame, and maps are often Galactic: say {remedy}")
    return values, str(frame or header_frame)


def read_density(path: PathName, sigma: float = 1000.0, frame: str | None = None) -> Field:
    """A HEALPix map of numbers of sources as a field: one source per pixel, with the weight of those in it.

    Parameters
    ----------
    path : str or Path
        A map whose values are proportional to the number of sources in each pixel.
    sigma : float
        Error of each of these sources. [µas/yr]
    frame : str, optional
        Frame of the map, where its header does not state it.

    Returns
    -------
    Field
        Positions are the centres of the pixels with sources, motions are zero, errors are ``sigma`` divided by the
        square root of the number of sources.

    Raises
    ------
    TableError
        If the file is no map, a value is negative, all are zero, or the frame is not known.
    """
    values, frame = read_map_with_frame(path, frame, "frame='galactic' (--columns frame=galactic), or which it is")
    label = printable(path)
    has_no_value = is_valueless(values)
    if (values[~has_no_value] < 0).any():
        raise TableError(f"{label}: {(values[~has_no_value] < 0).sum()} pixels have a negative number of sources")
    has_sources = ~has_no_value & (values > 0)
    if not has_sources.any():
        raise TableError(f"{label}: no pixel has sources")
    lon, lat = (axis[has_sources] for axis in centres(round(np.sqrt(values.size / 12)), any_size=True))
    pixel_errors = np.broadcast_to(positive("sigma", sigma) / np.sqrt(values[has_sources]), (2, lon.size))
    notes = [
        f"a map of densities: {has_sources.sum()} pixels with {values[has_sources].sum():.6g} sources, each of "
        f"{sigma:g} µas/yr"
    ]
    if has_no_value.any():
        notes.append(f"{has_no_value.sum()} of {values.size} pixels of the map have no value and count as empty")
    return Field(lon, lat, np.zeros((2, lon.size)), pixel_errors, frame=frame, notes=tuple(notes))
