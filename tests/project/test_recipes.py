"""The recipes of the documentation, run as they stand."""

import os
import re
import shlex
import subprocess
import sys

import numpy as np
import pytest
from conftest import POSIX, ROOT
from tap_server import serving

from vsh import Field
from vsh.commands import COMMANDS

PAGES = [ROOT / "docs" / name for name in ("large_catalogues.md", "archive.md", "samplers.md")]
RECIPES = {
    found.group(1): found.group(0)
    for page in PAGES
    for found in re.finditer(r"# recipe: (\w+)\n.*?(?=\n```)", page.read_text(encoding="utf-8"), re.DOTALL)
}
NEEDS = {"dask": "dask.dataframe", "cluster": "distributed", "lsdb": "lsdb"}
SAMPLERS = ("dynesty", "numpyro", "cobaya", "sbi")


def field(seed):
    rng = np.random.default_rng(seed)
    n = 400
    return Field(
        rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n)), rng.normal(size=(2, n)) * 100, np.full((2, n), 100.0),
        magnitude=rng.uniform(15, 21, n), name=np.arange(n) + n * seed,
    )  # fmt: skip


@pytest.fixture(scope="module")
def home(tmp_path_factory):
    home = tmp_path_factory.mktemp("recipes")
    (home / "folder").mkdir()
    for i in range(3):
        field(i).write(home / "folder" / f"{i}.parquet")
    field(9).write(home / "whole.fits")
    return home


def test_no_recipe_is_forgotten():
    assert set(RECIPES) == {
        "folder",
        "choose",
        "dask",
        "cluster",
        "lsdb",
        "archive",
        "epochs",
        "likelihood",
        "dynesty",
        "numpyro",
        "cobaya",
        "sbi",
    }


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.slow] * (name in (*NEEDS, "epochs")))
        for name in sorted(set(RECIPES) - {*SAMPLERS})
    ],
)
def test_recipe(name, home):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], exc_type=ImportError)
    text = RECIPES[name]
    if name == "lsdb":
        import lsdb
        import pandas

        frame = pandas.concat(pandas.read_parquet(path) for path in sorted((home / "folder").iterdir()))
        lsdb.from_dataframe(frame, catalog_name="sky", lowest_order=0).write_catalog(home / "hats", overwrite=True)
    if name == "archive":
        with serving((home / "whole.fits").read_bytes()) as (url, _):
            run(text.replace('"crf3.fits")', f'"crf3.fits", "{url}")'), home)
    else:
        run(text, home)


def run(text, home):
    (home / "recipe.py").write_text(text, encoding="utf-8")
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "recipe.py"],
        cwd=home,
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("name", SAMPLERS)
def test_sampler_takes_a_result(name, tmp_path):
    """Mean and width of the angular speed are those of the posterior on a grid; simulated skies have no floor."""
    pytest.importorskip(name)
    (tmp_path / "likelihood.py").write_text(RECIPES["likelihood"], encoding="utf-8")
    printed = run(RECIPES[name], tmp_path)
    mean, sigma = (float(word) for word in printed.split("omega")[-1].split())
    code = """
from likelihood import log_likelihood, np
omega, r0 = np.linspace(20, 40, 801), 8.178 + 0.026 * np.linspace(-5, 5, 41)
weight = np.array([[log_likelihood((a, b)) - ((b - 8.178) / 0.026) ** 2 / 2 for b in r0] for a in omega])
weight = np.exp(weight - weight.max()).sum(1)
mean = np.average(omega, weights=weight)
print(mean, np.sqrt(np.average((omega - mean) ** 2, weights=weight)))
"""
    if name == "sbi":
        text = RECIPES["likelihood"].replace("fit.recommended(field)", "fit.fit_field(field, 2)")
        (tmp_path / "likelihood.py").write_text(text, encoding="utf-8")
    expected, width = map(float, run(code, tmp_path).split())
    # A network that has seen ten thousand skies is right to a third of an error.
    accuracy = 0.4 if name == "sbi" else 0.15
    assert mean == pytest.approx(expected, abs=accuracy * width)
    assert sigma == pytest.approx(width, rel=0.15)


@POSIX
@pytest.mark.slow
def test_job_for_one_node_runs(home, tmp_path):
    """SLURM's lines are comments to bash."""
    page = PAGES[0].read_text(encoding="utf-8")
    one, several = re.findall(r"```bash\n(.*?)```", page, re.DOTALL)
    for script in (one, several):
        assert subprocess.run(["bash", "-n"], input=script, text=True, check=False).returncode == 0
    binary = tmp_path / "bin" / "vsh-fit"
    binary.parent.mkdir()
    binary.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m vsh fit "$@"\n')
    binary.chmod(0o755)
    environment = os.environ | {
        "PATH": f"{binary.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "CATALOGUE": str(home / "folder"),
        "RESULTS": str(tmp_path / "results"),
    }  # fmt: skip
    script = one.replace("--lmax 10", "--lmax 2")
    done = subprocess.run(
        ["bash"], input=script, text=True, env=environment, capture_output=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert (tmp_path / "results" / "report.txt").exists()


#: The day of DR4, line by line.
DAY = (ROOT / "docs" / "dr4.md").read_text(encoding="utf-8")
LINES = [line.strip() for line in DAY.splitlines() if re.match(r" {7,}vsh-", line)]


def run_line(line, *more):
    from importlib import import_module

    program, *words = shlex.split(line)
    module = COMMANDS[program.removeprefix("vsh-")].module
    return import_module(module).main([*words, *more])


def test_page_has_eight_steps():
    assert len(re.findall(r"^\d+\. ", DAY, re.MULTILINE)) == 8
    assert len(LINES) == 13


@pytest.mark.slow
def test_day(tmp_path, monkeypatch, capsys):
    """Every line of the page on tables of 8000 sources, but the archive's, which is not asked."""
    monkeypatch.chdir(tmp_path)
    for line in LINES:
        if line.startswith("vsh-archive"):
            continue
        more = (
            ["--number", "8000"] if line.startswith("vsh-sim") else ["--format", "none"] if "--output" in line else []
        )
        assert run_line(line, *more) == 0, line
    out = capsys.readouterr().out
    assert out.count("Does the dipole change with class?") == 3
    assert "Does the dipole change with redshift?" in out
    assert "Motions along each template, by degree (rms)" in out
    assert {"answer", "magnitude", "colour", "halves", "bins", "templates", "against3", "referee"} <= {
        each.name for each in tmp_path.iterdir()
    }


def test_cheatsheet_runs(tmp_path, monkeypatch):
    """All twenty lines, one after the other."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")
    page = (ROOT / "docs" / "cheatsheet.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block, names)
    numbers = [int(k) for k in re.findall(r"# (\d+): ", page)]
    assert numbers == list(range(1, 21))
    a, truth = names["a"], (0.0, -40.0, -20.0)
    assert np.abs(a.value - truth).max() < 4 * a.sigma.max()
    assert (tmp_path / "page.html").stat().st_size > 100_000
