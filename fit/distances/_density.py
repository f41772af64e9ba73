"""How many sources there are at each distance, and inverse distances of those whose distance or parallax was measured.

The true distance has the density p(d | data) ∝ d² exp(−d/L) N(data; …), that of sources in an exponentially thinning
space (Bailer-Jones 2015, PASP 127, 994), with L as the catalogue has it. A motion that falls as 1/d is expected to be
as E[1/d] has it: with parallaxes of small S/N, putting 1/ϖ in would bias it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize

from vsh.field import Field
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.tools.errors import DegeneracyError, FieldError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.subsample import select_share
from vsh.tools.types import BoolArray, FloatArray
from vsh.tools.units import AU_PER_YEAR


@dataclass(frozen=True, eq=False)
class LogCurve:
    """A natural cubic spline through a few values, straight beyond the outer ones."""

    knots: FloatArray
    values: FloatArray

    def __call__(self, x: FloatArray) -> FloatArray:
        """The logarithm of the curve."""
        spline = CubicSpline(self.knots, self.values, bc_type="natural")
        end_knots = self.knots[[0, -1]]
        clipped = np.clip(x, *end_knots)
        end_slopes = spline(end_knots, 1)
        return spline(clipped) + np.where(x < end_knots[0], end_slopes[0], end_slopes[1]) * (x - clipped)


def make_log_curve_basis(knots: FloatArray, x: FloatArray) -> FloatArray:
    """Make the basis of the curve at `x`, one function per knot, (n, k)."""
    return np.stack([LogCurve(knots, unit)(x) for unit in np.eye(len(knots))], axis=1)


def fit_curve_values(basis: FloatArray, counts: FloatArray, shares: FloatArray, smoothing: float = 1e-3) -> FloatArray:
    """The values at the knots that make counts most probable: group b is in cell a as shares[b, a] exp(curve)."""
    bending = np.diff(np.eye(basis.shape[1]), 2, axis=0)
    total = counts.sum()

    def compute_misfit(theta):
        curve = np.exp(basis @ theta - (basis @ theta).max())
        # Cells are seen as they are, or through a kernel.
        prediction = np.maximum(shares * curve if shares.ndim == 2 else shares @ curve, 1e-300)
        norm = prediction.sum(1)
        value = np.sum(counts.sum(1) * np.log(norm)) - np.sum(counts * np.log(prediction))
        excess = (counts.sum(1) / norm)[:, None] - counts / prediction
        gradient = curve * np.einsum("bm,bm->m" if shares.ndim == 2 else "bam,ba->m", shares, excess)
        curvature = bending @ theta
        return (
            value / total + smoothing * curvature @ curvature + 1e-6 * theta.mean() ** 2,
            basis.T @ gradient / total + 2 * smoothing * bending.T @ curvature + 2e-6 * theta.mean() / len(theta),
        )

    return minimize(compute_misfit, np.zeros(basis.shape[1]), jac=True, method="BFGS", options={"gtol": 1e-6}).x


#: Cells of ln z in which redshifts are counted.
Z_EDGES = np.arange(np.log(1e-4), np.log(30.0), 0.02)


@dataclass(frozen=True, eq=False)
class SourceDensity(InNotebook):
    """The number of sources per comoving volume, up to a factor."""

    curve: Any = None
    words: str = "evenly in volume"

    def log(self, distance: FloatArray) -> FloatArray:
        """The logarithm of the density."""
        return np.zeros(np.shape(distance)) if self.curve is None else self.curve(np.log(distance))


@dataclass(frozen=True)
class GivenDensity:
    """The logarithm of a function of distance, as a function of its logarithm."""

    function: Callable[[FloatArray], FloatArray]

    def __call__(self, log_distance: FloatArray) -> FloatArray:
        with np.errstate(divide="ignore"):
            return np.log(np.asarray(self.function(np.exp(log_distance)), float))


@dataclass(frozen=True, eq=False)
class CompletedDensity:
    """The density of all sources, from that of those which a catalogue complete to a magnitude holds."""

    curve: LogCurve
    log_distance: FloatArray
    log_share: FloatArray

    def __call__(self, log_distance: FloatArray) -> FloatArray:
        log_share_spline = CubicSpline(self.log_distance, self.log_share)
        return self.curve(log_distance) - log_share_spline(np.clip(log_distance, *self.log_distance[[0, -1]]))


def complete_density(density: SourceDensity, luminosity: Any, limit: float, log_distance: Any) -> SourceDensity:
    """The density of all sources behind that of a magnitude-limited catalogue."""
    log1p_z = np.geomspace(1e-4, np.log(30.0), 600)
    log_d, _ = log_distance(log1p_z)
    faintest_magnitude = limit - 5 / np.log(10) * (log_d + log1p_z) - 25
    magnitude = np.linspace(faintest_magnitude.min() - 12, faintest_magnitude.max(), 6000)
    log_phi = luminosity.log(magnitude)
    with np.errstate(divide="ignore"):  # no source is so bright
        log_share = np.interp(faintest_magnitude, magnitude, np.log(np.cumsum(np.exp(log_phi - log_phi.max()))))
    is_finite = np.isfinite(log_share)
    return SourceDensity(CompletedDensity(density.curve, log_d[is_finite], log_share[is_finite]), density.words)


#: Classes of the error of ln(1 + z), a factor of two each, in which redshifts are counted: spectroscopic redshifts are
#: not seen through the errors of photometric ones.
ERROR_CLASS_EDGES = np.r_[0.0, np.geomspace(1e-5, 1.0, 18), np.inf]


#: A class of errors so many times as large as the typical one is not used to find the density.
_LARGEST_ERROR_RATIO = 4.0


def count_redshifts_by_error(redshift: FloatArray, spread: FloatArray) -> FloatArray:
    """Count sources by class of error and by redshift, behind the sum of squared errors; such tables add over parts."""
    counts = np.histogram2d(spread, np.log(redshift), bins=(ERROR_CLASS_EDGES, Z_EDGES))[0]
    squared_errors = np.histogram(spread, bins=ERROR_CLASS_EDGES, weights=spread**2)[0]
    return np.column_stack([squared_errors, counts])


def find_median_spread(counts: FloatArray) -> float:
    """Find the error of ln(1 + z) of the class in the middle of those of `count_redshifts_by_error`, by number."""
    class_counts = counts[:, 1:].sum(axis=1)
    median_class = int(np.searchsorted(np.cumsum(class_counts), class_counts.sum() / 2))
    return float(np.sqrt(counts[median_class, 0] / max(class_counts[median_class], 1.0)))


#: What a galaxy has of its own: none tells more of ours than that, and no redshift places it better. [km/s]
_OWN_VELOCITY = 300.0


def flow_information(redshift: FloatArray, weight: FloatArray) -> FloatArray:
    """Information of sources on a velocity by redshift, a table that adds over parts; `weight` is of their motions.

    1/(s² + (4.74 d)²/w) each, of distances d to s/H0 at best, s the velocity that a galaxy has of its own: else a few
    that are next to us, by their redshifts, would be all that is followed, and flows of the others independent noise.
    """
    distance = np.hypot(transverse_distance(redshift), _OWN_VELOCITY / hubble_value(FLAT_PLANCK13))
    with np.errstate(divide="ignore"):
        information = 1 / (_OWN_VELOCITY**2 + (AU_PER_YEAR * distance) ** 2 / weight)
    return np.histogram(np.log(redshift), bins=Z_EDGES, weights=information)[0]


def flow_limits(information: FloatArray) -> tuple[float, float]:
    """Redshifts between which all but a hundredth of that lies: a flow beyond them moves no estimate."""
    cumulative_share = np.cumsum(information) / max(information.sum(), 1e-300)
    lower_cell, upper_cell = np.argmax(cumulative_share > 1e-4), np.argmax(cumulative_share > 0.99)
    return float(np.exp(Z_EDGES[lower_cell])), float(np.exp(Z_EDGES[upper_cell + 1]))


def fit_density(
    table: FloatArray, log_distance: Any, limits: tuple[float, float], inner_limits: tuple[float, float] | None = None
) -> SourceDensity:
    """The density by which a catalogue's redshifts are most probable, with the errors and velocities of each class."""
    class_counts, typical_error = table[:, 1:].sum(axis=1), find_median_spread(table)
    spreads = np.sqrt(table[:, 0] / np.maximum(class_counts, 1))
    # Those that are much less certain than most say nothing of the density that most do not say.
    is_used = (class_counts > 0) & (spreads < _LARGEST_ERROR_RATIO * max(typical_error, 1e-9))
    spreads, by_class = spreads[is_used], table[is_used, 1:]
    counts = by_class.sum(axis=0)
    if inner_limits is not None and inner_limits[1] > inner_limits[0] > 0:
        inner_cells = np.searchsorted(Z_EDGES, np.log(inner_limits)) - 1
        if inner_cells[1] - inner_cells[0] > 8 and counts[inner_cells[0] : inner_cells[1]].sum() > 0.2 * counts.sum():
            limits = inner_limits
    lower_cell, upper_cell = np.searchsorted(Z_EDGES, np.log(limits)) - 1
    if upper_cell - lower_cell > 8:  # cells at the ends are cut by the catalogue's own limits
        lower_cell, upper_cell = lower_cell + 1, upper_cell - 1
    lower_cell = max(lower_cell, 0)
    cells, edges = slice(lower_cell, upper_cell + 1), np.log1p(np.exp(Z_EDGES[lower_cell : upper_cell + 2]))
    largest_error = spreads.max()
    log1p_z = np.linspace(max(np.log1p(1e-4), edges[0] - 5 * largest_error), edges[-1] + 5 * largest_error, 600)
    from scipy.special import ndtr

    kernel = np.diff(ndtr((edges[:, None] - log1p_z) / np.maximum(spreads, 1e-9)[:, None, None]), axis=1)
    log_d, log_volume = log_distance(log1p_z)
    # Beyond what is seen the curve goes on straight.
    inner_d = log_d[(log1p_z >= edges[0]) & (log1p_z <= edges[-1])]
    knots = np.linspace(inner_d[0], inner_d[-1], int(np.clip(np.ceil(inner_d[-1] - inner_d[0]) + 1, 4, 8)))
    volume = np.exp(log_volume - log_volume.max())
    by_cell = by_class[:, cells]
    is_seen = by_cell.sum(axis=1) > 0
    values = fit_curve_values(make_log_curve_basis(knots, log_d), by_cell[is_seen], (kernel * volume)[is_seen])
    return SourceDensity(LogCurve(knots, values), f"as the catalogue's {counts.sum():.0f} redshifts have it")


#: Cells of absolute magnitude and of distance modulus, by their lower ends.
_CELL_WIDTH = 0.1
MAGNITUDES = np.arange(-32.0, 12.0, _CELL_WIDTH)
MODULI = np.arange(20.0, 60.0, _CELL_WIDTH)
#: Fewer sources than this say nothing of a luminosity function.
_FEWEST_WITH_MAGNITUDES = 30


@dataclass(frozen=True, eq=False)
class LuminosityFunction(InNotebook):
    """The density of galaxies by absolute magnitude, up to a factor."""

    curve: Any
    words: str

    def log(self, magnitude: FloatArray) -> FloatArray:
        """log φ(M)."""
        return self.curve(magnitude)


def count_absolute_magnitudes(magnitude: FloatArray, modulus: FloatArray) -> FloatArray:
    """Count sources by absolute magnitude and distance modulus, in a table that adds over parts."""
    edges = [np.r_[lower_edges, lower_edges[-1] + _CELL_WIDTH] for lower_edges in (MAGNITUDES, MODULI)]
    return np.histogram2d(magnitude - modulus, modulus, bins=edges)[0]


#: A sample is not complete where its T_C is below this and the mean share is off by more than the errors of redshifts
#: alone make it; and the fewest galaxies that tell.
_INCOMPLETE_DEVIATE, _LARGEST_MEAN_SHIFT, _FEWEST_FOR_COMPLETENESS = -3.0, 0.02, 100


def compute_completeness_deviate(counts: FloatArray, limit: float) -> float:
    """Compute the normal deviate of a sample from completeness to a magnitude, far below zero where faint ones lack.

    Rauzy's (2001, MNRAS 324, 51) T_C: of the galaxies that are no farther than a given one and bright enough to be
    seen at its distance, the share that is brighter is uniform in a complete sample, however galaxies are distributed.

    counts : (m, k) array
        Those of `count_absolute_magnitudes`.
    limit : float
        The magnitude. Too few galaxies to tell give 0.
    """
    rows, columns = np.nonzero(counts)
    if counts.sum() < _FEWEST_FOR_COMPLETENESS:
        return 0.0
    # Galaxies brighter than each cell's lower edge and within it, at most as far, by sums over the table.
    nearer = np.cumsum(counts, axis=1)
    brighter = np.cumsum(nearer, axis=0)
    # The last class of magnitude that is bright enough as a whole, at the far edge of the class of distance.
    faintest_rows = np.searchsorted(MAGNITUDES, limit - (MODULI[columns] + _CELL_WIDTH) + 1e-9, side="right") - 2
    is_bright_enough = faintest_rows >= rows
    rows, columns, faintest_rows = rows[is_bright_enough], columns[is_bright_enough], faintest_rows[is_bright_enough]
    ties = nearer[rows, columns]
    rank = brighter[rows, columns] - ties / 2
    n_visible = brighter[faintest_rows, columns]
    cell_counts = counts[rows, columns]
    share, variance = rank / n_visible, (n_visible - 1) / (12 * (n_visible + 1))
    return float(cell_counts @ (share - 0.5) / np.sqrt(np.maximum(cell_counts @ variance, 1e-300)))


def find_completeness_limit_and_counts(counts: FloatArray, faintest: float) -> tuple[float, FloatArray]:
    """Find the faintest magnitude to which a sample is complete, and the counts of galaxies to it; nan where to none.

    Tried from the faintest of all on in steps of a quarter of a magnitude, as far as a quarter of the galaxies is left.
    """
    apparent_magnitude = (MAGNITUDES + _CELL_WIDTH)[:, None] + (MODULI + _CELL_WIDTH)
    for limit in np.arange(faintest, faintest - 8, -0.25):
        counts_to_limit = np.where(apparent_magnitude <= limit + 1e-9, counts, 0.0) if limit < faintest else counts
        if counts_to_limit.sum() < 0.25 * counts.sum():
            break
        deviate = compute_completeness_deviate(counts_to_limit, limit)
        if deviate >= _INCOMPLETE_DEVIATE or deviate / np.sqrt(12 * counts_to_limit.sum()) >= -_LARGEST_MEAN_SHIFT:
            return float(limit), counts_to_limit
    return float("nan"), counts


def fit_luminosity_function(counts: FloatArray, limit: float) -> LuminosityFunction:
    """The luminosity function by which counts of a magnitude-limited catalogue are most probable.

    Only the shape of the counts at each distance matters, so that neither density nor clusters bear on it (Sandage,
    Tammann & Yahil 1979, ApJ 232, 352; the curve is free as that of Efstathiou, Ellis & Peterson 1988, MNRAS 232, 431).
    """
    n_galaxies = counts.sum()
    if n_galaxies < _FEWEST_WITH_MAGNITUDES:
        raise DegeneracyError(
            f"{n_galaxies:.0f} galaxies with magnitudes say nothing of a luminosity function: give one (luminosity=), "
            "or use no magnitudes (magnitudes=False, --columns magnitude=)"
        )
    cumulative_share = np.cumsum(counts.sum(1)) / n_galaxies
    lower, upper = MAGNITUDES[np.searchsorted(cumulative_share, [0.005, 0.995])]
    knots = np.linspace(lower, max(upper, lower + 1.0), 8 if n_galaxies > 1000 else 5)
    magnitudes = MAGNITUDES + _CELL_WIDTH / 2
    magnitude_mask = (magnitudes > lower - 3) & (magnitudes < upper + 3)
    modulus_mask = counts.sum(0) > 0
    visibility = (magnitudes[magnitude_mask] + MODULI[modulus_mask, None] <= limit).astype(float)
    visible_counts = counts[magnitude_mask][:, modulus_mask].T * visibility
    values = fit_curve_values(make_log_curve_basis(knots, magnitudes[magnitude_mask]), visible_counts, visibility)
    return LuminosityFunction(
        LogCurve(knots, values), f"luminosity function of {n_galaxies:.0f} galaxies to magnitude {limit:.2f}"
    )


@dataclass(frozen=True, eq=False)
class VariancesByRedshift(InNotebook):
    """The mean variance of motions, a smooth function of redshift.

    Weights by a source's own error, which follows its magnitude, tell near sources from far ones of the same
    redshift. Where magnitudes are not known, only weights that depend on the redshift alone are unbiased. With the
    mean variance of its neighbours for each source the covariance of a fit is right on average.
    """

    curve: LogCurve

    def at(self, redshift: FloatArray) -> FloatArray:
        """The mean variance at redshifts. [(µas/yr)²]"""
        return np.exp(self.curve(np.log(redshift)))


def sum_variances_by_redshift(redshift: FloatArray, sigma: FloatArray) -> FloatArray:
    """Count sources and sum their mean variances by redshift, (2, k), which adds over parts."""
    ln_z = np.log(redshift)
    return np.stack([np.histogram(ln_z, Z_EDGES)[0], np.histogram(ln_z, Z_EDGES, weights=np.mean(sigma**2, 0))[0]])


def fit_variances_by_redshift(sums: FloatArray, n_knots: int = 6) -> VariancesByRedshift:
    """Fit the local mean of the variances, which are taken as exponentially distributed about it."""
    has_sources = sums[0] > 0
    counts, totals = sums[:, has_sources]
    ln_z = (Z_EDGES[1:] + Z_EDGES[:-1])[has_sources] / 2
    knot_positions = np.linspace(ln_z[0], max(ln_z[-1], ln_z[0] + 0.1), n_knots)
    basis, n, mean_variance = make_log_curve_basis(knot_positions, ln_z), counts.sum(), totals.sum() / counts.sum()
    bending = np.diff(np.eye(n_knots), 2, axis=0)

    def compute_misfit(theta):
        log_ratio = basis @ theta
        ratio = totals / mean_variance * np.exp(-log_ratio)
        curvature = bending @ theta
        value = np.sum(ratio + counts * log_ratio) / n + 1e-4 * curvature @ curvature
        return value, basis.T @ (counts - ratio) / n + 2e-4 * bending.T @ curvature

    log_ratios = minimize(compute_misfit, np.zeros(n_knots), jac=True, method="BFGS", options={"gtol": 1e-7}).x
    return VariancesByRedshift(LogCurve(knot_positions, log_ratios + np.log(mean_variance)))


_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(96)
_INTEGRATION_REACH, _BLOCK_SIZE = 6.0, 4096
#: Below this S/N a parallax is integrated over in ln d, above it in ϖ.
_PRECISE_SIGNAL_TO_NOISE = 6.0
#: So many sources tell the scale length to a per cent or two.
_N_SOURCES_FOR_LENGTH = 4000


class MeasuredInverseDistances(NamedTuple):
    """The motion that 1 km/s gives to each source, its mean and variance, and the scale length they were taken as.

    Attributes
    ----------
    mean : (n,) array
        [µas/yr per km/s]
    variance : (n,) array
    length : float
        L. [Mpc]
    n_parallaxes : int
        Sources whose parallax was used.
    """

    mean: FloatArray
    variance: FloatArray
    length: float
    n_parallaxes: int


def inverse_distances_from_measurements(
    field: Field, length: float | None = None, power: float = 2.0
) -> MeasuredInverseDistances:
    """Mean and variance of the inverse distances of a field with distances, or parallaxes.

    Parameters
    ----------
    field : Field
        With a distance or a parallax for every source, and their errors; where both are known, the distance counts.
    length : float, optional
        Scale length L of the density of sources; that of greatest likelihood unless given. [Mpc]
    power : float
        κ of the density of sources, d^κ exp(−d/L): 2 in a ball, 1 in a thin disc.

    Raises
    ------
    FieldError
        If some source has neither; the message counts them.
    """
    has_distance = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    is_missing = ~has_distance_or_parallax(field)
    if is_missing.any():
        raise FieldError(
            f"{is_missing.sum()} of {len(field)} sources have neither a distance nor a parallax with its error (first: "
            f"row {is_missing.argmax()}): name the columns (distance= and distance_error=, or parallax= and "
            "parallax_error=; --columns), and leave those sources out (--where 'not ismissing(distance)')"
        )
    measured, error, is_parallax = np.empty(len(field)), np.empty(len(field)), ~has_distance
    for column, distance, parallax in (
        (measured, field.distance, field.parallax),
        (error, field.distance_error, field.parallax_error),
    ):
        if has_distance.any():
            column[has_distance] = np.asarray(distance)[has_distance]
        if is_parallax.any():
            column[is_parallax] = 1000 * np.asarray(parallax)[is_parallax]  # 1 mas is 1000 per Mpc
    length = _fit_scale_length(measured, error, is_parallax, power) if length is None else float(length)

    def integrate_chunk(chunk):
        return _integrate_over_distance(measured[chunk], error[chunk], is_parallax[chunk], length, power)[:2]

    mean, variance = np.concatenate(list(map_blocks(integrate_chunk, len(field), _BLOCK_SIZE)), axis=1)
    return MeasuredInverseDistances(mean, variance, length, int(is_parallax.sum()))


def _integrate_over_distance(measured, error, is_parallax, length, power):
    """Mean and variance of the rate, and the logarithm of the density of the data, (3, n)."""
    is_precise = np.where(is_parallax, measured > _PRECISE_SIGNAL_TO_NOISE * error, True)
    reach = _INTEGRATION_REACH * error
    lower, upper = measured - reach, measured + reach
    # Surely measured, the datum itself is integrated over; a parallax that is not, in ln d.
    lowest = np.where(is_parallax, 1e-3 * np.abs(measured), 1e-3 * measured)
    lower = np.where(is_precise, np.maximum(lower, lowest), np.log(1 / np.maximum(upper, 1e-12)))
    upper = np.where(is_precise, upper, np.log(40 * length))
    upper = np.maximum(upper, lower + 1.0 * ~is_precise)
    nodes = (upper + lower) / 2 + (upper - lower) / 2 * _GAUSS_NODES[:, None]
    with np.errstate(over="ignore"):
        distance = np.where(is_precise, np.where(is_parallax, 1 / nodes, nodes), np.exp(nodes))
        jacobian = np.where(is_precise, np.where(is_parallax, 2 * np.log(distance), 0.0), nodes)  # ln |dd/dnode|
        prediction = np.where(is_parallax, 1 / distance, distance)
    log_density = power * np.log(distance) - distance / length - ((prediction - measured) / error) ** 2 / 2 + jacobian
    peak = log_density.max(0)
    weight = np.exp(log_density - peak) * _GAUSS_WEIGHTS[:, None]
    norm = weight.sum(0)
    rate = 1 / (distance * AU_PER_YEAR)
    mean = (weight * rate).sum(0) / norm
    variance = (weight * (rate - mean) ** 2).sum(0) / norm
    # d^κ exp(−d/L)/(Γ(κ + 1) L^(κ + 1)) is the density; the rest does not depend on L.
    return np.stack([mean, variance, np.log(norm * (upper - lower) / 2) + peak - (power + 1) * np.log(length)])


def _fit_scale_length(measured, error, is_parallax, power):
    """The scale length of greatest likelihood, by golden sections in its logarithm."""
    sample = select_share(_N_SOURCES_FOR_LENGTH / len(measured), measured, error)
    measured, error, is_parallax = measured[sample], error[sample], is_parallax[sample]
    typical_distance = np.where(is_parallax, 1 / np.maximum(measured, error), measured)

    def compute_misfit(log_length):
        return -_integrate_over_distance(measured, error, is_parallax, np.exp(log_length), power)[2].sum()

    log_lengths = np.log(np.median(typical_distance) / 3) + np.linspace(-4, 4, 33)
    best_index = int(np.argmin([compute_misfit(log_length) for log_length in log_lengths]))
    lower, upper = log_lengths[max(best_index - 1, 0)], log_lengths[min(best_index + 1, 32)]
    golden_ratio = (np.sqrt(5) - 1) / 2
    while upper - lower > 1e-3:
        left, right = upper - golden_ratio * (upper - lower), lower + golden_ratio * (upper - lower)
        lower, upper = (lower, right) if compute_misfit(left) < compute_misfit(right) else (left, upper)
    return float(np.exp((lower + upper) / 2))


def has_distance_or_parallax(field: Field) -> BoolArray:
    """Mask of sources with a distance, or a parallax with its error, (n,)."""
    mask = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    if field.parallax is None or field.parallax_error is None:
        return mask
    return mask | (np.isfinite(field.parallax) & np.isfinite(field.parallax_error))
