"""`vsh-fit`: from a catalogue to spin and acceleration, on the command line."""

from dataclasses import replace
from importlib.resources import files
from pathlib import Path
from typing import Any

import fit
import vsh
from fit.commands import backgrounds as shared
from vsh.commands import finishing, outputs, reading, running
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
    from fit.commands import estimators
    from vsh.io import catalogue, tables

    whole: Any
    if reading.in_parts(options):
        whole = catalogue.parts(str(path), **reading.reading_parts(options))
    else:
        source = tables.remembered(source) if options.classes else source  # each class reads its rows
        # Names tell of sources that stand there twice, and are in the report; no fit looks at the rest.
        whole = catalogue.read_field(source, **reading.arguments(options), roles=("name",))
    field = whole.to_frame(options.frame)
    estimate = estimators.estimate(field, vsh.Modes(options.lmax), options)
    kept, clipped = estimate.sources, estimate.n_clipped
    recommended = estimate.weights if options.recommended else None
    backgrounds = shared.found(estimate.solution, options, recommended)
    lmax = estimate.solution.modes.lmax
    solution = fit.background.add_floor(backgrounds.solution)
    floor = backgrounds.results.get("floor", solution.floor)
    results, texts = dict(backgrounds.results), list(backgrounds.texts)
    maps = []
    if options.templates:
        from fit.commands import templates

        maps = templates.templates_of(source, str(path), field, options)
    if options.classes:
        from fit.commands import classes

        n_sources = solution.n_sources + (clipped or 0)
        results["shared"] = classes.shared_by(source, str(path), options, estimate, maps, n_sources)
        texts.append(results["shared"].report(what="class"))
    elif maps:
        normal = estimate.equations(kept, lmax, templates=maps)
        beside = fit.background.shared(
            [normal], labels=["all sources"], noise_scale=estimate.is_scaled, rng=options.seed
        )
        results["shared"] = replace(beside, notes=(*beside.notes, estimate.class_note))
        texts.append(results["shared"].report())
    if maps:
        results["cross_powers"] = templates.cross_powers_of(estimate.solution, floor, maps)
        texts.append(results["cross_powers"].report())
    backgrounds = replace(backgrounds, results=results, texts=tuple(texts))
    name = "the simulated catalogue of the demo" if options.demo else source.label
    check, truth = fit.cross_check(kept), catalogue.truth_of(source)
    said = fit.output.verdict(solution) if recommended is None else recommended.verdict
    said = said.removeprefix("verdict: ")
    if options.classes:
        from fit.quality import SEEN, printed_p_value

        p = results["shared"].verdict().p_value
        said += f"; {'a' if p < SEEN else 'no'} change from class to class is seen (p = {printed_p_value(p)})"
    text = "\n".join([solution.report(check=check, truth=truth, source=name), *backgrounds.texts])
    lines = [f"{label or 'warning'}: {words}" for label, words in fit.output.warnings_of(solution)]

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
        return "\n\n".join(
            [
                fit.output.latex_of(solution, verdict=said),
                *(finishing.as_latex(table, head) for head, table in further().items()),
            ]
        )

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
        fit.output.write_correlation(solution, folder / "correlation.ecsv", meta)
        backgrounds.write(folder, meta)

    def page(drawn, meta):
        about = {"check": check, "truth": truth, "source": Path(name).name, "provenance": meta, "verdict": said}
        plain = (fit.fit_field(field, options.lmax, floor=False), field) if options.beside else None
        fit.output.write_html(
            solution,
            kept,
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
        finishing.RunResult(text, sheets, [*lines, *solution.notes], latex, said),
        provenance=provenance,
        write=write,
        page=page,
        draw=lambda: fit.output.draw_figures(solution, kept) | backgrounds.draw(),
    )


main, run = running.make_entry(options_module, _run)
