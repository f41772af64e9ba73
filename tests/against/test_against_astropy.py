"""astropy's ICRS → Galactic and ecliptic, for positions, motions and covariances."""

import astropy.units as u
import numpy as np
import pytest
from astropy.coordinates import SkyCoord
from conftest import random_field

from vsh.sky.frames import FRAMES, rotation_matrix
from vsh.tools.units import UAS

SKIES = ["galactic", "ecliptic"]


def sky_coord(field, motion):
    return SkyCoord(
        field.lon * u.rad,
        field.lat * u.rad,
        pm_ra_cosdec=motion[0] * u.uas / u.yr,
        pm_dec=motion[1] * u.uas / u.yr,
        frame="icrs",
    ).transform_to(FRAMES["galactic"])


@pytest.mark.parametrize("frame", SKIES)
def test_positions(frame):
    field = random_field(1000, seed=1)
    ours = field.to_frame(frame)
    theirs = SkyCoord(field.lon * u.rad, field.lat * u.rad, frame="icrs").transform_to(FRAMES[frame]).spherical
    np.testing.assert_allclose(np.exp(1j * ours.lon), np.exp(1j * theirs.lon.rad), atol=1e-12)
    np.testing.assert_allclose(ours.lat, theirs.lat.rad, atol=1e-12)


def test_motions():
    field = random_field(1000, seed=2)
    ours, theirs = field.to_frame("galactic"), sky_coord(field, field.motion)
    expected = [theirs.pm_l_cosb.to_value("uas/yr"), theirs.pm_b.to_value("uas/yr")]
    # astropy carries motions as velocities at a distance of 1: 1e-9 of the motion is its own rounding.
    np.testing.assert_allclose(ours.motion, expected, rtol=1e-6, atol=1e-6)


def test_covariances():
    """Turn the two columns of a Cholesky factor as if they were motions, and square."""
    field = random_field(300, seed=3)
    (s1, s2), rho = field.sigma, field.rho
    factor = np.array([[s1, rho * s2], [0 * s1, s2 * np.sqrt(1 - rho**2)]])
    turned = [sky_coord(field, column) for column in factor]
    turned = np.array([[c.pm_l_cosb.to_value("uas/yr"), c.pm_b.to_value("uas/yr")] for c in turned])
    covariance = np.einsum("kan,kbn->abn", turned, turned)
    ours = field.to_frame("galactic")
    np.testing.assert_allclose(ours.sigma**2, [covariance[0, 0], covariance[1, 1]], rtol=1e-6)
    np.testing.assert_allclose(ours.rho * ours.sigma[0] * ours.sigma[1], covariance[0, 1], rtol=1e-6, atol=1e-5)


@pytest.mark.parametrize("frame", SKIES)
def test_there_and_back(frame):
    field = random_field(1000, seed=4)
    back = field.to_frame(frame).to_frame("icrs")
    for name in ("lon", "lat", "motion", "sigma", "rho"):
        np.testing.assert_allclose(getattr(back, name), getattr(field, name), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(field.to_frame(frame).chi2, field.chi2, rtol=1e-9)


def test_galactic_centre_in_icrs():
    """docs/theory.md: ã = (4.3, 0, 0) Galactic = (−0.235965, −3.755779, −2.080491) ICRS."""
    found = rotation_matrix("galactic", "icrs") @ [4.3, 0, 0]
    np.testing.assert_allclose(found, [-0.235965, -3.755779, -2.080491], atol=5e-7)


def test_micro_arcsecond_is_astropys():
    assert pytest.approx((1 * u.uas).to_value("rad"), rel=1e-14) == UAS
