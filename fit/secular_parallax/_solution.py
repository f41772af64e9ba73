"""Our velocity or the Hubble constant as a least-squares fit has them, with the acceleration, and as text.

The motions of near galaxies scatter by σ_pec/d. The likelihood of that dispersion, with velocity, acceleration and flow
marginalised, is taken on a grid: of the sources that tell most of it, those with the largest k/σ, which are chosen by
their distances and errors and not by their motions.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import chdtrc, ndtr, ndtri

from fit.results.output import format_amplitude, format_components, format_direction, is_seen, p_value, pulls
from fit.results.solution import NamedSolution
from fit.secular_parallax._equations import (
    OMEGA,
    Flow,
    ParallaxEquations,
    V,
    add_acceleration_prior,
    add_flow_prior,
    add_vector_prior,
    marginalise_flow,
    subtract_known_motions,
)
from vsh import Coefficients
from vsh.field import Field
from vsh.io import tables
from vsh.io.sections import Section
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, transverse_distance
from vsh.sky.sphere import triad
from vsh.tools.digits import format_with_error
from vsh.tools.printing import printable
from vsh.tools.types import FloatArray, Table
from vsh.tools.units import AU_PER_YEAR, SPEED_OF_LIGHT
from vsh.vector import Vector

#: A velocity of ours above this, ten times that of the Sun, is doubted. [km/s]
_FASTEST_PLAUSIBLE = 3000.0


def doubt_speed(velocity: Vector) -> str:
    """Ask for the units where a velocity is seen that is beyond any of ours; else nothing."""
    if not (is_seen(velocity) and velocity.amplitude > _FASTEST_PLAUSIBLE):
        return ""
    speed_text = "faster than light" if velocity.amplitude > SPEED_OF_LIGHT else f"above {_FASTEST_PLAUSIBLE:g} km/s"
    return f"{speed_text}: are redshifts, H0 and motions in the unit that was taken?"


def _make_vectors_table(solution, truth, long):
    """Velocity and acceleration by component, with the truth of a simulation, as a table of text."""
    rows = []
    if hasattr(solution, "velocity"):
        v = solution.velocity
        rows.append(("velocity [km/s]", *format_components(v), format_amplitude(v)))
        if "velocity" in truth:
            true = truth["velocity"].to_frame(solution.frame)
            expectation = replace(true, value=true.value * truth["hubble"] / solution.assumed_hubble)
            is_other = truth["hubble"] != solution.assumed_hubble
            rows.append(_make_true_row(v, expectation, "+.1f", f"(simulated with H0 = {truth['hubble']:g})" * is_other))
        if long:
            rows.append(("  galactic axes", *format_components(v.to_frame("galactic")), ""))
    a = solution.acceleration
    rows.append(("acceleration [µas/yr]", *format_components(a), format_amplitude(a)))
    if "acceleration" in truth:
        rows.append(_make_true_row(a, truth["acceleration"].to_frame(solution.frame), "+.3f"))
    return tables.table_of_rows(("vector", "x", "y", "z", "amplitude"), rows)


def _make_true_row(vector, true, form, remark=""):
    cells = (f"{x:{form}} ({pull:+.1f}σ)" for x, pull in zip(true.value, pulls(vector, true), strict=True))
    return ("  truth", *cells, remark)


def _judge_assumed_dispersion(solution):
    """Return whether the residuals contradict the dispersion, with words."""
    preference = solution.preferred
    if preference is None:
        return False, ""
    if solution.quality.factor > 1.2:
        return False, "do not determine the dispersion: they contradict the errors themselves"
    if not preference.constrained:
        return False, "do not determine the dispersion"
    preferred_range = f"prefer {preference.low:.0f} to {preference.high:.0f} km/s (68 %)"
    if preference.gain < 4.5:  # ln L of three standard deviations
        return False, preferred_range
    remedy_text = "peculiar_dispersion= (--dispersion) takes another, and fit.posterior.sample has it free"
    return True, f"the residuals {preferred_range}: results are biased where the dispersion is wrong, {remedy_text}"


def _note_omitted_flow(solution):
    """The size of flows that errors leave out."""
    if solution.flow_covariance is None:
        return []
    flow_errors = np.sqrt(np.diag(solution.flow_covariance))
    first_error_text = (
        f"{flow_errors[0]:.0f} km/s/Mpc in H0"
        if solution.names[0] == "H0"
        else f"{np.sqrt(np.mean(flow_errors[:3] ** 2)):.0f} km/s in each component"
    )
    start = solution.names.index("a_x")
    glide_error = np.sqrt(np.mean(flow_errors[start : start + 3] ** 2))
    return [
        f"warning: not in the errors above: flows of linear theory, which galaxies share, add ± {first_error_text} and "
        f"± {glide_error:.2g} µas/yr in each component of the acceleration; without --flows no they are fitted"
    ]


def _describe_flow_share(solution):
    """Share of flows in the error, in words."""
    if solution.flow is None and solution.flow_covariance is None:
        return "too far for coherent flows"
    if solution.flow is None:
        return "errors without coherent flows"
    modes = solution.flow.modes
    share_text = f"{100 * solution.cosmic_share:.0f} % of the error's variance is due to coherent flows"
    return f"{share_text} ({len(modes)} modes of {modes.theory.name})"


def _list_velocity_facts(solution, quality, long):
    v, galactic = solution.velocity, solution.velocity.to_frame("galactic")
    direction_text = "toward the apex (galaxies move toward the antapex)"
    facts = [("velocity", f"for H0 = {solution.assumed_hubble:g} km/s/Mpc, {direction_text}")]
    if is_seen(v) or long:
        remark = f"; noise-debiased |v| {v.debiased_amplitude:.1f}" if is_seen(v) and long else ""
        facts.append(("apex", f"{format_direction(galactic)}{remark}"))
    if long:
        chi2_of_planck = solution.against(CMB_VELOCITY_PLANCK18)[0]
        chi2_of_zero = float(v.value @ np.linalg.solve(v.covariance, v.value))
        facts.append(("test of zero velocity", _format_chi2_and_p_value(chi2_of_zero, 3, quality)))
        prefix = f"{CMB_VELOCITY_PLANCK18.amplitude:.1f} km/s relative to the microwave background: "
        facts.append(("test of Planck's velocity", prefix + _format_chi2_and_p_value(chi2_of_planck, 3, quality)))
    return facts


def _format_chi2_and_p_value(chi2, dof, quality):
    """A χ² with its p-value as quoted, and with errors scaled where χ²/dof asks for it."""
    chi2_text = f"χ² = {chi2:.2f} for {dof}, p-value {p_value(chdtrc(dof, chi2))}"
    if quality.factor > 1:
        chi2_text += f"; with scaled errors {p_value(chdtrc(dof, chi2 / quality.factor**2))}"
    return chi2_text


def _describe_hubble_limits(lower_limit, upper_limit):
    lower = f"above {lower_limit:.1f} with 95 % (one-sided)" if lower_limit > 0 else "without a limit from below"
    return f"below {upper_limit:.1f} km/s/Mpc with 95 %, {lower}"


def _list_hubble_facts(solution, quality, truth):
    v = solution.assumed_velocity.to_frame("galactic")
    hubble_in_errors = solution.hubble / solution.hubble_error
    facts = [("velocity", f"{v.amplitude:.2f} km/s {format_direction(v)}, assumed")]
    if hubble_in_errors < 3:  # the error is no longer a ±
        product, error = (v.amplitude * value for value in (solution.hubble, solution.hubble_error))
        value_text = f"{product:.0f}, standard error {error:.0f} (km/s)²/Mpc: {hubble_in_errors:.1f} of them from zero"
        facts.append(("v · H0", value_text))
        facts.append(("H0", f"{_describe_hubble_limits(*solution.hubble_limits)}; least squares {solution.hubble:.1f}"))
    else:
        remark = f"; {hubble_in_errors / quality.factor:.1f} with scaled errors" if quality.factor > 1 else ""
        value_text = f"{format_with_error(solution.hubble, solution.hubble_error)} km/s/Mpc"
        facts.append(("H0", f"{value_text}, {hubble_in_errors:.1f} standard errors from zero{remark}"))
    if truth and "velocity" in truth:
        true_hubble = truth["hubble"]
        truth_text = f"{true_hubble:.2f} ({(solution.hubble - true_hubble) / solution.hubble_error:+.1f}σ)"
        facts.append(("truth", truth_text if truth["velocity"].amplitude else "no velocity was simulated"))
    return facts


#: Dispersions that are tried. [km/s]
GRID = np.array([0.0, 40.0, 80.0, 120.0, 160.0, 210.0, 270.0, 350.0, 450.0, 600.0, 800.0, 1050.0, 1400.0])
_MOST_SENSITIVE_SOURCES = 4000


@dataclass(frozen=True)
class PreferredDispersion:
    """The dispersion that the residuals prefer."""

    best: float
    low: float
    high: float
    gain: float

    @property
    def constrained(self) -> bool:
        """Return whether residuals constrain it: 68 % of the likelihood within a third of what was tried, not at its
        end."""
        return self.high - self.low < GRID[-1] / 3 and self.high < 0.95 * GRID[-1]


def find_preferred_dispersion(
    equations: ParallaxEquations,
    assumed_dispersion: float,
    excess_noise: float,
    acceleration: Vector | None,
    ratio: float,
    spin: Literal["free"] | Vector | None = None,
) -> PreferredDispersion:
    """Find the dispersion that residuals prefer; `assumed_dispersion` is that of the estimate. [km/s]"""
    few = equations.select_most_sensitive(_MOST_SENSITIVE_SOURCES)
    sums = add_acceleration_prior(few.sums(GRID * ratio, excess_noise, ratio=ratio), acceleration, equations.frame)
    if equations.modes is not None:
        sums, _ = marginalise_flow(
            add_flow_prior(sums, few.design.shape[1], np.full(len(GRID), ratio)), few.design.shape[1]
        )
    is_free = spin is not None
    if isinstance(spin, Vector):
        known = spin.to_frame(equations.frame)
        is_free = bool(np.linalg.det(known.covariance) > 0)
        sums = add_vector_prior(sums, known, OMEGA) if is_free else subtract_known_motions(sums, known.value, OMEGA)
    parameters = slice(0, OMEGA.stop if is_free else OMEGA.start)
    columns = np.r_[parameters, V] if sums.matrix[:, V].any() else np.r_[parameters]
    matrix, rhs = sums.matrix[:, columns[:, None], columns], sums.rhs[:, columns]
    matrix = matrix + 1e-12 * np.trace(matrix, axis1=1, axis2=2)[:, None, None] * np.eye(matrix.shape[1])
    chi2 = sums.chi2_null - np.einsum("gi,gi->g", rhs, np.linalg.solve(matrix, rhs[..., None])[..., 0])
    log_likelihood = -(chi2 + sums.logdet + np.linalg.slogdet(matrix)[1]) / 2
    return _summarise_dispersion_likelihood(log_likelihood, assumed_dispersion)


def _summarise_dispersion_likelihood(log_likelihood: FloatArray, assumed_dispersion: float) -> PreferredDispersion:
    """Summarise ln L on the grid."""
    log_likelihood_curve = CubicSpline(GRID, log_likelihood)
    dispersions = np.linspace(0, GRID[-1], 1401)
    fine_log_likelihoods = log_likelihood_curve(dispersions)
    best_index = int(np.argmax(fine_log_likelihoods))
    cumulative = np.cumsum(np.exp(fine_log_likelihoods - fine_log_likelihoods[best_index]))
    lower, upper = np.interp([0.15865525, 0.84134475], cumulative / cumulative[-1], dispersions)
    gain = fine_log_likelihoods[best_index] - float(log_likelihood_curve(min(assumed_dispersion, GRID[-1])))
    return PreferredDispersion(float(dispersions[best_index]), float(lower), float(upper), float(max(gain, 0.0)))


@dataclass(frozen=True, eq=False, kw_only=True)
class ParallaxSolution(NamedSolution):
    """Base of both fits.

    Attributes
    ----------
    names : tuple of str
        v_x v_y v_z, or H0; a_x a_y a_z; omega_x … where the spin is free.
    values : (p,) array
        [km/s, or km/s/Mpc; µas/yr]
    covariance : (p, p) array
    chi2 : float
    n_data : int
        Two a source.
    frame : str
        Frame of the axes.
    peculiar_dispersion : float
        The dispersion of peculiar velocities in each component, beside the flow, in the weights. [km/s]
    flow : Flow or None
        The velocities that galaxies share, as far as they were fitted.
    noise_covariance : (p, p) array or None
        The covariance that the solution would have if the flow were known.
    flow_covariance : (p, p) array or None
        What the flow of linear theory would add to the covariance, where it was left out (flows=None) and galaxies are
        near enough for one.
    preferred : PreferredDispersion or None
        What the residuals say of the dispersion; None for catalogues in parts.
    notes : tuple of str
    """

    peculiar_dispersion: float = 750.0
    flow: Flow | None = None
    noise_covariance: FloatArray | None = None
    flow_covariance: FloatArray | None = None
    preferred: PreferredDispersion | None = None

    @property
    def cosmic_share(self) -> float | None:
        """Share of the variance of v, or of H0, that is due to flows; None where none were fitted."""
        if self.flow is None or self.noise_covariance is None:
            return None
        size = 3 if self.names[0] == "v_x" else 1
        return float(1 - np.trace(self.noise_covariance[:size, :size]) / np.trace(self.covariance[:size, :size]))

    def to_table(self) -> Table:
        """Parameters with their errors, units and correlations as an astropy Table, a row each; tests in its meta."""
        table = super().to_table()
        table.meta |= self._collect_table_metadata() | {"n_sources": self.n_sources, "chi2": self.chi2, "dof": self.dof}
        units = {"v": "km / s", "H0": "km / (s Mpc)"}
        table.add_column([units.get(name.partition("_")[0], "uas / yr") for name in self.names], 3, "unit")
        return table

    def sections(
        self, *, long: bool = False, source: str | None = None, truth: dict[str, Any] | None = None
    ) -> tuple[Section, ...]:
        """The velocity or H0, and the acceleration.

        Parameters
        ----------
        long : bool
            Add the dispersion, tests of no velocity and of the velocity relative to the microwave background, and
            correlations.
        source : str, optional
            What was fitted.
        truth : dict, optional
            "velocity" and "hubble" of a simulated catalogue, printed below the fitted ones.
        """
        result: Any = self  # a velocity, or a Hubble constant
        is_velocity, quality = hasattr(result, "velocity"), self.quality
        quantity = "Our velocity" if is_velocity else "The Hubble constant"
        fit_quality = f", χ²/dof = {quality.reduced:.3f}" if np.isfinite(quality.reduced) else ""
        prefix = f"{printable(source)}: " if source else ""
        facts = [("sources", f"{prefix}{self.n_sources} sources, {self.frame} axes{fit_quality}")]
        facts.append(("flows", _describe_flow_share(self)))
        is_warned, verdict = _judge_assumed_dispersion(self)
        if long:
            suffix = ", with the flow" if self.flow is not None else ""
            text = f"{self.peculiar_dispersion:g} km/s of peculiar velocities in each component, in the weights{suffix}"
            facts.append(("dispersion", text))
        if verdict and (long or is_warned):
            facts.append(("warning" if is_warned else "residuals", verdict))
        correlation_columns = {"parameter": list(self.names)} | dict(zip(self.names, self.correlation.T, strict=True))
        forms = dict.fromkeys(self.names, "+.3f")
        below = Section("Correlations", (), tables.table_of(correlation_columns), forms=forms, notes=self.notes)
        if np.isnan(self.values).all():
            errors = tables.table_of({"parameter": list(self.names), "error": self.sigma})
            return (Section(f"{quantity} from the secular parallax of galaxies: errors of a fit", facts, errors), below)
        if long:
            facts.append(("χ²/dof", f"{self.chi2:.6g} / {self.dof}"))
        if quality.warning():
            remark = "; errors below are as quoted, p-values are given for both" if quality.factor > 1 else ""
            facts.append(("warning", f"{quality.warning()}{remark}"))
        if is_velocity and (doubt := doubt_speed(result.velocity)):
            facts.append(("warning", doubt))
        facts += _list_velocity_facts(self, quality, long) if is_velocity else _list_hubble_facts(self, quality, truth)
        a = self.acceleration
        if is_seen(a) and (long or is_velocity):
            facts.append(("acceleration", format_direction(a.to_frame("galactic"))))
        title = f"{quantity} from the secular parallax of galaxies"
        section = Section(title, facts, _make_vectors_table(self, truth or {}, long), remarks=_note_omitted_flow(self))
        return (section, below) if long else (replace(section, notes=self.notes),)

    def _collect_table_metadata(self):
        """p-values and limits by name."""
        return {}

    def _predict_motions(self, field, velocity, hubble):
        """Predict the motions by a velocity and H0, with acceleration and spin, (2, n)."""
        p, q, _ = triad(field.lon, field.lat)
        rate = 1 / (AU_PER_YEAR * transverse_distance(field.redshift, None, hubble=hubble))
        spin = self.spin
        vectors = Coefficients.from_vectors(np.zeros(3) if spin is None else spin.value, self.acceleration.value)
        return vectors.at(field.lon, field.lat) - np.stack([velocity @ p, velocity @ q]) * rate


@dataclass(frozen=True, eq=False, kw_only=True)
class VelocitySolution(ParallaxSolution):
    """Our velocity, for the Hubble constant in `assumed_hubble`. [km/s/Mpc]"""

    assumed_hubble: float = float("nan")

    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a `field`, (2, n). [µas/yr]

        With the default cosmology's shape of the distance; a spin that was held fixed is not in it.
        """
        return self._predict_motions(field, self.velocity.value, self.assumed_hubble)

    @property
    def velocity(self) -> Vector:
        """v, a Vector in km/s, toward the apex."""
        return self._make_vector("v", "km/s")

    @property
    def apex(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Galactic longitude and latitude of the apex, and their errors: two pairs. [deg]"""
        galactic = self.velocity.to_frame("galactic")
        return galactic.direction, galactic.direction_error

    def _collect_table_metadata(self):
        return {
            "assumed_hubble": self.assumed_hubble,
            "p_value_zero": self.velocity.p_value,
            "p_value_microwave_background": self.against()[1],
        }

    def against(self, velocity: Vector = CMB_VELOCITY_PLANCK18) -> tuple[float, float]:
        """χ² of the difference from another `velocity` [km/s] (its own errors included), and its p-value."""
        ours, other = self.velocity, velocity.to_frame(self.frame)
        difference = ours.value - other.value
        chi2 = float(difference @ np.linalg.solve(ours.covariance + other.covariance, difference))
        return chi2, float(chdtrc(3, chi2))


@dataclass(frozen=True, eq=False, kw_only=True)
class HubbleSolution(ParallaxSolution):
    """The Hubble constant, for the velocity in `assumed_velocity` (a Vector, km/s)."""

    assumed_velocity: Vector = CMB_VELOCITY_PLANCK18

    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a `field`, (2, n). [µas/yr]

        With the default cosmology's shape of the distance; a spin that was held fixed is not in it.
        """
        return self._predict_motions(field, self.assumed_velocity.to_frame(self.frame).value, self.hubble)

    @property
    def hubble(self) -> float:
        """H0. [km/s/Mpc]"""
        return float(self.values[0])

    @property
    def hubble_error(self) -> float:
        """Its standard error; that of the velocity included. [km/s/Mpc]"""
        return float(self.sigma[0])

    @property
    def hubble_limits(self) -> tuple[float, float]:
        """Limits from below, zero at least, and from above, for a constant that is positive, 95 % each. [km/s/Mpc]

        The upper limit is the 95 % quantile of the normal distribution truncated at zero. Where the estimate is
        negative, which only noise can cause, its coverage is above 95 %.
        """
        above_zero = ndtr(self.hubble / self.hubble_error)
        lower = self.hubble + ndtri(0.05) * self.hubble_error
        upper = self.hubble - ndtri(0.05 * above_zero) * self.hubble_error
        return max(float(lower), 0.0), float(upper)

    def _collect_table_metadata(self):
        lower, upper = self.hubble_limits
        limits = {"hubble_above_95": lower} if lower > 0 else {}
        return {"assumed_velocity": self.assumed_velocity.amplitude, **limits, "hubble_below_95": upper}
