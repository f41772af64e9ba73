"""What `vsh-fit --templates` does: maps of what may cause systematics, from files, columns and the sources."""

import argparse
from pathlib import Path
from typing import Any

import fit
from vsh.commands import reading
from vsh.tools.errors import ParameterError

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


def cross_powers_of(solution: Any, templates: list[Any]) -> Any:
    """How far the solution follows the templates, beside the floor where it is known."""
    from fit.normal import template_fields

    fields = template_fields(templates, solution.modes, solution.frame)
    floor = getattr(solution, "floor", None)
    plain = solution.unshrunk or solution
    return fit.background.cross_powers(plain, fields, None if floor is None else floor.spectrum)
