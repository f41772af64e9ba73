"""`vsh-archive`: catalogues from an archive, on the command line."""

import re
from pathlib import Path

from vsh.commands import configuration, finishing, outputs, running
from vsh.commands.options import archive as options_module
from vsh.io.archive import DATA_SERVER, ESA, QUERIES, RELEASES, check_schema, fetch_epochs, of_table, query, read_ids
from vsh.tools.errors import ArchiveError
from vsh.tools.files import atomic_write, check_not_read
from vsh.tools.printing import printable


def _run(options):
    if options.check:
        checked = check_schema(options.check, options.url)
        finishing.print_result(
            options, finishing.RunResult(checked.report(), lambda: {"Names that are missing": checked.to_table()})
        )
        return
    if options.what == "epochs":
        _epochs(options)
        return
    adql = QUERIES[options.what] if options.what in QUERIES else _text(options)
    if options.show:
        finishing.print_result(options, finishing.RunResult(adql))
        return
    there = Path(options.output).exists() and not options.overwrite
    check_not_read(options.output, f"--output {printable(options.output)}")
    path = query(
        adql,
        options.output,
        options.url,
        patience=options.patience,
        max_rows=options.max_rows,
        overwrite=options.overwrite,
    )
    was = f"{path} was there already, as it was fetched: nothing was asked"
    beside = Path(f"{path}.{configuration.NAME}")
    with atomic_write(beside) as new:
        new.write_text(outputs.repeats(options, name=beside.name), encoding="utf-8")
    finishing.print_result(options, finishing.RunResult(was if there else f"written to {path}"))


def _epochs(options):
    """Fetch the epochs of a list of sources, a batch at a time."""
    more = {
        name: value
        for name in ("retrieval_type", "structure", "batch")
        if (value := getattr(options, name)) is not None
    }
    ids = read_ids(options.ids)
    url = DATA_SERVER if options.url == ESA else options.url
    folder = fetch_epochs(ids, options.output, url, patience=options.patience, progress=not options.quiet, **more)
    count = sum(1 for each in folder.iterdir() if each.is_file())
    finishing.print_result(
        options, finishing.RunResult(f"written to {folder}: {count} files of {len(set(ids))} sources")
    )


def _text(options):
    path = options.what
    if re.fullmatch(r"\w+\.(?!(adql|sql|txt)$)\w+", path) and not Path(path).exists():
        return of_table(path, release=RELEASES[options.release], astrometry=options.table)
    if options.release != "DR3" or options.table != "gaia_source":
        raise ArchiveError("--release and --table are for a table of the archive: schema.table")
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ArchiveError(
            f"{path} is neither a query of ours ({', '.join(QUERIES)}) nor a file with one: "
            f"{getattr(error, 'strerror', None) or error}"
        ) from None


main, run = running.make_entry(options_module, _run)
