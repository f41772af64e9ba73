"""The floor: errors of spin and acceleration that more sources do not remove."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from scipy.special import softmax

from fit.background._amplitude import compute_posteriors_and_evidence
from fit.background._likelihood import (
    Likelihood,
    check_degrees,
    compute_parity_p_value,
    equations_of,
    find_error_source,
    format_degrees,
    should_fit_scale,
)
from fit.normal import NormalEquations, gaussian_prior
from fit.results.output import square_of
from fit.results.quality import ErrorSource
from fit.results.solution import Solution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Section
from vsh.models.covariance import LINDEGREN_2021, LINDEGREN_2021_PARALLAX, ScalarSpectrum, Spectrum
from vsh.modes import Modes
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError
from vsh.tools.printing import log_calls
from vsh.tools.types import ArrayLike, Axes, FloatArray, Table

_PUBLISHED_COVARIANCES: Any = ((Spectrum, LINDEGREN_2021), (ScalarSpectrum, LINDEGREN_2021_PARALLAX))
#: Spectra of the systematic errors by name: one power for each mode, what Gaia EDR3's astrometry was published with
#: (Lindegren et al. 2021), and l⁻², which rises towards degree 1 more steeply than either.
SHAPES: dict[str, Spectrum]
SCALAR_SHAPES: dict[str, ScalarSpectrum]
SHAPES, SCALAR_SHAPES = (
    {
        "flat": kind.flat(),
        "gaia": kind.from_covariance(published, "Gaia's, Lindegren et al. 2021"),
        "steep": kind.of_modes(lambda l: np.maximum(l, 1.0) ** -2, "l⁻² for each mode"),
    }
    for kind, published in _PUBLISHED_COVARIANCES
)


#: Prior odds of the spectra. Both published spectra of Gaia's astrometry rise towards low degrees, and with odds of 3
#: intervals cover on them (91 % with even odds). Of a steeper one nothing is published; with odds of a half, intervals
#: cover where the power falls by 7 from degree 1 to 5, and errors grow by 5 % where nothing is systematic.
_PRIOR_ODDS = {"gaia": 3.0, "steep": 0.5}


#: Up to this degree the steepest spectrum is among the usual ones.
_HIGHEST_WITH_STEEP = 12


def list_shapes(highest_degree: int) -> tuple[str, ...]:
    """Default spectra to average over: degrees beyond 12 determine the slope, so that "steep" is left out."""
    return tuple(SHAPES) if highest_degree <= _HIGHEST_WITH_STEEP else ("flat", "gaia")


def compute_shape_probabilities(shape_names: Sequence[str], log_evidences: ArrayLike) -> FloatArray:
    """The probability of each spectrum, by its evidence and its prior odds."""
    return softmax(np.asarray(log_evidences) + np.log([_PRIOR_ODDS.get(name, 1.0) for name in shape_names]))


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class FloorOfKind(Result):
    """Base of the floors of vector and of scalar fields: an average over spectra, and what it does to a fit."""

    degrees: tuple[int, ...]
    noise_scale: float
    log_likelihood: float
    n_data: int
    errors_from: str = "the catalogue"
    shape: str = "flat"
    mean: tuple[float, ...] | None = None
    parts: tuple[Any, ...] = ()
    probability: tuple[float, ...] = ()
    error_source: ErrorSource = ErrorSource.CATALOGUE
    unit: str = "µas/yr"

    #: What of the low degrees has an error by the floor, and the fields with the powers, and with their intervals.
    _parameter_names: ClassVar[tuple[str, str]]
    _power_names: ClassVar[tuple[str, ...]]
    _spectra_by_shape: ClassVar[dict[str, Any]]
    _single_shape_remark: ClassVar[str] = ""

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._spell()}, from degrees {format_degrees(self.degrees)}>"

    @property
    def errors(self) -> dict[str, float]:
        """The floor in each component of what stands in the low degrees, by its name. [`unit`]"""
        spectra = [part._make_spectrum(*part.mean) if part.mean else part.spectrum for part in self._shape_floors]
        weights = self.probability or (1.0,)  # the variance of a mixture is the mean of those of the shapes
        return {
            name: float(np.sqrt(np.dot(weights, [getattr(spectrum, f"{name}_error") ** 2 for spectrum in spectra])))
            for name in self._parameter_names
        }

    @property
    def powers(self) -> dict[str, tuple[float, float, float]]:
        """Power of each mode with the ends of its 68 % interval, by parity. [square of `unit`]"""
        return {name: (getattr(self, name), *getattr(self, f"{name}_interval")) for name in self._power_names}

    @property
    def spectrum(self) -> Any:
        """Estimated spectrum with the median powers; of several shapes the most probable."""
        if self.parts:
            return self.parts[int(np.argmax(self.probability))].spectrum
        return self._make_spectrum(*(value for value, *_ in self.powers.values()))

    def _make_spectrum(self, *powers):
        """The spectrum with some powers, in the shape of this floor."""
        raise NotImplementedError

    @property
    def _shape_floors(self):
        return self.parts or (self,)

    def _spell(self, digits=3):
        """The errors as a reader sees them: "spin ± 1.23, acceleration ± 0.8 µas/yr"."""
        errors = ", ".join(f"{name} ± {error:.{digits}g}" for name, error in self.errors.items())
        return f"{errors} {self.unit}".rstrip()

    def _sections(self, long):
        n_sources = self.n_data // self._spectra_by_shape["flat"].mode_class.components
        gain_phrase = f"ln L exceeds that without systematic errors by {self.log_likelihood:.2f}"
        facts = [("estimated from", f"the power of degrees {format_degrees(self.degrees)} of {n_sources} sources")]
        facts.append(self._make_likelihood_fact(gain_phrase))
        facts += [
            (f"spectrum {part.shape}", f"{100 * p:.0f} %: {part._spell()}")
            for part, p in zip(self.parts, self.probability, strict=True)
        ]
        if self.noise_scale != 1:
            facts.append(("errors", f"the catalogue's, scaled by {self.noise_scale:.4f} in the same fit"))
        remark = (
            f"The powers (median, ends of the 68 % interval) are those of the {self.shape} spectrum; the floor is the "
            "posterior mean, averaged over all spectra with their probabilities as weights."
            if self.parts
            else self._single_shape_remark
        )
        return (Section("Systematic floor", facts, self.to_table(), remarks=[remark]),)

    def _make_likelihood_fact(self, gain_phrase):
        """Line of the report on the likelihood."""
        return ("likelihood", gain_phrase)

    def to_table(self) -> Table:
        """A row for each power as an astropy Table."""
        powers = list(self.powers.values()) * (len(self.errors) // len(self.powers))
        rows = [(name, *power, error) for (name, error), power in zip(self.errors.items(), powers, strict=True)]
        power_columns = ("power", "power_low", "power_high")
        units = dict.fromkeys(power_columns, square_of(self.unit)) | {"floor": self.unit}
        return tables.table_of_rows(("parameter", *power_columns, "floor"), rows, self._make_table_metadata(), units)

    def _make_table_metadata(self):
        return {}

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The powers with their intervals on matplotlib axes."""
        from fit.background._plot import plot_floor

        return plot_floor(self, ax=ax)

    def prior(self, modes: Modes) -> NormalEquations:
        """The prior on the degrees that it was estimated from, among `modes`, as normal equations without data.

        Raises
        ------
        ModesError
            If it was estimated from degrees that are not fitted.
        """
        if max(self.degrees) > modes.lmax:
            raise ModesError(
                f"the floor was estimated from degrees {format_degrees(self.degrees)}, and these normal equations go "
                f"to {modes.lmax}"
            )
        variances = self.spectrum.variances(modes)
        variances[~np.isin(modes.degrees, self.degrees)] = np.inf
        return gaussian_prior(modes, np.sqrt(variances))

    def added(self, modes: Modes) -> FloatArray:
        """Addition to the variances of the coefficients of low degrees among `modes`, zero for the others, (p,)."""
        raise NotImplementedError

    def allowed_for(self, solve: Callable[[NormalEquations], Any], normal: NormalEquations) -> Any:
        """The solution with this prior on the higher degrees, and with the floor in the errors of degree 1.

        Parameters
        ----------
        solve : function
            From normal equations to their solution.
        normal : NormalEquations
            Normal equations of the data.
        """
        if self.parts:
            return self._average_over_shapes(solve, normal)
        modes, tau = normal.modes, self.noise_scale**2
        data = equations_of(normal, scalars=True)
        scaled_data = replace(data, matrix=data.matrix / tau, rhs=data.rhs / tau, chi2_null=data.chi2_null / tau)
        prior = self.prior(modes) if normal.prior is None else self.prior(modes) + normal.prior
        solution = solve(scaled_data + prior)
        covariance = solution.covariance + np.diag(self.added(modes))
        note = (
            f"the floor is a prior that shrinks the coefficients of degrees {format_degrees(self.degrees)}; their "
            "powers and p-values are from the fit without it"
        )
        try:
            plain = solve(normal)
            formal = plain.covariance
            plain = replace(plain, covariance=plain.covariance * tau)
        except DegeneracyError:  # that the prior alone mends
            plain = formal = None
        changes = {"without_prior": plain, "formal_covariance": formal, "notes": (*solution.notes, note)}
        return self._attach_floor(solution, covariance, chi2=solution.chi2 * tau, **changes)

    def _average_over_shapes(self, solve, normal):
        """The mean over the shapes, its covariance with their scatter."""
        solutions = [shape_floor.allowed_for(solve, normal) for shape_floor in self.parts]
        weights = np.array(self.probability)
        values = np.array([solution.coefficients.values for solution in solutions])
        mean = weights @ values
        deviations = values - mean
        covariance = np.tensordot(weights, [solution.covariance for solution in solutions], 1)
        covariance = covariance + np.einsum("s,si,sj->ij", weights, deviations, deviations)
        best_solution = solutions[int(np.argmax(weights))]
        shares = ", ".join(
            f"{shape_floor.shape} {100 * p:.0f} %" for shape_floor, p in zip(self.parts, weights, strict=True)
        )
        coefficients = replace(best_solution.coefficients, values=mean)
        return self._attach_floor(best_solution, covariance, f" (spectra: {shares})", coefficients=coefficients)

    def _attach_floor(self, solution, covariance, spectra_phrase="", **changes):
        """A solution with a covariance that has this floor in it, and what is to be said of that."""
        scale = "" if self.noise_scale == 1 else f" times {self.noise_scale:.4g}"
        degrees = f"degrees {format_degrees(self.degrees)}{spectra_phrase}"
        text = f"{self.errors_from}{scale}, with the systematic floor from {degrees}: {self._spell()} in each component"
        # Those of the catalogue are scaled already.
        error_source = ErrorSource.SCALED if self.error_source == ErrorSource.CATALOGUE else self.error_source
        changes |= {"errors_from": text, "error_source": error_source, "includes_floor": True, "floor": self}
        return replace(solution, covariance=covariance, **changes)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Floor(FloorOfKind):
    """Systematic floor: the power of the higher degrees, and the error that it implies for degree 1.

    Attributes
    ----------
    odd, even : float
        Power of each mode in the fields of a spin's parity (T of odd degrees, S of even ones) and of a glide's: the
        median of its posterior. [(µas/yr)²]
    odd_interval, even_interval : tuple of two floats
        68 % intervals: the likeliest values, from zero where zero is likely.
    parity_p_value : float
        Probability of as large a difference of the two where there is none, by the likelihood ratio.
    degrees : tuple of int
        Which they were estimated from.
    noise_scale : float
        Factor on the catalogue's errors that was estimated with them; 1 where the errors are not the catalogue's.
    log_likelihood : float
        By how much ln L is larger than without systematics.
    n_data : int
        How many numbers were fitted.
    errors_from : str
        Where the errors that were used come from, in words.
    shape : str
        Spectrum: "flat" for one power of each mode, "gaia" for that of Lindegren et al. (2021), "steep" for l⁻².
    mean : tuple of two floats, or None
        Posterior means of the two powers, of the parity of a spin and of a glide, for each part of an average over
        shapes: the errors of degree 1 follow from these, because the variance of a mixture is the mean of the
        variances. None for a single shape, where they follow from the medians.
    parts, probability : tuple of Floor, tuple of float
        Where several shapes were averaged, the floor for each and its probability; `odd`, `even` and their intervals
        are those of the first then, and what is implied for degree 1 is the mean over all.
    error_source : ErrorSource
        Where those errors come from, as one of a few.
    unit : str
        That of the errors.
    """

    odd: float
    even: float
    odd_interval: tuple[float, float]
    even_interval: tuple[float, float]
    parity_p_value: float

    _parameter_names = ("spin", "acceleration")
    _power_names = ("odd", "even")
    _spectra_by_shape = SHAPES
    _single_shape_remark = (
        "A spectrum that rises towards degree 1, as the published one of Gaia EDR3 does, makes the floor too small: "
        "true errors are then 1.2, 1.5, 1.8 times those with the floor from degree 3, 7, 10."
    )

    @property
    def spin_error(self) -> float:
        """Floor of the spin in each component, for one shape √(3 s/8π). [µas/yr]"""
        return self.errors["spin"]

    @property
    def acceleration_error(self) -> float:
        """Floor of the acceleration in each component, for one shape √(3 s/8π). [µas/yr]"""
        return self.errors["acceleration"]

    @property
    def spin_interval(self) -> tuple[float, float]:
        """68 % interval of the floor of the spin; an average over shapes, of mean powers, may be above. [µas/yr]"""
        return self._average_interval("odd", "spin_error")

    @property
    def acceleration_interval(self) -> tuple[float, float]:
        """The likeliest 68 % of the acceleration's floor; an average, of the mean power, may lie above. [µas/yr]"""
        return self._average_interval("even", "acceleration_error")

    @property
    def bands(self) -> list[tuple[str, int, float, float]]:
        """The likeliest 68 % of the power of degree 1 of either kind: kind, degree, and both ends. [(µas/yr)²]"""
        # Power of a vector v is 8π v²/3, of three components.
        pairs = (("T", self.spin_interval), ("S", self.acceleration_interval))
        return [(kind, 1, *(8 * np.pi * np.square(interval)).tolist()) for kind, interval in pairs]

    def _average_interval(self, parity, error_name):
        """Ends of the 68 % intervals of the shapes, as degree 1 has them, averaged by probability."""
        ends = []
        for shape_floor in self._shape_floors:
            unit_error = getattr(shape_floor._make_spectrum(1.0, 1.0), error_name)
            ends.append([unit_error * np.sqrt(end) for end in getattr(shape_floor, f"{parity}_interval")])
        lower, upper = np.asarray(self.probability or (1.0,)) @ np.array(ends)
        return float(lower), float(upper)

    def _make_spectrum(self, odd, even):
        shape = SHAPES[self.shape]
        return odd * shape.only("odd") + even * shape.only("even")

    def _make_likelihood_fact(self, gain_phrase):
        return ("parities", f"p = {self.parity_p_value:.3g} that both parities have equal power ({gain_phrase})")

    def _make_table_metadata(self):
        return {"parity_p_value": self.parity_p_value}

    def added(self, modes: Modes) -> FloatArray:
        """Addition to the variances of the coefficients of degree 1 among `modes`, zero for the others, (p,)."""
        odd, even, errors = Spectrum.odd(), Spectrum.even(), self.errors
        spin_scale, glide_scale = errors["spin"] / odd.spin_error, errors["acceleration"] / even.acceleration_error
        return np.where(modes.degrees == 1, (spin_scale**2 * odd + glide_scale**2 * even).variances(modes), 0.0)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ScalarFloor(FloorOfKind):
    """Systematic floor of a scalar field, parallaxes say: the errors that it implies for the mean and the dipole.

    Attributes
    ----------
    power : float
        Power of each mode: the median of its posterior. [square of `unit`]
    power_interval : tuple of two floats
        68 % interval.
    mean : tuple of a float, or None
        Posterior mean of the power for each part of an average over shapes; None for a single shape.
    degrees, noise_scale, log_likelihood, n_data, errors_from, shape, parts, probability, error_source, unit
        As in `Floor`.
    """

    power: float
    power_interval: tuple[float, float]

    _parameter_names = ("dipole", "mean")
    _power_names = ("power",)
    _spectra_by_shape = SCALAR_SHAPES

    @property
    def mean_error(self) -> float:
        """Floor of the mean over the sky. [`unit`]"""
        return self.errors["mean"]

    @property
    def dipole_error(self) -> float:
        """Floor of the dipole in each component. [`unit`]"""
        return self.errors["dipole"]

    @property
    def bands(self) -> list[tuple[str, int, float, float]]:
        """The likeliest 68 % of the power of degrees 0 and 1: kind, degree, and both ends. [square of `unit`]"""
        powers = [np.outer(part.power_interval, SCALAR_SHAPES[part.shape].power(1)[0]) for part in self._shape_floors]
        ends = np.tensordot(self.probability or (1.0,), powers, 1)
        return [("F", l, float(ends[0, l]), float(ends[1, l])) for l in (0, 1)]

    def _make_spectrum(self, power):
        return power * SCALAR_SHAPES[self.shape]

    def added(self, modes: Modes) -> FloatArray:
        """Addition to the variances of the coefficients of degrees 0 and 1 among `modes`, zero for others, (p,)."""
        flat, errors = ScalarSpectrum.flat(), self.errors
        mean_scale, dipole_scale = errors["mean"] / flat.mean_error, errors["dipole"] / flat.dipole_error
        return np.select([modes.degrees == 0, modes.degrees == 1], [mean_scale**2, dipole_scale**2 / modes.norm2], 0.0)


@log_calls("floor")
def floor(
    normal: NormalEquations | Solution,
    degrees: Iterable[int] | None = None,
    *,
    shapes: Iterable[str] | None = None,
    noise_scale: bool | None = None,
) -> Any:
    """Estimate systematic errors from the power of the higher degrees, and what they do to degree 1.

    Systematics are taken as a Gaussian field with one power for each mode of either parity: T of odd and S of even
    degrees, to which a spin belongs, and T of even and S of odd ones, to which a glide does. Degree 1 is fitted freely;
    the powers shown are medians of the exact posterior, flat in the root of each a priori, the other power and the
    scale of the errors marginalised.

    Parameters
    ----------
    normal : NormalEquations or Solution
        What was summed or fitted, to degree 3 at least for a result that says much.
    degrees : iterable of int, optional
        Where to estimate; from 2 to the highest unless given. Others are fitted freely.
    shapes : iterable of "flat", "gaia", "steep", optional
        Spectra, averaged by their evidence with prior odds of 1 : 3 : ½: one power of each mode; that of Gaia EDR3's
        published covariance (Lindegren et al. 2021), which rises towards low degrees; and l⁻², which rises more
        steeply. Default: all three; "flat" and "gaia" if the highest of `degrees` is above 12. ("flat",) assumes a
        single spectrum.
    noise_scale : bool, optional
        Estimate a factor on the catalogue's errors along with the powers: otherwise errors that are too small are
        mistaken for systematic errors. Default: yes for normal equations and for solutions with the catalogue's errors,
        no for all others (errors scaled, or from residuals or replicates).

    Returns
    -------
    Floor or ScalarFloor
        A ScalarFloor of a scalar field: one power of all modes, and the errors of the mean and of the dipole.

    Raises
    ------
    ModesError
        If a degree is not fitted, or degree 1 is named.
    DegeneracyError
        If the data do not determine what is fitted freely.
    ParameterError
        If a shape is unknown, or if the normal equations have templates; use `shared` for these.

    Notes
    -----
    The floor extrapolates from degrees 2, 3, … to degree 1 along the spectra that it is given. On simulated skies with
    power of the size of the noise, drawn from Gaia EDR3's published covariance, from a flat spectrum and from one that
    falls as 1/(3 + l²), the scatter of spin and acceleration is 0.8 to 1.05 of their errors at degrees 3 to 7, and 95 %
    intervals have 93 to 99 % coverage; without "steep" the scatter is 1.2 times the errors and the coverage 89 % for
    the last of these spectra. Where the power is far above the noise, the data determine the spectrum. Degree 5 is a
    good choice: degree 3 has errors that are a tenth larger. Systematic errors in degrees that are not fitted leak into
    the fitted ones: the estimated powers are then too large, but the coverage does not change. For a single shape, the
    median of the posterior has better coverage than the maximum of the likelihood if there are few modes (degree 3: 12
    of each parity); an average over shapes takes the mean power, because the variance of a mixture is the mean of the
    variances. If there are no systematic errors, the average over shapes makes the errors 1.1 times those of the flat
    shape at degrees 5 and 7, and 1.3 times those of a plain fit at degree 4. The floor is also a prior on the higher
    degrees, which then no longer increase the errors of degree 1. docs/backgrounds.md has the coverage on simulated
    skies.

    Examples
    --------
    >>> from fit import normal_equations, solve
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1.5, (2, 500)), rng.normal(size=(2, 500)), np.ones((2, 500)))
    >>> normal = normal_equations(field, 3)
    >>> solve(normal, floor=floor(normal)).n_data
    1000
    """
    equations = equations_of(normal, scalars=True)
    modes = equations.modes
    kind = ScalarFloor if modes.components == 1 else Floor
    if equations.templates:
        raise ParameterError("fit.background.shared([normal]) gives the floor beside templates; this one knows none")
    if degrees is None and modes.lmax < 2:
        raise ModesError("a floor is estimated from degrees 2 and higher: fit to degree 3 at least")
    degrees = check_degrees(modes, range(2, modes.lmax + 1) if degrees is None else degrees)
    if degrees[0] < 2:
        raise ModesError(
            f"degree {degrees[0]} holds the {' and the '.join(kind._parameter_names)}: a floor is estimated from "
            "degrees above 1"
        )
    shape_names = [shapes] if isinstance(shapes, str) else list(list_shapes(degrees[-1]) if shapes is None else shapes)
    if not shape_names or not all(isinstance(shape, str) and shape in SHAPES for shape in shape_names):
        raise ParameterError(f"shapes of the spectrum are {', '.join(map(repr, SHAPES))}, not {shapes!r}")
    free_degrees = tuple(l for l in range(modes.lowest, modes.lmax + 1) if l not in degrees)
    fit_scale = should_fit_scale(normal, noise_scale)
    estimates = [
        _estimate_floor(kind, shape, equations, degrees, free_degrees, fit_scale, find_error_source(normal))
        for shape in shape_names
    ]
    floors, evidences = zip(*estimates, strict=True)
    if len(floors) == 1:
        return replace(floors[0], mean=None)
    probabilities = compute_shape_probabilities(shape_names, evidences)
    return replace(floors[0], mean=None, parts=floors, probability=tuple(probabilities.tolist()))


def _estimate_floor(floor_class, shape_name, equations, degrees, free_degrees, fit_scale, error_origin):
    """The floor for one shape of the spectrum, and ln of its evidence."""
    spectrum = floor_class._spectra_by_shape[shape_name]
    spectra = [spectrum.only("odd"), spectrum.only("even")] if floor_class is Floor else [spectrum]
    likelihood = Likelihood(equations, spectra, degrees, free_degrees, fit_scale)
    maximum = likelihood.find_maximum()
    amplitudes, evidence = compute_posteriors_and_evidence(likelihood, maximum)
    powers: dict[str, Any] = {}
    for name, amplitude in zip(floor_class._power_names, amplitudes, strict=True):
        powers |= {name: amplitude.quantile(0.5, "root"), f"{name}_interval": amplitude.interval(0.68, "root")}
    if floor_class is Floor:  # beside one power for both parities
        common_maximum = Likelihood(equations, [spectrum], degrees, free_degrees, fit_scale).find_maximum()
        powers["parity_p_value"] = compute_parity_p_value(maximum.log_likelihood, common_maximum.log_likelihood)
    estimated_floor = floor_class(
        **powers,
        degrees=degrees,
        noise_scale=maximum.noise_scale,
        log_likelihood=maximum.log_likelihood,
        n_data=equations.n_data,
        errors_from=error_origin[0],
        shape=shape_name,
        mean=tuple(amplitude.mean("root") for amplitude in amplitudes),
        error_source=error_origin[1],
        unit=equations.unit or "",
    )
    return estimated_floor, evidence
