"""Fits whose likelihood expects that some errors are wrong.

Each is the chain, called again and again on a field whose errors grow where the last fit
left large residuals, X² = Δᵀ C⁻¹ Δ of both components together.
"""

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.special import gamma, gammainc, gammaln

from fit.normal import normal_equations
from fit.solution import Solution
from fit.solve import solve
from vsh.errors import ConvergenceError


@dataclass(frozen=True, eq=False)
class Reweighted:
    """A fit that trusts each source as far as the source deserves.

    Attributes
    ----------
    solution : Solution
        Its covariance holds for the scatter that was found, not for the catalogue's errors.
    weights : (n,) array
        By how much each source's inverse covariance was multiplied, up to a common factor.
    rounds : int
        How many fits it took.
    inflation : float
        Standard errors over those of plain least squares with the catalogue's errors.
    dof : float or None
        Of the Student-t distribution.
    """

    solution: Solution
    weights: np.ndarray
    rounds: int
    inflation: float
    dof: float = None

    @property
    def effective(self):
        """The number of equally weighted sources with the same weight, (Σu)²/Σu²."""
        return float(self.weights.sum() ** 2 / (self.weights**2).sum())

    def most_downweighted(self, count=10):
        """Indices of the sources with the least weight, least first."""
        return np.argsort(self.weights, kind="stable")[:count]


def student_t(field, modes, dof=None, **options):
    """Fit with a bivariate Student-t likelihood of each source's residual.

    Parameters
    ----------
    field : Field
    modes : Modes
    dof : float, optional
        Degrees of freedom of the distribution; estimated by maximum likelihood, between
        0.5 and 200, unless given.

    Returns
    -------
    Reweighted

    Raises
    ------
    ConvergenceError
        If the weights have not settled.

    Notes
    -----
    Weights u = (ν + 2)/(ν + X²): Lange, Little & Taylor (1989, JASA 84, 881).
    """
    if dof is not None and not dof > 0:
        raise ValueError(f"dof must be positive, not {dof}")
    state = {"dof": dof or 4.0}

    def weight(x2):
        if dof is None:
            state["dof"] = _likeliest_dof(x2)
        nu = state["dof"]
        u = (nu + 2) / (nu + x2)
        return u, -u / (nu + x2)

    found = _reweighted(field, modes, weight, "Student-t", **options)
    return replace(found, dof=float(state["dof"]))


def permissive(field, modes, **options):
    """Fit taking every error for a lower bound, after Sivia.

    The true errors are s ≥ 1 times the stated ones, with probability density 1/s². For two
    components with a common s the likelihood is ∫₀¹ t² exp(−X² t²/2) dt.

    Returns
    -------
    Reweighted

    Notes
    -----
    Sivia & Skilling (2006, Data Analysis, sect. 8.3.1), there for one component.
    """

    def weight(x2):
        q = np.maximum(x2 / 2, 1e-8)
        i2, i4, i6 = (gamma(a) * gammainc(a, q) / q**a for a in (1.5, 2.5, 3.5))
        return i4 / i2, (np.square(i4 / i2) - i6 / i2) / 2

    return _reweighted(field, modes, weight, "Sivia's permissive likelihood", **options)


def _reweighted(field, modes, weight, name, tolerance=1e-4, max_rounds=200):
    """Iterate the weighted fit until no coefficient moves by `tolerance` of its error."""
    plain = solve(normal_equations(field, modes))
    solution, values = plain, plain.coefficients.values
    for rounds in range(1, max_rounds + 1):
        u, slope = weight(solution.residuals(field).chi2)
        solution = solve(normal_equations(field.with_errors(field.sigma / np.sqrt(u)), modes))
        moved = np.max(np.abs(solution.coefficients.values - values) / plain.sigma)
        values = solution.coefficients.values
        if moved < tolerance:
            break
    else:
        raise ConvergenceError(
            f"the weights have not settled after {max_rounds} rounds: coefficients move by {moved:.1e} σ"
        )
    x2 = solution.residuals(field).chi2
    u, slope = weight(x2)
    # Huber's sandwich, for residuals whose distribution does not depend on the place in the sky: the
    # score has the variance mean(u² X²)/2 and the slope mean(u + u' X²), in units of the plain N.
    inflation = float(np.sqrt(np.mean(u * u * x2) / 2) / np.mean(u + slope * x2))
    covariance = plain.covariance * inflation**2
    least = np.argsort(u, kind="stable")[:5]
    label = field.name if field.name is not None else np.arange(len(field))
    effective = u.sum() ** 2 / (u * u).sum()
    said = (
        f"{name}: {rounds} rounds, weight of {effective:.1f} equal sources of {len(field)}; errors are {inflation:.2f} times "
        f"those of the catalogue; most downweighted: {', '.join(f'{label[i]} ({u[i] / u.max():.2g})' for i in least)}"
    )
    solution = replace(
        solution,
        covariance=covariance,
        chi2=float(x2.sum()),
        notes=(*plain.notes, said),
        errors_from="the scatter that the robust fit found",
    )
    return Reweighted(solution, u, rounds, inflation)


def _likeliest_dof(x2):
    """ν of the bivariate t distribution, p(X²) ∝ (1 + X²/ν)^{−(ν+2)/2}, that makes the X² likeliest."""

    def loss(log_nu):
        nu = np.exp(log_nu)
        constant = gammaln((nu + 2) / 2) - gammaln(nu / 2) - np.log(nu)
        return -(constant - (nu + 2) / 2 * np.mean(np.log1p(x2 / nu)))

    return float(np.exp(minimize_scalar(loss, bounds=np.log([0.5, 200]), method="bounded").x))
