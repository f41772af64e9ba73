"""The harmonics: what must hold for any of them."""

import numpy as np
import pytest
from conftest import triad
from hypothesis import example, given
from hypothesis import strategies as st

from vsh import Coefficients, Mode, Modes
from vsh.basis import harmonics
from vsh.tools.errors import ModesError

angles = {"lon": st.floats(0, 2 * np.pi), "lat": st.floats(-np.pi / 2, np.pi / 2)}
vectors = st.tuples(*[st.floats(-10, 10)] * 3)
at_the_poles = (example(lon=1.0, lat=np.pi / 2), example(lon=1.0, lat=-np.pi / 2))


def test_order_is_t_then_s_then_l_m_part():
    modes = list(Modes(3))
    written = [
        Mode(kind, l, m, part)
        for kind in "TS"
        for l in range(1, 4)
        for m in range(l + 1)
        for part in ("re", "im")[: 1 + (m > 0)]
    ]
    assert modes == written
    assert [Modes(3).index(mode) for mode in modes] == list(range(len(Modes(3))))


@pytest.mark.parametrize("lmax", [0, -1, 1.5, "3", None])
def test_degree_is_a_positive_whole_number(lmax):
    with pytest.raises(ModesError, match="at least 1"):
        Modes(lmax)


@given(**angles, omega=vectors)
@example(lon=1.0, lat=np.pi / 2, omega=(1.0, -2.0, 3.0))
@example(lon=1.0, lat=-np.pi / 2, omega=(1.0, -2.0, 3.0))
def test_rotation_is_omega_cross_r(lon, lat, omega):
    east, north, out = triad(lon, lat)
    seen = Coefficients.from_vectors(rotation=omega).at([lon], [lat])[:, 0]
    motion = np.cross(omega, out)
    np.testing.assert_allclose(seen, [motion @ east, motion @ north], atol=1e-13)


@given(**angles, g=vectors)
@example(lon=1.0, lat=np.pi / 2, g=(1.0, -2.0, 3.0))
@example(lon=1.0, lat=-np.pi / 2, g=(1.0, -2.0, 3.0))
def test_glide_is_the_tangent_part_of_g(lon, lat, g):
    east, north, _ = triad(lon, lat)
    seen = Coefficients.from_vectors(glide=g).at([lon], [lat])[:, 0]
    np.testing.assert_allclose(seen, [east @ g, north @ g], atol=1e-13)


@given(**angles)
@at_the_poles[0]
@at_the_poles[1]
def test_addition_theorem(lon, lat):
    """Σ_m |T_lm|² = (2l+1)/4π to degree 100, at the poles too."""
    check_addition_theorem(lon, lat, 100, rtol=1e-11)


@pytest.mark.parametrize("lat", [-np.pi / 2, -1.5, -0.3, 0.0, 1e-3, 1.2, 1.57, np.pi / 2])
def test_addition_theorem_to_degree_1000(lat):
    check_addition_theorem(0.7, lat, 1000, rtol=1e-9)


def check_addition_theorem(lon, lat, lmax, rtol):
    modes = Modes(lmax)
    basis = harmonics([lon], [lat], modes)[:, :, 0]
    for kind in "TS":
        square = np.array(
            [np.sum(weight(l) * np.sum(basis[modes.slice_of(kind, l)] ** 2, 1)) for l in range(1, lmax + 1)]
        )
        np.testing.assert_allclose(square, (2 * np.arange(1, lmax + 1) + 1) / (4 * np.pi), rtol=rtol)


def weight(l):
    """Modes of m > 0 carry a factor 2, the square 4, for two members ±m of the sum."""
    return np.array([1.0] + 2 * l * [0.5])


@pytest.mark.parametrize("lmax", [1, 8, 20])
def test_orthonormality(lmax):
    """∫ V_i · V_j dΩ is 1 or 2 on the diagonal, by a quadrature exact to this degree."""
    modes = Modes(lmax)
    x, w = np.polynomial.legendre.leggauss(lmax + 1)
    lon = np.arange(2 * lmax + 2) * np.pi / (lmax + 1)
    lon, lat = (grid.ravel() for grid in np.meshgrid(lon, np.arcsin(x)))
    weights = np.repeat(w, 2 * lmax + 2) * np.pi / (lmax + 1)
    basis = harmonics(lon, lat, modes)
    gram = np.einsum("pkn,n,qkn->pq", basis, weights, basis, optimize=True)
    np.testing.assert_allclose(gram, np.diag([1.0 if mode.m == 0 else 2.0 for mode in modes]), atol=1e-12)


def test_spheroidal_is_toroidal_turned():
    """S = r × T, the cross product taken in space."""
    lon, lat = 0.4, -0.9
    east, north, out = triad(lon, lat)
    basis = harmonics([lon], [lat], Modes(5))[:, :, 0]
    t, s = (half[:, :1] * east + half[:, 1:] * north for half in np.split(basis, 2))
    np.testing.assert_allclose(s, np.cross(out, t), atol=1e-14)


def test_at_is_the_sum_over_modes():
    rng = np.random.default_rng(3)
    modes = Modes(12)
    lon, lat = rng.uniform(0, 6, 50), rng.uniform(-1.5, 1.5, 50)
    values = rng.normal(size=len(modes))
    expected = sum(v * h for v, h in zip(values, harmonics(lon, lat, modes), strict=True))
    np.testing.assert_allclose(Coefficients(modes, values).at(lon, lat), expected, atol=1e-12)


def test_coefficients_of_the_wrong_number_are_refused():
    with pytest.raises(ModesError, match="degree 2 has 16 coefficients"):
        Coefficients(Modes(2), np.zeros(15))


def test_fields_of_different_degree_add():
    low, high = Coefficients.from_vectors(rotation=(1, 2, 3)), Coefficients(Modes(4), np.arange(48.0))
    total = low + high
    assert total.modes.lmax == 4
    lon, lat = np.array([1.0, 2.0]), np.array([0.5, -0.5])
    np.testing.assert_allclose(total.at(lon, lat), low.at(lon, lat) + high.at(lon, lat), atol=1e-12)
