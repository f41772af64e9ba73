"""Names and arguments that do not exist: the message says what they may be."""

import copy
import pickle

import pytest
from conftest import random_field

import fit
import sim
import vsh


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda field, _: field.redshfit, "did you mean redshift"),
        (lambda field, _: field.galactic, 'did you mean to_frame("galactic")?'),
        (lambda _, solution: solution.aic, "did you mean bic, which"),
        (lambda *_: vsh.harmonics, "did you mean vsh.basis.harmonics?"),
        (lambda *_: fit.fit_feild, "did you mean fit_field"),
        (lambda *_: vsh.read_feild, "read_field"),
    ],
)
def test_attributes(ask, words):
    field = random_field(50, 1)
    with pytest.raises(AttributeError) as error:
        ask(field, fit.fit_field(field, 1))
    assert words in str(error.value)


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
