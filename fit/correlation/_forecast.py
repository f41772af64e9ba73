"""What a catalogue will tell before anybody has measured it, and weights under which parameters are uncorrelated."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from fit.correlation._matrices import FRAME_NAMES, field_from_positions, largest_correlation, named
from fit.normal import gaussian_prior, normal_equations
from fit.results.solution import Solution, at_sources
from fit.results.storage import Result, exact, number
from fit.solving import solve
from vsh.coefficients import FIRST_DEGREE, Coefficients
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import as_parts
from vsh.io.sections import Section
from vsh.models.covariance import Spectrum
from vsh.modes import KINDS, Modes, as_modes
from vsh.tools import arguments
from vsh.tools.arguments import covariance, generator
from vsh.tools.errors import ConvergenceError, FieldError, ParameterError
from vsh.tools.types import ArrayLike, Axes, BoolArray, FloatArray, Rng, Table
from vsh.vector import correlation_of


@dataclass(frozen=True, eq=False, repr=False)
class Prediction(Solution):
    """A solution without coefficients: they are nan, its covariance is that of the fit to come."""

    def __repr__(self) -> str:
        return f"<Prediction: degree {self.modes.lmax}, {self.n_sources} sources, {self.frame}>"

    @property
    def efficiency(self) -> float:
        """Share of the weight that spin and acceleration keep, against the same weight spread evenly: 0 to 1.

        The sixth root of the ratio of determinants of their normal equations of degree 1 alone.
        """
        uniform_matrix = (
            self._weight / 3 * np.eye(6)
        )  # N of degree 1 on a uniform sky: two thirds of the mean weight a source
        return float(np.exp((np.linalg.slogdet(self._alone)[1] - np.linalg.slogdet(uniform_matrix)[1]) / 6))

    @property
    def largest(self) -> tuple[float, tuple[str, str]]:
        """The largest correlation among spin and acceleration, and the pair it is of."""
        pair = named(FRAME_NAMES, self.modes)
        correlation = correlation_of(pair.covariance(self.covariance))
        return largest_correlation(correlation, pair.names)

    def _pack(self):
        columns, metadata, units = super()._pack()
        return (
            columns,
            metadata | {"weight": exact(self._weight), "alone": [[exact(x) for x in row] for row in self._alone]},
            units,
        )

    @classmethod
    def _unpack(cls, columns, metadata):
        normal_matrix = np.array([[number(x) for x in row] for row in metadata["alone"]])
        attributes: Any = {"_weight": number(metadata["weight"]), "_alone": covariance("alone", normal_matrix, 6)}
        return cls(*cls._plain(columns, metadata), **attributes)

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
    Systematic errors adds to the errors of degree 1:

    >>> quasars = Field([0.1, 2.0, 4.0], [0.3, -0.7, 0.2], np.zeros((2, 3)), np.ones((2, 3)))
    >>> alone, shared = (predict_covariance(quasars, floor=floor) for floor in (None, 4 * Spectrum.flat()))
    >>> bool(np.all(np.diag(shared.covariance) - np.diag(alone.covariance) > 1))
    True
    """
    modes = as_modes(modes)
    field = field_from_positions(sources, sigma)
    normal = normal_equations(field, modes)
    solution = _with_spectrum(normal, floor) if isinstance(floor, Spectrum) else solve(normal, floor=floor)
    # N of the six vectors, from that of the degree-1 coefficients: c = F v.
    to_coefficients = np.zeros((len(modes), 6))
    for k, kind in enumerate(KINDS):
        to_coefficients[modes.slice_of(kind, 1), 3 * k : 3 * k + 3] = FIRST_DEGREE
    return Prediction(
        Coefficients(modes, np.full(len(modes), np.nan)),
        solution.covariance,
        float("nan"),
        solution.n_data,
        solution.frame,
        solution.notes,
        "the predicted weights" + ("" if floor is None else ", with systematic errors"),
        _weight=as_parts(field).sum(_information, roles=(), words="weights"),
        _alone=to_coefficients.T @ normal.matrix @ to_coefficients,
    )


def _with_spectrum(normal, spectrum):
    """The solution with errors of a known spectrum: a prior from degree 2 on, and more of degree 1."""
    variances, degree_one = spectrum.variances(normal.modes), normal.modes.degrees == 1
    solution = solve(normal + gaussian_prior(normal.modes, np.sqrt(np.where(degree_one, np.inf, variances))))
    return replace(solution, covariance=solution.covariance + np.diag(np.where(degree_one, variances, 0.0)))


def _information(field):
    return float(field.information.sum())


@arguments.accepts(cases=arguments.a(dict))
def compare_cuts(
    sources: Any, cases: Mapping[str, Any], modes: Modes | int = 1, *, sigma: ArrayLike | None = None
) -> Table:
    """Compare the errors after cuts, masks or reweightings.

    Parameters
    ----------
    sources
        As for `predict`.
    cases : dict of str to None, mask (n,), or factors (n,) on the weights
        None takes all; a factor of zero leaves a source out.
    modes : Modes or int
        What to fit, or the degree lmax.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    astropy Table
        A row a case: sources, mean errors of spin and acceleration, worst correlation, efficiency.

    Raises
    ------
    ParameterError
        If there are no cases.
    """
    modes = as_modes(modes)
    from vsh.io import tables

    if not cases:
        raise ParameterError("there are no cases to compare")
    field = Field.from_positions(sources, sigma)
    rows = []
    for name, case in cases.items():
        prediction = predict_covariance(reweight_field(field, case), modes)
        worst, pair = prediction.largest
        rows.append(
            (
                name,
                prediction.n_sources,
                *(np.sqrt(np.mean(getattr(prediction, v).sigma ** 2)) for v in ("spin", "acceleration")),
                worst,
                " ".join(pair),
                prediction.efficiency,
            )
        )
    names = ("case", "sources", "sigma_spin", "sigma_acceleration", "largest_correlation", "of", "efficiency")
    return tables.table_of(
        dict(zip(names, zip(*rows, strict=True), strict=True)),
        units=dict.fromkeys(("sigma_spin", "sigma_acceleration"), "uas / yr"),
    )


def reweight_field(field: Field, case: ArrayLike | None) -> Field:
    """The field with a mask, or factors on its weights, or as it is."""
    if case is None:
        return field
    case = np.asarray(case)
    if case.dtype.kind not in "bif":
        raise FieldError(f"each case is None, a mask or factors on the weights, not {case.dtype}")
    if case.shape != (len(field),):
        raise FieldError(f"a mask or weights have one value a source, {len(field)}, not shape {case.shape}")
    if case.dtype == bool:
        return field[case]
    if not (np.isfinite(case) & (case >= 0)).all():
        raise FieldError("factors on weights are finite and not negative")
    selection = field[case > 0]
    return selection.with_errors(selection.sigma / np.sqrt(case[case > 0]))


@dataclass(frozen=True, eq=False)
class DownweightResult(Result):
    """Weights of each part of the sky.

    Attributes
    ----------
    keep : (12 nside²,) array
        Share of the weight of each pixel, 0 to 1; nan where there are no sources.
    factors : (n,) array
        The same for each source: factors on its weight.
    before, after : Prediction
        Predictions of degree 1.
    """

    keep: FloatArray
    factors: FloatArray
    before: Prediction
    after: Prediction

    def _sections(self, long):
        facts = [("weight kept", f"{np.nanmean(self.factors):.0%}")]
        for label, prediction in (("before", self.before), ("after", self.after)):
            value, pair = prediction.largest
            spin, acceleration = (np.sqrt(np.mean(v.sigma**2)) for v in (prediction.spin, prediction.acceleration))
            size = f"errors of spin {spin:.3g}, of acceleration {acceleration:.3g} µas/yr"
            facts.append((label, f"largest correlation {value:+.3f}, of {pair[0]} and {pair[1]}; {size}"))
        return (Section("Sources downweighted for a smaller correlation", facts),)

    def to_table(self) -> Table:
        """Share of the weight to keep in each pixel, as an astropy Table in ring order."""
        return tables.table_of({"keep": self.keep}, {"frame": self.after.frame})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The shares as a map; on matplotlib axes."""
        from fit.correlation._plot import plot_shares

        return plot_shares(self.keep, self.after.frame, ax=ax)

    def mask(self, rng: Rng) -> BoolArray:
        """Draw a mask of sources to keep, (n,), by `rng` with these shares."""
        return generator(rng).uniform(size=len(self.factors)) < self.factors


@arguments.accepts(max_correlation=arguments.number, nside=arguments.whole)
def downweight(
    sources: Any, max_correlation: float, *, nside: int = 4, sigma: ArrayLike | None = None
) -> DownweightResult:
    """Shares of the weight in each pixel that bring all correlations of spin and acceleration under a bound.

    Parameters
    ----------
    sources : Field, or positions with errors
        As for `fit.correlation.predict_covariance`.
    max_correlation : float
        Between 0 and 1.
    nside : int
        Resolution of the pixels.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Raises
    ------
    ConvergenceError
        If no weights reach the bound.

    Notes
    -----
    Minimises log det of the covariance of the six components over the shares, under
    |ρ| ≤ bound for all pairs, by sequential quadratic programming with exact derivatives.
    """
    from vsh.sky.pixels import pixels_of

    if not 0 < max_correlation < 1:
        raise ParameterError(f"a bound on correlations lies between 0 and 1, not at {max_correlation}")
    field = Field.from_positions(sources, sigma)
    pixels = pixels_of(field.lon, field.lat, nside)
    unique_pixels, index = np.unique(pixels, return_inverse=True)
    matrices = _normal_by_pixel(field, index, len(unique_pixels))
    matrices /= np.trace(matrices.sum(0)) / 6
    pairs = np.triu_indices(6, 1)

    def covariance(keep):
        return np.linalg.inv(np.tensordot(keep, matrices, 1))

    def cost(keep):
        c = covariance(keep)
        return np.linalg.slogdet(c)[1], -np.einsum("ij,kji->k", c, matrices)

    def slack(keep):
        rho = correlation_of(covariance(keep))[pairs]
        return np.concatenate([limit - rho, limit + rho])

    def slope(keep):
        c = covariance(keep)
        sigma = np.sqrt(np.diag(c))
        change = -c @ matrices @ c
        rho = correlation_of(c)
        relative = np.einsum("kii->ki", change) / np.diag(c)
        d_rho = change / np.outer(sigma, sigma) - rho / 2 * (relative[:, :, None] + relative[:, None, :])
        d_rho = d_rho[:, pairs[0], pairs[1]].T
        return np.concatenate([-d_rho, d_rho])

    # The bound is lowered step by step, each from the last solution: at once, it is often out of sight.
    keep, limit = np.full(len(unique_pixels), 0.999), np.array(max_correlation)
    largest = np.abs(correlation_of(covariance(keep))[pairs]).max()
    for bound in np.geomspace(max(largest, max_correlation), max_correlation, 12):
        limit[()] = bound
        from scipy.optimize import minimize  # slow to import

        minimum = minimize(
            cost,
            keep,
            jac=True,
            method="SLSQP",
            bounds=[(1e-6, 1.0)] * len(unique_pixels),
            constraints={"type": "ineq", "fun": slack, "jac": slope},
            options={"maxiter": 200, "ftol": 1e-8},
        )
        keep = np.clip(minimum.x, 1e-6, 1.0)
    keep[keep < 1e-5] = 0.0
    if slack(keep).min() < -1e-3:
        raise ConvergenceError(
            f"no weights bring all correlations under {max_correlation:g} ({minimum.message}): take a larger bound"
        )
    full = np.full(12 * nside**2, np.nan)
    full[unique_pixels] = keep
    return DownweightResult(
        full, keep[index], predict_covariance(field, 1), predict_covariance(reweight_field(field, keep[index]), 1)
    )


def _normal_by_pixel(field, index, count):
    """N of spin and acceleration from the sources of each pixel, (count, 6, 6)."""
    axes = np.eye(3)
    vectors = [Coefficients.from_vectors(rotation=axis) for axis in axes]
    vectors += [Coefficients.from_vectors(glide=axis) for axis in axes]
    basis = [at_sources(vector, field) for vector in vectors]
    matrices = np.empty((count, 6, 6))
    for i in range(6):
        for j in range(i + 1):
            matrices[:, i, j] = matrices[:, j, i] = np.bincount(index, field.inner(basis[i], basis[j]), count)
    return matrices
