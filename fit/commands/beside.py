"""What `vsh-fit` does beside the fit: classes of sources, backgrounds (floor, waves), and templates of systematics."""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import fit
import vsh
from vsh.commands import parsing, reading
from vsh.tools.errors import EmptySelectionError, ModesError, ParameterError, VshError


def compare_subsets(
    run: Any, source: Any, path: str, estimate: Any, templates: Sequence[Any] = (), n_sources: int = 0
) -> Any:
    """Normal equations of each class by the weights of the `estimate`, and the systematic errors.

    Those of `n_sources` that are in no class are counted.
    """
    options = run.options
    classes = vsh.Classes.from_text(options.classes)
    read = partial(run.read, source, path, roles=())
    subsets: list[Any]
    if classes.frame:
        subsets = list(classes.split(read()))
    else:
        conditions = [_and(options.where, condition) for condition in classes.conditions]
        subsets = [_class(read, *item) for item in zip(classes.labels, conditions, strict=True)]
        if ";" in options.classes:
            either = " or ".join(f"({condition})" for condition in classes.conditions)
            _check_apart(read(where=_and(options.where, either)), classes, subsets)
    lmax, inside = estimate.solution.modes.lmax, 0
    if estimate.method == "clip":
        inside = sum(vsh.io.parts.as_parts(subset).sum(len) for subset in subsets)
        subsets = [fit.estimate(subset, lmax, *parsing.method_and_value(options.method)).sources for subset in subsets]
    subsets = [subset.to_frame(options.frame) for subset in subsets]
    make = partial(estimate.equations, templates=templates)
    normals = [make(subset, lmax) for subset in subsets]
    normals = fit.background.widened(normals, make, subsets)
    comparison = fit.background.shared(
        normals, range(2, lmax + 1), labels=classes.labels, noise_scale=estimate.is_scaled, rng=options.seed
    )
    inside, notes = inside or sum(item.n_sources for item in normals), []
    if n_sources > inside:
        notes.append(f"{n_sources - inside} of {n_sources} sources are in no class: no value, or between conditions")
    return replace(comparison, notes=(*comparison.notes, *notes, estimate.class_note))


def _and(selection, condition):
    """The rows that are expected, and of those the ones that fulfil a condition."""
    return condition if selection is None else f"({selection}) and ({condition})"


def _class(read, label, condition):
    try:
        return read(where=condition)
    except EmptySelectionError:
        raise ParameterError(f"the class {label} is empty: choose other edges, or leave it out") from None


def _check_apart(union, classes, subsets):
    """Raise ParameterError where a source is in two classes."""
    counts = [vsh.io.parts.as_parts(subset).sum(len) for subset in subsets]
    total = vsh.io.parts.as_parts(union).sum(len)
    if sum(counts) > total:
        raise ParameterError(
            f"{sum(counts) - total} sources are in more than one of the classes {'; '.join(classes.labels)}: make them "
            "exclude each other"
        )


#: Waves beside a floor are looked for to this degree.
_HIGHEST = 7


#: Captions of the figures.
CAPTIONS = {
    "shared": "Spin and acceleration of the classes, with common systematic errors.",
    "cross_powers": "What of the solution follows each template, by degree, in errors with the floor.",
    "waves": "Energy in gravitational waves: posteriors and 95 % limits.",
}


def limit_on_waves(plain: Any, has_floor: bool, years: float | None) -> Any:
    """The limit on gravitational waves from a fit without a floor, systematics beside them where there is a floor."""
    if plain.modes.lmax < 2:
        raise ModesError("gravitational waves begin at degree 2: take --lmax 2 or higher")
    systematics: dict[str, Any] = {}
    if has_floor and plain.modes.lmax >= 3:  # the higher degrees show which power of degree 2 is no wave
        shapes = list(fit.background.SHAPES.values())
        systematics = {"degrees": range(2, min(plain.modes.lmax, _HIGHEST) + 1), "systematics": shapes}
    return replace(fit.background.wave_limit(plain, **systematics), years=years)


def with_floor(plain: Any) -> Any:
    """A fit with the systematic floor in its errors."""
    if plain.modes.lmax < 3:
        raise ModesError(f"degree {plain.modes.lmax} cannot determine a systematic floor: use --lmax 3 or higher")
    solution = fit.solve(fit.background.equations_of(plain), floor=fit.background.floor(plain))
    return replace(solution, formal_covariance=plain.formal.covariance)


#: A floor beside templates is estimated up to this degree.
_MAPPED = 10
#: The sources' own density; everything else is a file or a column.
_DENSITY = "density"


def template(word: str, run: Any, source: Any, path: str, field: Any) -> Any:
    """The template of a name: `density`, a HEALPix map (FITS), a solution of motions (ECSV), or a column."""
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
    return _column(word, run, source, path)


def _column(name, run, source, path):
    """Numbers of a column at the places of the sources that are read."""
    from vsh.io import catalogue

    arguments = reading.arguments(run.options)
    if reading.in_parts(run.options):
        chunks = catalogue.stream_columns(source, [name], **arguments)
        pairs = ((field.to_frame("icrs"), columns[name]) for field, columns in chunks)
        return fit.background.Template.of_parts(name, ((field.lon, field.lat, values) for field, values in pairs))
    field = run.read(source, path, roles=())
    return fit.background.Template.of_sources(
        name, field.lon, field.lat, catalogue.read_columns(source, [name], **arguments)[name], field.frame
    )


def cross_powers_of(solution: Any, floor: Any, templates: list[Any]) -> Any:
    """Project a solution without a prior on the templates; errors include the floor, of the run if it has one.

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
