"""Velocities, Hubble constants and redshift bins as text."""

import numpy as np
from scipy.special import chdtrc

from fit.report import WIDTH, components, direction
from vsh.apex import PLANCK

#: A chance below this is called a difference; the Gaussian's three σ.
_REMARKABLE = 0.0027


def report_drift(solution, source=None, truth=None):
    """A velocity or a Hubble constant as text.

    Parameters
    ----------
    solution : VelocitySolution or HubbleSolution
    source : str, optional — what was fitted
    truth : dict, optional — "velocity" and "hubble" of a simulated catalogue, printed beside what was found

    Returns
    -------
    str
    """
    velocity = hasattr(solution, "velocity")
    lines = [
        "Our velocity from the drift of galaxies" if velocity else "The Hubble constant from the drift of galaxies"
    ]
    lines += ["─" * WIDTH]
    if source:
        lines.append(f"catalogue      {source}")
    lines += [
        f"sources        {solution.n_data // 2}",
        f"frame          {solution.frame}",
        f"peculiar       {solution.peculiar:g} km/s in each component, in the weights",
        f"χ²/dof         {solution.chi2:.6g} / {solution.dof} = {solution.chi2 / solution.dof:.3f}",
    ]
    if solution.chi2 > 1.5 * solution.dof:
        factor = np.sqrt(solution.chi2 / solution.dof)
        lines.append(
            f"careful        the residuals ask for errors {factor:.2f} times those below; chances allow for that"
        )
    rows = _velocity(solution) if velocity else _hubble(solution)
    if truth and "velocity" in truth:
        rows.insert(2, _truth(solution, truth))  # below the components, or H0
    lines += ["", *rows, ""]
    a = solution.acceleration
    lines.append(f"{'acceleration':14}{components(a)}  |ã| = {a.amplitude:.3f} ± {a.amplitude_error:.3f} µas/yr")
    lines.append(f"{'':14}toward {direction(a.to_frame('galactic'))}")
    lines += ["", "Correlations", f"{'':8}" + "".join(f"{name:>8}" for name in solution.names)]
    for name, row in zip(solution.names, solution.correlation, strict=True):
        lines.append(f"{name:8}" + "".join(f"{value:+8.3f}" for value in row))
    return "\n".join([*lines, *_notes(solution.notes)]) + "\n"


def _velocity(solution):
    v = solution.velocity
    galactic = v.to_frame("galactic")
    scale = _scale(solution.chi2 / solution.dof)
    chi2 = solution.against(PLANCK)[0] / scale
    none = float(v.value @ np.linalg.solve(v.covariance, v.value)) / scale
    return [
        f"for H0 = {solution.assumed_hubble:g} km/s/Mpc; toward the apex (sources drift toward the antapex) [km/s]",
        f"{'velocity':14}{components(v)}  |v| = {v.amplitude:.1f} ± {v.amplitude_error:.1f}",
        f"{'galactic':14}{components(galactic)}",
        f"{'apex':14}{direction(galactic)}; |v| less noise {v.debiased_amplitude:.1f}",
        f"chance of as much from no velocity: {chdtrc(3, none):.2g} (χ² = {none:.2f} for 3)",
        f"chance of as far from the microwave background's {PLANCK.amplitude:.1f} km/s: {chdtrc(3, chi2):.2g} (χ² = {chi2:.2f} for 3)",
    ]


def _truth(solution, truth):
    """The true value in the units of the result: of the product, for what was assumed."""
    true = truth["velocity"].to_frame(solution.frame)
    if hasattr(solution, "velocity"):
        expected = true.value * truth["hubble"] / solution.assumed_hubble
        away = (solution.velocity.value - expected) / solution.velocity.sigma
        cells = "".join(f"{value:+9.3f} ({d:+.1f}σ)".rjust(16) for value, d in zip(expected, away, strict=True))
        note = "" if truth["hubble"] == solution.assumed_hubble else f" (simulated with H0 = {truth['hubble']:g})"
        return f"{'  truth':14}{cells}{note}"
    if not true.amplitude:
        return f"{'  truth':14}no velocity was simulated"
    return f"{'  truth':14}{truth['hubble']:.2f} ({(solution.hubble - truth['hubble']) / solution.hubble_error:+.1f}σ)"


def _hubble(solution):
    v = solution.assumed_velocity.to_frame("galactic")
    pull = solution.hubble / solution.hubble_error / np.sqrt(_scale(solution.chi2 / solution.dof))
    return [
        f"for a velocity of {v.amplitude:.2f} km/s toward {direction(v)}",
        f"{'H0':14}{solution.hubble:.2f} ± {solution.hubble_error:.2f} km/s/Mpc, {pull:.1f} standard errors from none",
    ]


def _scale(reduced_chi2):
    """What variances are multiplied with before anything is called a detection."""
    return reduced_chi2 if reduced_chi2 > 1.5 else 1.0


def report_bins(binned, velocity=PLANCK, chances=None):
    """Dipoles in bins of redshift as text: a table, and whether the bins differ.

    Parameters
    ----------
    binned : BinnedSolution
    velocity : Vector or None — whose drift the bins are compared with
    chances : dict, optional — from `fit.redshift.chances_by_shuffling`, printed beside the others and believed
    """
    lines = [f"Bins of redshift ({binned.frame} axes, degree 1 to {binned.modes.lmax})", "─" * WIDTH]
    lines.append(f"{'z':>17}{'sources':>9}{'χ²/dof':>8}{'spin':>26}{'acceleration [µas/yr]':>28}")
    for b, solution in enumerate(binned.solutions):
        edges = f"{binned.edges[b]:.4g} – {binned.edges[b + 1]:.4g}"
        for row, axis in enumerate("xyz"):
            left = f"{edges:>17}{binned.counts[b]:9d}{solution.reduced_chi2:8.2f}" if row == 0 else " " * 34
            cells = [f"{v.value[row]:+9.3f} ±{v.sigma[row]:7.3f}" for v in (solution.spin, solution.acceleration)]
            lines.append(f"{left}   {axis}{cells[0]:>22}{cells[1]:>27}")
    scale = _scale(binned.reduced_chi2)
    if scale > 1:
        lines.append(
            f"careful: residuals ask for errors {np.sqrt(scale):.2f} times the catalogue's; χ² below are with those"
        )
    lines.append("")
    tests = {"T": ("spin alike in all bins", binned.equality("T", 1))}
    tests["S"] = ("acceleration alike in all bins", binned.equality("S", 1))
    if len(binned) > 1:
        tests["trend"] = ("no slope of either with redshift", binned.trend().test)
    if velocity is not None and np.isfinite(binned.nearness).all():
        tests["drift"] = (f"constant ã − v/d, |v| = {velocity.amplitude:.0f} km/s", binned.drift(velocity)[1])
    for key, (name, test) in tests.items():
        if test.dof == 0:
            continue
        p = float(chdtrc(test.dof, test.chi2 / scale))
        line = f"{name:36}χ² = {test.chi2 / scale:8.2f} for {test.dof:3d}, chance {p:8.2g}"
        if chances and key in chances:
            p = chances[key]
            line += f", by shuffling redshifts {p:6.3f}"
        lines.append(f"{line}: {'contradicted' if p < _REMARKABLE else 'not contradicted'}")
    return "\n".join([*lines, *_notes(binned.notes)]) + "\n"


def _notes(notes):
    return ["", "Notes", *(f"  - {note}" for note in notes)] if notes else []
