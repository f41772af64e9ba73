"""Names and arguments that do not exist: the message says what they may be."""

import copy
import pickle

import numpy as np
import pytest
from conftest import random_field

import fit
import sim
import vsh


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda field, _: field.redshfit, "did you mean redshift"),
        (lambda field, _: field.sort, "did you mean to_table(), whose rows"),
        (lambda _, solution: solution.log_likelihood, "did you mean chi2, −2 ln L"),
        (lambda _, solution: solution.to_arviz, "did you mean sample(n), whose draws"),
        (lambda *_: vsh.vsh, "did you mean vsh.basis.harmonics(lon, lat, modes)?"),
        (lambda *_: fit.fit_feild, "did you mean fit_field"),
        (lambda *_: vsh.read_feild, "read_field"),
    ],
)
def test_attributes(ask, words):
    field = random_field(50, 1)
    with pytest.raises(AttributeError) as error:
        ask(field, fit.fit_field(field, 1))
    assert words in str(error.value)


def test_other_names_of_ours_are_ours():
    """A name by which another package has the same, and of what needs no choice."""
    field = random_field(200, 1)
    solution = fit.fit_field(field, 2)
    np.testing.assert_array_equal(field.galactic.lon, field.to_frame("galactic").lon)
    np.testing.assert_array_equal(solution.spin.galactic.value, solution.spin.to_frame("galactic").value)
    assert field.skycoord.frame.name == "icrs"
    np.testing.assert_array_equal(solution.cl(), [solution.power("T"), solution.power("S")])
    np.testing.assert_array_equal(solution.get_power(l=2), [solution.power("T", 2), solution.power("S", 2)])
    assert vsh.harmonics is vsh.basis.harmonics
    assert vsh.figures.plot_sky is vsh.figures.plot.plot_field


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: sim.quasars(10, seed=1), "did you mean rng?"),
        (lambda: fit.resample.bootstrap(random_field(50, 1), 1, n=10), "did you mean n_replicates?"),
        (lambda: fit.recommended(random_field(50, 1), degree=1), "unexpected keyword argument 'degree'"),
    ],
)
def test_arguments(call, words):
    with pytest.raises(TypeError) as error:
        call()
    assert words in str(error.value)


def test_objects_are_still_copied_and_pickled():
    """Python asks for names with underscores that may be missing."""
    field = random_field(50, 1)
    for thing in (field, fit.fit_field(field, 1)):
        assert len(repr(copy.copy(thing))) == len(repr(pickle.loads(pickle.dumps(thing)))) == len(repr(thing))
    assert not hasattr(field, "nothing_like_it")
