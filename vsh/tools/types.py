"""Types that signatures share."""

from collections.abc import Sequence
from os import PathLike
from typing import TYPE_CHECKING, Any, Literal, Protocol, TypeAlias

import numpy as np
from numpy.typing import ArrayLike as ArrayLike
from numpy.typing import NDArray

if TYPE_CHECKING:
    from astropy.table import Table
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    #: One axes, or as many as a figure has panels.
    OnAxes: TypeAlias = Axes | Sequence[Axes] | NDArray[np.object_]
    #: The axes of a figure's panels.
    AxesArray: TypeAlias = NDArray[np.object_]
else:  # not imported for their names
    Axes = AxesArray = Figure = OnAxes = Table = Any


class Cosmology(Protocol):
    """Interface of a cosmology: one of astropy's, or `FLAT_PLANCK13` and its like."""

    @property
    def H0(self) -> Any:
        """The Hubble constant, a Quantity."""

    @property
    def Ok0(self) -> Any:
        """Ω_k."""

    def comoving_transverse_distance(self, z: Any) -> Any:
        """The distance at redshifts, a Quantity."""


#: Arrays as results have them; shapes and units are in the docstrings.
if TYPE_CHECKING:
    FloatArray: TypeAlias = NDArray[np.float64]
    IntArray: TypeAlias = NDArray[np.integer[Any]]
    BoolArray: TypeAlias = NDArray[np.bool_]
    ComplexArray: TypeAlias = NDArray[np.complex128]
else:  # `help` shows a short name
    FloatArray = IntArray = BoolArray = ComplexArray = np.ndarray

#: A source of randomness: NumPy's generator, or a number (or a sequence of them) that seeds one.
Rng: TypeAlias = np.random.Generator | int | list[int]
PathName: TypeAlias = str | PathLike[str]
#: Toroidal or spheroidal; "F" of a scalar field.
Kind: TypeAlias = Literal["T", "S", "F"]
OnBad: TypeAlias = Literal["raise", "drop"]
Release: TypeAlias = Literal["DR3", "DR4", "DR5", "paper"]
#: astropy's Quantity, which is not imported for its name.
Quantity: TypeAlias = Any
