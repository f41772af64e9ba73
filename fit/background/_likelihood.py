"""The likelihood of the amplitudes of Gaussian backgrounds, whatever else is fitted marginalised.

The coefficients of a background are c_i ~ N(0, D_i) with D = Σ_k A_k D_k, D_k the variances of spectrum k for an
amplitude of one. What is free (degree 1) has a flat prior and is eliminated by the Schur complement: N', b', χ0' = χ0 −
b₁ᵀ N₁₁⁻¹ b₁. With κ the scale of the catalogue's errors, τ = κ², a = A/τ and n the numbers less those that are free, up
to a constant

    ln L(A, κ) = −(n/2) ln τ − ½ ln|K(a)| − (χ0' − Q(a))/(2τ),    K(a) = I + D^½ N' D^½,   Q(a) = b'ᵀ D^½ K⁻¹ D^½ b',

with D = Σ a_k D_k. That is the likelihood of the 2N motions with their dense covariance, by a matrix of the size of the
coefficients; N' may be singular.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import reduce
from typing import TypeAlias

import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular
from scipy.linalg.lapack import dposv
from scipy.special import chdtrc

from fit.background._amplitude import places, words_of
from fit.normal import NormalEquations
from vsh.models.covariance import Spectrum
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.parallel import blas_for
from vsh.tools.types import FloatArray

#: From roots of each amplitude to ln|K| and Q on their tensor.
OnTensor: TypeAlias = Callable[[list[FloatArray]], FloatArray]


def parts_of(matrix: FloatArray, rhs: FloatArray, variances: FloatArray) -> tuple[float, float]:
    """ln|K| and Q of coefficients with variances D, for errors of scale one."""
    root, k = kernel(matrix, variances)
    side = root * rhs
    factor, solved, failed = dposv(k, side, lower=1, overwrite_a=1)
    if failed:  # cannot be: K is the identity and more
        raise DegeneracyError("the normal matrix is not positive: it is no sum over sources")
    return 2 * float(np.log(factor.diagonal()).sum()), float(side @ solved)


def kernel(matrix: FloatArray, variances: FloatArray) -> tuple[FloatArray, FloatArray]:
    """√D, and K = I + D^½ N D^½ in the order that LAPACK overwrites."""
    root = np.sqrt(variances)
    k = np.multiply(matrix, root[:, None] * root, order="F")
    k.ravel("K")[:: len(k) + 1] += 1
    return root, k


@dataclass(frozen=True, eq=False)
class Maximum:
    """Where the likelihood is largest."""

    amplitudes: FloatArray
    noise_scale: float
    log_likelihood: float


class Likelihood:
    """ln L of the amplitudes of some spectra."""

    def __init__(
        self,
        normal: NormalEquations,
        spectra: Sequence[Spectrum],
        degrees: Sequence[int],
        free: Sequence[int],
        noise_scale: bool = True,
    ) -> None:
        modes = normal.modes
        spectra = list(spectra) if isinstance(spectra, Iterable) else []
        if not spectra or not all(isinstance(each, Spectrum) for each in spectra):
            raise ParameterError("a background needs a list of fit.background.Spectrum, one at least")
        where = places(modes, degrees)
        shapes = np.array([each.variances(modes)[where] for each in spectra])
        for each, shape in zip(spectra, shapes, strict=True):
            if not shape.any():
                raise ParameterError(f"the spectrum {each.name} has no power in degrees {words_of(degrees)}")
        where, shapes = where[shapes.any(0)], shapes[:, shapes.any(0)]
        first = places(modes, free)
        self.matrix, self.rhs, self.chi2 = _eliminated(normal, first, where)
        self.shapes, self.n_data = shapes, normal.n_data - len(first)
        if noise_scale and self.n_data <= 0:
            raise DegeneracyError(f"{normal.n_data} numbers do not tell the scale of their errors: noise_scale=False")
        self.noise_scale = bool(noise_scale)
        # The amplitude that would be seen at one standard error if there were nothing.
        information = self.matrix**2
        self.unit = np.array([1 / np.sqrt(max(shape @ information @ shape / 2, 1e-300)) for shape in shapes])
        self._eigen = _eigen(self.matrix, self.rhs, shapes[0]) if len(shapes) == 1 else None
        self._start = np.ones(len(shapes))  # of a search
        if self.noise_scale and self.chi2 - self.parts(1e9 * self.unit)[1] <= 1e-9 * normal.chi2_null:
            raise DegeneracyError(
                "the residuals are zero: they do not tell the scale of the errors (noise_scale=False)"
            )

    def __len__(self) -> int:
        return len(self.shapes)

    def __call__(self, amplitudes: FloatArray, noise_scale: float = 1.0) -> float:
        """ln L, relative to that of no background with errors as they are."""
        tau = noise_scale**2
        return (
            float(self.of_parts(*self.parts(np.atleast_1d(np.asarray(amplitudes, float)) / tau), tau)) + self.chi2 / 2
        )

    def parts(self, ratios: FloatArray) -> tuple[float, float]:
        """ln|K| and Q for amplitudes in units of κ²."""
        if self._eigen is not None:
            values, squares = ratios[0] * np.array(self._eigen)
            return float(np.log1p(values).sum()), float(np.sum(squares / (1 + values)))
        return parts_of(self.matrix, self.rhs, ratios @ self.shapes)

    def of_parts(
        self, logdet: FloatArray | float, gain: FloatArray | float, tau: FloatArray | float
    ) -> FloatArray | float:
        """ln L from ln|K| and Q, up to a constant."""
        return -self.n_data / 2 * np.log(tau) - logdet / 2 - (self.chi2 - gain) / (2 * tau)

    def scale(self, gain: float) -> float:
        """κ² where it is likeliest, for some ratios."""
        return max((self.chi2 - gain) / self.n_data, 1e-300) if self.noise_scale else 1.0

    def profile(self, ratios: FloatArray) -> float:
        """ln L of ratios, with κ where it is likeliest, up to the same constant."""
        logdet, gain = self.parts(ratios)
        return float(self.of_parts(logdet, gain, self.scale(gain)))

    def on_tensor(self, roots: list[FloatArray]) -> FloatArray:
        """ln|K| and Q on the tensor of any √a, (2, …)."""
        values = np.empty((2, *map(len, roots)))
        for index in np.ndindex(*map(len, roots)):
            ratios = np.array([axis[i] ** 2 for axis, i in zip(roots, index, strict=True)])
            values[(slice(None), *index)] = self.parts(ratios)
        return values

    def between(self, spans: Sequence[tuple[float, float]], taus: FloatArray) -> OnTensor:
        """ln|K| and Q on the tensor of any √a within the spans: by polynomials, or exactly for one spectrum."""
        if len(spans) == 1:
            return self.on_tensor
        units = np.sqrt(self.unit)
        ends = [
            (np.arcsinh(low / np.sqrt(taus[-1]) / u), np.arcsinh(high / np.sqrt(taus[0]) / u))
            for (low, high), u in zip(spans, units, strict=True)
        ]
        number = {2: 20, 3: 12}.get(len(spans), 8)
        if len(self.rhs) > 300:  # where the degree is high, amplitudes are known well, and the spans short
            number = min(number, 12)
        node = chebyshev.chebpts1(number)
        axes = [low + (high - low) * (node + 1) / 2 for low, high in ends]
        values = self.on_tensor([u * np.sinh(axis) for u, axis in zip(units, axes, strict=True)])
        inverse = np.linalg.inv(chebyshev.chebvander(node, number - 1))
        # Contracting the first axis behind the two quantities once an amplitude comes back to the order of the axes.
        series = reduce(lambda array, _: np.moveaxis(np.tensordot(inverse, array, (1, 1)), 0, -1), spans, values)

        def at(roots):
            array = series
            for x, u, (low, high) in zip(roots, units, ends, strict=True):
                vander = chebyshev.chebvander(2 * (np.arcsinh(x / u) - low) / (high - low) - 1, number - 1)
                array = np.moveaxis(np.tensordot(vander, array, (1, 1)), 0, -1)
            return array

        return at

    def maximum(self) -> Maximum:
        """Where it is largest."""
        with blas_for(len(self.rhs)):
            return self._maximum()

    def _maximum(self):
        best = self._start = self._search(self._start)
        ratios = self.unit * np.expm1(best)
        ratios[best < 1e-6] = 0.0  # rounding of the search is no background
        logdet, gain = self.parts(ratios)
        tau = self.scale(gain)
        return Maximum(ratios * tau, float(np.sqrt(tau)), self._above(logdet, gain))

    def _above(self, logdet, gain):
        """ln L with κ where it is likeliest, relative to no background: there K = I, and Q = 0."""
        scaled = float(self.of_parts(logdet, gain, self.scale(gain)))
        return max(scaled - float(self.of_parts(0.0, 0.0, self.scale(0.0))), 0.0)

    def _search(self, x):
        """Where the loss is least for 0 ≤ x ≤ 60, by Newton's method with differences of its slope."""
        loss, slope = self._loss(x)
        for _ in range(100):
            free = ~((x <= 0) & (slope > 0) | (x >= 60) & (slope < 0))
            if np.abs(slope[free]).max(initial=0.0) < 1e-8:
                break
            bend = np.array([self._loss(x + 1e-5 * axis)[1] - slope for axis in np.eye(len(x))]) / 1e-5
            values, vectors = np.linalg.eigh((bend + bend.T)[np.ix_(free, free)] / 2)
            step = np.zeros(len(x))
            step[free] = -vectors @ (vectors.T @ slope[free] / np.maximum(np.abs(values), 1e-8))
            for shorter in 0.5 ** np.arange(30):
                there = np.clip(x + shorter * np.clip(step, -3, 3), 0, 60)
                value, its_slope = self._loss(there)
                if value <= loss + 1e-4 * slope @ (there - x):
                    break
            else:
                break  # no lower in double precision
            x, loss, slope = there, value, its_slope
        return x

    def _loss(self, x):
        """−ln L by a = unit (eˣ − 1), which is linear next to zero and logarithmic far from it; and its gradient."""
        ratios = self.unit * np.expm1(x)
        logdet, gain, by_logdet, by_gain = self._slopes(ratios)
        tau = self.scale(gain)
        slope = (by_logdet - by_gain / tau) / 2
        return -float(self.of_parts(logdet, gain, tau)), slope * self.unit * np.exp(x)

    def _slopes(self, ratios):
        """ln|K|, Q, and what they change by with each ratio."""
        if self._eigen is not None:
            values, squares = self._eigen
            left = 1 / (1 + ratios[0] * values)
            return (*self.parts(ratios), np.sum(values * left), np.sum(squares * left**2))
        factor, w, t = self._solved(ratios)
        left = self.rhs - w @ t
        diagonal = np.diag(self.matrix) - np.sum(t * t, 0)
        return 2 * np.log(np.diag(factor)).sum(), w @ w, self.shapes @ diagonal, self.shapes @ left**2

    def _solved(self, ratios):
        """L of K = L Lᵀ, L⁻¹ D^½ b', and the T = L⁻¹ D^½ N' of the information N' − TᵀT that is left."""
        root, k = kernel(self.matrix, ratios @ self.shapes)
        factor = cholesky(k, lower=True, overwrite_a=True, check_finite=False)
        sides = np.column_stack([root * self.rhs, root[:, None] * self.matrix])
        solved = solve_triangular(factor, sides, lower=True, check_finite=False)
        return factor, solved[:, 0], solved[:, 1:]

    def covariance(self, best: Maximum) -> FloatArray:
        """The covariance of the amplitudes and κ², from the expected information."""
        tau = best.noise_scale**2
        ratios = best.amplitudes / tau
        if self._eigen is not None:
            left = self._eigen[0] / (1 + ratios[0] * self._eigen[0])
            cross, single = np.array([[np.sum(left**2)]]), np.array([np.sum(left)])
        else:
            t = self._solved(ratios)[-1]
            r = self.matrix - t.T @ t
            cross, single = self.shapes @ r**2 @ self.shapes.T, self.shapes @ np.diag(r)
        k = len(self)
        information = np.empty((k + 1, k + 1))
        information[:k, :k] = cross
        information[:k, k] = information[k, :k] = single - cross @ ratios
        information[k, k] = self.n_data - 2 * ratios @ single + ratios @ cross @ ratios
        known = slice(None) if self.noise_scale else slice(k)
        scale = np.sqrt(np.diag(information)[known])
        scale = np.outer(scale, scale)
        covariance = np.full((k + 1, k + 1), np.nan)
        covariance[known, known] = 2 * tau**2 * np.linalg.pinv(information[known, known] / scale) / scale
        return covariance


def parity_p_value(apart: float, together: float) -> float:
    """Probability that two parities of one power look as different as they do, by the ratio of likelihoods."""
    return float(chdtrc(1, max(2 * (apart - together), 0.0)))


def _eliminated(normal, first, where):
    """N', b', χ0' of the places `where`, with the places `first` fitted freely."""
    matrix, rhs = normal.matrix[np.ix_(where, where)], normal.rhs[where]
    if not len(first):
        return np.array(matrix), np.array(rhs), float(normal.chi2_null)
    inner, across = normal.matrix[np.ix_(first, first)], normal.matrix[np.ix_(first, where)]
    scale = np.sqrt(np.maximum(np.diag(inner), 0))
    if not (scale > 0).all() or np.linalg.eigvalsh(inner / np.outer(scale, scale))[0] < 1e-10:
        raise DegeneracyError(
            f"{normal.n_sources} sources do not determine the {len(first)} coefficients that are fitted freely"
        )
    factor = cho_factor(inner)
    known = cho_solve(factor, np.column_stack([across, normal.rhs[first]]))
    schur = matrix - across.T @ known[:, :-1]
    chi2 = float(normal.chi2_null - normal.rhs[first] @ known[:, -1])
    return (schur + schur.T) / 2, rhs - across.T @ known[:, -1], chi2


def _eigen(matrix, rhs, shape):
    """For one spectrum: the eigenvalues λ of D^½ N' D^½, and the squares of the right-hand side along them."""
    root = np.sqrt(shape)
    values, vectors = np.linalg.eigh(matrix * np.outer(root, root))
    return np.maximum(values, 0.0), (vectors.T @ (root * rhs)) ** 2


#: Accuracy of a probability.
_ACCURACY = 1e-7


def probability_above(x: float, variances: FloatArray, shifts: FloatArray) -> float:
    """P(Σ λ_i (z_i + δ_i)² > x) with z_i ~ N(0, 1): Imhof (1961, Biometrika 48, 419), eq. 3.2."""
    scale = variances.max()
    ratio, x = variances / scale, x / scale

    def integrand(u):
        y = ratio * u
        inner = 1 + y * y
        angle = np.sum(np.arctan(y) + shifts**2 * y / inner) / 2 - x * u / 2
        size = np.sum(np.log(inner) / 4 + shifts**2 * y * y / inner / 2)
        return np.sin(angle) / u * np.exp(-size)

    from scipy.integrate import quad  # slow to import

    # What is left beyond the end: at most 1/(π k U^k √Πr) with k = n/2 (his eq. 3.4).
    k = len(ratio) / 2
    end = np.exp(-(np.log(np.pi * k * _ACCURACY) + np.sum(np.log(ratio)) / 2) / k)
    value, _ = quad(integrand, 0, end, limit=2000, epsabs=_ACCURACY)
    return float(np.clip(0.5 + value / np.pi, 0, 1))


def quantile(probability: float, variances: FloatArray, shifts: FloatArray) -> float:
    """The value below which Σ λ_i (z_i + δ_i)² lies with a probability."""
    from scipy.optimize import brentq  # slow to import

    mean = np.sum(variances * (1 + shifts**2))
    spread = np.sqrt(np.sum(2 * variances**2 * (1 + 2 * shifts**2)))
    high = mean + 3 * spread
    while probability_above(high, variances, shifts) > 1 - probability:
        high += 3 * spread
    return float(brentq(lambda x: 1 - probability - probability_above(x, variances, shifts), 0, high, xtol=1e-9 * high))


def squares_of(equations: NormalEquations, lmax: int, scaled: bool) -> tuple[float, float, FloatArray]:
    """P_2, its noise, variances and shifts of its terms, (2, 10), fitted with all degrees to lmax, or nan."""
    modes = equations.modes
    where = places(modes, range(1, lmax + 1))
    matrix, rhs = equations.matrix[np.ix_(where, where)], equations.rhs[where]
    second = np.flatnonzero(modes.degrees[where] == 2)
    if equations.n_data <= len(where) or np.linalg.cond(matrix) > 1e12:
        return float("nan"), float("nan"), np.full((2, len(second)), np.nan)
    covariance = np.linalg.inv(matrix)
    values = covariance @ rhs
    scale = (equations.chi2_null - values @ rhs) / (equations.n_data - len(where)) if scaled else 1.0
    root = np.sqrt(modes.norm2[where][second])
    variances, vectors = np.linalg.eigh(scale * covariance[np.ix_(second, second)] * np.outer(root, root))
    shifts = vectors.T @ (root * values[second]) / np.sqrt(variances)
    return float(np.sum(variances * shifts**2)), float(variances.sum()), np.array([variances, shifts])
