"""Arrows run one way: vsh knows nobody, sim and fit know vsh, and neither knows the other."""

import re
import subprocess
import sys

import pytest
from conftest import ROOT

MAY_IMPORT = {"vsh": {"vsh"}, "sim": {"sim", "vsh"}, "fit": {"fit", "vsh"}, "study": {"study", "sim", "fit", "vsh"}}
FILES = sorted(path for package in MAY_IMPORT for path in (ROOT / package).rglob("*.py"))
IMPORT = re.compile(r"^\s*(?:>>> )?(?:from|import) ([\w.]+)", re.MULTILINE)  # doctests included
#: Heavy friends, and the rooms where they are met.
HEAVY = {
    "healpy": {"vsh/pixels.py"},
    "ducc0": {"vsh/transform.py"},
    "emcee": {"fit/chain.py"},
    "corner": {"fit/plot_posterior.py"},
    "arviz": {"fit/posterior.py"},
    "matplotlib": {
        "sim/plot.py",
        "vsh/plot.py",
        "fit/plot.py",
        "fit/plot_posterior.py",
        "fit/plot_redshift.py",
        "fit/export.py",
        "fit/cli.py",
        "fit/drift_cli.py",
        "fit/correlate_cli.py",
        "study/figures.py",
        "fit/plot_correlation.py",
    },
    "astropy.table": {
        "vsh/tables/_arrow.py",
        "vsh/tables/_memory.py",
        "vsh/tables/_source.py",
        "vsh/tables/_text.py",
        "vsh/tables/_write.py",
    },
    "pyarrow": {"vsh/tables/_arrow.py"},
    "astropy.cosmology": {"vsh/cosmology.py"},
    "astropy": {
        "vsh/cosmology.py",
        "sim/effects.py",
        "vsh/tables/_arrow.py",
        "vsh/tables/_fits.py",
        "vsh/tables/_memory.py",
        "vsh/tables/_source.py",
        "vsh/tables/_text.py",
        "vsh/tables/_votable.py",
        "vsh/tables/_write.py",
        "vsh/catalogue/_columns.py",
        "vsh/frames.py",
        "vsh/shell.py",
        "fit/storage.py",
    },
}


def name(path):
    return path.relative_to(ROOT).as_posix()


def imports(path):
    return set(IMPORT.findall(path.read_text(encoding="utf-8")))


@pytest.mark.parametrize("path", FILES, ids=name)
def test_arrows(path):
    package = path.relative_to(ROOT).parts[0]
    imported = {module.split(".")[0] for module in imports(path)} & set(MAY_IMPORT)
    assert imported <= MAY_IMPORT[package]


@pytest.mark.parametrize("path", FILES, ids=name)
def test_heavy_friends_are_met_at_their_own_door(path):
    for friend, rooms in HEAVY.items():
        if any(module == friend or module.startswith(friend + ".") for module in imports(path)):
            assert name(path) in rooms


def test_import_is_light():
    heavy = "{'matplotlib', 'healpy', 'emcee', 'astropy', 'ducc0', 'pandas'}"
    code = f"import sys, vsh, sim, fit; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0


@pytest.mark.parametrize("path", FILES, ids=name)
def test_small_rooms(path):
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 300
