"""The sources that a referee looks at, their classes, and how the acceleration moves with what should not matter.

That is the degree, the way outliers are met, a single source.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import block_diag
from scipy.special import chdtrc, fdtrc

from fit.background import ClassComparison, Floor, Verdict, extend_degrees, shared
from fit.methods import Recommended, degree_for, recommended
from fit.normal import NormalEquations, Template, fit_field, normal_equations, solve
from fit.results.quality import gls
from fit.results.solution import Solution
from fit.robust import ClippedFit, clip, student_t
from vsh.basis import harmonics
from vsh.classes import Classes
from vsh.coefficients import FIRST_DEGREE
from vsh.field import Field
from vsh.io import catalogue, tables
from vsh.tools.arguments import generator
from vsh.tools.errors import ConvergenceError, DegeneracyError, TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import FloatArray, Rng

#: Columns that checks split the sources by, of Gaia's archive and of tables of VLBI: the first that is there.
_COLUMNS = {
    "colour": ("nu_eff_used_in_astrometry", "bp_rp", "pseudocolour", "bp_g"),
    "visibility periods": ("visibility_periods_used", "n_epoch"),
    "transits": ("matched_transits", "astrometric_matched_transits", "astrometric_n_good_obs_al"),
    "scan strength": ("scan_direction_strength_k2",),
    "scan direction": ("scan_direction_mean_k2",),
    "RUWE": ("ruwe",),
    "last epoch": ("mjd_last",),
    "parameters solved": ("astrometric_params", "astrometric_params_solved"),
}
#: The highest degree of the headline: higher ones tell less of degree 1.
_HEADLINE_DEGREE = 7
_KAPPA = 3.0


@dataclass(frozen=True, eq=False)
class Quasars(InNotebook):
    """Sources, clipped, and what is known of each.

    Attributes
    ----------
    field : Field
        Those that stay after clipping.
    columns : dict of str to (n,) array
        Numbers of each, by what they mean; nan where nothing is known.
    names : dict of str to str
        The column of the table that each is.
    label : str
        Where they are from.
    n_clipped : int
        How many were left out.
    whole : Field
        All of them.
    """

    field: Field
    columns: Mapping[str, FloatArray]
    names: Mapping[str, str]
    label: str
    n_clipped: int
    whole: Field

    @classmethod
    def of(cls, field: Field, columns: Mapping[str, Any], names: Mapping[str, str], label: str) -> "Quasars":
        """Clip the sources to the degree they bear.

        Parameters
        ----------
        field : Field
            All sources.
        columns : dict of str to (n,) array
            Numbers of each, by what they mean.
        names : dict of str to str
            The column of the table that each is.
        label : str
            Where they are from.
        """
        clipped_fit = clip_quasars(field)
        is_kept = clipped_fit.kept
        values = {name: np.asarray(column, float)[is_kept] for name, column in columns.items()}
        return cls(field[is_kept], values, names, label, clipped_fit.n_clipped, field)

    def column(self, name: str) -> FloatArray:
        """Numbers of a column, (n,).

        Parameters
        ----------
        name : str
            What it means: "colour", say.

        Raises
        ------
        TableError
            If it is not there; it says what it might be called.
        """
        if name not in self.columns or not np.isfinite(self.columns[name]).any():
            candidates = {"redshift": ("redshift", "z", "redshift_qsoc"), "G": ("phot_g_mean_mag",)} | _COLUMNS
            raise TableError(f"there is no column for {name} ({', '.join(candidates[name])})")
        return self.columns[name]

    @property
    def degree(self) -> int:
        """Highest degree from which systematic errors are estimated."""
        return degree_for(len(self.field), _HEADLINE_DEGREE)

    @cached_property
    def normal(self) -> NormalEquations:
        """Normal equations of all that stay, to `degree`."""
        return normal_equations(self.field, self.degree)

    @cached_property
    def recommended(self) -> Recommended:
        """The recommended fit of all sources, none clipped."""
        return recommended(self.whole)

    @property
    def is_scaled(self) -> bool:
        """Return whether χ² scales the errors of `equations`: not where a robust fit has settled."""
        return self.recommended.weights is None

    def equations(self, chosen: Any, lmax: int, *, templates: Sequence[Template] = ()) -> NormalEquations:
        """Sum those `chosen` to degree `lmax`, with `templates`, by the weights of the recommended fit."""
        return self.recommended.equations(self.field[chosen], lmax, templates=templates)

    def plain_equations(self, chosen: Any, lmax: int) -> NormalEquations:
        """Sum those `chosen` to degree `lmax` with formal errors, as published analyses do."""
        return normal_equations(self.field[chosen], lmax)


def clip_quasars(field: Field) -> ClippedFit:
    """Clip at κ = 3 to degree 3, or what few sources bear; where that oscillates, at the limit of a first fit."""
    lmax = degree_for(len(field), 3)
    try:
        return clip(field, lmax, _KAPPA)
    except ConvergenceError:
        whitened_residuals = fit_field(field, lmax).residuals(field).whitened
        return clip(field, lmax, threshold=_KAPPA * float(np.median(np.sqrt(np.sum(whitened_residuals**2, 0)))))


def read_quasars(source: Any, *, axes: str = "icrs", **reading: Any) -> Quasars:
    """Read what a referee looks at.

    Parameters
    ----------
    source : path or table
        As for `vsh.io.catalogue.read_field`.
    axes : str
        Those of all results: "icrs", "galactic" or "ecliptic".
    **reading
        Its arguments: columns, units, on_bad, frame, where, format.

    Returns
    -------
    Quasars
        Clipped at κ = 3; columns that are not there are left out.

    Raises
    ------
    TableError
        If a column that is needed is missing.
    FieldError
        If no source, or not every one, can be used.
    DegeneracyError
        If there are fewer than a dozen.
    """
    table_source = tables.open_table(source, reading.pop("format", None))
    field = catalogue.read_field(table_source, **reading, roles=("name", "redshift", "magnitude")).to_frame(axes)
    present = {meaning: [name for name in names if name in table_source.names] for meaning, names in _COLUMNS.items()}
    names = {meaning: column_names[0] for meaning, column_names in present.items() if column_names}
    read_columns = catalogue.read_columns(table_source, names.values(), **reading)
    columns = {meaning: read_columns[name] for meaning, name in names.items()}
    for meaning, values in (("redshift", field.redshift), ("G", field.magnitude)):
        if values is not None:
            columns[meaning] = np.asarray(values, float)
    return Quasars.of(field, columns, names, table_source.label)


#: What classes share is looked for to this degree, in no class of fewer sources.
_CLASS_DEGREE, MIN_CLASS_SIZE = 5, 100
#: Draws of the systematic errors, repeated where few have weight: p-values of 200 and of 800 differ by a tenth.
_N_DRAWS = 200
#: Skies behind a p-value, which is multiplied by the number of checks: 1/40 000 is the smallest.
_N_SKIES = 40_000


@dataclass(frozen=True, eq=False)
class Comparison(InNotebook):
    """Classes: each fitted alone with formal errors, and all with systematic errors."""

    plain: list[Solution]
    shared: ClassComparison

    @cached_property
    def verdict(self) -> Verdict:
        """The largest difference after allowing for all, by skies enough for one p-value among many."""
        return self.shared.verdict(_N_SKIES)

    def formal_p_value(self, kind: str | None = None) -> float:
        """p-value of spins ("T"), accelerations ("S") or both that are alike, with formal errors and nothing shared."""
        component_slice = {None: slice(0, 6), "T": slice(0, 3), "S": slice(3, 6)}[kind]
        degree_one_fits = [select_degree_coefficients(solution, 1) for solution in self.plain]
        values = np.array([value[component_slice] for value, _ in degree_one_fits])
        covariance = block_diag(*(covariance[component_slice, component_slice] for _, covariance in degree_one_fits))
        chi2 = gls(values, covariance, np.ones((len(values), 1)))[1]
        return float(chdtrc(values.size - values.shape[1], chi2))


def select_degree_coefficients(solution: Solution, degree: int) -> tuple[FloatArray, FloatArray]:
    """Coefficients of one degree of a solution, and their covariance."""
    indices = np.flatnonzero(solution.modes.degrees == degree)
    return solution.values[indices], solution.covariance[np.ix_(indices, indices)]


def compare_classes(quasars: Quasars, classes: Classes, rng: Rng = 1, lmax: int | None = None) -> Comparison:
    """Compare classes of sources, each with formal errors, and all with systematic errors.

    Parameters
    ----------
    quasars : Quasars
        The sources.
    classes : Classes
        The classes, as masks of the sources.
    rng : Generator or int
        The source of all randomness.
    lmax : int, optional
        Degree of the fits with formal errors. Unless given, it is that of the other fits: the highest degree that the
        smallest class has enough sources for, 5 at most.

    Raises
    ------
    DegeneracyError
        If fewer than two classes have enough sources.
    """
    eligible = classes.of_at_least(MIN_CLASS_SIZE)
    if len(eligible) < 2:
        counts = ", ".join(f"{name}: {mask.sum()}" for name, mask in classes)
        raise DegeneracyError(f"fewer than two classes have {MIN_CLASS_SIZE} sources or more ({counts})")
    degree = degree_for(min(mask.sum() for _, mask in eligible), _CLASS_DEGREE, least=3, per_mode=4)
    normals = [quasars.equations(mask, degree) for _, mask in eligible]
    plain_solutions = [solve(quasars.plain_equations(mask, lmax or degree)) for _, mask in eligible]
    extensions = extend_degrees(normals, quasars.equations, [mask for _, mask in eligible])
    comparison = shared(
        extensions, range(2, degree + 1), labels=eligible.labels, draws=_N_DRAWS, noise_scale=quasars.is_scaled, rng=rng
    )
    return Comparison(plain_solutions, comparison)


#: Random parts of the sources, and the least number in each.
_N_GROUPS, _MIN_GROUP_SIZE = 20, 60
#: Sources that are looked at together.
_BLOCK_SIZE = 20_000
#: Angles that the probability of a quadratic form of two normal numbers is averaged over.
_COSINES = np.cos((np.arange(32) + 0.5) * np.pi / 32) ** 2


def find_degree_shift(field: Field, low: int, high: int, floor: Floor | None) -> tuple[FloatArray, FloatArray, float]:
    """Measure how the acceleration moves from a fit of `low` to one of `high`.

    Both are linear in the same data: with M the matrix of one less the other, the move M b has the covariance
    M (τ² N + s² N₂ + N S N) Mᵀ: τ² and s² the scatter of the residuals, which holds what lies beyond the higher degree,
    N₂ the normal matrix with squared weights, S the spectrum of systematic errors.

    Parameters
    ----------
    field : Field
        The sources.
    low, high : int
        The degrees.
    floor : Floor, optional
        Systematic errors; errors are as quoted, up to one factor, unless given.

    Returns
    -------
    (3,) array, (3,) array, float
        The move and its errors [µas/yr], and its p-value.
    """
    normal = normal_equations(field, high)
    modes = normal.modes
    indices = np.flatnonzero(modes.degrees <= low)
    rows = np.arange(len(modes))[modes.slice_of("S", 1)]
    high_estimator, low_estimator = np.linalg.inv(normal.matrix)[rows], np.zeros((3, len(modes)))
    low_estimator[:, indices] = np.linalg.inv(normal.matrix[np.ix_(indices, indices)])[np.searchsorted(indices, rows)]
    m = np.linalg.inv(FIRST_DEGREE) @ (high_estimator - low_estimator)
    solution = solve(normal)
    if floor is None:
        noise = normal.matrix * solution.quality.factor**2
    else:
        scale, excess_variance = _fit_scale_and_excess_variance(solution.residuals(field))
        noise = scale * normal.matrix + excess_variance * normal_equations(_square_covariance(field), high).matrix
        noise = noise + normal.matrix @ np.diag(floor.spectrum.variances(modes)) @ normal.matrix
    move, covariance = m @ normal.rhs, m @ noise @ m.T
    chi2 = move @ np.linalg.pinv(covariance, hermitian=True) @ move
    return move, np.sqrt(np.diag(covariance)), float(chdtrc(3, chi2))


def _square_covariance(field):
    """The sources with the square of each covariance for a covariance: weights W² in place of W."""
    (s1, s2), rho = field.sigma, field.rho
    v1, v2, c = s1**2, s2**2, rho * s1 * s2
    p, q, r = v1**2 + c**2, v2**2 + c**2, c * (v1 + v2)
    return field.with_errors(np.sqrt([p, q]), r / np.sqrt(p * q))


def find_method_shift(field: Field, rng: Rng = 1) -> tuple[FloatArray, FloatArray, float]:
    """Measure how the acceleration of degree 1 moves from least squares to Student's t, on random parts of the sources.

    Each part gives the difference of the two; Hotelling's T² of their mean asks nothing of the errors.

    Parameters
    ----------
    field : Field
        All sources, none clipped.
    rng : Generator or int
        The source of all randomness.

    Returns
    -------
    (3,) array, (3,) array, float
        The mean move of a part and its errors [µas/yr], and its p-value.

    Raises
    ------
    DegeneracyError
        If there are too few sources.
    """
    if len(field) < _N_GROUPS * _MIN_GROUP_SIZE:
        raise DegeneracyError(f"{len(field)} sources, and {_N_GROUPS * _MIN_GROUP_SIZE} are needed")
    group_index = generator(rng).permutation(len(field)) % _N_GROUPS
    group_moves = np.array(
        [
            student_t(group, 1).solution.acceleration.value - fit_field(group, 1).acceleration.value
            for group in (field[group_index == k] for k in range(_N_GROUPS))
        ]
    )
    mean, covariance = group_moves.mean(0), np.cov(group_moves.T) / _N_GROUPS
    t2 = mean @ np.linalg.solve(covariance, mean)
    p_value = fdtrc(3, _N_GROUPS - 3, t2 * (_N_GROUPS - 3) / (3 * (_N_GROUPS - 1)))
    return mean, np.sqrt(np.diag(covariance)), float(p_value)


def find_most_influential_source(field: Field, lmax: int) -> tuple[int, float, float]:
    """The source that moves the acceleration most, by how many of its errors, and how probable that is.

    A source moves g by VᵀW r times the covariance, which in errors of g is a quadratic form of its residual r; the
    probability that none of them moves it further is the product over all. Errors may be wrong by one factor, and have
    a part that is the same for all sources: systematic errors beyond the degree of the fit.

    Parameters
    ----------
    field : Field
        The sources; where they are clipped, the p-value is a little too large.
    lmax : int
        The degree of the fit.

    Returns
    -------
    int, float, float
        Its row, the move in errors, and the p-value.
    """
    solution = fit_field(field, lmax)
    rows = np.arange(len(solution.modes))[solution.modes.slice_of("S", 1)]
    # Whitened, the move in errors is the length of three numbers.
    whitening = np.linalg.inv(np.linalg.cholesky(solution.covariance[np.ix_(rows, rows)])) @ solution.covariance[rows]
    residual = solution.residuals(field)
    blocks = [np.arange(start, min(start + _BLOCK_SIZE, len(field))) for start in range(0, len(field), _BLOCK_SIZE)]
    move_squares = np.concatenate([_square_influences(residual[block], solution.modes, whitening) for block in blocks])
    largest = int(np.argmax(move_squares))
    # The scatter of the others: the source that is asked about must not excuse itself.
    scale, excess_variance = _fit_scale_and_excess_variance(residual[np.delete(np.arange(len(field)), largest)])
    log_probability = sum(
        _sum_log_probabilities(residual[block], solution, whitening, scale, excess_variance, move_squares[largest])
        for block in blocks
    )
    return largest, float(np.sqrt(move_squares[largest])), float(-np.expm1(log_probability))


def _square_influences(residual, modes, whitening):
    """Squared influence of each source on the acceleration, in errors."""
    return np.sum(
        np.einsum("ajp,jp->ap", _differentiate_acceleration(residual, modes, whitening), residual.whitened) ** 2, 0
    )


def _differentiate_acceleration(residual, modes, whitening):
    """Derivative of the whitened acceleration, (3, 2, n)."""
    acceleration_response = np.tensordot(whitening, harmonics(residual.lon, residual.lat, modes), 1)
    return np.einsum("aip,jip->ajp", acceleration_response, _weight_root(residual))


def _sum_log_probabilities(residual, solution, whitening, scale, excess_variance, move_square):
    """Log of the probability that none of these sources moves it by so much."""
    root, derivative = (_weight_root(residual), _differentiate_acceleration(residual, solution.modes, whitening))
    # What least squares leave of a residual, 1 − R Vᵀ C V Rᵀ, and what all sources scatter by besides.
    white = np.einsum("pin,jin->pjn", harmonics(residual.lon, residual.lat, solution.modes), root)
    redundancy = np.eye(2)[..., None] - np.einsum("pjn,pq,qkn->jkn", white, solution.covariance, white, optimize=True)
    covariance = scale * redundancy + excess_variance * np.einsum("jin,kin->jkn", root, root)
    product = np.einsum("ajn,akn,kln->jln", derivative, derivative, covariance)
    mean_eigenvalue = (product[0, 0] + product[1, 1]) / 2
    determinant = product[0, 0] * product[1, 1] - product[0, 1] * product[1, 0]
    half_difference = np.sqrt(np.maximum(mean_eigenvalue**2 - determinant, 0))
    larger, smaller = (mean_eigenvalue + half_difference, np.maximum(mean_eigenvalue - half_difference, 0))
    # Two squares with weights λ1, λ2 exceed x together with the mean over φ of exp(−x / 2(λ1 cos²φ + λ2 sin²φ)).
    with np.errstate(over="ignore", divide="ignore"):
        tail = np.mean([np.exp(-move_square / (2 * (larger * u + smaller * (1 - u)))) for u in _COSINES], axis=0)
    return np.sum(np.log1p(-np.minimum(tail, 1 - 1e-16)))


def _fit_scale_and_excess_variance(residual):
    """Residuals as τ² of the quoted variance and a variance that all have: r²/σ² = τ² + s²/σ²."""
    weights, chi2 = residual.weights[:2].mean(0), np.mean(residual.whitened**2, 0)
    if not np.ptp(weights) > 0:
        return float(np.mean(chi2)), 0.0
    scale, excess_variance, design = float(np.mean(chi2)), 0.0, np.stack([np.ones_like(weights), weights])
    for _ in range(5):  # the likeliest two, of exponential y
        weighted_design = design / (scale + excess_variance * weights) ** 2
        matrix = weighted_design @ design.T
        scale, excess_variance = np.linalg.solve(matrix, weighted_design @ chi2)
        excess_variance = max(excess_variance, 0.0)
        scale = max(float(scale if excess_variance else np.mean(chi2)), 0.1 * float(np.mean(chi2)))
    return float(scale), float(excess_variance)


def _weight_root(field):
    """R with Rᵀ R the inverse covariance of each source, (2, 2, n)."""
    (s1, s2), rho = field.sigma, field.rho
    k = np.sqrt(1 - rho**2)
    return np.array([[1 / s1, np.zeros_like(s1)], [-rho / (k * s1), 1 / (k * s2)]])
