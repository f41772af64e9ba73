"""`vsh-archive`: catalogues from an archive, on the command line."""

import argparse
import re
from pathlib import Path

from vsh.commands import finishing, parsing, running
from vsh.io import archive
from vsh.tools.errors import ArchiveError
from vsh.tools.files import check_not_read
from vsh.tools.printing import printable

#: Options of any query, and of each kind of request besides. An option that a kind does not take is an error: it would
#: be ignored in silence.
_QUERY_OPTIONS = {"output", "show", "url", "max_rows", "overwrite"}
_OPTIONS_BY_REQUEST = {
    "--check": {"url"},
    "epochs": {"ids", "retrieval_type", "structure", "output", "url"},
    "a query of ours": _QUERY_OPTIONS,
    "dr3-neighbourhood": _QUERY_OPTIONS | {"upload"},
    "a query in a file": _QUERY_OPTIONS | {"upload"},
    "a table of the archive": _QUERY_OPTIONS | {"release", "table", "with_columns", "where"},
    "a list that is sent": _QUERY_OPTIONS | {"upload", "release", "table"},
}
_NEIGHBOURS = "dr3-neighbourhood"


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
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
        f"{', '.join(archive.QUERIES)}, {_NEIGHBOURS}, a file with a query, a table of the archive, or epochs | "
        f"{_NEIGHBOURS}: DR4's names of the sources of DR3 in --upload; a query in ADQL; a table that names sources by "
        "source_id (schema.table); epochs: the epoch astrometry of --ids",
        nargs="?",
    )
    add(
        "--check SCHEMA",
        "ask for the tables and columns of a schema, gaiadr4 say | and print which queries run and what changed; the "
        "exit status is 1 where none runs",
    )
    add(
        "--upload LIST",
        "send a list of sources with the query | which calls it tap_upload.list: a table with source_id, or with "
        "ra and dec in degrees, or a text with one source_id per line. Without a query, the astrometry of the list is "
        "fetched: by source_id, or of the sources within 1 arcsec",
    )
    add("--ids FILE", "epochs: source_id, a column of a table or one a line of a text")
    add(
        "--retrieval-type NAME",
        "epochs: name of the product | (default: EPOCH_ASTROMETRY; of bright and crowded sources "
        "EPOCH_ASTROMETRY_BRIGHT and EPOCH_ASTROMETRY_CROWDED_FIELD)",
    )
    add(
        "--structure NAME",
        "epochs: how several sources come | (default: DATAMODEL_GAIA, or what the server names as valid)",
    )
    add(
        "--release",
        "of a list or a table of your own (default: DR3) | a table of the archive's has its own",
        tuple(archive.RELEASES),
    )
    add(
        "--table",
        "for a table or a list, of DR4 | the best model of each source (default: gaia_source), or the core solution of "
        "all",
        archive.ASTROMETRY,
    )
    add(
        "--with NAMES",
        "for a table: columns of it that come with the astrometry, redshift_qsoc say",
        parsing.parse_names,
        dest="with_columns",
    )
    add(
        "--where CONDITION",
        "for a table: a condition in ADQL | in which t is the table and g the astrometry: "
        "t.classprob_dsc_combmod_quasar > 0.9",
    )
    add("--output FILE", "the FITS file to be")
    add("--show", "print the query and ask nobody")
    add("--url", "of the TAP service (default: ESA's archive of Gaia)", default=archive.ESA)
    add("--max-rows N", "the server's own limit unless given", parsing.count(1))
    parsing.add_overwrite(parser)
    return parsing.add_common(parser, "list of what was written")


def _classify_request(options):
    """The kind of a request, a key of _OPTIONS_BY_REQUEST."""
    if options.check:
        return "--check"
    if options.what in ("epochs", _NEIGHBOURS):
        return options.what
    if options.what is None:
        return "a list that is sent"
    if options.what in archive.QUERIES:
        return "a query of ours"
    is_table_name = re.fullmatch(r"\w+\.(?!(adql|sql|txt)$)\w+", options.what) and not Path(options.what).exists()
    return "a table of the archive" if is_table_name else "a query in a file"


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself."""
    if bool(options.what or options.upload) == bool(options.check):
        parser.error("say what to fetch, or --check SCHEMA")
    kind = _classify_request(options)
    if kind == "a table of the archive" and options.upload:
        parser.error("--upload goes with a query in a file, or alone: a table of the archive is its own list")
    foreign = set().union(*_OPTIONS_BY_REQUEST.values()) - _OPTIONS_BY_REQUEST[kind]
    ignored = [f"--{parsing.option_name(a)}" for a in parser._actions if a.dest in foreign and getattr(options, a.dest)]
    if ignored:
        request = f"{options.what}, {kind}" if kind.startswith("a query") else kind
        hint = ": its release is its own" if ignored[0] == "--release" else ""
        parser.error(f"{ignored[0]} does not go with {request}{hint}")
    if options.check:
        return
    if options.what == "epochs" and not (options.ids and options.output):
        parser.error("epochs are those of a list of sources: vsh-archive epochs --ids FILE --output FOLDER")
    if options.what == _NEIGHBOURS and not options.upload:
        parser.error(f"{_NEIGHBOURS} is asked for a list of sources of DR3: --upload LIST")
    if not (options.output or options.show):
        parser.error("say where to: --output FILE.fits, or --show")


def _make_query(options, has_source_ids):
    """The query that is asked for; `by_name` says whether a list that is sent names its sources."""
    kind = _classify_request(options)
    if kind == "a query of ours":
        return archive.QUERIES[options.what]
    if kind == _NEIGHBOURS:
        if not has_source_ids:
            raise ArchiveError(f"{_NEIGHBOURS} needs the source_id of DR3: {printable(options.upload)} has positions")
        return archive.NEIGHBOURS
    release = None if options.release is None else archive.RELEASES[options.release]
    astrometry = options.table or "gaia_source"
    if kind == "a table of the archive":
        return archive.of_table(
            options.what, options.with_columns or (), release=release, astrometry=astrometry, where=options.where
        )
    if kind == "a list that is sent":
        if has_source_ids:
            return archive.of_table(archive.UPLOADED, release=release, astrometry=astrometry)
        return archive.query_near_positions(release=release or archive.DR3, astrometry=astrometry)
    try:
        return Path(options.what).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ArchiveError(
            f"{options.what} is neither a query of ours ({', '.join((*archive.QUERIES, _NEIGHBOURS))}) nor a file with "
            f"one: {getattr(error, 'strerror', None) or error}"
        ) from None


def _run(options):
    if options.check:
        checks = archive.check_schema(options.check, options.url)
        result = finishing.RunResult(lambda _: checks.sections(), lambda: {"Names that are missing": checks.to_table()})
        finishing.print_result(options, result)
        if not checks.any_runs:
            raise ArchiveError(f"no query runs in {options.check}: see the names that are missing")
        return
    if options.what == "epochs":
        _fetch_epochs(options)
        return
    upload, has_source_ids = archive.make_upload(options.upload) if options.upload else (None, True)
    adql = _make_query(options, has_source_ids)
    if options.show:
        finishing.print_result(options, finishing.make_message_result(adql))
        return
    is_reused = Path(options.output).exists() and not options.overwrite
    check_not_read(options.output, f"--output {printable(options.output)}")
    finishing.check_configuration_replaceable(options.output)
    path = archive.query(
        adql, options.output, options.url, max_rows=options.max_rows, overwrite=options.overwrite, upload=upload
    )
    reuse_message = f"{path} was there already, as it was fetched: nothing was asked"
    finishing.write_configuration(options)
    finishing.print_result(options, finishing.make_message_result(reuse_message if is_reused else f"written to {path}"))


def _fetch_epochs(options):
    """Fetch the epochs of a list of sources, a batch at a time."""
    choices = {name: value for name in ("retrieval_type", "structure") if (value := getattr(options, name)) is not None}
    ids = archive.read_ids(options.ids)
    url = archive.DATA_SERVER if options.url == archive.ESA else options.url
    folder = archive.fetch_epochs(ids, options.output, url, progress=not options.quiet, **choices)
    n_files, missing = sum(1 for path in folder.iterdir() if path.is_file()), archive.sources_without_epochs(folder)
    lines = [f"written to {folder}: {n_files} files of {len(set(ids)) - len(missing)} sources"]
    if missing:
        listing = ", ".join(map(str, missing[:5])) + (", …" if len(missing) > 5 else "")
        lines.append(f"{len(missing)} of {len(set(ids))} sources have no epochs: {listing} (all in {folder.name}.json)")
    finishing.print_result(options, finishing.make_message_result("\n".join(lines)))


main, run = running.make_entry(__name__, _run)
