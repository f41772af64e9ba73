"""Names of the release before this one still work, and say what they are called now."""

import importlib
import subprocess
import sys

import pytest
from conftest import ROOT

import vsh
from vsh.tools.modules import MODULES


@pytest.mark.parametrize(("old", "new"), MODULES.items())
def test_a_module_by_its_old_name_is_the_module(old, new):
    sys.modules.pop(old, None)
    with pytest.warns(DeprecationWarning, match=f"{old} is now {new};"):
        module = importlib.import_module(old)
    assert module is importlib.import_module(new)
    assert module.__spec__.name == new


def test_old_names_are_attributes_too():
    vars(vsh).pop("catalogue", None)
    with pytest.warns(DeprecationWarning, match="vsh.catalogue is now vsh.io.catalogue"):
        assert vsh.catalogue is vsh.io.catalogue


def test_the_warning_names_the_line_that_asked(tmp_path):
    script = tmp_path / "mine.py"
    script.write_text("import vsh\nfrom vsh.catalogue import read_field\nvsh.cosmology\nfrom vsh import archive\n")
    done = subprocess.run([sys.executable, script], cwd=ROOT, capture_output=True, text=True, check=True)
    for line, name in ((2, "catalogue"), (3, "cosmology"), (4, "archive")):
        assert f"mine.py:{line}: DeprecationWarning: vsh.{name} is now" in done.stderr
