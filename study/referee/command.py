"""`vsh-referee`: every published analysis of quasar motions from one catalogue, on the command line."""

from vsh.commands import finishing, outputs, reading, running
from vsh.commands.options import referee as options_module
from vsh.tools.notes import dropped


def _run(options):
    outputs.check(options)
    source = reading.open_catalogue(options.catalogue, options)
    from study.referee import read_quasars, referee

    quasars = read_quasars(source, axes=options.frame, **reading.arguments(options) | {"format": None})
    earlier = None
    if options.earlier:
        from vsh.io.catalogue import read_field

        earlier = read_field(options.earlier, roles=("name",), on_bad=options.on_bad)
    answer = referee(quasars, options.seed, earlier=earlier)
    counts = {"rows_used": len(quasars.whole), "rows_refused": dropped(quasars.field.notes)}

    def draw():
        from study.referee._page import draw

        return draw(answer)

    def write(folder, meta):
        from vsh.io import tables

        for name, table in answer.tables().items():
            tables.write_table(table, folder / f"{name}.ecsv", meta)
        answer.headline.solution.write(folder / "solution.ecsv", meta)
        for name, result in answer.results().items():
            result.write(folder / f"{name}.ecsv", meta)

    def page(drawn, meta):
        from study.referee._page import html
        from vsh.figures.page import write_page

        write_page(options.html, html(answer, drawn.drawn, provenance=meta, command=options.command))

    finishing.finish(
        options,
        finishing.RunResult(answer.details, answer.tables, quasars.field.notes, answer=answer.answer.lines),
        provenance=lambda: running.provenance(
            [options.catalogue, options.earlier] if options.earlier else options.catalogue, options, **counts
        ),
        draw=draw,
        write=write,
        page=page,
    )


main, run = running.make_entry(options_module, _run)
