"""Epoch astrometry: from the positions along scan of every transit to five parameters and fields."""

from typing import TYPE_CHECKING

import lazy_loader

from vsh.io.epochs._solve import FiveParameters, design_row, downweight, solve_epochs

if TYPE_CHECKING:
    from vsh.io.epochs._observations import Observations, read_epochs, read_observations

__all__ = ["FiveParameters", "Observations", "read_epochs", "read_observations", "solve_epochs"]

# Imported when first asked for: astropy comes with it.
__getattr__, _, _ = lazy_loader.attach(
    __name__, submod_attrs={"_observations": ["Observations", "read_epochs", "read_observations"]}
)


def __dir__() -> list[str]:
    return __all__
