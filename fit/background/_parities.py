"""The likelihood of the powers of the two parities, which share no coefficient: ln|K| and Q by halves.

Turned to the axes of its own N', each parity by itself is diagonal, with eigenvalues λ and μ. What is left is how the
sky mixes them, S = (a/(1 + aλ))^½ C (b/(1 + bμ))^½, small where the sky is whole:

    ln|K| = Σ ln(1 + aλ) + Σ ln(1 + bμ) + ln|I − S Sᵀ|,
    Q     = fᵀf + gᵀg − 2 fᵀS g + |Sᵀf|² + |S g|² + O(S³),   f = (a/(1 + aλ))^½ x,   g = (b/(1 + bμ))^½ y.

To first order in S Sᵀ the sums are products of small matrices on any tensor of a and b; the rest is computed exactly at
a few nodes and interpolated.
"""

from collections.abc import Sequence
from functools import cache, cached_property

import numpy as np
from numpy.polynomial import chebyshev
from scipy.linalg.blas import dsyrk, ssyrk
from scipy.linalg.lapack import dposv, sposv

from fit.background._likelihood import Likelihood, scales_of, span_of
from fit.normal import NormalEquations
from vsh.models.covariance import Spectrum
from vsh.tools.errors import ConvergenceError
from vsh.tools.parallel import blas_for
from vsh.tools.types import FloatArray

#: Nodes along each amplitude, each set within the next, until the rest of ln L is interpolated to `_ACCURACY`.
_NODES = (3, 5, 9)
_ACCURACY = 2e-3
#: How often the region is moved to where the maximum turns out to be.
_ROUNDS = 4
_MIXED = "the sky mixes the parities too much for an expansion"
#: Where that is tried, in parts of the way.
_BETWEEN = ((0.3, 0.7), (0.85, 0.2))


class Parities(Likelihood):
    """ln L of the powers of odd and even parity, by an expansion for high degrees.

    Raises
    ------
    ConvergenceError
        If the sky mixes the parities too much for it: half of it empty, say.
    """

    _rest: "_Remainder | None" = None

    def __init__(
        self,
        normal: NormalEquations,
        degrees: Sequence[int],
        free: Sequence[int],
        noise_scale: bool = True,
        shape: Spectrum | None = None,
    ) -> None:
        spectrum = Spectrum.flat() if shape is None else shape
        super().__init__(normal, [spectrum.only("odd"), spectrum.only("even")], degrees, free, noise_scale)
        with blas_for(len(self.rhs)):
            self._rest = _Remainder()
            for _ in range(_ROUNDS):
                best = self._maximum()
                ends = self._region(best)
                if self._rest.holds(ends):
                    return
                self._rest = self._interpolate(ends, best.noise_scale**2)
        raise ConvergenceError(_MIXED)

    def exact(self, ratios: FloatArray) -> tuple[float, float]:
        """ln|K| and Q of one pair of ratios."""
        (a, b), (odd, even, c, x, y) = ratios, self._diagonal_blocks
        w, v = a / (1 + a * odd), b / (1 + b * even)
        s = np.sqrt(w)[:, None] * c * np.sqrt(v)
        f, g = np.sqrt(w) * x, np.sqrt(v) * y
        side = f - s @ g
        factor, solution, info = dposv(_less_square(dsyrk, s), side, lower=1, overwrite_a=1)
        if info:
            raise ConvergenceError(_MIXED)
        logdet = np.log1p(a * odd).sum() + np.log1p(b * even).sum() + 2 * np.log(factor.diagonal()).sum()
        return float(logdet), float(g @ g + side @ solution)

    def _left(self, ratios):
        """Terms of `exact` beyond first order, in single precision: it is small, and is interpolated.

        With h = f − S g and (I − M) z = h, where M = S Sᵀ: ln|I − M| + tr M and (Sᵀh)ᵀ(Sᵀz) − |Sᵀf|².
        """
        (a, b), (odd, even, _, x, y) = ratios, self._diagonal_blocks
        w, v = np.sqrt(a / (1 + a * odd)).astype("f4"), np.sqrt(b / (1 + b * even)).astype("f4")
        s = w[:, None] * self._single * v
        f, g = w * x.astype("f4"), v * y.astype("f4")
        h = f - s @ g
        matrix = _less_square(ssyrk, s)
        trace = len(s) - matrix.trace(dtype=float)
        factor, z, info = sposv(matrix, h, lower=1, overwrite_a=1)
        if info:  # a strong field on a part of the sky: I − S Sᵀ is nearly singular, and rounded below
            raise ConvergenceError(_MIXED)
        logdet = 2 * np.log(factor.diagonal(), dtype=float).sum() + trace
        return np.array([logdet, np.vdot(h @ s, z @ s) - np.sum((f @ s) ** 2)], dtype=float)

    def parts(self, amplitudes: FloatArray) -> tuple[float, float]:
        """ln|K| and Q for amplitudes in units of κ²."""
        if self._rest is None:
            return self.exact(amplitudes)
        logdet, gain = self._near(*amplitudes[:, None]) + self._rest.at(self._places(amplitudes))
        return float(logdet[0, 0]), float(gain[0, 0])

    def scale(self, gain: float) -> float:
        """κ² where it is likeliest, for some ratios; ConvergenceError where more is explained than there is."""
        if gain >= self.chi2:
            raise ConvergenceError(_MIXED)
        return super().scale(gain)

    def on_tensor(self, roots: list[FloatArray]) -> FloatArray:
        """ln|K| and Q on the tensor of two √a, (2, …)."""
        positions = [np.arcsinh(x / unit) for x, unit in zip(roots, np.sqrt(self.unit), strict=True)]
        assert self._rest is not None
        return self._near(roots[0] ** 2, roots[1] ** 2) + self._rest.at(positions)

    def together(self) -> float:
        """ln L where it is largest for one power in both parities, relative to none."""
        with blas_for(len(self.rhs)):
            lower, upper = 0.0, 3 * np.sqrt(self.unit.max() + max(self._highest(k) for k in range(2)))
            for _ in range(4):
                root = np.linspace(lower, upper, 32)
                logdet, gain = (np.diagonal(array) for array in self.on_tensor([root, root]))
                tau = np.maximum((self.chi2 - gain) / self.n_data, 1e-300) if self.noise_scale else 1.0
                top = int(np.argmax(self.of_parts(logdet, gain, tau)))
                lower, upper = root[max(top - 1, 0)], root[min(top + 1, 31)]
            return self._log_likelihood_excess(*self.exact(np.full(2, root[top] ** 2)))

    def _highest(self, k):
        """End of the interpolated region of an amplitude."""
        assert self._rest is not None
        return self.unit[k] * np.sinh(self._rest.ends[k][1]) ** 2

    @cached_property
    def _diagonal_blocks(self):
        """λ and μ, C, and the right-hand sides x and y along their axes."""
        root = np.sqrt(self.shares.sum(0))
        matrix, side = root[:, None] * self.matrix * root, root * self.rhs
        odd, even = (np.flatnonzero(shape) for shape in self.shares)
        (odd_values, u), (even_values, v) = (np.linalg.eigh(matrix[np.ix_(rows, rows)]) for rows in (odd, even))
        c = u.T @ matrix[np.ix_(odd, even)] @ v
        return np.maximum(odd_values, 0.0), np.maximum(even_values, 0.0), c, u.T @ side[odd], v.T @ side[even]

    @cached_property
    def _squares(self):
        return self._diagonal_blocks[2] ** 2

    @cached_property
    def _single(self):
        return self._diagonal_blocks[2].astype("f4")

    def _near(self, a, b):
        """ln|K| and Q to first order on the tensor of ratios a and b, (2, a, b)."""
        odd, even, c, x, y = self._diagonal_blocks
        w, v = a[:, None] / (1 + np.outer(a, odd)), b[:, None] / (1 + np.outer(b, even))
        logdet = np.log1p(np.outer(a, odd)).sum(1)[:, None] + np.log1p(np.outer(b, even)).sum(1)
        logdet -= w @ (self._squares @ v.T)
        h, k = (w * x) @ c, (v * y) @ c.T
        gain = (w @ x**2)[:, None] + v @ y**2 - 2 * h @ (v * y).T + h**2 @ v.T + w @ (k**2).T
        return np.stack([logdet, gain])

    def slopes(self, amplitudes: FloatArray) -> tuple[float, float, FloatArray, FloatArray]:
        """ln|K|, Q, and what they change by with each ratio."""
        (a, b), (odd, even, c, x, y) = amplitudes, self._diagonal_blocks
        w, v = a / (1 + a * odd), b / (1 + b * even)
        dw, dv = 1 / (1 + a * odd) ** 2, 1 / (1 + b * even) ** 2
        h, k = (w * x) @ c, c @ (v * y)
        mixing = self._squares @ v
        by_logdet = np.array(
            [np.sum(odd / (1 + a * odd)) - dw @ mixing, np.sum(even / (1 + b * even)) - w @ self._squares @ dv]
        )
        dh, dk = (dw * x) @ c, c @ (dv * y)
        by_gain = np.array([
            dw @ x**2 - 2 * dh @ (v * y) + 2 * v @ (h * dh) + dw @ k**2,
            dv @ y**2 - 2 * h @ (dv * y) + dv @ h**2 + 2 * w @ (k * dk),
        ])  # fmt: skip
        remainder = self._rest_by(amplitudes)
        return *self.parts(amplitudes), by_logdet + remainder[0], by_gain + remainder[1]

    def _rest_by(self, ratios):
        """Derivatives of the remainder of ln|K| and of Q by each ratio, (2, 2): it is smooth, and differences will
        do."""
        assert self._rest is not None
        derivatives = np.zeros((2, 2))
        for i, step in enumerate(np.maximum(1e-3 * self.unit, 1e-6 * ratios)):
            lower, upper = np.array(ratios), np.array(ratios)
            lower[i], upper[i] = max(ratios[i] - step, 0.0), ratios[i] + step
            change = self._rest.at(self._places(upper)) - self._rest.at(self._places(lower))
            derivatives[:, i] = change[:, 0, 0] / (upper[i] - lower[i])
        return derivatives

    def _places(self, ratios):
        return list(np.arcsinh(np.sqrt(ratios / self.unit))[:, None])

    def _region(self, best):
        """Ends of the likelihood's region along each axis."""
        taus, _ = scales_of(self, best)
        spans = [span_of(self, best, k) for k in range(2)]
        return [
            (np.arcsinh(lower / np.sqrt(taus[-1]) / u), np.arcsinh(upper / np.sqrt(taus[0]) / u))
            for (lower, upper), u in zip(spans, np.sqrt(self.unit), strict=True)
        ]

    def _interpolate(self, ends, tau):
        """The rest in a region, and some way around it."""
        ends = [(0.9 * lower, upper + 0.1) for lower, upper in ends]

        @cache
        def left(*coordinates):
            if 0.0 in coordinates:  # one parity without power: there is nothing to mix
                return np.zeros(2)
            return self._left(self.unit * np.sinh(coordinates) ** 2)

        lower, upper = np.array(ends).T
        points = [lower + np.array(fraction) * (upper - lower) for fraction in _BETWEEN]
        exact_values = [left(*point) for point in points]
        for number in _NODES:
            remainder = _Remainder.through(left, ends, number)
            residuals = np.array([remainder.at(list(point[:, None]))[:, 0, 0] for point in points]) - exact_values
            if (np.abs(residuals) @ [0.5, 0.5 / tau]).max() < _ACCURACY:
                return remainder
        raise ConvergenceError(_MIXED)


class _Remainder:
    """Chebyshev interpolation of two quantities: zero unless given, constant beyond."""

    def __init__(
        self, series: FloatArray | None = None, ends: Sequence[tuple[float, float]] = ((0, 1), (0, 1))
    ) -> None:
        self.series, self.ends = np.zeros((2, 1, 1)) if series is None else series, ends

    def holds(self, ends):
        """Return whether a region lies within its own."""
        return bool(np.any(self.series)) and all(
            lower >= mine[0] and upper <= mine[1] for (lower, upper), mine in zip(ends, self.ends, strict=True)
        )

    @classmethod
    def through(cls, function, ends, number):
        """Interpolate through `number` × `number` values of a function that remembers them."""
        node = chebyshev.chebpts2(number).round(15)
        axes = [lower + (upper - lower) * (node + 1) / 2 for lower, upper in ends]
        values = np.array([[function(x, y) for y in axes[1]] for x in axes[0]])
        inverse = np.linalg.inv(chebyshev.chebvander(node, number - 1))
        return cls(np.einsum("ai,bj,ijk->kab", inverse, inverse, values), ends)

    def at(self, positions):
        """Both on the tensor of places along each axis, (2, m, n)."""
        left, right = (
            chebyshev.chebvander(np.clip(2 * (x - lower) / (upper - lower) - 1, -1, 1), self.series.shape[1] - 1)
            for x, (lower, upper) in zip(positions, self.ends, strict=True)
        )
        return left @ self.series @ right.T


def _less_square(syrk, s):
    """I − S Sᵀ, on and below its diagonal: half the work."""
    matrix = syrk(-1.0, s.T, trans=1, lower=1)
    matrix.ravel("K")[:: len(s) + 1] += 1
    return matrix
