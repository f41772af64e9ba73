"""Models of the sky: covariances of random fields, flows of galaxies, distances and our own motion, plane waves."""

from typing import TYPE_CHECKING

import lazy_loader

if TYPE_CHECKING:
    from vsh.models import cosmology, covariance, flows, waves

__all__ = ["cosmology", "covariance", "flows", "waves"]

__getattr__, _, _ = lazy_loader.attach(__name__, submodules=__all__)


def __dir__() -> list[str]:
    return __all__
