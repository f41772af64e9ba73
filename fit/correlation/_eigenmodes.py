"""An orthogonal basis on the given sky: fields that are measured independently of each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import eigh

from fit.normal import normal_equations
from fit.storage import Result
from vsh import Coefficients, tables
from vsh.checks.types import ArrayLike, FloatArray, Table
from vsh.field import Field
from vsh.modes import Modes, as_modes


@dataclass(frozen=True, eq=False)
class Eigenmodes(Result):
    """Fields that a sky measures independently of each other, from the worst to the best.

    Attributes
    ----------
    information : (p,) array
        Rising. How well each is measured against a uniform sky of the same weight: 1 is as well, 0.01 with
        ten times the error.
    fields : list of Coefficients
        Each of ∫|V|² dΩ = 1.
    frame : str
    """

    information: FloatArray
    fields: list
    frame: str

    def report(self) -> str:
        """How well the best and the worst are measured, as text."""
        error = 1 / np.sqrt(self.information)
        lines = [
            f"Fields that this sky measures independently ({self.frame} axes): {len(error)}, with errors of "
            f"{error[-1]:.3f} (best) to {error[0]:.3g} (worst) times those of the same weight on a uniform sky",
            "The worst, with what they are made of:",
        ]
        for i, field in enumerate(self.fields[:3]):
            names = list(map(str, field.modes))
            largest = np.argsort(-np.abs(field.values))[:3]
            made = ", ".join(f"{field.values[k]:+.2f} {names[k]}" for k in largest)
            lines.append(f"  {error[i]:>8.3g} × the error   {made}")
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """Information of each as an astropy Table, from the worst to the best."""
        return tables.table_of({"information": self.information}, {"frame": self.frame})

    def plot(self, n_fields: int = 2, *, ax: Any = None) -> Any:
        """The worst and the best as maps of arrows; on matplotlib axes.

        Parameters
        ----------
        n_fields : int
            How many of the worst and of the best.
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.correlation._plot import plot_eigenmodes

        return plot_eigenmodes(self, n_fields, ax=ax)


def eigenmodes(sources: Any, modes: Modes | int, *, sigma: ArrayLike | None = None) -> Eigenmodes:
    """An orthogonal basis on the given sky.

    Parameters
    ----------
    sources
        As for `leakage`.
    modes : Modes, or the degree lmax
        What to fit.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    Eigenmodes
        Solutions of N v = λ M v, M the normal matrix of a uniform sky of the same total weight.
    """
    modes = as_modes(modes)
    field = Field.without_motions(sources, sigma)
    normal = normal_equations(field, modes).matrix
    # ∫ |V|² dΩ = Σ norm2 c²; a uniform sky measures its mean, by half the trace of the weights.
    norm = np.diag(modes.norm2.astype(float))
    values, vectors = eigh(normal, norm)
    even = field.information.sum() / 2 / (4 * np.pi)
    return Eigenmodes(values / even, [Coefficients(modes, v) for v in vectors.T], field.frame)
