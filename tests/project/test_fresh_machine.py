"""Nothing depends on what yesterday's run left in a cache."""

import os
import re
import subprocess
import sys

import pytest
from conftest import ROOT


@pytest.mark.slow
@pytest.mark.parametrize(
    "code",
    [
        "from vsh.tools.printing import import_quietly; import_quietly('corner')",
        "import vsh.figures.plot, vsh.figures.page, sim.plot, study",
    ],
)
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
    floors = dict(re.findall(r"^[ \t]+(\w[\w-]*)>=([\d.]+)$", (ROOT / "setup.cfg").read_text(), re.MULTILINE))
    oldest = dict(re.findall(r"^([\w-]+)==([\d.]+)$", (ROOT / "requirements" / "oldest.txt").read_text(), re.MULTILINE))
    for name in (
        "numpy",
        "scipy",
        "astropy",
        "healpy",
        "ducc0",
        "emcee",
        "matplotlib",
        "tqdm",
        "lazy-loader",
        "threadpoolctl",
        "corner",
    ):
        assert oldest[name].removesuffix(".0").startswith(floors[name].removesuffix(".0")), name
    newest = (ROOT / "requirements" / "newest.txt").read_text()
    assert all(f"\n{name}==" in newest for name in floors if name != "uv")


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
