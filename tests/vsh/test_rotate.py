"""Coefficients in another frame."""

import numpy as np
import pytest
from astropy.coordinates import CartesianRepresentation, SkyCoord
from conftest import random_field
from scipy.spatial.transform import Rotation

import fit
from vsh import Coefficients, Field, Modes
from vsh.rotate import rotate
from vsh.sky.frames import FRAMES, rotation_matrix
from vsh.tools.errors import FrameError

LMAX = 12
C = Coefficients(Modes(LMAX), np.random.default_rng(1).normal(size=len(Modes(LMAX))))


def random_covariance():
    a = np.random.default_rng(2).normal(size=2 * (len(C.modes),))
    return a @ a.T


def test_field_is_the_same_field():
    field = random_field(100, seed=1)
    field = Field(field.lon, field.lat, C.at(field.lon, field.lat), field.sigma)
    for frame in ("galactic", "ecliptic"):
        turned = field.to_frame(frame)
        np.testing.assert_allclose(rotate(C, frame).at(turned.lon, turned.lat), turned.motion, atol=1e-12)


def test_there_and_back():
    covariance = random_covariance()
    galactic, turned = rotate(C, "galactic", covariance=covariance)
    back, returned = rotate(galactic, "icrs", covariance=turned, frame="galactic")
    np.testing.assert_allclose(back.values, C.values, atol=1e-12)
    np.testing.assert_allclose(returned, covariance, atol=1e-12 * np.abs(covariance).max())


def test_degree_one_turns_like_the_vectors():
    matrix = rotation_matrix("icrs", "galactic")
    galactic = rotate(C, "galactic")
    np.testing.assert_allclose(galactic.rotation, matrix @ C.rotation, atol=1e-13)
    np.testing.assert_allclose(galactic.glide, matrix @ C.glide, atol=1e-13)


def test_power_is_unchanged():
    galactic = rotate(C, "galactic")
    for kind in "TS":
        for l in range(1, LMAX + 1):
            assert galactic.power(kind, l) == pytest.approx(C.power(kind, l), rel=1e-12)


@pytest.mark.parametrize("vector", [(0, 0, 1.3), (np.pi, 0, 0), (0.1, -2, 1), (0, 0, 0)])
def test_any_rotation(vector):
    """Turning by A and then by Aᵀ is nothing; turning by A twice is A²."""
    matrix = Rotation.from_rotvec(vector).as_matrix()
    np.testing.assert_allclose(rotate(rotate(C, matrix), matrix.T).values, C.values, atol=1e-12)
    np.testing.assert_allclose(rotate(rotate(C, matrix), matrix).values, rotate(C, matrix @ matrix).values, atol=1e-12)


def test_fit_in_another_frame_is_the_fit_rotated():
    field = random_field(500, seed=3)
    icrs, galactic = fit.fit_field(field, 3), fit.fit_field(field.to_frame("galactic"), 3)
    turned, covariance = rotate(icrs.coefficients, "galactic", covariance=icrs.covariance)
    np.testing.assert_allclose(turned.values, galactic.coefficients.values, atol=1e-9)
    np.testing.assert_allclose(covariance, galactic.covariance, atol=1e-9)


@pytest.mark.parametrize("to", [np.eye(2), np.diag([1, 1, -1.0]), 2 * np.eye(3)])
def test_matrices_that_are_no_rotation_are_refused(to):
    with pytest.raises(FrameError, match="rotation matrix"):
        rotate(C, to)


def test_covariance_of_the_wrong_shape_is_refused():
    with pytest.raises(ValueError, match="covariance has shape"):
        rotate(C, "galactic", covariance=np.eye(3))


@pytest.mark.parametrize("to", ["icrs", "galactic", "ecliptic"])
@pytest.mark.parametrize("frame", ["icrs", "galactic", "ecliptic"])
def test_matrices_are_astropys(frame, to):
    axes = SkyCoord(CartesianRepresentation(np.eye(3)), frame=FRAMES[frame])
    np.testing.assert_allclose(
        rotation_matrix(frame, to), axes.transform_to(FRAMES[to]).cartesian.xyz.value, atol=3e-16
    )
