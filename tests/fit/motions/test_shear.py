"""Anisotropic expansion: five relations between a tensor and degree 2, and what a fit says of it."""

import numpy as np
import pytest
from conftest import few_or_many
from numpy.testing import assert_allclose
from scipy.linalg import block_diag

import fit
import sim
from fit.background._blocks import ClassEquations, ClassLikelihood, map_parities, reduce_class_equations
from fit.motions.shear import COMPONENT_INDICES, _mask_own_modes, compare_expansions, expansion, from_tensor, to_tensor
from vsh import Coefficients, Field, Mode, Modes, ModesError, ParameterError
from vsh.models.covariance import Spectrum

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


def test_five_relations():
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


def test_trace_makes_no_difference():
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


def test_prior_does_not_shrink_what_is_sought():
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
    with pytest.raises(ParameterError, match="must be Solution"):
        expansion(sky())
    with pytest.raises(ParameterError, match="hubble must be above zero"):
        expansion(fit.fit_field(sky(), 2), hubble=0)


def bins(k=3, n=4000, sigma=100.0, grows=0.0, seed=0, shared=0.0):
    """Normal equations of bins whose tensor grows from bin to bin, with a quadrupole of its own in each of degree 2 … 5."""
    common = Coefficients(Modes(5), np.random.default_rng(seed + 99).normal(size=70) * shared)
    out = []
    for i in range(k):
        field = sim.observe(
            sim.quasars(n, rng=10 * seed + i), sim.anisotropic_expansion(SHEAR * grows * i), rng=500 + 10 * seed + i,
            sigma=sigma,
        )  # fmt: skip
        motion = np.array(common.at(field.lon, field.lat))
        out.append(fit.normal_equations(field.minus(-motion), 5))
    return out


def test_free_modes_by_the_dense_covariance():
    """Degree 1 and the expansion of three classes: mean and covariance of all coefficients' joint inverse."""
    modes, k = Modes(4), 3
    own = _mask_own_modes(modes)
    assert own.sum() == 11
    normals = [fit.normal_equations(sky(800, seed), 4) for seed in range(k)]
    parts = ClassEquations.from_separate_classes([reduce_class_equations(each, modes, False, own) for each in normals])
    variances = Spectrum.flat().variances(modes)
    blocks = ClassLikelihood(parts, modes, variances, "each")
    x = np.random.default_rng(1).uniform(0.5, 3, blocks.units.size)
    mean, covariance = blocks.fit_free_modes(x)
    p = len(modes)
    matrix = block_diag(*(each.matrix for each in normals))
    share = blocks.compute_shares(x)[map_parities(modes)] * variances[:, None, None]
    prior = np.einsum("pij,pq->ipjq", share, np.eye(p)).reshape(k * p, -1)
    both = np.c_[np.eye(k * p)[:, np.tile(own, k)], np.eye(k * p)]
    precision = both.T @ matrix @ both
    precision[33:, 33:] += np.linalg.inv(prior + 1e-12 * np.trace(prior) * np.eye(k * p))
    solved = np.linalg.inv(precision)
    rhs = np.concatenate([each.rhs for each in normals])
    assert_allclose(covariance.reshape(33, 33), solved[:33, :33], rtol=1e-5, atol=1e-6 * covariance.max())
    assert_allclose(mean.ravel(), (solved @ (both.T @ rhs))[:33], atol=1e-5 * np.abs(mean).max())


def test_tensor_that_grows_is_recovered():
    result = compare_expansions(bins(n=8000, grows=25.0), [0.5, 1.0, 1.5], labels=["near", "middle", "far"])
    for i, shear in enumerate(result.shears):
        pull = (shear.values - 25.0 * i * SHEAR[tuple(np.transpose(COMPONENT_INDICES))]) / shear.sigma
        assert np.abs(pull).max() < 4
    assert result.growth() < 1e-4
    assert result.equality() < 1e-4
    assert result.p_value(2) < 1e-4
    assert_allclose(result.slope, 50 * SHEAR, atol=25)
    assert result.to_table()["place"].tolist() == [0.5, 1.0, 1.5]
    assert "linear change" in result.report()


def test_systematic_errors_are_no_expansion():
    """Systematic errors of 5 µas/yr in every coefficient: tiny formal p-values, and none with what bins share."""
    result = compare_expansions(bins(n=8000, sigma=30.0, shared=5.0))
    assert result.formal.min() < 1e-4
    assert min(map(result.p_value, range(3))) > 0.01
    assert result.growth() > 0.01


def test_classes_without_order():
    with pytest.raises(ParameterError, match="a place for each of 3 classes"):
        compare_expansions(bins(n=300), [1, 1, 1], draws=100)
    with pytest.raises(ModesError):
        compare_expansions([fit.normal_equations(sky(300, 1), 1)])


def test_no_p_value_of_a_fit_without_errors():
    """χ² of a covariance that is not known had p < 0.0027 on 95 % of skies of noise."""
    rng = np.random.default_rng(3)
    lon, lat = sim.uniform_sky(60, rng)
    sigma = np.tile(100 * 10 ** (4 * (rng.random(60) - 0.5)), (2, 1))
    field = Field(lon, lat, np.hypot(sigma, 300.0) * rng.normal(size=(2, 60)), sigma)
    solution = fit.estimate(field, 2, "student").solution
    assert np.isnan(solution.p_value("S", 2))
    assert np.isnan(expansion(solution).p_value)
