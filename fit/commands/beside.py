"""What `vsh-fit` does beside the fit: classes of sources, backgrounds (floor, waves), and templates of systematics."""

import argparse
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import fit
import vsh
from vsh.commands import parsing, reading
from vsh.tools.errors import ModesError, NothingSelectedError, ParameterError, VshError


def shared_by(
    source: Any,
    path: str,
    options: argparse.Namespace,
    estimate: Any,
    templates: Sequence[Any] = (),
    n_sources: int = 0,
) -> Any:
    """Normal equations of each class by the weights of the `estimate`, and what they share.

    Those of `n_sources` that are in no class are counted.
    """
    classes = vsh.Classes.from_text(options.classes)
    parts: list[Any]
    if classes.frame:
        parts = list(classes.split(_read(source, path, options, options.where)))
    else:
        parts = [_class(source, path, options, *each) for each in zip(classes.labels, classes.conditions)]
        if ";" in options.classes:
            _check_apart(source, path, options, classes, parts)
    lmax, inside = estimate.solution.modes.lmax, 0
    method, value = parsing.method_and_value(options.method)
    if method == "clip":
        inside = sum(vsh.io.parts.as_parts(part).sum(len) for part in parts)
        parts = [fit.estimate(part, lmax, method, value).sources for part in parts]
    parts = [part.to_frame(options.frame) for part in parts]
    make = partial(estimate.equations, templates=templates)
    normals = [make(part, lmax) for part in parts]
    normals = fit.background.widened(normals, make, parts)
    together = fit.background.shared(
        normals, range(2, lmax + 1), labels=classes.labels, noise_scale=estimate.is_scaled, rng=options.seed
    )
    inside, notes = inside or sum(each.n_sources for each in normals), []
    if n_sources > inside:
        notes.append(f"{n_sources - inside} of {n_sources} sources are in no class: no value, or between conditions")
    return replace(together, notes=(*together.notes, *notes, estimate.class_note))


def _read(source, path, options, where):
    from vsh.io import catalogue

    if reading.in_parts(options):
        return catalogue.parts(path, **reading.reading_parts(options) | {"where": where})
    return catalogue.read_field(source, **reading.arguments(options) | {"where": where}, roles=())


def _class(source, path, options, label, condition):
    where = condition if options.where is None else f"({options.where}) and ({condition})"
    try:
        return _read(source, path, options, where)
    except NothingSelectedError:
        raise ParameterError(f"the class {label} is empty: choose other edges, or leave it out") from None


def _check_apart(source, path, options, classes, parts):
    """Raise ParameterError where a source is in two classes."""
    whole = _class(source, path, options, "all", " or ".join(f"({condition})" for condition in classes.conditions))
    counts = [vsh.io.parts.as_parts(part).sum(len) for part in parts]
    total = vsh.io.parts.as_parts(whole).sum(len)
    if sum(counts) > total:
        raise ParameterError(
            f"{sum(counts) - total} sources are in more than one of the classes {'; '.join(classes.labels)}: make them "
            "exclude each other"
        )


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


#: A floor beside templates is estimated up to this degree.
_MAPPED = 10
#: The sources' own density; everything else is a file or a column.
_DENSITY = "density"


def templates_of(source: Any, path: str, field: Any, options: argparse.Namespace) -> list[Any]:
    """The templates that are named: `density`, HEALPix maps (FITS), solutions of motions (ECSV), columns."""
    return [_template(word, source, path, field, options) for word in options.templates]


def _template(word, source, path, field, options):
    if word == _DENSITY:
        return fit.background.Template.density(_DENSITY, field)
    if Path(word).is_file():
        name = Path(word).name
        if word.endswith(".ecsv"):
            solution = fit.storage.read(word)
            if not isinstance(solution, fit.Solution):
                raise ParameterError(f"--templates {name} is no solution of motions")
            return fit.background.Template(name, solution.coefficients, solution.frame or "icrs")
        return fit.background.Template(name, word)
    if word not in source.names:
        raise ParameterError(
            f"--templates {word}: there is no such file, and no such column in {source.label}; density is that of the "
            "sources"
        )
    return _column(word, source, options)


def _column(name, source, options):
    """Numbers of a column at the places of the sources that are read."""
    from vsh.io import catalogue

    given = reading.arguments(options)
    if reading.in_parts(options):
        parts = catalogue.stream_columns(source, [name], **given)
        placed = ((field.to_frame("icrs"), columns[name]) for field, columns in parts)
        return fit.background.Template.of_parts(name, ((field.lon, field.lat, values) for field, values in placed))
    field = catalogue.read_field(source, **given, roles=())
    return fit.background.Template.of_sources(
        name, field.lon, field.lat, catalogue.read_columns(source, [name], **given)[name], field.frame
    )


def cross_powers_of(solution: Any, floor: Any, templates: list[Any]) -> Any:
    """Project a solution without a prior on the templates; errors hold the systematic floor, of the run if it has one.

    The same equations as the floor's, so that the errors do not depend on whether the floor was put into the solution.
    """
    from fit.normal import template_fields

    if floor is None:
        with suppress(VshError):  # too few degrees, or too little of the sky
            floor = fit.background.floor(solution, range(2, min(solution.modes.lmax, _MAPPED) + 1))

    plain = fit.solve(fit.background.equations_of(solution))
    fields = template_fields(templates, plain.modes, plain.frame)
    if floor is None:
        return fit.background.cross_powers(plain, fields)
    plain = replace(plain, covariance=plain.covariance * floor.noise_scale**2)
    return fit.background.cross_powers(plain, fields, floor.spectrum)
