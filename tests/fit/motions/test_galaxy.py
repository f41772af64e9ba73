"""Our orbit in the Galaxy from an acceleration: published numbers, components, models."""

import numpy as np
import pytest
from astropy import units as u

import fit
import sim
from effects import circular_acceleration
from fit import galaxy
from vsh import Field, ParameterError, Vector
from vsh.tools.units import KM_S_MYR

EDR3 = Vector([5.04, -0.10, -0.29], np.diag([0.35, 0.36, 0.36]) ** 2, "galactic")


def test_published_numbers():
    assert "{:.1f} ± {:.1f}".format(*galaxy.circular_speed(5.05, 0.35, 8.275)) == "243.7 ± 8.4"
    assert "{:.2f} ± {:.2f}".format(*galaxy.distance_of_centre(5.05, 0.35)) == "8.60 ± 0.62"
    assert f"{galaxy.expected_acceleration(8.178):.3f}" == "4.804"
    assert f"{galaxy.angular_speed():.2f}" == "28.89"
    assert f"{galaxy.angular_speed(solar_speed=0):.2f}" == "30.39"


def test_three_relations_are_one():
    a = galaxy.expected_acceleration(8.3, 29.0)
    assert galaxy.distance_of_centre(a, 0.1, 29.0)[0] == pytest.approx(8.3, rel=1e-12)
    assert galaxy.circular_speed(a, 0.1, 8.3)[0] == pytest.approx(29.0 * 8.3, rel=1e-12)
    # Beside astropy's units.
    expected = circular_acceleration(240.7 * u.km / u.s, 8.3 * u.kpc).value
    assert a == pytest.approx(float(expected), rel=1e-9)


def test_components_of_an_orbit():
    found = galaxy.orbit(EDR3.to_frame("icrs"))
    assert found.inward == pytest.approx((5.04, 0.35), abs=1e-10)
    assert found.circular_speed[0] == pytest.approx(243.4, abs=0.1)
    assert found.across_p_value == pytest.approx(np.exp(-0.5 * ((0.1 / 0.36) ** 2 + (0.29 / 0.36) ** 2)), rel=1e-6)
    assert "towards the centre" in found.report()


def test_errors_from_few_replicates_are_no_evidence():
    orbit = galaxy.orbit(Vector([5.0, 1.0, 0.5], 0.1 * np.eye(3), "galactic", dof=11))
    sure = galaxy.orbit(Vector([5.0, 1.0, 0.5], 0.1 * np.eye(3), "galactic"))
    assert orbit.across_p_value > 3 * sure.across_p_value
    expected, p = orbit.compare_with(lambda x: np.array([5.0, 0, 0]) / KM_S_MYR)
    assert p == Vector(orbit.acceleration.value - expected.value, 0.1 * np.eye(3), "galactic", dof=11).p_value


def test_bias_of_the_amplitude():
    rng = np.random.default_rng(1)
    true = np.array([2.0, 0.0, 0.0])
    covariance = np.diag([0.3, 0.5, 0.6]) ** 2
    lengths = [np.linalg.norm(true + rng.normal(size=3) * [0.3, 0.5, 0.6]) for _ in range(20_000)]
    found = galaxy.orbit(Vector(true, covariance, "galactic"))
    assert found.amplitude_bias == pytest.approx(np.mean(lengths) - 2, abs=0.02)


@pytest.mark.slow
def test_errors_on_simulated_skies():
    """V0 and R0 of 200 skies with a known acceleration: pulls 1."""
    truth = np.array([galaxy.expected_acceleration(8.2, 29.0), 0, 0])
    icrs = Vector(truth, np.zeros((3, 3)), "galactic").to_frame("icrs").value
    pulls, rng = [], np.random.default_rng(1)
    for _ in range(200):
        lon, lat = rng.uniform(0, 2 * np.pi, 2000), np.arcsin(rng.uniform(-1, 1, 2000))
        errors = np.full((2, 2000), 10.0)
        motion = sim.acceleration(icrs)(lon, lat) + errors * rng.normal(size=(2, 2000))
        found = galaxy.orbit(fit.fit_field(Field(lon, lat, motion, errors), 1), r0=8.2, r0_error=0.0)
        distance = galaxy.distance_of_centre(*found.inward, 29.0, 0.0)
        pulls.append(
            [(found.circular_speed[0] - 29 * 8.2) / found.circular_speed[1], (distance[0] - 8.2) / distance[1]]
        )
    assert np.std(pulls) == pytest.approx(1, abs=0.1)
    assert np.abs(np.mean(pulls, 0)).max() < 0.25


def test_potential():
    """A flat rotation curve of 238 km/s in km/s/Myr, and as a Quantity of any unit."""

    def plain(x):
        return -(238.0**2) * x / np.sum(x**2) * 1.0227121650537077e-3

    found = galaxy.orbit(EDR3)
    expected, p_value = found.compare_with(plain, height=0.0)
    assert expected.value[0] == pytest.approx(4.816, abs=0.005)
    assert p_value == pytest.approx(0.769, abs=0.005)
    other, again = found.compare_with(lambda x: plain(x)[:, None] * u.km / u.s / u.Myr, height=0.0)
    assert other.value == pytest.approx(expected.value, rel=1e-12)
    assert again == pytest.approx(p_value)
    assert found.compare_with(lambda x: plain(x) * 0.5)[1] < 1e-8
    for bad, said in (
        (3.0, "function of a position"),
        (lambda x: [1.0], "acceleration has shape"),
        (lambda x: x * u.kg, "acceleration is in kg"),
    ):
        with pytest.raises(ParameterError, match=said):
            found.compare_with(bad)


def test_messages():
    outward = galaxy.orbit(Vector([-1.0, 0, 0], np.eye(3), "galactic"))
    assert "does not point to the centre" in outward.report()
    with pytest.raises(ParameterError, match="does not point to the centre"):
        _ = outward.circular_speed
    with pytest.raises(ParameterError, match="a solution with an acceleration"):
        galaxy.orbit(5.0)
    with pytest.raises(ParameterError, match="must be in µas/yr"):
        galaxy.orbit(Vector([1, 0, 0], np.eye(3), unit="km/s"))
    with pytest.raises(ParameterError, match="r0 must be above zero"):
        galaxy.orbit(EDR3, r0=0)
