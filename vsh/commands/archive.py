"""`vsh-archive`: catalogues from an archive, on the command line."""

import argparse
import re
from pathlib import Path

from vsh.commands import finishing, parsing, running
from vsh.io.archive import (
    DATA_SERVER,
    ESA,
    QUERIES,
    RELEASES,
    UPLOADED,
    check_schema,
    fetch_epochs,
    of_positions,
    of_table,
    query,
    read_ids,
    upload_of,
)
from vsh.tools.errors import ArchiveError
from vsh.tools.files import atomic_write, check_not_read
from vsh.tools.printing import printable


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make(
        prog="vsh-archive",
        description=(
            "Fetch a catalogue from an archive (TAP), as a FITS file that vsh-fit reads. A file that is there is "
            "the answer; an interrupted call goes on where it was."
        ),
        examples=(
            "vsh-archive gaia-crf3 --output qso.fits",
            "vsh-archive --upload quasars.csv --output mine.fits",
            "vsh-archive epochs --ids quasars.fits --output epochs",
        ),
    )
    add = parsing.adder(parser)
    add(
        "what",
        f"{', '.join(parsing.QUERIES)}, a file with a query in ADQL, a table of the archive that names sources by "
        "source_id (schema.table), or epochs: the epoch astrometry of --ids",
        nargs="?",
    )
    add(
        "--check SCHEMA",
        "ask for the tables and columns of a schema, gaiadr4 say, and print which queries run and what changed",
    )
    add(
        "--upload LIST",
        "send a list of sources with the query, which calls it tap_upload.list: a table with source_id, or with ra and "
        "dec in degrees, or a text with one source_id per line. Without a query, the astrometry of the list is "
        "fetched: by source_id, or of the sources within 1 arcsec",
    )
    group = parsing.adder(parser.add_argument_group("epoch astrometry (DataLink)"))
    group("--ids FILE", "source_id, a column of a table or one a line of a text")
    group("--retrieval-type NAME", "name of the product (default: EPOCH_ASTROMETRY)")
    group("--structure NAME", "how several sources come (default: COMBINED)")
    group("--batch N", "sources asked for at once, 5000 at most (default: 500)", parsing.count(1))
    add("--release", "for a table: of which release", parsing.RELEASES, "DR3")
    add(
        "--table",
        "for a table, DR4: the best model of each source (the default), or the core solution of all",
        parsing.ASTROMETRY,
        "gaia_source",
    )
    add("--output FILE", "the FITS file to be")
    add("--show", "print the query and ask nobody")
    add("--url", "of the TAP service (default: ESA's archive of Gaia)", default=parsing.ESA)
    add("--max-rows N", "the server's own limit unless given", parsing.count(1))
    add("--patience S", "how long to wait for the job (default: 7200 s)", parsing.positive, 7200.0)
    parsing.add_overwrite(parser)
    parsing.add_common(parser, "list of what was written")
    return parser


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.what or options.upload) == bool(options.check):
        parser.error("say what to fetch, or --check SCHEMA")
    if options.upload and options.what in ("epochs", *QUERIES):
        parser.error("--upload goes with a query of your own, or alone")
    if options.check:
        return
    epoch_options = [
        name for name in ("ids", "retrieval_type", "structure", "batch") if getattr(options, name) is not None
    ]
    if (options.what == "epochs") != (options.ids is not None):
        parser.error("epochs are those of a list of sources: vsh-archive epochs --ids FILE --output FOLDER")
    if epoch_options and options.what != "epochs":
        parser.error(f"--{epoch_options[0].replace('_', '-')} is for epochs")
    if options.what == "epochs" and (options.show or not options.output):
        parser.error("epochs go into a folder: --output FOLDER")
    if not (options.output or options.show):
        parser.error("say where to: --output FILE.fits, or --show")


def _run(options):
    if options.check:
        schema_check = check_schema(options.check, options.url)
        finishing.print_result(
            options,
            finishing.RunResult(
                lambda _: schema_check.sections(), lambda: {"Names that are missing": schema_check.to_table()}
            ),
        )
        return
    if options.what == "epochs":
        _epochs(options)
        return
    upload, by_name = upload_of(options.upload) if options.upload else (None, True)
    if options.what is None and not by_name:
        adql = of_positions(release=RELEASES[options.release])
    elif options.what is None:
        adql = of_table(UPLOADED, release=RELEASES[options.release], astrometry=options.table)
    else:
        adql = QUERIES[options.what] if options.what in QUERIES else _text(options)
    if options.show:
        finishing.print_result(options, finishing.message(adql))
        return
    is_reused = Path(options.output).exists() and not options.overwrite
    check_not_read(options.output, f"--output {printable(options.output)}")
    path = query(
        adql,
        options.output,
        options.url,
        patience=options.patience,
        max_rows=options.max_rows,
        overwrite=options.overwrite,
        upload=upload,
    )
    was = f"{path} was there already, as it was fetched: nothing was asked"
    config_path = Path(f"{path}.{parsing.NAME}")
    with atomic_write(config_path) as temporary_path:
        temporary_path.write_text(finishing.repeats(options, name=config_path.name), encoding="utf-8")
    finishing.print_result(options, finishing.message(was if is_reused else f"written to {path}"))


def _epochs(options):
    """Fetch the epochs of a list of sources, a batch at a time."""
    keywords = {
        name: value
        for name in ("retrieval_type", "structure", "batch")
        if (value := getattr(options, name)) is not None
    }
    ids = read_ids(options.ids)
    url = DATA_SERVER if options.url == ESA else options.url
    folder = fetch_epochs(ids, options.output, url, patience=options.patience, progress=not options.quiet, **keywords)
    count = sum(1 for path in folder.iterdir() if path.is_file())
    finishing.print_result(options, finishing.message(f"written to {folder}: {count} files of {len(set(ids))} sources"))


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


main, run = running.make_entry(__name__, _run)
