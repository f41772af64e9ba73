"""True fields: each is what it says, and is recovered."""

import numpy as np
import pytest
from astropy import units as u
from astropy.cosmology import Planck18

import sim
from vsh import Coefficients, Modes
from vsh.basis import harmonics
from vsh.models.cosmology import transverse_distance
from vsh.models.covariance import wave_fractions
from vsh.tools.errors import FieldError
from vsh.tools.units import hubble_rate

SKY = sim.galaxies(300, rng=1, sky="gums", min_redshift=0.002)
PLACES = (SKY.lon, SKY.lat, SKY.redshift)
LAW = sim.NominalScanningLaw()
APEX = np.array([-25.7, -244.3, 275.3])


@pytest.mark.parametrize(
    ("z", "motion"), [(0.001, 17.478), (0.003, 5.829), (0.01, 1.7516), (0.03, 0.5867), (0.1, 0.1790), (1.0, 0.0229)]
)
def test_secular_parallax_values(z, motion):
    """docs/theory.md: the secular parallax of 369 km/s, at distances that test_cosmology has."""
    away = sim.secular_parallax((369.0, 0, 0))([np.pi / 2], [0.0], [z])  # 90° from the apex
    np.testing.assert_allclose(away[:, 0], [motion, 0], atol=6e-4 if z < 0.01 else 6e-5)


def test_secular_parallax_is_away_from_the_apex_and_scales_with_hubble():
    lon, lat = np.array([1.0]), np.array([0.0])
    toward_lower_longitude = sim.secular_parallax((1000.0, 0, 0))(lon, lat, [0.01])[0, 0]
    assert toward_lower_longitude > 0  # the apex is at longitude 0; east is away from it
    one, two = (sim.secular_parallax(APEX, hubble=h)(*PLACES) for h in (67.3, 134.6))
    np.testing.assert_allclose(two, 2 * one)
    other = sim.secular_parallax(APEX, cosmology=Planck18, hubble=67.3)(*PLACES)
    np.testing.assert_allclose(other, one, rtol=2e-3)
    with pytest.raises(FieldError, match="no redshifts"):
        sim.secular_parallax(APEX)([0.0], [0.0])


def test_peculiar_motion_has_its_dispersion():
    many = sim.galaxies(20_000, rng=3)
    signal = sim.peculiar(750.0, rng=4)
    motion = signal(many.lon, many.lat, many.redshift)
    speed = motion * transverse_distance(many.redshift) * 4.740470
    np.testing.assert_allclose(speed.std(1), 750, rtol=4 / np.sqrt(40_000))
    np.testing.assert_array_equal(motion, signal(many.lon, many.lat, many.redshift))
    at_001 = sim.peculiar(750.0, rng=1)(np.zeros(20_000), np.zeros(20_000), np.full(20_000, 0.01))
    assert at_001.std() == pytest.approx(3.56, rel=0.02)


def test_peculiar_motion_may_be_correlated():
    """Two points 10 Mpc apart, velocities correlated by exp(−r²/2ℓ²), over 300 draws."""
    z, length = 0.01, 15.0
    separation = 10.0 / float(transverse_distance([z])[0])
    lon, lat = np.array([0.0, separation]), np.zeros(2)
    north = np.array([sim.peculiar(500.0, rng=s, length=length)(lon, lat, [z, z])[1] for s in range(400)])
    r = 2 * np.sin(separation / 2) * float(transverse_distance([z])[0])
    assert np.corrcoef(north.T)[0, 1] == pytest.approx(np.exp(-(r**2) / (2 * length**2)), abs=0.06)
    assert north.std() * float(transverse_distance([z])[0]) * 4.740470 == pytest.approx(500, rel=0.15)


def gamma_of(theta):
    """docs/theory.md: correlation of two sources under gravitational waves."""
    s = np.sin(theta / 2)
    return 1 - 7 * s**2 - 12 * s**4 * np.log(s) / (1 - s**2)


@pytest.mark.parametrize(
    ("theta", "value"), [(0.2, 0.933007), (0.8, 0.245254), (1.3, -0.288158), (2.0, -0.399264), (2.7, -0.091271)]
)
def test_waves_have_the_known_correlation(theta, value):
    """Σ_l α_l of the harmonics at two places, against the closed form."""
    assert gamma_of(theta) == pytest.approx(value, abs=5e-7)
    lmax = 60
    modes = Modes(lmax)
    l = modes.degrees
    variance = wave_fractions(lmax)[l - 1] / 2 / (2 * l + 1) / modes.norm2
    # Along the equator: east is along the arc, north across it.
    basis = harmonics([0.0, theta], [0.0, 0.0], modes)
    both = np.einsum("pki,p,pkj->kij", basis, variance, basis)
    for component in both:
        # The sum to degree 60 lacks 1/60⁴ of the power.
        assert component[0, 1] / component[0, 0] == pytest.approx(value, abs=1e-5)


def test_waves_have_their_power():
    """⟨P_2⟩ = (5/6) 4π H0² Ω, half in T, half in S; Ω_GW = (6/5) P_2/(4π H0²) of the mean."""
    omega = 0.01
    modes = Modes(4)
    lon, lat = sim.uniform_sky(400, rng=1)
    basis = harmonics(lon, lat, modes).reshape(len(modes), -1)
    solver = np.linalg.pinv(basis.T)
    powers = []
    for seed in range(400):
        c = Coefficients(modes, solver @ sim.wave_background(omega, seed, lmax=4)(lon, lat).ravel())
        powers.append([c.power("T", 2), c.power("S", 2), c.power("S", 1)])
    t, s, dipole = np.mean(powers, 0)
    expected = 5 / 12 * 4 * np.pi * omega * hubble_rate(70) ** 2
    error = np.sqrt(2 / 5 / 400)
    assert t == pytest.approx(expected, rel=4 * error)
    assert s == pytest.approx(expected, rel=4 * error)
    assert dipole < 1e-20
    assert 1.2 / (4 * np.pi * hubble_rate(70) ** 2) == pytest.approx(4.37944e-4, rel=1e-5)
    with pytest.raises(ValueError, match="omega must be zero or more, not -1"):
        sim.wave_background(-1, 1)


def test_anisotropic_expansion_is_a_quadrupole():
    shear = np.diag([0.1, 0.1, -0.2])
    signal = sim.anisotropic_expansion(shear)
    lon, lat = np.array([0.0, 1.0]), np.array([np.pi / 4, -np.pi / 4])
    # Towards the equator, where the expansion is fastest: ½ (Σ_zz − Σ_xx) sin 2δ northwards.
    np.testing.assert_allclose(signal(lon, lat), [[0, 0], [-0.15, 0.15]], atol=1e-12)
    np.testing.assert_allclose(sim.anisotropic_expansion(shear + 5 * np.eye(3))(lon, lat), signal(lon, lat), atol=1e-12)
    with pytest.raises(ValueError, match="symmetric"):
        sim.anisotropic_expansion(np.arange(9.0).reshape(3, 3))


SHEARS = [np.diag([1, -1, 0.0]), np.diag([1, 1, -2.0])] + [
    np.eye(3)[[i]].T @ np.eye(3)[[j]] + np.eye(3)[[j]].T @ np.eye(3)[[i]] for i, j in ((0, 1), (0, 2), (1, 2))
]
AXES = np.eye(3)


def of_modes(lmax, lowest):
    modes = Modes(lmax)
    return [sim.from_coefficients(Coefficients(modes, row)) for row in np.eye(len(modes))[modes.degrees >= lowest]]


#: Each kind of signal as a sum of unit signals, and the size to inject.
LINEAR = {
    "spin": ([sim.spin(e) for e in AXES], 5.0),
    "acceleration": ([sim.acceleration(e) for e in AXES], 5.0),
    "secular parallax": ([sim.secular_parallax(e) for e in AXES], 300.0),
    "any coefficients": (of_modes(2, 1), 5.0),
    "waves": (of_modes(3, 2), 5.0),
    "anisotropic expansion": ([sim.anisotropic_expansion(s) for s in SHEARS], 3.0),
}


@pytest.fixture(scope="module", params=[60, pytest.param(200, marks=pytest.mark.slow)])
def still_skies(request):
    """Skies of quasars that stand still, as the mission sees them."""
    mission = sim.Mission(LAW, attitude=0)
    return [
        sim.observe(SKY, sim.spin((0, 0, 0)), seed, mission=mission, progress=False) for seed in range(request.param)
    ]


@pytest.mark.parametrize("kind", LINEAR)
def test_injection_and_recovery(kind, still_skies):
    """Skies through the mission, weighted least squares: pulls are N(0, 1) in every parameter."""
    units, size = LINEAR[kind]
    design = np.array([unit(*PLACES) for unit in units])
    truth = size * np.random.default_rng(1).standard_normal(len(units))
    total = sum(units[1:], units[0])
    assert total(*PLACES).shape == (2, len(SKY))
    pulls = []
    for field in still_skies:
        a, b, c = field.weights
        motion = field.motion + np.tensordot(truth, design, axes=1)
        weighted = np.stack([a * design[:, 0] + c * design[:, 1], c * design[:, 0] + b * design[:, 1]], axis=1)
        normal = np.einsum("pkn,qkn->pq", design, weighted)
        covariance = np.linalg.inv(normal)
        found = covariance @ np.einsum("pkn,kn->p", weighted, motion)
        pulls.append((found - truth) / np.sqrt(np.diag(covariance)))
    pulls = np.array(pulls)
    assert np.abs(pulls.mean(0)).max() < 4 / np.sqrt(len(pulls))
    assert np.abs(pulls.std(0) - 1).max() < 4 / np.sqrt(2 * len(pulls))


def test_quantities_keep_their_units():
    lon, lat = np.array([1.0]), np.array([0.5])
    bare, with_unit = sim.acceleration((0, 5, 0)), sim.acceleration([0, 0.005, 0] * u.mas / u.yr)
    np.testing.assert_allclose(with_unit(lon, lat), bare(lon, lat))
    with pytest.raises(FieldError, match="cannot be converted"):
        sim.spin([1, 2, 3] * u.km)
    with pytest.raises(FieldError, match="three finite components"):
        sim.spin(3)
