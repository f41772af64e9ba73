"""The harmonics without a matrix, at any positions: the one file that knows ducc0.

Sizes, angles and types are checked or set here, before ducc0 sees them: it would read a
short array out of bounds, and go on over the pole in silence.
"""

from collections.abc import Callable
from typing import cast

import ducc0
import numpy as np

from vsh.coefficients import Coefficients
from vsh.conventions import from_healpy, scalar_from_healpy, scalar_to_healpy, to_healpy
from vsh.modes import Modes, ScalarModes, as_modes
from vsh.scalars import ScalarCoefficients
from vsh.tools import arguments
from vsh.tools.errors import FieldError
from vsh.tools.parallel import thread_count
from vsh.tools.types import ArrayLike, ComplexArray, FloatArray

__all__ = ["adjoint", "synthesis"]

#: Relative accuracy asked of ducc0; it reaches 2e-13 at best in double precision.
EPSILON = 5e-13


@arguments.accepts(coefficients=arguments.a(Coefficients), lon=arguments.float_array, lat=arguments.float_array)
def synthesis(coefficients: Coefficients, lon: ArrayLike, lat: ArrayLike) -> FloatArray:
    """The field at each position, as `Coefficients.at` gives it, to 1e-12 of its size.

    Takes time ∝ n + lmax³ where the exact sum takes n · lmax².

    Parameters
    ----------
    coefficients : Coefficients or ScalarCoefficients
        The field. [µas/yr]
    lon, lat : (n,) arrays
        Positions [rad]

    Returns
    -------
    (2, n) array; (n,) of a scalar field
        East and north component. [µas/yr]

    Raises
    ------
    FieldError
        If positions are not finite, differ in number, or lie beyond a pole.
    """
    return _synthesize_field(coefficients, _make_locations(lon, lat), EPSILON)


@arguments.accepts(lon=arguments.float_array, lat=arguments.float_array, motion=arguments.float_array)
def adjoint(
    modes: Modes | int, lon: ArrayLike, lat: ArrayLike, motion: ArrayLike, *, threads: int | None = None
) -> FloatArray:
    """Σ over the sources of motion · V_i for every mode i: Aᵀ y for the design matrix A.

    Parameters
    ----------
    modes : Modes or ScalarModes, or the degree lmax of vector fields
        The modes V_i; p of them.
    lon, lat : (n,) arrays
        Positions [rad]
    motion : (2, n) array; (1, n) for scalar modes
        East and north component.
    threads : int, optional
        How many; one a core unless given.

    Returns
    -------
    (p,) array
        With several threads the order of the sums, and so the last bits, may vary from call to call.

    Raises
    ------
    FieldError
        As in `synthesis`, and if motion has another shape.

    Examples
    --------
    A motion northwards at the origin, in the modes of a glide: all of it along z.

    >>> from vsh import Modes
    >>> g = adjoint(Modes(1), [0.0], [0.0], [[0.0], [1.0]])[3:]
    >>> bool(g[0] > 0.3), bool(abs(g[1:]).max() < 1e-12)
    (True, True)
    """
    loc, modes = _make_locations(lon, lat), as_modes(modes, None)
    motion = np.asarray(motion, float)
    if motion.shape != (modes.components, len(loc)):
        raise FieldError(f"motion has shape {motion.shape}, expected {(modes.components, len(loc))}")
    return _sum_by_mode(modes, loc, motion, EPSILON, threads)


def project_response(
    coefficients: Coefficients,
    lon: ArrayLike,
    lat: ArrayLike,
    response: Callable[[FloatArray], FloatArray],
    epsilon: float,
) -> FloatArray:
    """Aᵀ f(A c), (p,): the field at each position, a function of it, and the sum over the sources for every mode.

    `response` takes and gives an array of shape (2, n), or (1, n) of scalars; `epsilon` is the relative accuracy.
    """
    loc, modes = _make_locations(lon, lat), coefficients.modes
    field = np.atleast_2d(_synthesize_field(coefficients, loc, epsilon))
    return _sum_by_mode(modes, loc, response(field), epsilon, None)


def _synthesize_field(coefficients, loc, epsilon):
    """The field at each location, (2, n); (n,) of a scalar field."""
    is_scalar = isinstance(coefficients.modes, ScalarModes)
    components = ducc0.sht.synthesis_general(
        alm=scalar_to_healpy(cast(ScalarCoefficients, coefficients))[None] if is_scalar else to_healpy(coefficients),
        spin=0 if is_scalar else 1,
        lmax=coefficients.modes.lmax,
        loc=loc,
        epsilon=epsilon,
        nthreads=thread_count(),
    )
    if is_scalar:
        return components[0]
    np.negative(components[0], out=components[0])
    return components[::-1]  # a copy would take as long as the transform


def _sum_by_mode(modes, loc, motion, epsilon, threads):
    """Σ motion · V_i for every mode, (p,)."""
    is_scalar = isinstance(modes, ScalarModes)
    alm = ducc0.sht.adjoint_synthesis_general(
        map=motion if is_scalar else np.stack([-motion[1], motion[0]]),
        spin=0 if is_scalar else 1,
        lmax=modes.lmax,
        loc=loc,
        epsilon=epsilon,
        nthreads=thread_count(threads),
    )
    return modes.norm2 * (scalar_from_healpy(alm[0]) if is_scalar else from_healpy(alm)).values


def fourier_moments(
    lon: ArrayLike, lat: ArrayLike, planes: FloatArray, max_order: int, epsilon: float = EPSILON
) -> ComplexArray:
    """Σ over the sources of planes · e^{−i(Mα + nδ)}, a non-uniform Fourier transform of (k, n) real numbers.

    Two of them travel as one complex one; their symmetry separates them.
    """
    packed = np.zeros(((len(planes) + 1) // 2, planes.shape[1]), complex)
    packed.real, packed.imag[: len(planes) // 2] = planes[::2], planes[1::2]
    moments = np.zeros((len(packed), 2 * max_order + 1, 2 * max_order + 1), complex)
    if planes.size:
        coord = np.stack([lon, lat], axis=1)
        ducc0.nufft.nu2u(
            points=packed, coord=coord, forward=True, epsilon=epsilon, nthreads=1, out=moments, periodicity=2 * np.pi
        )
    mirrored_moments = np.conj(moments[:, ::-1, ::-1])
    separated_moments = np.stack([(moments + mirrored_moments) / 2, (moments - mirrored_moments) / 2j], axis=1)
    return separated_moments.reshape(-1, *moments.shape[1:])[: len(planes)]


def _make_locations(lon, lat):
    """Colatitude and longitude within the ranges that ducc0 knows, (n, 2)."""
    lon, lat = np.atleast_1d(np.asarray(lon, float)), np.atleast_1d(np.asarray(lat, float))
    if lon.ndim != 1 or lon.shape != lat.shape:
        raise FieldError(f"lon and lat have shapes {lon.shape} and {lat.shape}: one of each for a source")
    if (np.abs(lat) > np.pi / 2 * (1 + 1e-14)).any():
        raise FieldError(f"{np.sum(np.abs(lat) > np.pi / 2)} latitudes lie beyond a pole: are they in radians?")
    loc = np.empty((lon.size, 2))
    np.clip(np.pi / 2 - lat, 0, np.pi, out=loc[:, 0])
    if lon.size and lon.min() >= 0 and lon.max() < 2 * np.pi:
        loc[:, 1] = lon
    else:
        phi = lon % (2 * np.pi)
        loc[:, 1] = np.where(phi < 2 * np.pi, phi, 0.0)  # a tiny negative angle rounds up
    return loc
