"""In which field of view a source was seen: the code of `transit_id`, decided by the times between transits.

Bits 15 and 16 of a transit_id tell the field of view. A draft of the numbering (GAIA-C3-TN-UB-JP-011, p. 9) has 1 for
the preceding one and 2 for the following one; the published epochs of Gaia BH3 have 0 and 1. Gaia turns once in six
hours, and its fields are 106.5° apart: a source is seen 106.5 minutes after the preceding field in the following one,
and 253.5 minutes after that in the preceding one again.
"""

from typing import Any

import numpy as np

#: From the preceding field to the following one, and back [minutes]; and by how much a pair may be off.
_SHORT, _LONG, _CLOSE = 106.5, 253.5, 4.0
#: Codes of the preceding and of the following field where times decide nothing.
_KNOWN = {(0, 1): "as in the epochs of Gaia BH3", (1, 2): "as in the draft of DR4's data model"}


def views_of(transit: Any, source: Any, time: Any) -> tuple[Any, str | None]:
    """Find the field of view of each observation.

    Parameters
    ----------
    transit : (k,) int array
        transit_id.
    source : (k,) array
        Source of each observation.
    time : (k,) array
        [ns]

    Returns
    -------
    view : (k,) int array or None
        +1 the preceding field, −1 the following one; None where it cannot be told.
    note : str or None
        How it was decided.
    """
    code = (np.asarray(transit, np.int64) >> 15) & 3
    codes = tuple(int(each) for each in np.unique(code))
    if len(codes) > 2:
        return None, (
            f"transit_id has the codes {', '.join(map(str, codes))} in bits 15 and 16, more than there are fields of "
            "view: it is not taken from there"
        )
    first, last, gap = _neighbours(transit, source, time)
    near_short, near_long = np.abs(gap - _SHORT) < _CLOSE, np.abs(gap - _LONG) < _CLOSE
    # Which code comes first of a short pair, or last of a long one, is that of the preceding field.
    leading = np.r_[code[first[near_short]], code[last[near_long]]]
    trailing = np.r_[code[last[near_short]], code[first[near_long]]]
    apart = leading != trailing
    if apart.any():
        values, counts = np.unique(leading[apart], return_counts=True)
        preceding, agreeing = int(values[counts.argmax()]), int(counts.max())
        if agreeing < 0.9 * len(leading):
            return None, (
                f"transit_id contradicts the times between transits in {len(leading) - agreeing} of {len(leading)} "
                "pairs: the field of view is not taken from there"
            )
        words = (
            f"fields of view: code {preceding} of transit_id is the preceding one, by {agreeing} of {len(leading)} "
            "pairs of transits 106.5 or 253.5 minutes apart"
        )
        return np.where(code == preceding, 1, -1), words
    if codes in _KNOWN:
        return np.where(code == codes[0], 1, -1), (
            f"fields of view: code {codes[0]} of transit_id is taken for the preceding one, {_KNOWN[codes]}; no two "
            "transits are near enough to tell"
        )
    if codes in ((0,), (2,)):
        return np.full(len(code), 1 if codes == (0,) else -1), (
            f"fields of view: all transits have code {codes[0]} of transit_id, taken for the "
            f"{'preceding' if codes == (0,) else 'following'} one"
        )
    return None, (
        f"transit_id has code {' and '.join(map(str, codes))} alone in bits 15 and 16, which is the preceding field of "
        "view by one numbering and the following one by another: it is not taken from there"
    )


def _neighbours(transit, source, time):
    """Observations of each source's transits and of the next one, and the time between them. [minutes]"""
    order = np.lexsort([time, source])
    new = np.ones(len(order), bool)
    new[1:] = (np.diff(np.asarray(transit)[order]) != 0) | (source[order][1:] != source[order][:-1])
    at = order[new]
    same = source[at][1:] == source[at][:-1]
    gap = np.diff(time[at]) / 6e10
    return at[:-1][same], at[1:][same], gap[same]
