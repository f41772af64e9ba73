"""The likelihood of the amplitudes of Gaussian backgrounds, whatever else is fitted marginalised.

`Amplitudes` is the formula for N and b; `Likelihood` is that of normal equations, with the scale of their errors. The
coefficients of a background are c_i ~ N(0, D_i) with D = Σ_k A_k D_k, D_k the variances of spectrum k for an
amplitude of one. What is free (degree 1) has a flat prior and is eliminated by the Schur complement: N', b', χ0' = χ0 −
b₁ᵀ N₁₁⁻¹ b₁. With κ the scale of the catalogue's errors, τ = κ², a = A/τ and n the numbers less those that are free, up
to a constant

    ln L(A, κ) = −(n/2) ln τ − ½ ln|K(a)| − (χ0' − Q(a))/(2τ),    K(a) = I + D^½ N' D^½,   Q(a) = b'ᵀ D^½ K⁻¹ D^½ b',

with D = Σ a_k D_k. That is the likelihood of the 2N motions with their dense covariance, by a matrix of the size of the
coefficients; N' may be singular.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dposv
from scipy.special import chdtrc

from fit.normal import NormalEquations, eliminate
from fit.results.quality import ErrorSource
from fit.results.solution import Solution
from vsh.models.covariance import SpectrumOfKind
from vsh.modes import Modes
from vsh.tools.arguments import choice
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.notes import drop_empty_notes
from vsh.tools.parallel import limit_blas
from vsh.tools.types import FloatArray, IntArray

#: How far below its maximum the likelihood is followed: e^−18.
_FOLLOWED_DROP = 18.0
#: From roots of each amplitude to ln|K| and Q on their tensor.
TensorFunction: TypeAlias = Callable[[list[FloatArray]], FloatArray]


def compute_logdet_and_gain(matrix: FloatArray, rhs: FloatArray, variances: FloatArray) -> tuple[float, float]:
    """ln|K| and Q of coefficients with variances D, for errors of scale one."""
    root, kernel = make_root_and_kernel(matrix, variances)
    right_side = root * rhs
    factor, solution, info = dposv(kernel, right_side, lower=1, overwrite_a=1)
    if info:  # cannot be: K is the identity and more
        raise DegeneracyError("the normal matrix is not positive: it is no sum over sources")
    return 2 * float(np.log(factor.diagonal()).sum()), float(right_side @ solution)


def make_root_and_kernel(matrix: FloatArray, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """√D, and K = I + D^½ N D^½ in the order that LAPACK overwrites."""
    root = np.sqrt(variances)
    kernel = np.multiply(matrix, root[:, None] * root, order="F")
    kernel.ravel("K")[:: len(kernel) + 1] += 1
    return root, kernel


@dataclass(frozen=True, eq=False)
class Axis:
    """Chebyshev nodes in asinh(value/scale); a single one where low = high."""

    low: float
    high: float
    scale: float
    count: int

    @property
    def nodes(self) -> FloatArray:
        """Chebyshev nodes between low and high, (k,)."""
        if self.count == 1:
            return np.array([self.low])
        return self._compute_value(np.cos(np.pi * (np.arange(self.count) + 0.5) / self.count))

    def evaluate_basis(self, value: FloatArray) -> FloatArray:
        """Chebyshev polynomials at values inside the limits, (n, count)."""
        if self.count == 1:
            return np.ones((value.size, 1))
        a, b = self._transformed_ends
        return chebyshev.chebvander((2 * np.arcsinh(value / self.scale) - a - b) / (b - a), self.count - 1)

    def to_coefficients(self, table: FloatArray, axis: int) -> FloatArray:
        """Convert values at the nodes, along one axis of a table, to Chebyshev coefficients."""
        vander = self.evaluate_basis(self.nodes)
        return np.moveaxis(np.tensordot(np.linalg.inv(vander), table, (1, axis)), 0, axis)

    def refine(self) -> "Axis":
        """An axis with more nodes."""
        return Axis(self.low, self.high, self.scale, 2 * self.count if self.count > 1 else 1)

    def at(self, fraction: FloatArray) -> FloatArray:
        """Values at fractions of the way from low to high."""
        return self._compute_value(2 * np.asarray(fraction) - 1) if self.count > 1 else np.full(len(fraction), self.low)

    @property
    def _transformed_ends(self):
        return np.arcsinh(self.low / self.scale), np.arcsinh(self.high / self.scale)

    def _compute_value(self, t):
        a, b = self._transformed_ends
        return np.clip(self.scale * np.sinh((t * (b - a) + a + b) / 2), self.low, self.high)


@dataclass(frozen=True, eq=False)
class Maximum:
    """Maximum of the likelihood."""

    amplitudes: FloatArray
    noise_scale: float
    log_likelihood: float


class Amplitudes(InNotebook):
    """The likelihood of the amplitudes A_k of random fields whose coefficients are c ~ N(0, Σ_k A_k D_k).

    With N and b what the data say of the coefficients, R² = Σ_k A_k D_k on the diagonal and K = 1 + R N R,

        ln L(A) = (Q − ln|K|)/2,   Q = bᵀ R K⁻¹ R b,

    relative to that of no field. N may be singular.

    Parameters
    ----------
    matrix, rhs : (p, p) and (p,) arrays
        N and b, whatever else was fitted eliminated, for errors of the size that is meant.
    shares : (k, p) array
        D_k: the variances of field k for an amplitude of one.

    Attributes
    ----------
    unit : (k,) array
        The amplitude of each field that is seen at one standard error where there is nothing.

    Examples
    --------
    >>> likelihood = Amplitudes(np.eye(3), np.array([1.0, 2.0, 3.0]), np.ones((1, 3)))
    >>> float(round(likelihood.log_likelihood(np.array([2.0])), 4))
    3.0187
    """

    def __init__(self, matrix: FloatArray, rhs: FloatArray, shares: FloatArray) -> None:
        self.matrix, self.rhs, self.shares = matrix, rhs, shares
        squared_matrix = matrix**2
        self.unit = np.array([1 / np.sqrt(max(share @ squared_matrix @ share / 2, 1e-300)) for share in shares])
        self._eigenvalues_and_squares = _diagonalise(matrix, rhs, shares[0]) if len(shares) == 1 else None

    def __len__(self) -> int:
        return len(self.shares)

    def log_likelihood(self, amplitudes: FloatArray) -> float:
        """ln L relative to that of no field.

        Parameters
        ----------
        amplitudes : (k,) array
            One for each field, none below zero.
        """
        logdet, gain = self.parts(np.atleast_1d(np.asarray(amplitudes, float)))
        return (gain - logdet) / 2

    def parts(self, amplitudes: FloatArray) -> tuple[float, float]:
        """ln|K| and Q of `amplitudes`, (k,)."""
        if self._eigenvalues_and_squares is not None:
            ratios, scaled_squares = amplitudes[0] * np.array(self._eigenvalues_and_squares)
            return float(np.log1p(ratios).sum()), float(np.sum(scaled_squares / (1 + ratios)))
        return compute_logdet_and_gain(self.matrix, self.rhs, amplitudes @ self.shares)

    def on_tensor(self, roots: list[FloatArray]) -> FloatArray:
        """ln|K| and Q on the tensor of the `roots` of the amplitudes, (2, …)."""
        if self._eigenvalues_and_squares is not None:
            ratios, scaled_squares = (roots[0][:, None] ** 2 * array for array in self._eigenvalues_and_squares)
            return np.array([np.log1p(ratios).sum(1), np.sum(scaled_squares / (1 + ratios), 1)])
        if len(roots) == 2 and not (self.shares[0] * self.shares[1]).any():
            return self._evaluate_on_plane(*roots)
        logdets_and_gains = np.empty((2, *map(len, roots)))
        for index in np.ndindex(*map(len, roots)):
            amplitudes = np.array([axis[i] ** 2 for axis, i in zip(roots, index, strict=True)])
            logdets_and_gains[(slice(None), *index)] = self.parts(amplitudes)
        return logdets_and_gains

    def _evaluate_on_plane(self, first_roots, second_roots):
        """`on_tensor` of two fields that share no coefficient: for each amplitude of the second in closed form."""
        of_first, of_second = (np.flatnonzero(share) for share in self.shares)
        root = np.sqrt(self.shares.sum(0))
        matrix, rhs = self.matrix * root[:, None] * root, self.rhs * root
        second_eigenvalues, vectors = np.linalg.eigh(matrix[np.ix_(of_second, of_second)])
        cross, second_rhs = matrix[np.ix_(of_first, of_second)] @ vectors, vectors.T @ rhs[of_second]
        second_eigenvalues = np.maximum(second_eigenvalues, 0.0)
        kept = second_roots[:, None] ** 2 / (1 + second_roots[:, None] ** 2 * second_eigenvalues)
        # What the data say of the first field once the second is marginalised, for each of its amplitudes.
        inner, vectors = np.linalg.eigh(matrix[np.ix_(of_first, of_first)] - (cross * kept[:, None]) @ cross.T)
        squares = np.einsum("jki,jk->ji", vectors, rhs[of_first] - (kept * second_rhs) @ cross.T) ** 2
        ratios = first_roots[:, None, None] ** 2 * np.maximum(inner, 0.0)
        logdet = np.log1p(ratios).sum(2) + np.log1p(second_roots[:, None] ** 2 * second_eigenvalues).sum(1)
        gain = np.sum(first_roots[:, None, None] ** 2 * squares / (1 + ratios), 2) + kept @ second_rhs**2
        return np.array([logdet, gain])

    def slopes(self, amplitudes: FloatArray) -> tuple[float, float, FloatArray, FloatArray]:
        """ln|K|, Q, and what they change by with each of the `amplitudes`, (k,)."""
        if self._eigenvalues_and_squares is not None:
            eigenvalues, squares = self._eigenvalues_and_squares
            remainder = 1 / (1 + amplitudes[0] * eigenvalues)
            return (*self.parts(amplitudes), np.sum(eigenvalues * remainder), np.sum(squares * remainder**2))
        factor, w, t = self._solve_kernel(amplitudes)
        remainder = self.rhs - w @ t
        diagonal = np.diag(self.matrix) - np.sum(t * t, 0)
        return 2 * np.log(np.diag(factor)).sum(), w @ w, self.shares @ diagonal, self.shares @ remainder**2

    def information(self, amplitudes: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Tr(D_j M D_k M) and Tr(D_k M) of the information M = N − N R K⁻¹ R N that some `amplitudes` leave."""
        if self._eigenvalues_and_squares is not None:
            remaining = self._eigenvalues_and_squares[0] / (1 + amplitudes[0] * self._eigenvalues_and_squares[0])
            return np.array([[np.sum(remaining**2)]]), np.array([np.sum(remaining)])
        t = self._solve_kernel(amplitudes)[-1]
        remaining = self.matrix - t.T @ t
        return self.shares @ remaining**2 @ self.shares.T, self.shares @ np.diag(remaining)

    def _solve_kernel(self, amplitudes):
        """L of K = L Lᵀ, L⁻¹ R b, and the T = L⁻¹ R N of the information N − TᵀT that is left."""
        root, kernel = make_root_and_kernel(self.matrix, amplitudes @ self.shares)
        factor = cholesky(kernel, lower=True, overwrite_a=True, check_finite=False)
        right_sides = np.column_stack([root * self.rhs, root[:, None] * self.matrix])
        solution = solve_triangular(factor, right_sides, lower=True, check_finite=False)
        return factor, solution[:, 0], solution[:, 1:]


class Likelihood(Amplitudes):
    """ln L of the amplitudes of some spectra, and of the scale κ of the errors, in normal equations.

    Amplitudes are in units of κ² in what it shares with `Amplitudes`, whose N and b have errors of scale one.
    """

    def __init__(
        self,
        normal: NormalEquations,
        spectra: Sequence[SpectrumOfKind],
        degrees: Sequence[int],
        free_degrees: Sequence[int],
        noise_scale: bool = True,
    ) -> None:
        modes = normal.modes
        spectra = list(spectra) if isinstance(spectra, Iterable) else []
        if not spectra or not all(isinstance(spectrum, SpectrumOfKind) for spectrum in spectra):
            raise ParameterError("a background needs a list of fit.background.Spectrum, one at least")
        indices = find_coefficient_indices(modes, degrees)
        shapes = np.array([spectrum.variances(modes)[indices] for spectrum in spectra])
        for spectrum, shape in zip(spectra, shapes, strict=True):
            if not shape.any():
                raise ParameterError(f"the spectrum {spectrum.name} has no power in degrees {format_degrees(degrees)}")
        indices, shapes = indices[shapes.any(0)], shapes[:, shapes.any(0)]
        free_indices = find_coefficient_indices(modes, free_degrees)
        matrix, rhs, self.chi2 = _eliminate_free_degrees(normal, free_indices, indices)
        super().__init__(matrix, rhs, shapes)
        self.n_data = normal.n_data - len(free_indices)
        # Where errors have no scale it is a constant of ln L, whose rounding is large if one source is far off.
        self._chi2_if_scaled = self.chi2 if noise_scale else 0.0
        if noise_scale and self.n_data <= 0:
            raise DegeneracyError(f"{normal.n_data} numbers do not tell the scale of their errors: noise_scale=False")
        self.noise_scale = bool(noise_scale)
        self._search_start = np.ones(len(shapes))  # of a search
        if self.noise_scale and self.chi2 - self.parts(1e9 * self.unit)[1] <= 1e-9 * normal.chi2_null:
            raise DegeneracyError("residuals are zero: they do not tell the scale of the errors (noise_scale=False)")

    def __call__(self, amplitudes: FloatArray, noise_scale: float = 1.0) -> float:
        """ln L, relative to that of no background with errors as they are."""
        tau = noise_scale**2
        logdet, gain = self.parts(np.atleast_1d(np.asarray(amplitudes, float)) / tau)
        return float(self.combine(logdet, gain, tau)) + self._chi2_if_scaled / 2

    def combine(
        self, logdet: FloatArray | float, gain: FloatArray | float, tau: FloatArray | float
    ) -> FloatArray | float:
        """Combine ln|K|, Q and κ² to ln L, up to a constant."""
        return -self.n_data / 2 * np.log(tau) - logdet / 2 - (self._chi2_if_scaled - gain) / (2 * tau)

    def find_best_tau(self, gain: float) -> float:
        """κ² where it is likeliest, for some ratios."""
        return max((self.chi2 - gain) / self.n_data, 1e-300) if self.noise_scale else 1.0

    def profile_log_likelihood(self, ratios: FloatArray) -> float:
        """ln L of ratios, with κ where it is likeliest, up to the same constant."""
        logdet, gain = self.parts(ratios)
        return float(self.combine(logdet, gain, self.find_best_tau(gain)))

    def make_interpolator(self, spans: Sequence[tuple[float, float]], taus: FloatArray) -> TensorFunction:
        """ln|K| and Q on the tensor of any √a within the spans: by polynomials, or exactly for one spectrum."""
        if len(spans) == 1:
            return self.on_tensor
        n_nodes = {2: 20, 3: 12}.get(len(spans), 8)
        if len(self.rhs) > 300:  # where the degree is high, amplitudes are known well, and the spans short
            n_nodes = min(n_nodes, 12)
        limits = np.array(spans) / np.sqrt([taus[-1], taus[0]])
        axes = [Axis(low, high, u, n_nodes) for (low, high), u in zip(limits, np.sqrt(self.unit), strict=True)]
        coefficients = self.on_tensor([axis.nodes for axis in axes])
        for k, axis in enumerate(axes):
            coefficients = axis.to_coefficients(coefficients, k + 1)

        def interpolate_logdet_and_gain(roots):
            contracted = coefficients
            # Contracting the first axis behind the two quantities once an amplitude comes back to their order.
            for root, axis in zip(roots, axes, strict=True):
                contracted = np.moveaxis(np.tensordot(axis.evaluate_basis(root), contracted, (1, 1)), 0, -1)
            return contracted

        return interpolate_logdet_and_gain

    def find_maximum(self) -> Maximum:
        """Amplitude of the maximum."""
        with limit_blas(len(self.rhs)):
            log1p_ratios = self._search_start = self._minimise_loss(self._search_start)
            ratios = self.unit * np.expm1(log1p_ratios)
            ratios[log1p_ratios < 1e-6] = 0.0  # rounding of the search is no background
            logdet, gain = self.parts(ratios)
        tau = self.find_best_tau(gain)
        # Relative to no background, where K = I and Q = 0.
        log_likelihood = float(self.combine(logdet, gain, tau)) - float(self.combine(0.0, 0.0, self.find_best_tau(0.0)))
        return Maximum(ratios * tau, float(np.sqrt(tau)), max(log_likelihood, 0.0))

    def _minimise_loss(self, x):
        """Minimise the loss for 0 ≤ x ≤ 60, by Newton's method with differences of its slope."""
        loss, slope = self._compute_loss(x)
        for _ in range(100):
            is_free = ~((x <= 0) & (slope > 0) | (x >= 60) & (slope < 0))
            if np.abs(slope[is_free]).max(initial=0.0) < 1e-8:
                break
            hessian = np.array([self._compute_loss(x + 1e-5 * axis)[1] - slope for axis in np.eye(len(x))]) / 1e-5
            eigenvalues, eigenvectors = np.linalg.eigh((hessian + hessian.T)[np.ix_(is_free, is_free)] / 2)
            step = np.zeros(len(x))
            step[is_free] = -eigenvectors @ (eigenvectors.T @ slope[is_free] / np.maximum(np.abs(eigenvalues), 1e-8))
            for fraction in 0.5 ** np.arange(30):
                trial = np.clip(x + fraction * np.clip(step, -3, 3), 0, 60)
                trial_loss, trial_slope = self._compute_loss(trial)
                if trial_loss <= loss + 1e-4 * slope @ (trial - x):
                    break
            else:
                break  # no lower in double precision
            x, loss, slope = trial, trial_loss, trial_slope
        return x

    def _compute_loss(self, x):
        """−ln L by a = unit (eˣ − 1), which is linear next to zero and logarithmic far from it; and its gradient."""
        logdet, gain, by_logdet, by_gain = self.slopes(self.unit * np.expm1(x))
        tau = self.find_best_tau(gain)
        slope = (by_logdet - by_gain / tau) / 2
        return -float(self.combine(logdet, gain, tau)), slope * self.unit * np.exp(x)


def compute_parity_p_value(separate_log_likelihood: float, common_log_likelihood: float) -> float:
    """Probability that two parities of one power look as different, by ln L of separate and of common powers."""
    return float(chdtrc(1, max(2 * (separate_log_likelihood - common_log_likelihood), 0.0)))


def _eliminate_free_degrees(normal, free_indices, kept_indices):
    """Reduced N', b', χ0' of `indices`, with `free_indices` fitted freely: DegeneracyError if they cannot be."""
    if not len(free_indices):
        return normal.matrix[np.ix_(kept_indices, kept_indices)], normal.rhs[kept_indices], float(normal.chi2_null)
    free_matrix = normal.matrix[np.ix_(free_indices, free_indices)]
    scale = np.sqrt(np.maximum(np.diag(free_matrix), 0))
    if not (scale > 0).all() or np.linalg.eigvalsh(free_matrix / np.outer(scale, scale))[0] < 1e-10:
        raise DegeneracyError(
            f"{normal.n_sources} sources do not determine the {len(free_indices)} coefficients that are fitted freely"
        )
    matrix, rhs, gain = eliminate(normal.matrix, normal.rhs, kept_indices, free_indices)
    return matrix, rhs, float(normal.chi2_null - gain)


def _diagonalise(matrix, rhs, variances):
    """Eigenvalues λ of D^½ N' D^½, and the squares of the right-hand side along them."""
    root = np.sqrt(variances)
    eigenvalues, eigenvectors = np.linalg.eigh(matrix * np.outer(root, root))
    return np.maximum(eigenvalues, 0.0), (eigenvectors.T @ (root * rhs)) ** 2


def make_tau_nodes(likelihood: Likelihood, maximum: Maximum) -> tuple[FloatArray, FloatArray]:
    """κ² and the weights of a sum over ln κ²."""
    if not likelihood.noise_scale:
        return np.ones(1), np.ones(1)
    reach = 4.5 * np.sqrt(2 / likelihood.n_data)
    log_scale2, weights = make_gauss_nodes(9, -reach, reach)
    return maximum.noise_scale**2 * np.exp(log_scale2), weights


def make_gauss_nodes(n_nodes: int, low: float, high: float) -> tuple[FloatArray, FloatArray]:
    """Nodes and weights of an integral from low to high."""
    nodes, weights = np.polynomial.legendre.leggauss(n_nodes)
    return low + (high - low) * (nodes + 1) / 2, weights * (high - low) / 2


def find_root_span(likelihood: Likelihood, maximum: Maximum, k: int) -> tuple[float, float]:
    """Range in which √A_k is followed, the others at their maximum."""
    tau = maximum.noise_scale**2
    highest_log_likelihood = likelihood.profile_log_likelihood(maximum.amplitudes / tau)

    def has_dropped(trial_root):
        trial_amplitudes = np.array(maximum.amplitudes)
        trial_amplitudes[k] = trial_root * trial_root
        return highest_log_likelihood - likelihood.profile_log_likelihood(trial_amplitudes / tau) > _FOLLOWED_DROP

    root = np.sqrt(maximum.amplitudes[k])
    step = np.sqrt(likelihood.unit[k] * tau)
    upper = root + step
    while not has_dropped(upper) and upper < 1e6 * (root + step):
        upper = root + 1.5 * (upper - root)
    return (0.0 if not has_dropped(0.0) else _bisect_edge(has_dropped, 0.0, root)), upper


def _bisect_edge(is_outside, outside, inside):
    for _ in range(6):
        midpoint = (outside + inside) / 2
        outside, inside = (midpoint, inside) if is_outside(midpoint) else (outside, midpoint)
    return outside


def equations_of(source: Any, scalars: bool = False) -> NormalEquations:
    """Normal equations of data alone: as they are less their prior, or those that a solution is the solution of."""
    source = _unwrap_solution(source)
    if not scalars and isinstance(source, NormalEquations | Solution) and source.modes.components != 2:
        raise ParameterError(
            "this is of fields of motions: their spectra have toroidal and spheroidal parts, and a scalar field has "
            "neither"
        )
    if isinstance(source, NormalEquations):
        return source if source.prior is None else source - source.prior
    if not isinstance(source, Solution):
        raise ParameterError(
            f"a background is fitted to normal equations or to a Solution, not to a {type(source).__name__}: "
            "fit.normal_equations(field, modes)"
        )
    if source.by_prior:
        raise ParameterError(
            "this solution holds a prior: give the normal equations of the data, fit.normal_equations(field, modes)"
        )
    formal = source.formal_covariance
    if formal is None and source.covariance_dof < len(source.modes):
        raise DegeneracyError(
            f"{source.covariance_dof + 1:.0f} replicates determine no covariance of {len(source.modes)} coefficients: "
            "take more of them, or a lower degree"
        )
    if np.isnan(source.values).any():
        raise ParameterError("a prediction holds no data to fit a background to")
    covariance = source.covariance
    if formal is not None:
        # The noise of a covariance from residuals or replicates would pass for power; its mean size has little.
        covariance = formal * (np.trace(np.linalg.solve(formal, covariance)) / len(formal))  # in any axes the same
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    try:
        matrix = cho_solve(cho_factor(covariance / scale), np.eye(len(scale))) / scale
    except np.linalg.LinAlgError:
        raise DegeneracyError("this solution's covariance is singular: no background can be fitted to it") from None
    rhs = matrix @ source.values
    chi2_null = float(source.chi2 + rhs @ source.values)
    notes = drop_empty_notes(source.notes)
    return NormalEquations(
        source.modes, matrix, rhs, chi2_null, source.n_data, source.frame, notes, unit=source.unit or None
    )


def find_error_source(source: Any) -> tuple[str, ErrorSource]:
    """Source of the errors, in words and as an ErrorSource; normal equations have those of the catalogue."""
    solution = _unwrap_solution(source)
    return (getattr(solution, "errors_from", "the catalogue"), getattr(solution, "error_source", ErrorSource.CATALOGUE))


def should_fit_scale(source: Any, noise_scale: bool | None) -> bool:
    """Return whether the scale of the errors is estimated: as told, or where the errors are the catalogue's."""
    option = choice("noise_scale", noise_scale, (None, True, False))
    return find_error_source(source)[1] == ErrorSource.CATALOGUE if option is None else option


def check_degrees(modes: Modes, degrees: Any, name: str = "degrees") -> tuple[int, ...]:
    """Check that degrees are among those fitted, and return them in order, each once."""
    try:
        requested = list(degrees) if isinstance(degrees, Iterable) else [degrees]
        unique_degrees = sorted({int(degree) for degree in requested if int(degree) == degree})
    except (TypeError, ValueError, OverflowError, np.ma.MaskError):
        unique_degrees = []
    lowest = modes.lowest
    if not unique_degrees or len(unique_degrees) != len(set(requested)):
        raise ModesError(f"{name} must be whole numbers from {lowest} on, one at least, not {degrees!r}")
    missing_degrees = [l for l in unique_degrees if not lowest <= l <= modes.lmax]
    if missing_degrees:
        fitted_range = f"these normal equations go from degree {lowest} to {modes.lmax}"
        raise ModesError(f"degree {missing_degrees[0]} is not fitted: {fitted_range}")
    return tuple(unique_degrees)


def find_coefficient_indices(modes: Modes, degrees: Iterable[int]) -> IntArray:
    """Indices of the coefficients of some degrees."""
    return np.flatnonzero(np.isin(modes.degrees, list(degrees)))


def format_degrees(degrees: Sequence[int]) -> str:
    """Degrees as a reader sees them: "2, 3", "2 to 7"."""
    degrees = list(degrees)
    if len(degrees) > 2 and degrees == list(range(degrees[0], degrees[-1] + 1)):
        return f"{degrees[0]} to {degrees[-1]}"
    return ", ".join(map(str, degrees))


def _unwrap_solution(source):
    return getattr(source, "resampled_solution", getattr(source, "solution", source))
