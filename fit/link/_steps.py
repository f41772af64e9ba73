"""Where a frame jumps: the magnitude of a step, from the data."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import logsumexp

from fit.link._link import link
from fit.link._solution import LinkSolution
from fit.output import Answer
from fit.quality import SEEN, printed_p_value
from fit.storage import Result
from vsh.io import tables
from vsh.sky.astrometry import AstrometryRows
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.types import Axes, FloatArray, Table

#: Places that are tried unless given, and how many sources are left to either side.
_PLACES, _BESIDE = 12, 6


@dataclass(frozen=True, eq=False)
class StepSearch(Result):
    """How probable each magnitude is as the place of a jump, and whether there is one.

    Attributes
    ----------
    places : (m,) array
        Magnitudes from which on the frame is turned otherwise, rising.
    probability : (m,) array
        That of each, if there is one jump, at one of them.
    p_values : (m,) array
        That of no jump at each, of all components together, as if no other had been tried.
    p_value : float
        That of no jump anywhere: the smallest, allowing for all.
    solution : LinkSolution
        The link with the most probable step.
    whole : LinkSolution
        The link without a step.
    """

    places: FloatArray
    probability: FloatArray
    p_values: FloatArray
    p_value: float
    solution: LinkSolution
    whole: LinkSolution

    def __repr__(self) -> str:
        return f"<StepSearch: {len(self.places)} places, G = {self.place:.4g} most probable, p = {self.p_value:.2g}>"

    @property
    def answer(self) -> Answer:
        """The result to quote: the link without a step where no jump is detected, and the jump after all places."""
        with_step = dict(self.solution.answer.lines)
        jump = {label: words for label, words in with_step.items() if label.startswith("jump")}
        if self.p_value < SEEN:
            return self.solution.answer
        lines = dict(self.whole.answer.lines)
        errors = lines.pop("errors")
        return Answer(tuple((lines | jump | {"errors": f"{errors}, without a jump"}).items()))

    @property
    def verdict(self) -> str:
        """The result to quote in one sentence."""
        return self.answer.sentence

    @property
    def place(self) -> float:
        """The most probable magnitude."""
        return float(self.places[self.probability.argmax()])

    @property
    def interval(self) -> tuple[float, float]:
        """What the most probable places that hold 68 % together span, each half way to those beside it."""
        order = np.argsort(-self.probability, kind="stable")
        held = np.searchsorted(np.cumsum(self.probability[order]), 0.68) + 1
        chosen = order[:held]
        edges = np.r_[self.places[0], (self.places[1:] + self.places[:-1]) / 2, self.places[-1]]
        return float(edges[chosen.min()]), float(edges[chosen.max() + 1])

    def report(self, *, long: bool = False) -> str:
        """Whether there is a jump and where, as text.

        Parameters
        ----------
        long : bool
            Add each place, and what `LinkSolution.report` adds.
        """
        low, high = self.interval
        lines = [
            f"p = {printed_p_value(self.p_value)} of a jump as large by chance, at any of {len(self.places)} places",
            f"if there is one, G = {self.place:.4g} is most probable; 68 %: {low:.4g} to {high:.4g}",
        ]
        if long:
            lines.append(f"{'fainter than':>12}{'probability':>14}{'p of no jump':>14}")
            lines += [
                f"{place:12.2f}{probability:14.3f}{printed_p_value(float(p)):>14}"
                for place, probability, p in zip(self.places, self.probability, self.p_values, strict=True)
            ]
            lines.append(f"{printed_p_value(float(self.p_values.min()))} for the largest jump alone")
        return "\n".join(lines) + "\n\nWith a jump at the most probable place: " + self.solution.report(long=long)

    def to_table(self) -> Table:
        """The places as an astropy Table, a row each."""
        columns = {"magnitude": self.places, "probability": self.probability, "p_value": self.p_values}
        return tables.table_of(columns, {"p_value": self.p_value}, {"magnitude": "mag"})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Probability of each place, on matplotlib axes."""
        from fit.link._plot import plot_steps

        return plot_steps(self, ax=ax)


@arguments.accepts(astrometry=arguments.a(AstrometryRows))
def find_step(astrometry: AstrometryRows, places: Sequence[float] | None = None, **options: Any) -> StepSearch:
    """Find the magnitude at which a frame jumps, in orientation and spin.

    Parameters
    ----------
    astrometry : AstrometryRows
        Rows of all catalogues, as for `link`.
    places : sequence of float, optional
        Magnitudes to try; 12 between those of the sources, as many to the left of each as to the right of the one
        before, unless given.
    **options
        As `link` takes them.

    Returns
    -------
    StepSearch
        The probability of each place if there is a jump, and that of no jump.

    Raises
    ------
    ParameterError
        If `steps` are given beside it, or there are fewer than two places.
    DegeneracyError
        If there are too few sources, or as `link` does.

    Notes
    -----
    Places are weighed by the evidence of the link with a step there, the jump beforehand as wide as its errors times
    one factor for all places (Zellner's g): flat in the jump, the few sources beyond a place near the ends would win
    by what they do not know. The p-value is the smallest times the number of places (Šidák): too large where
    neighbouring ones hold nearly the same sources.
    """
    if "steps" in options:
        raise ParameterError("steps are what is sought: say at which magnitudes with places")
    tried = _between(astrometry) if places is None else np.unique(np.asarray(places, float))
    if tried.ndim != 1 or len(tried) < 2 or not np.isfinite(tried).all():
        raise ParameterError(f"two magnitudes at least are wanted as places of a jump, not {places!r}")
    solutions = [link(astrometry, steps=[float(place)], **options) for place in tried]
    unknown = [np.linalg.slogdet(each.jump_covariance(x))[1] for each, x in zip(solutions, tried.tolist(), strict=True)]
    evidence = np.array([each.log_evidence for each in solutions]) - np.array(unknown) / 2
    best = solutions[int(evidence.argmax())]
    each = np.array([solution.jump_p_values(place) for solution, place in zip(solutions, tried.tolist(), strict=True)])
    together = -np.expm1(len(tried) * np.log1p(-np.minimum(each.min(axis=0), 1 - 1e-16)))
    whole = link(astrometry, **options)
    best = replace(best, searched=tuple(map(float, together)))
    return StepSearch(tried, np.exp(evidence - logsumexp(evidence)), each[:, 0], float(together[0]), best, whole)


def _between(astrometry):
    """Magnitudes between those of the sources, some of these left to either side."""
    _, first = np.unique(astrometry.source, return_index=True)
    known = np.sort(astrometry.magnitude[first][np.isfinite(astrometry.magnitude[first])])
    if len(known) < 2 * _BESIDE + 2:
        raise DegeneracyError(
            f"{len(known)} sources with a magnitude are too few to look for a jump among: {2 * _BESIDE + 2} at least"
        )
    at = np.unique(np.linspace(_BESIDE, len(known) - _BESIDE, _PLACES).astype(int))
    return np.unique((known[at - 1] + known[at]) / 2)
