"""Classes of a part of the sky: what higher degrees leak into theirs is allowed for."""

from dataclasses import replace

import numpy as np

import fit
import sim
from fit.background import sees_part, shared
from fit.background._leakage import marginalised
from fit.normal import gaussian_prior
from vsh import Modes
from vsh.models.covariance import Spectrum


def whole_and_caps(seed, lmax, n=8000, power=300.0):
    """A class of the whole sky, and one beyond latitude 45° that has twice its systematics, of degrees 1 to 9."""
    quasars = sim.quasars(n, 1, "uniform")
    field = sim.observe(quasars, sim.systematics(power * Spectrum.flat(), seed, lmax=9), seed + 1000, sigma=100.0)
    double = sim.observe(quasars, sim.systematics(4 * power * Spectrum.flat(), seed, lmax=9), seed + 2000, sigma=100.0)
    caps = np.abs(field.lat) > np.pi / 4
    return [fit.normal_equations(each, lmax) for each in (field[::2], double[caps][::2])]


def test_what_is_marginalised_is_a_fit_with_a_prior():
    normal = whole_and_caps(1, 7)[1]
    variances = Spectrum.flat().variances(normal.modes) * 30
    at = normal.modes.degrees <= 5
    found = marginalised(normal, Modes(5), variances, 1.3)
    whole = fit.solve(normal + gaussian_prior(normal.modes, np.where(at, np.inf, np.sqrt(variances) / 1.3)))
    one = fit.solve(found)
    np.testing.assert_allclose(one.values, whole.values[at], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(one.covariance, whole.covariance[np.ix_(at, at)], rtol=1e-7, atol=1e-8)
    assert found.n_data == normal.n_data


def test_differences_of_caps_are_within_their_errors():
    """Twelve skies: by degrees to 5 alone differences are larger than their errors, with three more they are not."""
    pulls = {5: [], 8: []}
    for seed in range(12):
        wide = whole_and_caps(seed, 8)
        at = np.flatnonzero(wide[0].modes.degrees <= 5)
        narrow = [_cut(each, at) for each in wide]
        for lmax, normals in ((5, narrow), (8, wide)):
            away = shared(normals, range(2, 6), draws=100, rng=seed).difference(0, 1)
            pulls[lmax].append(away.values / away.sigma)
    rms = {lmax: np.sqrt(np.mean(np.square(each))) for lmax, each in pulls.items()}
    assert 0.6 < rms[8] < 1.2
    assert rms[5] > 1.3 * rms[8]


def test_a_part_of_the_sky_is_told():
    normals = whole_and_caps(1, 8)
    assert [sees_part(each, 5) for each in normals] == [False, True]
    at = np.flatnonzero(normals[0].modes.degrees <= 5)
    (note,) = shared([_cut(each, at) for each in normals], labels=["all", "caps"], draws=50).notes
    assert note.startswith("caps: a part of the sky, into whose degrees higher ones leak; give normal equations to")
    assert "degree 8 and degrees=range(2, 6)" in note
    assert shared(normals, range(2, 6), draws=50).notes == ()


def _cut(normal, at):
    return replace(normal, modes=Modes(5), matrix=normal.matrix[np.ix_(at, at)], rhs=normal.rhs[at])
