"""Small linear models with named parameters: circular speed, stars, expansion by axis, growth of structure."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from fit.motions import galaxy, growth, shear, stars

__all__ = ["galaxy", "growth", "shear", "stars"]

__getattr__, __dir__ = lazily(__name__, __all__, {})
