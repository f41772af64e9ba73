"""Small linear models with named parameters: circular speed, stars, expansion by axis."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.motions import galaxy, shear, stars

__all__ = ["galaxy", "shear", "stars"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
