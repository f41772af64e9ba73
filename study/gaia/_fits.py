"""One fit of the study: clipped, with formal errors and those of a bootstrap."""

from __future__ import annotations

from dataclasses import dataclass, replace

from fit import Solution
from fit.resample import bootstrap
from fit.robust import clip
from vsh import Field
from vsh.checks.notebook import InNotebook
from vsh.checks.types import Rng
from vsh.errors import VshError

#: As in the paper.
KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class DegreeOrSubset(InNotebook):
    """What one fit found, or why it found nothing.

    Attributes
    ----------
    name : str
    n_sources, n_clipped : int
    solution : Solution or None
        With the catalogue's errors.
    resampled : Solution or None
        With those of the bootstrap.
    said : str
        Why there is no solution.
    """

    name: str
    n_sources: int
    n_clipped: int
    solution: Solution | None
    resampled: Solution | None
    said: str = ""


def fit_sources(name: str, field: Field, lmax: int, n_replicates: int, rng: Rng) -> DegreeOrSubset:
    """Clip, fit and draw again."""
    try:
        clipped = clip(field, lmax, KAPPA)
        found = bootstrap(clipped.sources(field), lmax, n_replicates, rng, progress=False).resampled_solution
    except VshError as error:
        return DegreeOrSubset(name, len(field), 0, None, None, str(error))
    covariance, quality = found.covariance * clipped.scatter_factor, clipped.solution
    found = replace(found, covariance=covariance, chi2=quality.chi2, notes=quality.notes)
    return DegreeOrSubset(name, len(field), clipped.n_clipped, quality, found)
