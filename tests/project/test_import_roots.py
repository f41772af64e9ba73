"""The four packages are ours wherever they are imported from, a user's `fit.py` beside them or not."""

import importlib
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from conftest import POSIX, ROOT, run_python

PACKAGES = ("vsh", "sim", "fit", "study")
#: What a user may have in a folder: its files, and whether Python takes it for ours.
FORMS = {
    "file": ("{name}.py", True),
    "package": ("{name}/__init__.py", True),
    "folder with code": ("{name}/mine.py", False),
    "folder without code": ("{name}/data.txt", False),
}


@pytest.fixture(scope="module", params=["editable", pytest.param("wheel", marks=pytest.mark.slow)])
def python(request, tmp_path_factory):
    """Python with the project as a wheel leaves it: a folder of packages; or as it is installed here."""
    if request.param == "editable":
        return lambda folder, *words: _run(folder, None, words)
    site = tmp_path_factory.mktemp("site")
    for name in PACKAGES:
        shutil.copytree(ROOT / name, site / name, ignore=shutil.ignore_patterns("__pycache__"))
    return lambda folder, *words: _run(folder, site, words)


def _run(folder, site, words):
    if words[0] != "-m":  # a script
        (folder / "script.py").write_text(words[0])
        words = ("script.py",)
    if site is None:
        return subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    # Without what an editable installation adds (`-S`); NumPy and the others are beside the packages, as in an environment.
    libraries = Path(np.__file__).parent.parent
    environment = {"PYTHONPATH": os.pathsep.join(map(str, (site, libraries))), "HOME": str(folder)}
    return subprocess.run(
        [sys.executable, "-S", *words], cwd=folder, env=environment, capture_output=True, text=True, check=False
    )


def _write(folder, form, name):
    path = folder / FORMS[form][0].format(name=name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("MINE = 1\n")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ["fit", "sim", "study"])
def test_warning_names_what_hides_a_package(python, form, name, tmp_path):
    _write(tmp_path, form, name)
    done = python(tmp_path, "import vsh")
    assert done.returncode == 0, done.stderr
    assert (f"hides the package {name} of vsh-astrometry" in done.stderr) == FORMS[form][1]
    assert str(tmp_path) in done.stderr or not FORMS[form][1]


@pytest.mark.parametrize(
    "form", [pytest.param(form, marks=[pytest.mark.slow] * (form != "editable-file")) for form in FORMS]
)
def test_commands_run_beside_what_hides_a_package(python, form, tmp_path):
    for name in ("fit", "sim", "study"):
        _write(tmp_path, form, name)
    catalogue = ROOT / "fit" / "demo.fits"
    if form == "file":
        catalogue = "q.ecsv"
        done = python(tmp_path, *f"-m vsh sim quasars --number 50 --errors expected --output {catalogue}".split())
        assert done.returncode == 0, done.stderr
    done = python(tmp_path, "-m", "vsh", "fit", catalogue, "--lmax", "1", "--format", "none")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    assert "spin" in done.stdout


def test_packages_are_not_hidden(python, tmp_path):
    done = python(tmp_path, "import vsh, sim, fit, study; print(fit.fit_field, sim.quasars, study.__doc__)")
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""


#: Imports the name of each line of standard input in a child that nothing else of ours has been imported in.
_CODE = """
import importlib, os, sys, traceback
import astropy.coordinates, astropy.table, healpy, matplotlib.pyplot, numpy, scipy  # not ours, and slow
for line in sys.stdin:
    module, name = line.split()
    child = os.fork()
    if not child:
        try:
            getattr(importlib.import_module(module), name)
        except BaseException:
            print(module, name, traceback.format_exc(limit=-1), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""


def promised():
    """Each module of ours with the names that it promises, one for each module that defines some."""
    seen = set()
    for package in ("vsh", "sim", "fit", "study"):
        for path in sorted((ROOT / package).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            module = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            if "__all__" in path.read_text(encoding="utf-8"):
                for name in getattr(importlib.import_module(module), "__all__", ()):
                    origin = getattr(getattr(importlib.import_module(module), name), "__module__", name)
                    if (module, origin) not in seen:
                        seen.add((module, origin))
                        yield module, name


@POSIX
@pytest.mark.slow
def test_each_promised_name_is_imported_by_itself():
    names = "\n".join(f"{module} {name}" for module, name in promised())
    assert names.count("\n") > 100
    assert run_python("-c", _CODE, input=names).stdout == ""
