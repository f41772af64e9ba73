"""The Sun's motion and Oort's constants from stars and clusters at known distances."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many, random_field
from scipy import stats

import fit
from fit.distances import inverse_distances_from_measurements
from vsh import DegeneracyError, Field, FieldError, ParameterError
from vsh.sky.sphere import triad
from vsh.tools.units import AU_PER_YEAR

SUN = np.array([11.1, 12.24, 7.25])
A, B, C, K = 15.3, -11.9, -3.2, -3.3


def stars(rng, n=4000, length=0.3, spread=(35.0, 25.0, 20.0), relative=None, sigma_plx=None, sigma=50.0, sun=SUN):
    """Stars that thin out with exp(−d/L) in a field of rotation and shear, as they are seen in Galactic axes."""
    d = rng.gamma(3.0, length, n)  # kpc
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    p, q, r = triad(lon, lat)
    gradient = np.array([[K + C, A - B, 0], [A + B, K - C, 0], [0, 0, 0]])
    velocity = -np.asarray(sun)[:, None] + gradient @ (r * d) + rng.normal(size=(3, n)) * np.array(spread)[:, None]
    motion = np.stack([np.sum(p * velocity, 0), np.sum(q * velocity, 0)]) / (AU_PER_YEAR * d / 1000)
    motion += sigma * rng.normal(size=(2, n))
    columns = {}
    if sigma_plx is None:
        relative = 0.05 if relative is None else relative
        seen = d * (1 + relative * np.clip(rng.normal(size=n), -3.0, 3.0))
        keep = seen > 0
        columns = {"distance": seen / 1000, "distance_error": relative * d / 1000}
    else:
        columns = {"parallax": 1 / d + sigma_plx * rng.normal(size=n), "parallax_error": np.full(n, sigma_plx)}
        keep = np.ones(n, bool)
    field = Field(lon, lat, motion, np.full((2, n), sigma), frame="galactic", **columns)
    return field[keep]


TRUTH = {"v_x": SUN[0], "v_y": SUN[1], "v_z": SUN[2], "w_x": 0.0, "w_y": 0.0, "w_z": B, "A": A, "C": C, "K": K, "S_xz": 0.0, "S_yz": 0.0}  # fmt: skip


@pytest.mark.slow
@few_or_many(12, 120, "skies")
def test_errors_hold(skies):
    """Pulls of all eleven parameters, with a velocity ellipsoid that is no sphere."""
    pulls = []
    for seed in range(skies):
        solution = fit.kinematics(stars(np.random.default_rng(seed), 1500))
        pulls.append([(v - TRUTH[k]) / s for k, v, s in zip(solution.names, solution.values, solution.sigma)])
    pulls = np.array(pulls)
    # The sum of squares of so many pulls is χ²; columns of one sky are hardly correlated.
    total = np.sum(pulls**2)
    assert 0.001 < stats.chi2.sf(total, pulls.size) < 0.9999
    assert np.abs(pulls.mean(0)).max() < 4.2 / np.sqrt(skies)


@pytest.mark.slow
def test_oorts_constants_and_the_vertex():
    solution = fit.kinematics(stars(np.random.default_rng(1), 20_000))
    for name, true in (("A", A), ("B", B), ("C", C), ("K", K)):
        value, error = solution.oort[name]
        assert abs(value - true) < 4 * error
        assert error < 1.5
    vertex, error = solution.vertex
    assert abs(vertex - np.degrees(np.arctan2(-C, A)) / 2) < 4 * error
    assert 23 < solution.dispersion < 31
    assert solution.rotation.unit == "km/s/kpc"
    report = solution.report()
    assert f"A = {solution.oort['A'][0]:+.2f} ± {solution.oort['A'][1]:.2f}" in report
    assert "vertex" in report
    bare = fit.kinematics(stars(np.random.default_rng(1), 500), gradient=False)
    assert bare.names == ("v_x", "v_y", "v_z")
    assert bare.oort == {}
    assert bare.rotation is None is bare.vertex


@pytest.mark.slow
@few_or_many(5, 20)
def test_parallaxes_of_small_signal_do_not_bias(n_skies):
    """Half of the parallaxes are below 3 σ: 1/ϖ would be worthless, and the motion is right."""
    pulls = []
    for seed in range(n_skies):
        field = stars(np.random.default_rng(seed), 4000, length=0.7, sigma_plx=0.25)
        assert np.mean(field.parallax < 3 * field.parallax_error) > 0.5
        assert (field.parallax <= 0).any()
        solution = fit.kinematics(field, gradient=False, power=2.0)
        pulls.append((solution.values - SUN) / solution.sigma)
        assert solution.length == pytest.approx(0.7, rel=0.15)
        assert any("distances by parallax" in note for note in solution.notes)
    assert np.abs(np.mean(pulls, 0)).max() < 4 / np.sqrt(n_skies)
    assert 0.5 < np.std(pulls) < 1.6


def test_clusters_find_the_suns_motion_around_the_centre():
    """158 clusters in a halo that does not turn: what is seen is our own motion around the Galaxy."""
    around, pulls = np.array([11.1, 245.0, 7.25]), []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = 158
        at = rng.normal(size=(3, n)) * 6.0 + np.array([[8.2], [0], [0]])  # kpc
        d = np.linalg.norm(at, axis=0)
        lon, lat = np.arctan2(at[1], at[0]), np.arcsin(at[2] / d)
        p, q, _ = triad(lon, lat)
        velocity = -around[:, None] + 110 * rng.normal(size=(3, n))
        motion = np.stack([np.sum(p * velocity, 0), np.sum(q * velocity, 0)]) / (AU_PER_YEAR * d / 1000)
        motion += 30 * rng.normal(size=(2, n))
        seen = d * (1 + 0.03 * rng.normal(size=n)) / 1000
        field = Field(
            lon, lat, motion, np.full((2, n), 30.0), frame="galactic", distance=seen, distance_error=0.03 * seen
        )
        solution = fit.kinematics(field, gradient=False)
        pulls.append((solution.velocity.value - around) / solution.sigma)
    assert solution.frame == "galactic"
    assert solution.dispersion == pytest.approx(110, rel=0.2)
    assert abs(np.std(pulls) - 1) < 3 / np.sqrt(2 * 60)
    assert np.abs(np.mean(pulls, 0)).max() < 4 / np.sqrt(20)


def test_frame_does_not_matter():
    field = stars(np.random.default_rng(3), 800)
    a, b = fit.kinematics(field), fit.kinematics(field.to_frame("icrs"))
    np.testing.assert_allclose(a.values, b.values, rtol=1e-6, atol=1e-8)
    equatorial = fit.kinematics(field, frame="icrs", gradient=False)
    galactic = fit.kinematics(field, gradient=False)
    np.testing.assert_allclose(equatorial.velocity.to_frame("galactic").value, galactic.values, rtol=1e-6)


def test_rates_of_sure_distances_are_their_inverse():
    field = stars(np.random.default_rng(5), 50, relative=1e-4)
    rates = inverse_distances_from_measurements(field)
    np.testing.assert_allclose(rates.mean, 1 / (AU_PER_YEAR * field.distance), rtol=1e-6)
    np.testing.assert_allclose(np.sqrt(rates.variance) / rates.mean, 1e-4, rtol=2e-3)


@pytest.mark.parametrize("signal", [0.5, 2.0, 5.9, 6.1, 30.0])
@pytest.mark.parametrize("power", [1.0, 2.0])
def test_rates_of_parallaxes_against_a_fine_sum(signal, power):
    d = np.geomspace(1e-5, 1e-1, 400_001)  # Mpc
    plx, error, length = 1.0, 1.0 / signal, 0.5e-3
    weight = d ** (power + 1) * np.exp(-d / length - (((1e-3 / d - plx) / error) ** 2) / 2)
    rate = 1 / (AU_PER_YEAR * d)
    mean = np.sum(weight * rate) / weight.sum()
    field = Field([0.1], [0.2], [[1.0], [1.0]], [[1.0], [1.0]], parallax=[plx], parallax_error=[error])
    rates = inverse_distances_from_measurements(field, length, power)
    assert rates.mean[0] == pytest.approx(mean, rel=1e-5)
    assert rates.variance[0] == pytest.approx(np.sum(weight * (rate - mean) ** 2) / weight.sum(), rel=1e-4)


def test_errors_have_what_another_density_would_change():
    """Of a disc taken for a ball the velocity was off by more than its error."""
    rng, n = np.random.default_rng(4), 6000
    radius, angle = 2.5e-3 * np.sqrt(rng.random(n)), rng.uniform(0, 2 * np.pi, n)
    place = np.array([radius * np.cos(angle), radius * np.sin(angle), rng.laplace(0, 1.5e-4, n)])
    d = np.linalg.norm(place, axis=0)
    lon, lat = np.arctan2(place[1], place[0]) % (2 * np.pi), np.arcsin(place[2] / d)
    velocity = np.array([30.0, 40.0, 20.0])
    p, q, _ = triad(lon, lat)
    across = np.stack([np.sum(each * (10 * rng.normal(size=(3, n)) - velocity[:, None]), 0) for each in (p, q)])
    measured = np.abs(d * (1 + 0.15 * rng.normal(size=n)))
    field = Field(lon, lat, across / (AU_PER_YEAR * d), np.full((2, n), 1.0), frame="galactic",
                  distance=measured, distance_error=0.15 * d)  # fmt: skip
    found, ball = (fit.kinematics(field, gradient=False, power=power) for power in (None, 2.0))
    assert np.max(np.abs(ball.values - velocity) / ball.sigma) > 3
    assert np.max(np.abs(found.values - velocity) / found.sigma) < 2.5
    np.testing.assert_array_equal(found.values, ball.values)
    exact = replace(field, distance=d, distance_error=1e-4 * d)
    sure = [fit.kinematics(exact, gradient=False, power=power).sigma for power in (None, 2.0)]
    np.testing.assert_allclose(*sure, rtol=1e-4)


def test_messages_name_the_error():
    field = stars(np.random.default_rng(1), 200)
    with pytest.raises(FieldError, match="200 of 200 sources have neither a distance nor a parallax"):
        fit.kinematics(Field(field.lon, field.lat, field.motion, field.sigma))
    with pytest.raises(DegeneracyError, match="5 sources cannot determine 11 parameters"):
        fit.kinematics(field[:5])
    with pytest.raises(ParameterError, match="a dispersion is a number"):
        fit.kinematics(field, dispersion="large")
    one = field[:50]
    same = Field(
        one.lon * 0 + 1, one.lat * 0, one.motion, one.sigma, distance=one.distance, distance_error=one.distance_error
    )
    with pytest.raises(DegeneracyError, match="cannot separate"):
        fit.kinematics(same)


@pytest.mark.slow
def test_unsure_distances_scatter():
    """Fast stars at distances known to 30 %: what that scatters is no dispersion of theirs."""
    pulls, dispersions = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        field = stars(rng, 1500, relative=0.3, spread=(10.0, 10.0, 10.0), sun=(120.0, 0.0, 0.0))
        solution = fit.kinematics(field, gradient=False)
        pulls.append((solution.values - [120.0, 0, 0]) / solution.sigma)
        dispersions.append(solution.dispersion)
    assert np.median(dispersions) < 20
    assert np.std(pulls) < 1.5


@few_or_many(40, 300, "skies")
@pytest.mark.parametrize("n", [6, 10])
def test_p_values_of_few_stars(n, skies):
    """Of errors from ten scores p < 0.0027 came out on 6 % of skies, and from six on 18 %."""
    p_values = []
    for seed in range(skies):
        rng = np.random.default_rng([n, seed])
        lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
        p, q, _ = triad(lon, lat)
        d, velocity = rng.gamma(3.0, 1.0, n), -SUN[:, None] + 20 * rng.normal(size=(3, n))
        motion = np.stack([np.sum(p * velocity, 0), np.sum(q * velocity, 0)]) / (AU_PER_YEAR * d / 1000)
        columns = {"distance": d / 1000, "distance_error": 0.01 * d / 1000}
        field = Field(lon, lat, motion, np.full((2, n), 1.0), frame="galactic", **columns)
        velocity = fit.kinematics(field, gradient=False).velocity
        assert velocity.dof < 2 * n
        p_values.append(replace(velocity, value=velocity.value - SUN).p_value)
    assert np.mean(np.array(p_values) < 0.0027) < 0.03
    assert np.mean(np.array(p_values) < 0.05) < 0.05 + 3 * np.sqrt(0.05 / skies)


def test_galaxies_are_refused():
    """At 60 Mpc the acceleration of the Solar System is 1400 km/s, and no parameter here."""
    field = random_field(100, 1)
    near = replace(field, distance=np.full(100, 0.5), distance_error=np.full(100, 0.05))
    assert fit.kinematics(near, gradient=False).names == ("v_x", "v_y", "v_z")
    with pytest.raises(ParameterError, match="beyond 60 Mpc"):
        fit.kinematics(replace(near, distance=np.full(100, 60.0)), gradient=False)
