"""A type checker sees our types in a user's script, as the project is installed here."""

import re

import pytest
from conftest import run_python

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
@pytest.mark.parametrize(
    ("script", "lines"), [(SCRIPT, [7, 8, 9, 10, 11, 12]), (READ_BACK, [9])], ids=["planted mistakes", "what is read"]
)
def test_mistakes_are_found(script, lines, tmp_path):
    (tmp_path / "mine.py").write_text(script)
    done = run_python("-m", "mypy", "mine.py", folder=tmp_path, status=None, environment={"PYTHONPATH": None})
    found = re.findall(r"^mine\.py:(\d+): error:", done.stdout, re.MULTILINE)
    assert [int(line) for line in dict.fromkeys(found)] == lines, done.stdout
