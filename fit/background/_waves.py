"""The limit on a stochastic background of gravitational waves."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fit.background._amplitude import Amplitude, compute_posteriors_and_evidence
from fit.background._likelihood import (
    Likelihood,
    check_degrees,
    compute_parity_p_value,
    equations_of,
    find_coefficient_indices,
    format_degrees,
    should_fit_scale,
)
from fit.normal import NormalEquations
from fit.results.solution import Solution
from fit.results.storage import Result
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.models.covariance import Spectrum
from vsh.tools.arguments import between, choice, positive
from vsh.tools.digits import format_p_value
from vsh.tools.errors import ModesError, ParameterError
from vsh.tools.types import ArrayLike, Axes, FloatArray, Table
from vsh.tools.units import JULIAN_YEAR, hubble_rate

#: km in a megaparsec.
MPC = 3.0856775814913673e19
#: What each prior takes for equally likely, in words.
PRIOR_TITLES = {"flat": "exact likelihood, flat in Ω", "root": "exact likelihood, flat in √Ω",
         "coefficients": "coefficients flat: quantile of (6/5) P_2/(4π H0²)"}  # fmt: skip


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class WaveLimit(Result):
    """Limit on h70² Ω_GW, the energy in waves longer than the observations.

    Attributes
    ----------
    amplitude : Amplitude
        The likelihood of h70² Ω, on a grid.
    degrees : tuple of int
        Which were used.
    hubble : float
        H0 for which Ω is meant; 70 makes it h70² Ω. [km/s/Mpc]
    systematics : tuple of str
        Spectra whose amplitudes were marginalised.
    noise_scale : float
        The likeliest factor on the catalogue's errors.
    power, noise_power : float
        P_2 as fitted, T and S together, and what noise gives on average. [(µas/yr)²]
    squares : (2, m) array
        Variances and shifts of the squares whose sum P_2 is, for coefficients that are equally likely a priori.
        [(µas/yr)², none]
    parity_p_value : float
        Probability of P_T2 and P_S2 as different as they are, where they are the same on average.
    n_data : int
        How many numbers were fitted.
    notes : tuple of str
    years : float, optional
        T, over which the motions were measured, for the band of frequency and the strain in the report. [yr]
    """

    amplitude: Amplitude
    degrees: tuple[int, ...]
    hubble: float
    systematics: tuple[str, ...]
    noise_scale: float
    power: float
    noise_power: float
    squares: FloatArray
    parity_p_value: float
    n_data: int
    notes: tuple[str, ...] = ()
    years: float | None = None

    def __repr__(self) -> str:
        return f"<WaveLimit: h70² Ω < {self.limit():.3g} (95 %, flat in Ω), {self._degrees_in_words}>"

    @property
    def _degrees_in_words(self):
        """The degrees that the limit is from, in words."""
        return f"degree{'s' * (len(self.degrees) > 1)} {format_degrees(self.degrees)}"

    @property
    def maximum(self) -> float:
        """The likeliest Ω."""
        return self.amplitude.maximum

    @property
    def interval(self) -> tuple[float, float]:
        """The 68 % of likeliest Ω, for a prior flat in Ω; from zero where zero is likely."""
        return self.amplitude.interval(0.68)

    def likelihood(self, omega: ArrayLike) -> FloatArray:
        """L(Ω) at `omega` ≥ 0, one at its maximum, the scale of the errors and the systematics marginalised."""
        return self.amplitude.likelihood(omega)

    def limit(
        self,
        probability: float = 0.95,
        prior: Literal["flat", "root", "log", "coefficients"] = "flat",
        *,
        lowest: float | None = None,
    ) -> float:
        """The Ω below which the true one lies with a probability.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        prior : {"flat", "root", "log", "coefficients"}
            Flat in Ω; in √Ω, the amplitude of the waves; in ln Ω; or in each coefficient of degree 2, as in most
            published limits. The last is not a prior on Ω: it gives a limit on the power that is realised on this one
            sky.
        lowest : float, optional
            Where the prior flat in ln Ω begins, on which that limit depends; a millionth of the largest Ω unless given.

        Raises
        ------
        ParameterError
            If the probability is not between 0 and 1, if the prior is unknown, or if the data do not determine degree
            2.
        """
        probability = between("probability", probability, 0, 1)
        if choice("prior", prior, ("flat", "root", "log", "coefficients")) != "coefficients":
            return self.amplitude.quantile(probability, prior, lowest)  # type: ignore[arg-type]
        if not np.isfinite(self.squares).all():
            raise ParameterError("the data do not determine every coefficient of degree 2: take another prior")
        return float(1.2 * find_sum_quantile(probability, *self.squares) / (4 * np.pi * hubble_rate(self.hubble) ** 2))

    def frequency(self, years: float) -> float:
        """The upper edge of the band, 1/T. [Hz]

        Parameters
        ----------
        years : float
            T, over which the motions were measured. [yr]
        """
        return 1 / (positive("years", years) * JULIAN_YEAR)

    def strain(self, years: float, probability: float = 0.95, prior: Literal["flat", "root"] = "flat") -> float:
        """The limit as the characteristic strain of waves at the upper edge of the band, h_c = √(3Ω/2) H0/(π f).

        Parameters
        ----------
        years : float
            T, over which the motions were measured. [yr]
        probability, prior
            As for `limit`.
        """
        rate = self.hubble / MPC
        return float(np.sqrt(1.5 * self.limit(probability, prior)) * rate / (np.pi * self.frequency(years)))

    @property
    def answer(self) -> Answer:
        """The line to quote: the limit on the energy in waves."""
        name = "h70² Ω" if self.hubble == 70 else "Ω"
        return Answer((("waves", f"{name} < {self.limit():.3g} (95 %, flat in Ω), {self._degrees_in_words}"),))

    def _sections(self, long):
        lower, upper = self.interval
        name = "h70² Ω" if self.hubble == 70 else "Ω"
        has_limit = {prior: prior != "coefficients" or np.isfinite(self.squares).all() for prior in PRIOR_TITLES}
        limits: list[Any] = [self.limit(0.95, prior) if has_limit[prior] else np.nan for prior in PRIOR_TITLES]  # type: ignore[arg-type]
        p_value_text = format_p_value(self.parity_p_value)
        systematics_phrase = f"; marginalised: systematics, {', '.join(self.systematics)}" if self.systematics else ""
        band_phrase = "f < 1/T with T the time over which the motions were measured"
        if self.years is not None:
            band_phrase = f"f < 1/T = {self.frequency(self.years) * 1e9:.3g} nHz (T = {self.years:g} yr)"
            band_phrase += f"; if all of it is there, h_c < {self.strain(self.years):.2e} (95 %, flat in Ω)"
        facts = [
            ("from", f"{self._degrees_in_words}; {self.n_data // 2} sources"),
            ("likeliest", f"{self.maximum:.4g} ({lower:.4g} … {upper:.4g}, 68 %, flat in Ω)"),
            ("P_2", f"{self.power:.4g} (µas/yr)², of which noise gives {self.noise_power:.4g} on average"),
            ("parity", f"P_T2 and P_S2, equal for waves, differ with a p-value of {p_value_text}"),
            ("errors", f"scaled by {self.noise_scale:.4g}{systematics_phrase}"),
            ("band", band_phrase),
        ]
        table = tables.table_of({"prior": list(PRIOR_TITLES.values()), f"{name} below (95 %)": limits})
        return (Section(f"Gravitational waves longer than the observations: {name}", facts, table, notes=self.notes),)

    def to_table(self) -> Table:
        """The likelihood of Ω as an astropy Table."""
        columns = {"omega": self.amplitude.root**2, "log_likelihood": self.amplitude.log_likelihood}
        return tables.table_of(columns, {"hubble": self.hubble, "n_data": self.n_data})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The posteriors of Ω with their limits on matplotlib axes."""
        from fit.background._plot import plot_wave_limit

        return plot_wave_limit(self, ax=ax)


def wave_limit(
    normal: NormalEquations | Solution,
    degrees: Iterable[int] = (2,),
    *,
    hubble: float = 70.0,
    noise_scale: bool | None = None,
    systematics: Sequence[Spectrum] | None = None,
) -> WaveLimit:
    """The posterior of the energy in gravitational waves that are longer than the observations.

    Parameters
    ----------
    normal : NormalEquations or Solution
        What was summed or fitted, to degree 2 at least. Degrees above the highest named are left out; those below it
        that are not named, degree 1 among them, are fitted freely.
    degrees : iterable of int
        Degrees in which waves are looked for. In general relativity degree 2 has 5/6 of the power. Higher degrees add
        little signal, and systematic errors that can be mistaken for waves.
    hubble : float
        H0 for which Ω is meant; the default gives h70² Ω. [km/s/Mpc]
    noise_scale : bool, optional
        Whether to marginalise over a factor on the errors. Default: yes for normal equations and for solutions with the
        catalogue's errors, no for all others.
    systematics : sequence of Spectrum, optional
        Backgrounds whose amplitudes are marginalised: one flat spectrum where degrees beyond 2 are used, none for
        degree 2 alone, unless given.

    Raises
    ------
    ModesError
        If a degree is not fitted, or degree 1 is named.
    DegeneracyError
        If the data do not determine what is fitted freely.

    Notes
    -----
    Book & Flanagan (2011, PhRvD 83, 024024) give the spectrum; the likelihood is exact for Gaussian errors of the size
    quoted, up to a factor: ranks of 500 known Ω are uniform. Where errors are wrong from source to source, clip or fit
    robustly first (`fit.robust.student_t`) and give that solution: in simulations without waves and with errors four
    times too small on half of the sky, the 95 % interval excludes zero on 4 % of the skies, and on 9 % for plain normal
    equations. A scalar wave appears only in degree 1, where it cannot be separated from the acceleration, so that no
    limit on it is given.
    """
    equations = equations_of(normal)
    degrees = check_degrees(equations.modes, degrees)
    if degrees[0] < 2:
        raise ModesError("gravitational waves have no power in degree 1: name degrees from 2 on")
    fit_scale = should_fit_scale(normal, noise_scale)
    free_degrees = tuple(l for l in range(1, degrees[-1]) if l not in degrees)
    backgrounds = list(systematics) if systematics is not None else [Spectrum.flat()] if degrees != (2,) else []
    likelihood = Likelihood(equations, [Spectrum.waves(hubble), *backgrounds], degrees, free_degrees, fit_scale)
    maximum = likelihood.find_maximum()
    (amplitude,), _ = compute_posteriors_and_evidence(likelihood, maximum, [0])
    # In degree 2 alone the odd spectrum is that of S, and the even one that of T.
    separate_maximum, common_maximum = (
        Likelihood(equations, spectra, (2,), (1,), fit_scale).find_maximum()
        for spectra in ([Spectrum.odd(), Spectrum.even()], [Spectrum.flat()])
    )
    power, noise_power, squares = fit_quadrupole(equations, degrees[-1], fit_scale)
    return WaveLimit(
        amplitude=amplitude,
        degrees=degrees,
        hubble=float(hubble),
        systematics=tuple(background.name for background in backgrounds),
        noise_scale=maximum.noise_scale,
        power=power,
        noise_power=noise_power,
        squares=squares,
        parity_p_value=compute_parity_p_value(separate_maximum.log_likelihood, common_maximum.log_likelihood),
        n_data=equations.n_data,
        notes=equations.notes,
    )


#: Accuracy of a probability.
_PROBABILITY_ACCURACY = 1e-7


def compute_probability_above(x: float, variances: FloatArray, shifts: FloatArray) -> float:
    """P(Σ λ_i (z_i + δ_i)² > x) with z_i ~ N(0, 1): Imhof (1961, Biometrika 48, 419), eq. 3.2."""
    scale = variances.max()
    ratio, x = variances / scale, x / scale

    def compute_integrand(u):
        y = ratio * u
        inner = 1 + y * y
        angle = np.sum(np.arctan(y) + shifts**2 * y / inner) / 2 - x * u / 2
        log_rho = np.sum(np.log(inner) / 4 + shifts**2 * y * y / inner / 2)
        return np.sin(angle) / u * np.exp(-log_rho)

    from scipy.integrate import quad  # slow to import

    # What is left beyond the end: at most 1/(π k U^k √Πr) with k = n/2 (his eq. 3.4).
    k = len(ratio) / 2
    upper_limit = np.exp(-(np.log(np.pi * k * _PROBABILITY_ACCURACY) + np.sum(np.log(ratio)) / 2) / k)
    integral, _ = quad(compute_integrand, 0, upper_limit, limit=2000, epsabs=_PROBABILITY_ACCURACY)
    return float(np.clip(0.5 + integral / np.pi, 0, 1))


def find_sum_quantile(probability: float, variances: FloatArray, shifts: FloatArray) -> float:
    """The value below which Σ λ_i (z_i + δ_i)² lies with a probability."""
    from scipy.optimize import brentq  # slow to import

    mean = np.sum(variances * (1 + shifts**2))
    standard_deviation = np.sqrt(np.sum(2 * variances**2 * (1 + 2 * shifts**2)))
    upper = mean + 3 * standard_deviation
    while compute_probability_above(upper, variances, shifts) > 1 - probability:
        upper += 3 * standard_deviation
    return float(
        brentq(lambda x: 1 - probability - compute_probability_above(x, variances, shifts), 0, upper, xtol=1e-9 * upper)
    )


def fit_quadrupole(equations: NormalEquations, lmax: int, is_scaled: bool) -> tuple[float, float, FloatArray]:
    """P_2, its noise, variances and shifts of its terms, (2, 10), fitted with all degrees to lmax, or nan."""
    modes = equations.modes
    indices = find_coefficient_indices(modes, range(1, lmax + 1))
    matrix, rhs = equations.matrix[np.ix_(indices, indices)], equations.rhs[indices]
    quadrupole = np.flatnonzero(modes.degrees[indices] == 2)
    if equations.n_data <= len(indices) or np.linalg.cond(matrix) > 1e12:
        return float("nan"), float("nan"), np.full((2, len(quadrupole)), np.nan)
    covariance = np.linalg.inv(matrix)
    values = covariance @ rhs
    scale2 = (equations.chi2_null - values @ rhs) / (equations.n_data - len(indices)) if is_scaled else 1.0
    root = np.sqrt(modes.norm2[indices][quadrupole])
    variances, vectors = np.linalg.eigh(scale2 * covariance[np.ix_(quadrupole, quadrupole)] * np.outer(root, root))
    shifts = vectors.T @ (root * values[quadrupole]) / np.sqrt(variances)
    return float(np.sum(variances * shifts**2)), float(variances.sum()), np.array([variances, shifts])
