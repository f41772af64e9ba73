"""Velocities and Hubble constants as text."""

from dataclasses import replace
from typing import Any

import numpy as np
from scipy.special import chdtrc

from fit.output import amplitude, components, direction, is_seen, note_lines, p_value, pulls
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18
from vsh.tools.printing import printable
from vsh.tools.units import SPEED_OF_LIGHT


def text_of(solution: Any, source: str | None = None, truth: dict[str, Any] | None = None, long: bool = False) -> str:
    """A velocity or a Hubble constant as text."""
    velocity = hasattr(solution, "velocity")
    what = "Our velocity" if velocity else "The Hubble constant"
    quality = solution.quality
    named = f"{printable(source)}: " if source else ""
    fitted = f", χ²/dof = {quality.reduced:.3f}" if np.isfinite(quality.reduced) else ""
    lines = [
        f"{what} from the secular parallax of galaxies: {_cosmic(solution)}",
        f"{named}{solution.n_sources} sources, {solution.frame} axes{fitted}",
    ]
    is_warned, about = _dispersion(solution)
    if long:
        lines.append(
            f"dispersion     {solution.peculiar_dispersion:g} km/s of peculiar velocities in each component, in the "
            "weights" + (", beside the flow" if solution.flow is not None else "")
        )
    if long or is_warned:
        lines += about
    if np.isnan(solution.values).all():
        lines += ["", "errors that a fit would have"]
        lines += [f"{name:14}{sigma:>12.4g}" for name, sigma in zip(solution.names, solution.sigma, strict=True)]
        return "\n".join([*lines, *_correlations(solution), *note_lines(solution.notes)]) + "\n"
    if long:
        lines.append(f"χ²/dof         {solution.chi2:.6g} / {solution.dof}")
    if quality.warning():
        lines.append(f"warning        {quality.warning()}")
        if quality.factor > 1:
            lines.append("               errors below are as quoted; p-values are given for both")
    if velocity and solution.velocity.amplitude > SPEED_OF_LIGHT:
        lines.append("warning        faster than light: are redshifts and motions in the unit that was taken?")
    rows = _velocity(solution, quality, long) if velocity else _hubble(solution, quality)
    if truth and "velocity" in truth:
        rows.insert(2 if velocity else len(rows), _truth(solution, truth))  # below the components, or H0
    lines += ["", *rows] + [""] * long
    a = solution.acceleration
    lines.append(f"{'acceleration':14}{_cells(components(a))}  |ã| {_equal(amplitude(a))} µas/yr")
    if truth and "acceleration" in truth:
        true = truth["acceleration"].to_frame(solution.frame)
        pairs = zip(true.value, pulls(a, true), strict=True)
        lines.append(f"{'  truth':14}{_cells(f'{value:+.3f} ({away:+.1f}σ)' for value, away in pairs)}")
    if is_seen(a) and (long or velocity):
        lines.append(f"{'':14}{direction(a.to_frame('galactic'))}")
    correlations = _correlations(solution) if long else []
    return "\n".join([*lines, *_left_out(solution), *correlations, *note_lines(solution.notes)]) + "\n"


def _dispersion(solution):
    """Whether the residuals contradict the dispersion, and what they say of it."""
    preferred = solution.preferred
    if preferred is None:
        return False, []
    if solution.quality.factor > 1.2:
        return False, ["               the residuals do not tell it: they contradict the errors themselves"]
    if not preferred.constrained:
        return False, ["               the residuals do not tell it"]
    prefer = f"the residuals prefer {preferred.low:.0f} to {preferred.high:.0f} km/s (68 %)"
    if preferred.gain < 4.5:  # ln L of three standard deviations
        return False, [f"               {prefer}"]
    return True, [
        f"warning        {prefer}: results are biased where the dispersion is wrong,",
        '               --peculiar-dispersion free ("free") takes what they prefer',
    ]


def _left_out(solution):
    """The size of flows that errors leave out."""
    if solution.flow_covariance is None:
        return []
    size = np.sqrt(np.diag(solution.flow_covariance))
    first = (
        f"{size[0]:.0f} km/s/Mpc in H0"
        if solution.names[0] == "H0"
        else f"{np.sqrt(np.mean(size[:3] ** 2)):.0f} km/s in each component"
    )
    at = solution.names.index("a_x")
    glide = np.sqrt(np.mean(size[at : at + 3] ** 2))
    return [
        "",
        f"warning        not in the errors above: flows of linear theory, which galaxies share, add ± {first}",
        (
            f"               and ± {glide:.2g} µas/yr in each component of the acceleration; without --no-flows they "
            "are fitted"
        ),
    ]


def _cosmic(solution):
    """What flows that galaxies share do to the error."""
    if solution.flow is None and solution.flow_covariance is None:
        return "too far for flows that galaxies share"
    if solution.flow is None:
        return "errors without flows that galaxies share"
    modes = solution.flow.modes
    return (
        f"{100 * solution.cosmic_share:.0f} % of the error's variance is cosmic ({len(modes)} modes of "
        f"{modes.theory.name})"
    )


def _correlations(solution):
    lines = ["", "Correlations", f"{'':8}" + "".join(f"{name:>8}" for name in solution.names)]
    for name, row in zip(solution.names, solution.correlation, strict=True):
        lines.append(f"{name:8}" + "".join(f"{value:+8.3f}" for value in row))
    return lines


def _velocity(solution, quality, long):
    v = solution.velocity
    galactic = v.to_frame("galactic")
    from_planck = solution.against(CMB_VELOCITY_PLANCK18)[0]
    from_none = float(v.value @ np.linalg.solve(v.covariance, v.value))
    lines = [
        f"for H0 = {solution.assumed_hubble:g} km/s/Mpc; toward the apex (galaxies move toward the antapex) [km/s]",
        f"{'velocity':14}{_cells(components(v))}  |v| {_equal(amplitude(v))}",
    ]
    if not long:
        return [*lines, *([f"{'apex':14}{direction(galactic)}"] if is_seen(v) else [])]
    return [
        *lines,
        f"{'galactic':14}{_cells(components(galactic))}",
        f"{'apex':14}{direction(galactic)}"
        + (f"; noise-debiased |v| {v.debiased_amplitude:.1f}" if is_seen(v) else ""),
        f"zero velocity: {_both(from_none, 3, quality)}",
        f"the microwave background's {CMB_VELOCITY_PLANCK18.amplitude:.1f} km/s: {_both(from_planck, 3, quality)}",
    ]


def _both(chi2, dof, quality):
    """A χ² with its p-value as quoted, and with errors scaled where χ²/dof asks for it."""
    line = f"χ² = {chi2:.2f} for {dof}, p-value {p_value(chdtrc(dof, chi2))}"
    if quality.factor > 1:
        line += f"; with scaled errors {p_value(chdtrc(dof, chi2 / quality.factor**2))}"
    return line


def _equal(text):
    return text if text.startswith("<") else f"= {text}"


def _cells(cells):
    return "".join(f"{cell:>19}" for cell in cells)


def _truth(solution, truth):
    """The true value in the units of the result: of the product, for what was assumed."""
    true = truth["velocity"].to_frame(solution.frame)
    if hasattr(solution, "velocity"):
        expected = replace(true, value=true.value * truth["hubble"] / solution.assumed_hubble)
        away = pulls(solution.velocity, expected)
        cells = _cells(f"{value:+.1f} ({d:+.1f}σ)" for value, d in zip(expected.value, away, strict=True))
        note = "" if truth["hubble"] == solution.assumed_hubble else f" (simulated with H0 = {truth['hubble']:g})"
        return f"{'  truth':14}{cells}{note}"
    if not true.amplitude:
        return f"{'  truth':14}no velocity was simulated"
    return f"{'  truth':14}{truth['hubble']:.2f} ({(solution.hubble - truth['hubble']) / solution.hubble_error:+.1f}σ)"


def _limits(low, high):
    if high <= 0:
        return "negative, beyond its 95 % limit: no positive one is allowed by the motions"
    lower = f"above {low:.1f} with 95 % (one-sided)" if low > 0 else "without a limit from below"
    return f"below {high:.1f} km/s/Mpc with 95 %, {lower}"


def _hubble(solution, quality):
    v = solution.assumed_velocity.to_frame("galactic")
    pull = solution.hubble / solution.hubble_error
    if pull < 3:  # the error is no longer a ±
        product = (
            solution.assumed_velocity.amplitude * solution.hubble,
            solution.assumed_velocity.amplitude * solution.hubble_error,
        )
        return [
            f"for a velocity of {v.amplitude:.2f} km/s {direction(v)}",
            f"{'v · H0':14}{product[0]:.0f}, standard error {product[1]:.0f} (km/s)²/Mpc: {pull:.1f} of them from zero",
            f"{'H0':14}{_limits(*solution.hubble_limits)}; least squares {solution.hubble:.1f}",
        ]
    scaled = f"; {pull / quality.factor:.1f} with scaled errors" if quality.factor > 1 else ""
    return [
        f"for a velocity of {v.amplitude:.2f} km/s {direction(v)}",
        (
            f"{'H0':14}{solution.hubble:.2f} ± {solution.hubble_error:.2f} km/s/Mpc, {pull:.1f} standard errors from "
            f"zero{scaled}"
        ),
    ]
