"""Classes of sources that share errors: what is found, how it is said, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import random_field
from scipy.special import chdtrc

import fit
import sim
import vsh
from fit.background import Spectrum, compare_classes_jointly, shared
from fit.background._blocks import ClassEquations, ClassLikelihood, map_parities, reduce_class_equations
from vsh import DegeneracyError, Field, FrameError, Modes, ModesError, ParameterError


def classes(seed=1, k=3, n=4000, power=20.0, lmax=5, change=(0.0, 0.0, 0.0)):
    """Classes of one sky with systematics in common, the last with another acceleration."""
    quasars = sim.quasars(k * n, seed)
    pattern = sim.systematics(power * Spectrum.flat(), seed + 100, lmax=7)
    out = []
    for i in range(k):
        signal = pattern + sim.acceleration(change if i == k - 1 else (0.0, 0.0, 0.0))
        out.append(fit.normal_equations(sim.observe(quasars[i::k], signal, rng=seed + i, sigma=300.0), lmax))
    return out


@pytest.fixture(scope="module")
def three():
    return shared(classes(), labels=["near", "middle", "far"], draws=200)


def test_gradient_is_that_of_the_likelihood():
    modes = Modes(4)
    parts = ClassEquations.from_separate_classes([reduce_class_equations(each, modes) for each in classes(lmax=4, k=2)])
    for own in ("each", "one"):
        blocks = ClassLikelihood(parts, modes, Spectrum.flat().variances(modes), own)
        x = np.linspace(0.7, 1.9, blocks.mode_units.size)
        value, slope = blocks.compute_loss(x)
        assert value == pytest.approx(-blocks.compute_log_likelihoods(x[None])[0], rel=1e-12)
        for k in range(x.size):
            step = np.zeros(x.size)
            step[k] = 1e-5
            numeric = (blocks.compute_loss(x + step)[0] - blocks.compute_loss(x - step)[0]) / 2e-5
            assert 2 * x[k] * slope[k] == pytest.approx(numeric, rel=1e-4, abs=1e-6)


def test_likelihood_is_that_of_the_dense_covariance():
    """ln L of degrees 2 … L by the covariance of all coefficients' right-hand sides."""
    modes = Modes(3)
    parts = ClassEquations.from_separate_classes(
        [reduce_class_equations(each, modes, False) for each in classes(lmax=3, k=2, n=500)]
    )
    variances = Spectrum.flat().variances(modes)
    blocks = ClassLikelihood(parts, modes, variances, "each")
    x = np.array([1.0, 0.5, 2.0, 0.7, 1.1, 0.2])
    shares = blocks.compute_shares(x)
    high = modes.degrees > 1
    prior = np.einsum("kij,k,kl->ikjl", shares[map_parities(modes)[high]], variances[high], np.eye(high.sum()))
    prior = prior.reshape(2 * high.sum(), -1)
    a = np.zeros_like(prior)
    q = high.sum()
    for i in range(2):
        a[i * q : (i + 1) * q, i * q : (i + 1) * q] = parts.matrix[i]
    beta = parts.rhs.ravel()
    inner = np.linalg.inv(prior) + a
    wanted = beta @ np.linalg.solve(inner, beta) / 2 - np.linalg.slogdet(np.eye(2 * q) + prior @ a)[1] / 2
    assert blocks.compute_log_likelihoods(x[None])[0] == pytest.approx(wanted, abs=1e-4)


def test_classes_alike_are_not_contradicted(three):
    assert three.equality() > 0.01
    assert three.trend() > 0.01
    verdict = three.verdict()
    assert verdict.p_value > 0.01
    assert verdict.p_value >= 0.9 * verdict.face_value
    assert verdict.looked_at == 6
    plain = [fit.solve(each) for each in classes()]
    assert all(s.sigma.mean() > p.sigma[p.modes.degrees == 1].mean() for s, p in zip(three.solutions, plain))
    difference = three.difference(0, 2)
    near, _, far = three.solutions
    np.testing.assert_allclose(difference.values, far.values - near.values)
    # What classes have in common drops out of their difference.
    assert difference.sigma.mean() < 1.2 * np.sqrt(2) * three.solutions[0].sigma.mean()
    assert three.power("T")[0] > 0


def test_change_is_found():
    result = shared(classes(change=(60.0, 0.0, 0.0)), draws=200)
    assert result.equality("S") < 0.0027
    assert result.equality("T") > 0.01
    verdict = result.verdict()
    assert verdict.p_value < 0.01
    assert "acceleration" in verdict.comparison
    assert "is contradicted" in result.verdict_words("redshift")


@pytest.mark.slow
def test_p_values_of_classes_alike():
    """On 24 skies of two classes with systematics in common, where fits without them find a change in most."""
    p, wrong = [], []
    for seed in range(24):
        normals = classes(seed=1000 + 10 * seed, k=2, n=1500, power=400.0, lmax=4)
        result = shared(normals, draws=100, rng=seed)
        p += [result.equality("T"), result.equality("S")]
        one, _ = result.solutions
        wrong.append(np.abs(one.coefficients.values / one.sigma))
    assert np.mean(np.array(p) < 0.05) <= 0.15
    assert np.mean(np.array(wrong) < 1.96) > 0.88


def test_same_seed_gives_the_same_result(three):
    assert shared(classes(), labels=["near", "middle", "far"], draws=200) == three


def test_results_are_told_and_drawn(three):
    report = three.report(long=True)
    assert "Does the dipole change with class?" in report
    assert "spectra        flat" in report
    assert "last − first" in report
    table = three.to_table()
    assert table["class"].tolist() == ["near", "middle", "far", "together"]
    assert len(three.plot()) == 2


def test_one_class_is_a_floor():
    (normal,) = classes(k=1)
    one = shared([normal], shapes=("flat",), draws=400)
    beside = fit.solve(normal, floor=fit.background.floor(normal, shapes=("flat",)))
    first = normal.modes.degrees == 1
    np.testing.assert_allclose(one.solutions[0].sigma, beside.sigma[first], rtol=0.12)
    np.testing.assert_allclose(one.solutions[0].values, beside.values[first], atol=0.15 * beside.sigma[first].max())
    with pytest.raises(ParameterError, match="a comparison needs two classes at least"):
        one.equality()


@pytest.mark.parametrize(
    ("call", "error", "words"),
    [
        (lambda n: shared([]), ParameterError, "there are no classes"),
        (lambda n: shared(n, degrees=(2,)), ModesError, "tell nothing of systematic errors"),
        (lambda n: shared(n, degrees=(2, 4)), ModesError, "without a gap"),
        (lambda n: shared(n, degrees=range(2, 9)), ModesError, "degree 8 is not fitted"),
        (lambda n: shared(n, shapes=("steeper",)), ParameterError, "a shape is 'flat', 'gaia', 'steep' or a Spectrum"),
        (lambda n: shared(n, labels=["a"]), ParameterError, "1 labels for 2 classes"),
        (lambda n: shared(n, own="two"), ParameterError, "own"),
        (lambda n: shared([n[0], replace(n[1], frame="galactic")]), FrameError, "classes are in"),
        (lambda n: shared([n[0], replace(n[1], n_data=0)], labels=["a", "b"]), DegeneracyError, "the class b is empty"),
        (lambda n: shared(n).trend([1.0, 1.0]), ParameterError, "a place for each"),
    ],
)
def test_messages_name_the_error(call, error, words):
    with pytest.raises(error, match=words):
        call(classes(k=2, n=300, lmax=4))


def test_class_on_a_cap_is_named():
    field = random_field(4000, 1)
    cap = field[field.lat > 1.2]
    result = shared([fit.normal_equations(field, 4), fit.normal_equations(cap, 4)], labels=["sky", "cap"], draws=60)
    assert any("the class cap sees too little of the sky" in note for note in result.notes)
    one_place = Field(np.full(5, 1.0), np.full(5, 0.2), np.ones((2, 5)), np.ones((2, 5)))
    with pytest.raises(DegeneracyError, match="class 2: a class does not determine|class 2: a class sees nothing"):
        shared([fit.normal_equations(field, 4), fit.normal_equations(one_place, 4)])


def test_covariance_is_that_of_the_mixture(three):
    """Mean of the covariances of all draws, and the scatter of their means."""
    size = 18
    inner = three.covariances.mean(0).reshape(size, size)
    scatter = np.cov(three.means.reshape(len(three.means), size).T, bias=True)
    np.testing.assert_allclose(three.covariance, inner + scatter, rtol=1e-10, atol=1e-12)
    assert np.trace(scatter) > 0


def test_errors_are_scaled_by_their_own_chi2():
    """Errors of one class too small by a factor: the same as if they were right, and the factor is said."""
    first, right = classes(k=2, n=1000)
    wrong = replace(right, matrix=right.matrix * 9, rhs=right.rhs * 9, chi2_null=9 * right.chi2_null)
    one, two = (shared([first, each], draws=100) for each in (right, wrong))
    np.testing.assert_allclose(two.covariance, one.covariance, rtol=1e-6)
    assert two.noise_scale[1] == pytest.approx(3 * one.noise_scale[1])


@pytest.mark.slow
def test_classes_that_share_no_noise_are_classes_of_their_own():
    """The model of catalogues, whose normal matrix has blocks between classes, with blocks of zeros."""
    rng = np.random.default_rng(4)
    fields = [random_field(500, seed, 0.5) for seed in range(3)]
    normals = [fit.normal_equations(each, 5) for each in fields]
    modes = normals[0].modes
    matrix, rhs = np.zeros((3, len(modes), 3, len(modes))), np.stack([each.rhs for each in normals])
    for k, each in enumerate(normals):
        matrix[k, :, k] = each.matrix
    plain = shared(normals, noise_scale=False, draws=100)
    joint = compare_classes_jointly(matrix, rhs, modes, draws=100, labels=("a", "b", "c"), n_sources=(500,) * 3)
    np.testing.assert_allclose(joint.values, plain.values, rtol=1e-8, atol=1e-10 * np.abs(plain.values).max())
    np.testing.assert_allclose(joint.covariance, plain.covariance, atol=1e-10 * plain.covariance.max())
    assert joint.probability == pytest.approx(plain.probability, rel=1e-9)
    # With blocks between classes: slopes are those of differences, degree 1 that of a joint inverse.
    mixed = matrix.reshape(rhs.size, -1)
    root, turn = np.linalg.cholesky(mixed), rng.normal(size=mixed.shape) / 60
    mixed = root @ (np.eye(rhs.size) + turn @ turn.T) @ root.T
    joint = ClassEquations.from_joint_equations(mixed.reshape(matrix.shape), rhs, modes)
    variances = Spectrum.flat().variances(modes)
    blocks = ClassLikelihood(joint, modes, variances, "each")
    x = rng.uniform(0.5, 3, blocks.units.size)
    _, slope = blocks.compute_loss(x)
    for k in range(x.size):
        up, down = (blocks.compute_loss(np.sqrt(x**2 + step * np.eye(x.size)[k]))[0] for step in (1e-5, -1e-5))
        assert (up - down) / 2e-5 == pytest.approx(slope[k], rel=1e-5, abs=1e-7)
    mean, covariance = blocks.fit_free_modes(x)
    share = blocks.compute_shares(x)[map_parities(modes)] * variances[:, None, None]
    prior = np.einsum("pij,pq->ipjq", share, np.eye(len(modes))).reshape(mixed.shape)
    low = np.tile(modes.degrees == 1, 3)
    free = np.eye(rhs.size)[:, low]
    both = np.concatenate([free, np.eye(rhs.size)], 1)
    precision = both.T @ mixed @ both
    precision[18:, 18:] += np.linalg.inv(prior + 1e-12 * np.trace(prior) * np.eye(rhs.size))
    solved = np.linalg.inv(precision)
    np.testing.assert_allclose(covariance.reshape(18, 18), solved[:18, :18], rtol=1e-5, atol=1e-6 * covariance.max())
    np.testing.assert_allclose(mean.ravel(), (solved @ (both.T @ rhs.ravel()))[:18], atol=1e-5 * np.abs(mean).max())


def scalar_classes(offset, n=3000):
    """Two classes of numbers whose means differ."""
    rng = np.random.default_rng(4)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    values = rng.normal(size=n) + np.where(np.arange(n) < n // 2, 0.0, offset)
    field = vsh.ScalarField(lon, lat, values, np.ones(n), "mag")
    return shared([fit.normal_equations(part, 4) for part in (field[: n // 2], field[n // 2 :])], labels=["a", "b"])


def test_means_and_dipoles_of_classes_of_numbers():
    found = scalar_classes(0.4)
    value, error = found.difference(0, 1).mean
    assert abs(value - 0.4) < 3 * error
    verdict = found.verdict()
    assert verdict.p_value < 0.0027
    assert verdict.comparison == "b against a, mean"
    assert verdict.face_value == pytest.approx(chdtrc(1, (value / error) ** 2), rel=0.01)
    assert found.p_value("dipole", 0, 1) > 0.001
    table = found.to_table()
    assert table["mean"].unit == table["dipole_x_error"].unit == "mag"
    assert "mean p = " in found.report()
    assert "spin" not in found.report(long=True)
    assert scalar_classes(0.0).verdict().p_value > 0.0027


def test_classes_in_different_units_are_refused():
    field = vsh.ScalarField(*np.random.default_rng(1).uniform(0, 1, (2, 500)), np.zeros(500), np.ones(500), "mas")
    other = fit.normal_equations(replace(field, unit="µas"), 3)
    with pytest.raises(ParameterError, match="mas and µas"):
        shared([fit.normal_equations(field, 3), other])
