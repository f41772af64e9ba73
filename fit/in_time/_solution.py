"""Functions of time that positions and motions of the sources do not take up, and their coefficients.

Coefficients of functions of time × harmonics: what they say of the sky at any time, and of the frame.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np

from fit.results.quality import Quality, f_p_value
from fit.results.storage import Result, make_coefficient_columns
from vsh.coefficients import Coefficients
from vsh.io import tables
from vsh.io.sections import Section
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.arguments import covariance, float_array
from vsh.tools.digits import format_p_value
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.types import ArrayLike, AxesArray, FloatArray, Kind, OnAxes, Table
from vsh.vector import Vector

#: From when to when DR4's observations were made, about J2017.5. [yr]
DR4_SPAN = (-2.94, 2.55)
#: Panels of the integrals over a mission, and Gauss nodes of each: functions of less than a few hundred cycles.
_N_PANELS, _N_NODES = 250, 12
_FAMILIES = ("cos", "sin")


@dataclass(frozen=True, eq=False)
class Functions(Frozen):
    """Functions of time, each less the straight line that comes nearest to it.

    What a straight line would be is the sources' own position and motion.

    Attributes
    ----------
    terms : tuple of (str, float)
        ("cos", f) and ("sin", f) with f in 1/yr.
    span : (float, float)
        Start and end of the observations, since the reference epoch. [yr]

    Examples
    --------
    >>> functions = waves(0.5) + waves(1.0)
    >>> functions.names
    ('cos 0.5', 'sin 0.5', 'cos 1', 'sin 1')
    >>> functions(np.linspace(-2, 2, 5)).shape
    (4, 5)
    """

    terms: tuple[tuple[str, float], ...]
    span: tuple[float, float] = DR4_SPAN
    _cache: dict = field(default_factory=dict, init=False, repr=False)

    def __post_init__(self) -> None:
        start, end = (arguments.number("span", edge) for edge in self.span)
        if not start < end:
            raise ParameterError(f"a span goes from a start to a later end, not {self.span!r}")
        if not self.terms or any(family not in _FAMILIES for family, _ in self.terms):
            raise ParameterError(f"terms are pairs of one of {', '.join(_FAMILIES)} and a number, not {self.terms!r}")
        if len(set(self.terms)) < len(self.terms):
            raise ParameterError("a function stands among the terms twice: it could not be told from itself")
        # An exact line by least squares at Gauss nodes.
        nodes, weights = _compute_quadrature()
        time = self._mid_time + self._half_span * nodes
        self._cache["line"] = (self._evaluate(time) * weights) @ _evaluate_line(nodes).T

    def __len__(self) -> int:
        return len(self.terms)

    def __add__(self, other: Functions) -> Functions:
        """Both sets of functions."""
        if not isinstance(other, Functions):
            return NotImplemented
        if self.span != other.span:
            raise ParameterError("functions of different spans do not add: give all of them the same")
        return Functions(self.terms + other.terms, self.span)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Functions) and (self.terms, self.span) == (other.terms, other.span)

    def __hash__(self) -> int:
        return hash((self.terms, self.span))

    @property
    def names(self) -> tuple[str, ...]:
        """Names in reports."""
        return tuple(f"{family} {number:.6g}" for family, number in self.terms)

    def __call__(self, time: ArrayLike) -> FloatArray:
        """Their values, (F, k), at `time` since the reference epoch, (k,). [yr]"""
        time = np.atleast_1d(np.asarray(time, float))
        return self._evaluate(time) - self._cache["line"] @ _evaluate_line((time - self._mid_time) / self._half_span)

    @property
    def _mid_time(self):
        return (self.span[0] + self.span[1]) / 2

    @property
    def _half_span(self):
        return (self.span[1] - self.span[0]) / 2

    def _evaluate(self, time):
        return np.array([getattr(np, family)(2 * np.pi * number * time) for family, number in self.terms])


def _evaluate_line(nodes):
    """Evaluate a constant and a slope, orthonormal from −1 to 1."""
    return np.array([np.full_like(nodes, np.sqrt(0.5)), nodes * np.sqrt(1.5)])


@lru_cache(maxsize=1)
def _compute_quadrature():
    """Compute nodes and weights of an integral from −1 to 1."""
    panel_nodes, panel_weights = np.polynomial.legendre.leggauss(_N_NODES)
    edges = np.linspace(-1, 1, _N_PANELS + 1)
    half_panel = (edges[1] - edges[0]) / 2
    return (edges[:-1, None] + half_panel * (1 + panel_nodes)).ravel(), np.tile(half_panel * panel_weights, _N_PANELS)


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
        raise ParameterError("a frequency at least is expected [1/yr]")
    numbers = [arguments.positive("frequency", frequency) for frequency in frequencies]
    if len({f"{number:g}" for number in numbers}) < len(numbers):
        raise ParameterError(f"a frequency is given twice, to the six digits that observations separate: {numbers}")
    return Functions(tuple((kind, frequency) for frequency in numbers for kind in ("cos", "sin")), (span[0], span[1]))


#: So much of a coefficient's own direction must be seen for it to be printed as determined.
SEEN = 0.99


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class TimeSolution(Result):
    """Displacements of the sky that change with time.

    Attributes
    ----------
    modes : Modes
        Harmonics on the sky.
    functions : Functions
        Functions of time.
    values : (F, p) array
        Coefficients of every function. [µas]
    covariance : (F p, F p) array
        Covariance of all of them, functions outermost; zero where nothing is seen. [µas²]
    chi2 : float
    dof : int
    n_sources : int
    attitude : str
        "known", or the response whose templates were fitted.
    seen : (F, p) array
        Which share of each coefficient the observations determine: below 1 where sources' own parameters take some.
    lost : tuple of str
        Combinations that they take, by their largest coefficients.
    notes : tuple of str
    """

    modes: Modes
    functions: Functions
    values: FloatArray
    covariance: FloatArray
    chi2: float
    dof: int
    n_sources: int
    attitude: str
    seen: FloatArray
    lost: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    frame = "icrs"

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        shape = len(self.functions), len(self.modes)
        for name in ("values", "seen"):
            object.__setattr__(self, name, float_array(name, getattr(self, name), shape))
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, shape[0] * shape[1]))
        super().__post_init__()

    def __repr__(self) -> str:
        return f"<TimeSolution: {len(self.functions)} functions × degree {self.modes.lmax}, {self.n_sources} sources>"

    @property
    def sigma(self) -> FloatArray:
        """Standard errors, (F, p); zero where nothing is seen. [µas]"""
        return np.sqrt(np.diag(self.covariance)).reshape(self.values.shape)

    @property
    def quality(self) -> Quality:
        """Quality of the fit by χ²."""
        return Quality(self.chi2, self.dof)

    @property
    def scaled(self) -> TimeSolution:
        """Scale the errors by √(χ²/dof)."""
        return replace(self, covariance=self.covariance * self.quality.reduced, chi2=float(self.dof))

    def at(self, time: float) -> tuple[Coefficients, FloatArray]:
        """Displacements of the sky at a time.

        Parameters
        ----------
        time : float
            Since the reference epoch. [yr]

        Returns
        -------
        coefficients : Coefficients
            [µas]
        covariance : (p, p) array
            [µas²]
        """
        weights = self.functions([arguments.number("time", time)])[:, 0]
        f, p = self.values.shape
        coefficient_covariance = np.einsum("f,fpgq,g->pq", weights, self.covariance.reshape(f, p, f, p), weights)
        return Coefficients(self.modes, weights @ self.values), coefficient_covariance

    def vector(self, kind: Kind, time: float) -> Vector:
        """The `kind` "T", a rotation, or "S", a glide, at a `time` since the reference epoch [yr], a Vector in µas."""
        coefficients, coefficient_covariance = self.at(time)
        return coefficients.vector(kind, coefficient_covariance, self.frame, "µas")

    def power(self, function: str, kind: Kind, l: int) -> tuple[float, float, float]:
        """Power of one function, kind and degree.

        Parameters
        ----------
        function : str
            One of `functions.names`.
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree.

        Returns
        -------
        power, noise, p_value : float
            ∫ |V|² dΩ as fitted, what noise gives on average [µas²], and the probability of as much signal from noise.

        Raises
        ------
        ModesError
            If there is no such function.
        """
        if function not in self.functions.names:
            raise ModesError(f"there is no function {function!r}: {', '.join(self.functions.names)}")
        row = self.functions.names.index(function)
        indices = np.arange(len(self.modes))[self.modes.slice_of(kind, l)]
        norm = self.modes.norm2[indices]
        terms = row * len(self.modes) + indices
        block_covariance = self.covariance[np.ix_(terms, terms)]
        chi2, rank = _test_against_zero(self.values[row, indices], block_covariance, self.seen[row, indices] > SEEN)
        return (
            float(norm @ self.values[row, indices] ** 2),
            float(norm @ np.diag(block_covariance)),
            f_p_value(chi2, rank, self.dof),
        )

    def rest(self, kind: Kind) -> tuple[float, int, float]:
        """Test whether degree 1 changes with time, all functions together: χ², unknowns, p-value.

        Parameters
        ----------
        kind : {"T", "S"}
            The rotation, which is seen where the attitude is known, or the glide.
        """
        indices = np.arange(len(self.modes))[self.modes.slice_of(kind, 1)]
        terms = (np.arange(len(self.functions))[:, None] * len(self.modes) + indices).ravel()
        chi2, rank = _test_against_zero(
            self.values.ravel()[terms], self.covariance[np.ix_(terms, terms)], self.seen.ravel()[terms] > SEEN
        )
        return chi2, rank, f_p_value(chi2, rank, self.dof)

    def _sections(self, long):
        start, end = self.functions.span
        attitude = "known from elsewhere" if self.attitude == "known" else f"solved from the same sky, {self.attitude}"
        facts = [
            ("sources", f"{self.n_sources}, {len(self.functions)} functions × degrees 1 to {self.modes.lmax}"),
            ("time", f"from {start:+.2f} to {end:+.2f} yr about the reference epoch"),
            ("attitude", attitude),
            ("χ²/dof", f"{self.quality.reduced:.4f} with {self.dof} degrees of freedom"),
        ]
        if warning := self.quality.warning():
            facts.append(("warning", warning))
        for kind, quantity in (("S", "glide"), ("T", "rotation")):
            chi2, rank, p_value = self.rest(kind)  # type: ignore[arg-type]
            test_words = f"χ² {chi2:.1f} of {rank} unknowns, p = {format_p_value(p_value)}"
            unseen_words = "not seen: an attitude solved from the same sky takes all of it"
            facts.append((f"{quantity} in time", test_words if rank else unseen_words))
        rows = []
        for function, l, kind in product(self.functions.names, range(1, self.modes.lmax + 1), "TS"):
            power, noise, p_value = self.power(function, kind, l)  # type: ignore[arg-type]
            if np.isfinite(p_value):
                rows.append((function, f"{kind}{l}", float(np.sqrt(power)), float(np.sqrt(noise)), p_value))
        column_names = ("function", "degree", "√power", "√noise", "p_value")
        table = tables.table_of_rows(column_names, rows, {}, {"√power": "uas", "√noise": "uas"})
        remarks = []
        if self.lost:
            suffix = f"; and {len(self.lost) - 5} more" if len(self.lost) > 5 else ""
            remarks = [
                f"{len(self.lost)} combinations are taken by the sources' own positions, parallaxes and motions, and "
                f"held at zero: {'; '.join(self.lost[:5])}{suffix}"
            ]
        forms = dict.fromkeys(("√power", "√noise"), ".3g")
        title = "Displacements that change with time: power by function and degree"
        return (Section(title, facts, table, forms=forms, remarks=remarks, notes=self.notes),)

    def to_table(self) -> Table:
        """A row for each function and coefficient, as an astropy Table."""
        f, p = self.values.shape
        mode_columns = make_coefficient_columns(self.modes)
        columns: dict[str, Any] = {"function": np.repeat(self.functions.names, p).tolist()}
        columns |= {name: list(values) * f for name, values in mode_columns.items()}
        columns |= {"value": self.values.ravel(), "sigma": self.sigma.ravel(), "seen": self.seen.ravel()}
        return tables.table_of(columns, self._plain_facts(), {"value": "uas", "sigma": "uas"})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Powers by function and degree, on matplotlib axes."""
        from fit.in_time._plot import plot_in_time

        return plot_in_time(self, ax=ax)


def _test_against_zero(values, coefficient_covariance, is_seen):
    """Compute χ² against zero of the coefficients that are seen, and count those."""
    seen = np.flatnonzero(is_seen)
    if not len(seen):
        return 0.0, 0
    return float(values[seen] @ np.linalg.solve(coefficient_covariance[np.ix_(seen, seen)], values[seen])), len(seen)
