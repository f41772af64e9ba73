"""Expansion that differs from axis to axis: the tensor behind the spheroidal coefficients of degree 2."""

from typing import TYPE_CHECKING

import lazy_loader

from fit.shear._shear import Shear, expansion
from fit.shear._tensor import coefficients_of, tensor_of

if TYPE_CHECKING:
    from fit.shear._plot import plot_shear

__all__ = ["Shear", "coefficients_of", "expansion", "tensor_of"]

# matplotlib is imported when a figure is first asked for.
__getattr__, _, _ = lazy_loader.attach(__name__, submod_attrs={"_plot": ["plot_shear"]})


def __dir__() -> list[str]:
    return __all__
