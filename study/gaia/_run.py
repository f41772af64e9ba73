"""All fits of the study."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from fit import CrossCheck, cross_check
from study.gaia._fits import DegreeOrSubset, fit_sources
from study.gaia._published import LMAX
from study.gaia._sources import FEWEST, Sources, subsets
from vsh.checks.arguments import generator
from vsh.checks.notebook import InNotebook
from vsh.checks.types import Rng
from vsh.errors import DegeneracyError
from vsh.system.progress import progress_bar


@dataclass(frozen=True, eq=False)
class GaiaStudy(InNotebook):
    """What was found.

    Attributes
    ----------
    sources : Sources
    degrees : list of DegreeOrSubset
        Five-parameter sources, highest degree 1, 2, …
    subsets : list of DegreeOrSubset
        Degree 3 (degree 1 for halves of the sky, which cannot bear more).
    check : CrossCheck
        Both solvers on the five-parameter sources.
    """

    sources: Sources
    degrees: list[DegreeOrSubset]
    subsets: list[DegreeOrSubset]
    check: CrossCheck

    @property
    def main(self) -> DegreeOrSubset:
        """The fit of degree 3 to all five-parameter sources."""
        return self.degrees[min(LMAX, len(self.degrees)) - 1]


def run_gaia(
    sources: Sources, *, max_lmax: int = 10, n_replicates: int = 500, rng: Rng = 1, progress: bool = True
) -> GaiaStudy:
    """Fit everything that the paper fits.

    Parameters
    ----------
    sources : Sources
        Of `read_gaia`.
    max_lmax : int
        The table of degrees goes from 1 to it.
    n_replicates : int
        Of each bootstrap.
    rng : Generator or int
        The source of all randomness.
    progress : bool
        Show a bar, after two seconds.

    Raises
    ------
    DegeneracyError
        If the five-parameter sources cannot bear the main fit.
    """
    five = sources.field[~sources.six]
    chosen = subsets(sources)
    if not len(five):
        raise DegeneracyError(f"{sources.label} holds no five-parameter solutions, which the study is about")
    work: list[Any] = [(f"degree {lmax}", five, lmax) for lmax in range(1, max_lmax + 1)]
    enough = {name: mask for name, mask in chosen.items() if mask.sum() >= FEWEST}
    work += [(name, sources.field[mask], 1 if "half" in name else LMAX) for name, mask in enough.items()]
    # A stream for each row, so that one more does not shift the others.
    streams = generator(rng).spawn(len(work))
    rows = []
    bar = progress_bar(list(zip(work, streams, strict=True)), words="fits", shown=progress)
    for (name, field, lmax), stream in bar:
        rows.append(fit_sources(name, field, lmax, n_replicates, stream))
    degrees, others = rows[:max_lmax], rows[max_lmax:]
    others += [DegreeOrSubset(name, int(mask.sum()), 0, None, None, f"{mask.sum()} sources, fewer than {FEWEST}")
               for name, mask in chosen.items() if name not in enough]  # fmt: skip
    study = GaiaStudy(sources, degrees, others, cross_check(five))
    if study.main.solution is None:
        raise DegeneracyError(f"the fit of degree {LMAX} to the five-parameter sources: {study.main.said}")
    return study
