"""The likelihood of one amplitude, and what is read off it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fit.normal import NormalEquations
from fit.quality import ErrorSource
from fit.solution import HarmonicSolution, Solution
from vsh.modes import Modes
from vsh.tools.arguments import between, choice
from vsh.tools.errors import DegeneracyError, ModesError, ParameterError
from vsh.tools.notebook import Frozen
from vsh.tools.notes import spoken
from vsh.tools.types import ArrayLike, FloatArray, IntArray

#: Densities that an amplitude A is given beforehand: 1, A^−½, 1/A.
Prior: TypeAlias = Literal["flat", "root", "log"]
_POWERS = {"flat": 1, "root": 0, "log": -1}


def trapezoids(y: FloatArray, x: FloatArray) -> FloatArray:
    """The integral of y from x[0] to each x."""
    return np.concatenate([[0.0], np.cumsum((y[1:] + y[:-1]) / 2 * np.diff(x))])


@dataclass(frozen=True, eq=False)
class Amplitude(Frozen):
    """The likelihood of one amplitude, on a grid.

    Attributes
    ----------
    root : (m,) array
        √A, rising, closer to each other towards zero.
    log_likelihood : (m,) array
        Its largest value is zero.
    """

    root: FloatArray
    log_likelihood: FloatArray

    @property
    def maximum(self) -> float:
        """The likeliest amplitude, by a parabola through the three highest points."""
        i, x, y = int(np.argmax(self.log_likelihood)), self.root, self.log_likelihood
        if 0 < i < len(x) - 1:
            bend, slope, _ = np.polyfit(x[i - 1 : i + 2] - x[i], y[i - 1 : i + 2], 2)
            return float((x[i] - slope / (2 * bend)) ** 2) if bend < 0 else float(x[i] ** 2)
        return float(x[i] ** 2)

    def likelihood(self, amplitude: ArrayLike) -> FloatArray:
        """L at an `amplitude` A ≥ 0, one at its maximum and nothing beyond the grid."""
        x = np.sqrt(np.asarray(amplitude, float))
        return np.exp(np.interp(x, self.root, self.log_likelihood, left=-np.inf, right=-np.inf))

    def quantile(self, probability: float, prior: Prior = "flat", lowest: float | None = None) -> float:
        """The amplitude below which the true one lies with a probability.

        Parameters
        ----------
        probability : float
            Between 0 and 1.
        prior : {"flat", "root", "log"}
            Flat in A, in √A, or in ln A.
        lowest : float, optional
            Where a prior flat in ln A begins; it has no limit otherwise.
        """
        x, share = self._shares(prior, lowest)
        return float(np.interp(between("probability", probability, 0, 1), share, x) ** 2)

    def mean(self, prior: Prior = "flat") -> float:
        """The mean amplitude, with the `prior` of `quantile`."""
        x, mass = self._mass(prior)
        return float(trapezoids(mass * x**2, x)[-1] / trapezoids(mass, x)[-1])

    def probability_below(self, amplitude: float, prior: Prior = "flat") -> float:
        """The probability of a smaller `amplitude`, the rank of a truth, with the `prior` of `quantile`."""
        return float(np.interp(np.sqrt(amplitude), *self._shares(prior)))

    def interval(self, probability: float = 0.68, prior: Prior = "flat") -> tuple[float, float]:
        """The likeliest amplitudes that hold the true one with `probability`, with the `prior` of `quantile`.

        Returns
        -------
        tuple of two floats
            Lower and upper limit of A.
        """
        x, mass = self._mass(prior)
        dense = np.linspace(x[0], x[-1], 8 * len(x))
        mass = np.interp(dense, x, mass)
        order = np.argsort(-self.likelihood(dense**2), kind="stable")
        share = np.cumsum(mass[order]) / mass.sum()
        inside = order[: np.searchsorted(share, between("probability", probability, 0, 1)) + 1]
        return float(dense[inside.min()] ** 2), float(dense[inside.max()] ** 2)

    def _shares(self, prior, lowest=None):
        """√A and the probability below it."""
        x, mass = self._mass(prior, lowest)
        share = trapezoids(mass, x)
        return x, share / share[-1]

    def _mass(self, prior, lowest=None):
        """√A and the density of the posterior in it, not normalised."""
        power = _POWERS[choice("prior", prior, tuple(_POWERS))]
        x, density = self.root, np.exp(self.log_likelihood)
        if power >= 0:
            return x, density * x**power
        start = np.sqrt(lowest) if lowest is not None else x[-1] / 1e3
        x = np.geomspace(start, x[-1], 4 * len(self.root))
        return x, np.interp(x, self.root, density, left=density[0]) / x


def equations_of(source: Any) -> NormalEquations:
    """Normal equations of data alone: as they are less their prior, or those that a solution is the solution of."""
    source = _about(source)
    if isinstance(source, NormalEquations | HarmonicSolution) and source.modes.components != 2:
        raise ParameterError(
            "backgrounds are fields of motions: their spectra have toroidal and spheroidal parts, and a scalar field "
            "has neither"
        )
    if isinstance(source, NormalEquations):
        return source if source.prior is None else source - source.prior
    if not isinstance(source, HarmonicSolution):
        raise ParameterError(
            f"a background is fitted to normal equations or to a Solution, not to a {type(source).__name__}: "
            "fit.normal_equations(field, modes)"
        )
    if getattr(source, "by_prior", 0.0):
        raise ParameterError(
            "this solution holds a prior: give the normal equations of the data, fit.normal_equations(field, modes)"
        )
    formal = source.formal_covariance if isinstance(source, Solution) else None
    if formal is None and source.covariance_dof < len(source.modes):
        raise DegeneracyError(
            f"{source.covariance_dof + 1:.0f} replicates determine no covariance of {len(source.modes)} coefficients: "
            "take more of them, or a lower degree"
        )
    if np.isnan(source.values).any():
        raise ParameterError("a prediction holds no data to fit a background to")
    covariance = source.covariance
    if formal is not None:
        # The noise of a covariance from residuals or replicates would pass for power; its mean size has little.
        covariance = formal * np.mean(np.diag(covariance) / np.diag(formal))
    scale = np.sqrt(np.outer(np.diag(covariance), np.diag(covariance)))
    try:
        matrix = cho_solve(cho_factor(covariance / scale), np.eye(len(scale))) / scale
    except np.linalg.LinAlgError:
        raise DegeneracyError(
            "the covariance of this solution is singular: no background can be fitted to it"
        ) from None
    rhs = matrix @ source.values
    chi2_null = float(source.chi2 + rhs @ source.values)
    return NormalEquations(source.modes, matrix, rhs, chi2_null, source.n_data, source.frame, spoken(source.notes))


def errors_of(source: Any) -> tuple[str, ErrorSource]:
    """Where the errors come from, in words and as one of a few; normal equations have those of the catalogue."""
    about = _about(source)
    return (getattr(about, "errors_from", "the catalogue"), getattr(about, "error_source", ErrorSource.CATALOGUE))


def is_scaled(source: Any, noise_scale: bool | None) -> bool:
    """Whether the scale of the errors is estimated: as told, or where the errors are the catalogue's."""
    scaled = choice("noise_scale", noise_scale, (None, True, False))
    return errors_of(source)[1] == ErrorSource.CATALOGUE if scaled is None else scaled


def fitted_degrees(modes: Modes, degrees: Any, name: str = "degrees") -> tuple[int, ...]:
    """Degrees that are among those fitted, in order, each once."""
    try:
        listed = list(degrees) if isinstance(degrees, Iterable) else [degrees]
        chosen = sorted({int(degree) for degree in listed if int(degree) == degree})
    except (TypeError, ValueError, OverflowError, np.ma.MaskError):
        chosen = []
    if not chosen or len(chosen) != len(set(listed)):
        raise ModesError(f"{name} must be whole numbers from 1 on, one at least, not {degrees!r}")
    missing = [each for each in chosen if not 1 <= each <= modes.lmax]
    if missing:
        raise ModesError(f"degree {missing[0]} is not fitted: these normal equations go from degree 1 to {modes.lmax}")
    return tuple(chosen)


def places(modes: Modes, degrees: Iterable[int]) -> IntArray:
    """Where the coefficients of some degrees are stored."""
    return np.flatnonzero(np.isin(modes.degrees, list(degrees)))


def words_of(degrees: Sequence[int]) -> str:
    """Degrees as a reader sees them: "2, 3", "2 to 7"."""
    degrees = list(degrees)
    if len(degrees) > 2 and degrees == list(range(degrees[0], degrees[-1] + 1)):
        return f"{degrees[0]} to {degrees[-1]}"
    return ", ".join(map(str, degrees))


def _about(source):
    return getattr(source, "resampled_solution", getattr(source, "solution", source))
