"""Storage order of the parameters of a field on the sphere.

The parameters of a real field are stored in this order::

    [
        (kind, l, m, part) for kind in modes.kinds for l in range(modes.lowest, lmax + 1) for m in range(l + 1) for part
        in ("re", "im")[: 1 + (m > 0)]
    ]

A vector field has two kinds of parameters, toroidal and spheroidal, from degree 1 on: ``2 lmax (lmax + 2)`` in all. A
scalar field has one kind, from degree 0 on: ``(lmax + 1)²`` in all.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from operator import index
from typing import ClassVar, NamedTuple

import numpy as np

from vsh.tools.errors import ModesError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray, IntArray, Kind


class Mode(NamedTuple):
    """Real parameter of a field: kind (toroidal "T", spheroidal "S" or scalar "F"), degree, order and part.

    Examples
    --------
    >>> Mode('S', 1, 0)
    Mode(kind='S', l=1, m=0, part='re')
    >>> str(Mode('T', 2, 1, 'im'))
    't(2,1,im)'
    """

    kind: str
    l: int
    m: int
    part: str = "re"

    def __str__(self) -> str:
        order = f"{self.m}" if self.m == 0 else f"{self.m},{self.part}"
        return f"{self.kind.lower()}({self.l},{order})"


#: Toroidal and spheroidal, in storage order.
KINDS: tuple[Kind, Kind] = ("T", "S")


#: Largest degree that is accepted: it has some 10¹⁰ coefficients, more than any computer can solve for.
MAX_DEGREE = 100_000


@dataclass(frozen=True)
class Modes(InNotebook):
    """All modes of a vector field up to degree `lmax`, in storage order.

    Parameters
    ----------
    lmax : int
        The highest degree, at least 1.

    Attributes
    ----------
    kinds : tuple of str
        Kinds in storage order: "T" for toroidal and "S" for spheroidal.
    lowest : int
        The lowest degree.
    components : int
        Number of components of the field at each position: two, east and north.

    Raises
    ------
    ModesError
        If `lmax` is not a whole number from `lowest` to `MAX_DEGREE`.

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

    kinds: ClassVar[tuple[Kind, ...]] = KINDS
    lowest: ClassVar[int] = 1
    components: ClassVar[int] = 2

    def __post_init__(self) -> None:
        try:
            lmax = index(self.lmax)
        except TypeError:
            lmax = -1
        if lmax < self.lowest:
            raise ModesError(f"lmax must be a whole number of at least {self.lowest}, not {self.lmax!r}")
        if lmax > MAX_DEGREE:
            raise ModesError(f"lmax must be at most {MAX_DEGREE}, not {self.lmax!r}")
        object.__setattr__(self, "lmax", lmax)

    def __len__(self) -> int:
        return len(self.kinds) * ((self.lmax + 1) ** 2 - self.lowest**2)

    def __iter__(self) -> Iterator[Mode]:
        for kind in self.kinds:
            for l in range(self.lowest, self.lmax + 1):
                yield Mode(kind, l, 0)
                for m in range(1, l + 1):
                    yield Mode(kind, l, m, "re")
                    yield Mode(kind, l, m, "im")

    @property
    def degrees(self) -> IntArray:
        """The degree l of each mode, a (p,) array."""
        l = np.arange(self.lowest, self.lmax + 1)
        return np.tile(np.repeat(l, 2 * l + 1), len(self.kinds))

    @property
    def norm2(self) -> FloatArray:
        """∫ |V_i|² dΩ of each mode, a (p,) array: 1 for m = 0, and 2 for m > 0, where a mode stands for both ±m."""
        l = np.arange(self.lowest, self.lmax + 1)
        norms = np.full(len(self) // len(self.kinds), 2.0)
        norms[l * l - self.lowest**2] = 1.0
        return np.tile(norms, len(self.kinds))

    def index(self, mode: tuple[str, int, int, str]) -> int:
        """Return the index of `mode`; degrees below l fill the first l² − lowest² places of its kind.

        Raises
        ------
        ModesError
            If there is no such mode.
        """
        kind, l, m, part = mode
        if kind not in self.kinds:
            raise ModesError(
                f"{type(self).__name__} are of kind {' and '.join(self.kinds)}, not {kind!r}"
                + (": a scalar field has no spin and no acceleration" if kind in KINDS else "")
            )
        if not self.lowest <= l <= self.lmax or not 0 <= m <= l or part not in ("re", "im"):
            raise ModesError(f"{tuple(mode)} is not a mode of degrees {self.lowest} to {self.lmax}")
        if m == 0 and part == "im":
            raise ModesError(f"order 0 has no imaginary part: {tuple(mode)}")
        offset = 2 * m - (m > 0) + (part == "im")
        return self.kinds.index(kind) * len(self) // len(self.kinds) + l * l - self.lowest**2 + offset

    @property
    def blocks(self) -> dict[tuple[Kind, int], slice]:
        """Slices of the coefficients of each kind and degree, in storage order."""
        return {(kind, l): self.slice_of(kind, l) for kind in self.kinds for l in range(self.lowest, self.lmax + 1)}

    def slice_of(self, kind: Kind, l: int) -> slice:
        """Return the slice of all orders of degree `l` of one `kind`."""
        start = self.index(Mode(kind, l, 0))
        return slice(start, start + 2 * l + 1)


@dataclass(frozen=True)
class ScalarModes(Modes):
    """All modes of a scalar field up to degree `lmax`, in storage order: f_00, f_10, f_11 re, f_11 im, …

    Parameters
    ----------
    lmax : int
        The highest degree, at least 0.

    Attributes
    ----------
    kinds : tuple of str
        "F" only.
    lowest : int
        0: degree 0 is the mean.
    components : int
        1.

    Examples
    --------
    >>> [str(mode) for mode in ScalarModes(1)]
    ['f(0,0)', 'f(1,0)', 'f(1,1,re)', 'f(1,1,im)']
    """

    kinds: ClassVar[tuple[Kind, ...]] = ("F",)
    lowest: ClassVar[int] = 0
    components: ClassVar[int] = 1


def as_modes(modes: Modes | int, kind: type[Modes] | None = Modes) -> Modes:
    """Return `modes` as an instance of the class `kind` (None: any class of modes); a number is the degree lmax."""
    if not isinstance(modes, Modes):
        return (kind or Modes)(modes)
    if kind is not None and type(modes) is not kind:
        subject = "a scalar field is" if kind is ScalarModes else "vector fields, such as motions, are"
        raise ModesError(f"{subject} expanded in {kind.__name__}, not in {type(modes).__name__}")
    return modes
