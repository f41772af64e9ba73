"""What turns redshifts of a catalogue into distances: frame, velocities, density, luminosities.

The inverse distance of each source has a mean and a variance, given the redshift as observed and the magnitude. The
density of the true redshift z, x = ln(1 + z), is

    p(x | z_obs, G) ∝ n(d) d² d'(x) φ(G − 5 lg(d(1 + z)) − 25) N(ln(1 + z_obs) − x; 0, s²),

with s the error of ln(1 + z) by the source's own velocity and by measurement. What selected the sources by z_obs or by
G drops out. A motion that falls as 1/d is expected to be as E[1/d] has it (regression calibration; Carroll et al.
2006, Measurement Error in Nonlinear Models, ch. 4): putting the observed redshift in would bias it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Literal

import numpy as np
from scipy.interpolate import CubicSpline, make_interp_spline

from fit.distances._density import (
    MODULI,
    GivenDensity,
    LogCurve,
    LuminosityFunction,
    SourceDensity,
    VariancesByRedshift,
    complete_density,
    count_absolute_magnitudes,
    count_redshifts_by_error,
    find_completeness_limit_and_counts,
    find_median_spread,
    fit_density,
    fit_luminosity_function,
    fit_variances_by_redshift,
    flow_information,
    flow_limits,
    sum_variances_by_redshift,
)
from vsh.field import Field
from vsh.io.parts import DISTANCES, Parts, as_parts
from vsh.models.cosmology import (
    FLAT_PLANCK13,
    FLOW_LIMIT,
    describe_unusable,
    distance_modulus,
    hubble_value,
    to_cmb,
    transverse_distance,
    usable_mask,
    with_redshift,
)
from vsh.sky.frames import TRUE, check_redshift_frame
from vsh.tools.errors import EmptyFieldError, FieldError, ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.types import BoolArray, Cosmology, FloatArray
from vsh.tools.units import AU_PER_YEAR, SPEED_OF_LIGHT


@dataclass(frozen=True, eq=False)
class Calibration(InNotebook):
    """Calibration of the distances of a catalogue by its redshifts.

    Attributes
    ----------
    frame : str
        Frame of the redshifts: "heliocentric", "cmb", "local-group"; "true" ones hold no velocities.
    dispersion : float
        Dispersion of radial velocities, those of flows among them. [km/s]
    cosmology : astropy cosmology
        The shape of the distance, and H_ref.
    density : SourceDensity
        Density of sources in space: of all where there is a luminosity function, else of those in the catalogue.
    luminosity : LuminosityFunction or None
        None where magnitudes are not used.
    errors : VariancesByRedshift or None
        The variances that stand in place of the sources' own, where magnitudes are not used.
    notes : tuple of str
    limits : pair of float
        The smallest and largest redshift of the catalogue.
    flow_limits : pair of float
        Redshifts between which sources tell of a velocity: those of a catalogue that reaches far are not its largest.
    """

    frame: str
    dispersion: float
    cosmology: Cosmology
    density: SourceDensity
    luminosity: LuminosityFunction | None = None
    errors: VariancesByRedshift | None = None
    notes: tuple[str, ...] = ()
    limits: tuple[float, float] = (np.nan, np.nan)
    flow_limits: tuple[float, float] = (np.nan, np.nan)

    @property
    def exact(self) -> bool:
        """Return whether redshifts hold the expansion alone."""
        return self.frame == TRUE

    def redshift(self, field: Field) -> FloatArray:
        """Redshifts of a `field` at rest in the microwave background, (n,); nan where there is none.

        Raises
        ------
        FieldError
            If one is missing, not positive, or below the flow, when it is corrected.
        """
        if field.redshift is None or self.frame in (TRUE, "cmb"):
            transverse_distance(field.redshift, self.cosmology)  # which says what is missing
        assert field.redshift is not None
        redshift = to_cmb(field.redshift, field.lon, field.lat, field.frame, self.frame)
        is_bad = ~usable_mask(redshift)
        if is_bad.any():
            row = is_bad.argmax()
            raise FieldError(
                f"{is_bad.sum()} of {len(field)} redshifts give no distance once they are taken from {self.frame} ones "
                f"to the frame of the microwave background: {describe_unusable(redshift)} (first: row {row}, "
                f"{field.redshift[row]:.6f} → {redshift[row]:.6f}). Leave those sources out: "
                "vsh.models.cosmology.with_redshift(field), or --on-bad drop"
            )
        return redshift

    def log_distance(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """ln d [Mpc] at `x` = ln(1 + z), and the logarithm of the volume for each x, but for a factor."""
        log_x = np.log(x)
        spline, slope = self._spline_and_slope
        log_d = spline(log_x) + log_x
        return log_d, 3 * log_d + np.log1p(slope(log_x)) - log_x

    @cached_property
    def _spline_and_slope(self):
        """ln d − ln x as a function of ln x, x = ln(1 + z), with its slope."""
        log_x = np.linspace(np.log(FLOW_LIMIT / 2), np.log(np.log(40.0)), 400)
        log_ratio = np.log(_extrapolate_distance(np.expm1(np.exp(log_x)), self.cosmology)) - log_x
        spline = make_interp_spline(log_x, log_ratio, k=5)
        return spline, spline.derivative()

    def spread(self, field: Field, redshift: FloatArray) -> FloatArray:
        """The error of ln(1 + z) of each source, (n,): of its velocity and its measurement.

        Parameters
        ----------
        field : Field
            The sources.
        redshift : (n,) array
            At rest in the microwave background.
        """
        variance = np.full(len(field), 0.0 if self.exact else (self.dispersion / SPEED_OF_LIGHT) ** 2)
        if field.redshift_error is not None:
            variance += (np.nan_to_num(field.redshift_error) / (1 + redshift)) ** 2
        return np.sqrt(variance)

    @property
    def little_h(self) -> float:
        """H_ref/100, by which Mpc become Mpc/h."""
        return hubble_value(self.cosmology) / 100


def _extrapolate_distance(redshift, cosmology):
    """The transverse distance; below the usable limit, in proportion to the redshift. [Mpc]"""
    return transverse_distance(np.maximum(redshift, FLOW_LIMIT), cosmology) * np.where(
        redshift < FLOW_LIMIT, redshift / FLOW_LIMIT, 1.0
    )


#: A sample that is complete to less than this above its faintest magnitude fades out; beyond, it is an inhomogeneous
#: list, whose magnitudes make errors too small (1.6 times for OpenNGC, complete to 14.5 of 21). [mag]
_MAX_FADING = 2.0
_GAUSS_NODES, _GAUSS_WEIGHTS = np.polynomial.legendre.leggauss(32)
_REACH = 6.0
_BLOCK_SIZE = 1024
#: Cells of a table of cubics, and the last ln(1 + z) in it; knots of one in the redshifts of sources.
_N_CELLS, _LAST_LOG1P_Z, _N_KNOTS = 8192, np.log(40.0), 3000


@dataclass(frozen=True, eq=False)
class InverseDistances(InNotebook):
    """Estimates of 1/d of each source, as the motion that 1 km/s gives."""

    mean: FloatArray
    variance: FloatArray
    slope: FloatArray
    own: BoolArray
    redshift: FloatArray

    @property
    def distance(self) -> FloatArray:
        """1/E[1/d], (n,). [Mpc]"""
        return 1 / (AU_PER_YEAR * self.mean)


def inverse_distances(field: Field, calibration: Calibration, threads: int | None = None) -> InverseDistances:
    """Mean and variance of the inverse distance of each source.

    Parameters
    ----------
    field : Field
        With redshifts, none missing or below 1e-4, and perhaps distances.
    calibration : Calibration
        Calibration of its catalogue.
    threads : int, optional
        How many; one a core unless given.

    Raises
    ------
    FieldError
        If redshifts cannot be used.
    """
    redshift = calibration.redshift(field)
    mean = 1 / (AU_PER_YEAR * transverse_distance(redshift, calibration.cosmology))
    variance, slope = np.zeros(len(field)), np.zeros(len(field))
    spread = calibration.spread(field, redshift)
    uncertain_rows = np.flatnonzero(spread > 0)
    magnitude = None if calibration.luminosity is None else np.asarray(field.magnitude)

    if uncertain_rows.size:
        x, s = np.log1p(redshift[uncertain_rows]), spread[uncertain_rows]
        g = None if magnitude is None else magnitude[uncertain_rows]
        compute_moments = _tabulate_moments_by_x(calibration, x, s) if g is None else _make_cached_moments(calibration)

        def compute_chunk_moments(chunk):
            return compute_moments(x[chunk], s[chunk], None if g is None else g[chunk])

        blocks = list(map_blocks(compute_chunk_moments, uncertain_rows.size, _BLOCK_SIZE, threads))
        mean[uncertain_rows], variance[uncertain_rows], slope[uncertain_rows] = np.concatenate(blocks, axis=1)
    if calibration.exact:
        slope[:] = 0.0
    has_distance = np.zeros(len(field), bool) if field.distance is None else np.isfinite(field.distance)
    if has_distance.any():
        columns = (field.distance, field.distance_error, redshift, magnitude)
        measured = [None if column is None else np.asarray(column)[has_distance] for column in columns]
        mean[has_distance], variance[has_distance] = _compute_moments_from_distances(calibration, *measured)
        slope[has_distance] = 0.0
    return InverseDistances(mean, variance, slope, has_distance, redshift)


def motions_per_velocity(field: Field, calibration: Calibration | None) -> FloatArray:
    """The motion that 1 km/s gives to each source, (n,), on average; nothing within the flow. [µas/yr per km/s]"""
    redshift = np.asarray(field.redshift)
    if calibration is not None:
        redshift = to_cmb(redshift, field.lon, field.lat, field.frame, calibration.frame)
    is_usable, rate = usable_mask(redshift), np.zeros(len(field))
    if is_usable.any():
        if calibration is None:
            rate[is_usable] = 1 / (AU_PER_YEAR * transverse_distance(redshift[is_usable]))
        else:
            rate[is_usable] = inverse_distances(field[is_usable], calibration).mean
    return rate


class _CubicTable:
    """Smooth functions of one variable as cubics on an even grid: a lookup and three products at each place."""

    def __init__(self, lower: float, upper: float, function: Callable[[FloatArray], Sequence[FloatArray]]) -> None:
        even_grid = np.linspace(lower, upper, _N_CELLS + 1)
        self._lower, self._per_cell = lower, _N_CELLS / (upper - lower)
        coefficients = CubicSpline(even_grid, np.array(function(even_grid)), axis=1).c
        coefficients /= self._per_cell ** np.arange(3, -1, -1)[:, None, None]
        self._coefficients = np.ascontiguousarray(np.moveaxis(coefficients, 2, 0))

    def __call__(self, x: FloatArray) -> list[FloatArray]:
        position = (x - self._lower) * self._per_cell
        cell = position.astype(np.int32)
        np.clip(cell, 0, _N_CELLS - 1, out=cell)
        position -= cell
        return [self._evaluate_cubic(coefficients, cell, position) for coefficients in self._coefficients]

    @staticmethod
    def _evaluate_cubic(coefficients, cell, position):
        value = coefficients[0].take(cell)
        for coefficient in coefficients[1:]:
            value *= position
            value += coefficient.take(cell)
        return value


class _RateMoments:
    """Mean, variance and slope of the rate of sources, by quadrature over their true redshifts."""

    def __init__(self, calibration: Calibration) -> None:
        self.calibration = calibration
        # Functions of the user's may have steps and ends, which cubics have not.
        self.compute_curves: Callable[[FloatArray], Sequence[FloatArray]] = self._compute_curves
        self.evaluate_log_luminosity: Callable[[FloatArray], Sequence[FloatArray]] = self._compute_log_luminosity
        if not isinstance(calibration.density.curve, GivenDensity):
            self.compute_curves = _CubicTable(np.log(np.log1p(FLOW_LIMIT)), np.log(_LAST_LOG1P_Z), self._compute_curves)
        if calibration.luminosity is not None and isinstance(calibration.luminosity.curve, LogCurve):
            self.evaluate_log_luminosity = _CubicTable(-60.0, 40.0, self._compute_log_luminosity)

    def _compute_curves(self, log_x):
        """The logarithm of the weight, the rate, and the distance modulus with its (1 + z)."""
        x = np.exp(log_x)
        log_d, log_weight = self.calibration.log_distance(x)
        weight = log_weight + self.calibration.density.log(np.exp(log_d))
        return weight, np.exp(-log_d) / AU_PER_YEAR, 5 / np.log(10) * (log_d + x) + 25

    def _compute_log_luminosity(self, magnitude):
        """The logarithm of the luminosity function."""
        assert self.calibration.luminosity is not None
        return (self.calibration.luminosity.log(magnitude),)

    def __call__(self, x: FloatArray, error: FloatArray, magnitude: FloatArray | None) -> FloatArray:
        """(3, n), for x = ln(1 + z)."""
        lowest = np.log1p(FLOW_LIMIT)
        lower, upper = np.maximum(x - _REACH * error, lowest), np.maximum(x, lowest) + _REACH * error
        nodes = (upper + lower) / 2 + (upper - lower) / 2 * _GAUSS_NODES[:, None]
        offset = nodes - x
        log_weight, rate, modulus = self.compute_curves(np.log(nodes))
        log_weight -= (offset / error) ** 2 / 2
        if magnitude is not None:
            log_weight += self.evaluate_log_luminosity(magnitude - modulus)[0]
        weight = _compute_probabilities(log_weight)
        mean, mean_offset = np.einsum("qn,qn->n", weight, rate), np.einsum("qn,qn->n", weight, offset)
        rate -= mean
        offset -= mean_offset
        weighted_rate = weight * rate
        variance, slope = np.einsum("qn,qn->n", weighted_rate, rate), np.einsum("qn,qn->n", weighted_rate, offset)
        return np.stack([mean, variance, slope / error**2])


_make_cached_moments = lru_cache(maxsize=8)(_RateMoments)  # parts, and skies of one study, share a calibration


def _tabulate_moments_by_x(calibration, x, error):
    """Moments without magnitudes: of many sources of one spread they are functions of x alone."""
    compute_moments = _make_cached_moments(calibration)
    if np.ptp(error) > 0 or len(x) < 2 * _N_KNOTS:
        return compute_moments
    knots = np.linspace(np.log(x.min()), np.log(x.max()) + 1e-12, _N_KNOTS)
    spline = CubicSpline(knots, compute_moments(np.exp(knots), np.full(_N_KNOTS, error[0]), None), axis=1)
    return lambda x, error, magnitude: spline(np.log(x))


def _compute_moments_from_distances(calibration, distance, error, redshift, magnitude):
    """Mean and variance of the rate where the distance itself was measured, (2, n)."""
    lower, upper = np.maximum(distance - _REACH * error, 1e-3 * distance), distance + _REACH * error
    nodes = (upper + lower) / 2 + (upper - lower) / 2 * _GAUSS_NODES[:, None]
    log_d = np.log(nodes)
    log_weight = 2 * log_d - ((nodes - distance) / error) ** 2 / 2
    weight = _compute_probabilities(log_weight + _compute_log_prior(calibration, log_d, np.log1p(redshift), magnitude))
    rate = np.exp(-log_d) / AU_PER_YEAR
    mean = np.sum(weight * rate, 0)
    return mean, np.sum(weight * (rate - mean) ** 2, 0)


def _compute_log_prior(calibration, log_d, x, magnitude):
    """The density of sources at a distance, given their magnitudes."""
    log_density = calibration.density.log(np.exp(log_d))
    if magnitude is not None:
        log_density = log_density + calibration.luminosity.log(magnitude - 5 / np.log(10) * (log_d + x) - 25)
    return log_density


def _compute_probabilities(log_weight):
    log_weight -= log_weight.max(0)
    weight = np.exp(log_weight, out=log_weight)
    weight *= _GAUSS_WEIGHTS[:, None]
    weight /= weight.sum(0)
    return weight


#: Dispersion of peculiar velocities in each component, those of flows among them. [km/s]
WHOLE_DISPERSION = 750.0


def calibrate(
    field: Field | Parts,
    redshift_frame: str | None = None,
    dispersion: float = WHOLE_DISPERSION,
    *,
    cosmology: Cosmology | None = None,
    density: Literal["volume", "fitted"] | Callable[[FloatArray], FloatArray] | None = None,
    luminosity: Callable[[FloatArray], FloatArray] | None = None,
    magnitudes: bool | None = None,
) -> Calibration:
    """Calibrate the distances of a catalogue by its redshifts.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4; gone through twice at most.
    redshift_frame : str, optional
        "heliocentric", "cmb", "local-group" or "true"; the field's own unless given.
    dispersion : float
        Dispersion of radial peculiar velocities, those of flows among them. [km/s]
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.
    density : "volume", "fitted", or a function of distance [Mpc], optional
        Sources per comoving volume, up to a factor: one everywhere, as the catalogue's redshifts have it, or given.
        With magnitudes of all sources that there are; without, of those in the catalogue. Fitted unless given.
    luminosity : function of absolute magnitude, optional
        log φ up to a constant; fitted to the catalogue, complete to its faintest magnitude, unless given.
    magnitudes : bool, optional
        Whether to use them; unless given, if all sources have one and the sample is complete, by Rauzy's (2001) test,
        to less than two magnitudes above its faintest. Of an incomplete sample those of the complete part are used.

    Raises
    ------
    ParameterError
        If a frame or a density is none, or magnitudes are asked for and there are none.
    FieldError
        If the dispersion is larger than c z of most sources, some magnitudes are missing, or redshifts cannot be used.
    """
    cosmology = FLAT_PLANCK13 if cosmology is None else cosmology
    sky = as_parts(field)
    bare = make_bare_calibration(field, redshift_frame, dispersion, cosmology)
    sums = sky.sum(partial(_sum_calibration_statistics, calibration=bare), roles=DISTANCES, words="redshifts")
    redshift_limits = float(min(sums["lowest"])), float(max(sums["highest"]))
    bare = replace(bare, limits=redshift_limits, flow_limits=flow_limits(sums["flow"]))
    if not sums["counts"][:, 0].any():
        return bare
    typical = find_median_spread(sums["counts"])
    _check_redshift_errors(bare, sums, dispersion)
    n_magnitudes, n = sums["magnitudes"], sums["n"]
    if magnitudes is None and 0 < n_magnitudes < n:
        raise FieldError(
            f"{n - n_magnitudes} of {n} sources have no magnitude: leave those out "
            "(field[np.isfinite(field.magnitude)]), or "
            "use no magnitudes (magnitudes=False, --columns magnitude=)"
        )
    if magnitudes and n_magnitudes < n:
        raise ParameterError(f"magnitudes are asked for, and {n - n_magnitudes} of {n} sources have none")
    use = n_magnitudes == n if magnitudes is None else bool(magnitudes)
    notes = _describe_uncertain_redshifts(sums["counts"], typical)
    is_luminosity_given = luminosity is not None
    histogram, faintest = _select_far_counts(sums["bright"], typical, cosmology), max(sums["faintest"], default=np.nan)
    if use and not is_luminosity_given:
        limit, complete_counts = find_completeness_limit_and_counts(histogram, faintest)
        if magnitudes is None and not limit >= faintest - _MAX_FADING:
            use = False
            reach = "none of them" if np.isnan(limit) else f"magnitude {limit:.2f}, not to its faintest, {faintest:.2f}"
            notes.append(
                f"magnitudes are not used: the sample is complete to {reach} (Rauzy's T_C); magnitudes=True uses those "
                "of the complete part"
            )
        elif np.isnan(limit):
            notes.append(
                "the magnitudes are complete to no limit (Rauzy's T_C): luminosity function and density of a sample "
                "that loses faint sources are wrong"
            )
        elif limit < faintest:
            notes.append(
                f"the sample is complete to magnitude {limit:.2f}, not to its faintest, {faintest:.2f} (Rauzy's T_C): "
                "luminosity function and density are those of the complete part"
            )
            histogram, faintest = complete_counts, limit
            count_bright = partial(_count_bright_redshifts, calibration=bare, limit=limit)
            sums |= {"counts": sky.sum(count_bright, roles=DISTANCES, words="redshifts of the complete part")}
    if use:
        if luminosity is not None:
            luminosity_function = LuminosityFunction(luminosity, "luminosity function as given")
        else:
            luminosity_function = fit_luminosity_function(histogram, faintest)
            notes.append(
                "magnitudes constrain distances by a luminosity function fitted to the catalogue, which must be "
                "complete to its faintest magnitude; otherwise use magnitudes=False (--columns magnitude=)"
            )
        bare = replace(bare, luminosity=luminosity_function)
    elif is_luminosity_given:
        raise ParameterError("a luminosity function needs magnitudes, which are not used")
    else:
        bare = replace(bare, errors=fit_variances_by_redshift(sums["variances"]))
        notes.append(
            "no magnitudes: distances follow from redshifts alone, and sources with distance errors above 5 % have the "
            "mean weight of their redshift"
        )
        notes += _describe_large_errors(sums["sizes"])
    return replace(bare, density=_choose_density(density, faintest if use else None, sums, bare), notes=tuple(notes))


def make_bare_calibration(
    field: Field | Parts, redshift_frame: str | None, dispersion: float, cosmology: Cosmology
) -> Calibration:
    """The frame of the redshifts alone."""
    frame = check_redshift_frame(redshift_frame or declared_frame(field) or TRUE)
    return Calibration(frame, dispersion, cosmology, SourceDensity())


#: Redshifts of so many times the typical error are another kind, and so many of them bear on the errors of a velocity.
_UNCERTAIN_RATIO, _UNCERTAIN_SHARE = 2.0, 0.02


def _describe_uncertain_redshifts(counts, typical_spread):
    """A note where some redshifts are much less certain than most, as photometric ones among spectroscopic ones."""
    class_counts = counts[:, 1:].sum(axis=1)
    class_errors = np.sqrt(counts[:, 0] / np.maximum(class_counts, 1.0))
    n_uncertain = int(class_counts[class_errors > _UNCERTAIN_RATIO * typical_spread].sum())
    if n_uncertain < _UNCERTAIN_SHARE * class_counts.sum():
        return []
    return [
        f"{n_uncertain} of {int(class_counts.sum())} redshifts have errors more than {_UNCERTAIN_RATIO:g} times the "
        "typical one, as photometric ones have: with galaxies as near as z = 0.002 the errors of a velocity are then "
        "up to 15 % too small (docs/validation.md). Leave those sources out where that matters (--where, field[mask])"
    ]


#: Edges of ln₁₀ of variances [(µas/yr)²], and the part of the sources below which half of all variance is of too few.
_LOG_VARIANCE_EDGES, _FEW_SHARE = np.linspace(-8, 18, 261), 0.02


def _describe_large_errors(counts):
    """A note where few sources have half of the variance, by whose mean sources of one redshift are weighted."""
    variances = counts * 10 ** _LOG_VARIANCE_EDGES[1:]
    variance_above = np.cumsum(variances[::-1])[::-1]
    cell = int(np.flatnonzero(variance_above >= variance_above[0] / 2)[-1])
    n_above = int(counts[cell:].sum())
    if n_above >= _FEW_SHARE * counts.sum():
        return []
    return [
        f"warning: {n_above} of {counts.sum()} sources, with errors above {10 ** (_LOG_VARIANCE_EDGES[cell] / 2):.2g} "
        "µas/yr, have half of the variance, by whose mean all sources of one redshift are weighted: leave them out "
        "(--where, field[mask])"
    ]


def calibrate_if_known(
    field: Field | Parts, redshift_frame: str | None, dispersion: float | None
) -> Calibration | None:
    """A calibration where the frame of redshifts is known; None where it is not, or redshifts are true ones."""
    sky = as_parts(field)
    frame = check_redshift_frame(redshift_frame or declared_frame(sky) or TRUE)
    if frame == TRUE:
        return None
    usable_sources = sky.map(partial(with_redshift, redshift_frame=frame))
    try:
        n_magnitudes, n_sources = usable_sources.sum(_count_magnitudes_and_sources, roles=DISTANCES, words="magnitudes")
    except EmptyFieldError:  # no source is beyond the flow
        return None
    dispersion = WHOLE_DISPERSION if dispersion is None else dispersion
    return calibrate(usable_sources, frame, dispersion, magnitudes=None if n_magnitudes == n_sources else False)


def _count_magnitudes_and_sources(field):
    return np.array([0 if field.magnitude is None else np.isfinite(field.magnitude).sum(), len(field)])


def _choose_density(density, magnitude_limit, sums, calibration):
    if callable(density):
        return SourceDensity(GivenDensity(density), "as given")
    if density == "volume":
        return SourceDensity()
    if density not in (None, "fitted"):
        raise ParameterError(f'a density is "volume", "fitted" or a function of distance, not {density!r}')
    # A catalogue that was cut in redshifts as observed lacks, next to its limits, sources of some directions.
    lower, upper, shift = min(sums["lowest seen"]), max(sums["highest seen"]), max(sums["shift"])
    inner_limits = (float(np.expm1(np.log1p(lower) + shift)), float(np.expm1(np.log1p(upper) - shift)))
    fitted_density = fit_density(sums["counts"], calibration.log_distance, calibration.limits, inner_limits)
    if magnitude_limit is None:
        return fitted_density
    return complete_density(fitted_density, calibration.luminosity, magnitude_limit, calibration.log_distance)


def declared_frame(field: Field | Parts) -> str | None:
    """The frame of the redshifts that a field, or the first of its parts, says; None where it says none."""
    sky = as_parts(field)
    first_field = next(iter(sky)) if sky.in_memory is None else sky.in_memory
    frame: str | None = first_field.redshift_frame
    return frame


def _sum_calibration_statistics(field, calibration):
    """Sums over some sources for the calibration of all."""
    z = calibration.redshift(field)
    spread = calibration.spread(field, z)
    modulus = distance_modulus(transverse_distance(z, calibration.cosmology), z)
    has_magnitude = np.zeros(len(field), bool) if field.magnitude is None else np.isfinite(field.magnitude)
    magnitudes = field.magnitude[has_magnitude] if has_magnitude.any() else np.empty(0)
    return {
        "n": len(field),
        "lowest": [z.min()],
        "highest": [z.max()],
        "lowest seen": [field.redshift.min()],
        "highest seen": [field.redshift.max()],
        "shift": [np.abs(np.log1p(z) - np.log1p(field.redshift)).max()],
        "lost": int(np.sum(spread > np.log1p(z))),
        "magnitudes": int(has_magnitude.sum()),
        "faintest": [magnitudes.max()] if has_magnitude.any() else [],
        "bright": count_absolute_magnitudes(magnitudes, modulus[has_magnitude]),
        "counts": count_redshifts_by_error(z, spread),
        "flow": flow_information(z, field.information),
        "variances": sum_variances_by_redshift(z, field.sigma),
        "sizes": np.histogram(np.log10(np.mean(field.sigma**2, 0)), _LOG_VARIANCE_EDGES)[0],
    }


def _count_bright_redshifts(field, calibration, limit):
    """Counts by redshift and error, as of `count_redshifts_by_error`, of the sources that are as bright as a limit."""
    z = calibration.redshift(field)
    is_bright = field.magnitude <= limit
    return count_redshifts_by_error(z[is_bright], calibration.spread(field, z)[is_bright])


def _check_redshift_errors(calibration, sums, dispersion):
    if 2 * sums["lost"] > sums["n"]:
        raise FieldError(
            f"the errors and peculiar velocities of redshifts ({dispersion:g} km/s) are larger than c z of "
            f"{sums['lost']} of {sums['n']} sources: their redshifts tell no distance. Take farther sources, or "
            "distances (distance=) that something else tells"
        )


def _select_far_counts(counts, spread, cosmology):
    """Counts of sources whose absolute magnitudes are not blurred by the errors of redshifts, where they are enough."""
    z = 10 * spread
    modulus = distance_modulus(transverse_distance(np.array([max(z, FLOW_LIMIT)]), cosmology)[0], z)
    far_counts = counts * (modulus <= MODULI)
    return far_counts if far_counts.sum() >= max(1000, 0.2 * counts.sum()) else counts
