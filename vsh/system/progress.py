"""Progress bars: after two seconds, and only where somebody looks on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from tqdm import tqdm


def progress_bar(
    things: Iterable[Any] | None = None,
    total: int | None = None,
    words: str | None = None,
    shown: bool = True,
    unit: str = "it",
    **options: Any,
) -> Any:
    """A tqdm bar on stderr; none in a log file or a pipe.

    Parameters
    ----------
    things : iterable, optional
        Through which to go.
    total : int, optional
        How many.
    words : str
        Beside the bar.
    shown : bool
        Whether there is one.
    unit : str
        Of what is counted.
    **options
        Others.
    """
    # With None tqdm looks whether stderr is a terminal.
    return tqdm(things, total=total, desc=words or None, delay=2, disable=None if shown else True, unit=unit, **options)
