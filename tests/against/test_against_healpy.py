"""healpy: spin-1 and scalar transforms, spectra, gradients, rotations, pixels and dipoles of the same fields."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fit import fit_field
from vsh import Coefficients, Field, Modes, ScalarCoefficients, ScalarField, ScalarModes
from vsh.conventions import from_healpy, scalar_to_healpy, to_healpy
from vsh.rotate import rotate
from vsh.sky import pixels
from vsh.sky.frames import rotation_matrix, triad

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


NSIDE, LMAX = 16, 12


@pytest.fixture
def scalars():
    """A random scalar field as ours and as alm."""
    values = np.random.default_rng(5).standard_normal(len(ScalarModes(LMAX)))
    field = ScalarCoefficients(ScalarModes(LMAX), values)
    return field, scalar_to_healpy(field)


def test_analysis_of_spin_one():
    field = Coefficients(Modes(LMAX), np.random.default_rng(6).standard_normal(len(Modes(LMAX))))
    lon, lat = pixels.centres(NSIDE)
    east, north = field.at(lon, lat)
    sources = Field(lon, lat, np.stack([east, north]), np.ones((2, len(lon))))
    np.testing.assert_allclose(fit_field(sources, LMAX).values, field.values, atol=1e-11)
    alms = healpy.map2alm_spin([-north, east], 1, LMAX)  # a plain sum over pixels, to their accuracy
    np.testing.assert_allclose(from_healpy(np.stack(alms)).values, field.values, atol=0.02)


def test_scalar_synthesis_and_analysis(scalars):
    field, alm = scalars
    lon, lat = pixels.centres(NSIDE)
    sky = healpy.alm2map(alm, NSIDE, lmax=LMAX)
    np.testing.assert_allclose(field.at(lon, lat), sky, atol=1e-11)
    ours = fit_field(ScalarField(lon, lat, sky, np.ones(len(lon))), LMAX).coefficients
    np.testing.assert_allclose(scalar_to_healpy(ours), alm, atol=1e-11)
    theirs, *_ = healpy.map2alm_lsq(sky, LMAX, LMAX, tol=1e-12, maxiter=60)
    np.testing.assert_allclose(theirs, scalar_to_healpy(ours), atol=1e-9)


def test_spectra(scalars):
    field, alm = scalars
    power = np.bincount(field.modes.degrees, field.values**2 * field.modes.norm2)
    np.testing.assert_allclose(power / (2 * np.arange(LMAX + 1) + 1), healpy.alm2cl(alm), rtol=1e-12)


def test_gradient(scalars):
    _, alm = scalars
    _, south, east = healpy.alm2map_der1(alm, NSIDE)
    gradient = alm * np.sqrt(healpy.Alm.getlm(LMAX)[0] * (healpy.Alm.getlm(LMAX)[0] + 1))
    ours = from_healpy(np.stack([gradient, 0 * gradient])).at(*pixels.centres(NSIDE))
    np.testing.assert_allclose(ours, [east, -south], atol=1e-10)  # spin 1 has the opposite sign of the gradient


@pytest.mark.parametrize("angles", [(0.4, 1.1, -0.7), (0.0, 0.0, 2.0), (3.0, np.pi, 0.1)])
def test_rotations_of_alm(scalars, angles):
    field, alm = scalars
    psi, theta, phi = angles
    matrix = Rotation.from_euler("ZYZ", [phi, theta, psi]).as_matrix()
    turned = alm.copy()
    healpy.rotate_alm(turned, psi, theta, phi)
    np.testing.assert_allclose(scalar_to_healpy(rotate(field, matrix)), turned, atol=1e-12)


@pytest.mark.parametrize("nside", [1, 64, 8192, 2**23, 2**29])
@pytest.mark.parametrize("nested", [False, True])
def test_pixels(nside, nested):
    rng = np.random.default_rng(7)
    lon, lat = rng.uniform(0, 2 * np.pi, (20, 50)), np.arcsin(rng.uniform(-1, 1, (20, 50)))
    theirs = healpy.ang2pix(nside, np.pi / 2 - lat, lon, nest=nested)
    np.testing.assert_array_equal(pixels.pixels_of(lon.ravel(), lat.ravel(), nside, nested=nested), theirs.ravel())


def test_dipole_of_a_masked_sky():
    rng = np.random.default_rng(8)
    lon, lat = pixels.centres(NSIDE)
    sky = 3 + np.array([0.3, -0.2, 0.5]) @ triad(lon, lat)[2] + 0.1 * rng.standard_normal(len(lon))
    keep = np.abs(lat) > 0.3
    ours = fit_field(ScalarField(lon, lat, sky, np.ones(len(lon)))[keep], 1).coefficients
    mean, dipole = healpy.fit_dipole(np.where(keep, sky, healpy.UNSEEN))
    np.testing.assert_allclose([ours.mean, *ours.dipole], [mean, *dipole], atol=1e-10)


def test_axes():
    matrix = healpy.Rotator(coord=["G", "E"]).mat
    np.testing.assert_allclose(rotation_matrix("galactic", "ecliptic"), matrix, atol=1e-8)
