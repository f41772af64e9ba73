"""A part of the rows that depends on what they hold and not on where they stand."""

import numpy as np

from vsh.tools.types import BoolArray, FloatArray


def select_share(share: float, *columns: FloatArray, draw: int = 0) -> BoolArray:
    """Select about a share of the rows by their values alone.

    Every k-th row is a sample of the order of a table, which may be that of two lists merged row by row. This
    selection is the same for each order of the rows and each division into parts.

    Parameters
    ----------
    share : float
        A fraction from 0 to 1.
    *columns : (n,) arrays
        What a row is known by: positions, say.
    draw : int
        Draws of different numbers are independent: a share of what was selected by the same would be all of it.

    Returns
    -------
    (n,) bool array
        Rows with the same values are selected together.

    Examples
    --------
    >>> x = np.random.default_rng(1).normal(size=10_000)
    >>> round(float(select_share(0.25, x).mean()), 2)
    0.25
    """
    bits = np.full(len(columns[0]), draw, np.uint64)
    for column in columns:  # splitmix64 of the numbers, one after the other
        bits = bits + np.ascontiguousarray(column, np.float64).view(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
        for shift, factor in ((30, 0xBF58476D1CE4E5B9), (27, 0x94D049BB133111EB)):
            bits = (bits ^ (bits >> np.uint64(shift))) * np.uint64(factor)
        bits ^= bits >> np.uint64(31)
    return np.asarray(bits >> np.uint64(11), float) < share * 2.0**53
