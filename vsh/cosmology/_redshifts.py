"""Which sources have a redshift that can be used, and what is said of the others."""

from __future__ import annotations

import numpy as np

from vsh.errors import FieldError
from vsh.field import Field
from vsh.types import ArrayLike, BoolArray

#: Below this redshift a source moves with its neighbours, not with the expansion.
FLOW_LIMIT = 1e-4


def usable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> BoolArray:
    """Which redshifts are finite, positive and at least `min_redshift`: a mask.

    Parameters
    ----------
    redshift : (n,) array
        One for each source.
    min_redshift : float
        The smallest redshift of use.

    Returns
    -------
    mask
    """
    redshift = np.asarray(redshift, float)
    return np.isfinite(redshift) & (redshift > 0) & (redshift >= min_redshift)


def count_unusable(redshift: ArrayLike, min_redshift: float = FLOW_LIMIT) -> str:
    """How many redshifts cannot be used, and why, in words.

    Parameters
    ----------
    redshift : (n,) array
        One for each source.
    min_redshift : float
        The smallest redshift of use.

    Returns
    -------
    str

    Examples
    --------
    >>> count_unusable([np.nan, 0.0, -0.1, 5e-5, 0.1])
    '1 missing, 2 zero or negative, 1 below 0.0001'
    """
    redshift = np.asarray(redshift, float)
    counts = {
        "missing": int((~np.isfinite(redshift)).sum()),
        "zero or negative": int((np.isfinite(redshift) & (redshift <= 0)).sum()),
        f"below {min_redshift:g}": int(((redshift > 0) & (redshift < min_redshift)).sum()),
    }
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count)


def with_redshift(field: Field, min_redshift: float = FLOW_LIMIT) -> Field:
    """The sources of a field whose redshift can be used; a note counts the others and names the first.

    Parameters
    ----------
    field : Field
        The sources.
    min_redshift : float
        The smallest redshift of use.

    Returns
    -------
    Field

    Raises
    ------
    FieldError
        If the field has no redshifts, or none that can be used.
    """
    if field.redshift is None:
        raise FieldError("these sources have no redshifts: the table needs a column of them (--columns redshift=NAME)")
    good = usable(field.redshift, min_redshift)
    if good.all():
        return field
    said = f"{(~good).sum()} of {len(field)} sources without a usable redshift: {count_unusable(field.redshift, min_redshift)}"
    if not good.any():
        raise FieldError(f"{said}. No source is left")
    named = ""
    if field.name is not None:
        first = [str(name) for name in field.name[~good][:5]]
        named = f" ({', '.join(first)}{', …' if (~good).sum() > 5 else ''})"
    return field[good].add_note(f"left out {said}{named}")
