"""ducc0's transform against the exact basis, and against itself."""

import numpy as np
import pytest
from conftest import random_field
from hypothesis import given, settings
from hypothesis import strategies as st

import sim
from vsh import Coefficients, Modes
from vsh.basis import harmonics
from vsh.tools.errors import FieldError, VshError
from vsh.transform import adjoint, fourier_moments, project_response, synthesis


def random_coefficients(lmax, seed):
    return Coefficients(Modes(lmax), np.random.default_rng(seed).normal(size=len(Modes(lmax))))


@pytest.mark.parametrize("lmax", [1, 2, 10, 60])
def test_synthesis_is_the_exact_sum(lmax):
    c = random_coefficients(lmax, 1)
    lon, lat = sim.uniform_sky(500, rng=2)
    lat[:2] = np.pi / 2, -np.pi / 2
    lon[2:5] = 0, -1e-18, 2 * np.pi
    exact = c.at(lon, lat)
    np.testing.assert_allclose(synthesis(c, lon, lat), exact, atol=1e-12 * np.abs(exact).max())


@pytest.mark.parametrize("lmax", [1, 10])
def test_adjoint_is_the_exact_sum(lmax):
    field = random_field(300, seed=1)
    exact = np.einsum("pkn,kn->p", harmonics(field.lon, field.lat, Modes(lmax)), field.motion)
    found = adjoint(Modes(lmax), field.lon, field.lat, field.motion)
    np.testing.assert_allclose(found, exact, atol=1e-12 * np.abs(field.motion).sum())


@given(seed=st.integers(0, 1000), lmax=st.integers(1, 40))
@settings(max_examples=20)
def test_adjoint_identity(seed, lmax):
    """⟨A c, y⟩ = ⟨c, Aᵀ y⟩."""
    c, field = random_coefficients(lmax, seed), random_field(200, seed)
    left = np.vdot(synthesis(c, field.lon, field.lat), field.motion)
    right = c.values @ adjoint(Modes(lmax), field.lon, field.lat, field.motion)
    scale = np.linalg.norm(synthesis(c, field.lon, field.lat)) * np.linalg.norm(field.motion)
    assert abs(left - right) < 1e-11 * scale


def test_response_is_projected():
    c, field = random_coefficients(3, 1), random_field(200, 1)
    expected = adjoint(Modes(3), field.lon, field.lat, synthesis(c, field.lon, field.lat) ** 3)
    found = project_response(c, field.lon, field.lat, lambda motion: motion**3, 1e-10)
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())


def test_fourier_moments_are_their_definition():
    lon, lat = sim.uniform_sky(100, rng=1)
    values = np.random.default_rng(2).normal(size=(3, 100))
    found = fourier_moments(lon, lat, values, 3)
    for m, n in ((0, 0), (3, -2), (-1, 3)):
        expected = values @ np.exp(-1j * (m * lon + n * lat))
        np.testing.assert_allclose(found[:, 3 + m, 3 + n], expected, atol=1e-10)


@pytest.mark.parametrize(("lon", "lat", "message"), [
    ([0.0, np.nan], [0.0, 0.0], "1 of 2 values of lon are not finite"),
    ([0.0], [1.6], "beyond a pole: are they in radians"),
    ([0.0, 1.0], [0.0], "one of each for a source"),
    ([[0.0]], [[0.0]], "one of each for a source"),
])  # fmt: skip
def test_ducc_never_sees_bad_positions(lon, lat, message):
    with pytest.raises(VshError, match=message):
        synthesis(random_coefficients(2, 1), lon, lat)
    with pytest.raises(VshError, match=message):
        adjoint(Modes(2), lon, lat, np.zeros((2, 1)))


def test_motion_of_the_wrong_shape():
    with pytest.raises(FieldError, match=r"motion has shape \(2,\), expected \(2, 1\)"):
        adjoint(Modes(2), [0.0], [0.0], [1.0, 2.0])
