"""Coverage of the recommended fit, and of least squares with formal errors, on skies that violate their assumptions.

    python benchmarks/recommended.py [SKIES [ROW …]]
    python benchmarks/recommended.py [SKIES] few [student|excess-noise|bins|classes]
    python benchmarks/recommended.py [SKIES] many

For each kind of sky: rms pull of a component, shares of components within 1 and 1.96 errors, of p-values of the difference
from the truth below 0.05, and of 95 % limits above the truth; for acceleration and spin together.

With many sources, pulls where errors are wrong. With few sources and no signal: how often p < 0.0027, how many nominal 95 % intervals of a component hold zero, the rms
pull, how often there was no result, and the scatter of the estimates in that of least squares with the true variances.
"""

import sys
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import product

import numpy as np

import fit
import sim
from fit.background import SHAPES
from vsh import Field
from vsh.tools.errors import VshError

TRUTH = {"acceleration": np.array([-0.3, -4.4, -2.3]), "spin": np.zeros(3)}
#: Factor on each spectrum of systematic errors, which then add 1 to 2 errors of the noise to spin and acceleration.
_POWER = {"gaia": 0.7, "steep": 50.0}


def quasars(rng, n=2500, *, errors_wrong=False, double=0.0, stars=0.0, shape=None, twice=0.0, half=False):
    """Quasars as Gaia sees them: 300 to 1500 µas/yr by magnitude, no sources near the Galactic plane."""
    field = sim.observe(
        sim.quasars(n, rng, "plane-avoiding"), sim.acceleration(TRUTH["acceleration"]), rng=rng, sigma=100.0
    )
    sigma = np.array(field.sigma) * rng.lognormal(0.5, 0.6, n)
    motion = sim.acceleration(TRUTH["acceleration"])(field.lon, field.lat) + sigma * rng.normal(size=(2, n))
    if shape is not None:
        motion = motion + sim.systematics(_POWER[shape] * SHAPES[shape], rng, lmax=12)(field.lon, field.lat)
    if errors_wrong:
        faint = sigma[0] > np.median(sigma)
        motion = motion + 0.8 * sigma * faint * rng.normal(size=(2, n))
    motion = motion + (rng.uniform(size=n) < double) * 5 * sigma * rng.standard_t(2, (2, n))
    motion = motion + (rng.uniform(size=n) < stars) * rng.normal(-2000, 2500, (2, n))
    lon, lat = field.lon, field.lat
    rows = np.concatenate([np.arange(n), np.flatnonzero(rng.uniform(size=n) < twice)])
    rows = rows[lat[rows] > 0] if half else rows
    return Field(lon[rows], lat[rows], motion[:, rows], sigma[:, rows])


def vlbi(rng, n):
    """A table of VLBI: tails of Student's t with three degrees of freedom, errors that are wrong by 0.25 dex."""
    lon, lat = sim.uniform_sky(n, rng)
    sigma = np.broadcast_to(20 * rng.lognormal(0, 0.8, n), (2, n))
    noise = sigma * 10 ** rng.normal(0, 0.25, n) * rng.standard_t(3, (2, n))
    return Field(lon, lat, sim.acceleration(TRUTH["acceleration"])(lon, lat) + noise, sigma)


SKIES = {
    "clean": quasars,
    "errors wrong at the faint end, 2 % double": partial(quasars, errors_wrong=True, double=0.02),
    "2 % stars": partial(quasars, stars=0.02),
    "VLBI, 50 sources": partial(vlbi, n=50),
    "VLBI, 150 sources": partial(vlbi, n=150),
    "VLBI, 700 sources": partial(vlbi, n=700),
    "5 % twice": partial(quasars, twice=0.05),
    "systematic, Gaia's spectrum": partial(quasars, shape="gaia"),
    "systematic, l⁻²": partial(quasars, shape="steep"),
    "half the sky": partial(quasars, half=True),
}


def one(seed, name):
    """Numbers of one sky by both fits: three pulls, p, whether the limit holds, the mean error; acceleration, then spin."""
    warnings.simplefilter("ignore")
    field = SKIES[name](np.random.default_rng(seed))
    lmax = fit.methods.degree_for(len(field), 3)
    rows = []
    for solution in (fit.recommended(field).solution, fit.fit_field(field, lmax)):
        for vector, truth in ((getattr(solution, each), TRUTH[each]) for each in TRUTH):
            away = replace(vector, value=vector.value - truth)
            limit = vector.amplitude_limit() >= np.linalg.norm(truth)
            rows.append([*(away.value / vector.sigma), away.p_value, limit, *away.value])
    return rows


#: Cells of few sources: how many, over how many decades their errors spread, and their true scatter in median errors.
CELLS = list(product((15, 25, 33, 37, 40, 60, 100, 200), (0, 1, 2, 3, 4), (0, 0.3, 3, 30, 300)))


def no_signal(rng, n, decades, scatter):
    """Motions without a signal, and the same with their true variances for errors."""
    lon, lat = sim.uniform_sky(n, rng)
    sigma = np.tile(100 * 10 ** (decades * (rng.random(n) - 0.5)), (2, 1))
    true = np.hypot(sigma, 100 * scatter)
    motion = true * rng.normal(size=(2, n))
    return Field(lon, lat, motion, sigma), Field(lon, lat, motion, true)


def in_two(field, rng, kind):
    """Vectors of two halves of the sources, with the least p-value of their difference: bins, or classes."""
    if kind == "bins":
        bins = fit.redshift.binned(replace(field, redshift=rng.uniform(0.5, 3.0, len(field))), 1, [0.4, 1.5, 3.1])
        p_value = min(bins.equality(part, 1).p_value for part in "ST")
        vectors = [getattr(solution, each) for solution in bins.solutions for each in TRUTH]
    else:
        first, estimate = rng.uniform(size=len(field)) < 0.5, fit.estimate(field, 3)
        halves, lmax = [field[first], field[~first]], estimate.solution.modes.lmax
        normals = fit.background.extend_degrees(
            [estimate.equations(half, lmax) for half in halves], estimate.equations, halves
        )
        shared = fit.background.shared(
            normals, range(2, lmax + 1), labels=("a", "b"), noise_scale=estimate.is_scaled, rng=1
        )
        vectors = [getattr(shared.difference(0, 1), each) for each in TRUTH]
        p_value = min(vector.p_value for vector in vectors)
    return [[*vector.value, *vector.sigma, p_value, 1.0, 1.0, 1.0] for vector in vectors]


def one_of_few(seed, cell, kind="recommended"):
    """Estimates, errors, p-values of acceleration and spin, and the estimates with the true variances; None of no result."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(seed)
    field, known = no_signal(rng, *cell)
    try:
        if kind in ("bins", "classes"):
            return in_two(field, rng, kind)
        solution = fit.estimate(field, None if kind == "recommended" else 1, kind).solution
    except VshError:
        return None
    best = fit.fit_field(known, solution.modes.lmax)
    return [
        [*vector.value, *vector.sigma, vector.p_value, *getattr(best, each).value]
        for vector, each in ((getattr(solution, each), each) for each in TRUTH)
    ]


def few(n=200, kind="recommended"):
    """Print the cells of few sources, by an estimator, in bins or in classes."""
    print("   N  decades  scatter   p<.0027   95 %   pull   none   sd")
    with ProcessPoolExecutor() as pool:
        for cell in CELLS:
            all_skies = list(pool.map(partial(one_of_few, cell=cell, kind=kind), range(n), chunksize=10))
            found = np.array([each for each in all_skies if each is not None]).reshape(-1, 10)
            pulls, known = found[:, :3] / found[:, 3:6], np.isfinite(found[:, 3])
            detected, covered = np.mean(found[:, 6] < 0.0027), np.mean(np.abs(pulls[known]) < 1.96)
            print(
                "{:4}{:9}{:9}".format(*cell)
                + f"{detected:10.4f}{covered:7.3f}{np.sqrt(np.mean(pulls[known] ** 2)):7.2f}"
                + f"{1 - known.sum() / (2 * n):7.3f}{found[:, :3].std() / found[:, 7:].std():6.2f}"
                + ("  <--" if detected > 0.01 or covered < 0.93 else ""),
                flush=True,
            )


#: Factors on the errors of 120 000 sources, of which a sample tells the noise: by error and draws of a generator.
WRONG = {
    "three times too small": lambda sigma, rng: 3.0,
    "three times too small, tails": lambda sigma, rng: 3 * np.sqrt(3 / rng.chisquare(3, len(sigma))),
    "the small ones ten times too small": lambda sigma, rng: np.where(sigma < 150, 10.0, 1.0),
    "a noise beside them": lambda sigma, rng: np.sqrt(1 + (300 / sigma) ** 2),
}


def one_of_many(seed, name, n=120_000):
    """Pulls of the vectors, and of the coefficients of degrees 2 to 5 without the floor."""
    rng = np.random.default_rng([seed, 7])
    lon, lat = sim.plane_avoiding_sky(n, rng)
    sigma = 10 ** rng.uniform(1.7, 2.8, n)
    noise = sigma * WRONG[name](sigma, rng) * rng.normal(size=(2, n))
    truth = sim.acceleration(TRUTH["acceleration"])(lon, lat)
    fitted = fit.recommended(Field(lon, lat, noise + truth, np.broadcast_to(sigma, (2, n))))
    vectors = [(getattr(fitted, key).value - value) / getattr(fitted, key).sigma for key, value in TRUTH.items()]
    plain = fitted.plain
    return np.ravel(vectors), (plain.values / plain.sigma)[plain.modes.degrees > 1]


def many(n=12):
    """Print the rms pulls on skies of many sources whose errors are wrong."""
    for name in WRONG:
        vectors, higher = (np.array(rows) for rows in zip(*(one_of_many(seed, name) for seed in range(n)), strict=True))
        texts = (f"{np.sqrt(np.mean(rows**2)):.2f} ± {1 / np.sqrt(2 * rows.size):.2f}" for rows in (vectors, higher))
        print(f"{name:36}", *texts, flush=True)


def main(n=200, *names):
    if names[:1] == ("many",):
        many(n)
        return
    if names[:1] == ("few",):
        few(n, *names[1:])
        return
    with ProcessPoolExecutor() as pool:
        for name in names or SKIES:
            found = np.array(list(pool.map(partial(one, name=name), range(n), chunksize=4)))
            for label, rows in (("recommended", found[:, :2]), ("least squares", found[:, 2:])):
                pulls, rms = np.abs(rows[..., :3]), np.sqrt(np.mean(rows[..., 5:] ** 2))
                print(
                    f"{name:44}{label:15}pull {np.sqrt(np.mean(pulls**2)):.2f}  68 % {np.mean(pulls < 1):.3f}  95 % "
                    f"{np.mean(pulls < 1.96):.3f}  p<.05 {np.mean(rows[..., 3] < 0.05):.3f}  p<.0027 "
                    f"{np.mean(rows[..., 3] < 0.0027):.4f}  limits {np.mean(rows[..., 4]):.3f}  rms {rms:.2f}",
                    flush=True,
                )


if __name__ == "__main__":
    main(*(int(each) if each.isdecimal() else each for each in sys.argv[1:]))
