"""The script of the page is a file of the repository: of the packages of npm's lock, with their licences."""

import json
import re
import shutil

import pytest
from conftest import ROOT, run_python

PAGE = ROOT / "vsh" / "figures" / "page"


def test_licences_are_of_packages_in_the_lock():
    lock = json.loads((ROOT / "requirements" / "page" / "package-lock.json").read_text(encoding="utf-8"))
    locked = {name.removeprefix("node_modules/") for name in lock["packages"]}
    texts = (PAGE / "d3.LICENSES.txt").read_text(encoding="utf-8").split("\n\n---\n\n")
    packages = {text.split("\n")[0] for text in texts}
    assert len(packages) == len(texts) >= 3
    assert packages <= locked
    assert all("Permission to use" in text or "Redistribution and use" in text for text in texts)


def test_script_has_what_the_sky_asks_of_it():
    script = (PAGE / "d3.min.js").read_text(encoding="utf-8")
    asked = (ROOT / "requirements" / "page" / "d3.js").read_text(encoding="utf-8")
    names = [name.strip() for part in re.findall(r"{(.*?)}", asked) for name in part.split(",")]
    assert len(names) == 8
    assert all(name in script for name in names)
    assert len(script) < 40_000


@pytest.mark.slow
def test_script_is_what_npm_makes_of_the_lock(tmp_path):
    if not shutil.which("npm"):
        pytest.skip("there is no npm")
    code = (
        "import runpy, sys; sys.argv = ['setup.py', '--name']; m = runpy.run_path('setup.py'); "
        "from pathlib import Path; m['make_bundle'](Path(sys.argv[0] and r'{0}/a.js'), Path(r'{0}/b.txt'))"
    )
    done = run_python("-c", code.format(tmp_path), status=None)
    if done.returncode:
        pytest.skip(f"npm makes nothing here: {done.stderr[-200:]}")
    assert (tmp_path / "a.js").read_bytes() == (PAGE / "d3.min.js").read_bytes()
    assert (tmp_path / "b.txt").read_bytes() == (PAGE / "d3.LICENSES.txt").read_bytes()
