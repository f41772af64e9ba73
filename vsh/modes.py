"""The order in which the parameters of a vector field are stored, said once.

A real field of degree 1 … lmax has ``2 lmax (lmax + 2)`` parameters, kept as::

    [
        (kind, l, m, part)
        for kind in KINDS
        for l in range(1, lmax + 1)
        for m in range(l + 1)
        for part in ("re", "im")[: 1 + (m > 0)]
    ]
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from operator import index
from typing import NamedTuple

import numpy as np

from vsh.errors import ModesError
from vsh.types import FloatArray, IntArray, Kind


class Mode(NamedTuple):
    """One real parameter: toroidal ("T") or spheroidal ("S"), degree, order, part."""

    kind: str
    l: int
    m: int
    part: str = "re"

    def __str__(self) -> str:
        order = f"{self.m}" if self.m == 0 else f"{self.m},{self.part}"
        return f"{self.kind.lower()}({self.l},{order})"


#: Toroidal and spheroidal, in storage order.
KINDS: tuple[Kind, Kind] = ("T", "S")


@dataclass(frozen=True)
class Modes:
    """All modes up to degree `lmax`, in storage order.

    Parameters
    ----------
    lmax : int
        The highest degree, at least 1.

    Raises
    ------
    ModesError
        If `lmax` is not a whole number of at least 1.

    Examples
    --------
    >>> modes = Modes(2)
    >>> len(modes)
    16
    >>> [str(mode) for mode in modes][:4]
    ['t(1,0)', 't(1,1,re)', 't(1,1,im)', 't(2,0)']
    >>> modes.index(Mode("S", 1, 0))
    8
    """

    lmax: int

    def __post_init__(self) -> None:
        try:
            lmax = index(self.lmax)
        except TypeError:
            lmax = 0
        if lmax < 1:
            raise ModesError(f"lmax must be a whole number of at least 1, not {self.lmax!r}")
        object.__setattr__(self, "lmax", lmax)

    def __len__(self) -> int:
        return 2 * self.lmax * (self.lmax + 2)

    def __iter__(self) -> Iterator[Mode]:
        for kind in KINDS:
            for l in range(1, self.lmax + 1):
                yield Mode(kind, l, 0)
                for m in range(1, l + 1):
                    yield Mode(kind, l, m, "re")
                    yield Mode(kind, l, m, "im")

    @property
    def degrees(self) -> IntArray:
        """The degree l of each mode, a (p,) array."""
        l = np.arange(1, self.lmax + 1)
        return np.tile(np.repeat(l, 2 * l + 1), 2)

    @property
    def norm2(self) -> FloatArray:
        """∫ |V_i|² dΩ of each mode, a (p,) array: 1, and 2 where the mode stands for ±m."""
        degrees = self.degrees
        zonal = np.flatnonzero(np.diff(degrees, prepend=-1))
        # Degree lmax of T may meet degree 1 of S, or be it.
        zonal = np.union1d(zonal, [0, len(self) // 2])
        out = np.full(len(self), 2.0)
        out[zonal] = 1.0
        return out

    def index(self, mode: tuple[str, int, int, str]) -> int:
        """Where `mode` is stored; degrees below l fill the first l² - 1 places of its kind.

        Parameters
        ----------
        mode : Mode
            Which.

        Raises
        ------
        ModesError
            If there is no such mode.
        """
        kind, l, m, part = mode
        if kind not in KINDS or not 1 <= l <= self.lmax or not 0 <= m <= l or part not in ("re", "im"):
            raise ModesError(f"{tuple(mode)} is no mode of degree 1 … {self.lmax}")
        if m == 0 and part == "im":
            raise ModesError(f"order 0 has no imaginary part: {tuple(mode)}")
        within = 2 * m - (m > 0) + (part == "im")
        return (kind == "S") * len(self) // 2 + l * l - 1 + within

    def slice_of(self, kind: Kind, l: int) -> slice:
        """The slice that holds every order of one degree of one kind.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        slice
        """
        start = self.index(Mode(kind, l, 0))
        return slice(start, start + 2 * l + 1)


def as_modes(modes: Modes | int) -> Modes:
    """Modes, or the degree lmax in their place.

    Parameters
    ----------
    modes : Modes or int
        Or the degree lmax.

    Raises
    ------
    ModesError
        If it is neither.

    Examples
    --------
    >>> as_modes(2) == as_modes(Modes(2))
    True
    """
    return modes if isinstance(modes, Modes) else Modes(modes)
