"""`vsh-fit`: from a catalogue to spin and acceleration, and what stands beside them, on the command line."""

import argparse
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Any

import fit
import vsh
from vsh.commands import finishing, parsing, reading, running
from vsh.io.quantities import latex_table
from vsh.io.sections import Answer
from vsh.sky.frames import FRAMES
from vsh.tools.errors import EmptySelectionError, ModesError, ParameterError, TableError, VshError
from vsh.tools.notes import count_dropped, count_unselected


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-fit",
        description=(
            "Fit vector spherical harmonics to a catalogue of proper motions: the spin of its frame, the "
            "acceleration of the Solar System, and the power of every degree. With --value: the mean, the dipole and "
            "the power of parallaxes, or of any other number."
        ),
        examples=(
            "vsh-fit catalogue.fits --lmax 3 --frame galactic --output results",
            "vsh-fit catalogue.fits --method clip=3 --html page.html",
            "vsh-fit catalogue.fits --classes magnitude:18,19",
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", parsing.A_TABLE, nargs="?")
    add("--demo", "run on a simulated catalogue that comes with the package")
    add("--lmax", "highest degree (default: 5; if --method is given: 3)", parsing.count(1))
    add(
        "--method NAME[=VALUE]",
        "recommended (default), least-squares, clip=KAPPA, student, excess-noise[=scale], bootstrap=N or "
        "jackknife[=NSIDE] | recommended is Student's t with the systematic floor included in the errors, its maximum "
        "degree reduced if there are too few sources; clip protects from outliers, not from wrong errors; excess-noise "
        "from errors that are too small, not from outliers",
        parsing.check_method,
        "recommended",
    )
    add(
        "--value COLUMN[,ERROR]",
        "fit this number in place of the motions: parallax, or what is calculated of columns, such as 'parallax - "
        "bias', or density | its standard error is in the column ERROR, or that of its name with _error behind "
        "(parallax_error); density[,MAP] is the number density of the sources, over that which a HEALPix map says of "
        "their selection",
    )
    add(
        "--floor",
        "with another --method than recommended: include the systematic floor in the errors | it is estimated from "
        "degrees 2 to --lmax (at least 3), and the coefficients of those degrees get a prior of that power",
        ("yes", "no"),
        nargs="?",
        const="yes",
    )
    add(
        "--waves YEARS",
        "upper limits on the energy density of gravitational waves from the power of degree 2 | for three choices of "
        "the prior; the length of the observations in years, where it is given, is that from which the frequency band "
        "and the strain are calculated",
        parsing.parse_positive,
        nargs="?",
        const=True,
    )
    add(
        "--classes COLUMN:EDGE,…",
        "compare classes of sources, systematic errors included | by a column, magnitude:18,20, by conditions between "
        "semicolons, or halves:galactic; --lmax 5 is best",
    )
    add(
        "--templates MAP,…",
        "fit the amplitude of systematic errors of a known pattern: a HEALPix map, a solution, a column, or density | "
        "truncated at degree --lmax; galactic:FILE where the header of a map does not state its axes; density is the "
        "number density of the sources",
        parsing.parse_names,
    )
    reading.add_workers(parser)
    reading.add_reading(parser)
    return parsing.add_common(parser)


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.catalogue) == options.demo:
        parser.error("name one catalogue, or --demo")
    if options.lmax is None:
        options.lmax = 5 if options.method == "recommended" else 3
    if options.classes and options.lmax < 3:
        parser.error("--classes needs --lmax 3 or more: degrees 1 and 2 tell nothing of systematic errors")
    if options.templates and options.lmax < 3:
        parser.error("--templates needs --lmax 3 or more, 5 is best: degrees 1 and 2 alone tell them from nothing")
    if options.value is not None and not options.value.strip(", "):
        parser.error("--value names no column")
    if options.value and options.sigma is not None:
        parser.error("sigma= is an error of motions: name the column of errors of a number, --value VALUE,ERROR")
    if options.value and (options.waves or reading.is_in_parts(options)):
        parser.error("--value fits one number of each source: --waves and --workers are for motions")
    options.years = options.waves if isinstance(options.waves, float) else None
    if options.floor == "no" and options.method == "recommended":
        parser.error("the recommended fit includes the systematic floor: --method student is the same fit without it")
    options.floor = options.floor == "yes"


DEMO = "demo.fits"
#: Headings of tables beside those of the solution.
_TABLE_HEADINGS = {
    "floor": "Systematic errors",
    "shared": "Classes with common systematic errors",
    "waves": "Gravitational waves",
    "cross_powers": "Cross-powers with the templates",
}


def _run(options):
    run = finishing.Run(options)
    path = str(files("fit") / DEMO if options.demo else options.catalogue)
    source = run.open(path)
    from vsh.io import catalogue, tables

    # Each class reads its rows; names tell of sources that stand there twice, and no fit looks at further columns.
    source = tables.cache_columns(source) if options.classes and not reading.is_in_parts(options) else source
    field = run.read(source, path, roles=("name",), value=options.value).to_frame(options.frame)
    estimate = fit.estimate(field, options.lmax, *parsing.split_method(options.method))
    solution, sources, plain_solution = estimate.solution, estimate.sources, estimate.plain
    results: dict[str, Any] = {}
    if not solution.covariance_dof > 0 and (options.floor or options.waves):
        raise ParameterError("few sources decide this fit, so it has no errors that --floor or --waves could use")
    if options.waves:
        has_floor = options.floor or solution.includes_floor
        results["waves"] = _limit_waves(plain_solution, has_floor, options.years)
    if options.floor and not solution.includes_floor:
        solution = _solve_with_floor(plain_solution)
    if solution.floor is not None:
        results["floor"] = solution.floor
    templates = [_read_template(template, run, source, path, field) for template in options.templates or ()]
    if options.classes:
        n_sources = solution.n_sources + (estimate.n_clipped or 0)
        results["shared"] = _compare_classes(run, source, path, estimate, templates, n_sources)
    elif templates:
        results["shared"] = _fit_templates(estimate, templates)
    if templates:
        results["cross_powers"] = _compute_cross_powers(plain_solution, solution.floor, templates)
    source_name = "the simulated catalogue of the demo" if options.demo else source.label
    facts: dict[str, Any] = {"source": f"{options.value} of {source_name}" if options.value else source_name}
    if not options.value:
        facts |= {"check": fit.cross_check(sources), "truth": catalogue.truth_of(source)}
    answer = _make_answer(solution, results, options.classes)
    captions = {key: text for key, text in _FIGURE_CAPTIONS.items() if key in results}

    def further_tables():
        return {_TABLE_HEADINGS.get(key, key): result.to_table() for key, result in results.items()}

    def format_latex():
        extra_tables = (latex_table(table, head) for head, table in further_tables().items()) if options.long else ()
        return "\n\n".join([fit.output.latex_of(solution, full=options.long), *extra_tables])

    def write_files(folder, meta):
        solution.write(folder / "solution.ecsv", meta)
        fit.output.write_tables(solution, sources, folder, meta, estimate.source_weights)
        fit.output.write_correlation(solution, folder / "correlation.ecsv", meta)

    def write_page(figures, meta, path):
        fit.output.write_html(
            solution,
            sources,
            path,
            overwrite=True,
            figures=figures.axes_by_name,
            command=options.command,
            captions=captions,
            sections=_make_further_sections(results, True),
            provenance=meta,
            answer=answer,
            **facts | {"source": Path(source_name).name},
        )

    warnings = [f"{label}: {text}" for label, text in fit.output.warnings_of(solution)]
    run.finish(
        [
            finishing.Part(
                "solution",
                solution,
                plot=lambda: fit.output.draw_figures(solution, sources, estimate.source_weights, options.value),
                tables=lambda: {
                    "vectors": fit.output.vectors_table(solution),
                    "powers": fit.output.powers_table(solution),
                    "coefficients": solution.to_table(),
                },
                files=write_files,
            ),
            *(
                finishing.Part(key, result, key, plot=dict if key == "floor" else None)
                for key, result in results.items()
            ),
        ],
        sections=lambda long: [*solution.sections(long=long, **facts), *_make_further_sections(results, long)],
        latex=format_latex,
        answer=answer,
        notes=[*warnings, *solution.notes],
        paths=path,
        counts=_count_rows(solution, estimate.n_clipped, options.where),
        page=write_page,
    )


def _fit_templates(estimate, templates):
    """Spin and acceleration of all sources with the templates fitted."""
    normal = estimate.equations(estimate.sources, estimate.solution.modes.lmax, templates=templates)
    compared = fit.background.shared([normal], labels=["all sources"], noise_scale=estimate.is_scaled)
    return replace(compared, notes=(*compared.notes, estimate.class_note))


def _make_answer(solution, results, has_classes):
    """The lines to quote: those of the fit, the limit on waves, and whether classes differ."""
    from fit.results.quality import SEEN
    from vsh.tools.digits import format_p_value

    lines = [*solution.answer.lines, *(results["waves"].answer.lines if "waves" in results else ())]
    if has_classes:
        p = results["shared"].verdict().p_value
        text = f"{'a change' if p < SEEN else 'no change'} from class to class is detected (p = {format_p_value(p)})"
        lines.append(("classes", text))
    return Answer(tuple(lines))


def _make_further_sections(results, long):
    """The sections below those of the solution; short, the lines to quote have the floor and the limit on waves."""
    names = [name for name in (*(("floor", "waves") if long else ()), "shared", "cross_powers") if name in results]
    shown = [replace(results[name], notes=()) if name == "waves" else results[name] for name in names]  # said above
    return [section for result in shown for section in result.sections(long=long)]


def _count_rows(solution, n_clipped, condition):
    """Rows of the table, by what became of them."""
    n_used, n_refused, n_skipped = solution.n_sources, count_dropped(solution.notes), count_unselected(solution.notes)
    counts = {"rows": n_used + n_clipped + n_refused + n_skipped, "rows_used": n_used, "rows_refused": n_refused}
    return counts | {"rows_clipped": n_clipped} | ({"rows_not_selected": n_skipped} if condition else {})


def _compare_classes(run, source, path, estimate, templates, n_sources):
    """The classes with their common systematic errors, summed by the weights of the `estimate`.

    Those of `n_sources` that are in no class are counted.
    """
    options = run.options
    classes = vsh.Classes.from_text(options.classes)
    read = partial(run.read, source, path, roles=(), value=options.value)
    subsets: list[Any]
    if classes.frame:
        subsets = list(classes.split(read()))
    else:
        conditions = [_join_conditions(options.where, condition) for condition in classes.conditions]
        subsets = [_read_class(read, *item) for item in zip(classes.labels, conditions, strict=True)]
        if ";" in options.classes:
            any_class = " or ".join(f"({condition})" for condition in classes.conditions)
            _check_classes_disjoint(read(where=_join_conditions(options.where, any_class)), classes, subsets)
    lmax, n_inside = estimate.solution.modes.lmax, 0
    if estimate.method == "clip":
        n_inside = sum(vsh.io.parts.as_parts(subset, vsh.field.SourcesWithErrors).sum(len) for subset in subsets)
        subsets = [fit.estimate(subset, lmax, *parsing.split_method(options.method)).sources for subset in subsets]
    subsets = [subset.to_frame(options.frame) for subset in subsets]
    make_equations = partial(estimate.equations, templates=templates)
    normals = [make_equations(subset, lmax) for subset in subsets]
    normals = fit.background.extend_degrees(normals, make_equations, subsets)
    compared = fit.background.shared(normals, range(2, lmax + 1), labels=classes.labels, noise_scale=estimate.is_scaled)
    n_inside, notes = n_inside or sum(normal.n_sources for normal in normals), []
    if n_sources > n_inside and not reading.is_density(options.value, source):  # which are pixels, of any size
        notes.append(f"{n_sources - n_inside} of {n_sources} sources are in no class: no value, or between conditions")
    return replace(compared, notes=(*compared.notes, *notes, estimate.class_note))


def _join_conditions(selection, condition):
    """The rows that are expected, and of those the ones that fulfil a condition."""
    return condition if selection is None else f"({selection}) and ({condition})"


def _read_class(read, label, condition):
    try:
        return read(where=condition)
    except EmptySelectionError:
        raise ParameterError(f"the class {label} is empty: choose other edges, or leave it out") from None
    except TableError as error:
        raise TableError(str(error).replace("--where", "--classes", 1)) from error


def _check_classes_disjoint(union, classes, subsets):
    """Raise ParameterError where a source is in two classes."""
    counts = [vsh.io.parts.as_parts(subset, vsh.field.SourcesWithErrors).sum(len) for subset in subsets]
    n_all = vsh.io.parts.as_parts(union, vsh.field.SourcesWithErrors).sum(len)
    if sum(counts) > n_all:
        raise ParameterError(
            f"{sum(counts) - n_all} sources are in more than one of the classes {'; '.join(classes.labels)}: make them "
            "exclude each other"
        )


#: Waves beside a floor are looked for to this degree.
_HIGHEST_WITH_WAVES = 7


#: Captions of the figures.
_FIGURE_CAPTIONS = {
    "shared": "The classes, with common systematic errors.",
    "cross_powers": "What of the solution follows each template, by degree, in errors with the floor.",
    "waves": "Energy in gravitational waves: posteriors and 95 % limits.",
}


def _limit_waves(plain, has_floor, years):
    """The limit on gravitational waves from a fit without a floor, systematics beside them where there is a floor."""
    if plain.modes.lmax < 2:
        raise ModesError("gravitational waves begin at degree 2: take --lmax 2 or higher")
    systematics: dict[str, Any] = {}
    if has_floor and plain.modes.lmax >= 3:  # the higher degrees show which power of degree 2 is no wave
        shapes = list(fit.background.SHAPES.values())
        systematics = {"degrees": range(2, min(plain.modes.lmax, _HIGHEST_WITH_WAVES) + 1), "systematics": shapes}
    return replace(fit.background.wave_limit(plain, **systematics), years=years)


def _solve_with_floor(plain):
    """A fit with the systematic floor in its errors."""
    if plain.modes.lmax < 3:
        raise ModesError(f"degree {plain.modes.lmax} cannot determine a systematic floor: use --lmax 3 or higher")
    solution = fit.solve(fit.background.equations_of(plain, scalars=True), floor=fit.background.floor(plain))
    return replace(solution, formal_covariance=plain.formal.covariance)


#: A floor beside templates is estimated up to this degree.
_HIGHEST_WITH_TEMPLATES = 10
#: The sources' own density; everything else is a file or a column.
_DENSITY = "density"


def _read_template(word, run, source, path, field):
    """The template of a name: `density`, a HEALPix map (FITS), a solution of motions (ECSV), or a column."""
    if word == _DENSITY:
        return fit.background.Template.density(_DENSITY, field)
    frame: Any
    frame, _, path_text = word.partition(":")
    frame, word = (frame, path_text) if frame in FRAMES else (None, word)
    if Path(word).is_file():
        name = Path(word).name
        if word.endswith(".ecsv"):
            solution = fit.storage.read(word)
            if not isinstance(solution, fit.Solution):
                raise ParameterError(f"--templates {name} is no solution of motions")
            if frame not in (None, solution.frame or "icrs"):
                raise ParameterError(f"--templates {name} is a solution in {solution.frame} axes, not in {frame}")
            return fit.background.Template(name, solution.coefficients, solution.frame or "icrs")
        return fit.background.Template(name, word, frame)
    if word not in source.names:
        raise ParameterError(
            f"--templates {word}: there is no such file, and no such column in {source.label}; density is that of the "
            "sources"
        )
    return _read_column_template(word, run, source, path)


def _read_column_template(name, run, source, path):
    """Numbers of a column at the places of the sources that are read."""
    arguments = reading.field_arguments(run.options)
    if run.options.value or reading.is_in_parts(run.options):  # numbers have no motions, whose rows would be theirs
        chunks = vsh.io.catalogue.stream_columns(source, [name], **arguments)
        pairs = ((field.to_frame("icrs"), columns[name]) for field, columns in chunks)
        return fit.background.Template.of_parts(name, ((field.lon, field.lat, values) for field, values in pairs))
    field = run.read(source, path, roles=())
    return fit.background.Template.of_sources(
        name, field.lon, field.lat, vsh.io.catalogue.read_columns(source, [name], **arguments)[name], field.frame
    )


def _compute_cross_powers(solution, floor, templates):
    """Project a solution without a prior on the templates; errors include the floor, of the run if it has one.

    The same equations as the floor's, so that the errors do not depend on whether the floor was put into the solution.
    """
    from fit.normal import template_fields

    if floor is None:
        with suppress(VshError):  # too few degrees, or too little of the sky
            floor = fit.background.floor(solution, range(2, min(solution.modes.lmax, _HIGHEST_WITH_TEMPLATES) + 1))

    plain = fit.solve(fit.background.equations_of(solution, scalars=True))
    fields = template_fields(templates, plain.modes, plain.frame)
    if floor is None:
        return fit.background.cross_powers(plain, fields)
    plain = replace(plain, covariance=plain.covariance * floor.noise_scale**2)
    return fit.background.cross_powers(plain, fields, floor.spectrum)


main, run = running.make_entry(__name__, _run)
