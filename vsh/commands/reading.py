"""Options of the commands that read a catalogue, whole or in parts, and of those that write figures."""

from __future__ import annotations

import argparse
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vsh.commands import parsing

if TYPE_CHECKING:
    from vsh.io.tables import TableSource
    from vsh.scalars import ScalarField
    from vsh.tools.types import FloatArray
    from vsh.vector import Vector


def add_reading(parser: argparse.ArgumentParser) -> None:
    """The options of every command that reads a catalogue."""
    add = parsing.adder(parsing.get_shared_group(parser))
    add("--frame", "axes of the result", parsing.FRAMES, "icrs")
    add_columns(parser, "the catalogue")
    add(
        "--on-bad",
        "for rows that cannot be used, raise an error, or drop them and report their number",
        ("raise", "drop"),
        "raise",
    )
    add(
        "--where CONDITION",
        "use only rows that fulfil a condition, such as 'phot_g_mean_mag < 19 and 0.5 < redshift < 2'",
    )
    add_output(parser)


def add_columns(parser: argparse.ArgumentParser, table_words: str) -> None:
    """Add --columns and --units, which say what stands in a table."""
    add = parsing.adder(parsing.get_shared_group(parser))
    add(
        "--columns ROLE=NAME,…",
        f"names of the columns of {table_words}: a predefined set (gaia, the default; vizier; icrf), pairs "
        "(pmra=mu_ra,redshift=z), or both (vizier,redshift=zsp); magnitude= for none; and what the table does not say: "
        "frame=galactic, format=mrt where its name does not tell it, sigma=30 for one error of all sources, µas/yr "
        "(of positions µas)",
        parsing.parse_columns,
        action=parsing.JoinValues,
    )
    add("--units NAME=UNIT,…", "units of columns, such as mu_ra=uas/yr", parsing.parse_pairs)


def add_output(parser: argparse.ArgumentParser) -> None:
    """Add --output, --format, --html and --overwrite."""
    add = parsing.adder(parsing.get_shared_group(parser))
    add("--output DIR", "write report, tables and figures to this folder", _check_folder_name)
    add(
        "--format NAME,…",
        "formats of the figures, png (the default), pdf or svg, with @DPI behind or without (300), or none; and of the "
        "tables in addition to ECSV: fits, vot, csv",
        parsing.check_formats,
        "png",
        action=parsing.JoinValues,
    )
    add("--html FILE", "write the whole result to one HTML page that works offline")
    parsing.add_overwrite(parser)


def field_arguments(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `read_field` that `add_reading` asks for."""
    return {
        "columns": options.columns,
        "units": options.units,
        "on_bad": options.on_bad,
        "frame": options.catalogue_frame,
        "where": options.where,
        "format": options.input_format,
    }


def open_catalogue(path: str, options: argparse.Namespace) -> TableSource:
    """Open a catalogue; a file that cannot be read is reported at once, before anything heavy is imported."""
    from vsh.io import tables

    return tables.open_table(path, options.input_format)


def read_map_and_frame(text: str) -> tuple[FloatArray, str]:
    """A HEALPix map and its axes, as options name it: FILE, or galactic:FILE where the header does not state them."""
    import vsh

    frame_name, _, path = text.rpartition(":")
    stated = frame_name if frame_name in parsing.FRAMES else None
    return vsh.io.maps.read_map_with_frame(path if stated else text, stated, "galactic:FILE, or which it is")


#: The number density of the sources in place of a column.
DENSITY = "density"


def is_density(value: str | None, source: TableSource) -> bool:
    """Return whether a value that is asked for is the density of the sources, and no column."""
    return (value or "").partition(",")[0].strip() == DENSITY and DENSITY not in source.names


def compute_source_density(source: TableSource, selection_text: str, keywords: dict[str, Any]) -> ScalarField:
    """The density of the sources of a catalogue, relative to a map of their selection where one is named."""
    import vsh
    from vsh.tools.notes import ASSUMED_MOTIONS, has_code

    field = vsh.io.catalogue.read_sources(source, sigma=1.0, **keywords)
    selection_map, frame = None, field.frame
    if selection_text:
        selection_map, frame = read_map_and_frame(selection_text)
        field = field.to_frame(frame)
    density = vsh.ScalarField.from_counts(field.lon, field.lat, selection=selection_map, frame=frame)
    return density.add_note(*(note for note in field.notes if not has_code(note, ASSUMED_MOTIONS)))


@contextmanager
def prepare_input_catalogues(options: argparse.Namespace) -> Iterator[None]:
    """Check that catalogues exist; keep standard input, where one is called -, in a file, to read it again."""
    from vsh.tools.errors import TableError

    other_paths = getattr(options, "others", [])
    for path in [getattr(options, "catalogue", None), getattr(options, "catalogue2", None), *other_paths]:
        file_path = re.sub(r"#[^#]+$", "", path or "")  # one of several tables in a file
        if path not in (None, "-") and "://" not in path and not (Path(path).exists() or Path(file_path).exists()):
            raise TableError(f"{path}: no such file")
    stdin_options = [name for name in ("catalogue", "catalogue2") if getattr(options, name, None) == "-"]
    if "-" in other_paths:
        raise TableError("standard input is one of the first two catalogues")
    if not stdin_options:
        yield
        return
    if len(stdin_options) > 1:
        raise TableError("standard input holds one catalogue: name a file for the other")
    if sys.stdin is None or sys.stdin.isatty():
        raise TableError("- is standard input, and nothing comes in: pipe a table into it, or name a file")
    with tempfile.TemporaryDirectory(prefix="vsh-") as folder:
        from vsh.io.tables import STANDARD_INPUT

        path = Path(folder, STANDARD_INPUT)
        with path.open("wb") as file:
            shutil.copyfileobj(sys.stdin.buffer, file, 2**22)
        if not path.stat().st_size:
            raise TableError("standard input is empty")
        setattr(options, stdin_options[0], str(path))
        yield


def read_with_named_notes(path: str, read: Callable[[], Any]) -> Any:
    """A catalogue whose notes with counts, and whose errors on rows, name its file."""
    from vsh.tools.errors import FieldError
    from vsh.tools.notes import CountedNote  # NumPy is slow to import
    from vsh.tools.printing import printable

    name = Path(path).name
    try:
        catalogue = read()
    except FieldError as error:
        if name not in str(error):
            error.args = (f"{printable(name)}: {error}",)
        raise
    notes = (f"{printable(name)}: {note}" if isinstance(note, CountedNote) else note for note in catalogue.notes)
    return replace(catalogue, notes=tuple(notes))


def add_workers(parser: argparse.ArgumentParser) -> None:
    """Add --workers, to every command that reads a catalogue in parts."""
    parsing.adder(parsing.get_shared_group(parser))(
        "--workers N|ADDRESS",
        "process a catalogue of any size in parts, with N processes, or on the Dask cluster with this address or "
        "scheduler file; by default it is read into memory",
        _parse_workers,
    )


def _parse_workers(text):
    return parsing.count(1)(text) if re.fullmatch(r"-?[\d.]*", text) else text


def is_in_parts(options: argparse.Namespace) -> bool:
    """Return whether a command was asked to go through its catalogue in parts."""
    return getattr(options, "workers", None) is not None


def parts_arguments(options: argparse.Namespace) -> dict[str, Any]:
    """The arguments of `vsh.io.catalogue.parts` that `add_reading` and `add_workers` ask for."""
    return field_arguments(options) | {"workers" if isinstance(options.workers, int) else "scheduler": options.workers}


def refuse_velocities(notes: Iterable[object], label: str) -> None:
    """Stop where most redshifts of a table are velocities, rather than count them as missing."""
    from vsh.tools.errors import TableError
    from vsh.tools.notes import NO_REDSHIFTS, has_code

    if warnings := [str(note) for note in notes if has_code(note, NO_REDSHIFTS)]:
        raise TableError(f"{label}: {warnings[0].removeprefix('warning: ')}")


def make_observer_velocity(value: str | tuple[float, ...] | None) -> Vector | None:
    """Our velocity, as `vsh.commands.parsing.parse_velocity` has it."""
    from vsh.models.cosmology import VELOCITIES, velocity_from_apex

    if value is None:
        return None
    return VELOCITIES[value] if isinstance(value, str) else velocity_from_apex(*value)


def _check_folder_name(text):
    if not text:
        raise argparse.ArgumentTypeError("names no folder")
    return text
