"""ERFA's FK5 → Hipparcos: its orientation and spin come out of a degree-1 fit."""

import erfa
import numpy as np

import fit
import sim
from vsh import Coefficients, Field, Modes
from vsh.tools.units import UAS


def fk5_minus_hipparcos(n=500):
    """Sources at rest in FK5, seen in Hipparcos' frame: offsets [µas] and motions [µas/yr]."""
    lon, lat = sim.uniform_sky(n, rng=3)
    zero = np.zeros(n)
    ra, dec, pmra, pmdec, *_ = erfa.fk52h(lon, lat, zero, zero, zero, zero)
    offset = np.stack([((ra - lon + np.pi) % (2 * np.pi) - np.pi) * np.cos(lat), dec - lat]) / UAS
    motion = np.stack([pmra * np.cos(dec), pmdec]) / UAS
    sigma = np.ones((2, n))
    return Field(lon, lat, -offset, sigma), Field(ra, dec, -motion, sigma)


def test_orientation_and_spin():
    """FK5 axes turn about Hipparcos' by the vectors that ERFA states, −19.9 … mas and −0.30 … mas/yr."""
    offsets, motions = fk5_minus_hipparcos()
    found = fit.direct.solve_frame(motions, offsets)
    epsilon, omega = np.array([-19900.0, -9100.0, 22900.0]), np.array([-300.0, 600.0, 700.0])
    # Second order in a turn of 20 mas: 20 mas × 1e-7 = 2e-3 µas; ERFA's sources drift 1e-4 more.
    np.testing.assert_allclose(found.orientation.value, epsilon, atol=5e-3)
    np.testing.assert_allclose(found.spin.value, omega, atol=5e-3)
    np.testing.assert_allclose(found.acceleration.value, 0, atol=5e-3)


def test_signs_are_those_of_the_harmonics():
    offsets, motions = fk5_minus_hipparcos()
    for field, vector in ((offsets, (-19900.0, -9100.0, 22900.0)), (motions, (-300.0, 600.0, 700.0))):
        np.testing.assert_allclose(fit.fit_field(field, 1).spin.value, vector, atol=5e-3)
        expected = Coefficients.from_vectors(rotation=vector).values
        fitted = fit.solve(fit.normal_equations(field, Modes(1))).coefficients.values
        np.testing.assert_allclose(fitted, expected, atol=0.02)
