"""A solution as a page of text."""

import numpy as np

from fit.spectrum import spectrum

WIDTH = 88


def report(solution, check=None, truth=None, source=None):
    """Summarise a solution for a human; returns the text and prints nothing.

    Parameters
    ----------
    solution : Solution
    check : CrossCheck, optional — both solvers at degree 1, from `fit.cross_check`
    truth : dict of str to Vector, optional — "spin" and "acceleration" of a simulated
        catalogue, printed beside what was found
    source : str, optional — what was fitted

    Returns
    -------
    str
    """
    sections = [_heading(solution, source), _vectors(solution, truth or {}), _degrees(solution)]
    if check is not None:
        sections.append(_check(check))
    if solution.notes:
        sections.append("Notes\n" + "\n".join(f"  - {note}" for note in solution.notes))
    return "\n\n".join(sections) + "\n"


def _heading(solution, source):
    modes = solution.modes
    lines = ["Vector spherical harmonics of proper motions", "─" * WIDTH]
    if source:
        lines.append(f"catalogue      {source}")
    lines += [
        f"sources        {solution.n_data // 2}",
        f"frame          {solution.frame}",
        f"degree         1 to {modes.lmax}: {len(modes)} coefficients",
        f"χ²/dof         {solution.chi2:.6g} / {solution.dof} = {solution.reduced_chi2:.3f}",
    ]
    if solution.errors_from != "the catalogue":
        lines.append(f"errors from    {solution.errors_from}")
    elif solution.reduced_chi2 > 1.5:
        factor = np.sqrt(solution.reduced_chi2)
        lines.append(
            f"careful        errors below are the catalogue's: its residuals ask for {factor:.2f} times as much,"
        )
        lines.append("               and so do chances, which are too small")
    if solution.dof < len(solution.modes):
        lines.append("careful        fewer numbers to spare than parameters: small errors here may mean little")
    return "\n".join(lines)


def _vectors(solution, truth):
    header = f"{'[µas/yr]':14}{'x':>16}{'y':>16}{'z':>16}{'amplitude':>18}"
    lines = [header]
    for name, vector in (("spin", solution.spin), ("acceleration", solution.acceleration)):
        lines.append(name.ljust(14) + _row(vector))
        if name in truth:
            true = truth[name].to_frame(vector.frame)
            away = (vector.value - true.value) / vector.sigma
            cells = "".join(f"{t:+9.3f} ({d:+.1f}σ)".rjust(16) for t, d in zip(true.value, away))
            lines.append("  truth".ljust(14) + cells + f"{true.amplitude:9.3f}")
    lines.append("")
    for name, vector in (("spin", solution.spin), ("acceleration", solution.acceleration)):
        lines.append(f"{name:14}toward {direction(vector)}")
        other = "galactic" if vector.frame != "galactic" else "icrs"
        lines.append(
            f"{'':14}       {direction(vector.to_frame(other))}; amplitude less noise {vector.debiased_amplitude:.3f}"
        )
    return "\n".join(lines)


def _row(vector):
    return components(vector) + f"{vector.amplitude:9.3f} ±{vector.amplitude_error:6.3f}".rjust(18)


def components(vector):
    """Three components with their errors, in one line."""
    return "".join(f" {v:+8.3f} ±{s:6.3f}".rjust(16) for v, s in zip(vector.value, vector.sigma))


def direction(vector):
    """Longitude and latitude with their errors, named after the frame."""
    names = {"icrs": ("α", "δ"), "galactic": ("l", "b"), "ecliptic": ("λ", "β")}[vector.frame]
    pairs = zip(names, vector.direction, vector.direction_error)
    return ", ".join(f"{name} = {value:+6.1f} ± {error:.1f}°" for name, value, error in pairs)


def _degrees(solution):
    lines = [
        "Power by degree, ∫|V|²dΩ [(µas/yr)²]: as fitted, less what noise alone gives, its error;",
        "chance of as much from noise (exact χ², any sky), and Mignard & Klioner's Z (even sky)",
        f"{'':8}{'power':>13}{'less noise':>13}{'±':>11}{'√power':>9}{'chance':>11}{'z':>8}{'M&K Z':>8}",
    ]
    for d in spectrum(solution):
        lines.append(
            f"{d.kind}{d.l:<7}{d.power:13.5g}{d.debiased:13.5g}{d.error:11.3g}{np.sqrt(d.power):9.3g}"
            f"{_chance(d.p):>11}{d.z:8.2f}{d.mk_z:8.2f}"
        )
    return "\n".join(lines)


def _chance(p):
    return f"{p:.4f}" if p > 1e-3 else f"{p:.1e}" if p > 0 else "<1e-300"


def _check(check):
    lines = [
        f"Cross-check: plain least squares of degree 1 alone on the same {check.direct.n_data // 2} sources, with the catalogue's",
        "errors, by two solvers without a common formula",
        f"{'[µas/yr]':26}{'x':>16}{'y':>16}{'z':>16}",
    ]
    for name in ("spin", "acceleration"):
        for solver, result in (("harmonics", check.harmonics), ("frame, QR", check.direct)):
            lines.append(f"{name:14}{solver:12}{components(getattr(result, name))}")
    lines.append(f"largest difference: {check.largest:.1e} σ")
    return "\n".join(lines)
