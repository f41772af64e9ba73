"""Files that are written are whole."""

from conftest import run_python

CODE = """
from astropy.table import Table
from vsh.tools.files import write_table
for length in range(180, 300):
    write_table(Table({"a": ["x" * length], "b": [1.5]}), "t.vot", overwrite=True)
    assert len(Table.read("t.vot")["a"][0]) == length
"""


def test_votable_row_of_any_length_is_written_whole(tmp_path):
    """The compiled writer of astropy writes one byte beyond its buffer where the text of a row just fills it."""
    run_python("-c", CODE, folder=tmp_path, environment={"PYTHONMALLOC": "debug"})
