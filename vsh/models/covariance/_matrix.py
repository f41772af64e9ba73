"""The dense covariance of the motions of some sources, and what it whitens."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.linalg import solve_triangular
from scipy.linalg.lapack import dpotrf

from vsh.basis import harmonics
from vsh.field import Field
from vsh.models.covariance._spectrum import Spectrum, values_of
from vsh.modes import as_modes
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import float_array, read_only
from vsh.tools.errors import CovarianceError, ParameterError, TableError, first_line
from vsh.tools.notebook import Frozen
from vsh.tools.parallel import map_blocks
from vsh.tools.types import ArrayLike, FloatArray, PathName

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
        """The covariance of the sources picked by a mask, a slice or indices."""
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
                "those before it, or more than that; add the errors of the sources (vsh.models.covariance.of_errors)"
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
        """The `field` of the same sources with the errors that the matrix gives each by itself.

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
    matrix = value if isinstance(value, Covariance) else Covariance(value)
    if len(matrix) != len(field):
        raise ParameterError(f"the covariance is of {len(matrix)} sources, the field of {len(field)}")
    return matrix


def check_size(n_sources: int) -> None:
    """Raise ParameterError where a dense matrix would be too large, before it is made."""
    if n_sources > MAX_SOURCES:
        raise ParameterError(
            f"the dense covariance of {n_sources} sources takes {32 * n_sources**2 / 2**30:.0f} GiB; the most are "
            f"{MAX_SOURCES} sources. Use the spectrum in its place: fit.background.floor(normal) estimates it, and "
            "fit.solve(normal, floor=…) allows for it, with any number of sources"
        )


def read_matrix(path: PathName, check_shape: Callable[[tuple[int, ...]], Any]) -> FloatArray:
    """A matrix from a file: NumPy's .npy, the first image of two axes of a FITS file, or numbers as text."""
    path = Path(path)
    ending = path.suffix.lower()
    if ending == ".npy":
        with _refused(path):
            matrix = np.load(path, mmap_mode="r", allow_pickle=False)
        check_shape(matrix.shape)
    elif ending in (".fits", ".fit"):
        matrix = _from_fits(path, check_shape)
    else:
        with _refused(path):
            matrix = np.loadtxt(path, ndmin=2)
        check_shape(matrix.shape)
    with _refused(path):
        return np.array(matrix, float)


def _from_fits(path, check_shape):
    from astropy.io import fits

    with _refused(path):
        units = fits.open(path)
    with units:
        with _refused(path):
            images = [
                unit for unit in units if unit.is_image and unit.header.get("NAXIS") == 2 and "NAXIS2" in unit.header
            ]
            if not images:
                raise TableError(f"{path} holds no image of two axes")
        with _refused(path):
            shape = images[0].shape
        check_shape(shape)
        with _refused(path):
            return np.array(images[0].data, float)


@contextmanager
def _refused(path):
    try:
        yield
    except TableError:
        raise
    except Exception as error:  # whatever a damaged file makes of NumPy or Astropy, a tokenizer's error included
        raise TableError(f"{path} holds no matrix that can be read: {first_line(error)}") from None


@arguments.accepts(field=arguments.a(Field))
def of_errors(field: Field) -> Covariance:
    """The sources' own errors, which no two of them share."""
    check_size(len(field))
    (s1, s2), n = field.sigma, len(field)
    matrix = np.diag(np.concatenate([s1, s2]) ** 2)
    cross = np.arange(n), np.arange(n) + n
    matrix[cross] = matrix[cross[::-1]] = field.rho * s1 * s2
    return Covariance(matrix)


@arguments.accepts(field=arguments.a(Field))
def from_function(field: Field, function: Callable[[FloatArray], FloatArray]) -> Covariance:
    """What sources share that lie at an angle θ: V(θ), with motions carried along the great circle.

    Parameters
    ----------
    field : Field
        The sources; its errors do not count: add `of_errors(field)`.
    function : function of θ [rad]
        V. [(µas/yr)²]

    Returns
    -------
    Covariance
        In the axes of the field.

    Raises
    ------
    ParameterError
        If there are more than `MAX_SOURCES`, or V is no function of θ.

    Examples
    --------
    >>> from vsh.models.covariance import LINDEGREN_2021
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 50)), rng.normal(size=(2, 50)), np.ones((2, 50)))
    >>> of_errors(field) + from_function(field, LINDEGREN_2021)
    <Covariance: 50 sources>
    """
    n = len(field)
    check_size(n)
    p, q, r = triad(field.lon, field.lat)
    matrix = np.empty((2, n, 2, n))

    def fill(part):
        across = r[:, part].T @ r
        # Half the chord keeps small angles; the cosine alone loses them.
        chord = np.linalg.norm(r[:, part, None] - r[:, None], axis=0)
        value = values_of(function, 2 * np.arcsin(np.minimum(chord / 2, 1.0)))
        # The parallel transport of a from r to r': a − (a·r') (r + r')/(1 + r·r').
        share = 1 / np.maximum(1 + across, 1e-300)
        for i, a in enumerate((p, q)):
            for j, b in enumerate((p, q)):
                turned = a[:, part].T @ b - (a[:, part].T @ r) * (r[:, part].T @ b) * share
                matrix[i, part, j] = value * np.clip(turned, -1, 1)

    for _ in map_blocks(fill, n, max(16, 2**22 // n)):
        pass
    whole = matrix.reshape(2 * n, 2 * n)
    whole[n:, :n] = whole[:n, n:].T
    return Covariance(whole)


@arguments.accepts(field=arguments.a(Field), spectrum=arguments.a(Spectrum))
def from_spectrum(field: Field, spectrum: Spectrum, lmax: int) -> Covariance:
    """What a random field of a given spectrum, cut at a degree, gives sources to share: A D Aᵀ.

    Parameters
    ----------
    field : Field
        The sources; its errors do not count: add `of_errors(field)`.
    spectrum : Spectrum
        Power of each kind and degree.
    lmax : int
        The highest degree.

    Raises
    ------
    ParameterError
        If there are more than `MAX_SOURCES`.
    """
    check_size(len(field))
    modes = as_modes(lmax)
    rows = harmonics(field.lon, field.lat, modes).reshape(len(modes), -1)
    rows *= np.sqrt(spectrum.variances(modes))[:, None]
    return Covariance(rows.T @ rows)


@arguments.accepts(n_sources=arguments.whole)
def from_blocks(blocks: Iterable[tuple[ArrayLike, Any]], n_sources: int) -> Covariance:
    """What groups of sources share: those of an experiment, of a station, of a field of view."""
    check_size(n_sources)
    matrix = np.zeros((2 * n_sources, 2 * n_sources))
    if not isinstance(blocks, Iterable):
        raise ParameterError(f"blocks are pairs of sources and what they share, not {blocks!r}")
    for number, block in enumerate(blocks):
        if not isinstance(block, tuple | list) or len(block) != 2:
            raise ParameterError(f"block {number} is no pair of sources and what they share")
        sources, shared = block
        try:
            rows = np.arange(n_sources)[np.asarray(sources)]
        except (IndexError, TypeError):
            raise ParameterError(f"block {number} names sources that are not among the {n_sources}") from None
        k = len(rows)
        if len(set(rows.tolist())) < k:
            raise ParameterError(f"block {number} names a source twice")
        value = float_array(f"the covariance of block {number}", shared)
        if not value.ndim:
            value = np.kron(np.eye(2), np.full((k, k), value))
        if value.shape != (2 * k, 2 * k):
            raise ParameterError(
                f"block {number} has {k} sources and a covariance of shape {value.shape}: ({2 * k}, {2 * k}) is wanted"
            )
        both = np.concatenate([rows, rows + n_sources])
        matrix[np.ix_(both, both)] += value
    return Covariance(matrix)


@arguments.explained
def read_covariance(path: PathName) -> Covariance:
    """A covariance from a file: NumPy's .npy, the first image of a FITS file, or numbers as text.

    Parameters
    ----------
    path : str or Path
        The file, whose (2n, 2n) matrix has all east components first. [(µas/yr)²]

    Raises
    ------
    TableError
        If it cannot be read.
    ParameterError
        If what it holds is no covariance, or too large.
    """
    return Covariance(read_matrix(path, lambda shape: check_size(max(shape, default=0) // 2)))
