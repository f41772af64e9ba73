"""What the errors of a joint solution are like: their size by magnitude and place, and what neighbours share."""

import numpy as np

from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, IntArray

#: Up to which angle neighbours are looked up; beyond, pairs with some of the sources are enough. [rad]
_NEAR = 0.03
_PIVOTS, _ROWS = 2000, 200


def correlation_by_angle(
    errors: ArrayLike, lon: ArrayLike, lat: ArrayLike, edges: ArrayLike, *, sigma: ArrayLike | None = None
) -> tuple[FloatArray, IntArray]:
    """Correlation of the errors of one parameter, in bins of the angle between two sources.

    Notes
    -----
    Bins below 1.7° use all pairs, others those with at most 2000 of the sources, evenly picked.
    """
    lon, lat, edges = (arguments.dimension(1)(*each) for each in (("lon", lon), ("lat", lat), ("edges", edges)))
    scaled = np.atleast_2d(arguments.float_array("errors", errors))
    if scaled.shape[1:] != lon.shape or lat.shape != lon.shape:
        raise ParameterError(f"errors have shape {scaled.shape}, expected (draws, {len(lon)})")
    if len(edges) < 2 or (np.diff(edges) <= 0).any():
        raise ParameterError("edges of bins of angle must rise")
    if sigma is None:
        if len(scaled) < 10:
            raise ParameterError(f"{len(scaled)} draws do not tell the size of errors: give sigma")
        sigma = np.sqrt(np.mean(scaled**2, axis=0))
    scaled = scaled / arguments.float_array("sigma", sigma, lon.shape)
    place = triad(lon, lat)[2].T
    total, pairs = np.zeros(len(edges) - 1), np.zeros(len(edges) - 1, int)

    def count(angle, product):
        where = np.searchsorted(edges, angle, side="right") - 1
        inside = (where >= 0) & (where < len(total))
        total[:] += np.bincount(where[inside], product[inside], len(total))
        pairs[:] += np.bincount(where[inside], minlength=len(total))

    near = edges[-1] <= _NEAR
    if near:
        from scipy.spatial import cKDTree  # slow to import

        first, second = cKDTree(place).query_pairs(2 * np.sin(edges[-1] / 2), output_type="ndarray").T
        chord = np.linalg.norm(place[first] - place[second], axis=1)
        count(2 * np.arcsin(chord / 2), np.mean(scaled[:, first] * scaled[:, second], axis=0))
    else:
        pivots = np.unique(np.linspace(0, len(lon) - 1, min(_PIVOTS, len(lon))).astype(int))
        for start in range(0, len(pivots), _ROWS):
            some = pivots[start : start + _ROWS]
            product = scaled[:, some].T @ scaled / len(scaled)
            angle = np.arccos(np.clip(place[some] @ place.T, -1, 1))
            angle[np.arange(len(some)), some] = np.inf  # not with itself
            count(angle.ravel(), product.ravel())
    return np.divide(total, pairs, out=np.full(len(total), np.nan), where=pairs > 0), pairs


def ratio_by(
    errors: ArrayLike, sigma: ArrayLike, group: ArrayLike, n_groups: int | None = None
) -> tuple[FloatArray, IntArray]:
    """True over formal errors of groups of sources: the rms of error over standard error."""
    labels: IntArray = _groups(group)
    values = np.atleast_2d(arguments.float_array("errors", errors))
    if values.shape[1:] != labels.shape:
        raise ParameterError(f"errors of {values.shape[-1]} sources, and groups of {labels.size}")
    square = np.mean((values / arguments.float_array("sigma", sigma, labels.shape)) ** 2, axis=0)
    used = labels >= 0
    counts = np.bincount(labels[used], minlength=n_groups or 0)
    total = np.bincount(labels[used], square[used], len(counts))
    return np.sqrt(np.divide(total, counts, out=np.full(len(counts), np.nan), where=counts > 0)), counts


def _groups(group):
    dimension = arguments.dimension(1)("group", group)
    if not (np.isfinite(dimension).all() and (dimension == np.floor(dimension)).all() and (dimension < 1e9).all()):
        raise ParameterError("groups are whole numbers")
    return dimension.astype(int)
