"""How the acceleration moves with what should not matter: the degree, the way outliers are met, a single source."""

import numpy as np
from scipy.special import chdtrc, fdtrc

from fit.background import Floor
from fit.normal import normal_equations
from fit.robust import student_t
from fit.solving import fit_field, solve
from vsh.basis import harmonics
from vsh.coefficients import FIRST_DEGREE
from vsh.field import Field
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError
from vsh.tools.types import FloatArray, Rng

#: Random parts of the sources, and the least number in each.
_GROUPS, _IN_GROUP = 20, 60
#: Sources that are looked at together.
_BLOCK = 20_000
#: Angles that the probability of a quadratic form of two normal numbers is averaged over.
_ANGLES = np.cos((np.arange(32) + 0.5) * np.pi / 32) ** 2


def by_degree(field: Field, low: int, high: int, floor: Floor | None) -> tuple[FloatArray, FloatArray, float]:
    """How the acceleration moves from a fit of degree `low` to one of degree `high`.

    Both are linear in the same data: with M the matrix of one less the other, the move M b has the covariance
    M (τ² N + s² N₂ + N S N) Mᵀ: τ² and s² the scatter of the residuals, which holds what lies beyond the higher degree,
    N₂ the normal matrix with squared weights, S the spectrum of what sources share.

    Parameters
    ----------
    field : Field
        The sources.
    low, high : int
        The degrees.
    floor : Floor, optional
        What sources share; errors are as quoted, up to one factor, unless given.

    Returns
    -------
    (3,) array, (3,) array, float
        The move and its errors [µas/yr], and its p-value.
    """
    normal = normal_equations(field, high)
    modes = normal.modes
    where = np.flatnonzero(modes.degrees <= low)
    first = np.arange(len(modes))[modes.slice_of("S", 1)]
    many, few = np.linalg.inv(normal.matrix)[first], np.zeros((3, len(modes)))
    few[:, where] = np.linalg.inv(normal.matrix[np.ix_(where, where)])[np.searchsorted(where, first)]
    m = np.linalg.inv(FIRST_DEGREE) @ (many - few)
    solution = solve(normal)
    if floor is None:
        noise = normal.matrix * solution.quality.factor**2
    else:
        scale, added = _scatter(solution.residuals(field))
        noise = scale * normal.matrix + added * normal_equations(_squared(field), high).matrix
        noise = noise + normal.matrix @ np.diag(floor.spectrum.variances(modes)) @ normal.matrix
    move, covariance = m @ normal.rhs, m @ noise @ m.T
    chi2 = move @ np.linalg.pinv(covariance, hermitian=True) @ move
    return move, np.sqrt(np.diag(covariance)), float(chdtrc(3, chi2))


def _squared(field):
    """The sources with the square of each covariance for a covariance: weights W² in place of W."""
    (s1, s2), rho = field.sigma, field.rho
    a, b, c = s1**2, s2**2, rho * s1 * s2
    p, q, r = a**2 + c**2, b**2 + c**2, c * (a + b)
    return field.with_errors(np.sqrt([p, q]), r / np.sqrt(p * q))


def by_method(field: Field, rng: Rng = 1) -> tuple[FloatArray, FloatArray, float]:
    """How the acceleration of degree 1 moves from least squares to Student's t, on random parts of the sources.

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
    if len(field) < _GROUPS * _IN_GROUP:
        raise DegeneracyError(f"{len(field)} sources, and {_GROUPS * _IN_GROUP} are needed")
    part = generator(rng).permutation(len(field)) % _GROUPS
    moves = np.array(
        [
            student_t(group, 1).solution.acceleration.value - fit_field(group, 1).acceleration.value
            for group in (field[part == k] for k in range(_GROUPS))
        ]
    )
    mean, covariance = moves.mean(0), np.cov(moves.T) / _GROUPS
    t2 = mean @ np.linalg.solve(covariance, mean)
    p = fdtrc(3, _GROUPS - 3, t2 * (_GROUPS - 3) / (3 * (_GROUPS - 1)))
    return mean, np.sqrt(np.diag(covariance)), float(p)


def by_source(field: Field, lmax: int) -> tuple[int, float, float]:
    """The source that moves the acceleration most, by how many of its errors, and how probable that is.

    A source moves g by VᵀW r times the covariance, which in errors of g is a quadratic form of its residual r; the
    probability that none of them moves it further is the product over all. Errors may be wrong by one factor, and have
    a part that is the same for all sources: what they share beyond the degree of the fit.

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
    whiten = np.linalg.inv(np.linalg.cholesky(solution.covariance[np.ix_(rows, rows)])) @ solution.covariance[rows]
    residual = solution.residuals(field)
    parts = [np.arange(start, min(start + _BLOCK, len(field))) for start in range(0, len(field), _BLOCK)]
    moves = np.concatenate([_moves(residual[part], solution.modes, whiten) for part in parts])
    largest = int(np.argmax(moves))
    # The scatter of the others: the source that is asked about must not excuse itself.
    scale, added = _scatter(residual[np.delete(np.arange(len(field)), largest)])
    log = sum(_log_none(residual[part], solution, whiten, scale, added, moves[largest]) for part in parts)
    return largest, float(np.sqrt(moves[largest])), float(-np.expm1(log))


def _moves(residual, modes, whiten):
    """By how many errors each source moves the acceleration, squared."""
    return np.sum(np.einsum("ajp,jp->ap", _seen(residual, modes, whiten), residual.whitened) ** 2, 0)


def _seen(residual, modes, whiten):
    """How a whitened residual moves the whitened acceleration, (3, 2, n)."""
    g = np.tensordot(whiten, harmonics(residual.lon, residual.lat, modes), 1)
    return np.einsum("aip,jip->ajp", g, _root(residual))


def _log_none(residual, solution, whiten, scale, added, size):
    """Log of the probability that none of these sources moves it by so much."""
    root, seen = _root(residual), _seen(residual, solution.modes, whiten)
    # What least squares leave of a residual, 1 − R Vᵀ C V Rᵀ, and what all sources scatter by besides.
    white = np.einsum("pin,jin->pjn", harmonics(residual.lon, residual.lat, solution.modes), root)
    left = np.eye(2)[..., None] - np.einsum("pjn,pq,qkn->jkn", white, solution.covariance, white, optimize=True)
    wide = scale * left + added * np.einsum("jin,kin->jkn", root, root)
    product = np.einsum("ajn,akn,kln->jln", seen, seen, wide)
    middle = (product[0, 0] + product[1, 1]) / 2
    determinant = product[0, 0] * product[1, 1] - product[0, 1] * product[1, 0]
    away = np.sqrt(np.maximum(middle**2 - determinant, 0))
    first, second = middle + away, np.maximum(middle - away, 0)
    # Two squares with weights λ1, λ2 exceed x together with the mean over φ of exp(−x / 2(λ1 cos²φ + λ2 sin²φ)).
    with np.errstate(over="ignore", divide="ignore"):
        tail = np.mean([np.exp(-size / (2 * (first * u + second * (1 - u)))) for u in _ANGLES], axis=0)
    return np.sum(np.log1p(-np.minimum(tail, 1 - 1e-16)))


def _scatter(residual):
    """Residuals as τ² of the quoted variance and a variance that all have: r²/σ² = τ² + s²/σ²."""
    x, y = residual.weights[:2].mean(0), np.mean(residual.whitened**2, 0)
    if not np.ptp(x) > 0:
        return float(np.mean(y)), 0.0
    scale, added, design = float(np.mean(y)), 0.0, np.stack([np.ones_like(x), x])
    for _ in range(5):  # the likeliest two, of exponential y
        weighted = design / (scale + added * x) ** 2
        matrix = weighted @ design.T
        scale, added = np.linalg.solve(matrix, weighted @ y)
        added = max(added, 0.0)
        scale = max(float(scale if added else np.mean(y)), 0.1 * float(np.mean(y)))
    return float(scale), float(added)


def _root(field):
    """R with Rᵀ R the inverse covariance of each source, (2, 2, n)."""
    (s1, s2), rho = field.sigma, field.rho
    k = np.sqrt(1 - rho**2)
    return np.array([[1 / s1, np.zeros_like(s1)], [-rho / (k * s1), 1 / (k * s2)]])
