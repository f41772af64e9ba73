"""Searches for a single gravitational wave: in coefficients of motions, and by frequency in along-scan positions.

2F is computed for every direction of a map, from whitened coefficients.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from fit.background import equations_of
from fit.in_time import TimeEquations, normal_equations, waves
from fit.normal import NormalEquations, eliminate
from fit.results.quality import SEEN, hint_of
from fit.results.solution import Solution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.length import length_limits
from vsh.models.waves import compute_strain, wave_templates
from vsh.modes import Modes, as_modes
from vsh.sky.frames import ANGLES, check_frame
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import generator
from vsh.tools.digits import format_p_value, format_simulated_p_value, is_reached_by_no_sky
from vsh.tools.errors import DegeneracyError, EmptyFieldError, ModesError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import merge_notes
from vsh.tools.types import Axes, AxesArray, BoolArray, FloatArray, OnAxes, Rng, Table
from vsh.tools.units import UAS
from vsh.vector import Vector


@dataclass(frozen=True, eq=False)
class WhitenedData(Frozen):
    """Equations with unit noise for some coefficients, with all other coefficients free."""

    kept: BoolArray
    root: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray, rhs: FloatArray, kept: BoolArray) -> WhitenedData:
        """Whiten normal equations."""
        try:
            reduced_matrix, reduced_rhs, _ = eliminate(matrix, rhs, kept, ~kept)
            root = cholesky(reduced_matrix)
        except np.linalg.LinAlgError:
            raise DegeneracyError(
                f"these sources do not determine {len(kept)} coefficients: lower lmax, or take more of the sky"
            ) from None
        return cls(kept, root, solve_triangular(root, reduced_rhs, trans="T"))


@lru_cache(maxsize=4)
def compute_wave_templates(lmax: int, nside: int) -> FloatArray:
    """Compute the coefficients of both polarisations for every pixel, (2, p, 12 nside²)."""
    templates = wave_templates(triad(*centres(nside))[2], lmax)
    templates.flags.writeable = False
    return templates


def fit_wave_by_direction(
    whitened: WhitenedData, modes: Modes, nside: int, n_phases: int = 1
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute 2F, best amplitudes (k, n) and their covariance (n, k, k) for every direction; k is twice `n_phases`."""
    whitened_templates, covariance = _compute_templates_and_covariance(whitened, modes, nside, n_phases)
    projections = np.tensordot(whitened.values, whitened_templates, axes=(0, 1))
    amplitudes = np.einsum("nij,jn->in", covariance, projections)
    return np.sum(projections * amplitudes, axis=0), amplitudes, covariance


def _compute_templates_and_covariance(whitened, modes, nside, n_phases):
    """Compute whitened templates (k, q, n) and the covariance of their amplitudes (n, k, k); k is twice `n_phases`."""
    phase_templates = compute_wave_templates(modes.lmax, nside)
    n_modes = len(modes)
    template_blocks = np.zeros((2 * n_phases, n_phases * n_modes, phase_templates.shape[2]))
    for phase in range(n_phases):
        template_blocks[2 * phase : 2 * phase + 2, phase * n_modes : (phase + 1) * n_modes] = phase_templates
    whitened_templates = np.tensordot(whitened.root, template_blocks[:, whitened.kept], axes=(1, 1)).transpose(1, 0, 2)
    return whitened_templates, np.linalg.inv(np.einsum("iqn,jqn->nij", whitened_templates, whitened_templates))


def compute_simulated_p_value(noise_maxima: FloatArray, observed_maximum: float) -> float:
    """Compute (1 + number of skies that reach `observed_maximum`)/(1 + number of skies)."""
    return (1 + int(np.sum(noise_maxima >= observed_maximum))) / (1 + len(noise_maxima))


def draw_maxima(data: WhitenedData, modes: Modes, nside: int, n_skies: int, rng: Rng, n_phases: int = 1) -> FloatArray:
    """Compute the largest 2F of each of `n_skies` simulated skies of noise."""
    whitened_templates, covariance = _compute_templates_and_covariance(data, modes, nside, n_phases)
    root = np.linalg.cholesky(covariance)
    unit_basis = np.einsum("nij,iqn->jnq", root, whitened_templates)  # 2F sums the squares of their products with noise
    rng, maxima = generator(rng), []
    for start in range(0, n_skies, 100):
        noise = rng.standard_normal((len(data.values), min(100, n_skies - start)))
        maxima.append(sum((component @ noise) ** 2 for component in unit_basis).max(axis=0))
    return np.concatenate(maxima)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveSearch(Result):
    """Result of a search for one wave over all directions.

    Attributes
    ----------
    statistic : (12 nside²,) array
        2F of each direction, in ring order: the decrease of χ² with the best wave. For noise alone it follows χ².
    amplitudes : (k, 12 nside²) array
        Best amplitudes of plus and cross; in a search in time those of cosine, then those of sine. [`unit`]
    limits : (12 nside²,) array
        95 % upper limit of the amplitude of a wave, for each direction. [`unit`]
    p_value : float
        Probability that noise alone gives as large a 2F somewhere on the sky, from `n_skies` simulated skies.
    n_skies : int
    degrees : tuple of int
        Degrees that were used.
    frame : str
        Frame of the axes.
    n_data : int
        Number of data that were fitted.
    frequency : float or None
        Frequency of a search in time. [1/yr]
    unit : str
        "µas/yr" for the rate of a strain; "µas" for a strain, in a search in time.
    notes : tuple of str
    """

    statistic: FloatArray
    amplitudes: FloatArray
    limits: FloatArray
    p_value: float
    n_skies: int
    degrees: tuple[int, ...]
    frame: str
    n_data: int
    frequency: float | None = None
    unit: str = "µas/yr"
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Check the frame and the shapes of the maps, which a file or a caller may have mixed up."""
        check_frame(self.frame)
        if self.amplitudes.shape[1:] != self.statistic.shape or self.limits.shape != self.statistic.shape:
            raise ParameterError("amplitudes and limits must have as many directions as statistic")
        super().__post_init__()

    def __repr__(self) -> str:
        return f"<WaveSearch: largest 2F {self.statistic.max():.3g}, p = {format_p_value(self.p_value)}>"

    @property
    def nside(self) -> int:
        """Resolution of the map."""
        return round(np.sqrt(len(self.statistic) / 12))

    @property
    def direction(self) -> tuple[float, float]:
        """Direction in which the best wave travels: longitude and latitude. [deg]"""
        lon, lat = (float(np.degrees(angle[np.argmax(self.statistic)])) for angle in centres(self.nside))
        return lon % 360, lat

    @property
    def vector(self) -> FloatArray:
        """Direction as a unit vector k, (3,)."""
        return triad(*np.radians(self.direction))[2]

    @property
    def amplitude(self) -> float:
        """Amplitude of the best wave, the root sum of squares of its components; biased high by noise. [`unit`]"""
        return float(np.linalg.norm(self.amplitudes[:, np.argmax(self.statistic)]))

    def strain(self, frequency: float | None = None) -> float:
        """Compute the strain of the best wave.

        Parameters
        ----------
        frequency : float, optional
            Frequency of a wave whose period is longer than the observations, of which only the rate is measured. [nHz]

        Raises
        ------
        ParameterError
            If no frequency is given, and none is known.
        """
        return float(self._convert_to_strains(np.array(self.amplitude), frequency))

    def strain_limits(self, frequency: float | None = None) -> FloatArray:
        """Compute the 95 % limit of the strain for each direction, (12 nside²,), at a `frequency` as for `strain`.

        Raises
        ------
        ParameterError
            If no frequency is given, and none is known.
        """
        return self._convert_to_strains(self.limits, frequency)

    def _convert_to_strains(self, amplitudes, frequency):
        if self.unit == "µas":
            return amplitudes * UAS
        if frequency is None:
            raise ParameterError("only the rate of the strain is measured: give a frequency in nHz, strain(frequency)")
        return compute_strain(amplitudes, frequency)

    def _sections(self, long):
        lon, lat = self.direction
        vector = Vector.from_spherical(1.0, lon, lat, frame=self.frame)
        direction_texts = []
        for frame in dict.fromkeys((self.frame, "galactic")):
            direction = vector.to_frame(frame).direction
            direction_texts.append(
                ", ".join(f"{name} = {value:.1f}°" for name, value in zip(ANGLES[frame], direction, strict=True))
            )
        best = self.amplitudes[:, np.argmax(self.statistic)]
        labels = ("plus", "cross") if len(best) == 2 else ("plus cos", "cross cos", "plus sin", "cross sin")
        amplitudes_text = ", ".join(f"{label} {value:+.4g}" for label, value in zip(labels, best, strict=True))
        lower, median, upper = np.quantile(self.limits, [0, 0.5, 1])
        strain_text = f"{compute_strain(median, 1.0):.3g} (1 nHz/f)"
        if self.unit == "µas":
            strain_text = f"{float(self._convert_to_strains(np.array(median), None)):.3g}"
        of_all = f"{self.statistic.max():.2f} of {len(self.statistic)} directions"
        p_text = format_simulated_p_value(self.p_value, self.n_skies)
        period_text = f"at {self.frequency:.4g} per year" if self.frequency else "longer than the observations"
        median_text = f"median {median:.4g}, a strain of {strain_text}"
        facts = [
            ("data", f"degrees {self.degrees[0]} to {self.degrees[-1]} of {self.n_data} numbers"),
            ("largest 2F", f"{of_all}; noise alone gives χ² with {len(self.amplitudes)} degrees of freedom in each"),
            ("p-value", f"{p_text} for as large a 2F anywhere from noise alone ({self.n_skies} simulated skies)"),
            ("travels to", "; ".join(direction_texts)),
            ("best wave", f"{amplitudes_text} {self.unit}"),
            ("95 % limits", f"{lower:.4g} … {upper:.4g} {self.unit} by direction, {median_text}"),
        ]
        return (Section(f"One gravitational wave, {period_text}", facts, notes=self.notes),)

    def to_table(self) -> Table:
        """Return an astropy Table with one row for each direction."""
        lon, lat = centres(self.nside)
        columns = {"lon": np.degrees(lon) % 360, "lat": np.degrees(lat)}
        columns |= {"statistic": self.statistic, "limit": self.limits}
        columns |= {f"amplitude_{i}": amplitude for i, amplitude in enumerate(self.amplitudes)}
        return tables.table_of(columns, self._plain_facts() | {"ORDERING": "RING"}, {"lon": "deg", "lat": "deg"})

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Plot maps of 2F and of the limits on matplotlib axes."""
        from fit.waves._plot import plot_search

        return plot_search(self, ax=ax)


@arguments.accepts(nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
def search(
    normal: NormalEquations | Solution,
    *,
    degrees: Iterable[int] | None = None,
    nside: int = 16,
    n_skies: int = 1000,
    rng: Rng = 1,
) -> WaveSearch:
    """Search every direction for one plane gravitational wave of a period much longer than the observations.

    Parameters
    ----------
    normal : NormalEquations or Solution
        Normal equations, or a fit, to degree 2 at least. Their errors are used unchanged: if the residuals contradict
        the errors of the catalogue, give a robust solution or `solution.scaled`. Degree 1 is fitted freely.
    degrees : iterable of int, optional
        Degrees in which waves are searched for (default: all fitted degrees ≥ 2). Fitted degrees not listed here are
        fitted freely.
    nside : int
        Resolution of the HEALPix map of directions; a map of nside 16 has 3072 directions.
    n_skies : int
        Simulated skies of noise, for the p-value.
    rng : Generator or int
        The source of their noise.

    Raises
    ------
    ModesError
        If `degrees` includes degree 1, or a degree that is not fitted.
    DegeneracyError
        If the data do not determine the coefficients.

    Notes
    -----
    2F = gᵀF⁻¹g is computed from the coefficients of `degrees`, with all others free. It is the F-statistic of pulsar
    timing (Babak & Sesana 2012, PRD 85, 044034). For noise alone, 2F in any fixed direction follows χ² with two degrees
    of freedom. A wave close to the limit of detection is located to within about 30°, up to the symmetry of the
    response, because low degrees do not have a better resolution. Systematic errors, like any field of low degree, look
    like waves: check first how large they are with `fit.background.floor`.
    """
    equations = equations_of(normal)
    modes = equations.modes
    search_degrees = tuple(sorted(set(degrees))) if degrees is not None else tuple(range(2, modes.lmax + 1))
    if not search_degrees or search_degrees[0] < 2 or search_degrees[-1] > modes.lmax:
        raise ModesError(f"waves need degrees from 2 on, up to the fitted {modes.lmax}, not {search_degrees or 'none'}")
    whitened = WhitenedData.of(equations.matrix, equations.rhs, np.isin(modes.degrees, search_degrees))
    attributes = {"degrees": search_degrees, "frame": equations.frame or "icrs", "n_data": equations.n_data}
    return _search_sky_and_noise(whitened, modes, nside, n_skies, rng, notes=equations.notes, **attributes)[0]


def _search_sky_and_noise(whitened, modes, nside, n_skies, rng, n_phases=1, **attributes):
    """Search all directions; return the search, and the largest 2F of each sky of noise."""
    statistic, amplitudes, covariance = fit_wave_by_direction(whitened, modes, nside, n_phases)
    noise_maxima = draw_maxima(whitened, modes, nside, n_skies, rng, n_phases)
    attributes |= {"p_value": compute_simulated_p_value(noise_maxima, statistic.max()), "n_skies": n_skies}
    limits = length_limits(amplitudes.T, covariance)
    return WaveSearch(statistic=statistic, amplitudes=amplitudes, limits=limits, **attributes), noise_maxima


#: Notes of searches in time: for an attitude that is known, and for one that was solved from the same sky.
KNOWN_ATTITUDE = (
    "warning: amplitudes and limits assume an attitude that is known from elsewhere; if it was solved from the"
    " same sky, as in Gaia's releases, 0.6 to 0.7 of a wave remains, and a 95 % limit is 0.7 of the true one: give a "
    "sim.agis.Response"
)
SOLVED_ATTITUDE = (
    "what an attitude solved from the same sky absorbs of each wave is allowed for; a rotation that changes with "
    "time is not measured"
)

#: Number of frequencies that a short report lists.
_LISTED = 8


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveSpectrum(Result):
    """Searches for one wave at many frequencies.

    Attributes
    ----------
    frequencies : (n,) array
        [1/yr]
    statistic : (n,) array
        The largest 2F over all directions.
    lon, lat : (n,) arrays
        Direction in which the best wave of each frequency travels. [rad]
    amplitudes : (n,) array
        Amplitude of the best wave of each frequency; biased high by noise. [µas]
    limits : (n, 3) array
        Smallest, median and largest 95 % limit over the directions. [µas]
    p_values : (n,) array
        p-value of each frequency by itself.
    p_value : float
        Probability that noise alone gives as large a 2F anywhere on the sky at any of these frequencies.
    lost : (n,) int array
        Number of combinations of coefficients that the sources' own parameters absorb, as parallaxes do at 1/yr.
    n_skies : int
    n_data : int
    degrees : tuple of int
    frame : str
    notes : tuple of str
    """

    frequencies: FloatArray
    statistic: FloatArray
    lon: FloatArray
    lat: FloatArray
    amplitudes: FloatArray
    limits: FloatArray
    p_values: FloatArray
    p_value: float
    lost: FloatArray
    n_skies: int
    n_data: int
    degrees: tuple[int, ...]
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<WaveSpectrum: {len(self.frequencies)} frequencies, p = {format_p_value(self.p_value)}>"

    @property
    def strain_limits(self) -> FloatArray:
        """`limits` as strains, (n, 3)."""
        return self.limits * UAS

    @property
    def answer(self) -> Answer:
        """The lines to quote: whether a wave is detected, and how strong one can be."""
        best_index = int(np.argmax(self.statistic))
        p_text = format_simulated_p_value(self.p_value, self.n_skies)
        is_detected, is_above_all_skies = self.p_value < SEEN, is_reached_by_no_sky(self.p_value, self.n_skies)
        verdict = "detected" if is_detected else "not decided" if is_above_all_skies else "not detected"
        text = f"{verdict} in a search of {len(self.frequencies)} frequencies, p = {p_text} for all of them together"
        if is_detected:
            text += f"; the largest at {self.frequencies[best_index]:.4g} per year"
        elif is_above_all_skies:
            text += f": more than on all {self.n_skies} simulated skies; {round(1 / SEEN)} are needed (--skies)"
        elif hint := hint_of(self.p_value):
            text += f" ({hint})"
        medians = self.strain_limits[:, 1]
        lower, upper = (f"{value:.2g}" for value in (medians.min(), medians.max()))
        limits_text = f"< {lower} to {upper} (95 %, median of directions, by frequency)"
        if is_detected:
            strain, frequency = self.amplitudes[best_index] * UAS, self.frequencies[best_index]
            limits_text = f"{strain:.2g} at {frequency:.4g} per year, as fitted; where there is no wave {limits_text}"
        return Answer((("wave", text), ("strain", limits_text)))

    def _sections(self, long):
        best_index = int(np.argmax(self.statistic))
        lon, lat = np.degrees(self.lon[best_index]) % 360, np.degrees(self.lat[best_index])
        best_text = f"at {self.frequencies[best_index]:.4g} per year, towards α = {lon:.1f}°, δ = {lat:.1f}°"
        p_text = format_simulated_p_value(self.p_value, self.n_skies)
        facts = [
            ("data", f"degrees {self.degrees[0]} to {self.degrees[-1]} of {self.n_data} numbers"),
            ("largest 2F", f"{self.statistic[best_index]:.2f} {best_text}"),
            ("p-value", f"{p_text} for all directions and frequencies together ({self.n_skies} simulated skies)"),
        ]
        table = self.to_table()
        table["strain"] = self.limits[:, 1] * UAS
        best_rows = np.sort(np.argsort(self.p_values, kind="stable")[:_LISTED])
        rows = None if long else best_rows.tolist()
        count = len(self.frequencies)
        remarks = [f"The {_LISTED} of {count} frequencies with the smallest p-values."] * (not long and count > _LISTED)
        columns = ("frequency", "statistic", "p_value", "limit_median", "limit_low", "limit_high", "strain")
        forms = dict.fromkeys(columns[3:6], ".3g") | {"statistic": ".2f", "strain": ".2e"}
        remarks.append(
            "Limits are 95 % upper limits: median and extremes over directions [µas]. p-values are for one frequency "
            "alone."
        )
        title = f"One gravitational wave at {count} frequencies"
        return (Section(title, facts, table, columns, rows, forms, remarks, self.notes),)

    def to_table(self) -> Table:
        """Return an astropy Table with one row for each frequency."""
        columns = {"frequency": self.frequencies, "statistic": self.statistic, "p_value": self.p_values}
        columns |= {"lon": np.degrees(self.lon) % 360, "lat": np.degrees(self.lat), "amplitude": self.amplitudes}
        columns |= {f"limit_{name}": row for name, row in zip(("low", "median", "high"), self.limits.T, strict=True)}
        columns["lost"] = self.lost
        return tables.table_of(columns, self._plain_facts(), {"lon": "deg", "lat": "deg", "frequency": "1 / yr"})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Plot limits on the strain against frequency on matplotlib axes."""
        from fit.waves._plot import plot_spectrum

        return plot_spectrum(self, ax=ax)


@arguments.accepts(nside=arguments.whole, n_skies=arguments.whole, rng=arguments.seed)
def search_in_time(
    observations: Any,
    frequency: float | Sequence[float],
    *,
    attitude: Any = None,
    lmax: int = 5,
    nside: int = 8,
    n_skies: int = 1000,
    rng: Rng = 1,
    threads: int | None = None,
) -> Any:
    """Search along-scan positions for one gravitational wave of a period shorter than the mission.

    Five parameters of each source are fitted freely, and so are a rotation and a glide of the frame that oscillate at
    the frequency. What remains is compared with a wave from every direction, with two polarisations and with cosine and
    sine of time.

    Parameters
    ----------
    observations : Observations, path, or an iterable of them
        Observations as `vsh.io.epochs.read_observations` returns them; see `fit.in_time.normal_equations`.
    frequency : float or sequence of float
        Frequency of the wave, or several frequencies to search. Below about one cycle in the time span of the
        observations, the positions and motions of the sources absorb the whole wave. [1/yr]
    attitude : sim.agis.Response, or "known"
        How much of a wave the attitude absorbs, if the attitude was solved from the same sky, as in Gaia's releases;
        "known" if it is known from elsewhere. This argument is required.
    lmax : int
        The highest degree; a wave has 99 % of its power in degrees up to 5.
    nside : int
        Resolution of the HEALPix map of directions.
    n_skies : int
        Simulated skies of noise, for the p-value.
    rng : Generator or int
        The source of their noise.
    threads : int, optional
        Number of threads; one per core unless given.

    Returns
    -------
    WaveSearch or WaveSpectrum
        For one frequency, a WaveSearch with the amplitudes of the strain: plus and cross of cosine, then of sine [µas;
        1 µas is a strain of 4.8e-12]. For several frequencies, a WaveSpectrum with limits at each of them and one
        p-value for all.

    Raises
    ------
    DegeneracyError
        If the observations determine no wave of this frequency.
    ParameterError
        If `observations` are not observations, a frequency is not above zero, or `attitude` is missing.

    Notes
    -----
    The response is that of a wave much shorter than the distances of the sources (Book & Flanagan 2011), and much
    longer than the time from one field of view to the other. For noise alone, 2F in any fixed direction follows χ²
    with four degrees of freedom. The p-value is for all directions. For several frequencies, noise is taken as
    independent from one frequency to the next. This is true if they are 1/T apart, and conservative if they are closer.

    An attitude that was solved from the same sky, as in Gaia's releases, absorbs a part of the wave. If such an
    attitude is treated as known, 0.59 to 0.68 of the amplitude of simulated waves is recovered, and the nominal 95 %
    limit is 0.7 of the true one. With a Response of nside 8 the recovered fraction is 0.96, of nside 16 it is 0.98.
    """
    has_several = np.ndim(frequency) > 0
    frequencies = [arguments.positive("frequency", value) for value in np.atleast_1d(frequency)]
    modes = as_modes(lmax)
    if modes.lmax < 2:
        raise ParameterError("waves have degrees from 2 on: lmax must be at least 2")
    rng = arguments.generator(rng)
    searches, noise_maxima_by_frequency, n_lost_by_frequency = [], [], []
    for wave_frequency in frequencies:
        try:
            equations = normal_equations(observations, modes, waves(wave_frequency), attitude=attitude, threads=threads)
        except EmptyFieldError as error:
            raise DegeneracyError(str(error)) from None
        frequency_search, noise_maxima, n_lost = _search_frequency(equations, wave_frequency, nside, n_skies, rng)
        searches.append(frequency_search)
        noise_maxima_by_frequency.append(noise_maxima)
        n_lost_by_frequency.append(n_lost)
    if not has_several:
        return searches[0]
    best_pixels = np.array([np.argmax(wave_search.statistic) for wave_search in searches])
    largest_statistics = np.array([wave_search.statistic.max() for wave_search in searches])
    lon, lat = centres(nside)
    return WaveSpectrum(
        frequencies=np.array(frequencies),
        statistic=largest_statistics,
        lon=lon[best_pixels],
        lat=lat[best_pixels],
        amplitudes=np.array([wave_search.amplitude for wave_search in searches]),
        limits=np.array([np.quantile(wave_search.limits, [0, 0.5, 1]) for wave_search in searches]),
        p_values=np.array([wave_search.p_value for wave_search in searches]),
        p_value=compute_simulated_p_value(np.max(noise_maxima_by_frequency, axis=0), largest_statistics.max()),
        lost=np.array(n_lost_by_frequency),
        n_skies=n_skies,
        n_data=searches[0].n_data,
        degrees=searches[0].degrees,
        notes=merge_notes(*(wave_search.notes for wave_search in searches)),
    )


def _search_frequency(equations: TimeEquations, frequency, nside, n_skies, rng):
    """Search one frequency; return the search, the largest 2F of each sky of noise, and the number lost."""
    modes, is_unconstrained = equations.modes, equations.unconstrained_terms
    unknowns, eigenvalues, eigenvectors, is_determined = equations.combinations()
    if eigenvalues[-1] <= 0 or is_determined.sum() < len(unknowns) / 2:
        raise DegeneracyError(
            f"these sources do not determine {len(unknowns)} coefficients: lower lmax, or take more of the sky"
        )
    diagonal = np.diag(equations.matrix)
    # A rotation is indistinguishable from attitude: any prior will do.
    matrix = equations.matrix + np.diag(np.where(is_unconstrained, np.median(diagonal), 1e-9 * diagonal))
    whitened = WhitenedData.of(matrix, equations.rhs, np.tile(modes.degrees >= 2, 2))
    notes = (*equations.notes, SOLVED_ATTITUDE if equations.attitude != "known" else KNOWN_ATTITUDE)
    lost_indices = np.flatnonzero(~is_determined)
    if len(lost_indices):
        examples = "; ".join(equations.named(unknowns, eigenvectors[:, i], 2) for i in lost_indices[:3])
        notes = (
            *notes,
            f"at {frequency:.4g} per year {len(lost_indices)} of {len(unknowns)} combinations are absorbed by the "
            f"sources' own parallaxes, positions and motions: {examples}{'; …' if len(lost_indices) > 3 else ''}",
        )
    about = {"degrees": tuple(range(2, modes.lmax + 1)), "frame": "icrs", "n_data": equations.n_data, "unit": "µas"}
    about |= {"frequency": float(frequency), "notes": notes}
    wave_search, noise_maxima = _search_sky_and_noise(whitened, modes, nside, n_skies, rng, 2, **about)
    return wave_search, noise_maxima, len(lost_indices)
