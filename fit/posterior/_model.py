"""Our velocity, H0, and perhaps the dispersion and an excess noise: one posterior, all its coordinates.

Coordinates follow the ridge: u = v H0/H_ref (3), H0, and what else is free. Those of a user are v = u H_ref/H0, so that
densities carry |∂v/∂u| = (H_ref/H0)³. Where the prior knows v better than the data know u, the ridge runs along H0 at
constant v, and v is the coordinate.

A dispersion σ_pec that is fixed enters the weights alone, for H_ref: H0 comes from the dipole. One with a prior lets
the scatter of the galaxies measure σ_pec H0, and H0 as well as that prior allows. If it were fixed there, a poorly
known number would determine H0 to a few per cent.

The likelihood of the secular parallax is compressed: Gaussian in u = v H0/H_ref, smooth in all else. For given spread s
= σ_pec H0/H_ref, excess noise x and size q of the flow that galaxies share the data enter through the normal equations
of (u, ã[, ω], flow) alone, from which all but u is marginalised exactly. What is left,

    log L = c(s, x, q) − (u − û)ᵀ M (u − û)/2,

is tabulated at Chebyshev nodes of asinh(s), asinh(x) and asinh(q) and interpolated; the nodes are doubled until the
table agrees with sums made between them. A sample then costs microseconds, however many the sources.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fit.background import Axis
from fit.posterior._priors import ModelPriors
from fit.secular_parallax import (
    OMEGA,
    A,
    LocalGroup,
    ParallaxEquations,
    ParallaxParts,
    ParallaxSums,
    U,
    add_acceleration_prior,
    add_flow_prior,
    add_vector_prior,
    check_parameters_determined,
    marginalise_flow,
    subtract_known_motions,
)
from vsh.tools.errors import ConvergenceError, ParameterError
from vsh.tools.types import FloatArray
from vsh.vector import Vector

_UPPER = np.triu_indices(3)
_MOST_NODES = 129
#: The largest error of log L near its maximum, between the nodes.
_TABLE_ACCURACY = 1e-5


@dataclass(frozen=True, eq=False)
class CompressedLikelihood:
    """The tabulated likelihood."""

    axes: tuple[Axis, Axis, Axis]
    coefficients: FloatArray
    hubble: float
    frame: str

    def __call__(self, arguments: FloatArray) -> Any:
        """Interpolate c (n,), û (n, 3), M (n, 3, 3) at spreads, excess noises and flow sizes, (3, n), within limits."""
        c, peak, matrix = np.split(self._interpolate_functions(arguments, slice(0, 10)), [1, 4], axis=1)
        return c[:, 0], peak, _fill_symmetric(matrix)

    def acceleration(self, arguments: FloatArray, u: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Mean (n, 3) and covariance (n, 3, 3) of ã, given all the rest."""
        mean, slope, covariance = np.split(self._interpolate_functions(arguments, slice(10, 28)), [3, 12], axis=1)
        return mean + np.einsum("nij,nj->ni", slope.reshape(-1, 3, 3), u), _fill_symmetric(covariance)

    def _interpolate_functions(self, arguments, selection):
        bases = [axis.evaluate_basis(np.asarray(value)) for axis, value in zip(self.axes, arguments, strict=True)]
        planes = np.tensordot(bases[2], self.coefficients[selection], (1, 3))  # (n, f, n_s, n_x)
        curves = np.einsum("nx,nfsx->nfs", bases[1], planes)
        return np.einsum("ns,nfs->nf", bases[0], curves)


@dataclass(frozen=True, eq=False)
class LikelihoodFunctions:
    """Tables of the functions of s, x and q."""

    rows: ParallaxEquations | ParallaxParts
    spin: Literal["free"] | Vector | None
    acceleration: Vector | None
    threads: int | None
    group: LocalGroup | None = None

    def at(self, s: FloatArray, x: FloatArray, q: FloatArray) -> FloatArray:
        """The functions, (28, n), at n points: `marginalise_nuisance` of the sums, flow and acceleration as known."""
        noise_pairs, pair_index = np.unique(np.stack([s, x]), axis=1, return_inverse=True)
        sums = self.rows.sums(*noise_pairs, threads=self.threads)
        sums = add_acceleration_prior(sums, self.acceleration, self.rows.frame)
        if self.rows.modes is None:
            return marginalise_nuisance(sums, self.spin, self.rows.frame)[:, pair_index.ravel()]
        columns = []
        for number, flow_size in zip(pair_index.ravel(), q, strict=True):
            pair_sums = ParallaxSums(
                sums.matrix[number], sums.rhs[number], sums.chi2_null[number], sums.logdet[number], sums.n_data
            )
            if self.group is None:
                pair_sums = add_flow_prior(pair_sums, 9, flow_size)
            else:  # the amplitudes stand for H_ref, and their mean goes with H0
                pair_sums = self.group.add_to_sums(add_flow_prior(pair_sums, 9, 1.0), 9, 1.0, None, flow_size)
            marginal, _ = marginalise_flow(pair_sums, 9)
            columns.append(marginalise_nuisance(marginal, self.spin, self.rows.frame))
        return np.stack(columns, axis=1)


def compress_likelihood(functions: LikelihoodFunctions, limits: Sequence[tuple[float, float]]) -> CompressedLikelihood:
    """Tabulate the likelihood between the limits of s, x and q."""
    (_, max_spread), (_, max_noise), (_, max_flow) = limits
    min_noise = float(np.sqrt(functions.rows.smallest_variance))
    scales = max(min_noise / functions.rows.largest_rate, 1e-6 * max(max_spread, 1e-30)), min_noise, max_flow
    axes = [Axis(*limit, scale, 1 if limit[0] == limit[1] else 12) for limit, scale in zip(limits, scales, strict=True)]
    _check_unknowns_separable(functions, max_spread, max_noise)
    for i in range(3):  # each axis along the sharp edge of the others
        edge_axes = [Axis(axis.low, axis.low, axis.scale, 1) for axis in axes]
        while axes[i].count > 1:
            edge_axes[i] = axes[i]
            if _find_largest_log_error(_tabulate_likelihood(functions, edge_axes), functions) < _TABLE_ACCURACY:
                break
            axes[i] = _refine_axis(axes[i])
    while True:
        likelihood = _tabulate_likelihood(functions, axes)
        if max(axis.count for axis in axes) == 1 or _find_largest_log_error(likelihood, functions) < _TABLE_ACCURACY:
            return likelihood
        axes = [_refine_axis(axis) for axis in axes]


def _refine_axis(axis):
    if axis.count > _MOST_NODES:
        raise ConvergenceError("the likelihood is too rough to be tabulated: narrow the priors")
    return axis.refine()


def _tabulate_likelihood(functions, axes):
    nodes = np.meshgrid(*(axis.nodes for axis in axes), indexing="ij")
    values = functions.at(*(node.ravel() for node in nodes)).reshape(-1, *nodes[0].shape)
    for axis_number, axis in enumerate(axes):
        values = axis.to_coefficients(values, axis_number + 1)
    return CompressedLikelihood(tuple(axes), values, functions.rows.hubble, functions.rows.frame)


def marginalise_nuisance(sums: ParallaxSums, spin: Literal["free"] | Vector | None, frame: str) -> Any:
    """Marginalise acceleration and spin: the functions that are tabulated, (28, …), from equations, (…, 9, 9)."""
    is_free = isinstance(spin, str) and spin == "free"
    if isinstance(spin, Vector):
        spin = spin.to_frame(frame)
        is_free = bool(spin.covariance.any())
        sums = add_vector_prior(sums, spin, OMEGA) if is_free else subtract_known_motions(sums, spin.value, OMEGA)
    elif spin is not None and not is_free:
        raise ParameterError(f"spin is None, 'free' or a Vector, not {spin!r}")
    matrix, rhs, nuisance = sums.matrix, sums.rhs, list(range(A.start, OMEGA.stop if is_free else A.stop))
    n_aa, n_au = matrix[..., nuisance, :][..., nuisance], matrix[..., nuisance, U]
    inverse = np.linalg.inv(n_aa)
    slope = -inverse @ n_au
    mean = _multiply_vectors(inverse, rhs[..., nuisance])
    m = matrix[..., U, U] + np.swapaxes(n_au, -1, -2) @ slope
    b = rhs[..., U] + _multiply_vectors(np.swapaxes(slope, -1, -2), rhs[..., nuisance])
    peak = np.linalg.solve(m, b[..., None])[..., 0]
    least_chi2 = sums.chi2_null - np.sum(rhs[..., nuisance] * mean, -1) - np.sum(b * peak, -1)
    c = -(least_chi2 + sums.logdet + np.linalg.slogdet(n_aa)[1]) / 2
    functions = [c[..., None], peak, m[..., _UPPER[0], _UPPER[1]], mean[..., :3]]
    functions += [slope[..., :3, :].reshape(*c.shape, 9), inverse[..., :3, :3][..., _UPPER[0], _UPPER[1]]]
    return np.moveaxis(np.concatenate(functions, axis=-1), -1, 0)


def _check_unknowns_separable(functions, dispersion, excess_noise):
    block = slice(0, 9 if functions.spin is not None else 6)
    matrix = functions.rows.sums(dispersion, excess_noise, threads=functions.threads).matrix[block, block]
    names = ["v_x", "v_y", "v_z", "a_x", "a_y", "a_z", "omega_x", "omega_y", "omega_z"][block]
    check_parameters_determined(matrix, names, functions.rows.n_data // 2)


def _find_largest_log_error(likelihood, functions, n_points=24):
    """Find the largest error of log L near its maximum, at points between the nodes, against the sums themselves."""
    t = (np.arange(n_points) + 0.5) / n_points
    stride = 0.6180339887 * n_points
    fractions = (t, (t * stride) % 1, (t * stride**2) % 1)  # all over the cube, and the same every time
    arguments = np.stack([axis.at(fraction) for axis, fraction in zip(likelihood.axes, fractions, strict=True)])
    exact = functions.at(*arguments)
    c0, peak0, m0 = exact[0], exact[1:4].T, _fill_symmetric(exact[4:10].T)
    c1, peak1, m1 = likelihood(arguments)
    depth = 1 + 0.01 * (c0.max() - c0)
    peak_shift = peak0 - peak1
    peak_error = np.sqrt(np.abs(np.einsum("ni,nij,nj->n", peak_shift, m0, peak_shift)))
    matrix_error = np.abs(m0 - m1).max((1, 2)) / np.abs(m0).max((1, 2))
    return max((np.abs(c0 - c1) / depth).max(), (peak_error / depth).max(), (matrix_error / depth).max())


def _multiply_vectors(matrix, vector):
    return (matrix @ vector[..., None])[..., 0]


def _fill_symmetric(triangle):
    symmetric = np.empty((len(triangle), 3, 3))
    symmetric[:, _UPPER[0], _UPPER[1]] = triangle
    symmetric[:, _UPPER[1], _UPPER[0]] = triangle
    return symmetric


@dataclass(frozen=True, eq=False)
class ParallaxModel:
    """The posterior of (u, H0, …) given the compressed data."""

    likelihood: CompressedLikelihood
    priors: ModelPriors
    letter: str = "u"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coordinates."""
        return (*(f"{self.letter}_{axis}" for axis in "xyz"), *self.priors.free)

    def compute_velocities(self, theta: FloatArray) -> tuple[FloatArray, FloatArray]:
        """u and v, (n, 3) each, of coordinates (n, d)."""
        ratio = theta[:, 3:4] / self.likelihood.hubble  # H0 is the first of the free numbers
        return (theta[:, :3], theta[:, :3] / ratio) if self.letter == "u" else (theta[:, :3] * ratio, theta[:, :3])

    def compute_log_jacobian(self, ratio: FloatArray) -> FloatArray:
        """log |∂v/∂(coordinates)|, or |∂u/∂(coordinates)| for a prior that is flat in u."""
        return 3 * (self.priors.velocity.flat_in_product - (self.letter == "u")) * np.log(ratio)

    def log_probability(self, theta: FloatArray) -> FloatArray:
        """Log posterior density of coordinates (n, d), up to a constant."""
        log_posterior = self.priors.log(theta[:, 3:])
        is_allowed = np.isfinite(log_posterior)
        arguments, ratio = self.compute_likelihood_arguments(theta[is_allowed, 3:])
        u, v = self.compute_velocities(theta[is_allowed])
        c, peak, matrix = self.likelihood(arguments)
        offset = u - peak
        log_posterior[is_allowed] += c - np.einsum("ni,nij,nj->n", offset, matrix, offset) / 2
        log_posterior[is_allowed] += self.priors.velocity.log(v) + self.compute_log_jacobian(ratio)
        return np.where(np.isnan(log_posterior), -np.inf, log_posterior)

    def compute_likelihood_arguments(self, parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        """s, x and q of the likelihood, (3, n), and H0/H_ref, from the free numbers (n, k)."""
        columns = dict(zip(self.priors.free, parameters.T, strict=True))
        ratio = columns["H0"] / self.likelihood.hubble
        dispersion: Any = self.priors.peculiar_dispersion
        if "peculiar_dispersion" in columns:
            dispersion = columns["peculiar_dispersion"] * ratio
        excess_noise = columns.get("excess_noise", self.priors.excess_noise)
        # Without a prior the flow's amplitude stands for H_ref and weighs only; with one it tells H0.
        flow = columns["flow_amplitude"] * ratio if "flow_amplitude" in columns else np.ones(ratio.shape)
        flow = flow if self.priors.group is None else ratio
        lower, upper = np.transpose([(axis.low, axis.high) for axis in self.likelihood.axes])[:, :, None]
        return np.clip(np.broadcast_arrays(dispersion, excess_noise, flow), lower, upper), ratio

    def marginalise_velocity(
        self, parameters: FloatArray, with_priors: bool = True
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Log of the posterior at free numbers (n, k), a Gaussian v marginalised exactly; its mean and covariance."""
        arguments, ratio = self.compute_likelihood_arguments(parameters)
        c, peak, matrix = self.likelihood(arguments)
        prior = self.priors.velocity
        data_precision = matrix * ratio[:, None, None] ** 2
        pull = np.einsum("nij,nj->ni", matrix, peak) * ratio[:, None] + prior.precision @ prior.mean
        precision = data_precision + prior.precision
        covariance = np.linalg.inv(precision)
        mean = np.einsum("nij,nj->ni", covariance, pull)
        misfit = np.einsum("ni,nij,nj->n", peak, matrix, peak) + prior.mean @ prior.precision @ prior.mean
        log_posterior = c - (misfit - np.einsum("ni,ni->n", pull, mean)) / 2 - np.linalg.slogdet(precision)[1] / 2
        if prior.proper:
            log_posterior += np.linalg.slogdet(prior.precision)[1] / 2
        if prior.flat_in_product:
            log_posterior += 3 * np.log(ratio)
        return (self.priors.log(parameters) + log_posterior if with_priors else log_posterior), mean, covariance

    def draw_start(self, rng: np.random.Generator, n_walkers: int) -> FloatArray:
        """Draw starting points, (n_walkers, d): candidates drawn, weighed, and drawn again around the best."""
        lower, upper = np.transpose([self.priors.limits(name) for name in self.priors.free])
        n_candidates = max(4000, 20 * n_walkers)
        shape = n_candidates, len(lower)
        parameters, log_proposal = rng.uniform(lower, upper, shape), 0.0
        for _ in range(4):
            velocity, log_velocity = self.draw_velocity_and_density(rng, parameters)
            theta = np.column_stack([velocity, parameters])
            log_weight = self.log_probability(theta) - log_proposal - log_velocity
            if not np.isfinite(log_weight).any():
                raise ParameterError("the posterior is zero wherever it was tried: priors and data exclude each other")
            weight = np.exp(log_weight - log_weight.max())
            weight /= weight.sum()
            mean = weight @ parameters
            width = np.sqrt(weight @ (parameters - mean) ** 2) * 1.5 + 1e-6 * (upper - lower)
            start = theta[np.argsort(-(log_weight + rng.gumbel(size=len(parameters))))[:n_walkers]]
            # One in ten anywhere, so that no weight runs away; what falls outside has no density.
            is_anywhere = rng.uniform(size=(n_candidates, 1)) < 0.1
            parameters = np.where(is_anywhere, rng.uniform(lower, upper, shape), rng.normal(mean, width, shape))
            parameters = parameters[((parameters >= lower) & (parameters <= upper)).all(1)]
            log_gaussian = np.log(0.9) - np.sum(
                ((parameters - mean) / width) ** 2 / 2 + np.log(width * np.sqrt(2 * np.pi)), 1
            )
            log_proposal = np.logaddexp(log_gaussian, np.log(0.1) - np.log(upper - lower).sum())
        return start

    def draw_velocity_and_density(
        self, rng: np.random.Generator | np.random.RandomState, parameters: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Draw the first three coordinates given the rest, (n, 3), with the log-density they were drawn with."""
        mean, root, root_logdet = self._compute_velocity_gaussian(parameters)
        standard_normals = rng.standard_normal(mean.shape)
        return mean + np.einsum("nij,nj->ni", root, standard_normals), -np.sum(standard_normals**2, 1) / 2 - root_logdet

    def log_density_of_velocity(self, theta: FloatArray) -> FloatArray:
        """The log-density with which `draw_velocity_and_density` gives the first three of coordinates (n, d)."""
        mean, root, root_logdet = self._compute_velocity_gaussian(theta[:, 3:])
        standard_normals = np.linalg.solve(root, (theta[:, :3] - mean)[..., None])[..., 0]
        return -np.sum(standard_normals**2, 1) / 2 - root_logdet

    def _compute_velocity_gaussian(self, parameters):
        """Compute mean, root of the covariance and log-determinant of that root, of the first three coordinates."""
        arguments, ratio = self.compute_likelihood_arguments(parameters)
        if self.priors.velocity.gaussian:
            _, mean, covariance = self.marginalise_velocity(parameters)
        else:
            _, mean, matrix = self.likelihood(arguments)
            mean, covariance = mean / ratio[:, None], np.linalg.inv(matrix) / ratio[:, None, None] ** 2
        if self.letter == "u":
            mean, covariance = mean * ratio[:, None], covariance * ratio[:, None, None] ** 2
        root = np.linalg.cholesky(covariance)
        return mean, root, np.log(np.einsum("nii->ni", root)).sum(1)

    def to_samples(self, theta: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        """Convert the samples to quantities by name: v, H0, the others, and ã, drawn given them."""
        parameters = theta[:, 3:]
        arguments, _ = self.compute_likelihood_arguments(parameters)
        u, v = self.compute_velocities(theta)
        samples = dict(zip(("v_x", "v_y", "v_z"), v.T)) | {"speed": np.linalg.norm(v, axis=1)}
        samples |= dict(zip(self.priors.free, parameters.T))
        mean, covariance = self.likelihood.acceleration(arguments, u)
        acceleration = mean + np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.standard_normal(mean.shape))
        return samples | dict(zip(("a_x", "a_y", "a_z"), acceleration.T))


def make_parallax_model(
    equations: ParallaxEquations | ParallaxParts,
    priors: ModelPriors,
    spin: Literal["free"] | Vector | None = None,
    threads: int | None = None,
) -> ParallaxModel:
    """Make the posterior of a catalogue's equations under priors."""
    dispersion_limits, flow_limits = priors.limits("peculiar_dispersion"), (1.0, 1.0)
    min_ratio, max_ratio = (limit / equations.hubble for limit in priors.limits("H0"))
    if "peculiar_dispersion" in priors.free:
        dispersion_limits = dispersion_limits[0] * min_ratio, dispersion_limits[1] * max_ratio
    if "flow_amplitude" in priors.free:
        if equations.modes is None:
            raise ParameterError('an amplitude of the flow needs a flow: flows="linear"')
        lower, upper = priors.limits("flow_amplitude")
        flow_limits = max(lower, 1e-3) * min_ratio, upper * max_ratio
    elif priors.group is not None:
        flow_limits = min_ratio, max_ratio
    functions = LikelihoodFunctions(equations, spin, priors.acceleration, threads, priors.group)
    likelihood = compress_likelihood(functions, (dispersion_limits, priors.limits("excess_noise"), flow_limits))
    return ParallaxModel(likelihood, priors, "v" if _is_prior_sharper(priors.velocity, likelihood) else "u")


def _is_prior_sharper(velocity, likelihood):
    """Return whether the prior on the velocity says more than the data, where they say most."""
    if not (velocity.gaussian and velocity.proper):
        return False
    _, _, matrix = likelihood(np.array([[axis.low] for axis in likelihood.axes]))
    return np.trace(np.linalg.inv(velocity.precision)) < np.trace(np.linalg.inv(matrix[0]))
