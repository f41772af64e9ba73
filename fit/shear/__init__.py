"""Expansion that differs from axis to axis: the tensor behind the spheroidal coefficients of degree 2."""

from typing import TYPE_CHECKING

from fit.shear._shear import Shear, expansion
from fit.shear._tensor import coefficients_of, tensor_of
from vsh.tools.modules import lazily

if TYPE_CHECKING:
    from fit.shear._plot import plot_shear

__all__ = ["Shear", "coefficients_of", "expansion", "tensor_of"]

# matplotlib is imported when a figure is first asked for.
__getattr__, __dir__ = lazily(__name__, __all__, {"_plot": ["plot_shear"]})
