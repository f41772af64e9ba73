"""The documentation is complete and true to the code; `make docs` builds it."""

import re
import subprocess
import sys

import pytest
from conftest import ROOT

DOCS = ROOT / "docs"
PACKAGES = ("vsh", "fit", "sim", "study")


def test_every_module_is_in_the_reference():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    for package in PACKAGES:
        for path in (ROOT / package).glob("*.py"):
            if path.stem != "__init__":
                assert f".. automodule:: {package}.{path.stem}\n" in text


@pytest.mark.parametrize(
    "path", sorted(DOCS.glob("*.md")) + [ROOT / "README.md", ROOT / "CHANGELOG.md"], ids=lambda p: p.name
)
def test_links_to_files_hold(path):
    for link in re.findall(r"\]\(([^)#\s]+)", path.read_text(encoding="utf-8")):
        if "://" not in link and not link.startswith("gallery/"):
            target = path.parent / link
            assert target.exists() or (path.name == "CHANGELOG.md" and (ROOT / link).exists()), link


@pytest.mark.parametrize("name", ["vsh-fit", "vsh-sim", "vsh-redshift", "vsh-correlate", "vsh-study"])
def test_options_that_the_pages_name_exist(name):
    """Every option of a command that stands on a page is one that the command has."""
    module = {"vsh-fit": "fit.commands.fit", "vsh-sim": "sim.command", "vsh-redshift": "fit.commands.redshift", "vsh-correlate": "fit.commands.correlate",
              "vsh-study": "study.command"}[name]  # fmt: skip
    done = subprocess.run([sys.executable, "-m", module, "--help"], cwd=ROOT, capture_output=True, text=True, encoding="utf-8",
                          check=True)  # fmt: skip
    known = set(re.findall(r"--[a-z-]+", done.stdout))
    for path in [ROOT / "README.md", *DOCS.glob("*.md")]:
        for line in path.read_text(encoding="utf-8").splitlines():
            for command in re.findall(rf"{name}( [^`|\n]*)", line):
                assert set(re.findall(r"(?<= )--[a-z-]+", command)) <= known, (path.name, line)


def test_the_python_in_the_pages_is_python():
    for path in [ROOT / "README.md", *DOCS.glob("*.md")]:
        for block in re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), re.DOTALL):
            compile(block, path.name, "exec")
