"""The estimators by name: what `vsh-fit --method`, classes, templates and other commands fit with."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from fit.background import Floor
from fit.methods._recommended import Weighted, recommended
from fit.resample import bootstrap, compare_blocks, jackknife
from fit.robust import ExcessNoise, Reweighted, clip, excess_noise, permissive, student_t
from fit.solution import Solution
from fit.solving import fit_field, with_coverage
from vsh.field import Field
from vsh.io.catalogue import as_field
from vsh.io.parts import Parts
from vsh.modes import Modes
from vsh.tools import arguments
from vsh.tools.arguments import choice
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray, Rng

#: The degree of every estimator but the recommended one, which chooses its own.
DEGREE = 3


@dataclass(frozen=True, eq=False)
class Estimate(Weighted):
    """A fit by one of `METHODS`.

    Attributes
    ----------
    solution : Solution
        With the errors of this estimator.
    method : str
        Its name.
    sources : Field or Parts
        Those that were fitted.
    plain : Solution
        The same without a systematic floor in its errors.
    n_clipped : int
        How many sources were clipped.
    weights : Reweighted, ExcessNoise or None
        The fit whose weights classes and templates are summed with; None of least squares.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> estimate(field, 3, "student").solution.modes.lmax
    3
    """

    solution: Solution
    method: str
    sources: Field | Parts
    plain: Solution
    n_clipped: int = 0
    weights: Reweighted | ExcessNoise | None = None

    @property
    def floor(self) -> Floor | None:
        """The systematic floor that is in the errors, or None."""
        return self.solution.floor

    @property
    def is_scaled(self) -> bool:
        """Whether χ² scales the errors of `equations`: not where they come from residuals already."""
        return not isinstance(self.weights, Reweighted)

    @property
    def source_weights(self) -> FloatArray | None:
        """Factor on each source's inverse covariance, (n,); None of least squares and of parts."""
        return self.weights.weights if isinstance(self.weights, Reweighted) else None

    @property
    def class_note(self) -> str:
        """Which estimator the numbers of classes and templates have."""
        if not self.is_scaled:
            return "classes and templates are summed by the weights of the robust fit, errors from their own residuals"
        if isinstance(self.weights, ExcessNoise):
            return "classes and templates have the excess noise of the whole, errors scaled by the χ²/dof of each"
        return "classes and templates are fitted by least squares, errors scaled by the χ²/dof of each"


def _recommended(field, lmax, value, rng):
    result = recommended(field, lmax, rng=rng)
    return Estimate(result.solution, "recommended", field, result.plain, 0, result.weights)


def _least_squares(field, lmax, value, rng):
    return _plain("least-squares", fit_field(field, lmax), field)


def _clip(field, lmax, value, rng):
    clipped = clip(field, lmax, 3.0 if value is None else float(value))
    sources = clipped.sources(field)
    return _plain("clip", clipped.solution, sources, clipped.n_clipped)


def _student(field, lmax, value, rng):
    weights = student_t(field, lmax)
    return _plain("student", weights.solution, field, 0, weights)


def _permissive(field, lmax, value, rng):
    weights = permissive(field, lmax)
    return _plain("permissive", weights.solution, field, 0, weights)


def _excess_noise(field, lmax, value, rng):
    weights = excess_noise(field, lmax, scale=choice("excess-noise", value, (None, "scale")) == "scale")
    return _plain("excess-noise", weights.solution, field, 0, weights)


def _bootstrap(field, lmax, value, rng):
    resampled = bootstrap(field, lmax, 100 if value is None else int(value), rng)
    return _plain("bootstrap", resampled.resampled_solution, field)


def _jackknife(field, lmax, value, rng):
    if value is not None:
        return _plain("jackknife", jackknife(field, lmax, int(value)).resampled_solution, field)
    best: Any
    _, best, advice = compare_blocks(field, lmax)
    solution = best.resampled.resampled_solution
    return _plain("jackknife", replace(solution, notes=(*solution.notes, advice)), field)


def _plain(method, solution, sources, n_clipped=0, weights=None):
    """An estimate whose errors are those of the solution; of the catalogue's, scaled where χ² contradicts them."""
    solution = with_coverage(solution, sources)
    return Estimate(solution.scaled, method, sources, solution, n_clipped, weights)


#: The estimators by name. Each takes a field (or parts), a degree, a value or None, and a source of randomness, and
#: gives an `Estimate`. The value is κ of the clipping, "scale" of the excess noise (a factor on the errors as well),
#: the number of bootstrap replicates, the NSIDE of the jackknife's blocks.
METHODS: dict[str, Callable[[Any, Any, Any, Rng], Estimate]] = {
    "recommended": _recommended,
    "least-squares": _least_squares,
    "clip": _clip,
    "student": _student,
    "permissive": _permissive,
    "excess-noise": _excess_noise,
    "bootstrap": _bootstrap,
    "jackknife": _jackknife,
}
#: Those that take a value.
WITH_VALUE = ("clip", "excess-noise", "bootstrap", "jackknife")


@arguments.accepts(field=as_field, rng=arguments.seed)
def estimate(
    field: Any,
    lmax: Modes | int | None = None,
    method: str = "recommended",
    value: float | str | None = None,
    *,
    rng: Rng = 1,
) -> Estimate:
    """Fit a field by one of the estimators of `METHODS`.

    Parameters
    ----------
    field : Field, Parts, path or table
        The sources; what is no Field is read by `vsh.read_field`.
    lmax : Modes or int, optional
        The highest degree; 3 unless given, and 5 of the recommended fit.
    method : str
        A name in `METHODS`.
    value : float or str, optional
        κ of "clip" (3), the number of replicates of "bootstrap" (100), the NSIDE of "jackknife" (several are compared
        unless given), "scale" of "excess-noise".
    rng : Generator or int
        The source of all randomness.

    Raises
    ------
    ParameterError
        If there is no such method, or it takes no value.

    Examples
    --------
    >>> import numpy as np
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> print(estimate(field, 1, "least-squares").answer.lines[0][1].partition(";")[0])
    least squares, formal errors, degree 1
    """
    choice("method", method, tuple(METHODS))
    if value is not None and method not in WITH_VALUE:
        raise ParameterError(f"the method {method} takes no value, and {value!r} was given")
    if method == "recommended" and isinstance(lmax, Modes):
        lmax = lmax.lmax
    degree = lmax if lmax is not None or method == "recommended" else DEGREE
    return METHODS[method](field, degree, value, rng)
