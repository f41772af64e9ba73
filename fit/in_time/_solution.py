"""Coefficients of functions of time × harmonics: what they say of the sky at any time, and of the frame."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.in_time._functions import Functions
from fit.quality import Quality, f_p_value, printed_p_value
from fit.storage import Result, coefficient_columns
from vsh.coefficients import Coefficients
from vsh.io import tables
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.arguments import covariance, float_array
from vsh.tools.errors import ModesError
from vsh.tools.files import atomic_write
from vsh.tools.notes import note_lines
from vsh.tools.types import AxesArray, FloatArray, Kind, OnAxes, PathName, Table
from vsh.vector import Vector

#: So much of a coefficient's own direction must be seen for it to be printed as determined.
SEEN = 0.99


@dataclass(frozen=True, eq=False, repr=False)
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
        """What χ² says of the errors."""
        return Quality(self.chi2, self.dof)

    @property
    def scaled(self) -> "TimeSolution":
        """The same with errors scaled by √(χ²/dof)."""
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
        weight = self.functions([arguments.number("time", time)])[:, 0]
        f, p = self.values.shape
        spread = np.einsum("f,fpgq,g->pq", weight, self.covariance.reshape(f, p, f, p), weight)
        return Coefficients(self.modes, weight @ self.values), spread

    def vector(self, kind: Kind, time: float) -> Vector:
        """The `kind` "T", a rotation, or "S", a glide, at a `time` since the reference epoch [yr], a Vector in µas."""
        coefficients, spread = self.at(time)
        return coefficients.vector(kind, spread, self.frame, "µas")

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
        place = np.arange(len(self.modes))[self.modes.slice_of(kind, l)]
        norm = self.modes.norm2[place]
        at = row * len(self.modes) + place
        own = self.covariance[np.ix_(at, at)]
        chi2, rank = _test(self.values[row, place], own, self.seen[row, place] > SEEN)
        return (
            float(norm @ self.values[row, place] ** 2),
            float(norm @ np.diag(own)),
            f_p_value(chi2, rank, self.dof) if rank else float("nan"),
        )

    def rest(self, kind: Kind) -> tuple[float, int, float]:
        """Whether degree 1 changes with time, all functions together: χ², unknowns, p-value.

        Parameters
        ----------
        kind : {"T", "S"}
            The rotation, which is seen where the attitude is known, or the glide.
        """
        place = np.arange(len(self.modes))[self.modes.slice_of(kind, 1)]
        at = (np.arange(len(self.functions))[:, None] * len(self.modes) + place).ravel()
        chi2, rank = _test(self.values.ravel()[at], self.covariance[np.ix_(at, at)], self.seen.ravel()[at] > SEEN)
        return chi2, rank, f_p_value(chi2, rank, self.dof) if rank else float("nan")

    def report(self) -> str:
        """Powers by function and degree, and whether the frame is at rest, as text."""
        start, end = self.functions.span
        lines = [
            f"Displacements that change with time: {len(self.functions)} functions × degrees 1 to {self.modes.lmax}, "
            f"{self.n_sources} sources",
            f"from {start:+.2f} to {end:+.2f} yr about the reference epoch; attitude "
            + ("known from elsewhere" if self.attitude == "known" else f"solved from the same sky, {self.attitude}"),
            f"χ²/dof           {self.quality.reduced:.4f} with {self.dof} degrees of freedom",
        ]
        warning = self.quality.warning()
        if warning:
            lines.append(f"warning: {warning}")
        for kind, what in (("S", "glide"), ("T", "rotation")):
            chi2, rank, p_value = self.rest(kind)  # type: ignore[arg-type]
            label = f"{what} in time"
            if rank:
                lines.append(f"{label:16} χ² {chi2:.1f} of {rank} unknowns, p = {printed_p_value(p_value)}")
            else:
                lines.append(f"{label:16} not seen: an attitude solved from the same sky takes all of it")
        lines.append(f"{'function':12}{'degree':>8}{'√power [µas]':>14}{'√noise':>10}{'p':>10}")
        for name in self.functions.names:
            for l in range(1, self.modes.lmax + 1):
                for kind in "TS":
                    power, noise, p_value = self.power(name, kind, l)  # type: ignore[arg-type]
                    if np.isfinite(p_value):
                        lines.append(
                            f"{name:12}{f'{kind}{l}':>8}{np.sqrt(power):>14.3g}{np.sqrt(noise):>10.3g}"
                            f"{printed_p_value(p_value):>10}"
                        )
        if self.lost:
            lines.append(
                f"{len(self.lost)} combinations are taken by the sources' own positions, parallaxes and motions, "
                "and held at zero:"
            )
            lines += [f"  {each}" for each in self.lost[:5]]
            if len(self.lost) > 5:
                lines.append(f"  and {len(self.lost) - 5} more")
        return "\n".join([*lines, *note_lines(self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each function and coefficient, as an astropy Table."""
        f, p = self.values.shape
        each = coefficient_columns(self.modes)
        columns: dict[str, Any] = {"function": np.repeat(self.functions.names, p).tolist()}
        columns |= {name: list(values) * f for name, values in each.items()}
        columns |= {"value": self.values.ravel(), "sigma": self.sigma.ravel(), "seen": self.seen.ravel()}
        return tables.table_of(columns, self._plain_facts(), {"value": "uas", "sigma": "uas"})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Powers by function and degree, on matplotlib axes."""
        from fit.in_time._plot import plot_in_time

        return plot_in_time(self, ax=ax)

    def movie(self, path: PathName, frames: int = 40) -> None:
        """Write the sky that moves, over the span, as a GIF.

        Parameters
        ----------
        path : str or Path
            The file, ending in .gif.
        frames : int
            How many pictures.
        """
        moving = self.movie_bytes(frames)
        with atomic_write(path) as out:
            out.write_bytes(moving)

    def movie_bytes(self, frames: int = 40) -> bytes:
        """The same as the bytes of a GIF of so many `frames`, for a page."""
        from fit.in_time._plot import movie_of

        return movie_of(self, frames)


def _test(values, spread, seen):
    """χ² against zero of the coefficients that are seen, and how many those are."""
    at = np.flatnonzero(seen)
    if not len(at):
        return 0.0, 0
    return float(values[at] @ np.linalg.solve(spread[np.ix_(at, at)], values[at])), len(at)
