"""The equations of the secular parallax by our own motion, and their sums for any spread of peculiar velocities.

A source at transverse comoving distance d moves by

    µ = −u_⊥ k + ã_⊥ + ω × r,   k = 1/d_P,   u = v H0/H_ref,

(Bachchan, Hobbs & Lindegren 2016, sect. 2.3 and 4), where distances are those for H_ref: the data see the product v H0
only. Where redshifts hold velocities and errors, k is the mean of 1/d (`fit.distances`), and its variance s² adds s²
|v|²/3 to that of the motion, and with flows s² σ² for theirs. Each source is turned to the axes of its error ellipse,
in which a variance that is the same in all directions (peculiar velocities, excess noise) is simply added.

What is known besides the motions (the amplitudes of a flow, the acceleration, the Local Group's velocity) adds to the
normal equations where they are solved, never to their sums.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from fit.distances import Calibration, inverse_distances
from fit.results.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import DISTANCES, Parts, apply_step
from vsh.io.sections import Section
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18, hubble_value, parallax_distance_ratio
from vsh.models.flows import FlowModes, LinearTheory, VelocityGrid
from vsh.sky.sphere import local_components, triad
from vsh.tools.arguments import positive
from vsh.tools.errors import DegeneracyError, FrameError, ParameterError
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.subsample import select_share
from vsh.tools.types import ArrayLike, AxesArray, FloatArray, IntArray, OnAxes, Table
from vsh.tools.units import AU_PER_YEAR, SPEED_OF_LIGHT
from vsh.vector import Vector

#: u: our velocity were H0 what the cosmology has [km/s]; ã and ω [µas/yr]; v of those with distances in Mpc [km/s].
U, A, OMEGA, V = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
#: Sources whose flow is computed at once.
_NEAR_BLOCK_SIZE = 512
#: Distances surer than this leave no room for magnitudes to tell near from far: sources weigh by their own errors.
_SURE_RELATIVE_ERROR = 0.05


@dataclass(frozen=True, eq=False)
class ParallaxSums:
    """N θ = b for θ = (u, ã, ω), with what a likelihood needs besides."""

    matrix: FloatArray
    rhs: FloatArray
    chi2_null: FloatArray
    logdet: FloatArray
    n_data: int

    def __add__(self, other: ParallaxSums) -> ParallaxSums:
        return ParallaxSums(*(getattr(self, entry.name) + getattr(other, entry.name) for entry in fields(self)))


@dataclass(frozen=True, eq=False)
class ParallaxEquations:
    """Uncorrelated equations, two a source."""

    design: FloatArray
    motion: FloatArray
    variance: FloatArray
    rate: FloatArray
    left: FloatArray
    hubble: float
    frame: str
    notes: tuple[str, ...]
    flow: FlowColumns | None = None
    n_own: int = 0
    left_out: Any = None

    @property
    def n_data(self) -> int:
        """Number of equations: two per source."""
        return len(self.motion)

    @property
    def modes(self) -> FlowModes | None:
        """Modes of the flow."""
        return None if self.flow is None else self.flow.modes

    @property
    def smallest_variance(self) -> float:
        """The smallest variance of all equations. [(µas/yr)²]"""
        return float(self.variance.min())

    @property
    def largest_rate(self) -> float:
        """The largest rate of all equations. [µas/yr per km/s]"""
        return float(self.rate.max())

    def select_most_sensitive(self, n_sources: int) -> ParallaxEquations:
        """Select the sources that are most sensitive to peculiar velocities, by distance and error alone."""
        n = self.n_data // 2
        if n <= n_sources:
            return self
        sensitivity = self.rate[:n] ** 2 * (1 / self.variance[:n] + 1 / self.variance[n:])
        source_numbers = np.sort(np.argpartition(-sensitivity, n_sources)[:n_sources])
        row_numbers = np.r_[source_numbers, source_numbers + n]
        flow = None if self.flow is None else self.flow.select(source_numbers[source_numbers < len(self.flow.lon)])
        columns = {name: getattr(self, name)[row_numbers] for name in ("design", "motion", "variance", "rate", "left")}
        return replace(self, **columns, flow=flow)

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, ratio: float = 1.0, threads: int | None = None
    ) -> ParallaxSums:
        """Normal equations with variances V = σ² + (spread k)² + excess_noise², and what a flow's modes leave."""
        spread, excess_noise = np.broadcast_arrays(spread, excess_noise)
        squared_scatters = np.stack([np.ravel(spread), np.ravel(excess_noise)]) ** 2
        n_variances, n = squared_scatters.shape[1], self.n_data // 2
        size = self.design.shape[1] + 1
        n_near = 0 if self.flow is None else len(self.flow.lon)
        far_rows = np.r_[n_near:n, n + n_near : 2 * n]

        def weighted_gram(row_numbers, flow_columns):
            base_variance = self.variance[row_numbers, None] + self.left[row_numbers, None] * ratio**2
            variance = self.rate[row_numbers, None] ** 2 * squared_scatters[0] + (base_variance + squared_scatters[1])
            rows = np.concatenate([self.design[row_numbers].T, self.motion[row_numbers][None], *flow_columns])
            return _compute_weighted_grams(rows, variance), np.log(variance).sum(0)

        def sum_near_chunk(chunk):
            assert self.flow is not None
            return weighted_gram(np.r_[chunk, slice(n + chunk.start, n + chunk.stop)], [self.flow.columns(chunk).T])

        def sum_far_chunk(chunk):
            return weighted_gram(far_rows[chunk], [])

        n_columns = size + (0 if self.modes is None else len(self.modes))
        gram: Any = np.zeros((n_variances, n_columns, n_columns))
        logdet: Any = np.zeros(n_variances)
        far_size = max(64, 2**20 // max(55, n_variances))
        jobs = ((sum_near_chunk, n_near, _NEAR_BLOCK_SIZE, n_columns), (sum_far_chunk, far_rows.size, far_size, size))
        for sum_chunk, n_indices, block_size, width in jobs:
            for block, block_logdet in map_blocks(sum_chunk, n_indices, block_size, threads):
                gram[:, :width, :width] += block
                logdet += block_logdet
        column_order = np.r_[: size - 1, size:n_columns, size - 1]  # the motion last
        gram = gram[:, column_order[:, None], column_order].reshape(*spread.shape, len(column_order), len(column_order))
        logdet_grid: Any = logdet.reshape(spread.shape)
        return ParallaxSums(gram[..., :-1, :-1], gram[..., :-1, -1], gram[..., -1, -1], logdet_grid, self.n_data)


def _compute_weighted_grams(rows, variance):
    """Σ rows rowsᵀ/V for every column of variances, (m, k, k); rows are (k, n)."""
    k, n_variances = len(rows), variance.shape[1]
    if k <= 16:
        upper = np.triu_indices(k)
        products = rows[upper[0]] * rows[upper[1]]  # weighted, for every spread at once, by one product
        sums = (products @ (1 / variance)).T
        matrices = np.empty((n_variances, k, k))
        matrices[:, upper[0], upper[1]] = sums
        matrices[:, upper[1], upper[0]] = sums
        return matrices
    matrices = np.empty((n_variances, k, k))
    for i, row_variances in enumerate(variance.T):
        white_rows = rows / np.sqrt(row_variances)
        matrices[i] = white_rows @ white_rows.T
    return matrices


def make_field_equations(
    field: Field,
    calibration: Calibration,
    *,
    theory: LinearTheory | None = None,
    modes: FlowModes | None = None,
    ratio: float = 1.0,
    apart: bool = False,
    reconstruction: VelocityGrid | None = None,
    threads: int | None = None,
) -> ParallaxEquations:
    """The equations of a field."""
    k = inverse_distances(field, calibration, threads)
    distance = k.distance * calibration.little_h
    mean, motion, notes = k.mean, field.motion, field.notes
    if reconstruction is not None:
        tangential_velocity, mean_shift, flow_notes = compute_known_flow(reconstruction, field, distance, k.slope)
        mean = mean + np.clip(mean_shift, -mean / 2, mean)
        motion, notes = motion - tangential_velocity * mean * np.where(k.own, 1.0, ratio), (*notes, *flow_notes)
    distance_ratio = np.where(k.own, ratio, 1.0)  # what is in Mpc moves by v/d, not by u/d
    mean, variance_of_k = mean / distance_ratio, k.variance / distance_ratio**2
    p, q, _ = triad(field.lon, field.lat)
    cos, sin, major_variance, minor_variance = _compute_error_ellipses(field, calibration, k)
    own_mask = np.where(k.own & apart, 1.0, 0.0)
    # Our own motion moves sources by v/d_P, which in curved space is another distance than d_M.
    parallax_rate = mean * parallax_distance_ratio(
        1 / (AU_PER_YEAR * np.where(k.own, k.mean / ratio, k.mean)), calibration.cosmology
    )
    velocity_columns = -parallax_rate * np.stack([p, q])
    columns = [velocity_columns * (1 - own_mask), [p, q], [q, -p], *([velocity_columns * own_mask] if apart else [])]
    east, north = np.concatenate(columns, axis=1)
    flow, residual_variance = None, np.zeros(len(field))
    velocity_variance = np.sum(CMB_VELOCITY_PLANCK18.to_frame(field.frame).value ** 2) / 3
    if theory is not None:
        velocity_variance += theory.sigma**2
        residual_variance = np.full(len(field), theory.sigma**2)
    if modes is not None:
        is_near = distance <= modes.radii[-1]
        near_first = np.argsort(~is_near, kind="stable")
        near_indices = near_first[: is_near.sum()]
        residual_variance[is_near] = modes.left(distance[is_near])[0]
        flow = FlowColumns(modes, *(array[near_indices] for array in (field.lon, field.lat, distance, mean, cos, sin)))
    rate = np.sqrt(mean**2 + variance_of_k)
    scatter_variance, residual_variance = variance_of_k * velocity_variance, residual_variance * rate**2
    rows: dict[str, Any] = {
        "design": np.concatenate([cos * east + sin * north, cos * north - sin * east], axis=1).T,
        "motion": np.concatenate([cos * motion[0] + sin * motion[1], cos * motion[1] - sin * motion[0]]),
        "variance": np.concatenate([major_variance + scatter_variance, minor_variance + scatter_variance]),
        "rate": np.tile(rate, 2),
        "left": np.tile(residual_variance, 2),
    }
    if modes is not None:
        row_order = np.r_[near_first, near_first + len(field)]
        rows = {name: column[row_order] for name, column in rows.items()}
    hubble, notes = hubble_value(calibration.cosmology), (*notes, *calibration.notes)
    return ParallaxEquations(**rows, hubble=hubble, frame=field.frame, notes=notes, flow=flow, n_own=int(k.own.sum()))


def _compute_error_ellipses(field, calibration, k):
    """Direction and variances of error ellipses; circles where distances are unsure and only redshifts may weigh."""
    (v1, v2), rho = field.sigma**2, field.rho
    if calibration.errors is not None:
        is_uncertain = ~k.own & (np.sqrt(k.variance) > _SURE_RELATIVE_ERROR * k.mean)
        typical_variance = calibration.errors.at(k.redshift)
        v1, v2 = (np.where(is_uncertain, typical_variance, variance) for variance in (v1, v2))
        rho = np.where(is_uncertain, 0.0, rho)
    covariance = rho * np.sqrt(v1 * v2)
    angle = np.arctan2(2 * covariance, v1 - v2) / 2
    mean_variance, half_difference = (v1 + v2) / 2, np.hypot((v1 - v2) / 2, covariance)
    major_variance = mean_variance + half_difference
    minor_variance = v1 * v2 * (1 - rho**2) / major_variance  # mean − half would cancel
    return np.cos(angle), np.sin(angle), major_variance, minor_variance


@dataclass(frozen=True, eq=False)
class ParallaxParts:
    """Equations of a catalogue in parts: the equations stay where the parts are, sums come back."""

    sky: Parts
    calibration: Calibration
    options: dict[str, Any]
    n_data: int
    smallest_variance: float
    largest_rate: float
    hubble: float
    frame: str
    notes: tuple[str, ...]
    n_own: int
    left_out: Any = None

    @property
    def modes(self) -> FlowModes | None:
        """Modes of the flow."""
        return self.options.get("modes")

    @classmethod
    def of(cls, sky: Parts, calibration: Calibration, options: dict[str, Any]) -> ParallaxParts:
        """The equations of a catalogue in parts."""
        collect_facts = partial(_collect_equation_facts, calibration=calibration, options=options)
        facts = sky.sum(collect_facts, roles=DISTANCES, words="redshifts")
        if len(facts["frames"]) > 1:
            raise FrameError(f"parts are in {' and '.join(sorted(facts['frames']))}: take all to one frame")
        about = {"frame": next(iter(facts["frames"])), "notes": merge_notes(*facts["notes"]), "n_own": facts["n_own"]}
        about |= {"smallest_variance": min(facts["variance"]), "largest_rate": max(facts["rate"])}
        hubble = hubble_value(calibration.cosmology)
        return cls(sky, calibration, options, n_data=facts["n_data"], hubble=hubble, **about)

    def sums(self, *spreads: ArrayLike, **keywords: Any) -> ParallaxSums:
        """Compute the sums of `ParallaxEquations.sums`, with its arguments."""
        sums = partial(_sum_up, calibration=self.calibration, options=self.options, spreads=spreads, keywords=keywords)
        return self.sky.sum(sums, roles=DISTANCES, words="secular parallax")


def _collect_equation_facts(field, calibration, options):
    equations = make_field_equations(field, calibration, **options)
    return {
        "n_data": equations.n_data,
        "variance": [equations.smallest_variance],
        "rate": [equations.largest_rate],
        "frames": {equations.frame: None},
        "notes": [equations.notes],
        "n_own": equations.n_own,
    }


def _sum_up(field, calibration, options, spreads, keywords):
    return make_field_equations(field, calibration, **options).sums(*spreads, **keywords)


def make_equations(field: Field | Parts, calibration: Calibration, **options: Any) -> ParallaxEquations | ParallaxParts:
    """The equations of a field or of parts."""
    if isinstance(field, Parts):
        return ParallaxParts.of(field, calibration, options)
    return make_field_equations(field, calibration, **options)


@dataclass(frozen=True, eq=False)
class FlowColumns:
    """Columns of the equations for the modes of a flow, along the axes of the error ellipses.

    The flow moves redshifts as well, and with them the distances at which motions are expected. The effect is the
    product of two unknown velocities, our velocity minus the flow across the line of sight, and the flow along it. It
    is therefore treated as scatter, among the errors of the distances. If only the term v_⊥ V_r with a known v were in
    the model, the data would seem to constrain the flow although they do not: with 60 000 galaxies the errors of v
    would be 1.5 times too small.
    """

    modes: FlowModes
    lon: FloatArray
    lat: FloatArray
    distance: FloatArray
    rate: FloatArray
    cos: FloatArray
    sin: FloatArray

    def select(self, source_indices: IntArray) -> FlowColumns:
        """Equations of some sources."""
        names = ("lon", "lat", "distance", "rate", "cos", "sin")
        return FlowColumns(self.modes, *(getattr(self, name)[source_indices] for name in names))

    def columns(self, sources: slice) -> FloatArray:
        """The columns of some sources, (2k, p): the first components of all, then the second. [µas/yr]"""
        cos, sin = self.cos[sources] * self.rate[sources], self.sin[sources] * self.rate[sources]
        turn = np.stack([[cos, sin], [-sin, cos]])
        columns = self.modes.columns(self.lon[sources], self.lat[sources], self.distance[sources], turn)
        return columns.reshape(len(self.modes), -1).T


def compute_known_flow(
    grid: VelocityGrid, field: Field, distance: FloatArray, slope: FloatArray
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Velocities that are known from elsewhere: across, what they do to 1/d by the redshift, and a note."""
    velocity, is_inside = grid.at(field.lon, field.lat, distance, field.frame)
    tangential_velocity, radial_velocity = local_components(velocity, field.lon, field.lat)
    n_outside = int((~is_inside).sum())
    note = f"{n_outside} sources lie outside of the reconstructed flow, which is taken as zero there"
    return tangential_velocity, -slope * radial_velocity / SPEED_OF_LIGHT, (note,) if n_outside else ()


@dataclass(frozen=True, eq=False, repr=False)
class Flow(Result):
    """Amplitudes of the modes of a flow, with their covariance.

    Attributes
    ----------
    modes : vsh.models.flows.FlowModes
    values : (p,) array
        Amplitudes of the modes, whose standard deviation is one a priori.
    covariance : (p, p) array
        That of the other parameters of the fit included.
    frame : str
        Frame of the axes.
    """

    modes: FlowModes
    values: FloatArray
    covariance: FloatArray
    frame: str

    def __repr__(self) -> str:
        return f"<Flow: {self.modes!r}, {self.frame}>"

    def at(self, lon: FloatArray, lat: FloatArray, distance: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Velocities in the frame of the microwave background: tangential, (2, n), and radial, (n,). [km/s]

        Parameters
        ----------
        lon, lat : (n,) arrays
            Positions. [rad]
        distance : (n,) array
            [Mpc/h]
        """
        tangential, radial = self.modes.at(lon, lat, distance)
        return tangential @ self.values, radial @ self.values

    def bulk(self, radius: float) -> Vector:
        """The mean velocity at distance `radius` [Mpc/h], over all directions, with its covariance. [km/s]"""
        mean_by_mode = _compute_shell_mean_by_mode(self.modes, positive("radius", radius))
        return Vector(mean_by_mode @ self.values, mean_by_mode @ self.covariance @ mean_by_mode.T, self.frame, "km/s")

    def _sections(self, long):
        facts = [("prior", f"{self.modes.theory.name}, {len(self.modes)} modes"), ("axes", self.frame)]
        return (Section("The flow of galaxies: mean velocity of shells", facts, self.to_table()),)

    def to_table(self) -> Table:
        """Mean velocities of shells as an astropy Table, a row each."""
        farthest = float(self.modes.radii[-1])
        radii = [radius for radius in (10.0, 20.0, 40.0, 80.0, 160.0, 320.0) if radius <= farthest] or [farthest]
        bulk_velocities = [self.bulk(radius) for radius in radii]
        columns: dict[str, Any] = {"distance": radii}
        for i, axis in enumerate("xyz"):
            columns[f"v_{axis}"] = [v.value[i] for v in bulk_velocities]
            columns[f"v_{axis}_error"] = [v.sigma[i] for v in bulk_velocities]
        units = {name: "km / s" for name in columns if name.startswith("v_")} | {"distance": "Mpc"}
        return tables.table_of(columns, {"frame": self.frame}, units)

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """The radial velocities that were found on three shells, on matplotlib axes."""
        from fit.secular_parallax._plot import plot_flow

        return plot_flow(self, ax=ax)


def _compute_shell_mean_by_mode(modes, radius):
    """Mean velocity over a shell by each mode, (3, p): (f_r + 2 f_t)/3 e for degree 1, else nothing."""
    lon, lat, distance = np.array([0.0, np.pi / 2, 0.0]), np.array([0.0, 0.0, np.pi / 2]), np.full(3, radius)
    radial = modes.at(lon, lat, distance)[1]  # outwards on the axes x, y, z
    tangential = modes.at(lon[:2], lat[:2], distance[:2])[0]  # on x, east is y and north z; on y, east is −x
    tangential_by_axis = np.stack([-tangential[0, 1], tangential[0, 0], tangential[1, 0]])
    dipole = slice(modes.counts[0], modes.counts[0] + 3 * modes.counts[1])
    shell_means = np.zeros_like(radial)
    shell_means[:, dipole] = (radial[:, dipole] + 2 * tangential_by_axis[:, dipole]) / 3
    return shell_means


def make_flow(
    equations: Any, amplitudes: Any, theta: FloatArray, to_u: FloatArray, covariance: FloatArray, ratio: float
) -> Flow:
    """The flow of a fit, from its amplitudes given the other parameters."""
    slope = amplitudes.slope @ to_u
    values = (amplitudes.mean - amplitudes.slope @ theta) / ratio
    total_covariance = (amplitudes.covariance + slope @ covariance @ slope.T) / ratio**2
    return Flow(equations.modes, values, (total_covariance + total_covariance.T) / 2, equations.frame)


def add_acceleration_prior(sums: ParallaxSums, acceleration: Vector | None, frame: str) -> ParallaxSums:
    """Add a prior on the acceleration, from quasars for example."""
    if acceleration is None:
        return sums
    if not isinstance(acceleration, Vector):
        raise ParameterError(f"the acceleration is a Vector with its covariance, not {type(acceleration).__name__}")
    return add_vector_prior(sums, acceleration.to_frame(frame), A)


def add_vector_prior(sums: ParallaxSums, prior: Vector, unknowns: slice) -> ParallaxSums:
    """Add a Gaussian prior on one of the vectors of unknowns."""
    if not np.linalg.eigvalsh(prior.covariance)[0] > 0:
        raise ParameterError("an acceleration or a spin that is known needs errors in all three components")
    weight = np.linalg.inv(prior.covariance)
    matrix, rhs = sums.matrix.copy(), sums.rhs.copy()
    matrix[..., unknowns, unknowns] += weight
    rhs[..., unknowns] += weight @ prior.value
    return replace(sums, matrix=matrix, rhs=rhs, chi2_null=sums.chi2_null + prior.value @ weight @ prior.value)


def subtract_known_motions(sums: ParallaxSums, known_values: FloatArray, unknowns: slice) -> ParallaxSums:
    """Take the motions by known values of some unknowns away."""
    motion = sums.matrix[..., unknowns] @ known_values
    chi2_null = sums.chi2_null - 2 * sums.rhs[..., unknowns] @ known_values + motion[..., unknowns] @ known_values
    return replace(sums, rhs=sums.rhs - motion, chi2_null=chi2_null)


def add_flow_prior(sums: ParallaxSums, width: int, scale: FloatArray | float) -> ParallaxSums:
    """Add a Gaussian prior on the amplitudes of the modes of a flow, about zero with the standard deviation `scale`."""
    matrix = sums.matrix.copy()
    mode_indices = np.arange(width, matrix.shape[-1])
    matrix[..., mode_indices, mode_indices] += 1 / np.asarray(scale)[..., None] ** 2
    prior_logdet = len(mode_indices) * np.log(np.asarray(scale) ** 2)
    return replace(sums, matrix=matrix, logdet=sums.logdet + prior_logdet)


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """Estimate of the modes of a flow, given the other parameters θ: mean − slope θ, and a covariance."""

    mean: FloatArray
    slope: FloatArray
    covariance: FloatArray


def marginalise_flow(sums: ParallaxSums, width: int) -> tuple[ParallaxSums, Amplitudes]:
    """The modes marginalised: normal equations of what is left, and the modes given that."""
    parameters, modes = slice(0, width), slice(width, None)
    matrix, rhs = sums.matrix, sums.rhs
    inner = matrix[..., modes, modes]
    cholesky_root = np.linalg.cholesky(inner)
    logdet = 2 * np.log(np.einsum("...ii->...i", cholesky_root)).sum(-1)
    solution = np.linalg.solve(inner, np.concatenate([matrix[..., modes, parameters], rhs[..., modes, None]], axis=-1))
    slope, mean = solution[..., :-1], solution[..., -1]
    cross_matrix = matrix[..., parameters, modes]
    marginal = ParallaxSums(
        matrix[..., parameters, parameters] - cross_matrix @ slope,
        rhs[..., parameters] - np.einsum("...ij,...j->...i", cross_matrix, mean),
        sums.chi2_null - np.einsum("...i,...i->...", rhs[..., modes], mean),
        sums.logdet + logdet,
        sums.n_data,
    )
    covariance = np.asarray(np.linalg.inv(inner) if inner.ndim == 2 else (), float)
    return marginal, Amplitudes(mean, slope, covariance)


@dataclass(frozen=True, eq=False)
class LocalGroup:
    """The Local Group's velocity as a measurement of the flow where we are.

    Given that velocity V, the amplitudes of the modes are c ± P on average, with

        c = Dᵀ (D Dᵀ + Σ)⁻¹ V,   P = (1 + Dᵀ Σ⁻¹ D)⁻¹,

    D the modes where we are and Σ what else there is in V. The motions tell amplitudes times h = H0/H_ref, so that
    their mean is h c; P stands for H_ref, as all variances of the flow. This is linear in h, and the speed of the Local
    Group alone has no information on H0. If h were taken as known, or V as drawn from flows of known variance, the
    estimate of H0 would be biased towards H_ref.
    """

    modes: FlowModes
    velocity: FloatArray
    covariance: FloatArray

    def add_to_sums(
        self, sums: ParallaxSums, width: int, ratio: float, our_velocity: FloatArray | None, h: float | None = None
    ) -> ParallaxSums:
        """Normal equations with this measurement as well; they hold the flow's prior already.

        `ratio` is H0/H_ref in the weights; `h` that of the mean, the same unless given.
        """
        h = ratio if h is None else h
        design = self.modes.at_origin()
        gain = design.T @ np.linalg.inv(self.covariance) / ratio**2
        mean = design.T @ np.linalg.solve(design @ design.T + self.covariance, self.velocity)
        pull = gain @ self.velocity
        information_on_h = pull @ mean
        matrix, rhs, chi2_null = sums.matrix.copy(), sums.rhs.copy(), sums.chi2_null
        matrix[width:, width:] += gain @ design
        if our_velocity is None:
            rhs[width:] += pull * h
            chi2_null = chi2_null + information_on_h * h**2
        else:
            scaled_direction = our_velocity / (our_velocity @ our_velocity)
            matrix[U, U] += information_on_h * np.outer(scaled_direction, scaled_direction)
            matrix[width:, U] -= np.outer(pull, scaled_direction)
            matrix[U, width:] = matrix[width:, U].T
        return replace(sums, matrix=matrix, rhs=rhs, chi2_null=chi2_null)


#: Size of the subsample; it determines the omitted flow to a few per cent.
_SUBSAMPLE_SIZE = 20_000


@dataclass(frozen=True, eq=False)
class OmittedFlow:
    """A catalogue that is fitted without a flow, and the modes that would describe it."""

    field: Field | Parts
    calibration: Calibration
    modes: FlowModes
    options: dict[str, Any]

    def sums(self, spread: float, excess_noise: float, n_sources: int) -> ParallaxSums:
        """Normal matrix and right-hand side with the flow's columns, from a subsample, scaled to all sources."""
        subsample = apply_step(self.field, partial(_take_subsample, share=_SUBSAMPLE_SIZE / n_sources))
        subsample_equations = make_equations(subsample, self.calibration, modes=self.modes, **self.options)
        sums = subsample_equations.sums(spread, excess_noise)
        source_ratio = n_sources / (sums.n_data // 2)
        return replace(sums, matrix=sums.matrix * source_ratio, rhs=sums.rhs * source_ratio)


def compute_flow_covariance(sums: ParallaxSums, to_u: FloatArray, ratio: float) -> FloatArray:
    """The covariance that an omitted flow induces in the fitted parameters."""
    width = len(to_u)
    normal = to_u.T @ sums.matrix[:width, :width] @ to_u
    response = np.linalg.solve(normal, to_u.T @ sums.matrix[:width, width:]) * ratio
    return response @ response.T


def _take_subsample(field, share):
    """A share of the sources, by their places: at least one."""
    is_selected = select_share(share, field.lon, field.lat)
    return field[is_selected] if is_selected.any() else field[:1]


def solve_for(
    sums: ParallaxSums,
    to_u: FloatArray,
    names: tuple[str, ...],
    spin: Literal["free"] | Vector | None,
    equations: ParallaxEquations | ParallaxParts,
    acceleration: Vector | None,
    ratio: float,
    local_group_measurement: LocalGroup | None = None,
    velocity: FloatArray | None = None,
    omitted_flow_sums: ParallaxSums | None = None,
) -> dict[str, Any]:
    """Least squares for θ with (u, ã, ω[, v]) = to_u θ: the spin fixed, free or none, the flow marginalised.

    `to_u` is (9 or 12, p), `ratio` H0/H_ref in the weights, `local_group_measurement` one of the flow where we are,
    `velocity` ours where H0 is the first of θ; `omitted_flow_sums` are the sums with the columns of a flow that the fit
    leaves out. Returns what a solution is made with.
    """
    width = 9 if velocity is None else 12
    sums = add_acceleration_prior(sums, acceleration, equations.frame)
    noise_matrix, amplitudes = sums.matrix[:width, :width], None
    if isinstance(spin, str) and spin == "free":
        to_u = np.concatenate([to_u, np.eye(width)[:, OMEGA]], axis=1)
        names = (*names, "omega_x", "omega_y", "omega_z")
    elif spin is not None and not isinstance(spin, Vector):
        raise ParameterError(f"spin is None, 'free' or a Vector, not {spin!r}")
    known_values = np.zeros(width)
    if velocity is not None:
        known_values[V] = velocity
    if isinstance(spin, Vector):
        spin = spin.to_frame(equations.frame)
        known_values[OMEGA] = spin.value
    if equations.modes is not None:
        sums = add_flow_prior(sums, width, ratio)
        if local_group_measurement is not None:
            sums = local_group_measurement.add_to_sums(sums, width, ratio, velocity)
        sums, amplitudes = marginalise_flow(sums, width)
    normal = to_u.T @ sums.matrix @ to_u
    check_parameters_determined(normal, names, sums.n_data // 2)
    inverse = np.linalg.inv(normal)
    covariance = (inverse + inverse.T) / 2
    reduced_sums = subtract_known_motions(sums, known_values, slice(None))
    rhs = to_u.T @ reduced_sums.rhs
    values = inverse @ rhs
    noise_covariance = np.linalg.inv(to_u.T @ noise_matrix @ to_u) if equations.modes is not None else covariance
    if isinstance(spin, Vector):
        spin_response = covariance @ to_u.T @ sums.matrix[:, OMEGA]
        covariance = covariance + spin_response @ spin.covariance @ spin_response.T
    attributes = {
        "names": names,
        "values": values,
        "covariance": covariance,
        "chi2": float(reduced_sums.chi2_null - values @ rhs),
        "n_data": sums.n_data,
        "frame": equations.frame,
        "notes": equations.notes,
        "noise_covariance": noise_covariance,
    }
    if omitted_flow_sums is not None:
        omitted_flow_sums = add_acceleration_prior(omitted_flow_sums, acceleration, equations.frame)
        attributes["flow_covariance"] = compute_flow_covariance(omitted_flow_sums, to_u, ratio)
    if amplitudes is not None:
        attributes["flow"] = make_flow(equations, amplitudes, to_u @ values + known_values, to_u, covariance, ratio)
    return attributes


def check_parameters_determined(matrix: FloatArray, names: Sequence[str], n_sources: int, limit: float = 1e10) -> None:
    """Raise DegeneracyError if the data do not determine some combination of the parameters."""
    diagonal = np.diag(matrix)
    if 2 * n_sources >= len(names) and (diagonal > 0).all():
        eigenvalues = np.linalg.eigvalsh(matrix / np.sqrt(np.outer(diagonal, diagonal)))
        if eigenvalues[0] * limit > eigenvalues[-1]:
            return
    raise DegeneracyError(
        f"{n_sources} sources cannot separate {', '.join(names)}: more sources, over more of the sky and of "
        "more than one distance, are needed"
    )
