"""Classes of a part of the sky: what higher degrees leak into theirs is allowed for."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many

import fit
import sim
from fit.background import Template, extend_degrees, has_leakage, shared
from fit.background._shared import marginalise_higher_degrees
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


def test_marginalising_is_a_fit_with_a_prior():
    normal = whole_and_caps(1, 7)[1]
    variances = Spectrum.flat().variances(normal.modes) * 30
    at = normal.modes.degrees <= 5
    found = marginalise_higher_degrees(normal, Modes(5), variances, 1.3)
    whole = fit.solve(normal + gaussian_prior(normal.modes, np.where(at, np.inf, np.sqrt(variances) / 1.3)))
    one = fit.solve(found)
    np.testing.assert_allclose(one.values, whole.values[at], rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(one.covariance, whole.covariance[np.ix_(at, at)], rtol=1e-7, atol=1e-8)
    assert found.n_data == normal.n_data


@pytest.mark.slow
@few_or_many(9, 40, "skies")
def test_differences_of_caps_are_within_their_errors(skies):
    """By degrees to 5 alone differences are larger than their errors, with three more they are not."""
    pulls = {5: [], 8: []}
    for seed in range(skies):
        wide = whole_and_caps(seed, 8)
        at = np.flatnonzero(wide[0].modes.degrees <= 5)
        narrow = [_cut(each, at) for each in wide]
        for lmax, normals in ((5, narrow), (8, wide)):
            away = shared(normals, range(2, 6), shapes=("flat", "gaia"), draws=50, rng=seed).difference(0, 1)
            pulls[lmax].append(away.values / away.sigma)
    rms = {lmax: np.sqrt(np.mean(np.square(each))) for lmax, each in pulls.items()}
    assert 0.6 < rms[8] < 1.2
    assert rms[5] > 1.3 * rms[8]


def test_part_of_the_sky_is_told():
    normals = whole_and_caps(1, 8)
    assert [has_leakage(each, 5) for each in normals] == [False, True]
    at = np.flatnonzero(normals[0].modes.degrees <= 5)
    low = [_cut(each, at) for each in normals]
    for given in (low, [normals[0], low[1]]):  # degrees of the other class do not help this one
        (note,) = _leaks(shared(given, range(2, 6), labels=["all", "caps"], draws=50))
        assert note.startswith("caps: a part of the sky, or few sources, into whose degrees higher ones leak; give")
        assert "to degree 8 and degrees=range(2, 6)" in note
    assert not _leaks(shared(normals, range(2, 6), draws=50))
    assert not _leaks(shared(low[1], draws=50))  # with nothing to be compared with, its own floor holds


def test_spectrum_that_ends_leaks_nothing():
    ends = Spectrum("to degree 5", lambda lmax: np.where(np.arange(1, lmax + 1) < 6, 1.0, 0.0) * np.ones((2, 1)))
    normals = whole_and_caps(1, 7)
    assert np.isfinite(shared(normals, range(2, 6), shapes=[ends], draws=50).covariance).all()
    narrow = _cut(normals[1], np.flatnonzero(normals[1].modes.degrees <= 5))
    found = marginalise_higher_degrees(normals[1], Modes(5), ends.variances(normals[1].modes), 1.0)
    np.testing.assert_allclose(found.matrix, narrow.matrix)
    np.testing.assert_allclose(found.rhs, narrow.rhs)


def test_equations_are_wide_where_a_class_sees_a_part():
    quasars = sim.quasars(3000, 1, "uniform")
    field = sim.observe(quasars, sim.spin((0, 0, 0)), 2, sigma=100.0)
    north = field.lat > 0
    for classes, lmax in (([field[::2], field[1::2]], 4), ([field[north], field[~north]], 7)):
        normals = [fit.normal_equations(each, 4) for each in classes]
        assert {each.modes.lmax for each in extend_degrees(normals, fit.normal_equations, classes)} == {lmax}


def test_templates_keep_their_units():
    """An amplitude is the rms of the degrees that are looked at, however many the equations hold."""
    quasars = sim.quasars(3000, 1, "uniform")
    rough = np.random.default_rng(1).normal(size=12 * 8**2)
    maps = [Template("rough", rough)]
    field = sim.observe(quasars, sim.spin((0, 0, 0)), 2, sigma=100.0)
    parts = [field[::2], field[1::2]]
    for lmax in (4, 7):
        found = shared([fit.normal_equations(each, lmax, templates=maps) for each in parts], range(2, 5), draws=100)
        if lmax == 4:
            sigma = found.amplitude_covariance[0, 0] ** 0.5
    assert found.amplitude_covariance[0, 0] ** 0.5 == pytest.approx(sigma, rel=0.1)


def _cut(normal, at):
    return replace(normal, modes=Modes(5), matrix=normal.matrix[np.ix_(at, at)], rhs=normal.rhs[at])


def _leaks(found):
    return [note for note in found.notes if "leak" in note]
