"""The dense covariance of the motions of some sources, and what it whitens."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from vsh.checks.arrays import float_array, read_only
from vsh.checks.frozen import Frozen
from vsh.checks.types import FloatArray
from vsh.errors import CovarianceError, ParameterError
from vsh.field import Field

#: More sources have matrices that no machine of today likes: 3 GiB at 10 000, and as much again for its factor.
MAX_SOURCES = 10_000


@dataclass(frozen=True, eq=False, repr=False)
class Covariance(Frozen):
    """The covariance of the motions of n sources, all east components first, then all north ones. Two of them add.

    Attributes
    ----------
    matrix : (2n, 2n) array
        Symmetric and positive definite, where it is to whiten something. [(µas/yr)²]

    Raises
    ------
    ParameterError
        If it is not square, not symmetric, or too large.
    """

    matrix: FloatArray

    def __post_init__(self) -> None:
        shape = np.shape(self.matrix)
        if len(shape) != 2 or shape[0] != shape[1] or shape[0] % 2 or not shape[0]:
            raise ParameterError(
                f"a covariance of n sources has shape (2n, 2n), all east components first, not {shape}"
            )
        check_size(shape[0] // 2)
        matrix = float_array("the covariance", self.matrix)
        for rows in np.array_split(np.arange(shape[0]), max(1, matrix.size // 2**24)):  # no second matrix of its size
            if (matrix[rows, rows] < 0).any():
                raise ParameterError(
                    f"the covariance has a negative variance: of component {rows[matrix[rows, rows] < 0][0]}"
                )
            size = np.sqrt(np.outer(np.diag(matrix)[rows], np.diag(matrix)))
            if (np.abs(matrix[rows] - matrix[:, rows].T) > 1e-8 * size + 1e-300).any():
                raise ParameterError("the covariance is not symmetric")
        object.__setattr__(self, "matrix", read_only(matrix))

    def __len__(self) -> int:
        return len(self.matrix) // 2

    def __repr__(self) -> str:
        return f"<Covariance: {len(self)} sources>"

    def __getitem__(self, keep: Any) -> Covariance:
        """Of the sources picked by a mask, a slice or indices."""
        rows = np.arange(len(self))[keep]
        rows = np.concatenate([rows, rows + len(self)])
        return Covariance(self.matrix[np.ix_(rows, rows)])

    def __add__(self, other: Any) -> Covariance:
        if not isinstance(other, Covariance):
            return NotImplemented
        if len(other) != len(self):
            raise ParameterError(f"covariances of {len(self)} and of {len(other)} sources do not add")
        return Covariance(self.matrix + other.matrix)

    @cached_property
    def factor(self) -> FloatArray:
        """L of L Lᵀ, lower triangular, (2n, 2n). [µas/yr]

        Raises
        ------
        CovarianceError
            If the matrix is not positive definite.
        """
        # Fortran's view of a symmetric matrix is itself: its upper triangle is our lower one.
        factor, info = dpotrf(self.matrix.T, lower=1, clean=1)
        if info:
            part, source = ("east", "north")[(info - 1) // len(self)], (info - 1) % len(self)
            raise CovarianceError(
                f"the covariance is not positive definite: the {part} component of source {source} is determined by "
                "those before it, or more than that; add the errors of the sources (vsh.covariance.of_errors)"
            )
        return factor

    def whiten(self, rows: FloatArray) -> FloatArray:
        """Rows of motions decorrelated and in units of their errors: L⁻¹ applied to each, (…, 2n).

        Parameters
        ----------
        rows : (…, 2n) array
            East components first, as the matrix has them.

        Raises
        ------
        CovarianceError
            If the matrix is not positive definite.
        """
        rows = np.asarray(rows, float)
        flat = rows.reshape(-1, 2 * len(self))
        return solve_triangular(self.factor, flat.T, lower=True, check_finite=False).T.reshape(rows.shape)

    def own_errors(self, field: Field) -> Field:
        """The field with the errors that the matrix gives each source by itself.

        Parameters
        ----------
        field : Field
            Of the same sources.

        Raises
        ------
        ParameterError
            If it is of another number of sources.
        """
        n = len(as_covariance(self, field))
        sigma = np.sqrt(np.diag(self.matrix)).reshape(2, n)
        cross = self.matrix[np.arange(n), np.arange(n) + n]
        return field.with_errors(sigma, cross / np.where(sigma.all(0), sigma[0] * sigma[1], 1.0))


def as_covariance(value: Any, field: Any) -> Covariance:
    """What a user gives for the covariance of a field: a matrix or a Covariance, of as many sources."""
    if not isinstance(field, Field):
        raise ParameterError(f"a dense covariance is of the sources of one Field, not of {type(field).__name__}")
    found = value if isinstance(value, Covariance) else Covariance(value)
    if len(found) != len(field):
        raise ParameterError(f"the covariance is of {len(found)} sources, the field of {len(field)}")
    return found


def check_size(n_sources: int) -> None:
    """Raise ParameterError where a dense matrix would be too large, before it is made."""
    if n_sources > MAX_SOURCES:
        raise ParameterError(
            f"the dense covariance of {n_sources} sources takes {32 * n_sources**2 / 2**30:.0f} GiB; the most are "
            f"{MAX_SOURCES} sources. Use the spectrum in its place: fit.background.floor(normal) estimates it, and "
            "fit.solve(normal, floor=…) allows for it, with any number of sources"
        )
