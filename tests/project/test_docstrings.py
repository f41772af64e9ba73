"""Every public signature is typed; the docstring of a promised name has every argument, in one form; the rest has a line."""

import ast
import importlib
import inspect
import re

from conftest import ROOT, for_each, parsed

FILES = [path for package in ("vsh", "sim", "fit", "study") for path in sorted((ROOT / package).rglob("*.py"))]

#: Where a promised signature says Any, and why: arguments by their names, what is returned by the function's.
HEADER = "what a header or JSON keeps"
ON = "handed on to the function that the docstring names"
TABLES = "a path, an address, or a table of astropy, pandas, polars or Arrow: by what it can do"
COLUMNS = "an array, a Quantity or a column, masked or not"
ASTROPY = "an astropy object, which is not imported for its name"
SOURCES = "a Field, a Population, a SkyCoord: whatever has positions"
ARROWS = "a result that this file must not import: arrows run one way"
SAME = "the type of what was given"
DRAWN = "an artist of matplotlib whose kind depends on what is drawn"
REASONS = {
    **dict.fromkeys(("meta", "truth", "provenance"), HEADER),
    **dict.fromkeys(("options", "style", "reading", "further"), ON),
    **dict.fromkeys(("source", "path", "positions", "pairs", "a", "b"), TABLES),
    **dict.fromkeys(
        ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "values", "errors", "columns", "units", "selection"),
        COLUMNS,
    ),
    **dict.fromkeys(("coord", "radius", "orientation", "spin", "jump", "acceleration", "masses"), ASTROPY),
    **dict.fromkeys(("sources", "cases", "fields", "field", "table"), SOURCES),
    **dict.fromkeys(
        ("solution", "check", "figures", "beside", "about", "models", "floor", "law", "folder", "observations",
         "attitude", "chosen"), ARROWS,
    ),
    **dict.fromkeys(("work", "pieces", "piece", "function", "solve", "potential", "correction"), "a function of the caller's"),
    "color": "a colour of matplotlib, or an array of them", "ax": "axes, or an array: each result says which",
    "rotate": "coefficients, or a pair with their covariance",
    "apparent_motion": SAME, "lensing_motion": SAME, "NominalScanningLaw.attitude": "three arrays, of any shape",
    "TabulatedLaw.attitude": "three arrays, of any shape",
    **dict.fromkeys(("search_in_time", "Solution.power"), "by its arguments"),
    **dict.fromkeys(("Field.to_skycoord", "Vector.to_skycoord"), "astropy's SkyCoord, which is imported when it is asked for"),
    "Field.to_pandas": "pandas's DataFrame, which is imported when it is asked for",
    "read": "a result, a field or a table: what is in the file",
    "Result.plot": "axes, or an array: each result says which", "Floor.allowed_for": "what `solve` returns",
    "Parts.sum": "what `function` returns", "Dask.total": "what `work` returns", "Processes.total": "what `work` returns",
    "Dask.fetched": SAME, "Parts.in_memory": SAME, "Study.plain": HEADER, "Result.to_dict": HEADER, "Referee.results": "results of many kinds",
    "Posterior.to_arviz": "arviz's, which may not be installed", "Samples.to_arviz": "arviz's, which may not be installed",
    "widget": "ipywidgets', which may not be installed", "Solution.widget": "ipywidgets', which may not be installed",
    **dict.fromkeys(("draw_vectors", "draw_map", "draw_sources", "draw_points", "draw_direction"), DRAWN),
}  # fmt: skip


def faces():
    """What a folder promises, in `__all__` of its `__init__` or of the stub that it follows; and what a module does."""
    for path in [*FILES, *(ROOT / package / "__init__.pyi" for package in ("vsh", "sim", "fit"))]:
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.Assign) and getattr(node.targets[0], "id", "") == "__all__":
                yield path.parent if path.stem == "__init__" else path, set(ast.literal_eval(node.value))


PROMISED: dict = {}
for _folder, _names in faces():
    PROMISED[_folder] = PROMISED.get(_folder, set()) | _names
ENTRY = re.compile(r"^([*\w][\w, *]*?)(?: : .*)?$")


def public(path):
    """The public functions of a file, and the public methods of its public classes: pairs of a name and a node."""
    for node in parsed(path).body:
        if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
            yield node.name, node
        elif isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
            yield node.name, node
            for each in node.body:
                if isinstance(each, ast.FunctionDef) and not each.name.startswith("_"):
                    yield f"{node.name}.{each.name}", each


def promised(path):
    """The same of names that the file, its folder, or the one above promises."""
    names = set().union(*(PROMISED.get(place, set()) for place in (path, path.parent, path.parent.parent)))
    for name, node in public(path):
        if name.split(".")[0] in names:
            yield name, node


def arguments(node):
    spec = node.args
    found = [*spec.posonlyargs, *spec.args, *spec.kwonlyargs, spec.vararg, spec.kwarg]
    return [each for each in found if each is not None and each.arg not in ("self", "cls")]


def documented(node):
    """Names under Parameters."""
    lines = ast.get_docstring(node).splitlines()
    if "Parameters" not in lines:
        return set()
    found = set()
    for line, after in zip(lines[lines.index("Parameters") + 2 :], [*lines[lines.index("Parameters") + 3 :], ""]):
        if re.fullmatch("-+", after):
            break
        match = ENTRY.match(line)
        if match and not line.startswith(" "):
            found |= {each.strip().lstrip("*") for each in match.group(1).split(",")}
    return found


def named_in_summary(node):
    """Names in backticks in the first line, which is enough for a method of few plain arguments."""
    return set(re.findall(r"`(\w+)`", ast.get_docstring(node).splitlines()[0]))


def path_name(path):
    return path.relative_to(ROOT).as_posix()


def anything(node):
    """Whether an annotation says Any."""
    return node is not None and any(isinstance(each, ast.Name) and each.id == "Any" for each in ast.walk(node))


@for_each(FILES, path_name)
def test_untyped_values_have_a_reason(path):
    for name, node in promised(path):
        if isinstance(node, ast.FunctionDef):
            said = {each.arg for each in arguments(node) if anything(each.annotation)}
            assert said | ({name} if anything(node.returns) else set()) <= set(REASONS)


@for_each(FILES, path_name)
def test_signatures_are_typed(path):
    for name, node in public(path):
        if isinstance(node, ast.FunctionDef):
            assert node.returns is not None, name
            assert [each.arg for each in arguments(node) if each.annotation is None] == [], name


@for_each(FILES, path_name)
def test_docstrings_name_every_argument(path):
    for name, node in public(path):
        assert ast.get_docstring(node), name
    for name, node in promised(path):
        if isinstance(node, ast.FunctionDef) and not (name.endswith(".plot") and documented(node) == set()):
            names = {each.arg for each in arguments(node)}
            assert names == documented(node) or ("." in name and names <= named_in_summary(node)), name
        elif isinstance(node, ast.FunctionDef):  # of which `Result.plot` tells, once
            assert {each.arg for each in arguments(node)} == {"ax"}, name


@for_each(FILES, path_name)
def test_docstrings_have_one_form(path):
    """A type and its text stand on lines of their own."""
    for name, node in public(path):
        for line in ast.get_docstring(node).splitlines():
            assert not re.match(r"^\w[\w, ]* : .* — ", line), (name, line)


@for_each(FILES, path_name)
def test_docstrings_say_what_they_speak_of(path):
    """No entry begins with a preposition that nothing stands before, and none under Returns is a type alone."""
    text = path.read_text(encoding="utf-8")
    assert re.findall(r'(?m)^\s*(?:"""|#:? )?(?:Of|Whose) .*$', text) == []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.FunctionDef) and ast.get_docstring(node):
            lines = [*ast.get_docstring(node).splitlines(), ""]
            if "Returns" in lines and " : " not in lines[lines.index("Returns") + 2]:
                assert lines[lines.index("Returns") + 3].startswith("    "), node.name


@for_each(FILES, path_name)
def test_long_signatures_take_keywords(path):
    """No promised function takes more than nine arguments by position."""
    for name, node in promised(path):
        if isinstance(node, ast.FunctionDef):
            assert len(node.args.args) <= 9, name


@for_each(FILES, path_name)
def test_errors_that_are_raised_are_listed(path):
    for name, node in promised(path):
        if not isinstance(node, ast.FunctionDef):
            continue
        raised = [each for each in ast.walk(node) if isinstance(each, ast.Raise) and isinstance(each.exc, ast.Call)]
        if raised:
            assert "Raises\n------" in ast.get_docstring(node), name


@for_each(["vsh", "fit", "sim"])
def test_all_that_a_face_gives_has_an_example(face):
    """What is called or made from the three faces is shown at work; the examples are run as tests."""
    module = importlib.import_module(face)
    given = {name: getattr(module, name) for name in module.__all__}
    lacking = [
        name
        for name, each in given.items()
        if callable(each)
        and not (inspect.isclass(each) and issubclass(each, BaseException))
        and ">>>" not in (each.__doc__ or "")
    ]
    assert not lacking


#: Openings that name no thing and no action.
WEAK = re.compile(
    r"(What|Which|How|Where|Whether|Why|That|It|They|The same|Those|These|So|As|By|In|Of|To|For|From|With|Up|On|At|Beside"
    r"|Nothing|Every|Each|One|Two)\b"
)


@for_each(FILES, lambda path: path.relative_to(ROOT).as_posix())
def test_docstrings_open_with_a_verb_or_a_noun(path):
    kinds = ast.ClassDef | ast.FunctionDef | ast.AsyncFunctionDef
    nodes = [node for node in ast.walk(parsed(path)) if isinstance(node, kinds)]
    assert [node.name for node in nodes if WEAK.match(ast.get_docstring(node) or "")] == []


def test_figures_take_and_return_axes():
    """Every figure can be drawn on axes that are given, and gives back those it is on."""
    nodes = [node for path in FILES for node in ast.walk(parsed(path)) if isinstance(node, ast.FunctionDef)]
    figures = [node for node in nodes if node.name.startswith("plot_") or node.name in ("plot", "corner", "trace")]
    assert len(figures) > 60
    for node in figures:
        assert "ax" in [each.arg for each in node.args.kwonlyargs], node.name
        assert ast.unparse(node.returns) in ("Axes", "AxesArray", "SkyAxes", "Any"), node.name
        assert ast.get_docstring(node), node.name
