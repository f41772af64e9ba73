"""Epoch astrometry: from the positions along scan of every transit to five parameters and fields."""

from typing import TYPE_CHECKING

from vsh.io.epochs._solve import COLOUR_PRIOR, FiveParameters, downweighting_factor, make_design_rows, solve_epochs
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from vsh.io.epochs._observations import (
        Observations,
        epoch_files,
        iterate_observations,
        read_epochs,
        read_observations,
    )

_LATER = ["Observations", "epoch_files", "iterate_observations", "read_epochs", "read_observations"]
__all__ = ["FiveParameters", "Observations", "epoch_files", "iterate_observations", "read_epochs", "read_observations",
           "solve_epochs"]  # fmt: skip

# Imported when first asked for: astropy comes with it.
__getattr__, __dir__ = lazy_names(__name__, __all__, {"_observations": _LATER})
