"""Fits to very high degrees: the normal equations are solved without storing the normal matrix.

The sources are read once, into the Fourier moments of `fit.Moments`. With these moments on a grid of (2L + 1) × (4L +
2) points, N c is computed by a synthesis on the grid, a 2 × 2 product at each point and an adjoint synthesis. One step
of the conjugate gradients takes the same time for ten million sources as for ten thousand.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, eigvalsh_tridiagonal

from fit.normal.sums import Rings, fourier_sums
from fit.results.solution import HarmonicSolution
from fit.results.storage import coefficient_columns
from vsh import Coefficients, Field, Mode, Modes
from vsh.io import tables
from vsh.io.parts import field_or_fields
from vsh.io.sections import Section
from vsh.modes import as_modes
from vsh.tools import arguments
from vsh.tools.arguments import explained
from vsh.tools.errors import ConvergenceError, CovarianceError, FieldError, ParameterError
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import progress_bar
from vsh.tools.types import ArrayLike, Axes, FloatArray, Table


def conjugate_gradients(
    system: Any, rhs: FloatArray, tolerance: float, max_iterations: int, words: str | None
) -> tuple[FloatArray, int, float, float]:
    """Solve `system` · c = `rhs` by preconditioned conjugate gradients."""
    x, r = np.zeros_like(rhs), rhs.copy()
    z = system.precondition(r)
    p, rz = z.copy(), r @ z
    start, alphas, betas = rz, [], []
    bar = progress_bar(None, max_iterations, words, bool(words), " steps")
    with bar:
        for iteration in range(1, max_iterations + 1):
            if rz <= tolerance**2 * start:
                return x, iteration - 1, float(np.sqrt(rz / start)) if start else 0.0, _condition(alphas, betas)
            q = system.apply(p)
            alpha = rz / (p @ q)
            x += alpha * p
            r -= alpha * q
            z = system.precondition(r)
            rz, previous_rz = r @ z, rz
            alphas.append(alpha)
            betas.append(rz / previous_rz)
            p = z + betas[-1] * p
            bar.update()
            bar.set_postfix_str(f"residual {np.sqrt(rz / start):.1e} → {tolerance:.0e}", refresh=False)
    moving = np.bincount(system.modes.degrees, weights=p**2 * system.diagonal)
    worst = ", ".join(str(l) for l in sorted(np.argsort(-moving)[:5]))
    raise ConvergenceError(
        f"no convergence to {tolerance:.0e} in {max_iterations} iterations (residual {np.sqrt(rz / start):.1e}, "
        f"condition at least {_condition(alphas, betas):.1e}). Undetermined: combinations of degrees {worst}, among "
        f"others; {100 * system.empty_sky():.0f} % of the sky is empty at this resolution. Give a prior_power, lower "
        f"lmax from {system.modes.lmax}, or allow more iterations"
    )


def _condition(alphas, betas):
    """Estimate the condition number from the Lanczos matrix that the coefficients of the iteration define."""
    if not alphas:
        return 1.0
    alphas, betas = np.array(alphas), np.array(betas)
    diagonal = 1 / alphas
    diagonal[1:] += betas[:-1] / alphas[:-1]
    values = eigvalsh_tridiagonal(diagonal, np.sqrt(betas[:-1]) / alphas[:-1])
    return float(values[-1] / max(values[0], 1e-300))


#: Highest degree of the block of N that the preconditioner inverts exactly.
LOW = 12


@dataclass(frozen=True, eq=False, repr=False)
class MatrixFreeSolution(HarmonicSolution):
    """Solution without a covariance matrix; anything that needs the matrix raises CovarianceError.

    Attributes
    ----------
    coefficients : Coefficients
        The best fit. [µas/yr]
    chi2 : float
        χ² of the residuals.
    n_data : int
        Number of data: two per source.
    frame : str
        Frame of the axes.
    notes : tuple of str
        Remarks on the data that a reader should know.
    errors : dict of Mode to float
        Standard errors of the coefficients for which they were requested. [µas/yr]
    iterations : int
        Number of steps of the conjugate gradients.
    residual : float
        |b − N c| / |b|, with both norms in units of the preconditioner.
    condition : float
        Condition number of the preconditioned N, estimated from the iterations.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> solution = solve_matrix_free(field, 4)
    >>> solution.frame, solution.n_data
    ('icrs', 1000)
    """

    coefficients: Coefficients
    chi2: float
    n_data: int
    frame: str
    notes: tuple[str, ...] = ()
    errors: dict[Mode, float] = field(default_factory=dict)
    iterations: int = 0
    residual: float = 0.0
    condition: float = 1.0

    def __repr__(self) -> str:
        return f"<MatrixFreeSolution: degree {self.modes.lmax}, {self.n_sources} sources, {self.frame}>"

    @property
    def covariance(self) -> FloatArray:
        """Covariance matrix, which a matrix-free fit does not have.

        Raises
        ------
        CovarianceError
            Always; the message says how to get errors of some coefficients.
        """
        raise CovarianceError(
            f"a matrix-free fit to degree {self.modes.lmax} has no covariance matrix: ask for the errors of some "
            "coefficients with errors_of=[Mode(…), …], or use fit.solve at a lower degree"
        )

    def _sections(self, long):
        facts = [
            ("sources", f"{self.n_sources}, {self.frame} axes"),
            ("χ²/dof", f"{self.chi2:.6g} / {self.dof} = {self.reduced_chi2:.3f}"),
        ]
        for mode, error in self.errors.items():
            facts.append((str(mode), f"{self.values[self.modes.index(mode)]:+.4g} ± {error:.2g} µas/yr"))
        degrees = range(1, self.modes.lmax + 1)
        columns: dict[str, Any] = {"degree": list(degrees)}
        kind_names: Any = (("T", "toroidal"), ("S", "spheroidal"))
        for kind, name in kind_names:
            columns[name] = [self.coefficients.power(kind, l) for l in degrees]
        table = tables.table_of(columns, {}, dict.fromkeys(("toroidal", "spheroidal"), "uas2 / yr2"))
        title = f"Matrix-free fit to degree {self.modes.lmax}: power as fitted, noise included"
        return (Section(title, facts, table, notes=self.notes),)

    def to_table(self) -> Table:
        """Return the coefficients as an astropy Table, one row each; errors are nan unless requested."""
        sigma = np.full(len(self.modes), np.nan)
        for mode, error in self.errors.items():
            sigma[self.modes.index(mode)] = error
        columns = coefficient_columns(self.modes) | {"value": self.values, "sigma": sigma}
        return tables.table_of(columns, {"frame": self.frame}, dict.fromkeys(("value", "sigma"), "uas / yr"))

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """Plot the fitted power of each degree on matplotlib axes."""
        from fit.results.output import plot_power

        return plot_power(self, ax=ax)

    @classmethod
    def _unpack(cls, columns, metadata):
        solution = super()._unpack(columns, metadata)
        return replace(solution, errors={Mode(*mode): error for mode, error in solution.errors.items()})


@arguments.accepts(fields=field_or_fields, tolerance=arguments.positive, max_iterations=arguments.whole)
@explained
def solve_matrix_free(
    fields: Field | Iterable[Field],
    modes: Modes | int,
    *,
    prior_power: float | ArrayLike | Callable[[int], float] | None = None,
    errors_of: Iterable[Mode] = (),
    tolerance: float = 1e-8,
    max_iterations: int = 500,
    threads: int | None = None,
    progress: bool = True,
) -> MatrixFreeSolution:
    """Fit to a degree at which the normal matrix is too large for memory.

    Parameters
    ----------
    fields : Field or iterable of Fields
        The catalogues.
    modes : Modes, or the degree lmax
        What to fit.
    prior_power : float, (lmax,) array or function of l, optional
        Expected power of each degree under a Gaussian prior of mean zero. It is the same for T and S, and inf
        means no prior. A prior is needed if the sources leave modes undetermined. [(µas/yr)²]
    errors_of : iterable of Mode
        Coefficients whose standard errors are computed, each at the cost of one more solution.
    tolerance : float
        Relative residual at which to stop.
    max_iterations : int
        Largest number of steps of the conjugate gradients.
    threads : int, optional
        Number of threads; one per core unless given.
    progress : bool
        Whether to show a progress bar after two seconds.

    Returns
    -------
    MatrixFreeSolution
        The solution. With several threads its last bits may vary from call to call.

    Raises
    ------
    ConvergenceError
        If the iteration does not converge. The message says how ill-conditioned the problem
        is, which degrees are still changing, how much of the sky is empty, and what to do.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> solution = solve_matrix_free(field, 5)
    >>> solution.coefficients.values.shape
    (70,)
    """
    modes = as_modes(modes)
    system = _System(fields, modes, prior_power, threads)
    values, iterations, residual, condition = conjugate_gradients(
        system, system.rhs, tolerance, max_iterations, f"degree {modes.lmax}" if progress else None
    )
    errors = {}
    for mode in errors_of:
        unit = np.zeros(len(modes))
        unit[modes.index(mode)] = 1
        column = conjugate_gradients(system, unit, tolerance, max_iterations, f"error of {mode}" if progress else None)[
            0
        ]
        errors[mode] = float(np.sqrt(column[modes.index(mode)]))
    note = f"matrix-free: {iterations} iterations, residual {residual:.1e}, condition {condition:.3g}"
    return MatrixFreeSolution(
        Coefficients(modes, values),
        chi2=float(system.chi2_null - 2 * values @ system.rhs + values @ system.apply_data(values)),
        n_data=system.n_data,
        frame=system.frame,
        notes=(*system.notes, note),
        errors=errors,
        iterations=iterations,
        residual=residual,
        condition=condition,
    )


def prior_precision(modes: Modes, power: float | ArrayLike | Callable[[int], float] | None) -> FloatArray:
    """Compute the inverse prior variance of each coefficient, (p,): (2l + 1)/P_l, and twice that for m > 0."""
    if power is None:
        return np.zeros(len(modes))
    l = np.arange(1, modes.lmax + 1)
    power = np.array([power(int(degree)) for degree in l] if callable(power) else power, float)
    power = np.broadcast_to(power, l.shape)
    if not (power > 0).all():
        raise ParameterError("the prior power must be positive at every degree")
    return ((2 * l + 1) / power)[modes.degrees - 1] * modes.norm2


class _System:
    """System (N + prior) c = b with N as an operator, and its approximate inverse."""

    def __init__(self, fields, modes, prior_power, threads):
        self.modes, self.threads = modes, threads
        self.prior = prior_precision(modes, prior_power)
        self.chi2_null, self.n_data = 0.0, 0
        weights: Any = 0
        motions: Any = 0
        notes: tuple[str, ...] = ()
        frames: dict[str, bool] = {}
        for catalogue in [fields] if isinstance(fields, Field) else fields:
            w, z, chi2 = fourier_sums(catalogue, modes.lmax, threads)
            weights, motions, self.chi2_null = weights + w, motions + z, self.chi2_null + chi2
            self.n_data += 2 * len(catalogue)
            notes = merge_notes(notes, catalogue.notes)
            frames[catalogue.frame] = True
        if len(frames) != 1:
            raise FieldError(f"all fields must be in one frame; found {', '.join(frames) or 'none'}")
        self.notes, (self.frame,) = notes, frames
        rings = Rings(modes.lmax)
        self.rhs = rings.rhs(motions)
        self.grid = rings.on_grid(weights)
        self._precondition(weights)

    def apply_data(self, values):
        """Compute N c of the data, without the prior."""
        from vsh.transform import adjoint_on_rings, synthesis_on_rings

        a, b, c = self.grid
        east, north = synthesis_on_rings(Coefficients(self.modes, values), a.shape, self.threads)
        return adjoint_on_rings(self.modes, np.stack([a * east + c * north, c * east + b * north]), self.threads)

    def apply(self, values):
        return self.apply_data(values) + self.prior * values

    def _precondition(self, weights):
        low_modes = Modes(min(LOW, self.modes.lmax))
        half = weights.shape[-1] // 2
        few = weights[:, : 2 * low_modes.lmax + 1, half - 2 * low_modes.lmax : half + 2 * low_modes.lmax + 1]
        self.low = self.modes.degrees <= low_modes.lmax
        # On a uniform sky the mean weight is the diagonal of N. An empty catalogue has no weight.
        mean = float((weights[0, 0, half] + weights[1, 0, half]).real) / (8 * np.pi)
        self.diagonal = mean * self.modes.norm2 + self.prior
        block = Rings(low_modes.lmax).matrix(few) + np.diag(self.prior[self.low])
        # A small multiple of the diagonal keeps the block positive definite if the sources do not.
        self.block = cho_factor(block + 1e-6 * np.diag(self.diagonal[self.low]))

    def precondition(self, residual):
        correction = residual / self.diagonal
        correction[self.low] = cho_solve(self.block, residual[self.low])
        return correction

    def empty_sky(self):
        """Compute the fraction of the sky without weight, at the resolution of the fit."""
        density = self.grid[0] + self.grid[1]
        area = np.broadcast_to(np.cos(Rings(self.modes.lmax).lat)[:, None], density.shape)
        # The grid holds integrals over cells, which shrink towards the poles.
        empty = density < 0.05 * area * (density.sum() / area.sum())
        return float(area[empty].sum() / area.sum())
