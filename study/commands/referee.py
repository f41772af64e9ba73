"""`vsh-referee`: every published analysis of quasar motions from one catalogue, on the command line."""

import argparse
from functools import partial

from vsh.commands import finishing, parsing, reading, running
from vsh.io.quantities import latex_table
from vsh.io.sections import Section
from vsh.tools.notes import count_dropped, merge_notes


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-referee",
        description=(
            "Repeat every published analysis of the motions of quasars on one catalogue, with systematic errors "
            "included, and check whether a signal is the sky or the instrument."
        ),
        examples=(
            "vsh-referee crf3.fits --on-bad drop --output referee --html referee.html",
            "vsh-referee crf4.fits --on-bad drop --earlier crf3.fits",
            'vsh-referee crf3.fits --on-bad drop --where "phot_g_mean_mag < 19"',
        ),
    )
    add = parsing.adder(parser)
    add("catalogue", parsing.A_TABLE)
    add(
        "--earlier FILE",
        "motions of the same sources in an earlier release, by source_id: is the acceleration the same there?",
    )
    add("--seed", "of all that is drawn", int, 1)
    reading.add_reading(parser)
    return parsing.add_common(parser)


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with an error for all, which the checks of the errors would be about."""
    if options.sigma:
        parser.error("the referee looks at the errors of the catalogue: leave out --columns sigma=")


def _run(options):
    run = finishing.Run(options)
    table_source = reading.open_catalogue(options.catalogue, options)
    from study.referee import read_quasars, referee

    quasars = read_quasars(table_source, axes=options.frame, **reading.field_arguments(options) | {"format": None})
    earlier = None
    if options.earlier:
        from vsh.io.catalogue import read_field

        read_earlier = partial(read_field, options.earlier, roles=("name",), on_bad=options.on_bad)
        earlier = reading.read_with_named_notes(options.earlier, read_earlier)
    report = referee(quasars, options.seed, earlier=earlier)
    counts = {"rows_used": len(quasars.whole), "rows_refused": count_dropped(quasars.field.notes)}

    def draw():
        from study.referee.page import draw_figures

        return draw_figures(report)

    def make_sections(long):
        additions = [Section(f"Earlier: {options.earlier}", notes=earlier.notes)] if earlier and earlier.notes else []
        return [*report.details(long), *additions]

    def write_tables(folder, meta):
        from vsh.io import tables

        for name, table in report.tables().items():
            tables.write_table(table, folder / f"{name}.ecsv", meta)
        report.headline.solution.write(folder / "solution.ecsv", meta)
        for name, result in report.results().items():
            result.write(folder / f"{name}.ecsv", meta)

    def write_html(figures, meta, path):
        from study.referee.page import make_html_page
        from vsh.figures.page import write_page

        page_html = make_html_page(report, figures.axes_by_name, provenance=meta, command=options.command)
        write_page(path, page_html, overwrite=True)

    run.finish(
        [finishing.Part("referee", None, sections=make_sections, plot=draw, tables=report.tables, files=write_tables)],
        notes=merge_notes(quasars.field.notes, () if earlier is None else earlier.notes),
        answer=report.answer,
        paths=[options.catalogue, options.earlier] if options.earlier else options.catalogue,
        counts=counts,
        latex=lambda: "\n\n".join(
            latex_table(section.table, section.title) for section in report.details() if section.table
        ),
        page=write_html,
    )


main, run = running.make_entry(__name__, _run)
