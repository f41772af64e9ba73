"""
What an attitude that is solved does to errors
==============================================

A catalogue quotes the error of each source by itself. The satellite's attitude is found from the same sources, and its
errors are shared by all that are seen at a time. How much larger are the true errors of an acceleration?
"""

import matplotlib.pyplot as plt
import numpy as np

import sim
from sim import agis
from vsh.figures.plot import COLOURS, STYLE

# %%
# Three thousand quasars, with fields and knots as if they were half a million: as many sources in a field, and as many
# transits in an interval of the attitude, as the whole mission has.

law = sim.NominalScanningLaw()
quasars = sim.quasars(3000, rng=1)
sigma = sim.Mission(law, "DR4").transit_error(quasars.magnitude)


def ratio(**options):
    """True over formal error of the acceleration; exact, no noise is drawn."""
    system, _ = agis.joint_system(law, quasars.lon, quasars.lat, sigma, **options)
    formal, true = system.formal_covariance(1), system.true_covariance(1)
    return np.sqrt(np.trace(true[3:, 3:]) / np.trace(formal[3:, 3:]))


known = [10.0, 100.0, 300.0, 1000.0, 3000.0]
ratios = [ratio(prior=each) for each in known]
solved = ratio()
print("attitude known to", dict(zip(known, np.round(ratios, 3).tolist(), strict=True)))
print(f"solved from the quasars alone: {solved:.2f}")

# %%
# With an attitude known to 10 µas sources may be taken one by one. Solved from the quasars alone, in knots of 30 s, it nearly
# doubles the error of the acceleration, and with more quasars somewhat more than that.

plt.rcParams.update(STYLE)
figure, ax = plt.subplots()
ax.semilogx(known, ratios, "o-", color=COLOURS[0], label="known")
ax.axhline(solved, color=COLOURS[1], label="solved from the quasars")
ax.set_xlabel("attitude known to [µas]")
ax.set_ylabel("true / formal error")
ax.legend()
plt.savefig("joint_solution.png", dpi=300)

# %%
# One draw of the noise, solved: systematic errors.

solution, system, _ = agis.solve_mission(law, quasars.lon, quasars.lat, sigma, rng=2)
print(f"{solution.iterations} iterations, degrees 1 to 3 at rest: {solution.converged}")

distance = np.abs(solution.history - solution.history[-1])[:-1] / np.sqrt(np.diag(solution.formal_low))
figure, ax = plt.subplots()
for degree, colour in zip(range(1, solution.modes.lmax + 1), COLOURS, strict=False):
    largest = distance[:, solution.modes.degrees == degree].max(axis=1)
    ax.semilogy(1 + np.arange(len(largest)), largest, color=colour, label=f"degree {degree}")
ax.axhline(0.05, color="0.3", linewidth=0.6, label="0.05: converged")
ax.set(xlabel="iteration", ylabel="distance from the last [formal errors]")
ax.legend()
figure.savefig("joint_convergence.png", dpi=300)

# %%
# True over formal errors of the five parameters by magnitude, from this draw of the noise.

magnitude = quasars.magnitude[solution.solved]
edges = np.arange(np.floor(magnitude.min()), np.ceil(magnitude.max()) + 1)
group = np.digitize(magnitude, edges) - 1
counts = np.bincount(group, minlength=len(edges) - 1)
figure, ax = plt.subplots()
for column, name in enumerate(("α*", "δ", "ϖ", "$µ_{α*}$", "$µ_δ$")):
    pulls = solution.sources[solution.solved, column] / np.sqrt(solution.formal[solution.solved, column, column])
    true = np.sqrt(np.bincount(group, pulls**2, len(edges) - 1) / np.maximum(counts, 1))
    place = edges[:-1] + 0.5 + 0.04 * (column - 2)
    ax.errorbar(place, true, true / np.sqrt(2 * np.maximum(counts, 1)), fmt="os^Dv"[column], label=name)
ax.axhline(1, color="0.3", linewidth=0.6)
ax.set(xlabel="G  [mag]", ylabel="true / formal error", yscale="log")
ax.set_yticks([1, 2, 5, 10], ["1", "2", "5", "10"], minor=False)
ax.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=5)
figure.savefig("joint_errors.png", dpi=300)
