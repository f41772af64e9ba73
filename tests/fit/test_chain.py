"""What a chain tells of its own convergence."""

import numpy as np
import pytest

from fit.sampling import split_r_hat


def test_r_hat_is_one_where_all_walkers_tell_the_same():
    chain = np.random.default_rng(1).normal(size=(1000, 20, 3))
    np.testing.assert_allclose(split_r_hat(chain), 1, atol=0.002)


def test_r_hat_of_walkers_that_stay_apart():
    """Means that scatter by τ about noise of σ: R̂² = 1 + τ²/σ² (Gelman et al. 2013, eqs. 11.1 to 11.4)."""
    rng = np.random.default_rng(2)
    chain = rng.normal(size=(4000, 300, 1)) + 0.5 * rng.normal(size=(1, 300, 1))
    assert split_r_hat(chain)[0] == pytest.approx(np.sqrt(1 + 0.5**2), rel=0.03)


def test_r_hat_sees_a_drift_that_all_walkers_share():
    chain = np.random.default_rng(3).normal(size=(1000, 20, 1)) + np.linspace(0, 3, 1000)[:, None, None]
    assert split_r_hat(chain)[0] == pytest.approx(1.22, abs=0.03)  # √(1 + 0.75²/1.19)
    assert np.isnan(split_r_hat(np.ones((10, 4, 1)))[0])
