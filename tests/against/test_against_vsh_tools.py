"""vsh-tools 1.0.0: coefficients, covariance and χ² of the same catalogue."""

import numpy as np
import pytest
import vsh_tools
from conftest import random_field

import fit
from vsh import Modes, ScalarField, ScalarModes
from vsh.models.covariance import VASILIEV_BAUMGARDT_2021, from_function, of_errors


@pytest.mark.parametrize("lmax", range(1, 7))
def test_fit(lmax):
    field = random_field(2000, seed=lmax, rho=0.95)
    theirs = vsh_tools.fit_vsh(
        field.lon,
        field.lat,
        *field.motion,
        lmax,
        sigma_ra=field.sigma[0],
        sigma_dec=field.sigma[1],
        rho=field.rho,
        method="chunked",
    )
    ours = fit.fit_field(field, lmax)
    order = [theirs.coefficient_names.index(their_name(mode)) for mode in Modes(lmax)]
    sigma = np.sqrt(np.diag(theirs.covariance))[order]
    np.testing.assert_allclose(ours.coefficients.values / sigma, theirs.coefficients[order] / sigma, atol=1e-9)
    np.testing.assert_allclose(ours.sigma, sigma, rtol=1e-9)
    correlation = theirs.covariance[np.ix_(order, order)] / np.outer(sigma, sigma)
    np.testing.assert_allclose(ours.correlation, correlation, atol=1e-9)
    assert ours.chi2 == pytest.approx(theirs.chi2, rel=1e-9)


def their_name(mode):
    part = {"re": "r", "im": "i"}[mode.part] if mode.m else ""
    return f"{mode.kind.lower()}{mode.l}{mode.m}{part}"


@pytest.mark.parametrize("lmax", [1, 3, 5])
def test_dense_covariance(lmax):
    field = random_field(300, seed=lmax)
    covariance = (of_errors(field) + from_function(field, VASILIEV_BAUMGARDT_2021)).matrix
    theirs = vsh_tools.fit_vsh(field.lon, field.lat, *field.motion, lmax, covariance=covariance)
    ours = fit.fit_field(field, lmax, covariance=covariance)
    order = [theirs.coefficient_names.index(their_name(mode)) for mode in Modes(lmax)]
    sigma = np.sqrt(np.diag(theirs.covariance))[order]
    np.testing.assert_allclose(ours.coefficients.values / sigma, theirs.coefficients[order] / sigma, atol=1e-10)
    np.testing.assert_allclose(
        ours.covariance / np.outer(sigma, sigma),
        theirs.covariance[np.ix_(order, order)] / np.outer(sigma, sigma),
        atol=1e-10,
    )
    assert ours.chi2 == pytest.approx(theirs.chi2, rel=1e-10)


@pytest.mark.parametrize("lmax", range(7))
def test_scalars(lmax):
    rng = np.random.default_rng(lmax)
    lon, lat = rng.uniform(0, 2 * np.pi, 2000), np.arcsin(rng.uniform(-0.6, 1, 2000))
    sigma = 10 ** rng.uniform(0, 2, 2000)
    values = sigma * rng.normal(size=2000)
    theirs = vsh_tools.fit_ssh(lon, lat, values, lmax, sigma=sigma, method="chunked")
    ours = fit.fit_field(ScalarField(lon, lat, values, sigma), lmax)
    order = [theirs.coefficient_names.index("y" + their_name(mode)[1:]) for mode in ScalarModes(lmax)]
    errors = np.sqrt(np.diag(theirs.covariance))[order]
    np.testing.assert_allclose(ours.values / errors, theirs.coefficients[order] / errors, atol=1e-10)
    np.testing.assert_allclose(ours.sigma, errors, rtol=1e-10)
    assert ours.chi2 == pytest.approx(theirs.chi2, rel=1e-10)
