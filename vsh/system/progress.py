"""Progress bars: after two seconds, and only where somebody looks on."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any

from tqdm import tqdm

_HIDDEN: ContextVar[bool] = ContextVar("hidden", default=False)


@contextmanager
def without_bars(hidden: bool = True) -> Iterator[None]:
    """No progress bar is shown meanwhile."""
    token = _HIDDEN.set(hidden or _HIDDEN.get())
    try:
        yield
    finally:
        _HIDDEN.reset(token)


def progress_bar(
    things: Iterable[Any] | None = None,
    total: int | None = None,
    words: str | None = None,
    shown: bool = True,
    unit: str = "it",
    **options: Any,
) -> Any:
    """A tqdm bar on stderr; none in a log file or a pipe."""
    # With None tqdm looks whether stderr is a terminal.
    return tqdm(
        things,
        total=total,
        desc=words or None,
        delay=2,
        disable=None if shown and not _HIDDEN.get() else True,
        unit=unit,
        **options,
    )
