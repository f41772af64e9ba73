"""Promised functions called with what they cannot take: each call gives a result, or an error of ours that says why.

`python tests/fuzz_api.py 2000` makes so many calls and prints those that ended otherwise; it ends with status 1 if any
did, or took longer than ten seconds. The same seed gives the same calls. Classes are left out: results are made by the
functions that give them.
"""

import inspect
import os
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter

import numpy as np

import fit
import sim
import study
import vsh
from vsh import Field, VshError

#: A call that takes longer hangs. [s]
SECONDS = 10
#: They ask servers, draw figures, or run for long by design.
SKIPPED = ("archive", "plot", "main", "run", "figures", "read_field", "stream", "parts", "crf3", "crf4", "galaxies")


def functions():
    """The promised functions by their names."""
    found = {}

    def walk(module, depth=0):
        for name in getattr(module, "__all__", []):
            thing = getattr(module, name)
            if any(each in f"{module.__name__}.{name}" for each in SKIPPED):
                continue
            if inspect.ismodule(thing) and depth < 3:
                walk(thing, depth + 1)
            elif inspect.isfunction(thing):
                found.setdefault(id(thing), (f"{module.__name__}.{name}", thing))

    for module in (vsh, fit, sim, study):
        walk(module)
    return dict(sorted(found.values()))


def values(rng):
    """What may be given: sensible things, and odd ones."""

    def sky(n):
        lat = np.arcsin(rng.uniform(-1, 1, n))
        return Field(rng.uniform(0, 6.28, n), lat, rng.normal(size=(2, n)), np.ones((2, n)))

    solution = fit.fit_field(sky(60), 2)
    sensible = [sky(6), solution, 2, vsh.Modes(1), "q.fits"]
    odd = [
        None, 0, -1, 3, 1.5, np.nan, np.inf, 1e308, 2**70, "", "x", b"x", [], {}, (), np.array([]), np.zeros((2, 0)),
        np.zeros(3), np.full((2, 5), np.nan), np.array(["a"]), np.array([object()]), np.ma.masked_all(4), sky(5), sky(1),
        [sky(4), sky(4)], object(), print, True, 1j, np.zeros((3, 3)), np.datetime64("NaT"), range(3), vsh.Modes(2),
        np.random.default_rng(1),
    ]  # fmt: skip
    return sensible, odd


def call(function, rng, sensible, odd):
    """Call a function with random arguments; returns what was wrong with how it ended, or None, and the arguments."""
    named = {}
    for each in inspect.signature(function).parameters.values():
        needed = each.default is each.empty
        if each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY) and (needed or rng.random() < 0.25):
            pool = odd if rng.random() < 0.5 else sensible
            named[each.name] = pool[rng.integers(len(pool))]
    shown = ", ".join(f"{name}={value!r}"[:50].replace("\n", " ") for name, value in named.items())
    signal.setitimer(signal.ITIMER_REAL, SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            function(**named)
    except VshError:
        return None, shown
    except TimeoutError:
        return "hangs", shown
    except Exception as error:
        place = traceback.extract_tb(error.__traceback__)[-1]
        return f"{type(error).__name__}: {str(error)[:80]} ({os.path.basename(place.filename)}:{place.lineno})", shown
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return None, shown


def _alarm(*_):
    raise TimeoutError


def main(number=2000, seed=1):
    signal.signal(signal.SIGALRM, _alarm)
    rng = np.random.default_rng(seed)
    known = functions()
    sensible, odd = values(rng)
    names, faults, calls = list(known), {}, 0
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        while calls < number:
            for name in rng.permutation(names):
                calls += 1
                wrong, shown = call(known[name], rng, sensible, odd)
                if wrong:
                    faults.setdefault((name, wrong), shown)
                if calls == number:
                    break
        os.chdir("/")
    for (name, wrong), shown in sorted(faults.items()):
        print(f"{name}({shown})\n    {wrong}")
    print(
        f"{calls} calls of {len(names)} functions: {len(faults)} faults in {len(Counter(n for n, _ in faults))} of them"
    )
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
