"""One fit of the study: clipped, with formal errors and those of a bootstrap."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit import Solution
from fit.resample import bootstrap
from fit.robust import clip
from vsh import Field
from vsh.errors import VshError
from vsh.types import Rng

#: As in the paper.
KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class DegreeOrSubset:
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
    """Clip, fit and draw again.

    Parameters
    ----------
    name : str
        Of the row.
    field : Field
        The sources.
    lmax : int
        The highest degree.
    n_replicates : int
        Of the bootstrap.
    rng : Generator or int
        The source of all randomness.

    Returns
    -------
    DegreeOrSubset
        Half a sky may not determine all coefficients, few sources may not settle: `said` tells.
    """
    try:
        clipped = clip(field, lmax, KAPPA)
        kept = field[clipped.kept]
        found = bootstrap(kept, lmax, n_replicates, rng, progress=False).resampled_solution
    except VshError as error:
        return DegreeOrSubset(name, len(field), 0, None, None, str(error))
    # What was kept because it fits scatters too little, and counts too much: twice the correction of the clip.
    covariance, quality = found.covariance * clipped.factor**4, clipped.solution
    found = replace(found, covariance=covariance, chi2=quality.chi2, notes=quality.notes)
    return DegreeOrSubset(name, len(field), int(np.sum(~np.asarray(clipped.kept))), clipped.solution, found)
