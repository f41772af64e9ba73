"""What moved case D of Bachchan, Hobbs & Lindegren (2016)? The numbers and the figure of docs/paper.md.

    python benchmarks/what_moved_case_d.py [N] [DRAWS] [FIGURE]

Its mean acceleration is (5.58, 1.66, −1.65) µas/yr for a truth of (4.3, 0, 0), its mean spin (−1.08, −4.47, 1.18) for none.
"""

import sys
from pathlib import Path

import numpy as np

import sim
from sim import agis
from sim.agis._globals import MotionFit
from vsh import Modes

sys.path.insert(0, str(Path(__file__).parents[1] / "papers" / "bachchan2016"))
from published import CORRELATIONS, EXPERIMENTS, published

N = int(sys.argv[1]) if len(sys.argv) > 1 else 5000
DRAWS = int(sys.argv[2]) if len(sys.argv) > 2 else 12
FIGURE = sys.argv[3] if len(sys.argv) > 3 else "case_d.png"
AXES = ("x", "y", "z")
LAW = sim.NominalScanningLaw(dead_time=0.06, rng=2)
SIGMA = sim.Mission(LAW, "paper").transit_error


def of(case, name, what):
    """Mean, Std or formal error (0, 1, 2) of a vector of the paper's tables."""
    return np.array([published(case)[f"{name}_{axis}"][what] for axis in AXES])


def one_noise_for_all():
    """Were the attitude's noise the same in all realisations, the means of A to C would be off by as much as D's."""
    means = np.concatenate(
        [of(case, name, 0) - (4.3 if name == "a" else 0.0) * np.eye(3)[0] for case in "ABC" for name in ("omega", "a")]
    )
    expected = np.sqrt(
        np.mean(np.concatenate([of(case, name, 1) for case in "ABC" for name in ("omega", "a")]) ** 2 / EXPERIMENTS)
    )
    print(
        f"means of ω and ã in A to C: rms {np.sqrt(np.mean(means**2)):.4f} µas/yr from the truth; {expected:.4f} expected from their scatter"
    )
    return means, expected


def turned_frame():
    """A spin held at a wrong value moves the galaxies' acceleration through the correlations."""
    spin, found = of("D", "omega", 0), of("D", "g_a", 0) - of("B", "g_a", 0)
    both = np.where(np.tri(9, dtype=bool), CORRELATIONS.T, CORRELATIONS)  # GUMS is above the diagonal
    moved = both[6:, 3:6] @ np.linalg.solve(both[3:6, 3:6], spin)
    print(
        f"galaxies, D less B: {found.round(3)} µas/yr; a spin of {spin} that they do not have would give {moved.round(3)}"
    )


def equations(prior=None):
    quasars = sim.quasars(N, 1, "igql")
    system, _ = agis.joint_system(LAW, quasars.lon, quasars.lat, SIGMA(quasars.magnitude), prior=prior)
    return system, MotionFit(system, Modes(1), np.arange(N))


def unfinished():
    """Bias and scatter of the acceleration by iteration, in formal errors: one start, many draws of the noise."""
    system, fit = equations()
    sigma = np.sqrt(np.diag(fit.formal))[3:]
    start, attitude = agis.start_errors(system.scans, 1)
    found = {}
    for first in ("attitude", "sources"):
        tracks = []
        for seed in range(DRAWS):
            track = []
            system.solve(
                *agis.observations(system.scans, [4, seed]), start=start, attitude=attitude, first=first, iterations=160, stop=None,
                watch=lambda _, x, track=track: track.append(fit.compute_coefficients(x[..., None])[3:, 0] / sigma),
            )  # fmt: skip
            tracks.append(track)
        tracks, quiet = np.array(tracks), []
        # The start alone, without noise: what all draws have in common.
        system.solve(
            *np.zeros((2, len(system.scans))), start=start, attitude=attitude, first=first, iterations=160, stop=None,
            watch=lambda _, x, quiet=quiet: quiet.append(fit.compute_coefficients(x[..., None])[3:, 0] / sigma),
        )  # fmt: skip
        bias = np.linalg.norm(quiet, axis=1)
        scatter = np.sqrt(np.mean(tracks.var(axis=0, ddof=1), axis=1))
        found[first] = bias, scatter
        wanted = np.linalg.norm((of("D", "a", 0) - [4.3, 0, 0]) / of("D", "a", 2))
        below = np.flatnonzero(bias < wanted)
        at = below[0] if len(below) else len(bias) - 1
        print(f"{first} first: bias {bias[at]:.1f} formal errors at iteration {at + 1} (the paper's: {wanted:.1f}), scatter there {scatter[at]:.1f}; "
              f"the paper's {np.mean(of('D', 'a', 1) / of('D', 'a', 2)):.2f}")  # fmt: skip
    return found


def attitudes():
    """True over formal error by how well the attitude is known."""
    known = np.array([10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0])
    ratios = []
    for prior in known:
        system, fit = equations(prior)
        ratios.append(
            np.sqrt(np.trace(system.covariance_of(fit.functionals([3, 4, 5]))) / np.trace(fit.formal[3:, 3:]))
        )
    print("attitude known to", dict(zip(known.tolist(), np.round(ratios, 3).tolist(), strict=True)))
    paper = {case: np.sqrt(np.sum(of(case, "a", 1) ** 2) / np.sum(of(case, "a", 2) ** 2)) for case in "ABCD"}
    print("the paper's Std/formal of ã:", {case: round(float(value), 3) for case, value in paper.items()})
    return known, ratios, paper


def main():
    import matplotlib as mpl

    mpl.use("agg")
    import matplotlib.pyplot as plt

    means, expected = one_noise_for_all()
    turned_frame()
    tracks = unfinished()
    known, ratios, paper = attitudes()
    figure, panels = plt.subplots(1, 3, figsize=(14, 4.2), layout="constrained")
    panels[0].hist(means / expected, bins=np.arange(-4, 4.1, 0.5), color="#0b5394", label="A to C")
    away = np.concatenate([of("D", "omega", 0), of("D", "a", 0) - [4.3, 0, 0]]) / np.concatenate(
        [of("D", "omega", 1), of("D", "a", 1)]
    )
    panels[0].set_title(f"case D: {np.abs(away).min() * 10:.0f} to {np.abs(away).max() * 10:.0f}", fontsize=12)
    panels[0].set_xlabel("mean of ω or ã less truth, in standard errors", fontsize=12)
    panels[0].set_ylabel("components", fontsize=12)
    for (first, (bias, scatter)), colour in zip(tracks.items(), ("#c55a11", "#38761d"), strict=True):
        steps = np.arange(1, len(bias) + 1)
        panels[1].semilogy(steps, bias, color=colour, label=f"bias, {first} first")
        panels[1].semilogy(steps, scatter, color=colour, linestyle="--", label=f"scatter, {first} first")
    panels[1].axhline(np.linalg.norm((of("D", "a", 0) - [4.3, 0, 0]) / of("D", "a", 2)), color="0.3", linewidth=0.8)
    panels[1].axhline(paper["D"], color="0.3", linewidth=0.8, linestyle="--")
    panels[1].set_xlabel("iteration", fontsize=12)
    panels[1].set_ylabel("acceleration, in formal errors", fontsize=12)
    panels[1].annotate("the paper's bias", (1, 17), fontsize=10)
    panels[1].annotate("the paper's scatter", (60, 0.62), fontsize=10)
    panels[1].set_ylim(0.05, 2e4)
    panels[1].legend(frameon=False, fontsize=10)
    panels[2].loglog(known, ratios, "o-", color="#0b5394")
    panels[2].axhspan(paper["D"] * 0.96, paper["D"] * 1.04, color="0.85")
    panels[2].annotate("the paper's case D", (10, paper["D"] * 0.93), fontsize=11, va="center")
    panels[2].set_yticks([1, 1.5, 2, 3], ["1", "1.5", "2", "3"])
    panels[2].set_yticks([], minor=True)
    panels[2].set_xlabel("attitude known to [µas]", fontsize=12)
    panels[2].set_ylabel("true / formal error of ã", fontsize=12)
    for panel in panels:
        panel.spines[["top", "right"]].set_visible(False)
    figure.savefig(FIGURE, dpi=110)


if __name__ == "__main__":
    main()
