"""galpy and gala: motions and their covariances in Galactic axes."""

import numpy as np
import pytest

from vsh import Field

REASON = "{} is not installed: pip install 'vsh-astrometry[against]'"


@pytest.fixture
def field():
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(0, 2 * np.pi, 400), np.arcsin(rng.uniform(-1, 1, 400))
    sigma, rho = rng.uniform(1, 30, (2, 400)), rng.uniform(-0.95, 0.95, 400)
    return Field(lon, lat, 100 * rng.standard_normal((2, 400)), sigma, rho)


def covariances_of(field):
    """The 2 × 2 matrix of each source, (n, 2, 2)."""
    (east, north), cross = field.sigma**2, field.rho * field.sigma.prod(0)
    return np.moveaxis(np.array([[east, cross], [cross, north]]), -1, 0)


def test_galpy(field):
    coords = pytest.importorskip("galpy.util.coords", reason=REASON.format("galpy"))
    turned, places = field.to_frame("galactic"), np.degrees([field.lon, field.lat])
    motions = coords.pmrapmdec_to_pmllpmbb(*field.motion, *places, degree=True, epoch=None)
    np.testing.assert_allclose(turned.motion, motions.T, atol=1e-11)
    matrices = coords.cov_pmrapmdec_to_pmllpmbb(covariances_of(field), *places, degree=True, epoch=None)
    np.testing.assert_allclose(covariances_of(turned), matrices, atol=1e-9)
    of_fk5 = coords.pmrapmdec_to_pmllpmbb(*field.motion, *places, degree=True, epoch=2000.0)
    assert 1e-6 < np.abs(of_fk5.T - turned.motion).max() < 1e-3  # their default has the poles of FK5


def test_gala(field):
    coordinates = pytest.importorskip("gala.coordinates", reason=REASON.format("gala"))
    from astropy import units as u
    from astropy.coordinates import Galactic, SkyCoord

    east, north = field.motion * u.uas / u.yr
    sky = SkyCoord(field.lon * u.rad, field.lat * u.rad, pm_ra_cosdec=east, pm_dec=north)
    matrices = coordinates.transform_pm_cov(sky, covariances_of(field), Galactic())
    np.testing.assert_allclose(covariances_of(field.to_frame("galactic")), matrices, atol=1e-9)
