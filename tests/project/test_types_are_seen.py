"""A type checker sees our types in a user's script, as the project is installed here."""

import re
import subprocess
import sys

import pytest

SCRIPT = """\
import fit
import sim
from vsh import Field, Modes
from vsh.io.catalogue import read_field

field: Field = read_field("catalogue.fits")
modes = Modes("three")  # a degree is a number
solution = fit.fit_field(field, lmx=3)  # misspelt
print(field.longitude)  # it is called lon
print(fit.fit_field(field, 3).acceleration.amplitud)  # amplitude
spin: float = fit.fit_field(field, 1).spin  # a Vector
quasars = sim.quasars(number=3)  # n
"""


@pytest.mark.slow
def test_six_planted_mistakes(tmp_path):
    (tmp_path / "mine.py").write_text(SCRIPT)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "mine.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    found = re.findall(r"^mine\.py:(\d+): error:", done.stdout, re.MULTILINE)
    assert [int(line) for line in dict.fromkeys(found)] == [7, 8, 9, 10, 11, 12], done.stdout


READ_BACK = """\
from typing import assert_type

import fit
from matplotlib.axes import Axes

solution = fit.Solution.read("solution.ecsv")
assert_type(solution, fit.Solution)
assert_type(solution.plot(), Axes)
solution.plot(ax=solution)  # no axes
"""


@pytest.mark.slow
def test_readers_and_figures_are_typed(tmp_path):
    (tmp_path / "mine.py").write_text(READ_BACK)
    done = subprocess.run(
        [sys.executable, "-m", "mypy", "mine.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert re.findall(r"^mine\.py:(\d+): error:", done.stdout, re.MULTILINE) == ["9"], done.stdout
