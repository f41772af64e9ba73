"""What others read of the package beside its code: workflows, hooks, citation, and an empty machine."""

import configparser
import json
import os
import re
import shlex
import subprocess
import sys

import pytest
import yaml
from conftest import ROOT, for_each, run_python
from wheel import JOBS

import vsh
from vsh.__main__ import import_command_module
from vsh.commands import parsing

YAML = [
    *(ROOT / ".github").rglob("*.yml"), ROOT / ".pre-commit-config.yaml", ROOT / ".readthedocs.yaml",
    ROOT / "CITATION.cff",
]  # fmt: skip
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
PAPER = ROOT / "papers" / "joss" / "paper.md"
ZENODO = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))


#: What stands at the top, beside files: a folder that a tool left behind would be seen here.
FOLDERS = {
    ".binder", ".ci", ".github", "benchmarks", "docs", "examples", "fit", "papers", "requirements", "sim", "study",
    "tests", "vsh",
}  # fmt: skip


def test_nothing_else_is_kept():
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if files.returncode:
        pytest.skip("not in a repository of git")
    paths = files.stdout.splitlines()
    assert {path.split("/")[0] for path in paths if "/" in path} == FOLDERS
    made = (".png", ".fits", ".ecsv", ".csv", ".html")
    assert not [path for path in paths if "/" not in path and path.endswith(made)]
    large = [path for path in paths if (ROOT / path).exists() and (ROOT / path).stat().st_size > 500_000]
    assert large == []


@for_each(YAML, lambda path: path.relative_to(ROOT).as_posix())
def test_yaml_is_valid(path):
    assert isinstance(yaml.safe_load(path.read_text(encoding="utf-8")), dict)


@for_each(JOBS)
def test_jobs_of_the_wheel_are_understood(job):
    program, *words = shlex.split(job)
    assert parsing.parse_options(import_command_module(program.removeprefix("vsh-")), words) is not None


def test_citation_zenodo_and_paper_agree():
    paper = yaml.safe_load(PAPER.read_text(encoding="utf-8").split("---")[1])
    names = [each["name"] for each in CITATION["authors"]]
    assert CITATION["title"] == ZENODO["title"]
    assert names == [each["name"] for each in ZENODO["creators"]] == [each["name"] for each in paper["authors"]]
    assert CITATION["license"] == ZENODO["license"] == "BSD-3-Clause"
    assert " ".join(CITATION["abstract"].split()) == ZENODO["description"]
    assert set(ZENODO["keywords"]) <= set(CITATION["keywords"])
    assert paper["title"].startswith("vsh-astrometry")
    assert CITATION["version"] == vsh.__version__


def test_references_of_the_paper_are_all_there():
    text = PAPER.read_text(encoding="utf-8")
    entries = (ROOT / "vsh" / "commands" / "citations.bib").read_text(encoding="utf-8")
    cited = set(re.findall(r"@(\w+)", text))
    assert len(cited) > 10
    assert cited <= set(re.findall(r"^@\w+{([^,]+),", entries, re.MULTILINE))


@pytest.fixture
def without_healpy(tmp_path):
    """Run Python where healpy is not installed, as on Windows."""
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['healpy'] = None\n")

    def run(*words):
        environment = {"PYTHONPATH": f"{tmp_path}:{ROOT}", "PATH": "", "HOME": str(tmp_path)}
        return run_python("-m", "vsh", *words, folder=tmp_path, environment=environment, status=None)

    return run


@pytest.mark.slow
def test_commands_run_without_healpy(without_healpy, tmp_path):
    assert without_healpy("fit", "--demo", "--output", "demo").returncode == 0
    assert (tmp_path / "demo" / "sky.png").exists()
    done = without_healpy(
        "correlate", str(ROOT / "fit" / "demo.fits"), "--influence", "omega_y,a_x", "--output", "influence"
    )
    assert done.returncode == 0, done.stderr
    done = without_healpy("sim", "quasars", "--number", "20", "--selection", "map.fits", "--output", "q.fits")
    assert done.returncode == 1
    assert "maps need healpy, which is not installed" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("code", [
    "from vsh.tools.printing import import_quietly; import_quietly('corner')",
    "import vsh.figures.plot, vsh.figures.page, study",
])  # fmt: skip
def test_imports_warn_of_nothing_in_an_empty_home(code, tmp_path):
    """Arviz, which corner imports, warns once a day by a stamp in the user's cache."""
    home = {"HOME": str(tmp_path), "PATH": os.environ["PATH"]}
    # Warnings by our own modules; numpy and others may have theirs.
    command = [sys.executable, "-W", "error::FutureWarning", "-c", code]
    done = subprocess.run(command, cwd=ROOT, env=home, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "Warning" not in done.stderr


def test_versions_are_locked_and_floors_are_tested():
    """`make test-oldest` installs the lowest versions that setup.cfg declares."""
    floors = dict(re.findall(r"^[ \t]+(\w[\w-]*)>=([\d.]+)(?:;.*)?$", (ROOT / "setup.cfg").read_text(), re.MULTILINE))
    oldest = dict(re.findall(r"^([\w-]+)==([\d.]+)$", (ROOT / "requirements" / "oldest.txt").read_text(), re.MULTILINE))
    libraries = "numpy scipy astropy healpy ducc0 emcee matplotlib tqdm lazy-loader threadpoolctl corner"
    for name in libraries.split():
        assert oldest[name].removesuffix(".0").startswith(floors[name].removesuffix(".0")), name
    newest = (ROOT / "requirements" / "newest.txt").read_text()
    settings = configparser.ConfigParser()
    settings.read(ROOT / "setup.cfg")
    others = {"uv", *re.findall(r"^([\w-]+)>=", settings["options.extras_require"]["against"].strip(), re.MULTILINE)}
    assert all(f"\n{name}==" in newest for name in floors if name not in others)  # of tools and oracles


@pytest.mark.slow
def test_two_processes_at_once_in_an_empty_home(tmp_path):
    """arviz' stamp is written under one temporary name: of two first imports one failed now and then."""
    code = "from vsh.tools.printing import import_quietly; import_quietly('corner')"
    home = {"HOME": str(tmp_path / "home"), "PATH": os.environ["PATH"]}
    (tmp_path / "home").mkdir()
    both = [
        subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, env=home, stderr=subprocess.PIPE) for _ in range(3)
    ]
    assert [(p.communicate(timeout=60)[1], p.returncode)[1] for p in both] == [0, 0, 0]
