"""The frames in which redshifts stand, by name, and how tables say them."""

from __future__ import annotations

import re
from typing import Any

from vsh.tools.errors import ParameterError

#: Redshifts of the expansion alone, without anybody's velocity: those of simulations.
TRUE = "true"
#: Where a table's metadata keep the frame of its redshifts.
REDSHIFT_FRAME_KEY = "ZFRAME"
#: Of observers: the Sun's, one at rest in the microwave background, one in the Local Group.
REDSHIFT_FRAME_NAMES = ("heliocentric", "cmb", "local-group", TRUE)
_WORDS = (
    (re.compile(r"helioc|baryc|geoc", re.IGNORECASE), "heliocentric"),
    (re.compile(r"\bcmb\b|microwave background|3\s?K\b", re.IGNORECASE), "cmb"),
    (re.compile(r"local[ -]group", re.IGNORECASE), "local-group"),
    (re.compile(r"true redshift|cosmological redshift", re.IGNORECASE), TRUE),
)


def check_redshift_frame(value: Any) -> str:
    """A frame of redshifts by name."""
    name = str(value).lower().replace("_", "-") if isinstance(value, str) else ""
    name = {"barycentric": "heliocentric", "helio": "heliocentric"}.get(name, name)
    if name not in REDSHIFT_FRAME_NAMES:
        raise ParameterError(f"a redshift's frame is {', '.join(REDSHIFT_FRAME_NAMES)}, not {value!r}")
    return name


def redshift_frame_in(description: str | None) -> str | None:
    """The frame of redshifts that a column's description tells, if it does.

    Examples
    --------
    >>> redshift_frame_in("Redshift in the CMB frame"), redshift_frame_in("Redshift")
    ('cmb', None)
    """
    found = {name for words, name in _WORDS if words.search(description or "")}
    return found.pop() if len(found) == 1 else None
