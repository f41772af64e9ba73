"""The direct frame solver: orientation, spin and acceleration, by QR.

The equations are those of Bachchan, Hobbs & Lindegren (2016, A&A 589, A71, sect. 4), after
Lindegren et al. (2012, A&A 538, A78, eqs. 108 and 110):

    µ_α* =  q·ω + p·ã      Δα* =  q·ε
    µ_δ  = −p·ω + q·ã      Δδ  = −p·ε

This file knows neither the harmonics nor the normal equations. It is there to disagree when they are wrong.
"""

from dataclasses import dataclass, replace
from functools import partial, reduce
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular, svdvals
from scipy.linalg.lapack import dgeqrf

from fit.normal import normal_equations, solve
from fit.results.solution import NamedSolution, Solution
from fit.results.storage import Result
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, add_sums, as_parts
from vsh.io.sections import Section
from vsh.models.covariance import Covariance, as_covariance
from vsh.modes import Modes
from vsh.sky.sphere import sin_cos, triad
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, FieldError, FrameError
from vsh.tools.notes import merge_notes
from vsh.tools.parallel import map_blocks
from vsh.tools.printing import log_calls
from vsh.tools.types import Axes, FloatArray, Table
from vsh.vector import Vector

_AXES = "xyz"
#: Sources in a block: what fits into a processor's own memory.
_BLOCK_SIZE = 8192


@dataclass(frozen=True, eq=False, kw_only=True)
class FrameSolution(NamedSolution):
    """Orientation, spin and acceleration with their joint covariance.

    Attributes
    ----------
    names : tuple of str
        epsilon_x … (with offsets only), omega_x …, a_x …
    values : (p,) array
        In the order of `names`; p is 9, or 6 without offsets. [µas, then µas/yr]
    covariance : (p, p) array
    chi2 : float
    n_data : int
    frame : str
    notes : tuple of str

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> frame = solve_frame(field)
    >>> frame.names, frame.spin.value.shape
    (('omega_x', 'omega_y', 'omega_z', 'a_x', 'a_y', 'a_z'), (3,))
    """

    def _sections(self, long):
        facts = [("axes", self.frame), ("χ²/dof", f"{self.chi2:.6g} / {self.dof} = {self.reduced_chi2:.3f}")]
        table = self.to_table()
        table["unit"] = ["µas" if name.startswith("epsilon") else "µas/yr" for name in self.names]
        title = "Orientation, spin and acceleration by the direct frame solver"
        return (Section(title, facts, table, notes=self.notes),)

    def model(self, field: Field) -> FloatArray:
        """The motions by spin and acceleration at the sources of a `field`, (2, n). [µas/yr]"""
        p, q, _ = triad(field.lon, field.lat)
        rotation: Any = self.spin
        spin, acceleration = rotation.value, self.acceleration.value
        return np.stack([spin @ q + acceleration @ p, acceleration @ q - spin @ p])

    @property
    def orientation(self) -> Vector | None:
        """ε, a Vector in µas, or None where no offsets were given."""
        return self._make_vector("epsilon", "µas") if "epsilon_x" in self.names else None


@log_calls("frame solver")
def solve_frame(
    motions: Field | Parts, offsets: Field | Parts | None = None, *, covariance: Covariance | FloatArray | None = None
) -> FrameSolution:
    """Solve for the spin and the acceleration, and for the orientation where offsets are given.

    Parameters
    ----------
    motions : Field or Parts
        Proper motions. [µas/yr]
    offsets : Field or Parts, optional
        Position differences (this frame minus the reference), of other sources or the
        same: `motion` and `sigma` hold Δα*, Δδ and their errors. [µas]
    covariance : Covariance or (2n, 2n) array, optional
        Covariance of the motions, all east components first, in place of the errors that the field has. [(µas/yr)²]

    Raises
    ------
    DegeneracyError
        If the sources cannot separate the parameters.
    FrameError
        If the two fields stand in different frames.

    Examples
    --------
    >>> from vsh import Coefficients, Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 100), np.arcsin(rng.uniform(-1, 1, 100))
    >>> motion = Coefficients.from_vectors(rotation=(1, 2, 3), glide=(4, 5, 6)).at(lon, lat)
    >>> frame = solve_frame(Field(lon, lat, motion, np.ones((2, 100))))
    >>> frame.spin.value.round(9), frame.acceleration.value.round(9)
    (array([1., 2., 3.]), array([4., 5., 6.]))
    """
    for field in (motions, offsets or motions):
        if not isinstance(field, Field | Parts):
            raise FieldError(f"the frame solver takes Fields, or parts of them, not a {type(field).__name__}")
    vector_groups = [("omega", "a")] if offsets is None else [("epsilon",), ("omega", "a")]
    names = tuple(f"{name}_{axis}" for vectors in vector_groups for name in vectors for axis in _AXES)
    triangularise_motions = partial(_triangularise_equations, first_column=len(names) - 6, size=len(names))
    if covariance is None:
        equations = as_parts(motions).sum(triangularise_motions, roles=(), words="frame solver")
    else:
        equations = triangularise_motions(motions, covariance=as_covariance(covariance, motions))
    if offsets is not None:
        offset_equations = as_parts(offsets).sum(
            partial(_triangularise_equations, first_column=0, size=len(names)), roles=(), words="frame solver"
        )
        if offset_equations.frame != equations.frame:
            raise FrameError(
                f"motions are in {equations.frame}, offsets in {offset_equations.frame}: take both to one frame"
            )
        equations = offset_equations + equations
    return _solve_triangle(equations.matrix, names, equations.n_data, equations.frame, equations.notes)


@dataclass(frozen=True, eq=False)
class _Triangle:
    """The upper triangle of the equations of some sources; two of them are the triangle of both."""

    matrix: FloatArray
    n_data: int
    frame: str
    notes: tuple[str, ...]

    def __add__(self, other):
        if other.frame != self.frame:
            raise FrameError(f"sources are in {self.frame} and {other.frame}: take all to one frame")
        matrix = qr(np.asfortranarray(np.concatenate([self.matrix, other.matrix])))
        return _Triangle(matrix, self.n_data + other.n_data, self.frame, merge_notes(self.notes, other.notes))

    def add_note(self, *notes):
        return replace(self, notes=merge_notes((*self.notes, *notes)))


def _triangularise_equations(field, first_column, size, covariance=None):
    """The triangle of motions, or of offsets in the first three columns of nine."""
    is_motions = first_column + 6 == size
    if covariance is not None:
        columns = np.zeros((size + 1, 2 * len(field)))
        unit_field = field.with_errors(np.ones((2, len(field))), np.zeros(len(field)))
        _fill_whitened_columns(unit_field, columns.reshape(size + 1, 2, len(field))[first_column:], is_motions)
        return _Triangle(qr(np.asfortranarray(covariance.whiten(columns).T)), 2 * len(field), field.frame, field.notes)

    def triangularise_block(selection):
        subset = field[selection]
        columns = np.zeros((size + 1, 2, len(subset)))
        _fill_whitened_columns(subset, columns[first_column:], is_motions)
        return _Triangle(qr(columns.reshape(size + 1, -1).T), 2 * len(subset), field.frame, field.notes)

    return reduce(add_sums, map_blocks(triangularise_block, len(field), _BLOCK_SIZE))


def qr(rows: FloatArray) -> FloatArray:
    """The upper triangle R of rows = Q R, by Householder's reflections (LAPACK)."""
    factor, _, _, _ = dgeqrf(rows, overwrite_a=True)
    return np.triu(factor[: rows.shape[1]])


def _fill_whitened_columns(field, columns, has_acceleration):
    """Fill columns of [coefficients | right-hand side], (k + 1, 2, n), decorrelated, of unit weight."""
    (sin_a, cos_a), (sin_d, cos_d) = sin_cos(field.lon), sin_cos(field.lat)
    p = np.stack([-sin_a, cos_a, np.zeros_like(sin_a)])
    q = np.stack([-sin_d * cos_a, -sin_d * sin_a, cos_d])
    east, north = columns[:, 0], columns[:, 1]
    east[:3], north[:3] = q, -p
    if has_acceleration:
        east[3:6], north[3:6] = p, q
    east[-1], north[-1] = field.motion
    # The part of the northern error that is independent of the eastern one, and its size.
    (s1, s2), rho = field.sigma, field.rho
    north -= rho * s2 / s1 * east
    north /= s2 * np.sqrt(1 - rho**2)
    east /= s1


def _solve_triangle(triangle, names, n_data, frame, notes):
    p = len(names)
    r, rhs = triangle[:p, :p], triangle[:p, p]
    column_norms = np.linalg.norm(r, axis=0) if len(r) == p else np.zeros(p)
    singular_values = svdvals(r / column_norms) if (column_norms > 0).all() else np.zeros(p)
    if not singular_values[-1] > 1e-5 * singular_values[0]:
        raise DegeneracyError(f"{n_data // 2} sources cannot separate {', '.join(names)}: widen the sky coverage")
    inverse = solve_triangular(r, np.eye(p))
    chi2 = float(triangle[p, p] ** 2) if len(triangle) > p else 0.0
    return FrameSolution(
        names=names,
        values=inverse @ rhs,
        covariance=inverse @ inverse.T,
        chi2=chi2,
        n_data=n_data,
        frame=frame,
        notes=notes,
    )


@dataclass(frozen=True, eq=False)
class CrossCheck(Result):
    """Spin and acceleration by harmonics of degree 1 and by the direct frame solver.

    Attributes
    ----------
    harmonics : Solution
    frame : FrameSolution
    largest : float
        Their largest difference in any component, in units of its standard error.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> check = cross_check(field)
    >>> check.harmonics.n_sources, check.frame.names[:3]
    (500, ('omega_x', 'omega_y', 'omega_z'))
    """

    harmonics: Solution
    frame: FrameSolution
    largest: float

    def _sections(self, long):
        from fit.results.output import cross_check_sections

        return cross_check_sections(self)

    def to_table(self) -> Table:
        """Both solutions as an astropy Table: a row for each component of spin and acceleration."""
        columns: dict[str, Any] = {"parameter": list(self.frame.names)}
        for name, solution in (("harmonics", self.harmonics), ("frame_solver", self.frame)):
            spin: Any = solution.spin
            columns[name] = np.concatenate([spin.value, solution.acceleration.value])
            columns[f"{name}_error"] = np.concatenate([spin.sigma, solution.acceleration.sigma])
        return tables.table_of(columns, {"frame": self.frame.frame})

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The correlations of the frame solver's parameters on matplotlib axes."""
        return self.frame.plot(ax=ax)


@log_calls("cross-check")
@arguments.accepts(field=arguments.a(Field, Parts))
def cross_check(field: Field | Parts, *, covariance: Covariance | FloatArray | None = None) -> CrossCheck:
    """Fit degree 1 to a field by both solvers and compare.

    Parameters
    ----------
    field : Field or Parts
        The sources. Parts are gone through twice.
    covariance : Covariance or (2n, 2n) array, optional
        As for `normal_equations`.

    Raises
    ------
    DegeneracyError
        If spin and acceleration cannot be separated with these sources.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> cross_check(field).largest < 1e-6
    True
    """
    # Not the short cut for degree 1, which writes the same p and q: the harmonics themselves.
    harmonics = solve(normal_equations(field, Modes(1), method="design-matrix", covariance=covariance))
    frame_solution = solve_frame(field, covariance=covariance)
    pairs: list[Any] = [(harmonics.spin, frame_solution.spin), (harmonics.acceleration, frame_solution.acceleration)]
    largest_difference = max(
        float(np.max(np.abs(harmonic_vector.value - direct_vector.value) / direct_vector.sigma))
        for harmonic_vector, direct_vector in pairs
    )
    return CrossCheck(harmonics, frame_solution, largest_difference)
