"""Covariances of sources: their own errors, and what they share."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from vsh.basis import harmonics
from vsh.checks import arguments
from vsh.checks.arrays import float_array
from vsh.checks.types import ArrayLike, FloatArray, PathName
from vsh.covariance._angular import values_of
from vsh.covariance._files import read_matrix
from vsh.covariance._matrix import Covariance, check_size
from vsh.covariance._spectrum import Spectrum
from vsh.errors import ParameterError
from vsh.field import Field
from vsh.modes import as_modes
from vsh.sky.sphere import triad
from vsh.system.parallel import map_blocks


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
    >>> from vsh.covariance import LINDEGREN_2021
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
    """What groups of sources share: those of an experiment, of a station, of a field of view.

    Parameters
    ----------
    blocks : iterable of (sources, covariance)
        Indices or a mask of k sources, and what they share: a (2k, 2k) matrix, all east components first, or one
        number, the variance of an error that all of them have in each component. Blocks may overlap; they add.
        [(µas/yr)²]
    n_sources : int
        How many there are in all.

    Raises
    ------
    ParameterError
        If a matrix does not fit its sources, or a source is not there.

    Examples
    --------
    >>> from_blocks([([0, 1], 4.0)], 3).matrix[:3, :3]
    array([[4., 4., 0.],
           [4., 4., 0.],
           [0., 0., 0.]])
    """
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


def read(path: PathName) -> Covariance:
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
