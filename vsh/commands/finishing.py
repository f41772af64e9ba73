"""What a command writes: where, whether something is there already, and in which formats: text, JSON, LaTeX, page."""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import vsh
from vsh.commands import parsing, reading, running
from vsh.commands.parsing import NOT_KEPT, NUMBER
from vsh.io.quantities import latex_table
from vsh.io.sections import Answer, Section, as_json_value, text_of
from vsh.tools.errors import TableError, VshError
from vsh.tools.files import UNFINISHED, atomic_folder, atomic_write, check_not_read, check_unchanged, digest, file_stamp
from vsh.tools.formats import is_address
from vsh.tools.parallel import hide_elapsed_time
from vsh.tools.printing import mute_output, one_line_text, printable, wrap_lines
from vsh.tools.types import PathName

if TYPE_CHECKING:
    from vsh.tools.types import Table


#: Endings that nobody gives to a folder.
_FILE_ENDINGS = (".json", ".csv", ".ecsv", ".fits", ".vot", ".tex", ".txt", ".html", ".pdf", ".png")
#: The file by which a command knows its own folders; it holds where the results come from, too.
MARK = "provenance.json"


def _refuse_address(path, option):
    """Raise VshError where a result would go to an address, of which a folder named s3: would be made."""
    if is_address(str(path)):
        raise VshError(f"{option} {printable(path)} is an address: results are written to this machine alone")


def check_folder(path: PathName, command: str, overwrite: bool = False) -> None:
    """Raise VshError now if results could not be written to a folder later."""
    _refuse_address(path, "--output")
    path, label = Path(path), f"--output {printable(path)}"
    if path.exists() and not path.is_dir():
        raise VshError(f"{label} is a file, not a folder")
    if not path.exists() and path.suffix.lower() in _FILE_ENDINGS:
        raise VshError(
            f"{label} would be a folder with the results of {command}: --json and --latex print the tables (> FILE), "
            "--html FILE writes a page"
        )
    _check_parent_writable(path, label, will_make_parents=True)
    check_not_read(path, label)
    if not path.exists() or not any(path.iterdir()):
        return
    mark = _read_folder_mark(path)
    if mark is None or not isinstance(mark.get("files"), dict):
        raise VshError(f"{label} holds files that {command} did not write: name a new folder")
    if mark.get("command") != command:
        raise VshError(f"{label} holds results of {printable(mark.get('command'))}: name another folder")
    if not overwrite:
        raise VshError(f"{label} holds results: use --overwrite to replace them, or name another folder")
    files = mark["files"]
    foreign = sorted(x.name for x in path.iterdir() if x.name not in {MARK, *files})
    if foreign:
        raise VshError(
            f"{label} holds files that {command} did not write ({printable(', '.join(foreign[:5]))}): move them, or "
            "name another folder"
        )
    changed_names = sorted(x for x, sha in files.items() if (path / x).exists() and digest(path / x) != sha)
    if changed_names:
        raise VshError(
            f"{label} holds files that were changed since {command} wrote them "
            f"({printable(', '.join(changed_names[:5]))}): "
            "move them, or name another folder"
        )


def check_file(path: PathName, overwrite: bool = False, option: str = "--output") -> None:
    """Raise VshError now if a file could not be written later, or is there already and may not be replaced."""
    _refuse_address(path, option)
    path, label = Path(path), f"{option} {printable(path)}"
    if path.is_dir():
        raise VshError(f"{label} is a folder, not a file")
    _check_parent_writable(path, label)
    check_not_read(path, label)
    if path.exists() and not overwrite:
        raise VshError(f"{label} exists already: use --overwrite to replace it, or name another file")


def _make_configuration_path(output):
    """Path of the configuration beside a file that is written: its name with run.toml for the ending."""
    return Path(output).with_name(f"{Path(output).name}.{parsing.CONFIGURATION_NAME}")


def write_configuration(options: argparse.Namespace, written: Mapping[str, str] | None = None) -> None:
    """Write the configuration that repeats a run beside its --output, a file."""
    path = _make_configuration_path(options.output)
    with atomic_write(path, overwrite=True) as temporary_path:
        temporary_path.write_text(_format_configuration(options, name=path.name, written=written), encoding="utf-8")


def check_configuration_replaceable(output: PathName) -> None:
    """Raise VshError where the file of a run's configuration, which nobody named, is somebody's."""
    path = _make_configuration_path(output)
    if path.exists() and not path.read_bytes().startswith(parsing.REPEATS.encode()):
        raise VshError(f"{printable(path)} is no configuration of a run, and is not replaced: move it")


@contextmanager
def make_results_folder(options: argparse.Namespace, provenance: dict[str, Any]) -> Iterator[Path]:
    """A folder for results, `run.toml`, citations and provenance; it becomes --output when all is written."""
    Path(os.path.realpath(options.output)).parent.mkdir(parents=True, exist_ok=True)
    with atomic_folder(options.output) as folder:
        yield folder
        for note in _write_tables_in_formats(folder, parsing.parse_table_formats(getattr(options, "format", ""))):
            print_line(options, note)
        (folder / parsing.CONFIGURATION_NAME).write_text(_format_configuration(options, provenance), encoding="utf-8")
        (folder / "citation.bib").write_text(parsing.bibtex(options.program, options.given) + "\n", encoding="utf-8")
        file_hashes = {file.name: digest(file) for file in sorted(folder.iterdir())}
        mark = {"command": options.program, "files": file_hashes} | provenance
        (folder / MARK).write_text(json.dumps(mark, indent=1, default=str, ensure_ascii=False) + "\n", encoding="utf-8")
        check_folder(options.output, options.program, options.overwrite)  # somebody else may have written meanwhile


def _write_tables_in_formats(folder, endings):
    """Write the tables of a folder in other formats as well; notes on those that a format cannot hold."""
    notes = []
    for path in sorted(folder.glob("*.ecsv")) if endings else ():
        table = vsh.io.tables.read_table(path)
        for ending in endings:
            try:
                vsh.io.tables.write_table(
                    _flatten_columns(table) if ending == "csv" else table, path.with_suffix(f".{ending}")
                )
            except TableError as error:
                notes.append(f"note: {path.name} is not written as {ending}: {error}")
    return notes


def _flatten_columns(table):
    """A table whose columns of several numbers a row are columns of one each, numbered from 1."""
    flat_table = table.copy(copy_data=False)
    for name in [name for name in table.colnames if table[name].ndim > 1]:
        values = table[name].reshape(len(table), -1)
        column_index = flat_table.colnames.index(name)
        names = [f"{name}_{k + 1}" for k in range(values.shape[1])]
        flat_table.add_columns(list(values.T), names=names, indexes=[column_index] * len(names))
        flat_table.remove_column(name)
    return flat_table


def _format_configuration(options, provenance=None, name=parsing.CONFIGURATION_NAME, written=None):
    """The configuration that repeats a run, as TOML."""
    files, hashes = ((provenance or {}).get(key, []) for key in ("catalogue", "sha256"))
    pairs = list(zip(files, hashes, strict=True)) if isinstance(files, list) else [(files, hashes)]
    names = [file for file, _ in pairs]
    known = {file: sha for file, sha in pairs if names.count(file) == 1}  # of two files of one name none is known by it
    return parsing.Configuration(options.program, options.given, vsh.__version__, known, written or {}).as_toml(name)


def _check_parent_writable(path, label, will_make_parents=False):
    parent = Path(os.path.realpath(path)).parent
    while will_make_parents and not parent.exists():
        parent = parent.parent
    if not parent.is_dir():
        raise VshError(f"{label}: there is no folder {printable(parent)}")
    try:
        os.rmdir(tempfile.mkdtemp(prefix=UNFINISHED, dir=parent))  # some folders say yes and mean no
    except OSError:
        raise VshError(f"{label}: the folder {printable(parent)} cannot be written to") from None


def _read_folder_mark(folder):
    try:
        mark = json.loads((folder / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return mark if isinstance(mark, dict) else None


class Figures:
    """The figures of a run, drawn when they are first asked for."""

    def __init__(self, draw: Callable[[], Mapping[str, Any]]) -> None:
        self._draw = draw

    @cached_property
    def axes_by_name(self) -> dict[str, Any]:
        """Axes by name of file."""
        import matplotlib

        matplotlib.use("agg")  # a command writes files only: there may be no screen
        return dict(self._draw())

    def write(self, folder: Path, options: argparse.Namespace) -> None:
        """Write them, unless there are to be none."""
        formats, dpi = parsing.parse_figure_formats_and_dpi(options.format)
        if formats:
            from vsh.figures.plot import save_figures

            save_figures(self.axes_by_name, folder, format=formats, dpi=dpi, close=False, overwrite=True)
            if not options.html:  # nobody wants them any more
                self.close()

    def close(self) -> None:
        """Close them."""
        from vsh.figures.plot import close_figures

        close_figures(self.axes_by_name.values())


@dataclass(frozen=True)
class RunResult:
    """The result of a run, in whatever form it is printed.

    `answer` has the lines to quote. `sections` are what stands below them, or a function that gives them in full length
    (of True: --long, the folder, the page) or short (of False).
    """

    sections: Callable[[bool], Sequence[Section]]
    make_tables: Callable[[], Mapping[str, Table]] = dict
    notes: Iterable[str] = ()
    latex: Callable[[], str] | None = None
    answer: Answer = field(default_factory=Answer)

    def format_body(self, long: bool) -> str:
        """The text below the lines to quote, whole or short."""
        return printable(text_of(self.sections(long)))

    def report(self, long: bool = True) -> str:
        """The lines to quote and the text, whole or short; a short one says where the whole is."""
        report_text = self.format_body(long)
        if not long and report_text != self.format_body(True):
            report_text = f"{report_text.rstrip()}\nfull report: --long, or --output DIR\n"
        return f"{self.answer}\n\n{report_text}" if self.answer.lines else report_text

    @cached_property
    def all_notes(self) -> tuple[str, ...]:
        """The notes of the run, and those, the warnings and the remarks of its sections."""
        sections = self.sections(True)
        notes = [f"{label}: {text}" for part in sections for label, text in part.facts if label.startswith("warning")]
        notes += [text for part in sections for text in (*part.notes, *part.remarks)]
        return tuple(dict.fromkeys(map(str, (*self.notes, *notes))))

    @cached_property
    def tables(self) -> Mapping[str, Table]:
        """Tables by heading, for --json and --latex; made when they are first asked for."""
        return self.make_tables()


def make_message_result(
    text: str, make_tables: Callable[[], Mapping[str, Table]] = dict, notes: Iterable[str] = ()
) -> RunResult:
    """The result of a run that has little to say."""
    return RunResult(lambda _: [Section(text)], make_tables, notes)


def print_result(options: argparse.Namespace, result: RunResult) -> None:
    """Print the report, or with --json or --latex what other programs read, or nothing."""
    hide_elapsed_time()
    if options.json:
        print(format_result_as_json(options, result), flush=True)  # who reads may have seen enough
    elif options.latex:
        tables = (latex_table(table, heading) for heading, table in result.tables.items())
        comments = (f"% {one_line_text(note)}" for note in result.all_notes if "warning" in note)
        running.print_text("\n".join((result.latex() if result.latex else "\n\n".join(tables), *comments)))
    elif not options.quiet:
        width = shutil.get_terminal_size().columns  # 80 in a pipe
        running.print_text(wrap_lines(result.report(options.long).rstrip("\n"), width))


def print_line(options: argparse.Namespace, text: str) -> None:
    """Print a line besides the report, where nobody asked for something else."""
    if not (options.json or options.latex or options.quiet):
        running.print_text(text)


@dataclass(frozen=True)
class Part:
    """Result of a run, with the outputs that are made from it.

    Attributes
    ----------
    name : str
        Name of the file and of the figure of the result.
    result : Result or None
        The result, which has `sections`, `to_table`, `write` and `plot`; None where functions below stand for them.
    heading : str
        Heading of its table in JSON and LaTeX; empty if the table is not in them.
    caption : str
        Caption of its figure on the HTML page.
    sections, plot, tables : callable, optional
        Functions that replace those of the result; `plot` may give several figures by name, or none, and `tables` gives
        tables by heading.
    as_table : bool
        Whether its file is its table alone, and not all that the result consists of.
    files : callable, optional
        Writes its files into a folder, in place of that one.
    is_long : bool
        Whether the result is left out of the short text.
    """

    name: str
    result: Any
    heading: str = ""
    caption: str = ""
    sections: Callable[[bool], Sequence[Section]] | None = None
    plot: Callable[[], Any] | None = None
    is_long: bool = False
    tables: Callable[[], Mapping[str, Table]] | None = None
    as_table: bool = False
    files: Callable[[Path, dict[str, Any]], None] | None = None

    def select_sections(self, long: bool) -> Sequence[Section]:
        """Its sections, whole or short."""
        if self.is_long and not long:
            return ()
        return self.result.sections(long=long) if self.sections is None else self.sections(long)

    def draw_figures(self) -> dict[str, Any]:
        """Its figures by name; none where it draws nothing."""
        axes = self.result.plot() if self.plot is None else self.plot()
        return axes if isinstance(axes, dict) else {self.name: axes}

    def tables_by_heading(self) -> Mapping[str, Table]:
        """Its tables by heading, for JSON and LaTeX."""
        if self.tables is None:
            return {self.heading: self.result.to_table()} if self.heading else {}
        return self.tables()

    def write(self, folder: Path, meta: dict[str, Any]) -> None:
        """Write its file, or files, into a folder."""
        path = folder / f"{self.name}.ecsv"
        if self.files is not None:
            self.files(folder, meta)
        elif self.as_table:
            vsh.io.tables.write_table(self.result.to_table(), path, meta)
        else:
            self.result.write(path, meta)


class Run:
    """A run of a command: where its results go is checked first, it opens and reads catalogues, and writes results.

    Parameters
    ----------
    options : argparse.Namespace
        What was asked for.
    """

    def __init__(self, options: argparse.Namespace) -> None:
        self.options = options
        #: Hashes of the files that were opened, and by what each is known again.
        self.opened: dict[str, tuple[str, Any]] = {}
        if options.output:
            check_folder(options.output, options.program, options.overwrite)
        if options.html:
            check_file(options.html, options.overwrite, "--html")

    def open(self, path: str) -> Any:
        """Open a catalogue; its hash in the provenance is that of what was opened."""
        if not is_address(path) and Path(path).is_file():
            stamp = file_stamp(path)
            needs_hash = self.options.output or self.options.html  # a run that writes nothing tells no hash
            self.opened[str(path)] = digest(path) if needs_hash else "", stamp
        return reading.open_catalogue(path, self.options)

    def read(self, source: Any, path: str = "", **more: Any) -> Any:
        """A catalogue that is open, as a field, or in parts where that is asked for; `more` as for `read_field`."""
        from vsh.io import catalogue

        keywords = reading.field_arguments(self.options) | more
        if getattr(self.options, "sigma", None) is not None:
            keywords["sigma"] = self.options.sigma
        if value_text := keywords.pop("value", None):
            column, error_or_selection = (word.strip() for word in re.split(r",(?![^(]*\))", f"{value_text},")[:2])
            keywords = {name: value for name, value in keywords.items() if name not in ("roles", "sigma")}
            if reading.is_density(value_text, source):
                scalars = reading.compute_source_density(source, error_or_selection, keywords)
            else:
                scalars = catalogue.read_scalars(source, column, error_or_selection or None, **keywords)
            self._check_files_unchanged()
            return scalars
        if not reading.is_in_parts(self.options):
            field = catalogue.read_field(source, **keywords)
            self._check_files_unchanged()
            return field
        keywords.pop("roles", None)
        self._check_files_unchanged()  # the parts have records of their own from here on
        return catalogue.parts(path, **reading.parts_arguments(self.options) | keywords)

    def _check_files_unchanged(self):
        for path, (_, stamp) in self.opened.items():
            check_unchanged(path, stamp, file_stamp(path))

    def finish(
        self,
        parts: Sequence[Part],
        *,
        title: str = "",
        answer: Answer | None = None,
        notes: Iterable[str] = (),
        paths: Any = None,
        counts: Mapping[str, Any] | None = None,
        sections: Callable[[bool], Sequence[Section]] | None = None,
        latex: Callable[[], str] | None = None,
        captions: Mapping[str, str] | None = None,
        page: Callable[[Figures, dict[str, Any], Path], None] | None = None,
    ) -> None:
        """Print the result, and write what was asked for: a folder, a page.

        Parameters
        ----------
        parts : sequence of Part
            The results, in the order of the text.
        title : str
            Title of the page.
        answer : Answer, optional
            The lines to quote.
        notes : iterable of str
            For JSON.
        paths : str or list of str, optional
            What was read.
        counts : dict, optional
            Numbers of rows, for the provenance.
        sections : callable, optional
            In place of those of the parts.
        latex, page : callable, optional
            In place of LaTeX of the tables and of a page of the sections.
        captions : dict, optional
            Captions of further figures, by name.
        """
        options = self.options
        make_sections = sections or (lambda long: [section for part in parts for section in part.select_sections(long)])
        make_tables = partial(_merge_by_name, parts, Part.tables_by_heading)
        result = RunResult(make_sections, make_tables, notes, latex, answer or Answer())
        try:
            print_result(options, result)
        except BrokenPipeError:  # whoever reads has seen enough (| head); the files are wanted all the same
            mute_output()
        if not (options.output or options.html):
            return
        meta = running.provenance(paths or [], options, self.opened, **(counts or {}))
        figure_set = Figures(partial(_merge_by_name, parts, Part.draw_figures))
        with (
            _open_output_if_named(options.html, lambda path: atomic_write(path, options.overwrite)) as page_path,
            _open_output_if_named(options.output, lambda _: make_results_folder(options, meta)) as folder,
        ):
            if folder is not None:
                (folder / "report.txt").write_text(result.report(), encoding="utf-8")
                for part in parts:
                    part.write(folder, meta)
                figure_set.write(folder, options)
            if page_path is not None and page is not None:
                page(figure_set, meta, page_path)
            elif page_path is not None:
                from vsh.figures import page as pages

                all_captions = {part.name: part.caption for part in parts if part.caption} | dict(captions or {})
                panels = [
                    pages.facts_panel(result.answer.lines, "answer"),
                    pages.join_panels("Figures", pages.figure_row(figure_set.axes_by_name, all_captions)),
                    *map(pages.section_panel, make_sections(True)),
                    pages.provenance_panel(meta, options.command),
                ]
                pages.write_page(page_path, pages.page(title, panels), overwrite=True)
            if page_path is not None:
                figure_set.close()
        if options.output:
            file_names = sorted(entry.name for entry in Path(options.output).iterdir())
            print_line(options, f"written to {options.output}: {', '.join(file_names)}")
        if options.html:
            print_line(options, f"written to {options.html}")


def _open_output_if_named(path, open_output):
    """The place where results are written, which takes its name at the end; None where nobody named one."""
    return open_output(path) if path else nullcontext()


def _merge_by_name(parts, get_items):
    """All that parts give by name."""
    return {name: item for part in parts for name, item in get_items(part).items()}


def format_result_as_json(options: argparse.Namespace, result: RunResult) -> str:
    """A result as one JSON object: command, version, options, notes, and tables by column; nan is null."""
    document = {
        "command": options.program,
        "version": vsh.__version__,
        "options": {name: _parse_if_number(value) for name, value in options.given.items() if name not in NOT_KEPT},
        "answer": dict(result.answer.lines) or None,
        "notes": list(result.all_notes),
        "tables": result.tables,
        "written": [str(path) for path in (options.output, getattr(options, "html", None)) if path],
    }
    encoding = getattr(sys.stdout, "encoding", None) or "utf-8"
    return json.dumps(as_json_value(document), ensure_ascii=encoding.lower() not in ("utf-8", "utf8"), allow_nan=False)


def _parse_if_number(value):
    """A word as a number, where it is one."""
    return json.loads(value) if isinstance(value, str) and NUMBER.fullmatch(value) else value
