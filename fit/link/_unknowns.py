"""What a frame may be turned by: orientation and spin, in steps and powers of magnitude and colour."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vsh.sky.sphere import triad
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import ArrayLike, FloatArray

_AXES = "xyz"
#: Vectors that can be unknown: their names, and the unit of each.
VECTORS = {"orientation": ("epsilon", "µas"), "spin": ("omega", "µas/yr"), "acceleration": ("a", "µas/yr")}
#: Magnitude and colour from which powers are counted.
_ZERO = {"magnitude": 13.0, "colour": 1.0}


@dataclass(frozen=True)
class Unknowns(InNotebook):
    """Which vectors are sought, and how those of the frame change with magnitude and colour.

    Attributes
    ----------
    vectors : tuple of str
        Some of "orientation", "spin" and "acceleration". The acceleration is that of the Solar System: one for all.
    turned : tuple of str
        The catalogues that are turned against the reference.
    steps : tuple of float
        Magnitudes from which on (fainter) a frame is turned by so much more.
    order : int
        Powers of (G − 13 mag), each.
    colour_order : int
        Powers of (colour − 1 mag), each.
    epoch : float
        The epoch of the orientation. [Julian year]
    """

    vectors: tuple[str, ...]
    turned: tuple[str, ...]
    steps: tuple[float, ...] = ()
    order: int = 0
    colour_order: int = 0
    epoch: float = 2016.0

    def __post_init__(self) -> None:
        """Check what a caller may have mixed up."""
        wrong = [each for each in self.vectors if each not in VECTORS]
        if wrong or not self.vectors:
            raise ParameterError(f"unknowns are of {', '.join(VECTORS)}, not {', '.join(map(str, wrong)) or 'none'}")
        if len(set(self.steps)) < len(self.steps) or not np.isfinite(self.steps).all():
            raise ParameterError(f"steps are different magnitudes, not {self.steps}")

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the functions of magnitude and colour; that of the constant is empty."""
        return (
            "",
            *(f" at {step:g}" for step in self.steps),
            *(f"[(G-13)^{k}]" for k in range(1, self.order + 1)),
            *(f"[(colour-1)^{k}]" for k in range(1, self.colour_order + 1)),
        )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, that of a catalogue before them where several are turned."""
        names = []
        for catalogue in self.turned:
            before = f"{catalogue}:" if len(self.turned) > 1 else ""
            for vector in self.vectors:
                if vector != "acceleration":
                    names += [_name(before, vector, axis, term) for term in self.terms for axis in _AXES]
        return (*names, *(f"a_{axis}" for axis in _AXES if "acceleration" in self.vectors))

    @property
    def levels(self) -> tuple[tuple[str, float | None], ...]:
        """Ranges of magnitude between the steps, in words, each with a magnitude within it."""
        edges = sorted(self.steps)
        if not edges:
            return (("", None),)
        between = [f"{low:g} ≤ G < {high:g}" for low, high in pairwise(edges)]
        inside = [np.nextafter(edges[0], -np.inf), *edges]
        return tuple(zip([f"G < {edges[0]:g}", *between, f"G ≥ {edges[-1]:g}"], inside, strict=True))

    def functions(self, magnitude: ArrayLike, colour: ArrayLike | None = None) -> FloatArray:
        """The functions of `terms` at each `magnitude` and `colour`, (k, n); nan where that is not known."""
        magnitude = np.atleast_1d(np.asarray(magnitude, float))
        colour = np.full(magnitude.shape, np.nan) if colour is None else np.atleast_1d(np.asarray(colour, float))
        unknown = np.where(np.isnan(magnitude), np.nan, 0.0)
        rows = [np.ones(magnitude.shape), *((magnitude >= step) + unknown for step in self.steps)]
        rows += [(magnitude - _ZERO["magnitude"]) ** k for k in range(1, self.order + 1)]
        rows += [(colour - _ZERO["colour"]) ** k for k in range(1, self.colour_order + 1)]
        return np.array(rows)

    def jump(self, vector: str, catalogue: str, step: float) -> FloatArray:
        """What of the parameters makes the jump of a `vector` of one `catalogue` at a `step`, (3, p)."""
        at = self.combination(vector, catalogue, step)
        return at - self.combination(vector, catalogue, np.nextafter(step, -np.inf))

    def combination(
        self, vector: str, catalogue: str, magnitude: float | None = None, colour: float | None = None
    ) -> FloatArray:
        """What of the parameters makes a vector of one catalogue at a magnitude, (3, p); the constants unless given.

        Parameters
        ----------
        vector : str
            "orientation", "spin" or "acceleration".
        catalogue : str
            The one that is turned.
        magnitude, colour : float, optional
            Where.

        Raises
        ------
        ParameterError
            If the frame depends on colour and none is given.
        """
        values = self.functions(np.nan if magnitude is None else magnitude, None if colour is None else [colour])[:, 0]
        if magnitude is None:
            values = np.where(np.isnan(values), 0.0, values)
        if np.isnan(values).any():
            raise ParameterError("the frame depends on colour here: say at which")
        names = self.names
        before = f"{catalogue}:" if len(self.turned) > 1 else ""
        matrix = np.zeros((3, len(names)))
        terms = self.terms if vector != "acceleration" else ("",)
        for k, axis in enumerate(_AXES):
            for term, value in zip(terms, values, strict=False):
                name = _name("" if vector == "acceleration" else before, vector, axis, term)
                matrix[k, names.index(name)] = value
        return matrix

    def design(
        self, lon: FloatArray, lat: FloatArray, epoch: FloatArray, functions: FloatArray, catalogue: str
    ) -> FloatArray:
        """Derivatives of Δα*, Δδ, ϖ, µ_α*, µ_δ by the parameters, for rows of one catalogue, (n, 5, p).

        The frame turns what it gives by ε + ω (t − epoch) (`fit.frame`): Δα* = q·ε, Δδ = −p·ε.

        Parameters
        ----------
        lon, lat, epoch : (n,) arrays
            Places [rad] and epochs of the rows. [Julian year]
        functions : (k, n) array
            The functions of `terms` there.
        catalogue : str
            The one that they are of.
        """
        n, names = len(lon), self.names
        design = np.zeros((n, 5, len(names)))
        if catalogue not in self.turned:
            return design
        p, q, _ = triad(lon, lat)
        turn = np.stack([q.T, -p.T], 1)  # (n, 2, 3)
        start = self.turned.index(catalogue) * sum(3 * len(self.terms) for v in self.vectors if v != "acceleration")
        for vector in self.vectors:
            if vector == "acceleration":
                continue
            for values in functions:
                part = slice(start, start + 3)
                if vector == "orientation":
                    design[:, :2, part] = values[:, None, None] * turn
                else:
                    design[:, :2, part] = (values * (epoch - self.epoch))[:, None, None] * turn
                    design[:, 3:, part] = values[:, None, None] * turn
                start += 3
        return design


def _name(before, vector, axis, term):
    """The name of a parameter: what a step adds is a jump, not the value beyond it."""
    component = f"{before}{VECTORS[vector][0]}_{axis}{term}"
    return f"jump {component}" if term.startswith(" at ") else component
