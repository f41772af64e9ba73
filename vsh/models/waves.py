"""One plane gravitational wave: the motions that it gives to sources far away, and their coefficients.

The deflection by a plane gravitational wave at the observer, exactly and by degree.

A wave that travels along k and strains space by h at the Earth moves a source at r by (Pyne et al. 1996, ApJ 465, 566;
Book & Flanagan 2011, PRD 83, 024024, eq. 58)

    V = ½ [(r + k) (rᵀ h r)/(1 + k·r) − h r].

h stands for the rate of the strain where V is a motion [µas/yr], for the strain where it is a displacement. Its two
polarisations are h = plus (e_θ e_θᵀ − e_φ e_φᵀ) + cross (e_θ e_φᵀ + e_φ e_θᵀ) with e_θ south and e_φ east at k, which
along +z are x and y.
"""

import numpy as np

from vsh.coefficients import Coefficients
from vsh.models.covariance import wave_fractions
from vsh.modes import Modes
from vsh.rotate import degree_matrix
from vsh.sky.sphere import angles, triad
from vsh.tools import arguments
from vsh.tools.arguments import float_array, number, positive
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray
from vsh.tools.units import JULIAN_YEAR, UAS

__all__ = ["wave_coefficients", "wave_motions"]


def wave_motions(lon: ArrayLike, lat: ArrayLike, direction: ArrayLike, plus: float, cross: float = 0.0) -> FloatArray:
    """V at each position, (2, n), in the unit of plus and cross.

    Parameters
    ----------
    lon, lat : (n,) arrays
        Positions. [rad]
    direction : (3,) array
        k, where the wave travels to; of any length. Its source is on the other side of the sky.
    plus, cross : float
        Rates of strain of the two polarisations. [µas/yr]
    """
    k, lon = unit_vector(direction), np.atleast_1d(float_array("lon", lon))
    east, north, r = triad(lon, float_array("lat", np.atleast_1d(lat), lon.shape))
    tensor = number("plus", plus) * _make_strain_tensor(k, 1, 0) + number("cross", cross) * _make_strain_tensor(k, 0, 1)
    strained_r = tensor @ r
    numerator = np.sum(r * strained_r, axis=0)
    denominator = 1 + k @ r
    # Where the wave comes from, both rᵀhr and 1 + k·r are zero to second order: the quotient is finite, and r + k zero.
    with np.errstate(divide="ignore", invalid="ignore"):
        quotient = np.where(denominator > 1e-12, numerator / denominator, 0.0)
    motion = ((r + k[:, None]) * quotient - strained_r) / 2
    return np.stack([np.sum(motion * east, axis=0), np.sum(motion * north, axis=0)])


def _make_strain_tensor(k, plus, cross):
    lon, lat = angles(k)
    east, north, _ = triad(lon, lat)
    mixed = np.outer(north, east)
    return plus * (np.outer(north, north) - np.outer(east, east)) - cross * (mixed + mixed.T)


def unit_vector(direction: ArrayLike) -> FloatArray:
    """A direction as a unit vector, (3,)."""
    vector = float_array("direction", direction, (3,))
    if not np.linalg.norm(vector) > 0:
        raise ParameterError("direction is where the wave travels to: a vector of some length")
    return vector / np.linalg.norm(vector)


def compute_degree_amplitudes(lmax: int) -> FloatArray:
    """c_l = (−1)^l √(π α_l/6), coefficients of a wave of unit rate along z, (lmax,), α_l those of a background."""
    l = np.arange(1, arguments.whole("lmax", lmax) + 1)
    return np.asarray((-1.0) ** l * np.sqrt(np.pi * wave_fractions(lmax) / 6), float)


def wave_coefficients(direction: ArrayLike, plus: float, cross: float = 0.0, *, lmax: int = 12) -> Coefficients:
    """The coefficients of one wave to a degree; it has none of degree 1.

    Parameters
    ----------
    direction, plus, cross
        As for `wave_motions`.
    lmax : int
        The highest degree.

    Examples
    --------
    Along z, a plus wave has t(l,2,im) = c_l and s(l,2,re) = −c_l:

    >>> from vsh import Mode
    >>> wave = wave_coefficients((0, 0, 1), 1.0, lmax=2)
    >>> float(wave.values[wave.modes.index(Mode("T", 2, 2, "im"))].round(6))
    0.660555
    """
    templates = wave_templates(unit_vector(direction)[:, None], lmax)[..., 0]
    return Coefficients(Modes(lmax), number("plus", plus) * templates[0] + number("cross", cross) * templates[1])


def wave_templates(directions: FloatArray, lmax: int) -> FloatArray:
    """The coefficients of both polarisations for many directions, (2, p, n)."""
    modes, amplitude = Modes(lmax), compute_degree_amplitudes(lmax)
    lon, lat = angles(directions)
    tilts, tilt_index = np.unique(np.pi / 2 - lat, return_inverse=True)
    templates = np.zeros((2, len(modes), directions.shape[1]))
    for l in range(2, lmax + 1):
        re_row, im_row = 2 * 2 - 1, 2 * 2  # of order 2 within a degree
        columns = np.zeros((2 * l + 1, 4))  # of T and S, plus and cross
        for column, (row, sign) in enumerate(((im_row, 1), (re_row, 1), (re_row, -1), (im_row, 1))):
            columns[row, column] = sign * amplitude[l - 1]
        tilted_waves = np.array([degree_matrix(l, np.array([0.0, tilt, 0.0])) @ columns for tilt in tilts])[tilt_index]
        coefficients = _rotate_about_z(tilted_waves, lon, l)
        for polarisation in range(2):
            templates[polarisation, modes.slice_of("T", l)] = coefficients[:, :, polarisation].T
            templates[polarisation, modes.slice_of("S", l)] = coefficients[:, :, 2 + polarisation].T
    return templates


def _rotate_about_z(coefficients, angle, l):
    """Coefficients of one degree, (n, 2l + 1, …), turned about z by an angle each: f e^{−imφ}."""
    rotated = coefficients.copy()
    m = np.arange(1, l + 1)
    cos, sin = (function(np.multiply.outer(angle, m))[..., None] for function in (np.cos, np.sin))
    re, im = coefficients[:, 1::2], coefficients[:, 2::2]
    rotated[:, 1::2], rotated[:, 2::2] = cos * re + sin * im, cos * im - sin * re
    return rotated


def compute_strain(rate: ArrayLike, frequency: float) -> FloatArray:
    """The amplitude of the strain of a wave of a frequency whose rate is seen, h = ḣ/2πf."""
    return float_array("rate", rate) * UAS / JULIAN_YEAR / (2 * np.pi * 1e-9 * positive("frequency", frequency))
