"""Which sources to observe next: what planned astrometry would add to a link."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.link._rows import equations
from fit.link._solution import LinkSolution
from fit.storage import Result
from vsh.io import tables
from vsh.sky.astrometry import AstrometryRows
from vsh.tools import arguments
from vsh.tools.types import Axes, FloatArray, Table

#: How many candidates a short report lists.
_LISTED = 8


@dataclass(frozen=True, eq=False)
class LinkPlan(Result):
    """Candidates in the order in which they tell most of a link, each after those before it.

    Attributes
    ----------
    names : tuple of str
        Names of the parameters.
    candidates : tuple of str
        Names of the sources, the best first.
    gain : (n,) array
        ln of the factor by which the volume of the parameters' errors shrinks with each.
    sigma : (n, p) array
        Errors of the parameters when it and all before it have been observed.
    before : (p,) array
        Errors today.
    """

    names: tuple[str, ...]
    candidates: tuple[str, ...]
    gain: FloatArray
    sigma: FloatArray
    before: FloatArray

    def __repr__(self) -> str:
        return f"<LinkPlan: {len(self.candidates)} candidates, {self.candidates[0]} first>"

    def report(self, *, long: bool = False) -> str:
        """The first candidates in their order, as text.

        Parameters
        ----------
        long : bool
            All of them.
        """
        lines = [f"{'observe next':24}{'gain':>8}   errors of {', '.join(self.names)}"]
        lines.append(f"{'(today)':24}{'':8}   " + " ".join(f"{each:.3g}" for each in self.before))
        shown = len(self.candidates) if long else _LISTED
        for name, gain, sigma in list(zip(self.candidates, self.gain, self.sigma, strict=True))[:shown]:
            lines.append(f"{name:24}{gain:8.3f}   " + " ".join(f"{each:.3g}" for each in sigma))
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """The candidates as an astropy Table, a row each."""
        columns: dict[str, Any] = {"source": np.array(self.candidates, dtype=str), "gain": self.gain}
        columns |= {f"sigma_{name}": column for name, column in zip(self.names, self.sigma.T, strict=True)}
        return tables.table_of(columns, {})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Errors against the number of candidates that have been observed, on matplotlib axes."""
        from fit.link._plot import plot_plan

        return plot_plan(self, ax=ax)


@arguments.accepts(solution=arguments.a(LinkSolution), candidates=arguments.a(AstrometryRows))
def forecast(solution: LinkSolution, candidates: AstrometryRows) -> LinkPlan:
    """Order candidates by what their astrometry, as planned, would add to a link.

    Parameters
    ----------
    solution : LinkSolution
        The link today.
    candidates : AstrometryRows
        Rows of all catalogues that the candidates have or will have: places, epochs and covariances count, values do
        not.

    Returns
    -------
    LinkPlan
        The candidates that tell anything, the best first.

    Raises
    ------
    FieldError
        As `link` does.
    DegeneracyError
        If no candidate tells anything.

    Notes
    -----
    Each step takes the candidate with the largest gain of ln det of the inverse covariance. Errors are those that were
    found, tails and size, in the mean over skies.
    """
    fixed = {solution.reference: 2015.0} if solution.reference in candidates.catalogues else {}
    raw, _ = equations(candidates, solution.unknowns, fixed=fixed, aberration=None)
    rows = raw.eliminated(solution.excess, 1.0, solution.reference)
    tails, d = solution.tails, rows.dims
    ratio = (1 - tails.share) * (tails.nu + d) / (tails.nu + d + 2) / solution.scale**2
    blocks = [weight * rows.design[mine].T @ rows.design[mine] for weight, mine in zip(ratio, rows.parts, strict=True)]
    matrix = np.linalg.inv(solution.covariance)
    left = list(range(len(blocks)))
    order, gains, sigmas = [], [], []
    while left:
        now = np.linalg.slogdet(matrix)[1]
        gain = np.array([np.linalg.slogdet(matrix + blocks[i])[1] - now for i in left]) / 2
        best = int(gain.argmax())
        order.append(left.pop(best))
        gains.append(gain[best])
        matrix = matrix + blocks[order[-1]]
        sigmas.append(np.sqrt(np.diag(np.linalg.inv(matrix))))
    return LinkPlan(
        solution.names, tuple(rows.names[i] for i in order), np.array(gains), np.array(sigmas), solution.sigma
    )
