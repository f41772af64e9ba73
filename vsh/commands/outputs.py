"""Where commands write to: folders that know which command made them, and are whole, old or new."""

import argparse
import json
import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import vsh
from vsh.commands import citing, configuration, values
from vsh.tools.errors import VshError
from vsh.tools.files import UNFINISHED, as_recorded, atomic_folder, check_not_read, digest, is_ours
from vsh.tools.formats import is_address
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: The file by which a command knows its own folders; it holds where the results come from, too.
MARK = "provenance.json"


def check(options: argparse.Namespace) -> None:
    """Raise VshError now if --output or --html could not be written later."""
    if options.output:
        check_folder(options.output, options.program, options.overwrite)
    if options.html:
        check_file(options.html, options.overwrite, "--html")


def _check_local(path, option):
    """Raise VshError where a result would go to an address, of which a folder named s3: would be made."""
    if is_address(str(path)):
        raise VshError(f"{option} {printable(path)} is an address: results are written to this machine alone")


def check_folder(path: PathName, command: str, overwrite: bool = False) -> None:
    """Raise VshError now if results could not be written to a folder later."""
    _check_local(path, "--output")
    path, shown = Path(path), f"--output {printable(path)}"
    if path.exists() and not path.is_dir():
        raise VshError(f"{shown} is a file, not a folder")
    _check_parent(path, shown, made=True)
    check_not_read(path, shown)
    if not path.exists() or not any(path.iterdir()):
        return
    mark = _read_mark(path)
    if mark is None:
        raise VshError(f"{shown} holds files that {command} did not write: name a new folder")
    if mark.get("command") != command:
        raise VshError(f"{shown} holds results of {printable(mark.get('command'))}: name another folder")
    if not overwrite:
        raise VshError(f"{shown} holds results: use --overwrite to replace them, or name another folder")
    recorded = mark.get("files", ())
    foreign = sorted(x.name for x in path.iterdir() if x.name not in {MARK, *recorded})
    if foreign:
        raise VshError(
            f"{shown} holds files that {command} did not write ({printable(', '.join(foreign[:5]))}): move them, or "
            "name another folder"
        )
    hashes = recorded if isinstance(recorded, dict) else {}
    changed = sorted(x for x, sha in hashes.items() if (path / x).exists() and digest(path / x) != sha)
    if changed:
        raise VshError(
            f"{shown} holds files that were changed since {command} wrote them ({printable(', '.join(changed[:5]))}): "
            "move them, or name another folder"
        )


def check_file(path: PathName, overwrite: bool = False, option: str = "--output", recorded: bool = False) -> None:
    """Raise VshError now if a file could not be written later, or is there already and may not be replaced."""
    _check_local(path, option)
    path, shown = Path(path), f"{option} {printable(path)}"
    if path.is_dir():
        raise VshError(f"{shown} is a folder, not a file")
    _check_parent(path, shown)
    check_not_read(path, shown)
    if not path.exists():
        return
    if not overwrite:
        raise VshError(f"{shown} exists already: use --overwrite to replace it, or name another file")
    if not is_ours(path):
        raise VshError(f"{shown} was not written by this program, and is not replaced: name another file")
    known = as_recorded(path)
    if known is False or (known is None and recorded) or (option == "--html" and not _is_page(path)):
        raise VshError(f"{shown} is not as this program wrote it, and is not replaced: name another file")


@contextmanager
def results_folder(options: argparse.Namespace, provenance: dict[str, Any]) -> Iterator[Path]:
    """A folder for results, `run.toml`, citations and provenance; it becomes --output when all is written."""
    check_folder(options.output, options.program, options.overwrite)
    Path(os.path.realpath(options.output)).parent.mkdir(parents=True, exist_ok=True)
    with atomic_folder(options.output) as folder:
        yield folder
        _copy_tables(folder, values.table_formats(getattr(options, "format", "")))
        (folder / configuration.NAME).write_text(repeats(options, provenance), encoding="utf-8")
        (folder / "citation.bib").write_text(citing.bibtex(options.program, options.given) + "\n", encoding="utf-8")
        files = {x.name: digest(x) for x in sorted(folder.iterdir())}
        mark = {"command": options.program, "files": files} | provenance
        (folder / MARK).write_text(json.dumps(mark, indent=1, default=str, ensure_ascii=False) + "\n", encoding="utf-8")
        check_folder(options.output, options.program, options.overwrite)  # somebody else may have written meanwhile


def _copy_tables(folder, endings):
    """The tables of a folder in other formats as well; columns of several numbers a row do not fit into CSV."""
    from vsh.io import tables

    for path in sorted(folder.glob("*.ecsv")) if endings else ():
        table = tables.read_table(path)
        for ending in endings:
            flat = [name for name in table.colnames if ending != "csv" or table[name].ndim == 1]
            tables.write_table(table[flat], path.with_suffix(f".{ending}"))


def repeats(
    options: argparse.Namespace,
    provenance: Mapping[str, Any] | None = None,
    name: str = configuration.NAME,
    written: Mapping[str, str] | None = None,
) -> str:
    """The configuration that repeats a run, as TOML."""
    files, hashes = ((provenance or {}).get(key, []) for key in ("catalogue", "sha256"))
    read = dict(zip(files, hashes, strict=True)) if isinstance(files, list) else {files: hashes}
    return configuration.Configuration(options.program, options.given, vsh.__version__, read, written or {}).text(name)


def _check_parent(path, shown, made=False):
    parent = Path(os.path.realpath(path)).parent
    while made and not parent.exists():
        parent = parent.parent
    if not parent.is_dir():
        raise VshError(f"{shown}: there is no folder {printable(parent)}")
    try:
        os.rmdir(tempfile.mkdtemp(prefix=UNFINISHED, dir=parent))  # some folders say yes and mean no
    except OSError:
        raise VshError(f"{shown}: the folder {printable(parent)} cannot be written to") from None


def _is_page(path):
    from vsh.figures.page import is_page  # which imports matplotlib

    return is_page(path)


def _read_mark(path):
    try:
        mark = json.loads((path / MARK).read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    return mark if isinstance(mark, dict) else None
