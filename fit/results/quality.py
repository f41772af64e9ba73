"""The one rule on χ²: when the residuals contradict the errors, and by how much errors would have to change.

A χ² per degree of freedom of 1.4 means nothing for ten numbers and a great deal for ten thousand, so the
rule is one of significance, not of size. Text, page, bins, velocity and posterior all ask here.
"""

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import numpy as np
from scipy.special import chdtr, chdtrc, chndtr, fdtrc, gammaln, ndtri_exp

from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray
from vsh.vector import SEEN as SEEN

__all__ = ["ErrorSource", "Quality"]

#: From so many standard deviations on, a χ² contradicts the errors.
SIGNIFICANT = 3.0
#: The code of the note that a fit leaves where a large part of the sky has no source.
ONE_SIDE = "one side of the sky"
#: That of a fit to a table with several rows a source.
REPEATED = "several rows a source"
#: That of a fit with heavy tails in which the quoted errors say little of the scatter, and that of a clipped one.
ERRORS_TOO_SMALL, CLIPPED = "quoted errors are too small", "clipped"
#: That of a fit whose residuals are many times smaller than the errors.
TOO_LITTLE_SCATTER = "residuals far below the errors"
#: By how much residuals exceed errors where a unit is wrong rather than an error.
WRONG_UNIT_FACTOR = 30.0
#: From so many sources on systematic errors are included by default; below so few they cannot be estimated.
MANY, FEW = 100_000, 200


class ErrorSource(StrEnum):
    """Source of the covariance of a solution, which decides how its errors are named and scaled."""

    CATALOGUE = "catalogue"
    SCALED = "catalogue, scaled"
    FLOWS = "catalogue and flows"
    EXCESS_NOISE = "excess noise"
    RESIDUALS = "residuals"
    BOOTSTRAP = "bootstrap"
    JACKKNIFE = "jackknife"
    JOINT = "several classes or catalogues together"


@dataclass(frozen=True)
class Quality:
    """Test of the errors by χ².

    Attributes
    ----------
    chi2 : float
    dof : int
    """

    chi2: float
    dof: int

    @property
    def reduced(self) -> float:
        """χ² per degree of freedom; nan where there is none."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    @property
    def deviations(self) -> float:
        """Deviation of χ² from its expectation, as a normal deviate: positive where residuals are too large."""
        return float(normal_deviate(self.chi2, self.dof)) if self.dof > 0 and self.chi2 >= 0 else 0.0

    @property
    def contradicted(self) -> bool:
        """Return whether the residuals contradict the errors, in either direction."""
        return abs(self.deviations) > SIGNIFICANT

    @property
    def factor(self) -> float:
        """Factor on the errors for χ² to be as expected; 1 where they are not contradicted, or χ² is zero."""
        return float(np.sqrt(self.reduced)) if self.contradicted and self.chi2 > 0 else 1.0

    def warning(self) -> str | None:
        """Warning for a report, or None."""
        if self.dof <= 0:
            return "no degrees of freedom are left: the residuals say nothing of the errors"
        if not self.contradicted:
            return None
        deviation_text = f"{self.reduced:.3f} is {abs(self.deviations):.1f} standard deviations from 1"
        if self.deviations > 0:
            return f"χ²/dof {deviation_text}: the residuals suggest errors {self.factor:.3g} times as large"
        if not self.chi2 > 0:
            return "the residuals are zero: the model was put in, or motions without noise"
        return f"χ²/dof {deviation_text}: the errors seem too large by a factor of {1 / self.factor:.3g}"


def log_p_value(chi2: float, dof: float) -> float:
    """Logarithm of the probability of as much χ² or more, also where the probability underflows."""
    p_value = chdtrc(dof, chi2)
    if p_value > 1e-290:
        return np.log(p_value)
    # Q(a, x) = x^(a−1) e^{−x}/Γ(a) (1 + (a−1)/x + (a−1)(a−2)/x² + …), the terms as long as they fall.
    a, x = dof / 2, chi2 / 2
    term = total = 1.0
    for k in range(1, 1_000_000):
        previous_term, term = term, term * (a - k) / x
        if abs(term) < 1e-17 * abs(total) or abs(term) > abs(previous_term):
            break
        total += term
    return (a - 1) * np.log(x) - x - gammaln(a) + np.log(total)


def normal_deviate(chi2: float, dof: float) -> float:
    """The z with the same tail probability as χ² with so many degrees of freedom, of any size."""
    # Each tail from its own small probability: 1 − p would round to 1.
    lower = chdtr(dof, chi2)
    if lower < 0.5:
        return ndtri_exp(np.log(max(lower, 1e-300)))
    return -ndtri_exp(log_p_value(chi2, dof))


def f_p_value(chi2: float, numerator: float, denominator: float) -> float:
    """Probability of as much χ² or more where its scale was estimated: chi2/numerator against F."""
    if not numerator:
        return float("nan")
    if not np.isfinite(denominator) or denominator > 1e8:
        return float(chdtrc(numerator, chi2))
    return float(fdtrc(numerator, denominator, chi2 / numerator))


def norm_limit(norms: FloatArray, sigma: FloatArray, size: int, probability: float = 0.95) -> FloatArray:
    """Upper limits of the norm of a vector: a longer one would have been found longer with this probability, (n,).

    Exact where all components have one error; never below that of a search without a signal (CLs; Read 2002, J. Phys. G
    28, 2693).
    """
    significance = norms / sigma
    noncentralities = np.linspace(1e-3, max(float(significance.max()), 0.1), 400) ** 2
    lower, upper = np.zeros_like(noncentralities), np.sqrt(noncentralities) + 12
    for _ in range(60):
        midpoint = (lower + upper) / 2
        is_allowed = chndtr(noncentralities, size, midpoint**2) / chdtr(size, noncentralities) > 1 - probability
        lower, upper = np.where(is_allowed, midpoint, lower), np.where(is_allowed, upper, midpoint)
    return sigma * np.interp(significance, np.sqrt(noncentralities), upper)


def hint_of(p: float) -> str:
    """Remark on a probability that is small, but not small enough; empty for any other."""
    return f"a hint; detections have p < {SEEN}" if SEEN <= p < 0.05 else ""


def gls(values: FloatArray, covariance: FloatArray, design: FloatArray) -> tuple[FloatArray, float, FloatArray]:
    """Generalised least squares of values (B, q) = design (B, k) · θ (k, q): θ flat, χ² and θ's covariance."""
    full_design = np.kron(design, np.eye(values.shape[1]))
    flat_values = values.ravel()
    weighted_columns = np.linalg.solve(covariance, np.column_stack([full_design, flat_values]))
    theta_covariance = np.linalg.inv(full_design.T @ weighted_columns[:, :-1])
    theta = theta_covariance @ (full_design.T @ weighted_columns[:, -1])
    chi2 = float(flat_values @ weighted_columns[:, -1] - theta @ (full_design.T @ weighted_columns[:, -1]))
    return theta, chi2, theta_covariance


def solution_of(result: Any, attribute: str) -> Any:
    """The solution for coefficients that a result is about, or the result itself where it is one."""
    solution = getattr(result, "solution", result)
    if not hasattr(solution, "error_source"):  # coefficients with a covariance say where it is from
        hint = f": use its own, .{attribute}" if hasattr(solution, attribute) else ""
        raise ParameterError(f"{attribute} is for solutions for coefficients, not a {type(solution).__name__}{hint}")
    return solution
