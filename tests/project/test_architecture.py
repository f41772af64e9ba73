"""Imports run one way, packages stay small, and heavy libraries are imported in few places.

vsh imports neither sim nor fit; sim and fit import vsh and not each other. Inside a package no two modules import
each other, not even from within a function, and files that begin with an underscore are imported from their own
folder only.
"""

import ast
import functools
import importlib.util
import re
from configparser import ConfigParser
from fnmatch import fnmatch

from breaks import BREAKS
from conftest import ROOT, for_each, parsed, run_python

MAY_IMPORT = {"vsh": {"vsh"}, "sim": {"sim", "vsh"}, "fit": {"fit", "vsh"}, "study": {"study", "sim", "fit", "vsh"}}
FILES = sorted(path for package in MAY_IMPORT for path in (ROOT / package).rglob("*.py"))
FOLDERS = sorted({path.parent for path in FILES} | {path.parent for path in (ROOT / "tests").rglob("*.py")})
DOCTEST = re.compile(r"^\s*>>> (?:from|import) ([\w.]+)", re.MULTILINE)

#: The only files that may import a heavy library.
HEAVY = {
    "healpy": ["vsh/sky/pixels.py", "vsh/io/maps.py"],
    "ducc0": ["vsh/transform.py", "vsh/sky/pixels.py"],
    "emcee": ["fit/posterior/_sampling.py"],
    "numba": ["vsh/tools/parallel.py", "sim/agis/passes/_kernels.py", "sim/scanning/_compiled.py"],
    "corner": ["fit/*/_plot.py"],
    "arviz": ["fit/posterior/_sampling.py"],
    "matplotlib": [
        "vsh/figures/plot/_*.py", "*/_plot.py", "fit/results/output/_figures.py", "vsh/commands/finishing.py",
    ],
    "pyarrow": [f"vsh/io/tables/{file}.py" for file in ("_arrow", "_source", "_open")],
    "h5py": ["vsh/io/tables/_source.py"],
    "dask": ["vsh/io/parts/_engines.py"],
    "distributed": ["vsh/io/parts/_engines.py"],
    "astropy.cosmology": ["vsh/models/cosmology.py"],
    "astropy": [
        "vsh/io/tables/_*.py", "vsh/io/columns.py", "vsh/tools/files.py", "vsh/models/covariance.py", "vsh/models/cosmology.py", "vsh/io/catalogue/_columns.py", "vsh/io/catalogue/_names.py", "vsh/commands/*.py", "vsh/figures/plot/_sky_axes.py", "vsh/vector.py", "vsh/field.py",
        "fit/results/storage.py",
    ],
}  # fmt: skip
#: What a function may import instead of its file: what is heavy, and what is imported only if it is asked for.
LATE = re.compile(
    r"(matplotlib|healpy|ducc0|emcee|astropy|arviz|corner|pandas|pyarrow|scipy|dask|distributed|numba|ipywidgets|importlib|multiprocessing|threadpoolctl|tqdm|fsspec|aiohttp|lsdb|platform|tomllib|resource|xml|h5py|fcntl|getdist|pyvo)\b"
)
#: Files that run before anything is imported, or as something is told to be wrong at once: they import even our own late.
FIRST = ("vsh/__main__.py", "vsh/tools/modules.py", "vsh/commands/reading.py", "vsh/commands/parsing.py")


def name(path):
    return path.relative_to(ROOT).as_posix()


def module(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module(path): path for path in FILES}


@functools.cache
def imported(path, everywhere=True, types=True):
    """The modules that a file imports: at its top, or with `everywhere` within its functions too; perhaps for types."""
    tree = parsed(path)
    body = list(tree.body) if types else list(_top(tree))
    found = set()
    for node in (each for part in body for each in ast.walk(part)) if everywhere else _top(tree):
        if isinstance(node, ast.Import):
            found |= {each.name for each in node.names}
        elif isinstance(node, ast.ImportFrom):
            for each in node.names:
                full = f"{node.module}.{each.name}"
                found.add(full if full in MODULES else node.module)
    return found


def _top(tree):
    """The statements that run when a file is imported: not those for type checkers alone."""
    for node in tree.body:
        if not (isinstance(node, ast.If) and "TYPE_CHECKING" in ast.dump(node.test)):
            yield node


@for_each(FILES, name)
def test_arrows(path):
    package = path.relative_to(ROOT).parts[0]
    used = imported(path) | set(DOCTEST.findall(path.read_text(encoding="utf-8")))
    assert {each.split(".")[0] for each in used} & set(MAY_IMPORT) <= MAY_IMPORT[package]


@for_each(FILES, name)
def test_private_files_are_imported_from_their_own_folder(path):
    own = module(path) if path.name == "__init__.py" else module(path).rsplit(".", 1)[0]
    for each in imported(path):
        if re.search(r"\._[a-z]", each):
            assert each.rsplit(".", 1)[0] == own, each


def test_no_two_modules_import_each_other():
    """Not in a circle of any length, and not from within functions either; a face and its own files are one."""
    package = {each: each.rsplit(".", 1)[0] if each.rsplit(".", 1)[-1].startswith("_") else each for each in MODULES}
    for of in (package, {each: each for each in MODULES}):
        arrows = {}
        for each, path in MODULES.items():
            # A package's own __init__ only gathers names; for single files it is left out.
            if of is not package and path.name == "__init__.py":
                continue
            targets = {
                of[t] for t in imported(path) if t in MODULES and (of is package or MODULES[t].name != "__init__.py")
            }
            arrows.setdefault(of[each], set()).update(targets - {of[each]} - {"vsh", "sim", "fit", "study"})
        assert _circle(arrows) is None


def _circle(arrows):
    """A circle among arrows as a list of its nodes, or None."""
    done = set()

    def visit(node, way):
        if node in way:
            return [*way[way.index(node) :], node]
        if node in done:
            return None
        done.add(node)
        for each in sorted(arrows.get(node, ())):
            found = visit(each, [*way, node])
            if found:
                return found
        return None

    return next((found for node in sorted(arrows) if (found := visit(node, []))), None)


@for_each(FILES, name)
def test_heavy_libraries_are_imported_in_few_places(path):
    for library, places in HEAVY.items():
        if any(each == library or each.startswith(library + ".") for each in imported(path, types=False)):
            assert any(fnmatch(name(path), place) for place in places)


@for_each(FILES, name)
def test_imports_within_functions_earn_it(path):
    """Only of heavy libraries, or of our own files that import one at their top."""
    for each in imported(path, types=False) - imported(path, everywhere=False):
        assert LATE.match(each) or name(path) in FIRST or any(map(LATE.match, _reached(each))), each


@functools.cache
def _reached(start):
    """All that is imported when a module is."""
    found, wait = set(), [start]
    while wait:
        each = wait.pop()
        if each in found:
            continue
        found.add(each)
        if each in MODULES:
            wait += imported(MODULES[each], everywhere=False)
            parent = each.rsplit(".", 1)[0]
            wait += [parent] if parent in MODULES and parent != each else []
    return found - {"scipy"}


def test_import_is_light():
    heavy = "{'matplotlib', 'healpy', 'emcee', 'astropy', 'ducc0', 'pandas', 'tqdm', 'scipy.optimize'}"
    run_python("-c", f"import sys, vsh, sim, fit; sys.exit(bool({heavy} & set(sys.modules)))")


@for_each(FILES, name)
def test_small_files(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 800


@for_each(FOLDERS, name)
def test_small_folders(folder):
    assert len(list(folder.glob("*.py"))) <= 15


def test_tests_mirror_the_packages():
    """Each folder of tests is one of the code, but for those about the project as a whole."""
    folders = {path.relative_to(ROOT / "tests") for path in FOLDERS if path.is_relative_to(ROOT / "tests")}
    packages = {path.relative_to(ROOT) for path in FOLDERS if not path.is_relative_to(ROOT / "tests")}
    assert {each.as_posix() for each in folders - packages} <= {".", "against", "language", "papers", "project"}


def test_every_file_of_the_packages_is_installed():
    """A wheel holds Python and what setup.cfg names: a table that it does not name is missed where it was installed."""
    config = ConfigParser()
    config.read(ROOT / "setup.cfg", encoding="utf-8")
    for package in MAY_IMPORT:
        named = [each.strip() for each in config["options.package_data"][package].split(",")]
        for path in (ROOT / package).rglob("*"):
            if path.is_file() and path.suffix != ".py" and "__pycache__" not in path.parts:
                assert path.relative_to(ROOT / package).as_posix() in named


def test_every_place_to_break_is_there():
    """The deliberate breaks of `tests/mutate.py`, whose run takes long."""
    assert [(name, old) for name, old, _, _ in BREAKS if old not in (ROOT / name).read_text(encoding="utf-8")] == []


def test_tests_of_breaks_are_found_by_their_names():
    files = {test.split("::")[0] for *_, tests in BREAKS for test in tests.split()}
    assert {name: len(list((ROOT / "tests").rglob(name))) for name in files} == dict.fromkeys(files, 1)


def test_scripts_import_what_is_there():
    """Two benchmarks imported what had gone; nothing runs them but people."""
    lost = []
    for path in (path for folder in ("benchmarks", "examples", "papers") for path in (ROOT / folder).rglob("*.py")):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.ImportFrom) and not node.level and (node.module or "").split(".")[0] in MAY_IMPORT:
                if importlib.util.find_spec(node.module) is None:
                    lost.append((path.name, node.module))
                    continue
                module = importlib.import_module(node.module)
                lost += [
                    (path.name, node.module, alias.name)
                    for alias in node.names
                    if not hasattr(module, alias.name) and not _is_module(f"{node.module}.{alias.name}")
                ]
    assert lost == []


def _is_module(name):
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False
