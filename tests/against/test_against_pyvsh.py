"""pyVSH (TU Dresden): spin, glide, their errors and χ² of the same catalogue."""

import numpy as np
import pytest
from conftest import random_field

import fit

fit_vsh = pytest.importorskip("pyVSH.fitVSH", reason="pyVSH is not installed: pip install a checkout of it").fitVSH


@pytest.mark.parametrize("lmax", [1, 3, 5])
def test_fit(lmax):
    field = random_field(1500, seed=lmax, rho=0.0)  # its table has no correlations
    columns = [field.lon, field.lat, field.motion[0], field.sigma[0], field.motion[1], field.sigma[1]]
    theirs, ours = fit_vsh(np.array(columns).T, lmax=lmax), fit.fit_field(field, lmax)
    for name, vector in (("rot", ours.spin), ("glide", ours.acceleration)):
        np.testing.assert_allclose(theirs[name][:3, 0], vector.value, rtol=1e-9, atol=1e-9 * vector.sigma.max())
        np.testing.assert_allclose(theirs[name][:3, 1] / theirs["uwe"], vector.sigma, rtol=1e-9)
    assert theirs["uwe"] ** 2 == pytest.approx(ours.reduced_chi2, rel=1e-9)
