"""To and from other people's coefficients: ICRF3's R, D, E, M, Vityazev and Tsvetkov's t_nkp, healpy's E/B alm.

Signs and factors are those of docs/theory.md; a test pins each.
"""

import re
from collections.abc import Mapping
from functools import lru_cache

import numpy as np

from vsh.coefficients import Coefficients
from vsh.modes import Mode, Modes, ScalarModes
from vsh.scalars import ScalarCoefficients
from vsh.tools.errors import ModesError
from vsh.tools.types import ArrayLike, ComplexArray, FloatArray

__all__ = [
    "from_healpy",
    "from_icrf3",
    "from_vityazev",
    "scalar_from_healpy",
    "scalar_to_healpy",
    "to_healpy",
    "to_icrf3",
    "to_vityazev",
]

_1, _20, _21, _22 = (np.sqrt(x * np.pi / 15) for x in (20, 32, 12, 48))

#: name: (mode, factor), our coefficient = factor × theirs (Charlot et al. 2020, eq. 9).
#: Their rotation is −(R × r), so R1, R2, R3 turn against our ω; the glides agree.
ICRF3 = {
    "R1": (Mode("T", 1, 1, "re"), _1),
    "R2": (Mode("T", 1, 1, "im"), -_1),
    "R3": (Mode("T", 1, 0), -_1 * np.sqrt(2)),
    "D1": (Mode("S", 1, 1, "re"), -_1),
    "D2": (Mode("S", 1, 1, "im"), _1),
    "D3": (Mode("S", 1, 0), _1 * np.sqrt(2)),
    "E20": (Mode("S", 2, 0), _20),
    "M20": (Mode("T", 2, 0), _20),
    "E21R": (Mode("S", 2, 1, "re"), _21),
    "E21I": (Mode("S", 2, 1, "im"), _21),
    "M21R": (Mode("T", 2, 1, "re"), _21),
    "M21I": (Mode("T", 2, 1, "im"), _21),
    "E22R": (Mode("S", 2, 2, "re"), _22),
    "E22I": (Mode("S", 2, 2, "im"), _22),
    "M22R": (Mode("T", 2, 2, "re"), _22),
    "M22I": (Mode("T", 2, 2, "im"), _22),
}


def to_icrf3(coefficients: Coefficients) -> dict[str, float]:
    """The parameters of degrees 1 and 2 under the names and signs of the ICRF3 papers.

    Degrees above 2 have no such names and are left out.

    Parameters
    ----------
    coefficients : Coefficients
        The field. [µas/yr]

    Returns
    -------
    dict
        From R1, R2, R3, D1, D2, D3 and, to degree 2, E20, M20, E21R, … M22I to their values. [unit of the coefficients]

    Examples
    --------
    >>> theirs = to_icrf3(Coefficients.from_vectors(rotation=(1, 2, 3)))
    >>> [round(theirs[name], 9) for name in ("R1", "R2", "R3")]
    [-1.0, -2.0, -3.0]
    """
    modes, values = coefficients.modes, coefficients.values
    return {
        name: float(values[modes.index(mode)] / factor)
        for name, (mode, factor) in ICRF3.items()
        if mode.l <= modes.lmax
    }


def to_icrf3_terms(coefficients: Coefficients, sigma: FloatArray) -> dict[str, tuple[float, float]]:
    """(value, error) by name: `to_icrf3` with the errors of the coefficients, (p,), and ours of degree 3 and higher."""
    terms = {
        name: (value, float(sigma[coefficients.modes.index(ICRF3[name][0])] / abs(ICRF3[name][1])))
        for name, value in to_icrf3(coefficients).items()
    }
    modes_values_errors = zip(coefficients.modes, coefficients.values, sigma, strict=True)
    return terms | {str(mode): (float(value), float(error)) for mode, value, error in modes_values_errors if mode.l > 2}


def from_icrf3(parameters: Mapping[str, float]) -> Coefficients:
    """Coefficients from a dict of ICRF3 parameters; those not named are zero.

    Parameters
    ----------
    parameters : dict of str to float
        As `to_icrf3` gives them. [µas/yr]

    Raises
    ------
    ModesError
        If a name is not one of ICRF3's.
    """
    invalid_names = [name for name in parameters if name not in ICRF3]
    if invalid_names:
        raise ModesError(f"ICRF3 has no parameter {', '.join(invalid_names)}; it has {', '.join(ICRF3)}")
    modes = Modes(max((ICRF3[name][0].l for name in parameters), default=1))
    values = np.zeros(len(modes))
    for name, value in parameters.items():
        mode, factor = ICRF3[name]
        values[modes.index(mode)] = factor * value
    return Coefficients(modes, values)


def _find_vityazev_name_and_factor(mode):
    """The name t_nkp of a mode and the factor from our coefficient to theirs: orthonormal real harmonics."""
    name = f"{mode.kind.lower()}_{mode.l}.{mode.m}.{0 if mode.part == 'im' else 1}"
    if mode.m == 0:
        return name, 1.0
    return name, np.sqrt(2) * (-1) ** mode.m * (1 if mode.part == "re" else -1)


def to_vityazev(coefficients: Coefficients) -> dict[str, float]:
    """Coefficients under the names of Vityazev & Tsvetkov (2014, MNRAS 442, 1249), whom Malkin follows.

    Parameters
    ----------
    coefficients : Coefficients
        The field. [µas/yr]

    Returns
    -------
    dict
        "t_n.k.p" and "s_n.k.p": degree n, order k, p = 1 for cos kα and 0 for sin kα, of harmonics that are orthonormal
        over the sphere. A rotation is t_1.1.1, t_1.1.0, t_1.0.1 = 2.894 (ω_x, ω_y, ω_z), a glide the same in s.

    Examples
    --------
    >>> theirs = to_vityazev(Coefficients.from_vectors(rotation=(1, 2, 3)))
    >>> [round(theirs[name], 3) for name in ("t_1.1.1", "t_1.1.0", "t_1.0.1")]
    [2.894, 5.789, 8.683]
    """
    terms = [_find_vityazev_name_and_factor(mode) for mode in coefficients.modes]
    return {name: float(factor * v) for (name, factor), v in zip(terms, coefficients.values, strict=True)}


def from_vityazev(parameters: Mapping[str, float]) -> Coefficients:
    """Coefficients from a dict as `to_vityazev` gives it; those not named are zero.

    Parameters
    ----------
    parameters : dict of str to float
        By "t_n.k.p" and "s_n.k.p". [µas/yr]

    Raises
    ------
    ModesError
        If a name is none of theirs.

    Examples
    --------
    >>> round(float(from_vityazev({"s_1.0.1": 2.8944}).glide[2]), 3)
    1.0
    """
    matches = [re.fullmatch(r"[ts]_(\d+)\.\d+\.[01]", name) for name in parameters]
    modes = Modes(max([int(match[1]) for match in matches if match], default=1))
    terms = {name: (i, factor) for i, (name, factor) in enumerate(map(_find_vityazev_name_and_factor, modes))}
    invalid_names = [name for name in parameters if name not in terms]
    if invalid_names:
        raise ModesError(f"no harmonic is called {', '.join(invalid_names)}: t_2.1.0 is T of degree 2, order 1, sine")
    values = np.zeros(len(modes))
    for name, value in parameters.items():
        i, factor = terms[name]
        values[i] = value / factor
    return Coefficients(modes, values)


def to_healpy(coefficients: Coefficients) -> ComplexArray:
    """E and B alm of the spin-1 field whose maps are (south, east): E = +s, B = −t.

    Parameters
    ----------
    coefficients : Coefficients
        The field. [µas/yr]

    Returns
    -------
    (2, (lmax + 1)(lmax + 2)/2) complex array
        In healpy's order, for ``healpy.alm2map_spin(alm, nside, 1, lmax)`` and for ducc0's spin 1.
    """
    t, s = np.split(coefficients.values, 2)
    return np.stack([_pack_alm(s, coefficients.modes), _pack_alm(-t, coefficients.modes)])


def from_healpy(alm: ArrayLike) -> Coefficients:
    """Coefficients from E and B alm (2, …) of a spin-1 field: the inverse of `to_healpy`.

    Parameters
    ----------
    alm : (2, k) complex array
        E and B, in healpy's order. [µas/yr]

    Raises
    ------
    ModesError
        If the alm are not two rows of a triangular length.
    """
    alm = np.asarray(alm)
    lmax = _infer_alm_lmax(alm)
    if alm.ndim != 2 or alm.shape[0] != 2 or lmax is None:
        raise ModesError(f"alm of shape {alm.shape} are not E and B to some degree, (2, (lmax + 1)(lmax + 2)/2)")
    modes = Modes(lmax)
    e, b = (_unpack_alm(row, modes) for row in alm)
    return Coefficients(modes, np.concatenate([-b, e]))


def scalar_to_healpy(coefficients: ScalarCoefficients) -> ComplexArray:
    """alm of a scalar field: f^R + i f^I, as they are.

    Parameters
    ----------
    coefficients : ScalarCoefficients
        The field.

    Returns
    -------
    ((lmax + 1)(lmax + 2)/2,) complex array
        In healpy's order, for ``healpy.alm2map``.
    """
    return _pack_alm(coefficients.values, coefficients.modes)


def scalar_from_healpy(alm: ArrayLike) -> ScalarCoefficients:
    """Coefficients from alm of a scalar field: the inverse of `scalar_to_healpy`.

    Parameters
    ----------
    alm : (k,) complex array
        In healpy's order.

    Raises
    ------
    ModesError
        If the alm are no row of a triangular length.
    """
    alm = np.asarray(alm)
    lmax = _infer_alm_lmax(alm)
    if alm.ndim != 1 or lmax is None:
        raise ModesError(f"alm of shape {alm.shape} are not those of a scalar field, ((lmax + 1)(lmax + 2)/2,)")
    modes = ScalarModes(lmax)
    return ScalarCoefficients(modes, _unpack_alm(alm, modes))


def _infer_alm_lmax(alm):
    lmax = int(np.sqrt(2 * alm.shape[-1])) - 1 if alm.ndim else -1
    return lmax if lmax >= 0 and (lmax + 1) * (lmax + 2) // 2 == alm.shape[-1] else None


def _pack_alm(values, modes):
    alm = np.zeros((modes.lmax + 1) * (modes.lmax + 2) // 2, complex)
    places, is_im = _find_alm_places_and_parts(modes.lmax, modes.lowest)
    alm.real[places[~is_im]] = values[~is_im]
    alm.imag[places[is_im]] = values[is_im]
    return alm


def _unpack_alm(alm, modes):
    places, is_im = _find_alm_places_and_parts(modes.lmax, modes.lowest)
    return np.where(is_im, alm[places].imag, alm[places].real)


@lru_cache(maxsize=8)
def _find_alm_places_and_parts(lmax, lowest):
    """Places of the modes of one kind in an alm array, and which are imaginary parts."""
    degrees = np.arange(lowest, lmax + 1)
    l = np.repeat(degrees, 2 * degrees + 1)
    offset = np.arange(len(l)) - (l * l - lowest**2)
    m = (offset + 1) // 2
    return m * (2 * lmax + 1 - m) // 2 + l, (offset > 0) & (offset % 2 == 0)
