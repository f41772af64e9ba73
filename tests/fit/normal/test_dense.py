"""Fits with a dense covariance, by every verb that takes one."""

import numpy as np
import pytest
from conftest import random_field

import fit
import vsh.models.covariance as shared
from vsh import Modes
from vsh.models.covariance import LINDEGREN_2021, Spectrum
from vsh.tools.errors import CovarianceError, ParameterError

FIELD = random_field(200, seed=1)
OWN = shared.of_errors(FIELD)
BOTH = OWN + shared.from_function(FIELD, LINDEGREN_2021)


def test_independent_errors_are_the_ordinary_fit():
    ordinary = fit.normal_equations(FIELD, 3)
    for given in (OWN, OWN.matrix):
        dense = fit.normal_equations(FIELD, 3, covariance=given)
        np.testing.assert_allclose(dense.matrix, ordinary.matrix, rtol=0, atol=1e-12 * np.abs(ordinary.matrix).max())
        np.testing.assert_allclose(dense.rhs, ordinary.rhs, rtol=0, atol=1e-12 * np.abs(ordinary.rhs).max())
        assert dense.chi2_null == pytest.approx(ordinary.chi2_null, rel=1e-12)
        assert (dense.n_data, dense.frame) == (400, "icrs")


def test_process_cut_at_a_degree_is_a_prior():
    """A dense field of degrees 2 … 4 gives degree 1 what a prior on those degrees gives it."""
    field, spectrum = random_field(300, seed=2), 40 * Spectrum.given([0.0, 3, 2, 1])
    covariance = shared.of_errors(field) + shared.from_spectrum(field, spectrum, 4)
    dense = fit.fit_field(field, 1, covariance=covariance)
    sigma = np.sqrt(spectrum.variances(4))
    prior = fit.gaussian_prior(4, np.where(sigma > 0, sigma, np.inf))
    modes = Modes(4)
    whole = fit.solve(fit.normal_equations(field, modes), prior)
    first = np.flatnonzero(modes.degrees == 1)
    np.testing.assert_allclose(whole.values[first], dense.values, atol=1e-8)
    np.testing.assert_allclose(whole.covariance[np.ix_(first, first)], dense.covariance, rtol=1e-8, atol=1e-10)


def test_both_solvers_agree_with_a_dense_covariance():
    assert fit.cross_check(FIELD, covariance=BOTH).largest < 1e-9


def test_messages():
    with pytest.raises(ParameterError, match="of 200 sources, the field of 100"):
        fit.normal_equations(FIELD[:100], 1, covariance=BOTH)
    with pytest.raises(ParameterError, match="of the sources of one Field, not of list"):
        fit.normal_equations([FIELD], 1, covariance=BOTH)
    with pytest.raises(CovarianceError, match="not positive definite"):
        fit.fit_field(FIELD, 1, covariance=np.ones((400, 400)))
    with pytest.raises(ParameterError, match="not symmetric"):
        fit.fit_field(FIELD, 1, covariance=np.triu(np.ones((400, 400))))
