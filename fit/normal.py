"""Normal equations: all that a least-squares fit needs to remember of the data."""

from dataclasses import dataclass

import numpy as np

from vsh.basis import toroidal_harmonics
from vsh.blocks import map_blocks
from vsh.errors import FrameError, ModesError
from vsh.modes import Modes


def block_size(p):
    """Sources worked on at a time: enough to keep NumPy busy, 64 MiB of whitened basis at most."""
    return max(256, min(2**16, 2**22 // p))


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """N c = b, summed over data. They add: chunks, catalogues and priors alike.

    Attributes
    ----------
    modes : Modes
        What the p unknowns are.
    matrix : (p, p) array
        N = Σ Aᵀ C⁻¹ A. [(yr/µas)²]
    rhs : (p,) array
        b = Σ Aᵀ C⁻¹ y. [yr/µas]
    chi2_zero : float
        Σ yᵀ C⁻¹ y, the χ² of fitting nothing.
    n_data : int
        How many numbers went in: two a source.
    frame : str or None
        Of the axes; None fits any (a prior that is the same along all axes).
    notes : tuple of str
        What the fields asked to be said.
    """

    modes: Modes
    matrix: np.ndarray
    rhs: np.ndarray
    chi2_zero: float
    n_data: int
    frame: str = None
    notes: tuple = ()

    def __add__(self, other):
        return self._combine(other, +1)

    def __sub__(self, other):
        """Take data away that went in before: a block of the sky, say."""
        return self._combine(other, -1)

    def __radd__(self, other):
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
            self.chi2_zero + sign * other.chi2_zero,
            self.n_data + sign * other.n_data,
            self.frame or other.frame,
            tuple(dict.fromkeys(self.notes + other.notes)),
        )


def normal_equations(field, modes, threads=None):
    """Sum a field into normal equations.

    Parameters
    ----------
    field : Field
    modes : Modes
    threads : int, optional
        How many; one a core unless given. The sum is taken in the order of the sources,
        so the number of threads does not change a bit of it.

    Examples
    --------
    The whole is the sum of its parts:

    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> field = Field(*rng.uniform(0, 1, (2, 100)), rng.normal(size=(2, 100)), np.ones((2, 100)))
    >>> whole, *parts = (normal_equations(f, Modes(2)) for f in (field, field[:30], field[30:]))
    >>> np.allclose(whole.matrix, sum(parts).matrix)
    True
    """
    p = len(modes)
    matrix, rhs, chi2_zero = np.zeros((p, p)), np.zeros(p), 0.0
    sums = map_blocks(lambda part: _block(field[part], modes.lmax), len(field), block_size(p), threads)
    for n, b, chi2 in sums:
        matrix += n
        rhs += b
        chi2_zero += chi2
    return NormalEquations(modes, matrix, rhs, chi2_zero, 2 * len(field), field.frame, field.notes)


def gaussian_prior(modes, sigma, mean=0.0, frame=None):
    """The prior c ~ N(mean, sigma²), as data: one number for each coefficient it bears on.

    Parameters
    ----------
    modes : Modes
    sigma : float or (p,) array — standard deviations; inf says nothing [µas/yr]
    mean : float or (p,) array — [µas/yr]
    frame : str, optional — of the axes, where the prior knows directions

    Raises
    ------
    ModesError
        If a sigma is not positive.
    """
    sigma, mean = (np.broadcast_to(np.asarray(x, float), len(modes)) for x in (sigma, mean))
    if not (sigma > 0).all():
        raise ModesError("the standard deviations of a prior must be positive")
    weight = 1 / sigma**2
    return NormalEquations(
        modes, np.diag(weight), weight * mean, float(weight @ mean**2), int(np.isfinite(sigma).sum()), frame
    )


def _block(field, lmax):
    """N, b and Σ yᵀ C⁻¹ y of a few sources, from the basis in units of each source's error."""
    s1, s2 = field.sigma
    root = np.sqrt(1 - field.rho**2)
    # L⁻¹ with L Lᵀ = C: rows (east, 0) and (mix, north).
    east, north, mix = 1 / s1, 1 / (s2 * root), -field.rho / (s1 * root)

    toroidal = toroidal_harmonics(field.lon, field.lat, lmax)
    t_east, t_north = toroidal[:, 0], toroidal[:, 1]
    half, n = t_east.shape
    a = np.empty((2 * half, 2, n))
    np.multiply(t_east, east, out=a[:half, 0])
    np.multiply(t_north, north, out=a[:half, 1])
    a[:half, 1] += t_east * mix
    # S is T turned by +90°: (e, n) -> (-n, e).
    np.multiply(t_north, -east, out=a[half:, 0])
    np.multiply(t_east, north, out=a[half:, 1])
    a[half:, 1] -= t_north * mix

    a = a.reshape(2 * half, 2 * n)
    y = np.concatenate([field.motion[0] * east, field.motion[0] * mix + field.motion[1] * north])
    return a @ a.T, a @ y, float(y @ y)
