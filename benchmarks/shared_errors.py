"""How far errors that classes of sources share hold, on skies drawn coefficient by coefficient.

`python benchmarks/shared_errors.py [SKIES] [WORDS]` prints a row for each case whose name holds the words: the share of
skies whose p-value of classes alike is below 0.05 and 0.0027 (spin, acceleration), by plain fits of degree 1 and by
`fit.background.shared`; pulls of a class, of the difference of the last and first, and of all together; and how often 95 %
intervals hold. Systematics go to degree 16, beyond what is fitted. `python benchmarks/shared_errors.py SKIES power WORDS`
puts an acceleration of four of its errors into the last class and prints in how many skies it is found. `--sources N`
behind either: of so many in a class, in place of 400 000, with the noise that goes with them. Where a class sees a part of the
sky alone ("north", "high") normal equations go three degrees higher, as commands take them; `--no-beyond`: they do not.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

import fit
from fit.background import SHAPES, shared
from fit.background._blocks import map_parities
from fit.normal import NormalEquations
from vsh import Field, Modes
from vsh.models.covariance import VASILIEV_BAUMGARDT_2021, Spectrum

HIGHEST, PLACES, SOURCES = 16, 1500, 400_000
if "--sources" in sys.argv:
    SOURCES = int(sys.argv.pop(sys.argv.index("--sources") + 1))
    sys.argv.remove("--sources")
EXTRA_DEGREES = 0 if "--no-beyond" in sys.argv else 3
if not EXTRA_DEGREES:
    sys.argv.remove("--no-beyond")
POLE = np.array([-0.8676661, -0.1980764, 0.4559838])
SPECTRA = {"flat": None, "lindegren": SHAPES["gaia"], "vasiliev": Spectrum.from_covariance(VASILIEV_BAUMGARDT_2021)}


def places(n, rng, kind):
    """Directions outside the Galactic plane; "north" also δ > −17°, "high" |b| > 40°."""
    v = rng.normal(size=(3, 20 * n))
    v /= np.linalg.norm(v, axis=0)
    b, dec = np.abs(POLE @ v), np.arcsin(v[2])
    keep = {"plane": b > np.sin(0.35), "north": (b > np.sin(0.35)) & (dec > -0.3), "high": b > np.sin(0.7)}[kind]
    v = v[:, keep][:, :n]
    return np.arctan2(v[1], v[0]), np.arcsin(v[2])


def variances(name, modes):
    if name == "none":
        return np.zeros(len(modes))
    if name == "flat":
        l = modes.degrees
        return np.where(map_parities(modes) == 0, 20.0, 5.0) * np.where(l <= 7, 1, (7 / l) ** 2) / modes.norm2
    return SPECTRA[name].variances(modes)


def mixing(name, k):
    ones, unit = np.ones((k, k)), np.eye(k)
    odd = np.zeros((k, k))
    odd[-1, -1] = k
    return {
        "common": ones, "own": unit, "half": (ones + unit) / 2, "tenth": 0.9 * ones + 0.1 * unit,
        "odd one": 0.7 * ones + 0.3 * odd, "twice": np.outer(x := np.r_[np.ones(k - 1), 2.0], x),
    }[name]  # fmt: skip


class Skies:
    """Classes at fixed places; normal equations of skies, exact to degree 16."""

    def __init__(self, kinds, noise=2.2 * 400_000 / SOURCES, seed=1):
        rng = np.random.default_rng(seed)
        self.modes, self.matrices, self.roots = Modes(HIGHEST), [], []
        for kind in kinds:
            lon, lat = places(PLACES, rng, kind)
            sigma = np.full((2, PLACES), np.sqrt(noise * PLACES / (4 * np.pi)))
            matrix = fit.normal_equations(Field(lon, lat, np.zeros((2, PLACES)), sigma), HIGHEST).matrix
            values, turn = np.linalg.eigh(matrix)
            self.matrices.append(matrix)
            self.roots.append(turn * np.sqrt(np.maximum(values, 0)))

    def draw(self, spectrum, mix, lmax, rng):
        k, modes = len(self.matrices), self.modes
        values, turn = np.linalg.eigh(mixing(mix, k))
        root = turn * np.sqrt(np.maximum(values, 0))
        true = root @ (rng.normal(size=(k, len(modes))) * np.sqrt(variances(spectrum, modes)))
        out = []
        for matrix, each, c in zip(self.matrices, self.roots, true, strict=True):
            noise = each @ rng.normal(size=len(modes))
            rhs = matrix @ c + noise
            total = c @ matrix @ c + 2 * c @ noise + rng.chisquare(2 * SOURCES)
            at = np.flatnonzero(modes.degrees <= lmax)
            out.append(
                NormalEquations(Modes(lmax), matrix[np.ix_(at, at)], rhs[at], float(total), 2 * SOURCES, "icrs", ())
            )
        return out


def plain(normals):
    """p-values of classes alike, spin and acceleration, by fits of degree 1 with errors scaled by χ²/dof."""
    solutions = [fit.solve(_cut(each)) for each in normals]
    p = []
    for part in (slice(0, 3), slice(3, 6)):
        values = np.array([s.coefficients.values[part] for s in solutions])
        weights = np.array([np.linalg.inv(s.covariance[part, part] * s.reduced_chi2) for s in solutions])
        mean = np.linalg.solve(weights.sum(0), np.einsum("kij,kj->i", weights, values))
        misfit = np.einsum("ki,kij,kj->", values - mean, weights, values - mean)
        p.append(chi2.sf(misfit, 3 * (len(values) - 1)))
    return p


def _cut(normal):
    at = np.flatnonzero(normal.modes.degrees == 1)
    return replace(normal, modes=Modes(1), matrix=normal.matrix[np.ix_(at, at)], rhs=normal.rhs[at])


CASES = [
    (kinds, lmax, spectrum, mix)
    for kinds, lmax in ((("plane", "north"), 5), (("plane", "north", "high"), 5), (("plane",) * 5, 4), (("plane",) * 5, 5),
        (("plane",), 5),
    )
    for spectrum, mixes in (
        ("none", ("common",)), ("flat", ("common", "half", "own", "odd one", "twice")),
        ("lindegren", ("common", "half", "tenth")), ("vasiliev", ("tenth",)),
    )
    for mix in (mixes if len(kinds) > 1 else mixes[:1])
]  # fmt: skip


def highest(kinds, lmax):
    """To which degree commands take the normal equations of these classes."""
    return lmax + EXTRA_DEGREES * ("north" in kinds or "high" in kinds)


def power(n_skies, words):
    """In how many skies a last class whose acceleration is four errors away is told from the others."""
    print(f"{'case':54}{'equality p < .05':>20}{'p < .0027':>12}{'verdict p < .05':>18}")
    cache = {}
    for kinds, lmax, spectrum, mix in CASES:
        name = f"{len(kinds)} {'+'.join(kinds)}, L = {lmax}, {spectrum}, {mix}"
        if words not in name or len(kinds) == 1:
            continue
        skies, rows = cache.setdefault(kinds, Skies(kinds)), []
        for seed in range(n_skies):
            rng = np.random.default_rng(seed)
            normals, degrees = skies.draw(spectrum, mix, highest(kinds, lmax), rng), range(2, lmax + 1)
            away = shared(normals, degrees, draws=200, rng=seed).difference(0, len(kinds) - 1)
            step, at = np.zeros(len(normals[-1].rhs)), np.flatnonzero(normals[-1].modes.degrees == 1)[3:]
            axis = rng.normal(size=3)
            axis /= np.linalg.norm(axis)
            covariance = away.covariance[3:6, 3:6]
            step[at] = 4 * axis / np.sqrt(axis @ np.linalg.solve(covariance, axis))
            last = normals[-1]
            moved = last.matrix @ step
            total = last.chi2_null + 2 * step @ last.rhs + step @ moved
            normals[-1] = replace(last, rhs=last.rhs + moved, chi2_null=total)
            result = shared(normals, degrees, draws=200, rng=seed)
            rows.append([result.equality("S"), result.verdict(1000, seed).p_value])
        p, verdict = np.array(rows).T
        print(
            f"{name:54}{np.mean(p < 0.05):>20.2f}{np.mean(p < 0.0027):>12.2f}{np.mean(verdict < 0.05):>18.2f}",
            flush=True,
        )


def main(n_skies=100, words=""):
    print(f"{'case':54}{'plain: spin; accel.':>24}{'shared':>24}{'verdict':>9}{'pull class diff sum':>24}{'95 %':>20}")
    cache = {}
    for kinds, lmax, spectrum, mix in CASES:
        name = f"{len(kinds)} {'+'.join(kinds)}, L = {lmax}, {spectrum}, {mix}"
        if words not in name:
            continue
        skies = cache.setdefault(kinds, Skies(kinds))
        rows, pulls = [], []
        for seed in range(n_skies):
            normals = skies.draw(spectrum, mix, highest(kinds, lmax), np.random.default_rng(seed))
            result = shared(normals, range(2, lmax + 1), draws=200, rng=seed)
            one, all_ = result.solutions[0], result.together()
            pull = [one.coefficients.values / one.sigma]
            if len(kinds) > 1:
                away = result.difference(0, len(kinds) - 1)
                pull.append(away.coefficients.values / away.sigma)
                rows.append(
                    [*plain(normals), result.equality("T"), result.equality("S"), result.verdict(1000, seed).p_value]
                )
            pulls.append([*pull, all_.coefficients.values / all_.sigma])
        pulls = np.abs(np.array(pulls))
        line = f"{name:54}"
        if rows:
            shares = [
                f"{np.mean(np.array(rows)[:, k] < 0.05):.2f} {np.mean(np.array(rows)[:, k] < 0.0027):.2f}"
                for k in range(5)
            ]
            line += f"{shares[0] + '; ' + shares[1]:>24}{shares[2] + '; ' + shares[3]:>24}{shares[4].split()[0]:>9}"
        line += f"{' '.join(f'{x:.2f}' for x in np.sqrt((pulls**2).mean((0, 2)))):>24}"
        print(line + f"{' '.join(f'{x:.3f}' for x in (pulls < 1.96).mean((0, 2))):>20}", flush=True)


if __name__ == "__main__":
    run = power if sys.argv[2:3] == ["power"] else main
    run(int(sys.argv[1]) if len(sys.argv) > 1 else 100, " ".join(sys.argv[3 if run is power else 2 :]))
