"""Which sources have a redshift that can be used, and what is said of the others."""

from __future__ import annotations

import numpy as np

from vsh.field import Field
from vsh.models.cosmology._apex import to_cmb
from vsh.sky.redshift_frames import check_redshift_frame
from vsh.tools.errors import FieldError, NothingLeftError
from vsh.tools.notes import WithoutRedshift
from vsh.tools.types import ArrayLike, BoolArray

#: Below this redshift a source moves with its neighbours, not with the expansion.
FLOW_LIMIT = 1e-4


def usable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> BoolArray:
    """Which redshifts are finite, positive and at least `min_redshift`: a mask."""
    redshift = np.asarray(redshift, float)
    return np.isfinite(redshift) & (redshift > 0) & (redshift >= min_redshift)


def count_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> str:
    """How many redshifts cannot be used, and why, in words.

    Examples
    --------
    >>> count_unusable([np.nan, 0.0, -0.1, 5e-5, 0.1])
    '1 missing, 2 zero or negative, 1 below 0.0001'
    """
    counts = reasons_unusable(redshift, min_redshift)
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)


def reasons_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> dict[str, int]:
    """How many redshifts cannot be used, by reason."""
    redshift = np.asarray(redshift, float)
    return {
        "missing": int((~np.isfinite(redshift)).sum()),
        "zero or negative": int((np.isfinite(redshift) & (redshift <= 0)).sum()),
        f"below {min_redshift:g}": int(((redshift > 0) & (redshift < min_redshift)).sum()),
    }


def with_redshift(field: Field, min_redshift: float = FLOW_LIMIT, redshift_frame: str | None = None) -> Field:
    """The sources of a field whose redshift can be used; a note counts the others and names the first.

    Where it is known in which frame the redshifts stand, those at rest in the microwave background count.

    Parameters
    ----------
    field : Field
        The sources.
    min_redshift : float
        The smallest redshift of use.
    redshift_frame : str, optional
        The field's own unless given.

    Raises
    ------
    FieldError
        If the field has no redshifts, or none that can be used.
    """
    if field.redshift is None:
        raise FieldError("these sources have no redshifts: the table needs a column of them (--columns redshift=NAME)")
    frame = redshift_frame or field.redshift_frame
    redshift = np.asarray(field.redshift)
    if frame is not None:
        redshift = to_cmb(redshift, field.lon, field.lat, field.frame, check_redshift_frame(frame))
    good = usable(redshift, min_redshift)
    if good.all():
        return field
    bad = ~good
    names = () if field.name is None else tuple(str(name) for name in field.name[bad][:5])
    reasons = reasons_unusable(redshift, min_redshift)
    note = WithoutRedshift.of_table(reasons, len(field), field.lon, field.redshift, names=names)
    if bad.all():
        error = NothingLeftError(f"{bad.sum()} of {len(field)} sources without a usable redshift: "
                                 f"{count_unusable(redshift, min_redshift)}. No source is left")  # fmt: skip
        error.notes = (note,)
        raise error
    return field[good].add_note(note)
