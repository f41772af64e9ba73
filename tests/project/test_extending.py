"""docs/extending.md does what it says: an estimator, a signal, a format and a command are added as it tells, and run."""

import re
import shutil

import numpy as np
import pytest
from conftest import ROOT, run_python

from vsh import Field

PAGE = (ROOT / "docs" / "extending.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"^```(?:python|text)\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def house(tmp_path_factory):
    """The packages, with what the page adds."""
    house = tmp_path_factory.mktemp("house")
    for name in ("vsh", "sim", "fit", "study"):
        shutil.copytree(ROOT / name, house / name, ignore=shutil.ignore_patterns("__pycache__"))
    for block in BLOCKS:
        first, _, text = block.partition("\n")
        if first.startswith("# file: "):
            (house / first[8:]).write_text(text, encoding="utf-8")
        elif first.startswith("# row: "):
            path, _, table = first[7:].partition(", ")
            before, begin, after = (house / path).read_text(encoding="utf-8").partition(f"\n{table} = ")
            bracket, _, rest = after.partition("\n")
            (house / path).write_text(f"{before}{begin}{bracket}\n{text}{rest}", encoding="utf-8")
    return house


def run(house, *words, folder=None):
    return run_python(*words, folder=folder or house, environment={"PYTHONPATH": str(house)}).stdout


@pytest.mark.slow
def test_estimator_and_a_signal(tmp_path):
    free = [block for block in BLOCKS if not block.startswith(("# file", "# row"))]
    assert len(free) == 3
    script = tmp_path / "mine.py"
    script.write_text(
        "\n".join(free)
        + """
field = sim.observe(sim.quasars(2000, 1), truth, rng=2, sigma=10.0)
trimmed = trim(field, 1)
assert trimmed.n_left_out == 20
trimmed.write("trimmed.ecsv")
assert fit.storage.read("trimmed.ecsv").solution == trimmed.solution
print(trimmed.report())
assert abs(np.mean(sim.observe(masers(500, 1), truth, rng=2, sigma=10.0).to_frame("galactic").lat)) < 1e-9
"""
    )
    assert "spin" in run(tmp_path, str(script))


@pytest.mark.slow
def test_format(house, tmp_path):
    rng = np.random.default_rng(1)
    field = Field(*rng.uniform(0, 1.5, (2, 300)), rng.normal(size=(2, 300)), np.ones((2, 300)))
    table = field.to_table()
    table.remove_column("source_id")
    for name in ("sky.bars", "noname"):
        table.write(tmp_path / name, format="ascii.basic", delimiter="|", overwrite=True)
    plain = table.copy()
    plain.write(tmp_path / "sky.csv", format="ascii.csv")
    expected = (
        run(house, "-m", "vsh", "fit", str(tmp_path / "sky.csv"), "--lmax", "1").partition("\n\n")[2].split("\n")[1:]
    )
    for words in (["sky.bars"], ["noname"], ["noname", "--columns", "format=bars"]):
        report = run(house, "-m", "vsh", "fit", str(tmp_path / words[0]), "--lmax", "1", *words[1:])
        assert report.partition("\n\n")[2].split("\n")[1:] == expected  # below the lines to quote and the file's name
    assert "formats: bars, FITS, " in " ".join(run(house, "-m", "vsh", "fit", "--help-all").split())
    broken = tmp_path / "broken.bars"
    broken.write_text("|".join((tmp_path / "sky.bars").read_text().split("|")[:-3]))
    done = run_python("-m", "vsh", "fit", broken, folder=house, environment={"PYTHONPATH": str(house)}, status=1)
    assert "1 of 300 rows cannot be used" in done.stderr


#: The line to quote, and the section.
COUNTED = "sources        30 in sky.csv\n\nSources\n  sources\n       30\n"


@pytest.mark.slow
def test_command(house, tmp_path):
    rng = np.random.default_rng(1)
    Field(*rng.uniform(0, 1.5, (2, 30)), rng.normal(size=(2, 30)), np.ones((2, 30))).write(tmp_path / "sky.csv")
    assert run(house, "-m", "vsh", "count", "sky.csv", folder=tmp_path).startswith(COUNTED)
    assert '"sources"' in run(house, "-m", "vsh", "count", str(tmp_path / "sky.csv"), "--json")
    run(house, "-m", "vsh", "count", str(tmp_path / "sky.csv"), "--output", str(tmp_path / "out"))
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written >= {"count.ecsv", "run.toml", "citation.bib", "report.txt"}
    assert "gaia" in run(house, "-m", "vsh", "count", "--citation").lower()
    assert "How many sources a catalogue has" in run(house, "-m", "vsh", "--help")
    assert run(house, "-m", "vsh", "count", "--help-all").count("vsh-count quasars.fits") == 3
