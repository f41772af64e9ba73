"""CPU time of what users wait for, in ratios to an anchor in the same run; beside another checkout where one is named.

    python benchmarks/cpu.py [--only WORDS] [OTHER CHECKOUT]

Every job runs in a process of its own with one thread, turn by turn with the other checkout's, and a command with the
anchor as well; the least of four is taken. Seconds are of user and system together: they do not depend on what else the
machine does, nearly. Byte code is kept, as where it is installed.
"""

import argparse
import os
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parents[1]
RUNS = 4

ANCHOR = "import numpy, scipy.linalg, astropy.io.fits"

#: What is run once, in the folder in which all else runs.
SETUP = """
import numpy as np, pyarrow as pa, pyarrow.parquet as pq, os, sim
from vsh.io.catalogue import read_field
rng = np.random.default_rng(1)
def table(n):
    lat = np.degrees(np.arcsin(rng.uniform(-1, 1, n)))
    columns = [rng.uniform(0, 360, n), lat, *rng.normal(0, 0.3, (2, n)), *np.full((2, n), 0.3), rng.uniform(-0.5, 0.5, n)]
    names = ["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr"]
    return pa.table(dict(zip(names, columns)))
for folder, parts, rows in (("small", 1000, 1000), ("big", 8, 250_000)):
    os.makedirs(folder)
    for i in range(parts):
        pq.write_table(table(rows), f"{folder}/{i:04d}.parquet")
sim.crf3(1, n_five=699, n_six=1).write("700.fits")
sim.crf3(1).write("crf3.fits")
truth = sim.secular_parallax((300.0, 0, 0))
sim.observe(sim.galaxies(300, rng=1), truth, 2, sigma=20.0).write("galaxies.fits")
"""

#: Commands on their smallest real jobs.
COMMANDS = {
    "fit, 700 rows": "fit 700.fits",
    "correlate": "correlate 700.fits",
    "compare": "compare 700.fits 700.fits",
    "redshift": "redshift galaxies.fits --h0 70 --redshift-frame true",
    "pairs": "pairs 700.fits",
    "sim --errors expected, 300": "sim quasars --number 300 --errors expected --output OUT.fits --overwrite",
    "sim, 300": "sim quasars --number 300 --output OUT.fits --overwrite",
    "forecast": "forecast",
    "archive --show": "archive gaia-crf3 --show",
    "fit, 1.6 million, degree 10": "fit crf3.fits --lmax 10",
}

#: Jobs that tell their own CPU seconds: (what is counted, by what it is divided, code). The last line's value is run.
COMMON = """
import time, numpy as np, fit, sim
from vsh import Field, Modes
def cpu(job, runs=3):
    times = []
    for _ in range(runs):
        begin = time.process_time(); job(); times.append(time.process_time() - begin)
    return min(times)
def sky(n, seed=1):
    r = np.random.default_rng(seed)
    s = np.exp(r.normal(np.log(300), 0.7, (2, n)))
    lat = np.arcsin(r.uniform(-1, 1, n))
    return Field(r.uniform(0, 2 * np.pi, n), lat, r.normal(size=(2, n)) * s, s, r.uniform(-0.7, 0.7, n))
def galaxies(n, **more):
    from dataclasses import replace
    field = sim.observe(sim.galaxies(n, rng=1), sim.secular_parallax((300.0, 0, 0)), 2, sigma=20.0)
    return replace(field, redshift_frame="cmb", **{k: v(field) for k, v in more.items()})
"""
FIT = """
field = sky(10**6)
print(cpu(lambda: fit.normal_equations(field, {lmax}, threads=1)))
"""
NUFFT = """
import ducc0
field = sky(10**6); L = {lmax}
loc = np.stack([np.pi / 2 - field.lat, field.lon], axis=1)
w = field.weights
def job():
    ducc0.sht.adjoint_synthesis_general(map=(w[:1] + w[1:2]), spin=0, lmax=2 * L, loc=loc, epsilon=5e-13, nthreads=1)
    ducc0.sht.adjoint_synthesis_general(map=w[1:3], spin=2, lmax=max(2 * L, 2), loc=loc, epsilon=5e-13, nthreads=1)
    ducc0.sht.adjoint_synthesis_general(map=field.motion, spin=1, lmax=L, loc=loc, epsilon=5e-13, nthreads=1)
print(cpu(job))
"""
PARTS = """
try: from vsh.io.catalogue import parts
except ImportError: from vsh.catalogue import parts
print(cpu(lambda: fit.normal_equations(parts({folder!r}), {lmax})))
"""
BARE = """
import glob, pyarrow.parquet as pq
names = ["ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "pmra_pmdec_corr"]
files = sorted(glob.glob({folder!r} + "/*"))
print(cpu(lambda: [[c.to_numpy() for c in pq.read_table(f, columns=names, use_threads=False).itercolumns()] for f in files]))
"""
VELOCITY = """
from fit.secular_parallax import observer_velocity
field = galaxies(200_000{more})
print(cpu(lambda: observer_velocity(field, 70.0, {options}), 2))
"""
POSTERIOR = """
from fit.posterior import sample
field = sim.observe(sim.galaxies(3000, rng=1), sim.secular_parallax((300.0, 0, 0)), rng=2, sigma=3.0)
about = dict(redshift_frame="true", flows=None, rng=1, progress=False{more})
sample(field, n_samples=2000, **({{"max_samples": 2000}} | about))
begin = time.process_time(); chain = sample(field, n_samples=200_000, **about); spent = time.process_time() - begin
size = chain.effective_size if hasattr(chain, "effective_size") else None
print(spent / min(size.values()))
"""
TRANSIT = """
from sim.scanning import NominalScanningLaw
law = NominalScanningLaw(); lon, lat = sim.uniform_sky(1000, 1)
n = len(law.transits_of_block(lon, lat{more}))
print(cpu(lambda: law.transits_of_block(lon, lat{more}), 7) / n)
"""
JOBS = {
    **{
        f"fit, 10⁶ sources, degree {lmax}": (1e6, "ns", FIT.format(lmax=lmax))
        for lmax in (1, 2, 3, 4, 10)
    },
    **{f"raw ducc0, 10⁶ sources, degree {lmax}": (1e6, "ns", NUFFT.format(lmax=lmax)) for lmax in (1, 3, 10)},
    "1000 parts of 1000, bare Arrow": (1e6, "ns", BARE.format(folder="small")),
    "1000 parts of 1000, degree 1": (1e6, "ns", PARTS.format(folder="small", lmax=1)),
    "1000 parts of 1000, degree 10": (1e6, "ns", PARTS.format(folder="small", lmax=10)),
    "8 parts of 250 000, bare Arrow": (2e6, "ns", BARE.format(folder="big")),
    "8 parts of 250 000, degree 1": (2e6, "ns", PARTS.format(folder="big", lmax=1)),
    "8 parts of 250 000, degree 10": (2e6, "ns", PARTS.format(folder="big", lmax=10)),
    "a galaxy: velocity, redshifts as seen": (2e5, "µs", VELOCITY.format(more="", options="flows=None")),
    "a galaxy: the same, redshift errors one by one": (
        2e5, "µs", VELOCITY.format(more=", redshift_error=lambda f: 1e-3 * (1 + f.redshift)", options="flows=None")),
    "a galaxy: the same, 250 modes of a flow": (2e5, "µs", VELOCITY.format(more="", options="n_modes=250")),
    "an effective sample, emcee": (1.0, "µs", POSTERIOR.format(more="")),
    "an effective sample, on a grid": (1.0, "µs", POSTERIOR.format(more=', method="grid"')),
    "a transit": (1.0, "ns", TRANSIT.format(more="")),
    "a transit, compiled": (1.0, "ns", TRANSIT.format(more=", compiled=True")),
    "floor of degrees 2 to 30": (1.0, "s", """
from fit.background import floor
normal = fit.normal_equations(sky(10**5), 30)
print(cpu(lambda: floor(normal), 1))
"""),
    "100 draws of a bootstrap, 10⁴ sources, degree 3": (1.0, "s", """
field = sky(10**4); print(cpu(lambda: fit.resample.bootstrap(field, 3, 100, 1, progress=False)))
"""),
    "100 draws of a bootstrap, 10⁵ sources, degree 3": (1.0, "s", """
field = sky(10**5); print(cpu(lambda: fit.resample.bootstrap(field, 3, 100, 1, progress=False)))
"""),
}  # fmt: skip
SIZES = {"ns": 1e9, "µs": 1e6, "s": 1.0}


def run(words, checkout, folder):
    """Run a process on a checkout; its CPU seconds, and what it prints."""
    alone = {"PYTHONPATH": str(checkout), "OMP_NUM_THREADS": "1", "MPLBACKEND": "agg", "PYTHONWARNINGS": "ignore"}
    alone |= {"PYTHONDONTWRITEBYTECODE": ""}
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run([sys.executable, *words], cwd=folder, env=os.environ | alone, capture_output=True, text=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return (spent, done.stdout) if done.returncode == 0 else (float("nan"), done.stderr[-300:])


def beside(jobs, folder):
    """The least of each job's four runs, turn by turn: jobs are words, a checkout, and whether it tells its own."""
    times = [[] for _ in jobs]
    for _ in range(RUNS):
        for row, (words, checkout, own) in zip(times, jobs, strict=True):
            spent, printed = run(words, checkout, folder)
            row.append(float(printed.split()[-1]) if own and spent == spent else spent)
    return [min(row) for row in times]


def main():
    """Print a line for each job: this checkout, the other, their ratio."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("other", nargs="?", help="another checkout")
    parser.add_argument("--only", default="", help="jobs with these words in their names")
    options = parser.parse_args()
    checkouts = [HERE] + ([Path(options.other).resolve()] if options.other else [])
    with tempfile.TemporaryDirectory() as folder:
        run(["-c", SETUP], HERE, folder)
        print(f"Commands are times {ANCHOR!r}")
        for name, command in COMMANDS.items():
            if options.only in name:
                words = [command.replace("OUT", f"out{i}").split() for i in range(len(checkouts))]
                jobs = [(["-m", "vsh", *mine], each, False) for mine, each in zip(words, checkouts, strict=True)]
                anchor, *times = beside([(["-c", ANCHOR], HERE, False), *jobs], folder)
                report(name, [each / anchor for each in times], "×")
        for name, (number, unit, code) in JOBS.items():
            if options.only in name:
                times = beside([(["-c", COMMON + code], each, True) for each in checkouts], folder)
                report(name, [each / number * SIZES[unit] for each in times], unit)


def report(name, times, unit):
    """One line."""
    ratio = f"   was {times[1]:10.3g} {unit}   {times[1] / times[0]:6.2f} times" if len(times) > 1 else ""
    print(f"{name:50}{times[0]:10.3g} {unit}{ratio}", flush=True)


if __name__ == "__main__":
    main()
