"""Joint solutions of sources and attitude: true errors, iterations, cost. The numbers of docs/agis.md.

python benchmarks/agis.py errors [N]        true over formal errors by attitude, stars, knots, global parameters
python benchmarks/agis.py carlo [N] [DRAWS] the same for two of them by Monte Carlo
python benchmarks/agis.py iterations [N]    to 1 and 0.01 µas, and to the rule on low degrees
python benchmarks/agis.py correlation [N] [DRAWS]
python benchmarks/agis.py full SKY [N [IN]] a whole mission: seconds, memory, iterations, figures in IN/agis_SKY_N; goes on after a kill
python benchmarks/agis.py paper [N] [DRAWS] the cases of the paper
python benchmarks/agis.py level [N]         a second level: iterations and cost
python benchmarks/agis.py memory N [FOLDER] memory and time of twenty iterations, transits in memory or in a folder
python benchmarks/agis.py kernels           time of a pass, with and without numba
"""

import sys
import threading
import time
from itertools import pairwise
from pathlib import Path

import numpy as np

import sim
from sim import agis
from vsh import Coefficients, Modes

LAW = sim.NominalScanningLaw(dead_time=0.06, rng=2)
MISSION = sim.Mission(LAW, "paper")


def system(n, sky="uniform", *, equal=None, stars=0, star_error=100.0, knots=30.0, spread=None, **options):
    """The equations of n quasars, perhaps with stars, scaled to half a million; and which are quasars."""
    mixture = agis.mixture(
        MISSION,
        sim.quasars(n, 1, sky),
        stars=sim.stars(stars, 5) if stars else None,
        star_error=star_error if stars else None,
    )
    sigma = np.where(mixture.are("quasars"), equal, mixture.sigma) if equal else mixture.sigma
    if spread is not None:
        options["motion"] = agis.global_motion(mixture.lon, mixture.lat, 1, scatter=spread)
    made, _ = agis.joint_system(LAW, mixture.lon, mixture.lat, sigma, knots=knots, number=n, **options)
    return made, mixture.are("quasars")


def ratio(made, quasars):
    """True over formal error of the acceleration, and the iterations that took."""
    from sim.agis._globals import MotionFit

    fit = MotionFit(made, Modes(1), np.flatnonzero(quasars))
    true = made.covariance_of(fit.functionals([3, 4, 5]))
    return np.sqrt(np.trace(true) / np.trace(fit.formal[3:, 3:]))


def errors(n=10_000):
    told = [
        ("known to 10 µas, even sky", {"prior": 10.0}), ("known to 10 µas, IGQL-like", {"sky": "igql", "prior": 10.0}),
        ("known to 100 µas, IGQL-like", {"sky": "igql", "prior": 100.0}), ("known to 1000 µas, IGQL-like", {"sky": "igql", "prior": 1000.0}),
        ("solved, quasars of equal weight, even sky", {"equal": 500.0}), ("solved, by magnitude, even sky", {}),
        ("solved, GUMS-like", {"sky": "gums"}), ("solved, IGQL-like", {"sky": "igql"}),
        ("the same, knots of 90 s", {"sky": "igql", "knots": 90.0}), ("the same, knots of 300 s", {"sky": "igql", "knots": 300.0}),
        ("knots of 300 s, even sky", {"knots": 300.0}),
        ("one star of 100 µas a quasar, even sky", {"stars": n}), ("the same, IGQL-like", {"sky": "igql", "stars": n}),
        ("five of 300 µas, IGQL-like", {"sky": "igql", "stars": 5 * n, "star_error": 300.0}),
        ("one of 1000 µas, IGQL-like", {"sky": "igql", "stars": n, "star_error": 1000.0}),
    ]  # fmt: skip
    for name, options in told:
        start = time.process_time()
        print(f"{name:45}{ratio(*system(n, **options)):8.3f}{time.process_time() - start:8.0f} CPU s", flush=True)
    for spread in (0.1, 10.0):
        made, _ = system(n, spread=spread)
        formal, true = made.global_covariances()
        found = np.sqrt(np.trace(true[3:, 3:]) / np.trace(formal[3:, 3:]))
        print(f"{f'global glide, motions to {spread:g} µas/yr':45}{found:8.3f}", flush=True)


def carlo(n=10_000, draws=200):
    """Scatter of the acceleration over draws of the noise, beside the exact error."""
    from sim.agis._globals import MotionFit

    for name, options in (("equal weights", {"equal": 500.0}), ("by magnitude", {})):
        made, quasars = system(n, **options)
        fit = MotionFit(made, Modes(1), np.flatnonzero(quasars))
        exact = made.covariance_of(fit.functionals([3, 4, 5]))
        found = []
        for seed in range(draws):
            solution = made.solve(*agis.observations(made.scans, [9, seed]), stop=0.02)
            found.append(fit.compute_coefficients(solution.sources[..., None])[3:, 0])
        scatter, formal = np.mean(np.square(found), axis=0), np.diag(fit.formal)[3:]
        print(f"{name}: scatter/formal {np.sqrt(scatter.sum() / formal.sum()):.3f} ± {np.sqrt(scatter.sum() / formal.sum()) / np.sqrt(6 * draws):.3f}"
              f" ({draws} draws), exact {np.sqrt(np.trace(exact) / formal.sum()):.3f}", flush=True)  # fmt: skip


def correlation(n=5000, draws=200):
    """Of parallax errors of neighbours, in heights of a field, and at the basic angle."""
    from vsh.sky.sphere import triad

    made, _ = system(n)
    root = np.sqrt(agis.FULL / n)
    found = np.array(
        [made.solve(*agis.observations(made.scans, [9, seed]), stop=0.02).sources[:, 2] for seed in range(draws)]
    )
    values = found / np.sqrt(np.mean(found**2, axis=0))
    first, second = np.triu_indices(n, 1)
    places = triad(made.scans.lon, made.scans.lat)[2]
    angle = np.degrees(np.arccos(np.clip(places.T @ places, -1, 1)[first, second]))
    product = (values.T @ values / draws)[first, second]
    near = np.array([0.0, 0.1, 0.25, 0.5, 0.7, 1.0, 2.0]) * root
    for edges in (near, 106.5 + np.array([-0.15, 0.15]) * root):
        for low, high in pairwise(edges):
            here = (angle >= low) & (angle < high)
            print(
                f"{low / root:8.2f} to {high / root:7.2f}°: {product[here].mean():+.4f} ({here.sum()} pairs)",
                flush=True,
            )


def iterations(n=5000, *skies):
    """Zero noise, from the paper's start errors; skies are even, GUMS-like and IGQL-like unless named."""
    skies = skies or ("uniform", "gums", "igql")
    for sky in skies:
        made, _ = system(n, sky)
        silent = np.zeros((2, len(made.scans)))
        start, attitude = agis.start_errors(made.scans, 1)
        for first in ("attitude", "sources"):
            sizes = []

            def watch(_, x, sizes=sizes, made=made):
                left = made.without_null_space(x[..., None])[0][made.solved]
                sizes.append(np.sqrt(np.mean(left[:, :3] ** 2)))

            found = made.solve(
                *silent, start=start, attitude=attitude, first=first, iterations=100, stop=None, watch=watch
            )
            sizes = np.array(sizes)
            reached = [int(np.argmax(sizes < limit)) if (sizes < limit).any() else None for limit in (100.0, 1.0, 0.01)]
            away = np.abs(found.history - found.history[-1]) / np.sqrt(np.diag(found.formal_low))
            low = int(np.max(np.flatnonzero(away.max(axis=1) > 0.05), initial=-1)) + 2
            print(f"{sky} {first} first: rms of positions and parallaxes below 100, 1, 0.01 µas after {reached} iterations "
                  f"(last {sizes[-1]:.2g} µas); degrees 1 to 3 within 0.05 σ of the end from {low} on", flush=True)  # fmt: skip
        noisy = made.solve(*agis.observations(made.scans, 3), start=start, attitude=attitude, iterations=1000)
        quiet = made.solve(*silent, start=start, attitude=attitude, iterations=1000)
        print(
            f"{sky} sources first, to the rule: {quiet.iterations} without noise, {noisy.iterations} with", flush=True
        )


def laps():
    """A function that tells time and memory since its last call, and the most that was taken of both memories."""
    most, moments = [0.0], [(time.perf_counter(), time.process_time())]

    def look():
        while True:
            with Path("/proc/self/status").open(encoding="ascii") as status:
                own = next(int(line.split()[1]) for line in status if line.startswith("RssAnon"))
            most[0] = max(most[0], own / 2**20)
            time.sleep(0.2)

    threading.Thread(target=look, daemon=True).start()

    def lap(words):
        moments.append((time.perf_counter(), time.process_time()))
        wall, cpu = np.subtract(moments[-1], moments[-2])
        print(f"{words:14}{wall:8.1f} s, {cpu:8.1f} CPU s, at most {most[0]:.2f} GiB of its own", flush=True)
        most[0] = 0.0

    return lap


def full(sky, n=agis.FULL, parent="."):
    """A whole mission to the rule on low degrees; what was done before a kill is not done again."""
    lap = laps()
    folder = Path(parent, f"agis_{sky}_{n}")
    folder.mkdir(parents=True, exist_ok=True)
    quasars = sim.quasars(n, 1, sky)
    sigma = MISSION.transit_error(quasars.magnitude)
    law, knots = (LAW, 30.0) if n >= agis.FULL else agis.scaled(n, LAW)
    print(agis.plan(law, quasars.lon, quasars.lat, knots))
    scans = agis.scans(law, quasars.lon, quasars.lat, sigma, 5 * sigma, knots, folder=folder / "scans")
    lap("transits")
    made = agis.System(scans)
    lap("equations")
    observed, (start, attitude) = agis.observations(scans, 3), agis.start_errors(scans, 4)
    lap("observations")
    seconds = []
    solution = made.solve(
        *observed, start=start, attitude=attitude, iterations=1000, checkpoint=folder / "checkpoint.npz",
        watch=lambda number, _: seconds.append((number, time.perf_counter(), time.process_time())),
    )  # fmt: skip
    lap("solution")
    wall, cpu = np.median(np.diff(seconds, axis=0), axis=0)[1:]
    print(
        f"{solution.iterations} iterations, {len(seconds) - 1} of them in this run (from {seconds[0][0]} on), {wall:.1f} s and "
        f"{cpu:.1f} CPU s each; {time.process_time() / 60:.1f} CPU minutes in all"
    )
    solution = agis.in_own_frame(made, solution)
    for low, high in ((0, 16), (16, 17), (17, 18), (18, 19), (19, 19.5), (19.5, 20)):
        here = made.solved & (quasars.magnitude >= low) & (quasars.magnitude < high)
        pulls = solution.sources[here] / np.sqrt(np.einsum("nii->ni", solution.formal[here]))
        print(f"G {low:g} to {high:g}: true/formal {np.sqrt(np.mean(pulls**2, axis=0)).round(3)}")
    if sky != "igql" and n <= agis.FULL:
        print(f"true/formal of the acceleration {ratio(made, np.ones(n, bool)):.3f}")
        lap("exact errors")


def paper(n=20_000, draws=100):
    """Cases A to D: rms over components of the acceleration, scaled to half a million quasars [µas/yr]."""
    from sim.agis._globals import MotionFit

    sys.path.insert(0, str(Path(__file__).parents[1] / "papers" / "bachchan2016"))
    from published import published

    cases = {"A": ("gums", 0.0, 2.0), "B": ("gums", 100.0, 2.0), "C": ("gums", 100.0, 10.0), "D": ("igql", 0.0, 2.0)}
    modes, scale = Modes(1), np.sqrt(n / agis.FULL)
    unit = [Coefficients(modes, row).glide for row in np.eye(6)[3:]]
    turn = np.stack(unit, axis=1)  # coefficients to components

    def size(covariance):
        return scale * np.sqrt(np.trace(turn @ covariance @ turn.T) / 3)

    print("case  paper: formal, Std, ratio;  here: formal, Std known to 10 µas, exact, ratio;  solved: exact, ratio")
    for case, (sky, sigma, tau) in cases.items():
        variability = sim.Variability(sigma, tau) if sigma else None
        table = published(case)
        theirs = [np.sqrt(np.mean([table[f"a_{axis}"][k] ** 2 for axis in "xyz"])) for k in (2, 1)]
        known, _ = system(n, sky, prior=10.0)
        fit = MotionFit(known, modes, np.arange(n))
        g = fit.functionals([3, 4, 5])
        found = []
        for seed in range(draws):
            rng = np.random.default_rng([3, seed])
            observed = agis.observations(known.scans, rng, variability=variability)
            about = 10.0 * rng.standard_normal((known.coefficients, 3))
            solution = known.solve(*observed, known=about, iterations=4, stop=None)
            found.append(fit.compute_coefficients(solution.sources[..., None])[3:, 0])
        formal, scatter = size(fit.formal[3:, 3:]), size(np.mean([np.outer(x, x) for x in found], axis=0))
        exact = size(known.covariance_of(g, variability=variability))
        solved, _ = system(n, sky)
        true = size(solved.covariance_of(g, variability=variability))
        print(f"{case}     {theirs[0]:.3f} {theirs[1]:.3f} {theirs[1] / theirs[0]:.2f};   {formal:.3f} {scatter:.3f} {exact:.3f} {exact / formal:.3f}"
              f" ({draws} draws ± {100 / np.sqrt(6 * draws):.0f} %);   {true:.3f} {true / formal:.2f}", flush=True)  # fmt: skip


def level(n=5000, degree=6):
    """A second level of harmonics in positions, parallaxes and motions: iterations and CPU seconds, for one solution and for thirty."""
    from sim.agis._globals import MotionFit
    from sim.agis._system import Iteration
    from vsh.basis import harmonics, scalar_harmonics

    made, quasars = system(n, "igql")
    field, scalar = (
        harmonics(made.scans.lon, made.scans.lat, degree),
        scalar_harmonics(made.scans.lon, made.scans.lat, degree),
    )
    basis = np.zeros((n, 5, 2 * len(field) + len(scalar)))
    basis[:, :2, : len(field)] = field.transpose(2, 1, 0)
    basis[:, 3:, len(field) : 2 * len(field)] = field.transpose(2, 1, 0)
    basis[:, 2, 2 * len(field) :] = scalar.T
    # Not the null space, which is none of the second level's business.
    basis = made.without_null_space(basis)[0]
    start = time.process_time()
    flat = basis.reshape(5 * n, -1)
    applied = np.concatenate(
        [made.apply(np.ascontiguousarray(basis[..., k : k + 3])) for k in range(0, basis.shape[-1], 3)], axis=-1
    )
    coarse = np.linalg.pinv(flat.T @ applied.reshape(5 * n, -1), rcond=1e-10, hermitian=True)
    setup = time.process_time() - start

    class Second:
        apply = staticmethod(made.apply)

        @staticmethod
        def precondition(r):
            below = (flat @ (coarse @ (flat.T @ r.reshape(5 * n, -1)))).reshape(r.shape)
            return made.precondition(r) + below

    g = made._remove_null_space(MotionFit(made, Modes(1), np.flatnonzero(quasars)).functionals([3]))
    for name, equations in (("one level", made), ("two levels", Second)):
        work, start = Iteration(equations, g), time.process_time()
        steps = 0
        while work.residual > 1e-4:
            work.step()
            steps += 1
        cost = time.process_time() - start
        more = setup if equations is Second else 0.0
        print(f"{name}: {steps} iterations, {cost:.1f} CPU s, and {more:.1f} to set up {basis.shape[-1]} vectors; "
              f"one solution {cost + more:.1f}, thirty {30 * cost + more:.1f} CPU s")  # fmt: skip


def memory(n=agis.FULL, folder=None, steps=20):
    """A mission of 30 s knots, whatever the number of its sources: what it takes in memory, and from a folder."""
    lap = laps()
    quasars = sim.quasars(n, 1)
    sigma = MISSION.transit_error(quasars.magnitude)
    print(agis.plan(LAW, quasars.lon, quasars.lat))
    scans = agis.scans(LAW, quasars.lon, quasars.lat, sigma, 5 * sigma, folder=folder)
    lap("transits")
    made = agis.System(scans)
    lap("equations")
    observed, (start, attitude) = agis.observations(scans, 3), agis.start_errors(scans, 4)
    lap("observations")
    seconds = []
    solution = made.solve(*observed, start=start, attitude=attitude, iterations=steps, stop=None,
                          watch=lambda *_: seconds.append((time.perf_counter(), time.process_time())))  # fmt: skip
    lap("solution")
    wall, cpu = np.median(np.diff(seconds, axis=0), axis=0)
    print(
        f"{solution.iterations} iterations, {wall:.2f} s and {cpu:.2f} CPU s each; low degrees {solution.history[-1][:6].round(6).tolist()}"
    )


def kernels(n=5000):
    """One iteration by the compiled passes and by the sparse matrix."""
    for compiled in (True, False):
        made, _ = system(n)
        passes = agis.System(made.scans, compiled=compiled, threads=1).passes
        x = np.ones((n, 5, 1))
        times = []
        for _ in range(5):
            start = time.process_time()
            passes.to_sources(passes.to_attitude(x))
            times.append(time.process_time() - start)
        print(
            f"{'numba' if compiled else 'sparse'}: {1e9 * min(times) / len(made.scans):.0f} ns a transit and iteration"
        )


if __name__ == "__main__":
    what = {
        each.__name__: each for each in (errors, carlo, iterations, correlation, full, paper, level, memory, kernels)
    }
    what[sys.argv[1]](*(int(x) if x.isdecimal() else x for x in sys.argv[2:]))
