"""How often Student's t finds what is not there, where a few sources of an uneven sky decide on a vector.

    python benchmarks/student_on_uneven_skies.py [SKIES]

Skies of 5000 quasars with the errors of DR5, Gaussian, all over the sky and where the surveys before Gaia found them (IGQL), without
any signal. Printed are the scatter of the spin's errors over those of least squares, the degrees of freedom that it stands
for, those that the fit states, and the shares of p-values of spin and acceleration below 0.05 and 0.0027.
"""

import sys
import warnings

import numpy as np

import fit
import sim
from sim.expected import errors_by_place


def main(n_skies=200):
    warnings.simplefilter("ignore")
    fits = {
        "least squares": fit.fit_field,
        "Student's t": lambda field, lmax: fit.robust.student_t(field, lmax).solution,
        "recommended": lambda field, lmax: fit.recommended(field, lmax).solution,
    }
    mission = sim.Mission(sim.NominalScanningLaw(years=10.0), "DR5")
    for sky in ("uniform", "igql"):
        quasars = sim.quasars(5000, 7, sky)
        errors, rho = errors_by_place(quasars.magnitude, quasars.lon, quasars.lat, mission)
        first = sim.observe(quasars, sim.spin((0, 0, 0)), 1, sigma=errors, rho=np.zeros_like(rho))
        for lmax in (1, 3, 5):
            p_values, ratios, dofs = {name: [] for name in fits}, [], []
            for seed in range(n_skies):
                noise = np.random.default_rng([seed, lmax]).normal(size=first.motion.shape) * first.sigma
                field = first.minus(first.motion - noise)
                solutions = {name: fitted(field, lmax) for name, fitted in fits.items()}
                for name, solution in solutions.items():
                    p_values[name] += [solution.spin.p_value, solution.acceleration.p_value]
                spins = [solutions[name].spin for name in ("Student's t", "least squares")]
                ratios.append(np.mean(np.diag(spins[0].covariance) / np.diag(spins[1].covariance)))
                dofs.append(solutions["Student's t"].dof_of_degree("T", 1))
            scatter = np.std(ratios) / np.mean(ratios)
            print(
                f"{sky}, degree {lmax}: variances scatter by {scatter:.3f}, as {2 / scatter**2:.0f} degrees of freedom"
            )
            print(f"  stated: {np.mean(dofs):.0f}")
            for name, each in p_values.items():
                shares = (np.mean(np.array(each) < level) for level in (0.05, 0.0027))
                print(f"  {name:14}", *(f"{share:.3f}" for share in shares), flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
