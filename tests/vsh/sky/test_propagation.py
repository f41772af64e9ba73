"""Stars carried from one epoch to another: values beside astropy's, derivatives beside differences."""

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import Distance, SkyCoord, get_body_barycentric
from astropy.time import Time

from vsh.sky.astrometry import add_positions, earth, propagate
from vsh.tools.units import UAS


def stars(n=50):
    rng = np.random.default_rng(1)
    place = rng.uniform(0, 6.28, n), np.arcsin(rng.uniform(-0.95, 0.95, n))
    return np.stack([*place, rng.uniform(1e3, 5e5, n), *rng.normal(0, 5e5, (2, n))]), rng.normal(0, 50, n)


def test_values_as_astropy():
    parameters, velocity = stars()
    later, _ = propagate(parameters, velocity, 2016.0, 1991.25)
    sky = SkyCoord(
        *parameters[:2] * u.rad, Distance(parallax=parameters[2] * u.uas), pm_ra_cosdec=parameters[3] * u.uas / u.yr,
        pm_dec=parameters[4] * u.uas / u.yr, radial_velocity=velocity * u.km / u.s, obstime=Time(2016.0, format="jyear", scale="tdb"),
    ).apply_space_motion(Time(1991.25, format="jyear", scale="tdb"))  # fmt: skip
    assert np.abs((later[0] - sky.ra.rad) * np.cos(later[1])).max() / UAS < 20  # its axes go through Cartesian rounding
    assert np.abs(later[1] - sky.dec.rad).max() / UAS < 20


@pytest.mark.parametrize("light_time", [True, False])
def test_there_and_back(light_time):
    parameters, velocity = stars()
    later, _ = propagate(parameters, velocity, 2016.0, 1991.25, light_time=light_time)
    back, _ = propagate(later, velocity, 1991.25, 2016.0, light_time=light_time)
    # The velocity changes by so little with the line of sight that parallaxes agree to a tenth.
    assert np.abs((back - parameters) / np.array([UAS, UAS, 1, 1, 1])[:, None]).max() < 5


def test_derivatives():
    parameters, velocity = stars()
    later, jacobian = propagate(parameters, velocity, 2016.0, 1991.0, light_time=False)
    for k in range(5):
        step = np.zeros_like(parameters)
        step[k] = 10.0 * (UAS / np.cos(parameters[1]) if k == 0 else UAS if k == 1 else 1.0)
        up, down = (propagate(parameters + s * step, velocity, 2016.0, 1991.0, light_time=False)[0] for s in (1, -1))
        change = (up - down) / 20.0
        change[0] *= np.cos(later[1]) / UAS
        change[1] /= UAS
        assert np.abs(change - jacobian[:, :, k].T).max() < 1e-4


def test_star_without_parallax_moves_on_a_circle():
    parameters = np.array([[1.0], [0.5], [0.0], [1e5], [2e5]])
    later, _ = propagate(parameters, 0.0, 2016.0, 2000.0)
    plain, _ = propagate(parameters, 0.0, 2016.0, 2000.0, light_time=False)
    assert np.abs(later - plain)[:2].max() / UAS < 0.01
    assert later[2] == 0


def test_earth():
    epochs = np.linspace(1985, 2030, 20)
    theirs = get_body_barycentric("earth", Time(epochs, format="jyear", scale="tdb")).xyz.to_value("au")
    assert np.abs(earth(epochs) - theirs).max() < 1e-10


def test_added_positions_equal_joint_least_squares():
    """Five parameters known with a full covariance, and positions years later, as one least-squares problem."""
    rng = np.random.default_rng(3)
    root = rng.normal(size=(4, 5, 5))
    covariance = root @ root.swapaxes(1, 2) + 0.1 * np.eye(5)
    position = np.array([[0.3, 0.1], [0.1, 0.2]])
    years = np.array([-5.0, 1.0, 8.0, 12.0])
    joint = add_positions(covariance, position, years)
    for k in range(4):
        design = np.array([[1, 0, 0, years[k], 0], [0, 1, 0, 0, years[k]]])
        normal = np.linalg.inv(covariance[k]) + design.T @ np.linalg.inv(position) @ design
        assert joint[k] == pytest.approx(np.linalg.inv(normal), rel=1e-9, abs=1e-12)
