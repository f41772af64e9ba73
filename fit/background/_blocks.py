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

from fit.background._floor import compute_shape_probabilities
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
MIN_EFFECTIVE_DRAWS = 20.0
#: So many draws of equal weight are kept.
_N_KEPT_DRAWS = 60


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
    def own_matrices(self) -> FloatArray:
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
        return _eliminate_free_modes(matrix, rhs.ravel(), np.tile(is_free, k), message, (1.0,) * k, (1.0,) * k, is_free)


def _eliminate_free_modes(matrix, rhs, mask, message, noise_scale, condition, free):
    """The equations of classes without what of all their unknowns is free; DegeneracyError with `message` if singular.

    There are as many classes as scales of the noise, one after the other, and any two may share some.
    """
    free_matrix, cross = matrix[np.ix_(mask, mask)], matrix[np.ix_(mask, ~mask)]
    if np.linalg.cond(free_matrix) > 1e12:
        raise DegeneracyError(message)
    leverage, k = np.linalg.solve(free_matrix, cross), len(noise_scale)
    inner, inner_rhs = matrix[np.ix_(~mask, ~mask)] - cross.T @ leverage, rhs[~mask] - leverage.T @ rhs[mask]
    q = len(inner_rhs) // k
    return ClassEquations(
        inner.reshape(k, q, k, q).swapaxes(1, 2).reshape(-1, q, q), np.indices((k, k)).reshape(2, -1),
        inner_rhs.reshape(k, q), free_matrix, rhs[mask], leverage.reshape(-1, k, q), noise_scale, condition, free,
    )  # fmt: skip


def compute_condition_number(matrix: FloatArray) -> float:
    """The condition of the normal matrix of a class, its diagonal scaled to one."""
    scale = np.sqrt(np.diag(matrix))
    if not (scale > 0).all():
        raise DegeneracyError("a class sees nothing of some coefficients: it has no sources, or too few")
    return float(np.linalg.cond(matrix / np.outer(scale, scale)))


def reduce_class_equations(
    normal: NormalEquations, modes: Modes, is_scaled: bool = True, free: BoolArray | None = None
) -> ClassEquations:
    """The equations of a class to the degree of `modes`; errors scaled by its own χ²/dof where that is known.

    Degree 1, and the mean of a scalar field, are free unless `free`, (p,), says more.
    """
    free = modes.degrees <= 1 if free is None else free
    low_indices = np.flatnonzero(normal.modes.degrees <= modes.lmax)
    matrix, rhs = normal.matrix[np.ix_(low_indices, low_indices)], normal.rhs[low_indices]
    templates = np.reshape([template.values[low_indices] for template in normal.templates], (-1, len(low_indices)))
    condition = compute_condition_number(matrix)
    ridge = 1e-9 * np.diag(np.diag(matrix))  # of few sources the matrix may be singular
    chi2 = normal.chi2_null - rhs @ np.linalg.solve(matrix + ridge, rhs)
    tau = chi2 / (normal.n_data - len(low_indices)) if is_scaled and normal.n_data > 1.5 * len(low_indices) else 1.0
    if not tau > 0:
        raise DegeneracyError("all residuals are zero: was a catalogue compared with itself?")
    extension = np.vstack([np.eye(len(low_indices)), templates])  # EᵀNE and Eᵀb
    matrix, rhs = extension @ matrix @ extension.T / tau, extension @ rhs / tau
    is_free = np.r_[free, np.zeros(len(templates), bool)]
    message = "a class does not determine its degree 1: merge it with another"
    return _eliminate_free_modes(matrix, rhs, is_free, message, (float(np.sqrt(tau)),), (condition,), free)


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
        parities = map_parities(modes)
        self.n_groups = n_groups = int(parities.max()) + 1
        self.classes, self.own = classes, own
        self.n_classes, self.n_modes = len(classes), int(is_high.sum())
        extras = np.ones(classes.rhs.shape[1] - self.n_modes)
        groups = np.r_[parities[is_high], np.full(extras.size, n_groups)]
        order = np.argsort(groups, kind="stable")  # one parity, the other, templates
        self.groups, self.free_groups, self.n_unknowns = groups[order], parities[is_free], order.size
        self.matrices, self.pairs = classes.matrix[:, order][:, :, order], classes.pairs
        self.rhs, self.leverage = classes.rhs[:, order], classes.leverage[:, :, order]
        shape = np.r_[variances[is_high], extras][order]
        self.root_variances, self.free_variances = np.sqrt(shape), variances[is_free]
        self.dipole_variances = variances[modes.degrees == 1]
        scaled_matrices = self.matrices * self.root_variances[:, None] * self.root_variances
        group_ends = np.searchsorted(self.groups, range(n_groups + (extras.size > 0) + 1))
        self.group_slices = [slice(low, high) for low, high in pairwise(group_ends)]
        #: √S A √S of the pairs of classes, flat, for each pair of groups.
        self.scaled_matrices = {
            (g, h): scaled_matrices[:, rows, columns].reshape(len(scaled_matrices), -1)
            for g, rows in enumerate(self.group_slices)
            for h, columns in enumerate(self.group_slices)
        }
        units = np.array([self._find_units(np.flatnonzero(self.groups == g), shape) for g in range(n_groups)])
        if self.n_classes == 1:
            units = units[:, :1]
        elif own == "one":
            units = np.c_[units[:, 0], units[:, 0]]
        #: Roots of amplitudes that would be seen at one standard error, (1 or 2, 1 + K), that of templates behind them.
        self.mode_units = units
        template = self._find_units(np.flatnonzero(self.groups == n_groups), shape)[:1] if extras.size else np.empty(0)
        self.units = np.r_[units.ravel(), template]

    def _find_units(self, indices, variances):
        squared_matrices = self.matrices[self.pairs[0] == self.pairs[1]][:, indices][:, :, indices] ** 2
        class_squares = [squared_matrices.sum(0), *squared_matrices]
        return np.sqrt([1 / np.sqrt(variances[indices] @ square @ variances[indices] / 2) for square in class_squares])

    def compute_shares(self, x: FloatArray) -> FloatArray:
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
        shares = self.compute_shares(x)
        # Without what each has for itself C would be singular.
        total_share = np.trace(shares, axis1=-2, axis2=-1)[..., None, None] + (self.units**2).min()
        return np.linalg.cholesky(shares + 1e-9 * np.eye(self.n_classes) * total_share)

    def _fill_gram_matrix(self, gram: FloatArray, root: FloatArray) -> None:
        """Set Rᵀ A R of each draw, (n, K, q, K, q), on and above the diagonal: a product for each pair of groups."""
        i, j = np.triu_indices(self.n_classes)
        pair_i, pair_j = self.pairs
        for (g, h), matrix in self.scaled_matrices.items():
            rows, columns = self.group_slices[g], self.group_slices[h]
            weights = root[:, g].swapaxes(1, 2)[:, i][..., pair_i] * root[:, h].swapaxes(1, 2)[:, j][..., pair_j]
            products = weights.reshape(-1, len(matrix)) @ matrix
            products = products.reshape(len(root), len(i), rows.stop - rows.start, -1)
            for k, (class_i, class_j) in enumerate(zip(i, j, strict=True)):
                gram[:, class_i, rows, class_j, columns] = products[:, k]

    def _compute_factors(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """R by class and mode, (n, K, K, q), and Λ with w as a row below it, (n, K q + 1, K q + 1), of draws (n, d).

        Above the diagonal of Λ stands anything.
        """
        root = self._factor_shares(x)
        r = root[:, self.groups].transpose(0, 2, 3, 1) * self.root_variances
        n, k, q = len(x), self.n_classes, self.n_unknowns
        gram = np.zeros((n, k * q + 1, k * q + 1))
        self._fill_gram_matrix(gram[:, :-1, :-1].reshape(n, k, q, k, q), root)  # axes that are split stay a view
        np.einsum("nii->ni", gram)[...] += 1
        gram[:, :-1, -1] = np.einsum("nmjk,mk->njk", r, self.rhs).reshape(n, -1)
        gram[:, -1, -1] = 1e300  # the corner of the factor is not used, and must be larger than w·w
        lower = gram.swapaxes(1, 2)  # each in the order that LAPACK overwrites, three times as fast as a stack
        for matrix in lower:
            _, info = dpotrf(matrix, lower=1, clean=0, overwrite_a=1)
            if info:  # cannot be: it is the identity and more
                raise DegeneracyError("the normal matrix of a class is not positive: it is no sum over sources")
        return r, lower

    def compute_draw_factors(self, x: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """R by class and mode, Λ (its lower triangle), and w, for one x."""
        (r,), (lower,) = self._compute_factors(x[None])
        return r, lower[:-1, :-1], lower[-1, :-1]

    def compute_log_likelihoods(self, x: FloatArray) -> FloatArray:
        """ln L of each draw, (n, d), relative to no systematics."""
        chunk_size = max(1, _CHUNK_NUMBERS // (self.n_classes * self.n_unknowns) ** 2)
        log_likelihoods = []
        for start in range(0, len(x), chunk_size):
            _, lower = self._compute_factors(x[start : start + chunk_size])
            w, diagonal = lower[:, -1, :-1], np.einsum("nii->ni", lower)[:, :-1]
            log_likelihoods.append(np.einsum("ni,ni->n", w, w) / 2 - np.log(diagonal).sum(1))
        return np.concatenate(log_likelihoods)

    def compute_loss(self, x: FloatArray) -> tuple[float, FloatArray]:
        """−ln L and its gradient by the squares of x.

        ∂ln L/∂C_ij = ½ Σ_k S_k (r_ik r_jk − T_ik,jk), r = β − A m the residual of the mean and T = A − A R G⁻¹ Rᵀ A.
        """
        r, lower, w = self.compute_draw_factors(x)
        k, q = self.n_classes, self.n_unknowns
        r_times_matrix, matrix_diagonal = self._multiply_by_matrix(r)
        whitened = solve_triangular(lower, r_times_matrix, lower=True, check_finite=False)
        residual = (self.rhs.ravel() - whitened.T @ w).reshape(k, q)
        whitened = whitened.reshape(-1, k, q)
        shrinkage = -np.einsum("zik,zjk->ijk", whitened, whitened)
        share_slopes = (residual[:, None] * residual[None] - shrinkage - matrix_diagonal) * self.root_variances**2 / 2
        group_slopes = np.stack([share_slopes[:, :, self.groups == g].sum(2) for g in range(self.n_groups + 1)])
        own_slopes = np.einsum("gii->gi", group_slopes)[: self.n_groups]
        common_slopes = group_slopes.sum((1, 2))
        gradient = common_slopes[: self.n_groups, None]
        if k > 1:
            gradient = np.c_[gradient, own_slopes if self.own == "each" else own_slopes.sum(1)]
        gradient = np.r_[gradient.ravel(), common_slopes[self.n_groups :]][: self.units.size]
        return float(np.log(np.diag(lower)).sum() - w @ w / 2), -gradient * self.units**2

    def _multiply_by_matrix(self, r):
        """Rᵀ A, and the diagonal over modes of A for each pair of classes, (K, K, q)."""
        k, q = self.n_classes, self.n_unknowns
        product, diagonal = np.zeros((k, q, k, q)), np.zeros((k, k, q))
        for row_class, column_class, matrix in zip(*self.pairs, self.matrices, strict=True):
            product[:, :, column_class] += r[row_class][:, :, None] * matrix
            diagonal[row_class, column_class] = matrix.diagonal()
        return product.reshape(k * q, k * q), diagonal

    def sample(self, n: int, rng: np.random.Generator, least: float = 0.0) -> tuple[FloatArray, FloatArray, float]:
        """Draws of the amplitudes, (n, d), their weights, and ln of the evidence: the mode, then importance.

        If the effective number of draws is below `least`, the proposal is adapted with twice as many, and then with
        four times.
        """
        centre, covariance = self._find_peak()
        n_half = max(1, n // 2)
        for n_draws in (n_half, n_half, n, 2 * n, 4 * n):
            x, log_density = _draw_folded_t(centre, 1.2 * covariance, n_draws, rng)
            log_weight = self.compute_log_likelihoods(x) - log_density
            weight = np.exp(log_weight - log_weight.max())
            evidence = float(np.log(weight.mean()) + log_weight.max())
            weight /= weight.sum()
            is_few = 1 / np.sum(weight**2) < 2 * centre.size
            # Where too few count, flatten the weights, and widen.
            proposal_weight = weight**0.3 / np.sum(weight**0.3) if is_few else weight
            centre = proposal_weight @ x
            scatter = np.einsum("n,ni,nj->ij", proposal_weight, x - centre, x - centre)
            covariance = scatter + 0.1 * covariance if is_few else 1.1 * scatter
            if n_draws >= n and 1 / np.sum(weight**2) >= least:
                break
        return x, weight, evidence

    def _find_peak(self):
        """The mode, and a covariance from the curvature there."""
        from scipy.optimize import minimize  # slow to import

        size = self.units.size

        def loss_by_log(y):  # x² = eʸ − 1 is linear next to zero, where x itself would be stuck
            loss, gradient = self.compute_loss(np.sqrt(np.expm1(y)))
            return loss, gradient * np.exp(y)

        optimum = minimize(
            loss_by_log, np.ones(size), jac=True, method="L-BFGS-B", bounds=[(0, 30)] * size, options={"ftol": 1e-9}
        )
        peak, hessian = np.sqrt(np.expm1(optimum.x)), np.empty((size, size))
        for k in range(size):
            step = np.zeros(size)
            step[k] = 0.05 * max(peak[k], 1)
            up, down = (2 * (peak + s * step) * self.compute_loss(np.abs(peak + s * step))[1] for s in (1, -1))
            hessian[k] = (up - down) / (2 * step[k])
        eigenvalues, eigenvectors = np.linalg.eigh((hessian + hessian.T) / 2)
        return peak, eigenvectors / np.maximum(eigenvalues, 0.25) @ eigenvectors.T  # never wider than two units

    def fit_free_modes(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """θ of all classes, (K, f), and its covariance, (K, f, K, f): what the other modes leave, and C ⊗ S."""
        r, lower, w = self.compute_draw_factors(x)
        k, q = self.n_classes, self.n_unknowns
        r_times_leverage = np.einsum("mjk,amk->jka", r, self.leverage).reshape(k * q, -1)
        z = solve_triangular(lower, r_times_leverage, lower=True, check_finite=False)
        n_free = self.free_variances.size
        covariance = (z.T @ z + np.linalg.inv(self.classes.free_matrix)).reshape(k, n_free, k, n_free)
        values = np.linalg.solve(self.classes.free_matrix, self.classes.free_rhs) - z.T @ w
        shares, free_indices = self.compute_shares(x)[self.free_groups], np.arange(n_free)
        for i, j in np.ndindex(k, k):
            covariance[i, free_indices, j, free_indices] += shares[:, i, j] * self.free_variances
        return values.reshape(k, n_free), covariance

    def fit_templates(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Amplitudes of the templates beside the systematic errors, free a priori, and their covariance."""
        n = self.n_modes
        if n == self.n_unknowns:
            return np.zeros(0), np.zeros((0, 0))
        r, _, _ = self.compute_draw_factors(x)
        root, k = r[:, :, :n], self.n_classes
        mode_matrices, template_coupling = self.matrices[:, :n, :n], self.matrices[:, :n, n:]
        gram = np.einsum("mjk,mkl,mil->jkil", root, mode_matrices, root, optimize=True).reshape(k * n, k * n)
        lower = cholesky(gram + np.eye(k * n), lower=True, check_finite=False)
        right_sides = np.concatenate([template_coupling, self.rhs[:, :n, None]], 2)
        z = solve_triangular(lower, np.einsum("mjk,mkt->jkt", root, right_sides).reshape(k * n, -1), lower=True)
        precision = self.matrices[:, n:, n:].sum(0) - z[:, :-1].T @ z[:, :-1]
        covariance = np.linalg.inv(precision)
        return covariance @ (self.rhs[:, n:].sum(0) - z[:, :-1].T @ z[:, -1]), covariance


def _draw_folded_t(centre, covariance, n, rng) -> tuple[FloatArray, FloatArray]:
    """|x| of a multivariate t, and ln of its density: all signs of what lies near zero are summed over."""
    size = len(centre)
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(size))
    scale = np.sqrt(rng.chisquare(_DOF, size=(n, 1)) / _DOF)
    x = np.abs(centre + (rng.normal(size=(n, size)) @ root.T) / scale)
    near_zero_numbers = np.flatnonzero(centre < 6 * np.sqrt(np.diag(covariance)))
    signs: Any = np.ones((2 ** len(near_zero_numbers), size))
    signs[:, near_zero_numbers] = list(product((1, -1), repeat=len(near_zero_numbers)))
    inverse_root = np.linalg.inv(root)
    precision = inverse_root.T @ inverse_root
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


def sample_amplitudes_by_shape(
    classes: ClassEquations,
    modes: Modes,
    spectra: Sequence[tuple[str, Spectrum]],
    own: str,
    n_draws: int,
    rng: np.random.Generator,
) -> list[ShapeDraws]:
    """Draws of the amplitudes for each shape, again where too few of them count."""
    squares: Any = sum(classes.own_matrices**2)
    is_higher = ~classes.free
    flat = spectra[0][1].flat().variances(modes)[is_higher]
    squares = squares[: len(flat), : len(flat)]  # without templates
    shape_draws, evidences = [], []
    with limit_blas(len(classes) * len(modes)):
        for name, spectrum in spectra:
            variances = spectrum.variances(modes)
            # All shapes as well seen as the flat one, or their evidence would depend on units.
            scale = np.sqrt((flat @ squares @ flat) / (variances[is_higher] @ squares @ variances[is_higher]))
            likelihood = ClassLikelihood(classes, modes, variances * scale, own)
            x, weight, evidence = likelihood.sample(n_draws, rng, MIN_EFFECTIVE_DRAWS)
            shape_draws.append(ShapeDraws(name, spectrum, np.nan, likelihood, float(scale), x, weight))
            evidences.append(evidence)
    probability = compute_shape_probabilities([name for name, _ in spectra], evidences)
    return [draws._replace(probability=float(p)) for draws, p in zip(shape_draws, probability, strict=True)]


def resample_draws(shape_draws: Sequence[ShapeDraws], rng: np.random.Generator) -> tuple[Any, Any, Any, Any]:
    """Draws of equal weight by systematic resampling: free modes, their covariance, C by the flat one, templates."""
    weight = np.concatenate([lot.probability * lot.weight for lot in shape_draws])
    candidates = [(lot, i) for lot in shape_draws for i in range(len(lot.x))]
    positions = (np.arange(_N_KEPT_DRAWS) + rng.random()) / _N_KEPT_DRAWS
    indices = np.minimum(np.searchsorted(np.cumsum(weight) / weight.sum(), positions), len(weight) - 1)
    fits: dict[int, Any] = {}
    for k in indices:
        if k not in fits:
            lot, i = candidates[k]
            n_groups, dipole_variances = lot.likelihood.n_groups, lot.likelihood.dipole_variances
            flat_variances = lot.spectrum.flat().variances(lot.spectrum.mode_class(1))[-dipole_variances.size :]
            power_ratio = (dipole_variances.reshape(n_groups, 3).mean(1)) / flat_variances.reshape(n_groups, 3).mean(1)
            shares = lot.likelihood.compute_shares(lot.x[i])[:n_groups] * power_ratio[:, None, None]
            fits[k] = (*lot.likelihood.fit_free_modes(lot.x[i]), shares, *lot.likelihood.fit_templates(lot.x[i]))
    means, covariances, shares, values, spreads = (np.array([fits[k][index] for k in indices]) for index in range(5))
    deviations = values - values.mean(0)
    return means, covariances, shares, (values.mean(0), spreads.mean(0) + deviations.T @ deviations / len(deviations))
