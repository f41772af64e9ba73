"""Other people's libraries, imported without what they say of themselves."""

from __future__ import annotations

import time
import warnings
from importlib import import_module
from typing import Any


def import_quietly(name: str, tries: int = 5) -> Any:
    """Import a library, and show none of its warnings.

    arviz, which corner imports too, warns of its own next version once a day by a stamp in the
    user's cache: a test run that passed yesterday would fail today, and a report begin with it.
    Two processes that write the stamp at once are in each other's way; the second try finds it there.
    """
    for attempt in range(tries):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                return import_module(name)
        except FileNotFoundError:
            if attempt == tries - 1:
                raise
            time.sleep(0.2)
