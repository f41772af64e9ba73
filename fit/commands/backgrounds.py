"""What `vsh-fit` does about backgrounds: the floor in the errors, the limit on gravitational waves."""

import argparse
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import fit
from vsh.tools.errors import ModesError

#: Waves beside a floor are looked for to this degree.
_HIGHEST = 7


@dataclass(frozen=True)
class Backgrounds:
    """What was found of backgrounds."""

    solution: Any
    results: dict[str, Any]
    years: float | None = None

    def texts(self, long: bool) -> list[str]:
        """The floor and the limit on waves as text; short, the lines to quote have them."""
        if not long:
            return []
        shown = [self.solution.floor.report()] if self.solution.floor is not None else []
        if "waves" in self.results:  # whose notes are those of the report above
            shown.append(replace(self.results["waves"], notes=()).report(self.years))
        return shown

    def write(self, folder: Path, meta: dict[str, Any]) -> None:
        """Write each result as a table."""
        for name, result in self.results.items():
            result.write(folder / f"{name}.ecsv", meta)

    def draw(self) -> dict[str, Any]:
        """Axes by name of file."""
        return {name: result.plot() for name, result in self.results.items() if name != "floor"}

    @property
    def captions(self) -> dict[str, str]:
        """Captions of the figures, for the page."""
        return {
            "shared": "Spin and acceleration of the classes, with errors that they share.",
            "cross_powers": "What of the solution follows each template, by degree, in errors with the floor.",
            "waves": "Energy in gravitational waves: posteriors and 95 % limits.",
        }


def backgrounds_of(estimate: Any, options: argparse.Namespace) -> Backgrounds:
    """Compute the wave limit and the systematic floor that the options ask for, or that the estimate has."""
    solution, plain = estimate.solution, estimate.plain
    results: dict[str, Any] = {}
    if options.waves:
        if plain.modes.lmax < 2:
            raise ModesError("gravitational waves begin at degree 2: take --lmax 2 or higher")
        beside: dict[str, Any] = {}
        has_floor = options.floor or solution.includes_floor
        if has_floor and plain.modes.lmax >= 3:  # the higher degrees tell what of degree 2 is no wave
            shapes = list(fit.background.SHAPES.values())
            beside = {"degrees": range(2, min(plain.modes.lmax, _HIGHEST) + 1), "systematics": shapes}
        results["waves"] = fit.background.wave_limit(plain, **beside)
    if options.floor and not solution.includes_floor:
        if plain.modes.lmax < 3:
            raise ModesError(f"degree {plain.modes.lmax} says nothing of a floor: take --lmax 3 or higher")
        solution = fit.solve(fit.background.equations_of(plain), floor=fit.background.floor(plain))
        solution = replace(solution, formal_covariance=plain.formal.covariance)
    if solution.floor is not None:
        results["floor"] = solution.floor
    return Backgrounds(solution, results, options.years)
