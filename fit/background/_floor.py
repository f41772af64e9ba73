"""The floor: errors of spin and acceleration that more sources do not remove."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.background._amplitude import equations_of, errors_of, fitted_degrees, is_scaled, places, words_of
from fit.background._fit import posteriors
from fit.background._likelihood import Likelihood, parity_p_value
from fit.background._parities import Parities
from fit.normal import NormalEquations, gaussian_prior
from fit.solution import HarmonicSolution, Solution
from fit.storage import Result
from vsh.io import tables
from vsh.models.covariance import Spectrum
from vsh.modes import Modes
from vsh.tools.errors import ConvergenceError, DegeneracyError, ModesError, VshError
from vsh.tools.logs import logged
from vsh.tools.types import Table


@dataclass(frozen=True, eq=False, repr=False)
class Floor(Result):
    """What the power of the higher degrees says of errors that sources share, and what it implies for degree 1.

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
        Where the errors that were used come from.
    """

    odd: float
    even: float
    odd_interval: tuple[float, float]
    even_interval: tuple[float, float]
    parity_p_value: float
    degrees: tuple[int, ...]
    noise_scale: float
    log_likelihood: float
    n_data: int
    errors_from: str = "the catalogue"

    def __repr__(self) -> str:
        return (
            f"<Floor: spin ± {self.spin_error:.3g}, acceleration ± {self.acceleration_error:.3g} µas/yr, from degrees "
            f"{words_of(self.degrees)}>"
        )

    @property
    def spin_error(self) -> float:
        """What the odd power implies for the spin in each component, √(3 s/8π). [µas/yr]"""
        return first_degree(self.odd)

    @property
    def acceleration_error(self) -> float:
        """What the even power implies for the acceleration in each component, √(3 s/8π). [µas/yr]"""
        return first_degree(self.even)

    @property
    def spin_interval(self) -> tuple[float, float]:
        """68 % interval of the spin's floor, in each component. [µas/yr]"""
        return first_degree(self.odd_interval[0]), first_degree(self.odd_interval[1])

    @property
    def acceleration_interval(self) -> tuple[float, float]:
        """68 % interval of the acceleration's floor, in each component. [µas/yr]"""
        return first_degree(self.even_interval[0]), first_degree(self.even_interval[1])

    @property
    def spectrum(self) -> Spectrum:
        """The spectrum that was found, for `sim.systematics` say."""
        return self.odd * Spectrum.odd() + self.even * Spectrum.even()

    def report(self) -> str:
        """The floor as text."""
        lines = [
            (
                f"Errors that sources share, from the power of degrees {words_of(self.degrees)} ({self.n_data // 2} "
                "sources)"
            ),
            f"{'':12}{'power of a mode [(µas/yr)²]':>34}{'68 %':>22}{'floor [µas/yr]':>18}",
        ]
        for name, value, interval, error in self._rows():
            low, high = interval
            lines.append(f"{name:14}{value:>32.4g}{f'{low:.4g} … {high:.4g}':>22}{error:>18.3f}")
        lines.append(
            f"the two parities differ with a p-value of {self.parity_p_value:.3g}; ln L gains {self.log_likelihood:.2f}"
        )
        lines.append(
            "a spectrum that rises towards degree 1, as Gaia EDR3's published one does, makes the floor too small: true"
            " errors are then 1.2, 1.5, 1.8 times those with it from degree 3, 7, 10"
        )
        if self.noise_scale != 1:
            lines.append(f"the catalogue's errors were scaled by {self.noise_scale:.4f} along with it")
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """A row for each parity as an astropy Table."""
        rows = self._rows()
        columns: dict[str, Any] = {
            "parameter": [row[0] for row in rows],
            "power": [row[1] for row in rows],
            "power_low": [row[2][0] for row in rows],
            "power_high": [row[2][1] for row in rows],
            "floor": [row[3] for row in rows],
        }
        units = dict.fromkeys(("power", "power_low", "power_high"), "uas2 / yr2") | {"floor": "uas / yr"}
        return tables.table_of(columns, {"parity_p_value": self.parity_p_value}, units)

    def plot(self, *, ax: Any = None) -> Any:
        """The two powers with their intervals on matplotlib axes."""
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
                f"the floor was estimated from degrees {words_of(self.degrees)}, and these normal equations go to "
                f"{modes.lmax}"
            )
        variances = self.spectrum.variances(modes)
        variances[~np.isin(modes.degrees, self.degrees)] = np.inf
        return gaussian_prior(modes, np.sqrt(variances))

    def allowed_for(self, solve: Callable[[NormalEquations], Any], normal: NormalEquations) -> Any:
        """The solution with this prior on the higher degrees, and with the floor in the errors of degree 1.

        Parameters
        ----------
        solve : function
            From normal equations to their solution.
        normal : NormalEquations
            Normal equations of the data.
        """
        modes, tau = normal.modes, self.noise_scale**2
        data = equations_of(normal)
        scaled = replace(data, matrix=data.matrix / tau, rhs=data.rhs / tau, chi2_null=data.chi2_null / tau)
        assumed = self.prior(modes) if normal.prior is None else self.prior(modes) + normal.prior
        solution = solve(scaled + assumed)
        covariance = np.array(solution.covariance)
        first = places(modes, (1,))
        covariance[first, first] += self.spectrum.variances(modes)[first]
        note = (
            f"coefficients of degrees {words_of(self.degrees)} are shrunk by their prior; their powers and p-values are"
            " of the fit without it"
        )
        try:
            plain = solve(normal)
            plain = replace(plain, covariance=plain.covariance * tau)
        except DegeneracyError:  # that the prior alone mends
            plain = None
        scale = "" if self.noise_scale == 1 else f" times {self.noise_scale:.4g}"
        return replace(
            solution,
            covariance=covariance,
            chi2=solution.chi2 * tau,
            unshrunk=plain,
            notes=(*solution.notes, note),
            errors_from=(
                f"{self.errors_from}{scale}, with the floor of degrees {words_of(self.degrees)}: spin ± "
                f"{self.spin_error:.3g}, acceleration ± {self.acceleration_error:.3g} µas/yr in each component"
            ),
        )

    def _rows(self):
        return [
            ("spin", self.odd, self.odd_interval, self.spin_error),
            ("acceleration", self.even, self.even_interval, self.acceleration_error),
        ]


@logged("floor")
def floor(
    normal: NormalEquations | HarmonicSolution, degrees: Iterable[int] | None = None, *, noise_scale: bool | None = None
) -> Floor:
    """Estimate errors that sources share from the power of the higher degrees, and what they do to degree 1.

    Systematics are taken for a Gaussian field with one power for each mode of either parity: T of odd and S of even
    degrees, to which a spin belongs, and T of even and S of odd ones, to which a glide does. Degree 1 is fitted freely;
    the powers are medians of the exact posterior, flat in the root of each beforehand, with the other power and the
    scale of the errors marginalised.

    Parameters
    ----------
    normal : NormalEquations or Solution
        What was summed or fitted, to degree 3 at least for a result that says much.
    degrees : iterable of int, optional
        Where to estimate; from 2 to the highest unless given. Others are fitted freely.
    noise_scale : bool, optional
        Estimate a factor on the catalogue's errors along with the powers: errors that are too small pass for
        systematics otherwise. Unless given it is, but for a solution whose errors come from residuals.

    Raises
    ------
    ModesError
        If a degree is not fitted, or degree 1 is named.
    DegeneracyError
        If the data do not determine what is fitted freely.

    Notes
    -----
    The floor extrapolates from degrees 2, 3, … to degree 1, on the assumption that each mode has the same power: a
    spectrum that rises towards low degrees makes it too small. On skies drawn from Gaia EDR3's published one
    (`vsh.models.covariance.LINDEGREN_2021`) spin and acceleration scatter by 1.18, 1.49 and 1.79 of the errors with the
    floor at degrees 3, 7 and 10, and three standard deviations hold 98, 95 and 91 %: the lower degree holds better
    there. Systematics of degrees that are not fitted leak into those that are, and make the powers larger than they
    are, not the coverage. The median of the posterior covers better than the largest likelihood where modes are few
    (degree 3: 12 of each parity). Where there is nothing it enlarges errors by 4 % at degree 7, 8 % at 4, 12 % at 3,
    and takes away what the higher degrees cost. Coverage on simulated skies: docs/backgrounds.md.

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
    equations = equations_of(normal)
    modes = equations.modes
    if degrees is None and modes.lmax < 2:
        raise ModesError("a floor is estimated from degrees 2 and higher: fit to degree 3 at least")
    degrees = fitted_degrees(modes, range(2, modes.lmax + 1) if degrees is None else degrees)
    if degrees[0] == 1:
        raise ModesError("degree 1 holds the spin and the acceleration: a floor is estimated from higher degrees")
    free = tuple(l for l in range(1, modes.lmax + 1) if l not in degrees)
    scaled = is_scaled(normal, noise_scale)
    likelihood, common = _likelihood(equations, degrees, free, scaled)
    best = likelihood.maximum()
    amplitudes, _ = posteriors(likelihood, best)
    odd, even = (amplitude.quantile(0.5, "root") for amplitude in amplitudes)
    intervals = [amplitude.interval(0.68, "root") for amplitude in amplitudes]
    return Floor(
        odd,
        even,
        intervals[0],
        intervals[1],
        parity_p_value(best.log_likelihood, common),
        degrees,
        best.noise_scale,
        best.log_likelihood,
        equations.n_data,
        errors_of(normal),
    )


#: Up to this degree the likelihood is taken as it is; beyond, expanded where the sky allows it.
_AS_IT_IS = 12


def _likelihood(equations, degrees, free, scaled):
    """ln L of the two powers, and its largest value for one power in both parities."""
    if degrees[-1] > _AS_IT_IS:
        with suppress(ConvergenceError):
            expanded = Parities(equations, degrees, free, scaled)
            return expanded, expanded.together()
    apart, one = ([Spectrum.odd(), Spectrum.even()], [Spectrum.flat()])
    together = Likelihood(equations, one, degrees, free, scaled).maximum()
    return Likelihood(equations, apart, degrees, free, scaled), together.log_likelihood


#: A floor beside a solution is estimated up to this degree: higher ones say less of degree 1, and make it too small
#: where the spectrum rises towards it.
_BESIDE = 10


def add_floor(solution: Solution) -> Solution:
    """The solution with its `floor` estimated, where its degrees determine one: its report prints it beside the errors.

    Parameters
    ----------
    solution : Solution
        Solution of motions, to degree 3 or higher and without a prior; anything else stays as it is. Degrees beyond 10
        are not asked: they take longer, and say less of degree 1.
    """
    if solution.modes.lmax < 3 or solution.unit != "µas/yr" or getattr(solution, "by_prior", None):
        return solution
    try:
        estimate = floor(solution, range(2, min(solution.modes.lmax, _BESIDE) + 1))
    except VshError:  # replicates too few for a covariance, say, or no noise at all
        return solution
    return (
        replace(solution, floor=estimate)
        if np.isfinite([*estimate.odd_interval, *estimate.even_interval]).all()
        else solution
    )


def first_degree(power: float) -> float:
    """√(3 s/8π): each component of a spin or a glide, for the power of a mode. [µas/yr]"""
    return (power * Spectrum.flat()).spin_error
