"""The recipes of the documentation, run as they stand."""

import contextlib
import os
import re
import shlex
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from astropy import units
from astropy.table import Table
from conftest import DATA, POSIX, ROOT, real_catalogue, run_python
from tap_server import serving

from vsh import Field
from vsh.__main__ import import_command_module
from vsh.commands import COMMANDS

PAGES = [ROOT / "docs" / name for name in ("large_catalogues.md", "archive.md", "further.md")]
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
def tables(tmp_path_factory):
    home = tmp_path_factory.mktemp("recipes")
    (home / "folder").mkdir()
    for i in range(3):
        field(i).write(home / "folder" / f"{i}.parquet")
    field(9).write(home / "whole.fits")
    return home


def test_no_recipe_is_forgotten():
    assert set(RECIPES) == {"folder", "choose", "archive", "epochs", "likelihood", *NEEDS, *SAMPLERS}


@pytest.mark.parametrize("name", [
    pytest.param(name, marks=[pytest.mark.slow] * (name in (*NEEDS, "epochs")))
    for name in sorted(set(RECIPES) - {*SAMPLERS})
])  # fmt: skip
def test_recipe(name, tables):
    if name in NEEDS:
        pytest.importorskip(NEEDS[name], exc_type=ImportError)
    text = RECIPES[name]
    if name == "lsdb":
        import lsdb
        import pandas

        frame = pandas.concat(pandas.read_parquet(path) for path in sorted((tables / "folder").iterdir()))
        lsdb.from_dataframe(frame, catalog_name="sky", lowest_order=0).write_catalog(tables / "hats", overwrite=True)
    if name == "archive":
        with serving((tables / "whole.fits").read_bytes()) as (url, _):
            run(text.replace('"crf3.fits")', f'"crf3.fits", "{url}")'), tables)
    else:
        run(text, tables)


def run(text, home):
    (home / "recipe.py").write_text(text, encoding="utf-8")
    return run_python("recipe.py", folder=home, timeout=120).stdout


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
def test_job_for_one_node_runs(tables, tmp_path):
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
        "PATH": f"{binary.parent}:{os.environ['PATH']}", "PYTHONPATH": str(ROOT), "CATALOGUE": str(tables / "folder"),
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
        more = ["--format", "none"] if "--output" in line else []
        more = ["--number", "8000"] if line.startswith("vsh-sim") else more
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
    page = (ROOT / "docs" / "cheatsheet.md").read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page, re.DOTALL):
        exec(block, names)
    numbers = [int(k) for k in re.findall(r"# (\d+): ", page)]
    assert numbers == list(range(1, 21))
    a, truth = names["a"], (0.0, -40.0, -20.0)
    assert np.abs(a.value - truth).max() < 4 * a.sigma.max()
    assert (tmp_path / "page.html").stat().st_size > 100_000


#: What a page may suppose: files of the names that the documentation uses, each made as its user would have it.
FILES = (
    "sim quasars --number 3000 --sky igql --seed 1 --output catalogue.fits",
    "sim quasars --number 3000 --sky gums --seed 2 --output gums.fits",
    "sim crf3 --number 5000 --seed 1 --output crf3.fits",
    "sim crf4 --number 5000 --seed 1 --output crf4.fits",
    "sim galaxies --number 3000 --no-transits --release DR5 --velocity planck --seed 1 --output galaxies.fits",
    "sim link --seed 1 --output both.csv",
    "sim epochs --number 30 --wave 2,900,0,60,-20 --seed 1 --output epochs.fits",
)
#: Lines that ask a server, a cluster, a shell or another program: the tests of these have servers of their own.
ELSEWHERE = re.compile(r"://|vsh-archive|neighbours|[|$]")
GUIDE = [*sorted((ROOT / "docs").glob("*.md")), *sorted((ROOT / "docs" / "commands").glob("*.md")), ROOT / "README.md"]
#: `extending.md` has a test of its own, and so have `cheatsheet.md` and the day of DR4.
GUIDE = [
    page for page in GUIDE if page.name not in ("extending.md", "cheatsheet.md", "dr4.md", "changelog.md", "vsh-sim.md")
]


def code_of(page):
    """Python's blocks and the lines of commands, in the order of the page; recipes are run above."""
    text = re.sub(r"```\{sample\}.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    pattern = r"^```python\n(.*?)^```|(?<=\n\n)((?: {4}[^\n]*\n|\n(?= {4}))+)|^```(?:text|console)\n(.*?)^```"
    for found in re.finditer(pattern, text, re.MULTILINE | re.DOTALL):
        python, indented, shown = found.groups()
        block = textwrap.dedent(python or indented or shown)
        if python or re.match(r"(import|from) ", block):
            if not block.startswith("# recipe"):
                yield "python", block
        else:
            for line in block.splitlines():
                if re.match(r"(vsh-\w+|python -m vsh) ", line) and not ELSEWHERE.search(line):
                    yield "shell", line.partition("   #")[0].replace("python -m vsh ", "vsh-")


def write_others(field, rng):
    """Tables with names and units of their own, a list, a map, and stars with distances."""
    Path("defining.txt").write_text("\n".join(map(str, field.name[:600])) + "\n")
    galactic = field.to_frame("galactic")
    for path, sky, names in (
        ("table.fits", galactic, "l b pml pmb e_pml e_pmb"),
        ("table.csv", field, "ra dec mu_ra mu_de e_mu_ra e_mu_de"),
        ("motions.csv", field, "ra dec pmra pmdec pmra_error pmdec_error"),
    ):
        columns = [np.degrees(sky.lon), np.degrees(sky.lat), *sky.motion, *sky.sigma]
        if path == "table.fits":
            columns[2:] = [each / 1000 for each in columns[2:]]  # without a unit, motions are in mas/yr
        table = Table(columns, names=names.split())
        if path == "motions.csv":
            table["zsp"] = rng.uniform(0.5, 2, len(sky))
            table["phot_g_mean_mag"] = sky.magnitude
        table.write(path)
    n, d = 400, rng.uniform(2, 20, 400)
    far = {"ra": rng.uniform(0, 360, n), "dec": np.degrees(np.arcsin(rng.uniform(-1, 1, n))), "pmra": rng.normal(0, 5, n),
           "pmdec": rng.normal(0, 5, n), "pmra_error": np.full(n, 0.1), "pmdec_error": np.full(n, 0.1)}  # fmt: skip
    Table({**far, "R_sun": d, "e_R_sun": 0.1 * d}).write("clusters.fits")
    Table({**far, "parallax": 1 / d, "parallax_error": np.full(n, 0.02)}).write("stars.fits")
    healpy = pytest.importorskip("healpy")
    healpy.write_map("map.fits", rng.normal(size=12 * 16**2), dtype=float)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    files = tmp_path_factory.mktemp("files")
    with contextlib.chdir(files):
        for line in FILES:
            assert run_line(f"vsh-{line}") == 0, line
        catalogue = Field.read("catalogue.fits")
        for name in ("quasars.fits", "igql.fits", "icrf.fits"):
            catalogue.write(name)
        gaia = Table.read("catalogue.fits")
        gaia["ra_error"] = gaia["dec_error"] = np.full(len(gaia), 0.1) << units.mas
        gaia.write("gaia.fits")
        for name, rows in (("icrf3.txt", slice(0, 400)), ("icrf2.txt", slice(100, 500))):
            few, rng = catalogue[rows], np.random.default_rng(rows.start)
            places = np.degrees([few.lon, few.lat]) + rng.normal(0, 0.1 / 3.6e6, (2, len(few)))  # errors of 0.1 mas
            lines = [f"{k} {a:.12f} {d:.12f} 0.1 0.1" for k, a, d in zip(few.name, *places, strict=True)]
            Path(name).write_text("\n".join(["source_id ra dec ra_error dec_error", *lines]) + "\n")
        Path("folder").mkdir()
        for i in range(3):
            catalogue[i * 1000 : (i + 1) * 1000].write(f"folder/{i}.parquet")
        write_others(catalogue, np.random.default_rng(1))
        Path("epochs").mkdir()
        shutil.copy("epochs.fits", "epochs")
        both = Table.read("both.csv")
        for name in ("gaia", "vlbi"):
            both[both["catalogue"] == name].write(f"{name}.csv")
    return files


@pytest.fixture
def home(files, tmp_path, monkeypatch):
    """A folder of its own that has the files the pages name; real ones where they are at hand."""
    shutil.copytree(files, tmp_path / "home")
    for name in ("icrf3sx.txt", "icrf2-all.txt"):
        if (DATA / name).exists():
            shutil.copy(DATA / name, tmp_path / "home")
    monkeypatch.chdir(tmp_path / "home")


def printed(kind):
    return {page: [code for each, code in code_of(page) if each == kind] for page in GUIDE}


def skip_what_needs(code):
    for name in ("icrf3sx.txt", "icrf2-all.txt"):
        if name in code:
            real_catalogue(name)


@pytest.mark.slow
@pytest.mark.parametrize(
    "page", [page for page, blocks in printed("python").items() if blocks], ids=lambda page: page.stem
)
def test_python_of_a_page_runs(page, home):
    """One block after the other, with nothing given but the files."""
    names: dict[str, object] = {}
    for code in printed("python")[page]:
        skip_what_needs(code)
        few = code.replace("range(200)", "range(10)")  # skies that are simulated
        exec(compile(few, page.name, "exec"), names)


#: What the help of a command shows is run by tests/vsh/commands/test_help.py.
SHOWN = {line.strip() for name in COMMANDS for line in import_command_module(name).make_parser().epilog.splitlines()}


@pytest.mark.slow
@pytest.mark.parametrize(
    "line", sorted({line.strip() for lines in printed("shell").values() for line in lines} - SHOWN)
)
def test_printed_command_runs(line, home):
    skip_what_needs(line)
    if "results/run.toml" in line:
        assert run_line("vsh-fit catalogue.fits --output results") == 0
    more = ["--overwrite"] if "--output" in line else []
    more += ["--number", "5000"] if re.match("vsh-sim crf", line) else []
    assert run_line(line, *more) == 0
