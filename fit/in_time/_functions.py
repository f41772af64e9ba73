"""Functions of time that positions and motions of the sources do not take up."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.special import eval_legendre

from vsh.tools import arguments
from vsh.tools.arguments import explained
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, FloatArray

#: From when to when DR4's observations were made, about J2017.5. [yr]
DR4_SPAN = (-2.94, 2.55)
#: Panels of the integrals over a mission, and Gauss nodes of each: functions of less than a few hundred cycles.
_PANELS, _NODES = 250, 12
_KINDS = ("cos", "sin", "legendre", "spline")


@dataclass(frozen=True, eq=False)
class Functions(Frozen):
    """Functions of time, each less the straight line that comes nearest to it.

    What a straight line would be is the sources' own position and motion.

    Attributes
    ----------
    terms : tuple of (str, float)
        ("cos", f) and ("sin", f) with f in 1/yr, ("legendre", k), ("spline", i).
    span : (float, float)
        Start and end of the observations, since the reference epoch. [yr]
    knots : tuple of float
        Knots of the splines, within the span. [yr]

    Examples
    --------
    >>> functions = waves(0.5, 1.0) + legendre(3)
    >>> functions.names
    ('cos 0.5', 'sin 0.5', 'cos 1', 'sin 1', 'P2', 'P3')
    >>> functions(np.linspace(-2, 2, 5)).shape
    (6, 5)
    """

    terms: tuple[tuple[str, float], ...]
    span: tuple[float, float] = DR4_SPAN
    knots: tuple[float, ...] = ()
    _made: dict = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        start, end = (arguments.number("span", each) for each in self.span)
        if not start < end:
            raise ParameterError(f"a span goes from a start to a later end, not {self.span!r}")
        if not self.terms or any(kind not in _KINDS for kind, _ in self.terms):
            raise ParameterError(f"terms are pairs of one of {', '.join(_KINDS)} and a number, not {self.terms!r}")
        if len(set(self.terms)) < len(self.terms):
            raise ParameterError("a function stands among the terms twice: it could not be told from itself")
        # An exact line by least squares at Gauss nodes, and with the splines what spans the rest.
        node, weight = _nodes()
        time = self._middle + self._half * node
        line = np.array([np.full_like(node, np.sqrt(0.5)), node * np.sqrt(1.5)])
        if self.knots:
            basis = self._splines(time)
            left = basis - (basis * weight) @ line.T @ line
            values, turn = np.linalg.eigh((left * weight) @ left.T)
            self._made["turn"] = turn[:, 2:] * np.sqrt(self._half / values[2:])  # two of them are lines
            if {i for kind, i in self.terms if kind == "spline"} - set(range(1, self._made["turn"].shape[1] + 1)):
                raise ParameterError(f"{len(self.knots)} knots make {self._made['turn'].shape[1]} splines")
        self._made["line"] = (self._plain(time) * weight) @ line.T

    def __len__(self) -> int:
        return len(self.terms)

    def __add__(self, other: Functions) -> Functions:
        """Both sets of functions."""
        if not isinstance(other, Functions):
            return NotImplemented
        if self.span != other.span or (self.knots and other.knots and self.knots != other.knots):
            raise ParameterError("functions of different spans or knots do not add: give all of them the same")
        return Functions(self.terms + other.terms, self.span, self.knots or other.knots)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Functions) and (self.terms, self.span, self.knots) == (
            other.terms,
            other.span,
            other.knots,
        )

    def __hash__(self) -> int:
        return hash((self.terms, self.span, self.knots))

    @property
    def names(self) -> tuple[str, ...]:
        """What a report calls them."""
        shown = {"legendre": "P{:g}", "spline": "spline {:g}"}
        return tuple(shown.get(kind, f"{kind} {{:.6g}}").format(number) for kind, number in self.terms)

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Their values, (F, k), at `time` since the reference epoch, (k,). [yr]"""
        time = np.atleast_1d(np.asarray(time, float))
        node = (time - self._middle) / self._half
        return self._plain(time) - self._made["line"] @ np.array(
            [np.full_like(node, np.sqrt(0.5)), node * np.sqrt(1.5)]
        )

    @property
    def _middle(self):
        return (self.span[0] + self.span[1]) / 2

    @property
    def _half(self):
        return (self.span[1] - self.span[0]) / 2

    def _plain(self, time):
        out: Any = np.empty((len(self.terms), len(time)))
        splines: Any = self._made["turn"].T @ self._splines(time) if self.knots else None
        for row, (kind, number) in zip(out, self.terms, strict=True):
            if kind == "legendre":
                row[:] = eval_legendre(int(number), (time - self._middle) / self._half)
            elif kind == "spline":
                row[:] = splines[int(number) - 1]
            else:
                row[:] = (np.cos if kind == "cos" else np.sin)(2 * np.pi * number * time)
        return out

    def _splines(self, time):
        from scipy.interpolate import BSpline  # slow to import

        ends = [[edge] * 4 for edge in self.span]
        knots = np.r_[ends[0], self.knots, ends[1]]
        return BSpline(knots, np.eye(len(knots) - 4), 3)(np.clip(time, *self.span)).T


@lru_cache(maxsize=1)
def _nodes():
    """Nodes and weights of an integral from −1 to 1."""
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    edges = np.linspace(-1, 1, _PANELS + 1)
    half = (edges[1] - edges[0]) / 2
    return (edges[:-1, None] + half * (1 + node)).ravel(), np.tile(half * weight, _PANELS)


def waves(*frequencies: float, span: tuple[float, float] = DR4_SPAN) -> Functions:
    """Cosine and sine of each frequency.

    Parameters
    ----------
    *frequencies : float
        Above zero; below about a cycle in the span sources' positions and motions take most of it. [1/yr]
    span : (float, float)
        Start and end of the observations, since the reference epoch. [yr]

    Raises
    ------
    ParameterError
        If there is none, or one twice.
    """
    if not frequencies:
        raise ParameterError("a frequency at least is wanted [1/yr]")
    numbers = [arguments.positive("frequency", each) for each in frequencies]
    return Functions(tuple((kind, each) for each in numbers for kind in ("cos", "sin")), (span[0], span[1]))


@explained
def legendre(highest: int, span: tuple[float, float] = DR4_SPAN) -> Functions:
    """Legendre polynomials of time from degree 2 on; those of degree 0 and 1 are positions and motions.

    Parameters
    ----------
    highest : int
        The highest degree, 2 or more.
    span : (float, float)
        As for `waves`.

    Raises
    ------
    ParameterError
        If the highest degree is below 2.
    """
    if arguments.whole("highest", highest) < 2:
        raise ParameterError("degrees 0 and 1 are the sources' positions and motions: highest of 2 or more")
    return Functions(tuple(("legendre", float(k)) for k in range(2, highest + 1)), (span[0], span[1]))


@explained
def splines(knots: ArrayLike, span: tuple[float, float] = DR4_SPAN) -> Functions:
    """Cubic splines of time, as many as there are knots and two more, turned so that none holds a straight line.

    Parameters
    ----------
    knots : (k,) array
        Between start and end of the span, rising. [yr since the reference epoch]
    span : (float, float)
        As for `waves`.

    Raises
    ------
    ParameterError
        If the knots do not rise within the span.
    """
    inner = arguments.float_array("knots", knots)
    if inner.ndim != 1 or not len(inner) or (np.diff(np.r_[span[0], inner, span[1]]) <= 0).any():
        raise ParameterError(f"knots rise between {span[0]:g} and {span[1]:g} yr")
    return Functions(
        tuple(("spline", float(i)) for i in range(1, len(inner) + 3)), (span[0], span[1]), tuple(map(float, inner))
    )
