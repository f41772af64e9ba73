"""scipy's scalar harmonics: T and S from their numerical gradient."""

import numpy as np
from scipy.special import sph_harm_y

from vsh import Mode, Modes
from vsh.basis import harmonics


def test_harmonics_are_gradients_of_scipys():
    lmax, h = 6, 1e-5
    modes = Modes(lmax)
    lon, lat = np.array([0.3, 2.0, 5.5]), np.array([-1.1, 0.2, 0.9])

    def y(l, m, lon, lat):
        return sph_harm_y(l, m, np.pi / 2 - lat, lon)

    basis = harmonics(lon, lat, modes)
    for l in range(1, lmax + 1):
        for m in range(l + 1):
            # Central differences of fourth order: good to h⁴ and to 1e-16/h.
            steps = ((1, 8 / 12), (-1, -8 / 12), (2, -1 / 12), (-2, 1 / 12))
            d_lon = sum(w * y(l, m, lon + k * h, lat) for k, w in steps) / h / np.cos(lat)
            d_lat = sum(w * y(l, m, lon, lat + k * h) for k, w in steps) / h
            t, s = (np.array(v) / np.sqrt(l * (l + 1)) for v in ((d_lat, -d_lon), (d_lon, d_lat)))
            for kind, v in (("T", t), ("S", s)):
                twice = 1 if m == 0 else 2
                np.testing.assert_allclose(basis[modes.index(Mode(kind, l, m))], twice * v.real, atol=1e-9)
                if m:
                    np.testing.assert_allclose(basis[modes.index(Mode(kind, l, m, "im"))], -2 * v.imag, atol=1e-9)
