"""The documentation is complete and true to the code; `make docs` builds it."""

import ast
import configparser
import importlib
import inspect
import re

import yaml
from conftest import ROOT, for_each, run_python

import vsh
import vsh.__main__ as commands
from vsh.commands.renamed import RULES

DOCS = ROOT / "docs"
PAGES = [*sorted(DOCS.rglob("*.md")), ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md"]
PAGES = [path for path in PAGES if "_build" not in path.parts and not {"gallery", "learn"} & set(path.parts)]
COMMANDS = [f"vsh-{name}" for name in commands.COMMANDS]
#: Faces whose names are used inside the project only.
INTERNAL = {
    "study", "study.commands", "sim.agis.passes", "sim.commands", "fit.commands", "vsh.figures", "vsh.io", "vsh.models",
    "vsh.tools", "vsh.commands",
}  # fmt: skip
#: Faces whose names stand under the modules that they are of.
NAMED_BELOW = {"fit.frames", "fit.motions", "fit.normal", "fit.results", "vsh.sky"}


def words_of(command):
    return commands.import_command_module(command.removeprefix("vsh-"))


def name(path):
    return path.relative_to(ROOT).as_posix()


def faces():
    for package in ("vsh", "sim", "fit", "study"):
        for path in (ROOT / package).rglob("__init__.py"):
            yield ".".join(path.relative_to(ROOT).parts[:-1])


def test_every_face_has_its_page():
    text = "".join(path.read_text(encoding="utf-8") for path in (DOCS / "api").glob("*.md"))
    assert {face for face in faces() if f".. automodule:: {face}\n" not in text} == INTERNAL | NAMED_BELOW


def test_every_promised_name_stands_on_a_page():
    shown = set()
    for path in (DOCS / "api").glob("*.md"):
        for module, options in re.findall(r"automodule:: ([\w.]+)\n((?:   :.*\n)*)", path.read_text(encoding="utf-8")):
            named = re.search(r":members: (.+)", options)
            own = importlib.import_module(module)
            names = named[1].split(", ") if named else own.__all__ if ":members:" in options else ()
            shown |= {id(getattr(own, each)) for each in names}
        shown |= {id(getattr(vsh, each.strip())) for each in re.findall(r"autoclass:: vsh\.(\w+)\n", path.read_text())}
    promised = {f"{face}.{each}": getattr(importlib.import_module(face), each)
                for face in faces() for each in getattr(importlib.import_module(face), "__all__", ())}  # fmt: skip
    missing = [name for name, each in promised.items() if not inspect.ismodule(each) and id(each) not in shown]
    assert not missing, f"add to the :members: of docs/api/: {', '.join(missing)}"


@for_each(sorted(faces()))
def test_faces_have_what_they_promise(face):
    module = importlib.import_module(face)
    for each in getattr(module, "__all__", ()):
        assert getattr(module, each) is not None, f"{face}.{each}"


def test_every_command_has_its_page():
    for command in COMMANDS:
        path = DOCS / "commands" / f"{command}.md"
        assert path.is_file(), f"write docs/commands/{command}.md, as its neighbours"
        text = path.read_text(encoding="utf-8")
        assert f":module: {words_of(command).__name__}\n" in text
        assert re.search(rf"^```{{sample}}[^`]*^{command} ", text, re.MULTILINE), f"show on {path.name} what it prints"


@for_each(COMMANDS)
def test_options_have_long_names_and_help(command):
    """By these names `run.toml` keeps them."""
    for action in words_of(command).make_parser()._actions:
        assert action.help, action.dest
        assert action.dest == "help" or all(option.startswith("--") for option in action.option_strings), action.dest


@for_each(PAGES, name)
def test_links_to_files_hold(path):
    for link in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
        if "://" not in link and not link.removeprefix("../").startswith(("gallery/", "learn/")):
            target = path.parent / link
            assert target.exists() or (path.name == "CHANGELOG.md" and (ROOT / link).exists()), link


@for_each(COMMANDS)
def test_options_that_the_pages_name_exist(command):
    """Every option of a command that stands on a page is one that the command has."""
    done = run_python("-m", "vsh", command, "--help-all")
    known = set(re.findall(r"--[a-z0-9-]+", done.stdout))
    for path in PAGES:
        if path.name == "CHANGELOG.md":
            continue
        if path.name == "dr4.md":  # its commands are frozen, under the names of then
            known = known | {f"--{rule.split()[-2]}" for rule in RULES if rule.endswith(" {}")}
        for line in path.read_text(encoding="utf-8").splitlines():
            for options in re.findall(rf"{command}( [^`|\n]*)", line):
                assert set(re.findall(r"(?<= )--[a-z0-9-]+", options)) <= known, (path.name, line)


def test_python_in_the_pages_is_python():
    for path in PAGES:
        for block in re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL):
            compile(block, path.name, "exec")


def test_python_of_the_readme_runs():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    assert "acceleration" in run_python("-c", block).stdout


def test_readme_is_short():
    lines = (ROOT / "README.md").read_text(encoding="utf-8").splitlines()
    assert len(lines) <= 90
    assert not [line for line in lines if len(line) > 110]
    first = " ".join(lines[:9])
    for word in ("vector spherical harmonics", "proper motions", "Gaia", "VLBI", "spin", "acceleration"):
        assert word in first


def test_version_is_said_once():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert cited["version"] == vsh.__version__
    said = re.compile(rf"version\s*[:=]+\s*[\"']?{re.escape(vsh.__version__)}")
    for path in [
        *DOCS.glob("*.md"),
        *(ROOT / name for name in ("README.md", "setup.cfg", "pyproject.toml", "setup.py")),
    ]:
        assert not said.search(path.read_text(encoding="utf-8")), path.name


def test_recipe_for_conda_needs_what_setup_cfg_says():
    """Names differ in three cases, bounds in none; the version is the package's."""
    recipe = (ROOT / "requirements" / "conda" / "recipe.yaml").read_text(encoding="utf-8")
    listed = set(re.findall(r"^    - (\S+ >=[\d.]+)$", recipe.partition("  run:")[2], re.MULTILINE))
    config = configparser.ConfigParser(interpolation=None)
    config.read(ROOT / "setup.cfg")
    theirs = {"astropy": "astropy-base", "matplotlib": "matplotlib-base", "lazy-loader": "lazy_loader"}
    wanted = set()
    for line in config["options"]["install_requires"].split("\n"):
        line = line.partition(";")[0].strip()  # conda has no package for Windows, whose marker goes
        if not line or line.startswith("#"):
            continue
        name, bound = line.split(">=")
        wanted.add(f"{theirs.get(name, name)} >={bound}")
    assert listed == wanted
    assert f'version: "{vsh.__version__}"' in recipe


def test_actions_are_pinned():
    """Every action by its commit, and every workflow says what it may."""
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        text = path.read_text(encoding="utf-8")
        assert "permissions:" in text, path
        for line in re.findall(r"uses: (.*)", text):
            pinned = r"[\w./-]+@[0-9a-f]{40}  # v[\d.]+( # zizmor: ignore\[artipacked\])?"
            assert re.fullmatch(pinned, line), (path, line)


def test_validation_ends_with_what_the_benchmarks_printed():
    """Copied by docs/make_validation.py, or by hand after another benchmark."""
    coverage = (ROOT / "benchmarks" / "coverage.md").read_text(encoding="utf-8").strip()
    text = (DOCS / "validation.md").read_text(encoding="utf-8").strip()
    assert text.startswith("# Validation")
    assert text.endswith(coverage)


def texts_of_code():
    """All texts of the packages but docstrings, … where a value is put in."""
    for package in ("vsh", "fit", "sim", "study"):
        for path in (ROOT / package).rglob("*.py"):
            nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
            docstrings = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
            for node in nodes:
                if isinstance(node, ast.JoinedStr):
                    yield "".join(part.value if isinstance(part, ast.Constant) else "…" for part in node.values)
                elif isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docstrings:
                    yield node.value


def test_messages_that_are_explained_are_in_the_code():
    """Every piece of two words or more between the … of a message; what other programs say is left out."""
    text = " ".join("\n".join(texts_of_code()).split())
    page, _, _ = (DOCS / "troubleshooting.md").read_text(encoding="utf-8").partition("## Setting up")
    messages = re.findall(r"^\| (.+?) \| .+ \|$", page, re.MULTILINE)
    assert len(messages) > 60
    for message in messages:
        if not message.startswith(("message", "---", "the command ends", "Python ends")):
            pieces = re.split(r"…|; | / |\b[NMLXY]\b|θ|`[^`]*`|'[^']*'", message)
            for piece in (piece.strip(" .,:?()") for piece in pieces):
                assert len(piece.split()) < 2 or piece in text, f"{message}: no message has {piece!r}"


def test_options_that_messages_name_exist():
    helps = "".join(words_of(name).make_parser().format_help_all() for name in COMMANDS)
    option = re.compile(r"(?<![\w-])--[a-z][\w-]*")
    named = {name for text in texts_of_code() for name in option.findall(text)}
    assert named - {*option.findall(helps)} == {"--threads"}  # a setting of the process
