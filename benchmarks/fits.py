"""One catalogue through four codes, in one run: times, ratios, peak memory.

    python benchmarks/fits.py [SOURCES [DEGREE …]]
    python benchmarks/fits.py small
    python benchmarks/fits.py recommended

1.2 million sources with full correlations on 80 % of the sky, through this project,
vsh-tools 1.0.0 (its chunked method; degree 20 at a fifth of the sources, scaled linearly),
a plain NumPy design matrix in blocks, and the three raw ducc0 adjoint transforms that the
weights and the motions would need on the sphere, without anything made of them. Each runs in
processes of its own, three where it is short, which say their peak memory beyond making the
catalogue; the codes of a degree follow one another at once.

`small` has 1000 to 100 000 sources at degrees 1 and 3 beside vsh-tools and SciPy's lstsq with its design matrix;
`recommended` the fit to quote, to degree 5, in units of `fit_field`. CPU seconds of one process, the least of several.
"""

import json
import resource
import subprocess
import sys
import time

import numpy as np
from catalogue import synthetic

DEGREES = (1, 3, 10, 20, 30)


def this_project(field, lmax):
    """The whole fit: normal equations, solution, covariance and χ²."""
    import fit

    return fit.fit_field(field, lmax).chi2


def recommended(field, lmax):
    """The fit to quote: robust, with the systematic floor, to at least degree 3 to have one."""
    import fit

    return fit.recommended(field, lmax).solution.chi2


def vsh_tools_1_0_0(field, lmax):
    """The same by vsh-tools, in blocks, without keeping residuals."""
    import vsh_tools

    s1, s2 = field.sigma
    return vsh_tools.fit_vsh(
        field.lon, field.lat, *field.motion, lmax, method="chunked", sigma_ra=s1, sigma_dec=s2, rho=field.rho,
        store_residuals=False,
    ).chi2  # fmt: skip


def plain_numpy(field, lmax, block=10_000):
    """A whitened design matrix in blocks, and NumPy's solver."""
    from vsh import Modes
    from vsh.basis import harmonics

    modes = Modes(lmax)
    matrix, rhs, chi2 = 0, 0, 0
    for start in range(0, len(field), block):
        part = field[start : start + block]
        design = harmonics(part.lon, part.lat, modes)
        (s1, s2), root = part.sigma, np.sqrt(1 - part.rho**2)
        east = design[:, 0] / s1
        north = (design[:, 1] / s2 - part.rho * east) / root
        a, y = np.concatenate([east, north], axis=1), part.whitened.ravel()
        matrix, rhs, chi2 = matrix + a @ a.T, rhs + a @ y, chi2 + y @ y
    values = np.linalg.solve(matrix, rhs)
    np.linalg.inv(matrix)
    return chi2 - values @ rhs


def raw_transforms(field, lmax):
    """Spin 0 and spin 2 adjoints to 2L and a spin 1 adjoint to L, by ducc0."""
    import ducc0

    from vsh.tools.parallel import thread_count

    a, b, c = field.weights
    loc = np.stack([np.pi / 2 - field.lat, field.lon], axis=1)
    maps = {0: np.array([(a + b) / 2]), 2: np.stack([(b - a) / 2, -c]), 1: np.array(field.motion)}
    start = time.perf_counter()
    for spin, values in maps.items():
        ducc0.sht.adjoint_synthesis_general(
            map=values, spin=spin, lmax=lmax if spin == 1 else 2 * lmax, loc=loc, epsilon=5e-13, nthreads=thread_count()
        )
    return time.perf_counter() - start


CODES = {code.__name__: code for code in (this_project, recommended, vsh_tools_1_0_0, plain_numpy, raw_transforms)}


def child(code, lmax, sources, runs):
    """Time one code in this process; the first run is not counted where it is short."""
    field = synthetic(sources)
    before = peak()
    times, spent = [], []
    for _ in range(runs):
        start, begin = time.perf_counter(), time.process_time()
        result = CODES[code](field, lmax)
        times.append(result if code == "raw_transforms" else time.perf_counter() - start)
        spent.append(time.process_time() - begin)
    # The first run of several opens libraries and fills caches.
    found = {"seconds": times[runs > 1 :], "cpu": spent[runs > 1 :], "peak": peak(), "before": before}
    print(json.dumps(found | {"result": result}))


def peak():
    """Peak memory so far, MiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def measure(code, lmax, sources, rounds=3):
    """Median time and least CPU time over processes, scaled to all sources; peak memory beyond the catalogue."""
    share, runs = 1, 4
    if code in ("vsh_tools_1_0_0", "plain_numpy") and lmax > 3:
        share, runs, rounds = (1 if lmax <= 10 else 5), 1, 1
        share = 20 if lmax > 20 else share
    times, spent, memory = [], [], 0
    for _ in range(rounds):
        arguments = [sys.executable, __file__, code, str(lmax), str(sources // share), str(runs)]
        said = json.loads(subprocess.run(arguments, capture_output=True, text=True, check=True).stdout)
        times += said["seconds"]
        spent += said["cpu"]
        memory = max(memory, said["peak"] - said["before"])
    return float(np.median(times)) * share, min(spent) * share, memory, share


def main(sources=1_200_000, degrees=DEGREES):
    print(f"{sources} sources, full correlations, 80 % of the sky; seconds (median), its ratio to this project, that of "
          "CPU seconds (least), memory")  # fmt: skip
    print(f"{'degree':>6}", *(f"{code:>34}" for code in CODES))
    for lmax in degrees:
        cells, own, own_cpu = [], None, None
        for code in CODES:
            seconds, cpu, memory, share = measure(code, lmax, sources)
            own, own_cpu = own or seconds, own_cpu or cpu
            scaled = "*" if share > 1 else " "
            cells.append(f"{seconds:9.3f}{scaled}{seconds / own:8.2f}{cpu / own_cpu:8.2f}{memory:6.0f} M")
        print(f"{lmax:6d}", *cells, flush=True)
    print("* at a part of the sources, scaled linearly")


def scipy_lstsq(field, lmax):
    """A whitened design matrix, and SciPy's solver by a QR with pivots."""
    from scipy.linalg import lstsq

    from vsh import Modes
    from vsh.basis import harmonics

    design, (s1, s2), root = harmonics(field.lon, field.lat, Modes(lmax)), field.sigma, np.sqrt(1 - field.rho**2)
    east = design[:, 0] / s1
    north = (design[:, 1] / s2 - field.rho * east) / root
    return lstsq(np.concatenate([east, north], axis=1).T, field.whitened.ravel(), lapack_driver="gelsy")[0]


def least_cpu(function, *arguments, runs=10):
    """The least CPU time of some runs, after one that opens libraries."""
    times = [0.0]
    for _ in range(runs + 1):
        start = time.process_time()
        function(*arguments)
        times.append(time.process_time() - start)
    return min(times[2:])


def small():
    for sources in (1000, 10_000, 100_000):
        field = synthetic(sources)
        for lmax in (1, 3):
            own, *others = (least_cpu(code, field, lmax) for code in (this_project, vsh_tools_1_0_0, scipy_lstsq))
            print(f"{sources:7d} sources, degree {lmax}: {1e3 * own:6.2f} ms; vsh-tools {others[0] / own:5.2f} ×, "
                  f"lstsq {others[1] / own:5.2f} ×", flush=True)  # fmt: skip


def beside_plain():
    from vsh import Field

    for sources in (10_000, 100_000, 400_000, 1_000_000):
        sky, rng = synthetic(sources), np.random.default_rng(1)
        for nu in (np.inf, 3.0):
            east, north = rng.normal(size=(2, sources)) * (
                1 if nu == np.inf else np.sqrt(nu / rng.chisquare(nu, sources))
            )
            noise = sky.sigma * np.stack([east, sky.rho * east + np.sqrt(1 - sky.rho**2) * north])
            field = Field(sky.lon, sky.lat, noise, sky.sigma, sky.rho)
            plain, best = (least_cpu(code, field, 5, runs=3) for code in (this_project, recommended))
            print(
                f"{sources:8d} sources, ν = {nu:3g}: {1e3 * plain:4.0f} ms; recommended {best / plain:5.2f} ×",
                flush=True,
            )


if __name__ == "__main__":
    if sys.argv[1:] in (["small"], ["recommended"]):
        {"small": small, "recommended": beside_plain}[sys.argv[1]]()
    elif sys.argv[1:] and sys.argv[1] in CODES:
        child(sys.argv[1], *map(int, sys.argv[2:]))
    else:
        numbers = list(map(int, sys.argv[1:]))
        main(*numbers[:1], *([numbers[1:]] if numbers[1:] else []))
