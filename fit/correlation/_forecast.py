"""What a catalogue will tell before anybody has measured it, and weights under which parameters are uncorrelated."""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fit.correlation._matrices import FRAME_NAMES, field_from_positions, find_largest_correlation, select_parameters
from fit.normal import gaussian_prior, normal_equations, solve
from fit.results.solution import Solution
from fit.results.storage import from_hex, to_hex
from vsh.coefficients import FIRST_DEGREE, Coefficients
from vsh.io.parts import as_parts
from vsh.models.covariance import Spectrum
from vsh.modes import KINDS, Modes, as_modes
from vsh.tools.arguments import covariance
from vsh.tools.types import ArrayLike, FloatArray
from vsh.vector import correlation_of


@dataclass(frozen=True, eq=False, repr=False, kw_only=True)
class Prediction(Solution):
    """A solution without coefficients: they are nan, its covariance is that of the fit to come."""

    def __repr__(self) -> str:
        return f"<Prediction: degree {self.modes.lmax}, {self.n_sources} sources, {self.frame}>"

    @property
    def efficiency(self) -> float:
        """Share of the weight that spin and acceleration keep, against the same weight spread evenly: 0 to 1.

        The sixth root of the ratio of determinants of their normal equations of degree 1 alone.
        """
        # N of degree 1 on a uniform sky: two thirds of the mean weight a source.
        uniform_matrix = self._weight / 3 * np.eye(6)
        return float(np.exp((np.linalg.slogdet(self._alone)[1] - np.linalg.slogdet(uniform_matrix)[1]) / 6))

    @property
    def largest(self) -> tuple[float, tuple[str, str]]:
        """The largest correlation among spin and acceleration, and the pair it is of."""
        parameters = select_parameters(FRAME_NAMES, self.modes)
        return find_largest_correlation(correlation_of(parameters.covariance(self.covariance)), parameters.names)

    def _pack(self):
        columns, metadata, units = super()._pack()
        alone = [[to_hex(x) for x in row] for row in self._alone]
        return columns, metadata | {"weight": to_hex(self._weight), "alone": alone}, units

    @classmethod
    def _unpack(cls, columns, metadata):
        normal_matrix = np.array([[from_hex(x) for x in row] for row in metadata["alone"]])
        attributes: Any = {"_weight": from_hex(metadata["weight"]), "_alone": covariance("alone", normal_matrix, 6)}
        return cls(**cls._decode_attributes(columns, metadata), **attributes)

    # What `predict` found on the way: total weight Σ tr W, and N of spin and acceleration alone.
    _weight: float = 0.0
    _alone: FloatArray = field(default_factory=lambda: np.eye(6))


def predict_covariance(
    sources: Any, modes: Modes | int = 1, *, sigma: ArrayLike | None = None, floor: Any = None
) -> Prediction:
    """The covariance that a fit to these sources would have.

    Parameters
    ----------
    sources : Field, Parts, Population, or anything with lon and lat [rad], and perhaps sigma, rho, frame
        Their positions and errors; motions are not used.
    modes : Modes, or the degree lmax
        What to fit.
    sigma : float, (2, n) array or None
        Errors in place of the sources' own [µas/yr]; needed where they have none.
    floor : Floor or Spectrum, optional
        Errors that sources will share: what `fit.background.floor` found in another catalogue, with its shapes, or a
        spectrum of their power. It is a prior on degrees 2 and up, and part of the errors of degree 1.

    Returns
    -------
    Prediction
        A Solution whose coefficients and χ² are nan.

    Raises
    ------
    DegeneracyError
        If the sources cannot separate the modes.
    ModesError
        If the floor was estimated from degrees that are not fitted.

    Examples
    --------
    Systematic errors add to the errors of degree 1:

    >>> from vsh import Field
    >>> quasars = Field([0.1, 2.0, 4.0], [0.3, -0.7, 0.2], np.zeros((2, 3)), np.ones((2, 3)))
    >>> alone, shared = (predict_covariance(quasars, floor=floor) for floor in (None, 4 * Spectrum.flat()))
    >>> bool(np.all(np.diag(shared.covariance) - np.diag(alone.covariance) > 1))
    True
    """
    modes = as_modes(modes)
    field = field_from_positions(sources, sigma)
    normal = normal_equations(field, modes)
    if isinstance(floor, Spectrum) or floor is None:
        solution = solve(normal) if floor is None else _solve_with_spectrum(normal, floor)
    else:  # the errors of these sources are not those of the other catalogue
        floor_parts = [replace(part, noise_scale=1.0) for part in floor.parts]
        solution = solve(normal, floor=replace(floor, noise_scale=1.0, parts=tuple(floor_parts)))
    # N of the six vectors, from that of the degree-1 coefficients: c = F v.
    transformation = np.zeros((len(modes), 6))
    for k, kind in enumerate(KINDS):
        transformation[modes.slice_of(kind, 1), 3 * k : 3 * k + 3] = FIRST_DEGREE
    return Prediction(
        coefficients=Coefficients(modes, np.full(len(modes), np.nan)),
        covariance=solution.covariance,
        chi2=float("nan"),
        n_data=solution.n_data,
        frame=solution.frame,
        notes=solution.notes,
        errors_from="the predicted weights" + ("" if floor is None else ", with systematic errors"),
        _weight=as_parts(field).sum(_sum_information, roles=(), words="weights"),
        _alone=transformation.T @ normal.matrix @ transformation,
    )


def _solve_with_spectrum(normal, spectrum):
    """The solution with errors of a known spectrum: a prior from degree 2 on, and more of degree 1."""
    variances, is_degree_one = spectrum.variances(normal.modes), normal.modes.degrees == 1
    solution = solve(normal + gaussian_prior(normal.modes, np.sqrt(np.where(is_degree_one, np.inf, variances))))
    return replace(solution, covariance=solution.covariance + np.diag(np.where(is_degree_one, variances, 0.0)))


def _sum_information(field):
    return float(field.information.sum())
