"""Models of the sky: covariances of random fields, flows of galaxies, distances and our own motion, plane waves."""

from typing import TYPE_CHECKING

from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from vsh.models import bright_stars, cosmology, covariance, flows, waves

__all__ = ["bright_stars", "cosmology", "covariance", "flows", "waves"]

__getattr__, __dir__ = lazy_names(__name__, __all__, {})
