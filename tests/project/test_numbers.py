"""Every number of every kind of result, and of every command, is what it was: `python tests/project/test_numbers.py` writes it anew.

Whether a number is right is said by the tests of its estimator; here a change that nobody meant is seen.
"""

import importlib
import json
import re
import tempfile
from contextlib import chdir, redirect_stdout
from enum import Enum
from io import StringIO
from pathlib import Path

import numpy as np
import pytest
from every_result import RESULTS, result_of

import sim
from vsh.io.astrometry import write_astrometry
from vsh.tools.parallel import without_progress_bars

KEPT = Path(__file__).with_name("numbers.json")
#: What rests on decisions of a random walk, which rounding changes.
WALKS = {"samples"}
LINK = "fit.commands.link"
#: The command and its words; what it reads is made by `write_inputs`.
COMMANDS = {
    "fit": "fit.commands.fit galaxies.fits --lmax 3 --where redshift<0.2",
    "fit by clipping": "fit.commands.fit galaxies.fits --lmax 2 --method clip=4 --frame galactic",
    "fit of classes": "fit.commands.fit galaxies.fits --lmax 3 --classes magnitude:19 --templates density --waves",
    "redshifts": "fit.commands.redshift galaxies.fits --velocity planck --bins 2 --flows no",
    "velocity": "fit.commands.redshift galaxies.fits --h0 67.4",
    "posterior": "fit.commands.redshift galaxies.fits --velocity planck --posterior --sampler grid --flows no",
    "correlations": "fit.commands.correlate galaxies.fits quasars.fits --lmax 2 --influence a_x --leakage 3",
    "pairs": "fit.commands.pairs quasars.fits --bins 6",
    "comparison": "fit.commands.compare quasars.fits again.fits --lmax 2 --floor",
    "chain": "fit.commands.compare quasars.fits again.fits third.fits --lmax 1",
    "link": f"{LINK} gaia.csv vlbi.csv",
    "link with a step": f"{LINK} gaia.csv vlbi.csv --steps 13 --no-robust",
    "forecast": "study.commands.forecast --survey mine=5000,3.0",
    "referee": "study.commands.referee quasars.fits",
    "waves": "study.commands.waves epochs.fits --frequencies 1,2 --skies 10",
}
#: Those that take seconds.
SLOW = {"waves", "referee", "forecast"}


def write_inputs():
    """The catalogues that the commands read, in this folder."""
    galaxies = sim.observe(sim.galaxies(500, 1), sim.secular_parallax((300, 0, 0)), rng=1, sigma=5.0)
    galaxies.write("galaxies.fits")
    sky = sim.quasars(400, 1)
    for name, seed in (("quasars", 2), ("again", 3), ("third", 4)):
        sim.observe(sky, sim.spin((1.0, 2.0, 3.0)), seed, sigma=50.0).write(f"{name}.fits")
    link = sim.link(1, 20)
    for name in ("gaia", "vlbi"):
        write_astrometry(link[link.catalogue == name], f"{name}.csv")
    sim.epochs(sim.quasars(30, 1), sim.spin((0, 0, 0)), 1, mission=sim.NominalScanningLaw(years=2.0)).write(
        "epochs.fits"
    )


def numbers_of(thing, depth=3):
    """All numbers of an object, by the names of its attributes; of a long array its sum and some further sums."""
    if isinstance(thing, bool | int | float | np.number | np.bool_):
        return float(thing)
    if (
        isinstance(thing, tuple | list)
        and thing
        and all(isinstance(each, int | float) or each is None for each in thing)
    ):
        thing = np.array(thing, float)
    if isinstance(thing, np.ndarray) and thing.dtype.kind in "biuf":
        flat = np.asarray(thing, float).ravel()
        if flat.size <= 8:
            return flat.tolist()
        flat = flat[np.isfinite(flat)]
        return [flat.size, *map(float, (np.abs(flat).sum(), flat @ flat))]
    if not depth or isinstance(thing, Enum):
        return None
    if isinstance(thing, dict):
        items = thing.items()
    elif isinstance(thing, tuple | list):
        items = enumerate(thing)
    elif type(thing).__module__.partition(".")[0] in ("vsh", "fit", "sim", "study"):
        names = [name for name in dir(type(thing)) if not name.startswith("_")] + list(getattr(thing, "__dict__", ()))
        items = ((name, _attribute(thing, name)) for name in sorted({*names}) if not name.startswith("_"))
    else:
        return None
    found = {str(name): numbers_of(value, depth - 1) for name, value in items}
    return {name: value for name, value in found.items() if value is not None and value != {}}


def _attribute(thing, name):
    try:
        value = getattr(thing, name)
    except Exception:
        return None  # what this one has not
    return None if callable(value) and not isinstance(value, np.ndarray) else value


def run(command):
    """The numbers of a command's tables."""
    module, *words = command.split()
    with redirect_stdout(StringIO()) as printed:
        assert importlib.import_module(module).main([*words, "--json"]) == 0
    return numbers_of(json.loads(printed.getvalue()), 9)


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        write_inputs()
    return folder


def check(numbers, name):
    """Compare with what is kept, to what another machine's rounding may change."""
    kept, now = (dict(leaves(tree)) for tree in (json.loads(KEPT.read_text("utf-8"))[name], numbers))
    assert now.keys() == kept.keys()
    scale = {where: np.max(np.abs(values[np.isfinite(values)]), initial=0.0) for where, values in kept.items()}
    changed = {
        where: (kept[where], now[where])
        for where in kept
        if np.shape(now[where]) != np.shape(kept[where])
        or not np.allclose(now[where], kept[where], rtol=1e-5, atol=1e-7 * scale[where] + 1e-12, equal_nan=True)
    }
    assert not changed, (
        f"{name}: {len(changed)} of {len(kept)} changed: `python tests/project/test_numbers.py` if they should"
    )


def leaves(tree, where=""):
    """(name, array) of every number of nested dictionaries."""
    for name, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{where}.{name}")
        else:
            yield f"{where}.{name}", np.atleast_1d(np.array(value, float))


@pytest.mark.parametrize("name", sorted(RESULTS.keys() - WALKS))
def test_numbers_of_a_result(name):
    check(numbers_of(result_of(name)), name)


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in COMMANDS]
)
def test_numbers_of_a_command(name, inputs, monkeypatch):
    monkeypatch.chdir(inputs)
    check(run(COMMANDS[name]), f"command: {name}")


def write():
    """Keep the numbers of today."""
    kept = {name: numbers_of(result_of(name)) for name in sorted(RESULTS.keys() - WALKS)}
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        write_inputs()
        kept |= {f"command: {name}": run(command) for name, command in COMMANDS.items()}
    text = json.dumps(kept, indent=0)
    KEPT.write_text(re.sub(r"-?\d+\.\d+(e-?\d+)?", lambda number: f"{float(number[0]):.8g}", text) + "\n", "utf-8")


if __name__ == "__main__":
    with without_progress_bars():
        write()
