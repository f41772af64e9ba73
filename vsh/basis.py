r"""The toroidal and spheroidal harmonics themselves, exactly, at any degree.

Mignard & Klioner (2012, A&A 547, A59), with Q = P̄ / cos δ so that
nothing is divided by cos δ and the poles are ordinary points:

    T_lm = (-1)^m / √(l(l+1)) · e^{imα} (B e_α - i A e_δ),   A = m Q_lm
    S_lm = (-1)^m / √(l(l+1)) · e^{imα} (i A e_α + B e_δ),   B = dP̄_lm/dδ

P̄_lm is the normalised Legendre function without the phase (-1)^m. The upward recurrence in l runs for all m at once;
to degree 1000 its sectoral start underflows only where the function itself is below 1e-100.
"""

import numpy as np

from vsh.modes import Modes, ScalarModes, as_modes
from vsh.sky.sphere import cos_sin_multiples, sin_cos
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray


@arguments.accepts(lon=arguments.array_with_dimensions(1), lat=arguments.array_with_dimensions(1))
def harmonics(lon: FloatArray, lat: FloatArray, modes: Modes | int) -> FloatArray:
    """The field of each mode at each source: the design matrix."""
    modes = as_modes(modes, None)
    if lon.shape != lat.shape:
        raise ParameterError(f"lon and lat have shapes {lon.shape} and {lat.shape}")
    if isinstance(modes, ScalarModes):
        return scalar_harmonics(lon, lat, modes.lmax)[:, None]
    toroidal = toroidal_harmonics(lon, lat, modes.lmax)
    return np.concatenate([toroidal, spheroidal_twin(toroidal)])


def spheroidal_twin(toroidal: FloatArray) -> FloatArray:
    """S is T turned by +90° about the line of sight: (e, n) → (-n, e), axis 1."""
    return np.stack([-toroidal[:, 1], toroidal[:, 0]], axis=1)


def toroidal_harmonics(lon: FloatArray, lat: FloatArray, lmax: int) -> FloatArray:
    """The toroidal half of `harmonics`: (lmax (lmax + 2), 2, n)."""
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    sin, cos = sin_cos(lat)
    cos_multiples, sin_multiples = cos_sin_multiples(lon, lmax)
    basis = np.empty((lmax * (lmax + 2), 2, lon.size))
    row = 0
    for l, q, q_below in _yield_legendre_over_cos(sin, cos, lmax):
        m = np.arange(1, l + 1)[:, None]
        # A real field needs m ≥ 0 alone, counted twice: 2 (t^R Re T - t^I Im T).
        norm = 2 * (-1.0) ** m / np.sqrt(l * (l + 1))
        a = (norm * m) * q
        b = (norm * -l) * (sin * q)
        if l > 1:
            b[:-1] += (norm[:-1] * np.sqrt((2 * l + 1) / (2 * l - 1) * (l * l - m[:-1] ** 2))) * q_below
        degree_rows = basis[row : row + 2 * l + 1]
        np.multiply(cos, q[0], out=degree_rows[0, 0])  # dP̄_l0/dδ = √(l(l+1)) P̄_l1
        degree_rows[0, 1] = 0.0
        np.multiply(b, cos_multiples[:l], out=degree_rows[1::2, 0])
        np.multiply(a, sin_multiples[:l], out=degree_rows[1::2, 1])
        np.multiply(b, -sin_multiples[:l], out=degree_rows[2::2, 0])
        np.multiply(a, cos_multiples[:l], out=degree_rows[2::2, 1])
        row += 2 * l + 1
    return basis


def scalar_harmonics(lon: FloatArray, lat: FloatArray, lmax: int) -> FloatArray:
    """The scalar harmonics Y_lm in the same order and norm: ((lmax + 1)², n), degree 0 first.

    A coefficient of one of a spheroidal mode is the gradient of these, over √(l(l+1)): Y_l0, then
    2 Re Y_lm and −2 Im Y_lm for m = 1 … l.
    """
    lon, lat = np.asarray(lon, float), np.asarray(lat, float)
    sin, cos = sin_cos(lat)
    basis = np.empty(((lmax + 1) ** 2, lon.size))
    basis[0] = 1 / np.sqrt(4 * np.pi)
    if lmax == 0:
        return basis
    cos_multiples, sin_multiples = cos_sin_multiples(lon, lmax)
    zonal, zonal_below = sin, np.ones_like(sin)  # P_l and P_l-1, not normalised
    for l, q, _ in _yield_legendre_over_cos(sin, cos, lmax):
        degree_rows = basis[l * l : (l + 1) ** 2]
        degree_rows[0] = np.sqrt((2 * l + 1) / (4 * np.pi)) * zonal
        norm = 2 * (-1.0) ** np.arange(1, l + 1)[:, None]
        np.multiply(norm * cos * q, cos_multiples[:l], out=degree_rows[1::2])
        np.multiply(-norm * cos * q, sin_multiples[:l], out=degree_rows[2::2])
        zonal, zonal_below = ((2 * l + 1) * sin * zonal - l * zonal_below) / (l + 1), zonal
    return basis


def _yield_legendre_over_cos(sin, cos, lmax):
    """P̄_lm(sin δ) / cos δ degree by degree: yields l, its (l, n) array for m = 1 … l, and that of l - 1."""
    q_below, q = np.empty((0, sin.size)), np.full((1, sin.size), np.sqrt(3 / (8 * np.pi)))
    for l in range(1, lmax + 1):
        yield l, q, q_below
        if l == lmax:
            return
        n, m = l + 1, np.arange(1, l + 1)[:, None]
        q_above = np.empty((n, sin.size))
        np.multiply(sin, q, out=q_above[:-1])
        q_above[: l - 1] -= np.sqrt((l * l - m[:-1] ** 2) / (4 * l * l - 1)) * q_below
        q_above[:-1] *= np.sqrt((4 * n * n - 1) / (n * n - m * m))
        # (m, m) from (m - 1, m - 1), and it alone brings a factor cos δ.
        q_above[-1] = np.sqrt((2 * l + 3) / (2 * l + 2)) * cos * q[-1]
        q_below, q = q, q_above
