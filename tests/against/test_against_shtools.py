"""SHTOOLS: gradients of every real harmonic, rotations, spectra, and the modes that a cap of the sky determines."""

import numpy as np
import pytest

import fit
import vsh
from vsh import Mode, Modes, ScalarCoefficients, ScalarField, ScalarModes
from vsh.transform import synthesis

shtools = pytest.importorskip("pyshtools", reason="pyshtools is not installed: pip install 'vsh-astrometry[against]'")
LMAX = 8


def gradient_of(l, m):
    """Their gradient of an orthonormal harmonic: places, and its components to the east and the north."""
    harmonic = shtools.SHCoeffs.from_zeros(LMAX, normalization="ortho", csphase=1)
    harmonic.set_coeffs(1.0, l, m)
    grid = harmonic.gradient(grid="DH2", extend=False)
    lon, lat = np.meshgrid(np.radians(grid.theta.lons()), np.radians(grid.theta.lats()))
    keep = np.abs(lat) < np.pi / 2 - 1e-9
    return lon[keep], lat[keep], np.stack([grid.phi.to_array()[keep], -grid.theta.to_array()[keep]])


def ours_of(kind, l, m):
    """Our field of the same harmonic: √(l(l+1)) times a spheroidal or a toroidal mode."""
    part = Mode(kind, l, abs(m), "im" if m < 0 else "re")
    size = np.sqrt(l * (l + 1)) * ((-1.0) ** m / np.sqrt(2) * np.sign(m) if m else 1.0)
    values = np.zeros(len(Modes(LMAX)))
    values[Modes(LMAX).index(part)] = size
    return vsh.Coefficients(Modes(LMAX), values)


@pytest.mark.parametrize("l", range(1, LMAX + 1))
def test_spheroidal_modes_are_gradients_and_toroidal_ones_turned_by_a_right_angle(l):
    for m in range(-l, l + 1):
        lon, lat, (east, north) = gradient_of(l, m)
        scale = np.hypot(east, north).max()
        np.testing.assert_allclose(synthesis(ours_of("S", l, m), lon, lat), [east, north], atol=1e-10 * scale)
        turned = synthesis(ours_of("T", l, m), lon, lat)
        assert min(np.abs(turned - sign * np.stack([-north, east])).max() for sign in (1, -1)) < 1e-10 * scale


@pytest.fixture
def pair():
    """A random scalar field in their coefficients and in ours."""
    theirs = shtools.SHCoeffs.from_random(
        1.0 / (1 + np.arange(LMAX + 1)) ** 2, normalization="ortho", csphase=1, seed=5
    )
    return theirs, converted(theirs)


def converted(theirs):
    array, modes = theirs.to_array(normalization="ortho", csphase=1), ScalarModes(LMAX)
    values = [
        array[0, mode.l, 0]
        if mode.m == 0
        else (-1) ** mode.m / np.sqrt(2) * (array[0] if mode.part == "re" else -array[1])[mode.l, mode.m]
        for mode in modes
    ]
    return ScalarCoefficients(modes, values)


def test_expansion_and_spectrum(pair):
    theirs, ours = pair
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, 200), np.arcsin(rng.uniform(-1, 1, 200))
    np.testing.assert_allclose(theirs.expand(lat=np.degrees(lat), lon=np.degrees(lon)), ours.at(lon, lat), atol=1e-12)
    power = np.bincount(ours.modes.degrees, ours.values**2 * ours.modes.norm2) / (4 * np.pi)
    np.testing.assert_allclose(theirs.spectrum(convention="power", unit="per_l"), power, rtol=1e-12)


def test_rotation(pair):
    theirs, ours = pair
    alpha, beta, gamma = np.radians([50.0, 35.0, -20.0])

    def about_z(t):
        return np.array([[np.cos(t), -np.sin(t), 0], [np.sin(t), np.cos(t), 0], [0, 0, 1]])

    about_y = np.array([[np.cos(beta), 0, np.sin(beta)], [0, 1, 0], [-np.sin(beta), 0, np.cos(beta)]])
    # They turn the field, we the axes.
    turned = vsh.rotate.rotate(ours, (about_z(alpha) @ about_y @ about_z(gamma)).T)
    expected = converted(theirs.rotate(*np.degrees([alpha, beta, gamma]), degrees=True))
    np.testing.assert_allclose(turned.values, expected.values, atol=1e-12)


def test_modes_that_a_cap_determines():
    """The eigenvalues of the normal matrix of a cap are the concentrations of its Slepian functions."""
    rng, n, edge = np.random.default_rng(1), 40_000, np.radians(60)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(np.cos(edge), 1, n))
    matrix = fit.normal_equations(ScalarField(lon, lat, np.zeros(n), np.ones(n)), LMAX).matrix
    root = np.sqrt(ScalarModes(LMAX).norm2)
    ours = np.sort(np.linalg.eigvalsh(matrix / np.outer(root, root)))[::-1] / n * 2 * np.pi * (1 - np.cos(edge))
    theirs = np.sort(shtools.SHWindow.from_cap(60, LMAX).eigenvalues)[::-1]
    np.testing.assert_allclose(ours[:20], theirs[:20], atol=0.03)
