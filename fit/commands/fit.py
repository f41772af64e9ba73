"""`vsh-fit`: from a catalogue to spin and acceleration, on the command line."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import fit
from fit.commands import backgrounds as shared
from vsh.commands import finishing, outputs, reading, running, values
from vsh.commands.options import fit as options_module
from vsh.tools.notes import dropped, unselected

DEMO = "demo.fits"
#: Headings of tables beside those of the solution.
_HEADINGS = {
    "floor": "What sources share",
    "shared": "Classes with errors that they share",
    "waves": "Gravitational waves",
    "cross_powers": "Templates beside the degrees",
}


def _run(options):
    outputs.check(options)
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
    estimate = fit.estimate(field, options.lmax, *values.method_and_value(options.method), rng=options.seed)
    sources, clipped = estimate.sources, estimate.n_clipped
    backgrounds = shared.backgrounds_of(estimate, options)
    lmax = estimate.solution.modes.lmax
    solution = backgrounds.solution
    results = dict(backgrounds.results)
    maps = []
    if options.templates:
        from fit.commands import templates

        maps = templates.templates_of(source, str(path), field, options)
    if options.classes:
        from fit.commands import classes

        n_sources = solution.n_sources + (clipped or 0)
        results["shared"] = classes.shared_by(source, str(path), options, estimate, maps, n_sources)
    elif maps:
        normal = estimate.equations(sources, lmax, templates=maps)
        beside = fit.background.shared(
            [normal], labels=["all sources"], noise_scale=estimate.is_scaled, rng=options.seed
        )
        results["shared"] = replace(beside, notes=(*beside.notes, estimate.class_note))
    if maps:
        results["cross_powers"] = templates.cross_powers_of(estimate.plain, solution.floor, maps)
    backgrounds = replace(backgrounds, results=results)
    name = "the simulated catalogue of the demo" if options.demo else source.label
    check, truth = fit.cross_check(sources), catalogue.truth_of(source)
    answer = [*solution.answer.lines, *(results["waves"].answer if "waves" in results else ())]
    if options.classes:
        from fit.quality import SEEN, printed_p_value

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


main, run = running.make_entry(options_module, _run)
