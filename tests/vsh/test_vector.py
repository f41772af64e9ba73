"""Amplitude, direction, and their errors."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many
from scipy.stats import kstest

from vsh import Vector
from vsh.length import length_limits
from vsh.tools.errors import FrameError, VshError

COVARIANCE = np.array([[0.04, 0.01, 0], [0.01, 0.09, -0.02], [0, -0.02, 0.16]])


@pytest.mark.slow
def test_errors_are_the_scatter_of_many_draws():
    vector = Vector([3, -4, 2], COVARIANCE / 100)
    draws = np.random.default_rng(1).multivariate_normal(vector.value, vector.covariance, 200_000)
    each = [Vector(draw, np.zeros((3, 3))) for draw in draws[:20_000]]
    # 20 000 draws give a standard deviation to 0.5 %; first order in errors of 1/50 is better than that.
    assert np.std([v.amplitude for v in each]) == pytest.approx(vector.amplitude_error, rel=0.02)
    lon, lat = np.transpose([v.direction for v in each])
    assert (np.std(lon), np.std(lat)) == pytest.approx(vector.direction_error, rel=0.02)


def test_debiased_amplitude():
    """Of a null vector the noise alone is as long as √tr C; less that, nothing is left on average."""
    draws = np.random.default_rng(1).multivariate_normal([0.3, 0, 0], COVARIANCE, 20_000)
    square = np.mean(np.sum(draws**2, 1)) - np.trace(COVARIANCE)
    assert square == pytest.approx(0.09, abs=0.01)
    assert Vector([0.1, 0.1, 0.1], COVARIANCE).debiased_amplitude == 0.0


def test_another_frame_keeps_the_vector():
    vector = Vector([3, -4, 2], COVARIANCE)
    turned = vector.to_frame("galactic")
    assert turned.amplitude == pytest.approx(vector.amplitude)
    assert turned.amplitude_error == pytest.approx(vector.amplitude_error)
    back = turned.to_frame("icrs")
    np.testing.assert_allclose(back.value, vector.value, atol=1e-12)
    np.testing.assert_allclose(back.covariance, COVARIANCE, atol=1e-12)


def test_null_vector_has_no_direction_but_no_crash():
    null = Vector([0, 0, 0], COVARIANCE)
    assert null.amplitude == 0
    assert np.isnan(null.amplitude_error)


def test_unknown_frames_are_named():
    with pytest.raises(FrameError, match="unknown frame 'b1950': choose one of icrs, galactic, ecliptic"):
        Vector([1, 2, 3], COVARIANCE, "b1950")


@few_or_many(20, 600, "n")
@pytest.mark.parametrize("covariance", [np.eye(3), np.diag([0.5, 1.0, 2.0])])
@pytest.mark.parametrize(
    "signal_to_noise", [0.0, 1.5, *(pytest.param(x, marks=pytest.mark.slow) for x in (0.5, 1.0, 2.0, 3.0, 5.0))]
)
def test_intervals_limits_and_cones_cover(covariance, signal_to_noise, n):
    """± covered 19 % of lengths without a signal, 45 % at S/N 1."""
    rng = np.random.default_rng(int(10 * signal_to_noise) + 1)
    root, sigma = np.linalg.cholesky(covariance), np.sqrt(np.trace(covariance) / 3)
    inside = limited = coned = 0
    for _ in range(n):
        direction = rng.normal(size=3)
        direction /= np.linalg.norm(direction)
        length = signal_to_noise * sigma
        vector = Vector(length * direction + root @ rng.normal(size=3), covariance)
        low, high = vector.amplitude_interval()
        inside += low <= length <= high
        limited += vector.amplitude_limit() >= length
        coned += np.degrees(np.arccos(vector.value @ direction / vector.amplitude)) < vector.direction_cone()
    error = 4 * np.sqrt(0.68 * 0.32 / n)  # of forty checks one in 400 fails at 4 σ
    assert inside / n > 0.68 - error
    assert limited / n > 0.95 - 4 * np.sqrt(0.95 * 0.05 / n)
    if signal_to_noise >= 1:
        assert 0.60 - error < coned / n < 0.74 + error  # as the docstring says
    assert inside / n < 0.74 + error


def test_search_that_finds_nothing_has_the_limit_of_noise():
    """CLs of no length at all: e^{−a²/2} is what a true length a leaves of the probability of noise."""
    for length in (0.0, 1e-4, 1e-2):
        limit = Vector([length, 0, 0], np.eye(3)).amplitude_limit(0.95)
        assert limit == pytest.approx(np.sqrt(-2 * np.log(0.05)), rel=0.08)


@pytest.mark.slow
@pytest.mark.parametrize("dof", [3, 7, 30])
def test_few_replicates_make_hotelling_of_chi2(dof):
    """Null vectors with a covariance from few replicates: p is uniform, limits and intervals cover."""
    rng, n, truth = np.random.default_rng(dof), 2000, np.array([1.5, 0, 0])
    spread = np.einsum("nki,nkj->nij", *[rng.normal(size=(n, dof, 3))] * 2) / dof
    null = [Vector(v, c, dof=dof) for v, c in zip(rng.normal(size=(n, 3)), spread, strict=True)]
    assert kstest([each.p_value for each in null], "uniform").pvalue > 0.01
    some = [Vector(each.value + truth, each.covariance, dof=dof) for each in null[:150]]
    assert np.mean([each.amplitude_limit() > 1.5 for each in some]) > 0.95 - 3 * 0.018
    assert np.mean([np.prod(np.subtract(each.amplitude_interval(), 1.5)) < 0 for each in some]) > 0.68 - 3 * 0.038
    # Of a long vector, for which errors taken as known exclude too much.
    long = np.stack([each.value for each in null]) + 4 * truth
    assert np.mean(length_limits(long, spread, dof=dof) >= 6) > 0.95 - 2.5 * 0.005
    assert np.mean([replace(each, dof=np.inf).p_value < 0.05 for each in null]) > 0.06
    assert np.isnan(Vector([1, 0, 0], np.eye(3), dof=2).p_value)
    # Of many it is χ² again.
    many, plain = Vector([2, 1, 0], np.eye(3), dof=1e6), Vector([2, 1, 0], np.eye(3))
    assert many.p_value == pytest.approx(plain.p_value, rel=1e-4)
    assert many.amplitude_limit() == pytest.approx(plain.amplitude_limit(), rel=1e-3)
    np.testing.assert_allclose(many.amplitude_interval(), plain.amplitude_interval(), rtol=3e-3)


def test_no_cone_without_degrees_of_freedom():
    assert np.isfinite(Vector([9, 0, 0], np.eye(3), dof=50).direction_cone())
    assert np.isnan(Vector([9, 0, 0], np.eye(3), dof=2).direction_cone())


def test_bad_vectors():
    for value, spread in (
        ([1, 2], np.eye(3)),
        ([1, 2, np.inf], np.eye(3)),
        ([1, 2, 3], -np.eye(3)),
        ([1, 2, 3], np.triu(np.ones((3, 3)))),
    ):
        with pytest.raises(VshError):
            Vector(value, spread)


@pytest.mark.parametrize(
    ("unit", "in_si"),
    [("µas/yr", 4.848136811095e-12), ("km/s", 1.0), ("µas", 4.848136811095e-12), ("mas", 4.848136811095e-9)],
)
def test_quantities_out(unit, in_si):
    from astropy import units as u

    found = Vector([1, 2, 3], np.eye(3), unit=unit).quantity
    target = {"µas/yr": u.rad / u.yr, "km/s": u.km / u.s}.get(unit, u.rad)
    np.testing.assert_allclose(found.to_value(target), np.array([1, 2, 3]) * in_si)


def test_format_is_that_of_each_number():
    vector = Vector([1.234, -5.678, 0.0], np.eye(3))
    assert f"{vector:.1f}" == "(1.2, -5.7, 0.0) ± (1.0, 1.0, 1.0) µas/yr, icrs"
    assert f"{vector}" == str(vector)
