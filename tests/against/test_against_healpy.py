"""healpy's spin-1 synthesis, an independent sum of the same field."""

import numpy as np
import pytest

from vsh import Coefficients, Modes
from vsh.conventions import from_healpy, to_healpy

healpy = pytest.importorskip("healpy", reason="there is no healpy for Windows")


@pytest.mark.parametrize("lmax", [1, 6, 30])
def test_synthesis(lmax):
    nside = 16
    values = np.random.default_rng(lmax).standard_normal(len(Modes(lmax)))
    field = Coefficients(Modes(lmax), values)
    theta, phi = healpy.pix2ang(nside, np.arange(12 * nside**2))
    east, north = field.at(phi, np.pi / 2 - theta)
    south_east = healpy.alm2map_spin(list(to_healpy(field)), nside, 1, lmax)
    np.testing.assert_allclose([-north, east], south_east, atol=1e-12 * np.abs(south_east).max())


def test_alm_are_in_healpys_order():
    lmax = 4
    alm = np.zeros((2, healpy.Alm.getsize(lmax)), complex)
    alm[0, healpy.Alm.getidx(lmax, 3, 2)] = 1 + 2j
    alm[1, healpy.Alm.getidx(lmax, 4, 0)] = 5
    field = from_healpy(alm)
    named = {str(mode): value for mode, value in zip(field.modes, field.values, strict=True) if value}
    assert named == {"s(3,2,re)": 1.0, "s(3,2,im)": 2.0, "t(4,0)": -5.0}
    np.testing.assert_array_equal(to_healpy(field), alm)
