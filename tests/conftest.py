"""What the tests share: random fields, and real catalogues where they are at hand."""

import ast
import functools
import gc
import json
import os
import subprocess
import sys
from pathlib import Path

# Tests run side by side, and start commands: threads of theirs would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
# No test opens a window.
os.environ.setdefault("MPLBACKEND", "agg")

import numpy as np
import pytest
from hypothesis import settings
from threadpoolctl import threadpool_limits

import sim
from vsh import Field

# The same examples every time; a slow machine is no failure.
settings.register_profile("project", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("project")
threadpool_limits(1, "blas")


def pytest_sessionstart(session):
    """Reports are wrapped at the width of the terminal: what tests look for stands in one line."""
    if reporter := session.config.pluginmanager.get_plugin("terminalreporter"):
        reporter._tw.fullwidth = reporter._tw.fullwidth  # pytest's own stays
    os.environ["COLUMNS"] = "1000"


def pytest_collection_finish(session):
    """What is loaded by now stays: a search for garbage in it, again and again, takes a part of every test."""
    gc.freeze()
    gc.set_threshold(20_000, 20, 50)


def pytest_addoption(parser):
    parser.addoption(
        "--agreement", metavar="FILE", help="write how well every comparison agrees, as JSON (docs/make_validation.py)"
    )


@pytest.fixture(autouse=True)
def record_agreement(request, monkeypatch):
    """With --agreement: the largest difference that each test's `assert_allclose` saw."""
    path = request.config.getoption("--agreement")
    if path is None:
        yield
        return
    original, seen = np.testing.assert_allclose, []

    def watched(actual, desired, *args, **options):
        original(actual, desired, *args, **options)
        difference = np.abs(np.asarray(actual) - np.asarray(desired)).max()
        scale = np.abs(np.asarray(desired)).max()
        seen.append((float(difference), float(difference / scale) if scale else 0.0))

    monkeypatch.setattr(np.testing, "assert_allclose", watched)
    yield
    largest = [max(column) for column in zip(*seen, strict=True)] if seen else [None, None]
    module = request.module
    row = {
        "file": Path(module.__file__).name, "truth": module.__doc__.strip().splitlines()[0], "test": request.node.name,
        "comparisons": len(seen), "absolute": largest[0], "relative": largest[1],
    }  # fmt: skip
    with open(path, "a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


@pytest.fixture(autouse=True)
def no_figures_stay_open():
    """Tests come in any order: what one leaves open is another's warning."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


ROOT = Path(__file__).parents[1]
#: Tests of signals, links, permissions and shells.
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="Windows has no such signals, links or shells")


#: Marks of a study of coverage on many simulated skies: not among the tests that `make test-slow` runs.
STUDY = (pytest.mark.slow, pytest.mark.study)


def few_or_many(few, many, name="n_skies"):
    """A test on so few simulated skies each time, and on many among the studies; its bounds follow the number."""
    return pytest.mark.parametrize(name, [few, pytest.param(many, marks=STUDY)])


#: Real catalogues, which are not part of the project.
DATA = Path(os.environ.get("VSH_TEST_DATA", ROOT.parent / "shared" / "data"))


def real_catalogue(name):
    """The path of a real catalogue; skips the test where it is not at hand."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the real catalogue {name} is not at hand (name its folder in VSH_TEST_DATA)")
    return path


def run_python(*words, folder=ROOT, status=0, environment=(), **options):
    """Run Python with these words in a process of its own that finds the packages; how it ended, and what it said.

    It has to end with this status, or with any for None. Variables of the environment that are None are taken away.
    """
    environment = os.environ | {"PYTHONPATH": str(ROOT), "PYTHONIOENCODING": "utf-8"} | dict(environment)
    environment = {name: value for name, value in environment.items() if value is not None}
    options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True, "encoding": "utf-8"} | options
    done = subprocess.run([sys.executable, *map(str, words)], cwd=folder, env=environment, check=False, **options)
    assert status in (None, done.returncode), (done.stderr or "")[-2000:]
    return done


def random_field(n, seed, rho=0.9, frame="icrs"):
    """Unrelated motions with unequal, correlated errors."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(0, 2, (2, n))
    return Field(lon, lat, sigma * rng.normal(size=(2, n)), sigma, rng.uniform(-rho, rho, n), frame=frame)


def triad(lon, lat):
    """Unit vectors east, north and outwards, written out once more: (3, 3) rows."""
    east = [-np.sin(lon), np.cos(lon), 0]
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    out = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return np.array([east, north, out])


def nonuniform(n=3000, seed=1, uniform_errors=False, frame="galactic"):
    """Quasars of the non-uniform list, with unequal errors unless `uniform_errors`."""
    quasars = sim.quasars(n, seed, "igql")
    rng = np.random.default_rng([seed, 7])  # a stream of its own: errors that do not depend on position
    sigma = np.full((2, n), 300.0) if uniform_errors else 10 ** rng.uniform(2, 3, (2, n))
    rho = np.zeros(n) if uniform_errors else rng.uniform(-0.8, 0.8, n)
    return Field(quasars.lon, quasars.lat, np.zeros((2, n)), sigma, rho).to_frame(frame)


@functools.cache
def parsed(path):
    """The tree of a file, which many tests look at."""
    return ast.parse(path.read_text(encoding="utf-8"))


def for_each(things, label=str):
    """A test of every thing in one: its failures are told together, each by the thing's label."""

    def decorate(check):
        @functools.wraps(check)
        def test():
            failures = []
            for thing in things:
                try:
                    check(thing)
                except AssertionError as error:
                    failures.append(f"{label(thing)}: {error or 'fails'}")
            assert not failures, "\n".join(failures)

        del test.__wrapped__  # of which pytest would take the arguments for fixtures
        return test

    return decorate
