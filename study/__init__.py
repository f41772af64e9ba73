"""Simulation studies: many skies with a known truth, fitted, and what came of it.

The one place that knows both `sim` and `fit`.
"""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from study.config import Study, load
    from study.run import run

__all__ = ["Study", "load", "run"]

# Imported when first asked for: all of `sim` and `fit` come with them.
__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"config": ["Study", "load"], "run": ["run"]})


def __dir__() -> list[str]:
    return __all__
