"""Amplitudes of backgrounds, by their marginal likelihood."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from fit.background._equations import equations_of, fitted_degrees, is_scaled, words_of
from fit.background._likelihood import Likelihood
from fit.background._posterior import posteriors
from fit.harmonic import HarmonicSolution
from fit.normal import NormalEquations
from fit.storage import Result
from vsh import tables
from vsh.checks.notes import note_lines
from vsh.checks.types import FloatArray, Table
from vsh.covariance import Spectrum
from vsh.errors import ModesError


@dataclass(frozen=True, eq=False, repr=False)
class Background(Result):
    """Amplitudes of random fields of known spectra.

    Attributes
    ----------
    names : tuple of str
        Of the spectra.
    amplitudes : (k,) array
        By which the spectra are multiplied: where the likelihood is largest, none below zero.
    covariance : (k, k) array
        Of the amplitudes, from the expected information; good where an amplitude is several times its error.
    intervals : (k, 2) array
        68 %, each with the other amplitudes and the scale of the errors marginalised; from zero where zero is likely.
    noise_scale, noise_scale_error : float
        Factor on the catalogue's errors; 1 and 0 where it was not estimated.
    log_likelihood : float
        Of these amplitudes, relative to no background.
    log_evidence : float
        ln of the mean likelihood, relative to no background, for amplitudes A whose A/(A + u) is uniform beforehand, u the
        amplitude that is seen at one standard error.
    degrees, free : tuple of int
        Where the background is, and which degrees were fitted without a prior.
    n_data : int
        How many numbers were fitted.
    frame : str
    notes : tuple of str
    """

    names: tuple[str, ...]
    amplitudes: FloatArray
    covariance: FloatArray
    intervals: FloatArray
    noise_scale: float
    noise_scale_error: float
    log_likelihood: float
    log_evidence: float
    degrees: tuple[int, ...]
    free: tuple[int, ...]
    n_data: int
    frame: str = "icrs"
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        found = ", ".join(f"{name}: {value:.4g}" for name, value in zip(self.names, self.amplitudes, strict=True))
        return f"<Background: {found}; degrees {words_of(self.degrees)}>"

    @property
    def sigma(self) -> FloatArray:
        """Standard error of each amplitude, (k,)."""
        return np.sqrt(np.diag(self.covariance))

    def report(self) -> str:
        """The amplitudes as text."""
        wide = max(len(name) for name in self.names) + 2
        lines = [
            f"Backgrounds in degrees {words_of(self.degrees)} of {self.n_data // 2} sources"
            + (f", degrees {words_of(self.free)} fitted freely" if self.free else ""),
            f"{'':{wide}}{'amplitude':>24}{'68 %':>24}",
        ]
        for name, value, error, (low, high) in zip(
            self.names, self.amplitudes, self.sigma, self.intervals, strict=True
        ):
            lines.append(f"{name:{wide}}{f'{value:.4g} ± {error:.2g}':>24}{f'{low:.4g} … {high:.4g}':>24}")
        if self.noise_scale_error:
            lines.append(f"scale of the errors   {self.noise_scale:.4f} ± {self.noise_scale_error:.4f}")
        lines.append(f"relative to no background: ln L {self.log_likelihood:+.2f}, ln Z {self.log_evidence:+.2f}")
        return "\n".join([*lines, *note_lines(self.notes)]) + "\n"

    def to_table(self) -> Table:
        """A row for each spectrum as an astropy Table."""
        columns: dict[str, Any] = {
            "spectrum": list(self.names), "amplitude": self.amplitudes, "sigma": self.sigma, "low": self.intervals[:, 0],
            "high": self.intervals[:, 1],
        }  # fmt: skip
        return tables.table_of(columns, {"frame": self.frame, "n_data": self.n_data})

    def plot(self, *, ax: Any = None) -> Any:
        """The amplitudes with their intervals on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.background._plot import plot_amplitudes

        return plot_amplitudes(self, ax=ax)


def fit(
    normal: NormalEquations | HarmonicSolution,
    spectra: Spectrum | Sequence[Spectrum],
    noise_scale: bool | None = None,
    *,
    degrees: Iterable[int] | None = None,
    free: Iterable[int] = (1,),
) -> Background:
    """Estimate the amplitudes of random fields of known spectra, whatever else is fitted marginalised.

    Parameters
    ----------
    normal : NormalEquations or Solution
        What was summed or fitted.
    spectra : Spectrum or sequence of Spectrum
        One for each amplitude.
    noise_scale : bool, optional
        Estimate a factor on the catalogue's errors as well. Unless given it is, but for a solution whose errors come from
        residuals.
    degrees : iterable of int, optional
        Where the background is; all that are fitted and not free unless given.
    free : iterable of int
        Degrees that are fitted without a prior, and never shrunk. Degrees that are neither have no coefficients.

    Raises
    ------
    ModesError
        If a degree is not fitted, or is both free and of the background.
    ParameterError
        If a spectrum is negative, or has no power where it is looked for.
    DegeneracyError
        If the data do not determine what is free.

    Notes
    -----
    The likelihood is exact for Gaussian errors (that of the dense 2N × 2N covariance to 1e-10). Tried on 500 skies, ranks
    of the true amplitude are uniform.

    Examples
    --------
    >>> from fit import normal_equations
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1.5, (2, 500)), rng.normal(size=(2, 500)), np.ones((2, 500)))
    >>> found = fit(normal_equations(field, 3), [Spectrum.waves(hubble=70)])
    >>> bool(found.intervals[0, 0] == 0)
    True
    """
    equations = equations_of(normal)
    modes = equations.modes
    listed = [spectra] if isinstance(spectra, Spectrum) else spectra
    flat = fitted_degrees(modes, free, "free") if not _is_empty(free) else ()
    left = [l for l in range(1, modes.lmax + 1) if l not in flat]
    degrees = fitted_degrees(modes, left if degrees is None else degrees)
    if both := set(degrees) & set(flat):
        raise ModesError(f"degree {min(both)} is both free and of the background: name other degrees, or another free=")
    scaled = is_scaled(normal, noise_scale)
    likelihood = Likelihood(equations, listed, degrees, flat, scaled)
    best = likelihood.maximum()
    found, evidence = posteriors(likelihood, best)
    k = len(likelihood)
    error = float(np.sqrt(best.covariance[k, k]) / (2 * best.noise_scale)) if scaled else 0.0
    return Background(
        tuple(each.name for each in listed), best.amplitudes, best.covariance[:k, :k],
        np.array([each.interval(0.68) for each in found]), best.noise_scale, error, best.log_likelihood, evidence, degrees, flat,
        equations.n_data, equations.frame or "icrs", equations.notes,
    )  # fmt: skip


def _is_empty(free):
    return not isinstance(free, (int, np.integer)) and isinstance(free, Iterable) and not list(free)
