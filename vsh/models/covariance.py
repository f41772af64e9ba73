"""Errors and motions that sources share: spectra of fields, covariance functions, matrices.

A `Spectrum` is the mean power of a random field in each kind and degree; `from_function` and the like make the dense
covariance matrix that such a field gives to the motions of some sources.

Two motions are compared by carrying one along the great circle to the other. The components along and across it give ξ±
= ⟨u∥u∥'⟩ ± ⟨u⊥u⊥'⟩, and

    ξ+ = Σ (P_T + P_S)_l d⁺_l/4π,   ξ− = Σ (P_T − P_S)_l d⁻_l/4π.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf
from scipy.special import eval_legendre

from vsh.basis import harmonics
from vsh.field import Field
from vsh.modes import Modes, ScalarModes, as_modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import float_array
from vsh.tools.errors import CovarianceError, ModesError, ParameterError, TableError, VshError, first_line
from vsh.tools.notebook import Frozen, InNotebook
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, FloatArray, PathName
from vsh.tools.units import hubble_rate

__all__ = [
    "LINDEGREN_2021",
    "LINDEGREN_2021_PARALLAX",
    "Covariance",
    "ScalarSpectrum",
    "Spectrum",
    "from_function",
    "from_spectrum",
    "read_covariance",
]


#: Panels of 16 nodes in the integral over θ, at least, and the power by which they crowd towards zero.
_FEWEST_PANELS, _GRADING = 250, 3


def d_plus(lmax: int, theta: ArrayLike) -> FloatArray:
    """d⁺_l = d^l_{11}(θ) = ½ (1 + x) P^{(0,2)}_{l−1}(x), x = cos θ, for l = 1 … lmax."""
    x = np.cos(np.atleast_1d(np.asarray(theta, float)))
    polynomials = np.empty((lmax, x.size))
    # Jacobi's polynomials with (0, 2), by their recurrence.
    previous, p = np.zeros_like(x), np.ones_like(x)
    for n in range(lmax):
        polynomials[n] = p
        k, c = n + 1, 2 * (n + 1) + 2
        numerator = (c - 1) * (c * (c - 2) * x - 4) * p - 2 * (k - 1) * (k + 1) * c * previous
        previous, p = p, numerator / (2 * k * (k + 2) * (c - 2))
    return (1 + x) / 2 * polynomials


def d_minus(lmax: int, theta: ArrayLike) -> FloatArray:
    """d⁻_l = ½ (1 − x) P^{(2,0)}_{l−1}(x) = (−1)^{l−1} d⁺_l(π − θ) for l = 1 … lmax."""
    signs = (-1.0) ** np.arange(lmax)
    return signs[:, None] * d_plus(lmax, np.pi - np.atleast_1d(np.asarray(theta, float)))


def legendre(lmax: int, theta: ArrayLike) -> FloatArray:
    """P_l(cos θ) for l = 0 … lmax."""
    return eval_legendre(np.arange(lmax + 1)[:, None], np.cos(theta))


def compute_power(function: Callable[[FloatArray], FloatArray], lmax: int, kernel: Any = d_plus) -> FloatArray:
    """P_l = 2π (2l + 1) ∫ V d⁺_l sin θ dθ of one kind, for l = 1 … lmax; or by another kernel. [(µas/yr)²]"""
    nodes, weights = np.polynomial.legendre.leggauss(16)
    n_panels = max(_FEWEST_PANELS, lmax)
    u = ((np.arange(n_panels)[:, None] + (nodes + 1) / 2) / n_panels).ravel()
    theta = np.pi * u**_GRADING
    integrand = evaluate_covariance_function(function, theta) * np.sin(theta) * _GRADING * np.pi * u ** (_GRADING - 1)
    integrand *= np.tile(weights / (2 * n_panels), n_panels)
    integrals = kernel(lmax, theta) @ integrand
    degrees = np.arange(lmax + 1 - len(integrals), lmax + 1)
    return 2 * np.pi * (2 * degrees + 1) * integrals


def evaluate_covariance_function(function: Callable[[FloatArray], FloatArray], theta: FloatArray) -> FloatArray:
    """Evaluate V at some angles, of their shape and finite. [(µas/yr)²]"""
    if not callable(function):
        raise ParameterError(f"a covariance function V(θ) takes angles in rad, not {type(function).__name__}")
    return float_array("V(θ)", function(theta), theta.shape, broadcast=True)


def VASILIEV_BAUMGARDT_2021(theta: ArrayLike) -> FloatArray:
    """Compute V(θ) of Gaia EDR3, 400/(1 + θ/0.3°) + 300 exp(−θ/12°), at angles θ in rad. [(µas/yr)²]

    Notes
    -----
    Vasiliev & Baumgardt (2021, MNRAS 505, 5978). At low degrees it is a few times larger than what quasars show.
    Use it for simulations, and estimate low degrees from the data (`fit.background.floor`).
    """
    degrees = np.degrees(theta)
    return 400 / (1 + degrees / 0.3) + 300 * np.exp(-degrees / 12)


@arguments.accepts(theta=arguments.float_array)
def LINDEGREN_2021(theta: ArrayLike) -> FloatArray:
    """V(θ) of Gaia EDR3 at large angles: 292 exp(−θ/12°). [(µas/yr)²]

    Parameters
    ----------
    theta : array
        Angles. [rad]

    Notes
    -----
    Lindegren et al. (2021, A&A 649, A2). The note on `VASILIEV_BAUMGARDT_2021` holds for it as well.
    """
    return 292 * np.exp(-np.degrees(theta) / 12)


@arguments.accepts(theta=arguments.float_array)
def LINDEGREN_2021_PARALLAX(theta: ArrayLike) -> FloatArray:
    """⟨ϖ ϖ'⟩ of Gaia EDR3's quasars at large angles, less their mean: 142 exp(−θ/16°). [µas²]

    Parameters
    ----------
    theta : array
        Angles. [rad]

    Notes
    -----
    Lindegren et al. (2021, A&A 649, A2), section 5.6.
    """
    return 142 * np.exp(-np.degrees(theta) / 16)


def wave_fractions(lmax: int) -> FloatArray:
    """Share of each degree in the power of a stochastic gravitational-wave background, (lmax,).

    α_l = 24 (2l + 1) / [(l − 1) l² (l + 1)² (l + 2)]: 5/6, 7/60, 3/100, … from l = 2 on; they
    sum to 1. The fractions are those of Book & Flanagan (2011, PhRvD 83, 024024), table 1.
    """
    l = np.arange(2, lmax + 1.0)
    return np.r_[0.0, 24 * (2 * l + 1) / ((l - 1) * l**2 * (l + 1) ** 2 * (l + 2))]


def truncate_spectrum(power: FloatArray, lmax: int, name: str) -> FloatArray:
    """The first degrees of a given spectrum, (2, lmax)."""
    if lmax > power.shape[1]:
        raise ModesError(f"the spectrum {name} is given to degree {power.shape[1]}, and degree {lmax} is expected")
    return power[:, :lmax]


def zero_rounding_errors(power: FloatArray) -> FloatArray:
    """Set to zero what is negative by the rounding of an integral alone."""
    return np.where(np.abs(power) < 1e-10 * np.abs(power).max(), 0.0, power)


#: The two parities, by what the field at the antipode is.
PARITIES = ("odd", "even")


@dataclass(frozen=True, eq=False, repr=False)
class SpectrumOfKind(InNotebook):
    """Base of the spectra of vector and of scalar fields: power by degree, and what it is for the modes.

    Attributes
    ----------
    name : str
        For reports.
    law : function
        From lmax to the powers of each kind and degree.
    """

    name: str
    law: Callable[[int], FloatArray]

    #: Modes of the field.
    mode_class: ClassVar[type[Modes]] = Modes
    _kernel: ClassVar[Any] = staticmethod(d_plus)

    def __repr__(self) -> str:
        return f"<{type(self).__name__}: {self.name}>"

    @classmethod
    def flat(cls) -> Self:
        """Spectrum with the same power in every mode: P_l = 2l + 1 in each kind."""
        return cls.of_modes(np.ones_like, "flat")

    @classmethod
    def of_modes(cls, variance: Callable[[FloatArray], FloatArray], name: str) -> Self:
        """Spectrum with a given variance of every mode: P_l = (2l + 1) V_l in each kind.

        Parameters
        ----------
        variance : function
            From degrees l to V_l.
        name : str
            For reports.
        """

        def law(lmax):
            l = np.arange(cls.mode_class.lowest, lmax + 1.0)
            return cls._repeat_for_kinds((2 * l + 1) * variance(l))

        return cls(name, law)

    @classmethod
    def from_covariance(cls, function: Callable[[FloatArray], FloatArray], name: str | None = None) -> Self:
        """The spectrum of a field whose motions are correlated by V(θ), carried along great circles; P_T = P_S.

        Parameters
        ----------
        function : function of θ [rad]
            V = ½ ξ+, asked once for each number of degrees. [(µas/yr)²]
        name : str, optional
            For reports.

        Raises
        ------
        ParameterError
            If V is no function, or the power of a degree comes out negative: no field has such a covariance.

        Notes
        -----
        P_l = 2π (2l + 1) ∫ V d⁺_l sin θ dθ. A published V is often measured as ½⟨µ_α*µ_α*' + µ_δµ_δ'⟩ in local
        axes, which is the same below some 20°, and not near the poles.

        Examples
        --------
        >>> from vsh.models.covariance import LINDEGREN_2021
        >>> Spectrum.from_covariance(LINDEGREN_2021).power(5)[0].round(1)
        array([218.3, 291.2, 306.9, 288.8, 257. ])
        """
        evaluate_covariance_function(function, np.array([0.1, 1.0]))
        name = name or f"of the covariance function {getattr(function, '__name__', 'V(θ)')}"
        integrate = lru_cache(maxsize=16)(lambda lmax: zero_rounding_errors(compute_power(function, lmax, cls._kernel)))
        return cls(name, lambda lmax: cls._repeat_for_kinds(integrate(lmax)))

    @classmethod
    def _repeat_for_kinds(cls, power):
        """Repeat the power for each kind of modes."""
        return np.tile(power, (len(cls.mode_class.kinds), 1))

    def power(self, lmax: int) -> FloatArray:
        """∫ |V_l|² dΩ of T and S for l = 1 … `lmax`, (2, lmax). [(µas/yr)²]

        Raises
        ------
        ParameterError
            If a power is negative.
        ModesError
            If it was given to a lower degree.
        """
        kinds, lowest = self.mode_class.kinds, self.mode_class.lowest
        lmax = as_modes(lmax, self.mode_class).lmax
        powers = float_array(f"the spectrum {self.name}", self.law(lmax), (len(kinds), lmax + 1 - lowest))
        if (powers < 0).any():
            row, column = np.argwhere(powers < 0)[0]
            raise ParameterError(
                f"the power of {kinds[row]}{column + lowest} is {powers[row, column]:.3g} in the spectrum "
                f"{self.name}: no field has a negative power"
            )
        return powers

    def variances(self, modes: Modes | int) -> FloatArray:
        """Variance of each of `modes`, (p,): P_l/(2l + 1), half where a mode stands for ±m. [(µas/yr)²]"""
        modes = as_modes(modes, self.mode_class)
        l, n_kinds = modes.degrees, len(modes.kinds)
        kind_rows = np.repeat(np.arange(n_kinds), len(modes) // n_kinds)
        return self.power(modes.lmax)[kind_rows, l - modes.lowest] / (2 * l + 1) / modes.norm2

    def __add__(self, other: Any) -> Self:
        if type(other) is not type(self):
            return NotImplemented
        return type(self)(f"{self.name} + {other.name}", lambda lmax: self.law(lmax) + other.law(lmax))

    def __mul__(self, factor: float) -> Self:
        factor = arguments.not_negative("the factor on a spectrum", factor)
        return type(self)(f"{factor:g} × {self.name}", lambda lmax: factor * self.law(lmax))

    __rmul__ = __mul__


@dataclass(frozen=True, eq=False, repr=False)
class Spectrum(SpectrumOfKind):
    """The mean power of a statistically isotropic field in each kind and degree, for an amplitude of one.

    Spectra add, and are multiplied by numbers.

    Attributes
    ----------
    name : str
        For reports.
    law : function
        From lmax to the powers ∫ |V_l|² dΩ of T and S in degrees 1 … lmax, (2, lmax). [(µas/yr)²]

    Examples
    --------
    >>> Spectrum.waves(hubble=70).power(3).round(2)
    array([[   0.  , 1141.7 ,  159.84],
           [   0.  , 1141.7 ,  159.84]])
    >>> (2 * Spectrum.odd()).power(2)
    array([[ 6.,  0.],
           [ 0., 10.]])
    """

    @classmethod
    def waves(cls, hubble: float = 70.0) -> Spectrum:
        """Gravitational waves longer than the observations; amplitude Ω_GW, H0 = `hubble` = 70 h70² Ω_GW. [km/s/Mpc]

        Notes
        -----
        Book & Flanagan (2011, PhRvD 83, 024024): 4π H0² α_l, half of it toroidal.
        """
        total_power = 4 * np.pi * hubble_rate(arguments.positive("hubble", hubble)) ** 2
        return cls(
            f"gravitational waves, H0 = {hubble:g} km/s/Mpc",
            lambda lmax: cls._repeat_for_kinds(total_power * wave_fractions(lmax) / 2),
        )

    @classmethod
    def odd(cls) -> Spectrum:
        """Spectrum with the same power in every mode of the parity of a spin: T of odd degrees, S of even ones."""
        return replace(cls.flat().only("odd"), name="odd parity")

    @classmethod
    def even(cls) -> Spectrum:
        """Spectrum with the same power in every mode of the parity of a glide: S of odd degrees, T of even ones."""
        return replace(cls.flat().only("even"), name="even parity")

    @classmethod
    def power_law(cls, index: float) -> Spectrum:
        """P_l = l^`index` in each kind; 0 for the same power in every degree."""
        index = arguments.number("index", index)
        return cls(f"power law l^{index:g}", lambda lmax: cls._repeat_for_kinds(np.arange(1.0, lmax + 1) ** index))

    @classmethod
    def given(cls, toroidal: ArrayLike, spheroidal: ArrayLike | None = None, name: str = "given") -> Spectrum:
        """Powers of degrees 1, 2, … as they are given.

        Parameters
        ----------
        toroidal : (lmax,) array
            P_T. [(µas/yr)²]
        spheroidal : (lmax,) array, optional
            P_S; the same as P_T unless given. [(µas/yr)²]
        name : str
            For reports.

        Raises
        ------
        ParameterError
            If they are not one number of at least zero for each degree.
        """
        toroidal = float_array("toroidal", toroidal)
        powers = np.stack(
            [toroidal, toroidal if spheroidal is None else float_array("spheroidal", spheroidal, toroidal.shape)]
        )
        if powers.ndim != 2 or not powers.shape[1] or (powers < 0).any():
            raise ParameterError("a spectrum is one power of at least zero for each degree from 1 on")
        return cls(name, lambda lmax: truncate_spectrum(powers, lmax, name))

    def only(self, parity: str) -> Spectrum:
        """The part of it that is odd, as a spin is, or even, as a glide is.

        Parameters
        ----------
        parity : {"odd", "even"}
            Odd: T of odd degrees and S of even ones.
        """
        arguments.choice("parity", parity, PARITIES)

        def law(lmax):
            is_odd = np.arange(1, lmax + 1) % 2 == [[1], [0]]  # T of odd degrees and S of even ones, as a spin
            return self.law(lmax) * (is_odd == (parity == "odd"))

        return Spectrum(f"{self.name}, {parity} parity", law)

    def covariance(self, theta: ArrayLike, lmax: int = 400) -> FloatArray:
        """V(θ) = ½ ξ+ = Σ ½ (P_T + P_S) d⁺_l/4π, of the shape of θ. [(µas/yr)²]

        Parameters
        ----------
        theta : array
            Angles. [rad]
        lmax : int
            The highest degree of the sum.
        """
        sums = self.power(lmax).mean(0) @ d_plus(lmax, np.ravel(theta)) / (4 * np.pi)
        return sums.reshape(np.shape(theta))

    @property
    def spin_error(self) -> float:
        """Standard deviation of each component of the spin of such a field: √(P_T1/8π). [µas/yr]"""
        return float(np.sqrt(self.power(1)[0, 0] / (8 * np.pi)))

    @property
    def acceleration_error(self) -> float:
        """Standard deviation of each component of the glide of such a field: √(P_S1/8π). [µas/yr]"""
        return float(np.sqrt(self.power(1)[1, 0] / (8 * np.pi)))


class ScalarSpectrum(SpectrumOfKind):
    """The mean power of a statistically isotropic scalar field, parallaxes say, in each degree from 0 on.

    Attributes
    ----------
    name : str
        For reports.
    law : function
        From lmax to the powers ∫ |f_l|² dΩ of degrees 0 … lmax, (1, lmax + 1). [squares of the field's unit] That of a
        covariance is P_l = 2π (2l + 1) ∫ V P_l(cos θ) sin θ dθ.

    Examples
    --------
    >>> ScalarSpectrum.from_covariance(LINDEGREN_2021_PARALLAX).power(2).round(1)
    array([[ 64.5, 159.1, 189.6]])
    """

    mode_class = ScalarModes
    _kernel = staticmethod(legendre)

    @property
    def mean_error(self) -> float:
        """Standard deviation of the mean over the sky of such a field: √(P_0/4π)."""
        return float(np.sqrt(self.power(0)[0, 0] / (4 * np.pi)))

    @property
    def dipole_error(self) -> float:
        """Standard deviation of each component of the dipole of such a field: √(P_1/4π)."""
        return float(np.sqrt(self.power(1)[0, 1] / (4 * np.pi)))


#: More sources have matrices that no machine of today likes: 3 GiB at 10 000, and as much again for its factor.
MAX_SOURCES = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Covariance(Frozen):
    """The covariance of the motions of n sources, all east components first, then all north ones. Two of them add.

    Attributes
    ----------
    matrix : (2n, 2n) array
        Symmetric and positive definite, where it is to whiten something. [(µas/yr)²]

    Raises
    ------
    ParameterError
        If it is not square, not symmetric, or too large.
    """

    matrix: FloatArray

    def __post_init__(self) -> None:
        shape = np.shape(self.matrix)
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] % 2 or not shape[0]:
            raise ParameterError(f"a covariance of n sources has shape (2n, 2n), east components first, not {shape}")
        check_covariance_size(shape[0] // 2)
        matrix = float_array("the covariance", self.matrix)
        for rows in np.array_split(np.arange(shape[0]), max(1, matrix.size // 2**24)):  # no second matrix of its size
            if (matrix[rows, rows] < 0).any():
                raise ParameterError(
                    f"the covariance has a negative variance: of component {rows[matrix[rows, rows] < 0][0]}"
                )
            scale = np.sqrt(np.outer(np.diag(matrix)[rows], np.diag(matrix)))
            if (np.abs(matrix[rows] - matrix[:, rows].T) > 1e-8 * scale + 1e-300).any():
                raise ParameterError("the covariance is not symmetric")
        self._set_frozen(matrix=matrix)

    def __len__(self) -> int:
        return len(self.matrix) // 2

    def __repr__(self) -> str:
        return f"<Covariance: {len(self)} sources>"

    def __getitem__(self, keep: Any) -> Covariance:
        """The covariance of the sources picked by a mask, a slice or indices."""
        matrix_rows = np.arange(len(self))[keep]
        matrix_rows = np.concatenate([matrix_rows, matrix_rows + len(self)])
        return Covariance(self.matrix[np.ix_(matrix_rows, matrix_rows)])

    def __add__(self, other: Any) -> Covariance:
        if not isinstance(other, Covariance):
            return NotImplemented
        if len(other) != len(self):
            raise ParameterError(f"covariances of {len(self)} and of {len(other)} sources do not add")
        return Covariance(self.matrix + other.matrix)

    @cached_property
    def factor(self) -> FloatArray:
        """L of L Lᵀ, lower triangular, (2n, 2n). [µas/yr]

        Raises
        ------
        CovarianceError
            If the matrix is not positive definite.
        """
        # Fortran's view of a symmetric matrix is itself: its upper triangle is our lower one.
        factor, info = dpotrf(self.matrix.T, lower=1, clean=1)
        if info:
            component, source = ("east", "north")[(info - 1) // len(self)], (info - 1) % len(self)
            raise CovarianceError(
                f"the covariance is not positive definite: the {component} component of source {source} is determined "
                "by those before it, or more than that; add the errors of the sources (vsh.models.covariance.of_errors)"
            )
        return factor

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Rows of motions decorrelated and in units of their errors: L⁻¹ applied to each, (…, 2n).

        Parameters
        ----------
        rows : (…, 2n) array
            East components first, as the matrix has them.

        Raises
        ------
        CovarianceError
            If the matrix is not positive definite.
        """
        rows = np.asarray(rows, float)
        flat_rows = rows.reshape(-1, 2 * len(self))
        return solve_triangular(self.factor, flat_rows.T, lower=True, check_finite=False).T.reshape(rows.shape)


def as_covariance(value: Any, field: Any) -> Covariance:
    """Interpret a covariance of a field: a matrix or a Covariance, of as many sources."""
    if not isinstance(field, Field):
        raise ParameterError(f"a dense covariance is of the sources of one Field, not of {type(field).__name__}")
    matrix = value if isinstance(value, Covariance) else Covariance(value)
    if len(matrix) != len(field):
        raise ParameterError(f"the covariance is of {len(matrix)} sources, the field of {len(field)}")
    return matrix


def check_covariance_size(n_sources: int) -> None:
    """Raise ParameterError where a dense matrix would be too large, before it is made."""
    if n_sources > MAX_SOURCES:
        raise ParameterError(
            f"the dense covariance of {n_sources} sources takes {32 * n_sources**2 / 2**30:.0f} GiB; the most are "
            f"{MAX_SOURCES} sources. Use the spectrum in its place: fit.background.floor(normal) estimates it, and "
            "fit.solve(normal, floor=…) allows for it, with any number of sources"
        )


def _read_covariance_matrix(path):
    """Read the first image of two axes of a FITS file, a NumPy array, or numbers as text, once its size is known."""
    suffix = path.suffix.lower()
    if suffix in (".fits", ".fit"):
        from astropy.io import fits

        with fits.open(path) as hdus:
            images = [unit for unit in hdus if unit.is_image and unit.header.get("NAXIS") == 2]
            images = [unit for unit in images if "NAXIS2" in unit.header]
            if not images:
                raise TableError(f"{path} holds no image of two axes")
            check_covariance_size(max(images[0].shape) // 2)
            return np.array(images[0].data, float)
    matrix = np.load(path, mmap_mode="r", allow_pickle=False) if suffix == ".npy" else np.loadtxt(path, ndmin=2)
    check_covariance_size(max(matrix.shape, default=0) // 2)
    return np.array(matrix, float)


@arguments.accepts(field=arguments.a(Field))
def of_errors(field: Field) -> Covariance:
    """The sources' own errors, which no two of them share."""
    check_covariance_size(len(field))
    (s1, s2), n = field.sigma, len(field)
    matrix = np.diag(np.concatenate([s1, s2]) ** 2)
    pairs = np.arange(n), np.arange(n) + n
    matrix[pairs] = matrix[pairs[::-1]] = field.rho * s1 * s2
    return Covariance(matrix)


@arguments.accepts(field=arguments.a(Field))
def from_function(field: Field, function: Callable[[FloatArray], FloatArray]) -> Covariance:
    """Covariance of sources at an angle θ, V(θ), with motions carried along the great circle.

    Parameters
    ----------
    field : Field
        The sources; its errors do not count: add `of_errors(field)`.
    function : function of θ [rad]
        V. [(µas/yr)²]

    Returns
    -------
    Covariance
        In the axes of the field.

    Raises
    ------
    ParameterError
        If there are more than `MAX_SOURCES`, or V is no function of θ.

    Examples
    --------
    >>> from vsh.models.covariance import LINDEGREN_2021
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 50)), rng.normal(size=(2, 50)), np.ones((2, 50)))
    >>> of_errors(field) + from_function(field, LINDEGREN_2021)
    <Covariance: 50 sources>
    """
    n = len(field)
    check_covariance_size(n)
    p, q, r = triad(field.lon, field.lat)
    matrix = np.empty((2, n, 2, n))

    def fill_block(block):
        cosines = r[:, block].T @ r
        # Half the chord keeps small angles; the cosine alone loses them.
        chord = np.linalg.norm(r[:, block, None] - r[:, None], axis=0)
        covariances = evaluate_covariance_function(function, 2 * np.arcsin(np.minimum(chord / 2, 1.0)))
        # The parallel transport of a from r to r': a − (a·r') (r + r')/(1 + r·r').
        factor = 1 / np.maximum(1 + cosines, 1e-300)
        for i, a in enumerate((p, q)):
            for j, b in enumerate((p, q)):
                transport = a[:, block].T @ b - (a[:, block].T @ r) * (r[:, block].T @ b) * factor
                matrix[i, block, j] = covariances * np.clip(transport, -1, 1)

    for _ in map_blocks(fill_block, n, max(16, 2**22 // n)):
        pass
    full_matrix = matrix.reshape(2 * n, 2 * n)
    full_matrix[n:, :n] = full_matrix[:n, n:].T
    return Covariance(full_matrix)


@arguments.accepts(field=arguments.a(Field), spectrum=arguments.a(Spectrum))
def from_spectrum(field: Field, spectrum: Spectrum, lmax: int) -> Covariance:
    """Covariance of a random field with a given spectrum, cut at a degree: A D Aᵀ.

    Parameters
    ----------
    field : Field
        The sources; its errors do not count: add `of_errors(field)`.
    spectrum : Spectrum
        Power of each kind and degree.
    lmax : int
        The highest degree.

    Raises
    ------
    ParameterError
        If there are more than `MAX_SOURCES`.
    """
    check_covariance_size(len(field))
    modes = as_modes(lmax)
    mode_rows = harmonics(field.lon, field.lat, modes).reshape(len(modes), -1)
    mode_rows *= np.sqrt(spectrum.variances(modes))[:, None]
    return Covariance(mode_rows.T @ mode_rows)


@arguments.accepts(n_sources=arguments.whole)
def from_blocks(blocks: Iterable[tuple[ArrayLike, Any]], n_sources: int) -> Covariance:
    """Covariance that is common to groups of sources: of an experiment, a station, a field of view."""
    check_covariance_size(n_sources)
    matrix = np.zeros((2 * n_sources, 2 * n_sources))
    if not isinstance(blocks, Iterable):
        raise ParameterError(f"blocks are pairs of sources and systematic errors, not {blocks!r}")
    for number, block in enumerate(blocks):
        if not isinstance(block, tuple | list) or len(block) != 2:
            raise ParameterError(f"block {number} is no pair of sources and systematic errors")
        sources, block_covariance = block
        try:
            source_rows = np.arange(n_sources)[np.asarray(sources)]
        except (IndexError, TypeError):
            raise ParameterError(f"block {number} names sources that are not among the {n_sources}") from None
        k = len(source_rows)
        if len(set(source_rows.tolist())) < k:
            raise ParameterError(f"block {number} names a source twice")
        block_matrix = float_array(f"the covariance of block {number}", block_covariance)
        if not block_matrix.ndim:
            block_matrix = np.kron(np.eye(2), np.full((k, k), block_matrix))
        if block_matrix.shape != (2 * k, 2 * k):
            raise ParameterError(
                f"block {number} has {k} sources and a covariance of shape {block_matrix.shape}, not ({2 * k}, {2 * k})"
            )
        matrix_rows = np.concatenate([source_rows, source_rows + n_sources])
        matrix[np.ix_(matrix_rows, matrix_rows)] += block_matrix
    return Covariance(matrix)


def read_covariance(path: PathName) -> Covariance:
    """A covariance from a file: NumPy's .npy, the first image of a FITS file, or numbers as text.

    Parameters
    ----------
    path : str or Path
        The file, whose (2n, 2n) matrix has all east components first. [(µas/yr)²]

    Raises
    ------
    TableError
        If it cannot be read.
    ParameterError
        If what it holds is no covariance, or too large.
    """
    try:
        matrix = _read_covariance_matrix(Path(path))
    except VshError:
        raise
    except Exception as error:  # whatever a damaged file makes of NumPy or Astropy, a tokenizer's error included
        raise TableError(f"{path} holds no matrix that can be read: {first_line(error)}") from None
    return Covariance(matrix)
