"""`vsh-fit`: from a catalogue to spin and acceleration, on the command line."""

import argparse
from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import fit
from fit.commands import beside
from vsh.commands import finishing, parsing, reading, running
from vsh.tools.notes import dropped, unselected


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-fit",
        description=(
            "Fit vector spherical harmonics to a catalogue of proper motions: the spin of its frame, the "
            "acceleration of the Solar System, and the power of every degree."
        ),
        examples=(
            "vsh-fit catalogue.fits --lmax 3 --frame galactic --output results",
            "vsh-fit catalogue.fits --method clip=3 --html page.html",
            "vsh-fit catalogue.fits --classes magnitude:18,19",
        ),
    )
    parser.add_argument("catalogue", nargs="?", help=parsing.A_TABLE)
    parser.add_argument("--demo", action="store_true", help="run on a simulated catalogue that comes with the package")
    parser.add_argument("--lmax", type=parsing.count(1), help="highest degree (default: 5; with --method 3)")
    parser.add_argument(
        "--method",
        type=parsing.method,
        default="recommended",
        metavar="NAME[=VALUE]",
        help=(
            "estimator (default: recommended, which is Student's t with the systematic floor in the errors, to a "
            "degree that the sources bear): least-squares, clip=KAPPA, student, permissive, excess-noise[=scale], "
            "bootstrap=N or jackknife[=NSIDE]"
        ),
    )
    _add_backgrounds(parser)
    parser.add_argument(
        "--classes",
        metavar="COLUMN:EDGE,…",
        help=(
            "compare classes of sources, with errors that they share (--lmax 5 is best): by a column, magnitude:18,20, "
            "by conditions between semicolons, or halves:galactic"
        ),
    )
    parser.add_argument(
        "--templates",
        type=parsing.names,
        metavar="MAP,…",
        help=(
            "how far motions follow maps, cut to --lmax: HEALPix maps (FITS), solutions (ECSV), columns of the "
            "catalogue, or density, that of the sources"
        ),
    )
    parser.add_argument("--seed", type=int, default=1, help="of the bootstrap and of the classes (default: 1)")
    parsing.add_threads(parser)
    reading.add_workers(parser)
    reading.add_reading(parser)
    parser.add_argument(
        "--beside", action="store_true", help="in the page of --html, also show plain least squares of all sources"
    )
    parsing.add_common(parser)
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.catalogue) == options.demo:
        parser.error("name one catalogue, or --demo")
    if options.lmax is None:
        options.lmax = 5 if options.method == "recommended" else 3
    if options.classes and options.lmax < 3:
        parser.error("--classes needs --lmax 3 or more: degrees 1 and 2 say nothing of what classes share")
    if options.templates and options.lmax < 3:
        parser.error("--templates needs --lmax 3 or more, 5 is best: degrees 1 and 2 alone tell them from nothing")
    if options.years and not options.waves:
        parser.error("--years is for --waves")
    if options.beside and not options.html:
        parser.error("--beside is for the page: name it, --html FILE")


def _add_backgrounds(parser):
    group = parser.add_argument_group("what sources share")
    group.add_argument(
        "--floor",
        action="store_true",
        help=(
            "put the systematic floor into the errors of another --method than the recommended one, estimated from "
            "degrees 2 to --lmax (3 at least), with a prior of that power on those degrees"
        ),
    )
    group.add_argument(
        "--waves", action="store_true", help="limit the energy in gravitational waves by degree 2, of three kinds"
    )
    group.add_argument(
        "--years",
        type=parsing.positive,
        metavar="T",
        help="with --waves: how long the motions were measured, for the band of frequency and the strain",
    )


DEMO = "demo.fits"
#: Headings of tables beside those of the solution.
_HEADINGS = {
    "floor": "What sources share",
    "shared": "Classes with errors that they share",
    "waves": "Gravitational waves",
    "cross_powers": "Templates beside the degrees",
}


def _run(options):
    finishing.check(options)
    path = files("fit") / DEMO if options.demo else options.catalogue
    source = reading.open_catalogue(str(path), options)
    from vsh.io import catalogue, tables

    whole: Any
    if reading.in_parts(options):
        whole = catalogue.parts(str(path), **reading.reading_parts(options))
    else:
        source = tables.remembered(source) if options.classes else source  # each class reads its rows
        # Names tell of sources that stand there twice, and are in the report; no fit looks at the rest.
        whole = catalogue.read_field(source, **reading.arguments(options), roles=("name",))
    field = whole.to_frame(options.frame)
    estimate = fit.estimate(field, options.lmax, *parsing.method_and_value(options.method), rng=options.seed)
    sources, clipped = estimate.sources, estimate.n_clipped
    backgrounds = beside.backgrounds_of(estimate, options)
    lmax = estimate.solution.modes.lmax
    solution = backgrounds.solution
    results = dict(backgrounds.results)
    maps = []
    if options.templates:
        maps = beside.templates_of(source, str(path), field, options)
    if options.classes:
        n_sources = solution.n_sources + (clipped or 0)
        results["shared"] = beside.shared_by(source, str(path), options, estimate, maps, n_sources)
    elif maps:
        normal = estimate.equations(sources, lmax, templates=maps)
        shared = fit.background.shared(
            [normal], labels=["all sources"], noise_scale=estimate.is_scaled, rng=options.seed
        )
        results["shared"] = replace(shared, notes=(*shared.notes, estimate.class_note))
    if maps:
        results["cross_powers"] = beside.cross_powers_of(estimate.plain, solution.floor, maps)
    backgrounds = replace(backgrounds, results=results)
    name = "the simulated catalogue of the demo" if options.demo else source.label
    check, truth = fit.cross_check(sources), catalogue.truth_of(source)
    answer = [*solution.answer.lines, *(results["waves"].answer if "waves" in results else ())]
    if options.classes:
        from fit.results.quality import SEEN, printed_p_value

        p = results["shared"].verdict().p_value
        words = f"{'a change' if p < SEEN else 'no change'} from class to class is detected (p = {printed_p_value(p)})"
        answer.append(("classes", words))

    def text(long):
        about = fit.output.report(solution, check=check, truth=truth, source=name, long=long, answer=False)
        more = [results["shared"].report(long=long)] if "shared" in results else []
        more += [results["cross_powers"].report()] if "cross_powers" in results else []
        return "\n".join([about, *backgrounds.texts(long), *more])

    lines = [f"{label}: {words}" for label, words in fit.output.warnings_of(solution)]

    def sheets():
        tables = {
            "vectors": fit.output.vectors_table(solution),
            "powers": fit.output.powers_table(solution),
            "coefficients": solution.to_table(),
        }
        return tables | {name: result.to_table() for name, result in backgrounds.results.items()}

    def further():
        return {_HEADINGS.get(name, name): result.to_table() for name, result in backgrounds.results.items()}

    def latex():
        more = (finishing.as_latex(table, head) for head, table in further().items()) if options.long else ()
        return "\n\n".join([fit.output.latex_of(solution, full=options.long), *more])

    def provenance():
        refused, out, used = dropped(solution.notes), unselected(solution.notes), solution.n_sources
        counts = {
            "rows": used + clipped + refused + out,
            "rows_used": used,
            "rows_refused": refused,
            "rows_clipped": clipped,
        }
        counts |= {"rows_not_selected": out} if options.where else {}
        return running.provenance(path, options, **counts)

    def write(folder, meta):
        solution.write(folder / "solution.ecsv", meta)
        fit.output.write_tables(solution, sources, folder, meta, estimate.source_weights)
        fit.output.write_correlation(solution, folder / "correlation.ecsv", meta)
        backgrounds.write(folder, meta)

    def page(drawn, meta):
        about = {
            "check": check,
            "truth": truth,
            "source": Path(name).name,
            "provenance": meta,
            "answer": fit.output.Answer(tuple(answer)),
        }
        plain = (fit.fit_field(field, options.lmax), field) if options.beside else None
        fit.output.write_html(
            solution,
            sources,
            options.html,
            figures=drawn.drawn,
            command=options.command,
            captions=backgrounds.captions,
            beside={"plain least squares, all sources": plain} if plain else {},
            sections=further(),
            **about,
        )

    finishing.finish(
        options,
        finishing.RunResult(text, sheets, [*lines, *solution.notes], latex, answer=answer),
        provenance=provenance,
        write=write,
        page=page,
        draw=lambda: fit.output.draw_figures(solution, sources, estimate.source_weights) | backgrounds.draw(),
    )


main, run = running.make_entry(__name__, _run)
