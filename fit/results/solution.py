"""What a fit found, and all that can be read off it; solutions whose parameters have names of their own."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from difflib import get_close_matches
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import gammaincinv

from fit.results.quality import ErrorSource, Quality
from fit.results.storage import (
    Result,
    check_count,
    check_strings,
    decode_value,
    encode_value,
    from_hex,
    make_coefficient_columns,
    to_hex,
)
from vsh.coefficients import FIRST_DEGREE, Coefficients, solve_degree_one
from vsh.field import Field
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.length import FEWEST_DOF, standard_errors
from vsh.modes import Modes
from vsh.scalars import DIPOLE, ScalarCoefficients
from vsh.sky.frames import check_frame
from vsh.tools.arguments import covariance, float_array, generator, whole
from vsh.tools.errors import DegeneracyError, ParameterError, TableError
from vsh.tools.notes import add_codes, codes_of
from vsh.tools.types import ArrayLike, Axes, FloatArray, Kind, Rng, Table
from vsh.vector import Vector, chance_probability, correlation_of


class Gaussian(NamedTuple):
    """A Gaussian likelihood of parameters, as samplers take it."""

    #: Names of the parameters, (p,).
    names: tuple[str, ...]
    #: Their estimates, (p,).
    mean: FloatArray
    #: Covariance of the estimates, (p, p).
    covariance: FloatArray

    def log_density(self, parameters: ArrayLike) -> FloatArray:
        """Logarithm of the normalised density at parameters, (…, p) → (…)."""
        cholesky_factor = np.linalg.cholesky(self.covariance)
        deviation = np.asarray(parameters, float) - self.mean
        white_deviation = solve_triangular(cholesky_factor, deviation.reshape(-1, len(self.mean)).T, lower=True)
        constant = np.log(np.diag(cholesky_factor)).sum() + len(self.mean) / 2 * np.log(2 * np.pi)
        return (-0.5 * (white_deviation**2).sum(0) - constant).reshape(deviation.shape[:-1])


class LinearSolution(Result):
    """A least-squares solution: parameters with a covariance, and how well they fit."""

    names: Any
    values: Any
    covariance: Any
    chi2: float
    n_data: int
    frame: str
    notes: tuple[str, ...]

    @abstractmethod
    def model(self, field: Field) -> FloatArray:
        """The motions that the solution predicts at the sources of a field, (2, n). [µas/yr]"""

    def __getitem__(self, name: str) -> Any:
        """A vector ("spin", "acceleration", "orientation") as a Vector, or a parameter as (value, sigma)."""
        vector_names, names = ["spin", "acceleration", "orientation"], [str(word) for word in self.names]
        if name in vector_names:
            with suppress(AttributeError, ValueError):  # what is not among the parameters of a solution
                if (vector := getattr(self, name)) is not None:
                    return vector
        if name in names:
            index = names.index(name)
            return float(self.values[index]), float(self.sigma[index])
        similar_names = [word for word in get_close_matches(str(name), [*vector_names, *names], n=3) if word != name]
        hint = f": is it {' or '.join(similar_names)}?" if similar_names else ""
        raise ParameterError(f"nothing of this solution is called {name!r}{hint}")

    @property
    def n_sources(self) -> int:
        """Number of sources that were fitted."""
        return self.n_data // 2

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each parameter, (p,): with the degrees of freedom of an estimated covariance."""
        return standard_errors(np.diag(self.covariance), self._parameter_dof)

    @property
    def _parameter_dof(self):
        """Degrees of freedom of each parameter's variance, (p,), or of all."""
        return getattr(self, "covariance_dof", np.inf)

    def gaussian(self) -> Gaussian:
        """Names, estimates and covariance of the parameters, for a sampler or another code's likelihood."""
        return Gaussian(tuple(map(str, self.names)), np.array(self.values), np.array(self.covariance))

    @property
    def correlation(self) -> FloatArray:
        """Correlation matrix of the parameters, (p, p)."""
        return correlation_of(self.covariance)

    @property
    def dof(self) -> int:
        """Degrees of freedom: data points less parameters."""
        return self.n_data - len(self.names)

    @property
    def quality(self) -> Quality:
        """Quality of the fit by χ², a `fit.quality.Quality`."""
        return Quality(self.chi2, self.dof)

    @property
    def reduced_chi2(self) -> float:
        """χ² per degree of freedom; nan where there is none."""
        return self.quality.reduced

    def residuals(self, field: Field) -> Field:
        """The field less the model: a Field, whose `chi2` is that of each source.

        Its `whitened` are the residuals decorrelated and in units of their errors.
        """
        field.check_frame(self.frame)
        return field.minus(self.model(field))


def predict_motions(coefficients: Coefficients, field: Field) -> FloatArray:
    """The motions of coefficients at the sources of a field, (2, n); by the transform for many of them."""
    if len(field) < 10_000:
        return coefficients.at(field.lon, field.lat)
    from vsh.transform import synthesis

    return synthesis(coefficients, field.lon, field.lat)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Solution(LinearSolution):
    """Coefficients with their covariance.

    Attributes
    ----------
    coefficients : Coefficients
        The best fit. [µas/yr]
    covariance : (p, p) array
        N⁻¹, from the catalogue's errors alone, unless `error_source` says otherwise. [(µas/yr)²]
    chi2 : float
        χ² of the residuals of the data, without the penalty of a prior.
    n_data : int
        Number of data that were fitted, two per source. A prior does not count.
    frame : str
        Frame of the axes.
    notes : tuple of str
        What the reader should know of the data.
    errors_from : str
        Where the covariance comes from, in words.
    covariance_dof : float
        Degrees of freedom with which the covariance was estimated. It is inf if the covariance follows from the
        errors of the sources, and the number of replicates minus one if it was resampled. p-values allow for it.
    block_dof : tuple of float
        The same of each kind and degree, in storage order; empty where they have that of the whole.
    by_prior : float
        Effective number of coefficients that a prior determined in place of the data: tr(C P), with P the inverse
        covariance of the prior. Only the other p − `by_prior` coefficients cost degrees of freedom.
    without_prior : Solution or None
        The same solution without the prior of a floor. Powers and p-values of degrees above 1 are taken from it.
    unit : str
        Unit of the coefficients: "µas/yr" for motions, "µas" for differences of position.
    floor : fit.background.Floor or None
        The systematic floor that is included in the covariance; None if there is none.
    error_source : ErrorSource
        Where the covariance comes from, as a member of ErrorSource. Only errors of the catalogue are scaled by χ².
    includes_floor : bool
        Whether the systematic floor is in the covariance.
    is_recommended : bool
        Whether it is the recommended fit, `fit.recommended`.
    formal_covariance : (p, p) array or None
        N⁻¹ from the weights of the fit, if `covariance` is a different matrix. It has no noise from replicates. A
        systematic floor is estimated with it, scaled to the size of `covariance`. [(µas/yr)²]

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> from fit import fit_field
    >>> solution = fit_field(field, 1)
    >>> solution.acceleration.value.shape, solution.n_sources
    ((3,), 500)
    >>> print(dict(solution.answer.lines)["acceleration"].partition(',')[0])
    not detected: < 5.27 µas/yr (95 %)
    """

    coefficients: Coefficients
    covariance: FloatArray
    chi2: float
    n_data: int
    frame: str = "icrs"
    notes: tuple[str, ...] = ()
    errors_from: str = "the catalogue"
    covariance_dof: float = float("inf")
    block_dof: tuple[float, ...] = ()
    by_prior: float = 0.0
    without_prior: Solution | None = None
    unit: str = "µas/yr"
    floor: Any = None
    formal_covariance: FloatArray | None = None
    error_source: ErrorSource = ErrorSource.CATALOGUE
    includes_floor: bool = False
    is_recommended: bool = False

    _coefficients = Coefficients

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self._format_repr()}>"

    def _format_repr(self):
        """Lines of the repr: what was fitted, and its vectors, a line each."""
        heading = f"degree {self.modes.lmax}, {self.n_sources} sources, {self.frame}, errors: {self.error_source.value}"
        heading += " and systematic floor" * self.includes_floor
        names = ("spin", "acceleration") if self.modes.components == 2 and self.modes.lowest == 1 else ()
        return "\n ".join([heading, *(f"{name} {getattr(self, name).in_numbers()}" for name in names)])

    def sections(
        self, *, long: bool = False, check: Any = None, truth: dict[str, Any] | None = None, source: str | None = None
    ) -> tuple[Section, ...]:
        """Spin and acceleration, and the power of each degree.

        Parameters
        ----------
        long : bool
            Add formal errors, the source of the errors and the powers with their noise.
        check : CrossCheck, optional
            Both solvers at degree 1.
        truth : dict, optional
            Truth of a simulated catalogue, by name.
        source : str, optional
            What was fitted.
        """
        from fit.results.output import sections_of

        return sections_of(self, check=check, truth=truth, source=source, long=long)

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Power by degree on matplotlib axes."""
        from fit.results.output import plot_spectrum

        return plot_spectrum(self, ax=ax)

    def plot_sky(self, field: Any = None, *, ax: Axes | None = None) -> Axes:
        """The fitted field on the sky, with how sure it is, on matplotlib axes.

        Parameters
        ----------
        field : Field or ScalarField, optional
            The sources, drawn where they are; none unless given.
        ax : matplotlib axes, optional
            Axes whose place the map takes; a new figure unless given.
        """
        from fit.results.output import plot_sky

        return plot_sky(self, field, ax=ax)

    def to_table(self) -> Table:
        """The coefficients with their errors as an astropy Table, a row each."""
        columns = make_coefficient_columns(self.modes) | {"value": self.values, "sigma": self.sigma}
        units = {name: self._column_units[name] for name in ("value", "sigma") if self._column_units}
        return tables.table_of(columns, {"frame": self.frame}, units)

    @property
    def answer(self) -> Answer:
        """The result to quote: an `Answer` of four labelled lines, with the errors of this solution."""
        from fit.results.output import answer_of

        return answer_of(self)

    @property
    def verdict(self) -> str:
        """The result to quote as text, a line each for acceleration, spin, Gaia EDR3 and the errors."""
        return str(self.answer)

    @property
    def formal(self) -> Solution:
        """Solution with formal errors: N⁻¹ by the weights of the fit."""
        if self.formal_covariance is None:
            return self
        return replace(
            self,
            covariance=self.formal_covariance,
            errors_from="the weights of the fit",
            error_source=ErrorSource.CATALOGUE,
            covariance_dof=float("inf"),
            block_dof=(),
            includes_floor=False,
            without_prior=None,
        )

    @property
    def modes(self) -> Modes:
        """The Modes that were fitted."""
        return self.coefficients.modes

    @property
    def n_sources(self) -> int:
        """Number of sources that were fitted."""
        return self.n_data // self.modes.components

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients, (p,)."""
        return tuple(map(str, self.modes))

    @property
    def values(self) -> FloatArray:
        """The coefficients as an array, (p,). [µas/yr]"""
        return self.coefficients.values

    def model(self, field: Any) -> FloatArray:
        """Predict the motions at the sources of `field`, (2, n), or (n,) of a scalar field. [µas/yr]"""
        return predict_motions(self.coefficients, field)

    @property
    def spin(self) -> Vector:
        """The spin ω of the frame, a Vector. [µas/yr]"""
        return self._make_first_degree_vector("T", FIRST_DEGREE)

    @property
    def acceleration(self) -> Vector:
        """The acceleration ã of the Solar System, in apparent motion, a Vector. [µas/yr]"""
        return self._make_first_degree_vector("S", FIRST_DEGREE)

    def power(self, kind: Kind | None = None, l: int | None = None, *, debiased: bool = True) -> Any:
        """Power of one `kind` and degree `l`, ∫ |V_l|² dΩ, `debiased` or not; of all without either. [(µas/yr)²]

        Noise adds Σ σ² (with the weights of the power) on average; it is taken away
        unless `debiased` is false, so that a small power may come out negative.
        """
        if kind is None:
            return np.array([self.power(each_kind, l, debiased=debiased) for each_kind in self.modes.kinds])
        if l is None:
            return np.array([self.power(kind, degree, debiased=debiased) for degree in np.unique(self.modes.degrees)])
        values, _ = self.of_degree(kind, l)
        power = float(self._compute_power_weights(l) @ values**2)
        return power - self.noise_power(kind, l) if debiased else power

    def noise_power(self, kind: Kind, l: int) -> float:
        """The power of `kind` and degree `l` that noise alone gives on average. [(µas/yr)²]"""
        return float(np.trace(self._compute_weighted_covariance(kind, l)))

    def power_error(self, kind: Kind, l: int) -> float:
        """Standard error of the power of `kind` and degree `l`. [(µas/yr)²]

        For Gaussian errors var(cᵀ W c) = 4 µᵀ W C W µ + 2 tr (W C)², with W the weights 1 and
        2 of the power; µᵀ W C W µ is estimated without bias, and taken as zero where the degree is not
        significant at 5 %: otherwise errors of powers without a signal come out a quarter too large.
        """
        values, covariance = self.of_degree(kind, l)
        wc = self._compute_weighted_covariance(kind, l)
        trace_wcwc = np.trace(wc @ wc)
        weighted_values = self._compute_power_weights(l) * values
        signal_term = max(0.0, weighted_values @ covariance @ weighted_values - trace_wcwc)
        if not self.p_value(kind, l) <= 0.05:
            signal_term = 0.0
        return float(np.sqrt(4 * signal_term + 2 * trace_wcwc))

    def p_value(self, kind: Kind, l: int) -> float:
        """Probability that noise alone gives degree `l` of `kind` as much signal or more.

        W̃ = cᵀ C⁻¹ c over the 2l + 1 coefficients is χ² with 2l + 1 degrees of freedom
        when the true ones are zero, whatever the sky coverage. Where C was estimated from replicates, it is
        Hotelling's T²; nan where they are too few to determine it.
        """
        return chance_probability(self.chi2_of_degree(kind, l), 2 * l + 1, self.dof_of_degree(kind, l))

    def dof_of_degree(self, kind: Kind, l: int) -> float:
        """Degrees of freedom with which the covariance of one degree was estimated; inf if it is known.

        Parameters
        ----------
        kind : {"T", "S", "F"}
            Toroidal or spheroidal; F of a scalar field.
        l : int
            The degree.
        """
        return float(self._parameter_dof[self.modes.slice_of(kind, l)][0])

    @property
    def _parameter_dof(self):
        """Degrees of freedom of each coefficient's variance, (p,)."""
        blocks = self.modes.blocks
        return np.repeat(self.block_dof or [self.covariance_dof] * len(blocks), [2 * l + 1 for _, l in blocks])

    def chi2_of_degree(self, kind: Kind, l: int) -> float:
        """W̃ = cᵀ C⁻¹ c over coefficients of one `kind` and degree `l`; nan where too few replicates determine C."""
        if self.dof_of_degree(kind, l) < max(2 * l + 1, FEWEST_DOF):
            return float("nan")
        values, covariance = self.of_degree(kind, l)
        return float(values @ np.linalg.solve(covariance, values))

    def _make_first_degree_vector(self, kind, design):
        vector = solve_degree_one(design, *self.of_degree(kind, 1), self.frame, self.unit)
        return replace(vector, dof=self.dof_of_degree(kind, 1))

    def _compute_weighted_covariance(self, kind, l):
        return self._compute_power_weights(l)[:, None] * self.of_degree(kind, l)[1]

    @staticmethod
    def _compute_power_weights(l):
        return np.array([1.0] + 2 * l * [2.0])

    def summary(self) -> Table:
        """Spin and acceleration as an astropy Table: a row for each component, with errors and 68 % intervals."""
        from fit.results.output import vectors_of

        formal = vectors_of(self.formal)
        rows = self._make_mean_rows() + [
            (f"{name}_{axis}", value, error, formal_error, value - error, value + error)
            for name, vector in vectors_of(self).items()
            for axis, value, error, formal_error in zip(
                "xyz", vector.value, vector.sigma, formal[name].sigma, strict=True
            )
        ]
        names = ("parameter", "value", "error", "formal_error", "low_68", "high_68")
        return tables.table_of_rows(names, rows, {"frame": self.frame}, dict.fromkeys(names[1:], self.unit))

    def _make_mean_rows(self):
        """The row of the mean, of a scalar field alone."""
        return []

    def predict(self, lon: ArrayLike | Field, lat: ArrayLike | None = None) -> FloatArray:
        """The fitted motions at places, (2, n): east and north component. [µas/yr]

        Parameters
        ----------
        lon, lat : (n,) arrays
            Places in the frame of the solution [rad]; or a Field alone, whose sources are taken.

        Raises
        ------
        ParameterError
            If there is a longitude without a latitude.
        """
        if isinstance(lon, Field):
            lon.check_frame(self.frame)
            return self.model(lon)
        if lat is None:
            raise ParameterError("predict takes lon and lat in radians, or a Field")
        return self.coefficients.at(lon, lat)

    def sample(self, n: int, *, rng: Rng = 1) -> FloatArray:
        """Draw coefficients from their distribution, (n, p): normal, or Student's t where replicates gave the errors.

        Parameters
        ----------
        n : int
            How many draws.
        rng : Generator or int
            The source of all randomness.
        """
        random_generator, values = generator(rng), self.coefficients.values
        draws = random_generator.multivariate_normal(np.zeros(len(values)), self.covariance, size=whole("n", n))
        if np.isfinite(self.covariance_dof):
            dof = self._parameter_dof
            draws /= np.sqrt(2 / dof * gammaincinv(dof / 2, random_generator.uniform(size=(n, 1))))
        return values + draws

    @property
    def aic(self) -> float:
        """Akaike's information criterion, χ² + 2k, up to a constant of the data: smaller is better."""
        return self._compute_penalised_chi2(2)

    @property
    def bic(self) -> float:
        """The Bayesian information criterion, χ² + k ln n, up to a constant of the data: smaller is better.

        It compares degrees by the catalogue's errors.
        """
        return self._compute_penalised_chi2(np.log(self.n_data))

    def _compute_penalised_chi2(self, penalty_per_coefficient):
        """χ² with a penalty for each coefficient that the data determine."""
        return float(self.chi2 + penalty_per_coefficient * (len(self.coefficients.values) - self.by_prior))

    def latex(
        self, style: Literal["booktabs", "siunitx", "aastex", "aa", "mnras"] = "booktabs", *, full: bool = False
    ) -> str:
        """Acceleration and spin as a LaTeX table for a paper: one float, with caption and label.

        Parameters
        ----------
        style : {"booktabs", "siunitx", "aastex", "aa", "mnras"}
            Packages and class that it is for: numbers by siunitx, a deluxetable of AASTeX, tables of A&A and MNRAS.
        full : bool
            Add the power of each degree.
        """
        from fit.results.output import latex_of

        return latex_of(self, style, full=full)

    def of_degree(self, kind: Kind, l: int) -> tuple[FloatArray, FloatArray]:
        """Coefficients of one kind and degree with their covariance: what its power and p-value are of.

        Parameters
        ----------
        kind : {"T", "S"}
            Toroidal or spheroidal.
        l : int
            The degree; beyond 1, of the solution without the prior of a floor, if there is one.

        Returns
        -------
        tuple[array, array]
            [µas/yr], [(µas/yr)²]
        """
        if self.without_prior is not None and l > 1:
            return self.without_prior.of_degree(kind, l)
        degree_slice = self.modes.slice_of(kind, l)
        return self.coefficients.values[degree_slice], self.covariance[degree_slice, degree_slice]

    @property
    def dof(self) -> int:
        """Degrees of freedom of χ²: data points less the parameters they determined, rounded where a prior helped."""
        return self.n_data - len(self.modes) + round(self.by_prior)

    @property
    def scaled(self) -> Solution:
        """Solution with errors multiplied by √(χ²/dof) where χ² contradicts them, and only there."""
        factor = self.quality.factor
        if factor == 1.0 or self.error_source != ErrorSource.CATALOGUE:
            return self
        errors_from = f"the catalogue, times {factor:.3g}"
        return with_errors(self, self.covariance * factor**2, errors_from, ErrorSource.SCALED)

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, len(self.modes)))
        object.__setattr__(self, "error_source", ErrorSource(self.error_source))  # a word where it was in a file
        if (self.covariance.diagonal() == 0).any():
            raise DegeneracyError(
                f"the errors from {self.errors_from} are zero: the motions have no scatter (are they all alike?). "
                "Take the catalogue's own errors"
            )
        super().__post_init__()

    def widget(self, field: Field, *, height: int = 720) -> Any:
        """The fit and its sources on a sky that can be turned, for a notebook.

        Parameters
        ----------
        field : Field
            The sources that were fitted.
        height : int
            [pixels]
        """
        from vsh.figures.page import ShownSolution, widget

        field = field.to_frame(self.frame)
        return widget(ShownSolution("fit", field, self.coefficients, self.covariance, self.unit), height=height)

    def _pack(self):
        columns = make_coefficient_columns(self.modes) | {"value": self.values, "sigma": self.sigma}
        metadata: dict[str, Any] = {"lmax": self.modes.lmax, "notes": list(map(str, self.notes))}
        metadata["note_codes"] = list(codes_of(self.notes))
        attributes = {name: getattr(self, name) for name in self._list_plain_attributes()}
        metadata |= {name: to_hex(x) if isinstance(x, float) else encode_value(x) for name, x in attributes.items()}
        return columns | {"covariance": self.covariance}, metadata, self._column_units

    @staticmethod
    def _list_plain_attributes():
        """Attributes of every solution that stand in the metadata of its file as they are."""
        excluded_names = ("coefficients", "covariance", "notes")
        return [entry.name for entry in fields(Solution) if entry.name not in excluded_names]

    @property
    def _column_units(self):
        """Units of the columns, where they are ones that tables know."""
        units = {"µas/yr": ("uas / yr", "uas2 / yr2"), "µas": ("uas", "uas2")}
        if self.unit not in units:
            return {}
        unit, square_unit = units[self.unit]
        return {"value": unit, "sigma": unit, "covariance": square_unit}

    @classmethod
    def _unpack(cls, columns, metadata):
        float_array("value", columns["value"])
        return cls(**cls._decode_attributes(columns, metadata))

    @classmethod
    def _decode_attributes(cls, columns, metadata):
        """Attributes of every solution."""
        # Older files lack these.
        stored_attributes = {"floor": None, "formal_covariance": None, "block_dof": encode_value(())} | metadata
        plain = {name: decode_value(stored_attributes[name]) for name in cls._list_plain_attributes()}
        plain |= {name: from_hex(plain[name]) for name in ("chi2", "covariance_dof", "by_prior")}
        plain |= {name: str(plain[name]) for name in ("errors_from", "unit")}
        plain |= {name: plain[name] is True for name in ("includes_floor", "is_recommended")}
        plain["n_data"], plain["frame"] = (check_count(plain["n_data"]), check_frame(plain["frame"]))
        plain["notes"] = add_codes(check_strings(metadata["notes"]), check_strings(metadata["note_codes"]))
        coefficients = cls._coefficients(metadata["lmax"], columns["value"])
        return plain | {"coefficients": coefficients, "covariance": columns["covariance"]}


def with_errors(
    solution: Solution, covariance: FloatArray, errors_from: str, source: ErrorSource, dof: Any = np.inf, **changes: Any
) -> Solution:
    """The solution with another covariance, beside which its own is the formal one.

    `dof` are its degrees of freedom, and then those of each kind and degree, where they are known.
    """
    covariance_dof, *block_dof = np.atleast_1d(dof).tolist()
    changes |= {"errors_from": errors_from, "error_source": source, "formal_covariance": solution.covariance}
    changes |= {"covariance_dof": covariance_dof, "block_dof": tuple(block_dof)}
    return replace(solution, covariance=covariance, **changes)


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class ScalarSolution(Solution):
    """Coefficients of a scalar field with their covariance."""

    unit: str = ""

    _coefficients = ScalarCoefficients

    @property
    def mean(self) -> tuple[float, float]:
        """The mean over the sky with its error, f_00/√4π; for degree 0 the weighted mean of the sources."""
        return float(self.values[0] / np.sqrt(4 * np.pi)), float(self.sigma[0] / np.sqrt(4 * np.pi))

    def _make_mean_rows(self):
        (value, error), formal = self.mean, float(self.formal.sigma[0] / np.sqrt(4 * np.pi))
        return [("mean", value, error, formal, value - error, value + error)]

    @property
    def dipole(self) -> Vector:
        """d of the part d·r, a Vector in `unit`."""
        return self._make_first_degree_vector("F", DIPOLE)


class AboutSolution(Result):
    """A result about a solution: text, table, figure and vectors are those of the solution to quote."""

    solution: Solution

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.quoted._format_repr()}>"

    @property
    def quoted(self) -> Solution:
        """The solution with the errors of this result."""
        return self.solution

    @property
    def spin(self) -> Vector:
        """The spin, a Vector with the errors of this result. [µas/yr]"""
        return self.quoted.spin

    @property
    def acceleration(self) -> Vector:
        """The acceleration, a Vector with the errors of this result. [µas/yr]"""
        return self.quoted.acceleration

    @property
    def answer(self) -> Answer:
        """The result to quote: an `Answer` of four labelled lines."""
        return self.quoted.answer

    @property
    def verdict(self) -> str:
        """The result to quote as text, a line each for acceleration, spin, Gaia EDR3 and the errors."""
        return self.quoted.verdict

    def __getitem__(self, name: str) -> Any:
        """A vector or parameter of the solution with the errors of this result, as `Solution` has them."""
        return self.quoted[name]

    def __getattr__(self, name: str) -> Any:
        """Whatever else a solution answers for: with the errors of this result."""
        if "solution" in vars(self):
            solution_class = type(self.solution)
            if name in solution_class.__dataclass_fields__ or hasattr(solution_class, name):
                return getattr(self.quoted, name)
        return super().__getattr__(name)  # type: ignore[misc]

    def __dir__(self) -> Iterable[str]:
        """Return the names of this result, and of its solution."""
        return {*super().__dir__(), *dir(self.solution)}

    def summary(self) -> Table:
        """Spin and acceleration as an astropy Table, a row for each component."""
        return self.quoted.summary()

    def sections(self, *, long: bool = False, **about: Any) -> tuple[Section, ...]:
        """The parts of the text; with more `about` it than `long`, those of `Solution.sections`."""
        return self.quoted.sections(long=long, **about) if about else self._sections(long)

    def _sections(self, long):
        return self.quoted.sections(long=long)

    def to_table(self) -> Table:
        """The coefficients with their errors as an astropy Table, a row each."""
        return self.quoted.to_table()

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Power by degree on matplotlib axes."""
        return self.quoted.plot(ax=ax)


@dataclass(frozen=True, eq=False, kw_only=True)
class NamedSolution(LinearSolution):
    """A least-squares solution for named parameters."""

    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    chi2: float
    n_data: int
    frame: str
    notes: tuple = ()

    def __post_init__(self) -> None:
        """Check what a file or a caller may have mixed up."""
        size = len(self.names)
        object.__setattr__(self, "values", float_array("the values", self.values, (size,), finite=False))
        object.__setattr__(self, "covariance", covariance("the covariance", self.covariance, size))
        super().__post_init__()

    def _pack(self):
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma}
        columns["covariance"] = self.covariance
        other_names = [entry.name for entry in fields(self) if entry.name not in ("names", "values", "covariance")]
        return columns, {"fields": {name: encode_value(getattr(self, name)) for name in other_names}}, {}

    @classmethod
    def _unpack(cls, columns, metadata):
        attributes = {name: decode_value(value) for name, value in metadata["fields"].items()}
        attributes["n_data"], attributes["frame"] = check_count(attributes["n_data"]), check_frame(attributes["frame"])
        names = tuple(columns["parameter"].tolist())
        if len(set(names)) < len(names):
            raise TableError("names of parameters repeat")
        return cls(names=names, values=columns["value"], covariance=columns["covariance"], **attributes)

    @property
    def spin(self) -> Vector | None:
        """ω, a Vector in µas/yr, or None where it is not among the parameters."""
        return self._make_vector("omega") if "omega_x" in self.names else None

    @property
    def acceleration(self) -> Vector:
        """ã, a Vector in µas/yr."""
        return self._make_vector("a")

    def to_table(self) -> Table:
        """Parameters with their errors and correlations as an astropy Table, a row each."""
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma}
        columns |= {f"correlation_{name}": column for name, column in zip(self.names, self.correlation.T, strict=True)}
        return tables.table_of(columns, {"frame": self.frame, "notes": list(map(str, self.notes))})

    def plot(self, *, ax: Any = None) -> Any:  # a link's has panels
        """The correlation matrix of the parameters on matplotlib axes."""
        from fit.results.output import plot_correlation

        return plot_correlation(self, ax=ax)

    def _make_vector(self, name, unit="µas/yr"):
        first_index = self.names.index(f"{name}_x")
        components = slice(first_index, first_index + 3)
        return Vector(self.values[components], self.covariance[components, components], self.frame, unit)
