"""Anisotropic expansion: five relations between a tensor and degree 2, and what a fit says of it."""

import numpy as np
import pytest
from conftest import few_or_many
from numpy.testing import assert_allclose

import fit
import sim
from fit.motions.shear import expansion, from_tensor, to_tensor
from vsh import Field, Mode, ModesError, ParameterError

SHEAR = np.array([[0.9, -0.4, 0.3], [-0.4, -1.3, 0.7], [0.3, 0.7, 0.4]])
ROOT = np.sqrt(np.pi / 5)
#: Each coefficient of degree 2 by the tensor.
RELATIONS = {
    Mode("S", 2, 0): np.sqrt(6) * ROOT * SHEAR[2, 2], Mode("S", 2, 2, "re"): ROOT * (SHEAR[0, 0] - SHEAR[1, 1]),
    Mode("S", 2, 2, "im"): -2 * ROOT * SHEAR[0, 1], Mode("S", 2, 1, "re"): -2 * ROOT * SHEAR[0, 2],
    Mode("S", 2, 1, "im"): 2 * ROOT * SHEAR[1, 2],
}  # fmt: skip


def sky(n=500, seed=1, shear=SHEAR, sigma=5.0):
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-0.8, 1, n))
    errors = np.full((2, n), sigma)
    return Field(lon, lat, sim.anisotropic_expansion(shear)(lon, lat) + errors * rng.normal(size=(2, n)), errors)


def test_the_five_relations():
    """Exactly: a fit without noise of the field that sim makes, and the conversion both ways."""
    field = sky(sigma=1e-3)
    clean = field.minus(field.motion - sim.anisotropic_expansion(SHEAR)(field.lon, field.lat))
    solution, made = fit.fit_field(clean, 3), from_tensor(SHEAR)
    for mode in solution.modes:
        expected = RELATIONS.get(mode, 0.0)
        assert solution.values[solution.modes.index(mode)] == pytest.approx(expected, abs=1e-12)
        if mode.l < 3:
            assert made.values[made.modes.index(mode)] == pytest.approx(expected, abs=1e-12)
    assert_allclose(to_tensor(made), SHEAR, atol=1e-12)
    assert made.power("S", 2) == pytest.approx(4 * np.pi / 5 * np.sum(SHEAR**2), rel=1e-12)


def test_a_trace_makes_no_difference():
    assert_allclose(from_tensor(SHEAR + 3 * np.eye(3)).values, from_tensor(SHEAR).values, atol=1e-12)


@few_or_many(30, 200)
def test_pulls(n_skies):
    """Errors of the tensor and of its eigenvalues."""
    pulls, rates = [], []
    truth = np.linalg.eigvalsh(SHEAR)[::-1]
    places = ([0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2])
    for seed in range(n_skies):
        found = expansion(fit.fit_field(sky(seed=seed, sigma=3.0), 3))
        pulls.append((found.values - SHEAR[places]) / found.sigma)
        clear = expansion(fit.fit_field(sky(seed=seed, sigma=0.5), 3))  # rates far apart in their errors
        rates.append((clear.eigenvalues - truth) / clear.eigenvalue_errors)
    error = np.sqrt(0.5 / n_skies)  # of a scatter
    assert_allclose(np.std(pulls, axis=0), 1, atol=3.2 * error)
    assert np.std(pulls) == pytest.approx(1, abs=error)
    assert np.abs(np.mean(pulls, axis=0)).max() < 3.5 / np.sqrt(n_skies)
    assert_allclose(np.std(rates, axis=0), 1, atol=3.2 * error)


@pytest.mark.slow
def test_limits_hold_at_any_signal():
    """95 % limits of |Σ| from nothing to three errors."""
    for size in (0.0, 0.3, 1.0):
        shear = size * SHEAR / np.linalg.norm(SHEAR)
        held = [expansion(fit.fit_field(sky(300, seed, shear), 2)).limit() > size for seed in range(100)]
        assert np.mean(held) > 0.9


@pytest.mark.slow
def test_p_values_of_noise():
    p = [expansion(fit.fit_field(sky(200, seed, np.zeros((3, 3))), 2)).p_value for seed in range(200)]
    assert np.mean(np.array(p) < 0.2) == pytest.approx(0.2, abs=0.09)


def test_a_prior_does_not_shrink_what_is_sought():
    """Of a fit with a floor the tensor is that without, as its p-value is."""
    equations = fit.normal_equations(sky(2000, sigma=60.0, shear=4 * SHEAR), 5)
    plain, shrunk = fit.solve(equations), fit.solve(equations, floor=fit.background.floor(equations))
    one, two = expansion(plain), expansion(shrunk)
    assert_allclose(two.tensor, one.tensor, rtol=1e-9)
    assert_allclose(two.covariance, one.covariance, rtol=0.05)  # by the scale of the errors, which a floor finds
    assert np.log(two.p_value) == pytest.approx(np.log(one.p_value), rel=0.05)
    assert two.limit() > np.linalg.norm(4 * SHEAR) * 0.7


def test_frames_and_report():
    solution = fit.fit_field(sky(), 3)
    found, turned = expansion(solution), expansion(fit.fit_field(sky().to_frame("galactic"), 3))
    assert_allclose(found.to_frame("galactic"), turned.tensor, atol=1e-10)
    assert_allclose(found.eigenvalues, turned.eigenvalues, atol=1e-10)
    assert_allclose(found.axes @ found.tensor @ found.axes.T, np.diag(found.eigenvalues), atol=1e-12)
    assert found.percent(14.7665) == pytest.approx(100, rel=1e-4)
    assert "% of H0 = 70" in found.report()
    assert np.trace(found.tensor) == pytest.approx(0, abs=1e-12)


def test_messages():
    with pytest.raises(ModesError, match="degree 2 at least"):
        expansion(fit.fit_field(sky(), 1))
    with pytest.raises(ParameterError, match="symmetric"):
        from_tensor(np.triu(np.ones((3, 3))))
    with pytest.raises(ParameterError, match="must be HarmonicSolution"):
        expansion(sky())
    with pytest.raises(ParameterError, match="hubble must be above zero"):
        expansion(fit.fit_field(sky(), 2), hubble=0)
