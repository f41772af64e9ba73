"""Evidence in closed form: against the dense Gaussian, and a table of a real catalogue."""

import numpy as np
import pytest
from conftest import random_field, real_catalogue
from scipy.integrate import quad

import fit
import sim
from fit.background import Spectrum, compare_models, evidence
from vsh import Modes
from vsh.basis import harmonics
from vsh.io.catalogue import read_field
from vsh.models.covariance import of_errors
from vsh.tools.errors import ModesError, ParameterError

FIELD = random_field(150, seed=1)
PER_DEGREE = Spectrum.power_law(0)


def gaussian(field, variances, modes):
    """ln of the Gaussian of all motions."""
    rows = harmonics(field.lon, field.lat, modes).reshape(len(modes), -1).T
    covariance, y = of_errors(field).matrix + rows @ np.diag(variances) @ rows.T, field.motion.ravel()
    return -(np.linalg.slogdet(covariance)[1] + y @ np.linalg.solve(covariance, y)) / 2


@pytest.mark.parametrize("degrees", [(1,), (1, 2, 3), (2,), (1, 3)])
def test_evidence_is_that_of_the_dense_gaussian(degrees):
    modes, spectrum = Modes(3), 50 * PER_DEGREE
    variances = np.where(np.isin(modes.degrees, degrees), spectrum.variances(modes), 0)
    expected = gaussian(FIELD, variances, modes) - gaussian(FIELD, 0 * variances, modes)
    assert evidence(fit.normal_equations(FIELD, 3), spectrum, degrees) == pytest.approx(expected, abs=1e-9)


def test_dipole_that_changes():
    """Two halves with coefficients in common and of their own: the dense Gaussian of both."""
    modes, halves = Modes(1), [FIELD[:80], FIELD[80:]]
    rows = [harmonics(half.lon, half.lat, modes).reshape(6, -1).T for half in halves]
    own, common = 30 * PER_DEGREE, 80 * PER_DEGREE
    parts = [[None, None], [None, None]]
    for i in (0, 1):
        for j in (0, 1):
            variances = common.variances(modes) + (own.variances(modes) if i == j else 0)
            parts[i][j] = rows[i] @ np.diag(variances) @ rows[j].T + (of_errors(halves[i]).matrix if i == j else 0)
    covariance, y = np.block(parts), np.concatenate([half.motion.ravel() for half in halves])
    dense = -(np.linalg.slogdet(covariance)[1] + y @ np.linalg.solve(covariance, y)) / 2
    nothing = sum(gaussian(half, np.zeros(6), modes) for half in halves)
    normals = [fit.normal_equations(half, 1) for half in halves]
    assert evidence(normals, common, varying=own) == pytest.approx(dense - nothing, abs=1e-9)
    # Without changes the halves add.
    assert evidence(normals, common) == pytest.approx(evidence(fit.normal_equations(FIELD, 1), common), abs=1e-9)


def test_evidence_adds_over_shapes_that_do_not_overlap():
    """A sky on which T and S of degree 1 are orthogonal: their evidences add."""
    modes = Modes(2)
    matrix = np.diag(np.arange(1.0, 17.0))
    normal = fit.NormalEquations(modes, matrix, np.linspace(-9, 9, 16), 100.0, 200, "icrs")
    parts = [evidence(normal, 5 * PER_DEGREE, (l,)) for l in (1, 2)]
    assert evidence(normal, 5 * PER_DEGREE, (1, 2)) == pytest.approx(sum(parts), abs=1e-12)


@pytest.mark.parametrize(
    ("power", "table"), [(10.0, (20.40, 23.60, 28.59, 27.73)), (50.0, (17.39, 15.03, 14.84, 6.71))]
)
def test_vlba_table(power, table):
    field = read_field(real_catalogue("td2017_vlba_proper_motions.ecsv"))
    kept = field[fit.clip(field, 2, 2).kept]
    assert len(kept) == 580
    normal = fit.normal_equations(kept, 4)
    found = [evidence(normal, power * PER_DEGREE, range(1, l + 1)) for l in (1, 2, 3, 4)]
    np.testing.assert_allclose(found, table, atol=0.01)


def test_power_marginalised():
    normal = fit.normal_equations(FIELD, 2)
    mean = quad(lambda t: np.exp(evidence(normal, np.exp(t) * PER_DEGREE)), np.log(1), np.log(1e4))[0] / np.log(1e4)
    assert evidence(normal, PER_DEGREE, amplitudes=(1, 1e4)) == pytest.approx(np.log(mean), abs=0.02)


def test_odds_are_true():
    """Skies drawn from one of two models, and the odds as often right as they say."""
    rng, said, true = np.random.default_rng(1), [], []
    quasars = sim.quasars(300, 1)
    for seed in range(300):
        quadrupole = rng.random() < 0.5
        signal = sim.systematics(Spectrum.given([100.0, 100.0 * quadrupole]), seed, lmax=2)
        normal = fit.normal_equations(sim.observe(quasars, signal, seed + 999, sigma=60.0), 2)
        models = {"two": (normal, 100 * PER_DEGREE, (1, 2)), "one": (normal, 100 * PER_DEGREE, (1,))}
        said.append(compare_models(models).probability[0])
        true.append(quadrupole)
    said, true = np.array(said), np.array(true)
    for low, high in ((0, 0.4), (0.4, 0.6), (0.6, 1)):
        chosen = (said >= low) & (said < high)
        assert abs(true[chosen].mean() - said[chosen].mean()) < 3.5 * np.sqrt(0.25 / chosen.sum())
    assert abs(true.mean() - said.mean()) < 0.08


def test_comparisons():
    found = compare_models({"nothing": 0.0, "a dipole": (fit.normal_equations(FIELD, 1), 10 * PER_DEGREE),
                     "any power": (fit.normal_equations(FIELD, 1), PER_DEGREE, (1,), {"amplitudes": (1, 100)})})  # fmt: skip
    assert found.probability.sum() == pytest.approx(1)
    assert found.best in found.report().splitlines()[2]
    for bad in ({}, {"x": "y"}, {"x": np.nan}, 3):
        with pytest.raises(ParameterError):
            compare_models(bad)


def test_messages():
    normal = fit.normal_equations(FIELD, 2)
    with pytest.raises(ModesError, match="degree 3 is not fitted"):
        evidence(normal, PER_DEGREE, (3,))
    with pytest.raises(ParameterError, match="the lowest and the highest, above zero"):
        evidence(normal, PER_DEGREE, amplitudes=(2, 1))
    with pytest.raises(ParameterError, match="go to different degrees"):
        evidence([normal, fit.normal_equations(FIELD, 1)], PER_DEGREE, (1,))
    with pytest.raises(ParameterError, match="one at least"):
        evidence([], PER_DEGREE)
    with pytest.raises(ParameterError, match="spectrum must be Spectrum, not float"):
        evidence(normal, 10.0)
    with pytest.raises(ParameterError, match="noise_scale must be above zero"):
        evidence(normal, PER_DEGREE, noise_scale=0)
