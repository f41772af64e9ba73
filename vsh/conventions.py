"""To and from other people's coefficients: ICRF3's R, D, E, M and healpy's E/B alm.

Signs and factors are those of docs/conventions.md; a test pins each.
"""

import numpy as np

from vsh.coefficients import Coefficients
from vsh.errors import ModesError
from vsh.modes import Mode, Modes

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


def to_icrf3(coefficients):
    """The parameters of degrees 1 and 2 under the names and signs of the ICRF3 papers.

    Degrees above 2 have no such names and are left out.

    Returns
    -------
    dict
        From R1, R2, R3, D1, D2, D3 and, to degree 2, E20, M20, E21R, … M22I to their
        values. [unit of the coefficients]

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


def from_icrf3(parameters):
    """Coefficients from a dict of ICRF3 parameters; those not named are zero.

    Raises
    ------
    ModesError
        If a name is not one of ICRF3's.
    """
    unknown = [name for name in parameters if name not in ICRF3]
    if unknown:
        raise ModesError(f"ICRF3 has no parameter {', '.join(unknown)}; it has {', '.join(ICRF3)}")
    modes = Modes(max((ICRF3[name][0].l for name in parameters), default=1))
    values = np.zeros(len(modes))
    for name, value in parameters.items():
        mode, factor = ICRF3[name]
        values[modes.index(mode)] = factor * value
    return Coefficients(modes, values)


def to_healpy(coefficients):
    """E and B alm of the spin-1 field whose maps are (south, east): E = +s, B = −t.

    Returns
    -------
    (2, (lmax + 1)(lmax + 2)/2) complex array
        In healpy's order, for ``healpy.alm2map_spin(alm, nside, 1, lmax)`` and for
        ducc0's spin 1.
    """
    lmax, values = coefficients.modes.lmax, coefficients.values
    alm = np.zeros((2, (lmax + 1) * (lmax + 2) // 2), complex)
    place, is_im, spheroidal = _healpy_order(lmax)
    signed = np.where(spheroidal, values, -values) * np.where(is_im, 1j, 1)
    np.add.at(alm, (np.where(spheroidal, 0, 1), place), signed)
    return alm


def from_healpy(alm):
    """Coefficients from E and B alm (2, …) of a spin-1 field: the inverse of `to_healpy`.

    Raises
    ------
    ModesError
        If the alm are not two rows of a triangular length.
    """
    alm = np.asarray(alm)
    lmax = int(np.sqrt(2 * alm.shape[-1])) - 1
    if alm.ndim != 2 or alm.shape[0] != 2 or (lmax + 1) * (lmax + 2) // 2 != alm.shape[1]:
        raise ModesError(f"alm of shape {alm.shape} are not E and B to some degree, (2, (lmax + 1)(lmax + 2)/2)")
    modes = Modes(lmax)
    place, is_im, spheroidal = _healpy_order(lmax)
    c = np.where(spheroidal, alm[0, place], -alm[1, place])
    return Coefficients(modes, np.where(is_im, c.imag, c.real))


def _healpy_order(lmax):
    """For each of our modes: its place in an alm array, whether it is an imaginary part, whether spheroidal."""
    l, m, is_im = np.array([(mode.l, mode.m, mode.part == "im") for mode in Modes(lmax) if mode.kind == "T"]).T
    place = m * (2 * lmax + 1 - m) // 2 + l
    half = len(place)
    return np.tile(place, 2), np.tile(is_im.astype(bool), 2), np.arange(2 * half) >= half
