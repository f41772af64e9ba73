"""p-values of a deformation between two catalogues that share noise, all sources alike or some of them.

`python benchmarks/shared_noise.py [PAIRS] [SOURCES]` prints, for each way to share, how often the p-value is below 0.05
and 0.0027 where there is no deformation: with errors as quoted, scaled by one factor, and in classes of their size;
and of the last the p-value of Kolmogorov and Smirnov that p-values are uniform.
"""

import sys

import numpy as np
from scipy.stats import kstest

import sim
from fit.frames.compare import fit_by_error_class
from fit.normal import fit_field
from fit.results.quality import f_p_value
from vsh import Field, Modes

SHARED = {
    "nothing": lambda s: 0 * s,
    "half": lambda s: 0.5 + 0 * s,
    "nine tenths": lambda s: 0.9 + 0 * s,
    "the bright, .95": lambda s: np.where(s < 25, 0.95, 0.0),
    "the faint, .95": lambda s: np.where(s < 25, 0.0, 0.95),
    "falling from .95": lambda s: 0.95 * (2 - np.log10(s)) / 1.2,
}


def pair(n, share, rng):
    """Differences of two catalogues of one sky, errors over a factor 16, and what is quoted of them."""
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(0.8, 2.0, n)
    seen = np.sqrt(2 * (1 - share(sigma))) * sigma
    return Field(lon, lat, rng.normal(size=(2, n)) * seen, np.sqrt(2) * np.tile(sigma, (2, 1)))


def main(n_pairs=300, n=500):
    print(f"{n} sources{'':20}{'quoted':>16}{'one factor':>16}{'classes':>16}{'KS':>8}")
    beyond = Modes(2).degrees > 1
    for name, share in SHARED.items():
        rng, p = np.random.default_rng(2), []
        for _ in range(n_pairs):
            field = pair(n, share, rng)
            solution = fit_field(field, 2)
            inner = solution.covariance[np.ix_(beyond, beyond)]
            chi2 = solution.values[beyond] @ np.linalg.solve(inner, solution.values[beyond])
            q = int(beyond.sum())
            one = f_p_value(chi2 / solution.reduced_chi2, q, solution.dof)
            p.append([f_p_value(chi2, q, np.inf), one, fit_by_error_class(field, Modes(2)).p_value])
        p = np.array(p)
        print(
            f"{name:30}"
            + "".join(f"{f'{np.mean(c < 0.05):.3f} {np.mean(c < 0.0027):.3f}':>16}" for c in p.T)
            + f"{kstest(p[:, 2], 'uniform').pvalue:8.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
