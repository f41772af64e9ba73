"""What `vsh-fit --templates` does: maps of what may cause systematics, from files, columns and the sources."""

import argparse
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import fit
from vsh.commands import reading
from vsh.tools.errors import ParameterError, VshError

#: A floor beside templates is estimated up to this degree.
_HIGHEST = 10
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
            floor = fit.background.floor(solution, range(2, min(solution.modes.lmax, _HIGHEST) + 1))

    plain = fit.solve(fit.background.equations_of(solution))
    fields = template_fields(templates, plain.modes, plain.frame)
    if floor is None:
        return fit.background.cross_powers(plain, fields)
    plain = replace(plain, covariance=plain.covariance * floor.noise_scale**2)
    return fit.background.cross_powers(plain, fields, floor.spectrum)
