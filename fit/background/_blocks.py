"""The likelihood of what classes of sources share, and draws from its posterior.

Class i sees c_i = θ_i + s_i: degree 1, and whatever else is looked for, free and its own, and systematics with
Cov(s_i, s_j) = C_ij S, parity by parity, for one shape S; C = a² 11ᵀ + diag(b_i²) is what all share and what each has
for itself. With A the normal matrix of the other modes to L, the free ones eliminated class by class, β its right-hand
sides, Σ = C ⊗ S = R Rᵀ and G = 1 + Rᵀ A R = Λ Λᵀ,

    ln L = ½ wᵀ w − Σ ln Λ_kk,   w = Λ⁻¹ Rᵀ β.

Classes that have no source in common have A = blockdiag A_i. If several catalogues of the same sources are compared
with one of them, their differences have common noise, and A has blocks between any two of them. Then a is the amplitude
of the systematic errors of the reference, which enter all differences, and b_i that of catalogue i. Amplitudes of
templates stand behind the modes, with one variance for all of them, the same in all classes.

The amplitudes a, b_i are drawn by importance sampling, flat in each a priori; ln L is even in them.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import block_diag, cholesky, solve_triangular
from scipy.linalg.lapack import dpotrf
from scipy.special import gammaln, logsumexp

from fit.background._floor import shape_probabilities
from fit.normal import NormalEquations
from vsh.models.covariance import Spectrum
from vsh.modes import Modes
from vsh.tools.errors import DegeneracyError
from vsh.tools.parallel import limit_blas
from vsh.tools.types import BoolArray, FloatArray, IntArray

#: Degrees of freedom of the proposals.
_DOF = 5.0
#: Numbers in the matrices that are factored together: four megabytes stay near the processor.
_CHUNK_NUMBERS = 2**19
#: Draws that count fewer than this are drawn again, four times as many, up to a limit.
EFFECTIVE = 20.0
#: So many draws of equal weight are kept.
_N_KEPT = 60


@dataclass(frozen=True, eq=False)
class ClassEquations:
    """Normal equations of K classes with the modes that are free in each of them eliminated, and these by themselves.

    `matrix` is (t, q, q), of the t `pairs` of classes (2, t) between which there is anything: of each with itself, or
    of any two where classes share their noise; `rhs` (K, q), `free_matrix` (f K, f K), `free_rhs` (f K,), and
    `leverage` free_matrix⁻¹ times the part between, (f K, K, q). `free` tells the f free modes, (p,).
    """

    matrix: FloatArray
    pairs: IntArray
    rhs: FloatArray
    free_matrix: FloatArray
    free_rhs: FloatArray
    leverage: FloatArray
    noise_scale: tuple[float, ...]
    condition: tuple[float, ...]
    free: BoolArray

    def __len__(self) -> int:
        return len(self.rhs)

    @property
    def own(self) -> FloatArray:
        """The normal matrix of each class by itself, (K, q, q)."""
        return self.matrix[self.pairs[0] == self.pairs[1]]

    @classmethod
    def from_separate_classes(cls, classes: "Sequence[ClassEquations]") -> "ClassEquations":
        """Classes that have no source in common."""
        k, (n_free, q) = len(classes), classes[0].leverage.shape[::2]
        leverage = np.zeros((k, n_free, k, q))
        for i, equations in enumerate(classes):
            leverage[i, :, i] = equations.leverage[:, 0]
        return cls(
            np.concatenate([equations.matrix for equations in classes]), np.tile(np.arange(k), (2, 1)),
            np.concatenate([equations.rhs for equations in classes]),
            block_diag(*(equations.free_matrix for equations in classes)),
            np.concatenate([equations.free_rhs for equations in classes]),
            leverage.reshape(k * n_free, k, q), sum((equations.noise_scale for equations in classes), ()),
            sum((equations.condition for equations in classes), ()), classes[0].free,
        )  # fmt: skip

    @classmethod
    def from_joint_equations(cls, matrix: FloatArray, rhs: FloatArray, modes: Modes) -> "ClassEquations":
        """Classes whose noise is shared, from their normal equations, (K, p, K, p) and (K, p)."""
        k, is_free, matrix = len(rhs), modes.degrees == 1, matrix.reshape(rhs.size, rhs.size)
        message = "sources in common do not determine rotation and glide of all catalogues"
        return _eliminate_free(matrix, rhs.ravel(), np.tile(is_free, k), message, (1.0,) * k, (1.0,) * k, is_free)


def _eliminate_free(matrix, rhs, mask, message, noise_scale, condition, free):
    """The equations of classes without what of all their unknowns is free; DegeneracyError with `message` if singular.

    There are as many classes as scales of the noise, one after the other, and any two may share some.
    """
    free_matrix, across = matrix[np.ix_(mask, mask)], matrix[np.ix_(mask, ~mask)]
    if np.linalg.cond(free_matrix) > 1e12:
        raise DegeneracyError(message)
    leverage, k = np.linalg.solve(free_matrix, across), len(noise_scale)
    inner, reduced_rhs = matrix[np.ix_(~mask, ~mask)] - across.T @ leverage, rhs[~mask] - leverage.T @ rhs[mask]
    q = len(reduced_rhs) // k
    return ClassEquations(
        inner.reshape(k, q, k, q).swapaxes(1, 2).reshape(-1, q, q), np.indices((k, k)).reshape(2, -1),
        reduced_rhs.reshape(k, q), free_matrix, rhs[mask], leverage.reshape(-1, k, q), noise_scale, condition, free,
    )  # fmt: skip


def compute_condition(matrix: FloatArray) -> float:
    """The condition of the normal matrix of a class, its diagonal scaled to one."""
    scale = np.sqrt(np.diag(matrix))
    if not (scale > 0).all():
        raise DegeneracyError("a class sees nothing of some coefficients: it has no sources, or too few")
    return float(np.linalg.cond(matrix / np.outer(scale, scale)))


def reduce_class_equations(
    normal: NormalEquations, modes: Modes, scaled: bool = True, free: BoolArray | None = None
) -> ClassEquations:
    """The equations of a class to the degree of `modes`; errors scaled by its own χ²/dof where that is known.

    Degree 1, and the mean of a scalar field, are free unless `free`, (p,), says more.
    """
    free = modes.degrees <= 1 if free is None else free
    low_indices = np.flatnonzero(normal.modes.degrees <= modes.lmax)
    matrix, rhs = normal.matrix[np.ix_(low_indices, low_indices)], normal.rhs[low_indices]
    templates = np.reshape([template.values[low_indices] for template in normal.templates], (-1, len(low_indices)))
    condition = compute_condition(matrix)
    ridge = 1e-9 * np.diag(np.diag(matrix))  # of few sources the matrix may be singular
    chi2 = normal.chi2_null - rhs @ np.linalg.solve(matrix + ridge, rhs)
    tau = chi2 / (normal.n_data - len(low_indices)) if scaled and normal.n_data > 1.5 * len(low_indices) else 1.0
    if not tau > 0:
        raise DegeneracyError("all residuals are zero: was a catalogue compared with itself?")
    extension = np.vstack([np.eye(len(low_indices)), templates])  # EᵀNE and Eᵀb
    matrix, rhs = extension @ matrix @ extension.T / tau, extension @ rhs / tau
    mask = np.r_[free, np.zeros(len(templates), bool)]
    message = "a class does not determine its degree 1: merge it with another"
    return _eliminate_free(matrix, rhs, mask, message, (float(np.sqrt(tau)),), (condition,), free)


def map_parities(modes: Modes) -> IntArray:
    """0 for the parity of a spin (T of odd degrees, S of even ones), 1 for that of a glide; 0 of all scalar modes."""
    if modes.components == 1:
        return np.zeros(len(modes), int)
    toroidal = np.arange(len(modes)) < len(modes) // 2
    return np.where(toroidal == (modes.degrees % 2 == 1), 0, 1)


class ClassLikelihood:
    """ln L of the amplitudes x = (a, b_1 … b_K) of both parities, in their units, for one shape of the spectrum."""

    def __init__(self, classes: ClassEquations, modes: Modes, variances: FloatArray, own: str) -> None:
        is_free, is_high = classes.free, ~classes.free
        group = map_parities(modes)
        self.n_groups = n_groups = int(group.max()) + 1
        self.classes, self.own = classes, own
        self.n_classes, self.n_modes = len(classes), int(is_high.sum())
        extras = np.ones(classes.rhs.shape[1] - self.n_modes)
        group_index = np.r_[group[is_high], np.full(extras.size, n_groups)]
        order = np.argsort(group_index, kind="stable")  # one parity, the other, templates
        self.group, self.free_group, self.size = group_index[order], group[is_free], order.size
        self.matrices, self.pairs = classes.matrix[:, order][:, :, order], classes.pairs
        self.rhs, self.leverage = classes.rhs[:, order], classes.leverage[:, :, order]
        shape = np.r_[variances[is_high], extras][order]
        self.root, self.free_variances = np.sqrt(shape), variances[is_free]
        self.dipole = variances[modes.degrees == 1]
        scaled_matrices = self.matrices * self.root[:, None] * self.root
        ends = np.searchsorted(self.group, range(n_groups + (extras.size > 0) + 1))
        self.groups = [slice(low, high) for low, high in pairwise(ends)]
        #: √S A √S of the pairs of classes, flat, for each pair of groups.
        self.scaled = {
            (g, h): scaled_matrices[:, rows, columns].reshape(len(scaled_matrices), -1)
            for g, rows in enumerate(self.groups)
            for h, columns in enumerate(self.groups)
        }
        units = np.array([self._find_units(np.flatnonzero(self.group == g), shape) for g in range(n_groups)])
        if self.n_classes == 1:
            units = units[:, :1]
        elif own == "one":
            units = np.c_[units[:, 0], units[:, 0]]
        #: Roots of amplitudes that would be seen at one standard error, (1 or 2, 1 + K), that of templates behind them.
        self.mode_units = units
        template = self._find_units(np.flatnonzero(self.group == n_groups), shape)[:1] if extras.size else np.empty(0)
        self.units = np.r_[units.ravel(), template]

    def _find_units(self, indices, variances):
        squares = self.matrices[self.pairs[0] == self.pairs[1]][:, indices][:, :, indices] ** 2
        class_squares = [squares.sum(0), *squares]
        return np.sqrt([1 / np.sqrt(variances[indices] @ square @ variances[indices] / 2) for square in class_squares])

    def shares(self, x: FloatArray) -> FloatArray:
        """C of both parities, and of templates where there are some, (…, 2 or 3, K, K), for x of shape (…, d)."""
        squares = (x * self.units) ** 2
        of_modes = squares[..., : self.mode_units.size].reshape(*squares.shape[:-1], *self.mode_units.shape)
        ones = np.ones((self.n_classes, self.n_classes))
        common = np.concatenate([of_modes[..., 0], squares[..., self.mode_units.size :]], -1)[..., None, None] * ones
        if self.n_classes > 1:
            # One of each class, or one for all.
            common[..., : self.n_groups, :, :] += of_modes[..., 1:, None] * np.eye(self.n_classes)
        return common

    def _factor_shares(self, x):
        """The Cholesky factor of C of each group, (n, 2 or 3, K, K)."""
        shares = self.shares(x)
        # Without what each has for itself C would be singular.
        size = np.trace(shares, axis1=-2, axis2=-1)[..., None, None] + (self.units**2).min()
        return np.linalg.cholesky(shares + 1e-9 * np.eye(self.n_classes) * size)

    def _fill_gram(self, gram: FloatArray, root: FloatArray) -> None:
        """Set Rᵀ A R of each draw, (n, K, q, K, q), on and above the diagonal: a product for each pair of groups."""
        i, j = np.triu_indices(self.n_classes)
        first, second = self.pairs
        for (g, h), matrix in self.scaled.items():
            rows, columns = self.groups[g], self.groups[h]
            weights = root[:, g].swapaxes(1, 2)[:, i][..., first] * root[:, h].swapaxes(1, 2)[:, j][..., second]
            products = weights.reshape(-1, len(matrix)) @ matrix
            products = products.reshape(len(root), len(i), rows.stop - rows.start, -1)
            for k, (class_i, class_j) in enumerate(zip(i, j, strict=True)):
                gram[:, class_i, rows, class_j, columns] = products[:, k]

    def _compute_factors(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R by class and mode, (n, K, K, q), and Λ with w as a row below it, (n, K q + 1, K q + 1), of draws (n, d).

        Above the diagonal of Λ stands anything.
        """
        root = self._factor_shares(x)
        r = root[:, self.group].transpose(0, 2, 3, 1) * self.root
        n, k, q = len(x), self.n_classes, self.size
        gram = np.zeros((n, k * q + 1, k * q + 1))
        self._fill_gram(gram[:, :-1, :-1].reshape(n, k, q, k, q), root)  # axes that are split stay a view
        np.einsum("nii->ni", gram)[...] += 1
        gram[:, :-1, -1] = np.einsum("nmjk,mk->njk", r, self.rhs).reshape(n, -1)
        gram[:, -1, -1] = 1e300  # the corner of the factor is not used, and must be larger than w·w
        lower = gram.swapaxes(1, 2)  # each in the order that LAPACK overwrites, three times as fast as a stack
        for matrix in lower:
            _, info = dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
            if info:  # cannot be: it is the identity and more
                raise DegeneracyError("the normal matrix of a class is not positive: it is no sum over sources")
        return r, lower

    def factor(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """R by class and mode, Λ (its lower triangle), and w, for one x."""
        (r,), (lower,) = self._compute_factors(x[None])
        return r, lower[:-1, :-1], lower[-1, :-1]

    def log_likelihoods(self, x: FloatArray) -> FloatArray:
        """ln L of each draw, (n, d), relative to no systematics."""
        chunk_size = max(1, _CHUNK_NUMBERS // (self.n_classes * self.size) ** 2)
        log_likelihoods = []
        for start in range(0, len(x), chunk_size):
            _, lower = self._compute_factors(x[start : start + chunk_size])
            w, diagonal = lower[:, -1, :-1], np.einsum("nii->ni", lower)[:, :-1]
            log_likelihoods.append(np.einsum("ni,ni->n", w, w) / 2 - np.log(diagonal).sum(1))
        return np.concatenate(log_likelihoods)

    def loss(self, x: FloatArray) -> tuple[float, FloatArray]:
        """−ln L and its gradient by the squares of x.

        ∂ln L/∂C_ij = ½ Σ_k S_k (r_ik r_jk − T_ik,jk), r = β − A m the residual of the mean and T = A − A R G⁻¹ Rᵀ A.
        """
        r, lower, w = self.factor(x)
        k, q = self.n_classes, self.size
        across, matrix_diagonal = self._multiply_by_matrix(r)
        solution = solve_triangular(lower, across, lower=True, check_finite=False)
        residual = (self.rhs.ravel() - solution.T @ w).reshape(k, q)
        solution = solution.reshape(-1, k, q)
        shrinkage = -np.einsum("zik,zjk->ijk", solution, solution)
        slope = (residual[:, None] * residual[None] - shrinkage - matrix_diagonal) * self.root**2 / 2
        by_group = np.stack([slope[:, :, self.group == g].sum(2) for g in range(self.n_groups + 1)])
        diagonal = np.einsum("gii->gi", by_group)[: self.n_groups]
        common = by_group.sum((1, 2))
        gradient = common[: self.n_groups, None]
        if k > 1:
            gradient = np.c_[gradient, diagonal if self.own == "each" else diagonal.sum(1)]
        gradient = np.r_[gradient.ravel(), common[self.n_groups :]][: self.units.size]
        return float(np.log(np.diag(lower)).sum() - w @ w / 2), -gradient * self.units**2

    def _multiply_by_matrix(self, r):
        """Rᵀ A, and the diagonal over modes of A for each pair of classes, (K, K, q)."""
        k, q = self.n_classes, self.size
        across, diagonal = np.zeros((k, q, k, q)), np.zeros((k, k, q))
        for first, second, matrix in zip(*self.pairs, self.matrices, strict=True):
            across[:, :, second] += r[first][:, :, None] * matrix
            diagonal[first, second] = matrix.diagonal()
        return across.reshape(k * q, k * q), diagonal

    def sample(self, n: int, rng: np.random.Generator, least: float = 0.0) -> tuple[FloatArray, FloatArray, float]:
        """Draws of the amplitudes, (n, d), their weights, and ln of the evidence: the mode, then importance.

        If the effective number of draws is below `least`, the proposal is adapted with twice as many, and then with
        four times.
        """
        centre, covariance = self._find_peak()
        half = max(1, n // 2)
        for count in (half, half, n, 2 * n, 4 * n):
            x, log_density = _draw_folded_t(centre, 1.2 * covariance, count, rng)
            log_weight = self.log_likelihoods(x) - log_density
            weight = np.exp(log_weight - log_weight.max())
            evidence = float(np.log(weight.mean()) + log_weight.max())
            weight /= weight.sum()
            is_few = 1 / np.sum(weight**2) < 2 * centre.size
            # Where too few count, flatten the weights, and widen.
            proposal_weight = weight**0.3 / np.sum(weight**0.3) if is_few else weight
            centre = proposal_weight @ x
            scatter = np.einsum("n,ni,nj->ij", proposal_weight, x - centre, x - centre)
            covariance = scatter + 0.1 * covariance if is_few else 1.1 * scatter
            if count >= n and 1 / np.sum(weight**2) >= least:
                break
        return x, weight, evidence

    def _find_peak(self):
        """The mode, and a covariance from the curvature there."""
        from scipy.optimize import minimize  # slow to import

        size = self.units.size

        def loss_by_log(y):  # x² = eʸ − 1 is linear next to zero, where x itself would be stuck
            value, slope = self.loss(np.sqrt(np.expm1(y)))
            return value, slope * np.exp(y)

        best = minimize(
            loss_by_log, np.ones(size), jac=True, method="L-BFGS-B", bounds=[(0, 30)] * size, options={"ftol": 1e-9}
        )
        peak, hessian = np.sqrt(np.expm1(best.x)), np.empty((size, size))
        for k in range(size):
            step = np.zeros(size)
            step[k] = 0.05 * max(peak[k], 1)
            up, down = (2 * (peak + s * step) * self.loss(np.abs(peak + s * step))[1] for s in (1, -1))
            hessian[k] = (up - down) / (2 * step[k])
        eigenvalues, vectors = np.linalg.eigh((hessian + hessian.T) / 2)
        return peak, vectors / np.maximum(eigenvalues, 0.25) @ vectors.T  # never wider than two units

    def fit_free_modes(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """θ of all classes, (K, f), and its covariance, (K, f, K, f): what the other modes leave, and C ⊗ S."""
        r, lower, w = self.factor(x)
        k, q = self.n_classes, self.size
        across = np.einsum("mjk,amk->jka", r, self.leverage).reshape(k * q, -1)
        z = solve_triangular(lower, across, lower=True, check_finite=False)
        n_free = self.free_variances.size
        covariance = (z.T @ z + np.linalg.inv(self.classes.free_matrix)).reshape(k, n_free, k, n_free)
        values = np.linalg.solve(self.classes.free_matrix, self.classes.free_rhs) - z.T @ w
        shares, free_indices = self.shares(x)[self.free_group], np.arange(n_free)
        for i, j in np.ndindex(k, k):
            covariance[i, free_indices, j, free_indices] += shares[:, i, j] * self.free_variances
        return values.reshape(k, n_free), covariance

    def fit_templates(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Amplitudes of the templates beside the systematic errors, free a priori, and their covariance."""
        n = self.n_modes
        if n == self.size:
            return np.zeros(0), np.zeros((0, 0))
        r, _, _ = self.factor(x)
        root, k = r[:, :, :n], self.n_classes
        modes, across = self.matrices[:, :n, :n], self.matrices[:, :n, n:]
        gram = np.einsum("mjk,mkl,mil->jkil", root, modes, root, optimize=True).reshape(k * n, k * n)
        lower = cholesky(gram + np.eye(k * n), lower=True, check_finite=False)
        sides = np.concatenate([across, self.rhs[:, :n, None]], 2)
        z = solve_triangular(lower, np.einsum("mjk,mkt->jkt", root, sides).reshape(k * n, -1), lower=True)
        precision = self.matrices[:, n:, n:].sum(0) - z[:, :-1].T @ z[:, :-1]
        covariance = np.linalg.inv(precision)
        return covariance @ (self.rhs[:, n:].sum(0) - z[:, :-1].T @ z[:, -1]), covariance


def _draw_folded_t(centre, covariance, n, rng) -> tuple[FloatArray, FloatArray]:
    """|x| of a multivariate t, and ln of its density: all signs of what lies near zero are summed over."""
    size = len(centre)
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(size))
    scale = np.sqrt(rng.chisquare(_DOF, size=(n, 1)) / _DOF)
    x = np.abs(centre + (rng.normal(size=(n, size)) @ root.T) / scale)
    near_zero = np.flatnonzero(centre < 6 * np.sqrt(np.diag(covariance)))
    signs: Any = np.ones((2 ** len(near_zero), size))
    signs[:, near_zero] = list(product((1, -1), repeat=len(near_zero)))
    inverse = np.linalg.inv(root)
    precision = inverse.T @ inverse
    constant = gammaln((_DOF + size) / 2) - gammaln(_DOF / 2) - size / 2 * np.log(_DOF * np.pi)
    log_density = np.empty(n)
    i, j = np.triu_indices(size)
    pairs, pair_precision = signs[:, i] * signs[:, j], np.where(i == j, 1.0, 2.0) * precision[i, j]
    pull = precision @ centre
    for start in range(0, n, 64):  # many signs of many draws would fill the memory
        chunk = x[start : start + 64]
        # (s x − µ)ᵀ P (s x − µ) of all signs s at once.
        square = pairs @ (chunk[:, i] * chunk[:, j] * pair_precision).T - 2 * signs @ (chunk * pull).T + centre @ pull
        log_density[start : start + 64] = logsumexp(-(_DOF + size) / 2 * np.log1p(np.maximum(square, 0) / _DOF), axis=0)
    return x, log_density - np.log(np.diag(root)).sum() + constant


class ShapeDraws(NamedTuple):
    """Draws of the amplitudes of one shape: shares times `scale` times the spectrum's variances are powers."""

    shape: str
    spectrum: Spectrum
    probability: float
    likelihood: ClassLikelihood
    scale: float
    x: FloatArray
    weight: FloatArray

    @property
    def effective(self) -> float:
        """Effective number of draws."""
        return float(1 / np.sum(self.weight**2))


def sample_shapes(
    classes: ClassEquations,
    modes: Modes,
    spectra: Sequence[tuple[str, Spectrum]],
    own: str,
    draws: int,
    rng: np.random.Generator,
) -> list[ShapeDraws]:
    """Draws of the amplitudes for each shape, again where too few of them count."""
    squares: Any = sum(classes.own**2)
    is_higher = ~classes.free
    flat = spectra[0][1].flat().variances(modes)[is_higher]
    squares = squares[: len(flat), : len(flat)]  # without templates
    lots, evidences = [], []
    with limit_blas(len(classes) * len(modes)):
        for name, spectrum in spectra:
            variances = spectrum.variances(modes)
            # All shapes as well seen as the flat one, or their evidence would depend on units.
            scale = np.sqrt((flat @ squares @ flat) / (variances[is_higher] @ squares @ variances[is_higher]))
            likelihood = ClassLikelihood(classes, modes, variances * scale, own)
            x, weight, evidence = likelihood.sample(draws, rng, EFFECTIVE)
            lots.append(ShapeDraws(name, spectrum, np.nan, likelihood, float(scale), x, weight))
            evidences.append(evidence)
    probability = shape_probabilities([name for name, _ in spectra], evidences)
    return [lot._replace(probability=float(p)) for lot, p in zip(lots, probability, strict=True)]


def resample_draws(lots: Sequence[ShapeDraws], rng: np.random.Generator) -> tuple[Any, Any, Any, Any]:
    """Draws of equal weight by systematic resampling: free modes, their covariance, C by the flat one, templates."""
    weight = np.concatenate([lot.probability * lot.weight for lot in lots])
    draws = [(lot, i) for lot in lots for i in range(len(lot.x))]
    positions = (np.arange(_N_KEPT) + rng.random()) / _N_KEPT
    indices = np.minimum(np.searchsorted(np.cumsum(weight) / weight.sum(), positions), len(weight) - 1)
    results: dict[int, Any] = {}
    for k in indices:
        if k not in results:
            lot, i = draws[k]
            n_groups, dipole = lot.likelihood.n_groups, lot.likelihood.dipole
            flat_variances = lot.spectrum.flat().variances(lot.spectrum.mode_class(1))[-dipole.size :]
            power = (dipole.reshape(n_groups, 3).mean(1)) / flat_variances.reshape(n_groups, 3).mean(1)
            shares = lot.likelihood.shares(lot.x[i])[:n_groups] * power[:, None, None]
            results[k] = (*lot.likelihood.fit_free_modes(lot.x[i]), shares, *lot.likelihood.fit_templates(lot.x[i]))
    means, covariances, shares, values, spreads = (np.array([results[k][index] for k in indices]) for index in range(5))
    deviations = values - values.mean(0)
    return means, covariances, shares, (values.mean(0), spreads.mean(0) + deviations.T @ deviations / len(deviations))
