"""Normal equations: all that a least-squares fit needs to remember of the data."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from os import PathLike
from typing import Any, Literal

import numpy as np

from fit.sums import compressed_sums, design_matrix_sums, design_matrix_up_to, dipole_sums
from vsh import Field, Modes
from vsh.checks.arguments import choice
from vsh.checks.arrays import float_array
from vsh.checks.frozen import Frozen
from vsh.checks.notes import merge_notes
from vsh.errors import FieldError, FrameError, ModesError
from vsh.modes import as_modes
from vsh.types import ArrayLike, FloatArray

#: A normal matrix beyond this is refused. [bytes]
MEMORY = 8 * 2**30


@dataclass(frozen=True, eq=False, repr=False)
class NormalEquations(Frozen):
    """N c = b, summed over data. They add: chunks, catalogues and priors alike.

    Attributes
    ----------
    modes : Modes
        What the p unknowns are.
    matrix : (p, p) array
        N = Σ Aᵀ C⁻¹ A. [(yr/µas)²]
    rhs : (p,) array
        b = Σ Aᵀ C⁻¹ y. [yr/µas]
    chi2_null : float
        Σ yᵀ C⁻¹ y, the χ² of fitting nothing.
    n_data : int
        How many numbers went in: two a source.
    frame : str or None
        Of the axes; None fits any (a prior that is the same along all axes).
    notes : tuple of str
        The notes of the fields.
    """

    modes: Modes
    matrix: FloatArray
    rhs: FloatArray
    chi2_null: float
    n_data: int
    frame: str | None = None
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        return f"<NormalEquations: {self.n_data} numbers, degree {self.modes.lmax}, {self.frame or 'any frame'}>"

    def __add__(self, other: NormalEquations) -> NormalEquations:
        return self._combine(other, +1)

    def __sub__(self, other: NormalEquations) -> NormalEquations:
        """Take data away that went in before: a block of the sky, say."""
        return self._combine(other, -1)

    def __radd__(self, other: Any) -> NormalEquations:
        return self if other == 0 else NotImplemented  # the start of sum()

    def _combine(self, other, sign):
        if not isinstance(other, NormalEquations):
            return NotImplemented
        if other.modes != self.modes:
            raise ModesError(
                f"cannot add normal equations of degree {self.modes.lmax} and {other.modes.lmax}: fit both to one degree"
            )
        if None not in (self.frame, other.frame) and self.frame != other.frame:
            raise FrameError(
                f"cannot add normal equations in {self.frame} and {other.frame} axes: "
                f'take one field .to_frame("{self.frame}") first'
            )
        return NormalEquations(
            self.modes,
            self.matrix + sign * other.matrix,
            self.rhs + sign * other.rhs,
            self.chi2_null + sign * other.chi2_null,
            self.n_data + sign * other.n_data,
            self.frame or other.frame,
            merge_notes(self.notes, other.notes),
        )


def normal_equations(
    field: Field | Iterable[Field],
    modes: Modes | int,
    *,
    method: Literal["auto", "design-matrix", "compressed"] = "auto",
    threads: int | None = None,
) -> NormalEquations:
    """Sum a field, or a stream of fields, into normal equations.

    Parameters
    ----------
    field : Field or iterable of Fields
        The sources.
    modes : Modes, or the degree lmax
        What to fit.
    method : {"auto", "design-matrix", "compressed"}
        "design-matrix" sums the design matrix, exact to rounding; "compressed" sums the moments of
        the weights and is as good to 1e-12, in a time that hardly grows with the degree.
        "auto" takes what was measured to be faster (docs/performance.md).
    threads : int, optional
        How many; one a core unless given. The sum is taken in the order of the sources,
        so the number of threads does not change a bit of it.

    Returns
    -------
    NormalEquations

    Raises
    ------
    FieldError
        If a stream of fields holds none.
    FrameError
        If the fields of a stream stand in different frames.

    Examples
    --------
    The whole is the sum of its parts:

    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 100)), rng.normal(size=(2, 100)), np.ones((2, 100)))
    >>> whole = normal_equations(field, Modes(2))
    >>> np.allclose(whole.matrix, normal_equations([field[:30], field[30:]], Modes(2)).matrix)
    True
    """
    modes = as_modes(modes)
    choice("method", method, ("auto", "design-matrix", "compressed"))
    if isinstance(field, (str, PathLike)):
        raise FieldError(f"{field} is a path: read it first, with vsh.catalogue.read_field or iter_fields")
    if len(modes) ** 2 * 8 > MEMORY:
        raise ModesError(
            f"degree {modes.lmax} has {len(modes)} coefficients, whose normal matrix takes "
            f"{len(modes) ** 2 * 8 / 2**30:.0f} GiB: lower lmax, or use fit.solve_matrix_free"
        )
    if not isinstance(field, Field):
        if isinstance(field, np.ndarray) or not hasattr(field, "__iter__"):
            raise FieldError(f"a Field, or a stream of them, is wanted, not {type(field).__name__}")
        total: Any = sum(normal_equations(each, modes, method=method, threads=threads) for each in field)
        if isinstance(total, int):
            raise FieldError("the stream of fields is empty: there are no sources to use")
        return total
    if method == "auto" and modes.lmax == 1:
        sums = dipole_sums(field)
    elif method == "compressed" or (method == "auto" and len(field) > design_matrix_up_to(modes)):
        sums = compressed_sums(field, modes, threads)
    else:
        sums = design_matrix_sums(field, modes, threads)
    return NormalEquations(modes, *sums, 2 * len(field), field.frame, field.notes)


def gaussian_prior(
    modes: Modes | int, sigma: ArrayLike, mean: ArrayLike = 0.0, *, frame: str | None = None
) -> NormalEquations:
    """The prior c ~ N(mean, sigma²), as data: one number for each coefficient it bears on.

    Parameters
    ----------
    modes : Modes, or the degree lmax
        What to fit.
    sigma : float or (p,) array
        Standard deviations; inf says nothing [µas/yr]
    mean : float or (p,) array
        [µas/yr]
    frame : str, optional
        Of the axes, where the prior knows directions.

    Returns
    -------
    NormalEquations

    Raises
    ------
    ModesError
        If a sigma is not positive.
    """
    modes = as_modes(modes)
    sigma = float_array("sigma", sigma, (len(modes),), finite=False, broadcast=True)
    mean = float_array("mean", mean, (len(modes),), broadcast=True)
    if not (sigma > 0).all():
        raise ModesError("the standard deviations of a prior must be positive")
    weight = 1 / sigma**2
    return NormalEquations(
        modes, np.diag(weight), weight * mean, float(weight @ mean**2), int(np.isfinite(sigma).sum()), frame
    )
