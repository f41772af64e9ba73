"""Simulated sources: magnitudes where redshifts are known."""

import numpy as np
import pytest
from scipy.stats import kstest

import sim
from sim.population import magnitudes_at


def test_magnitudes_at_redshifts_are_those_of_galaxies():
    """Drawn where redshifts are known they are as where both are drawn: as bright, and fainter with distance."""
    whole = sim.galaxies(20_000, 1)
    again = magnitudes_at(whole.redshift, 2)
    assert kstest(again, whole.magnitude).pvalue > 0.01
    for low, high in ((0.001, 0.01), (0.01, 0.02), (0.02, 0.03)):
        near = (whole.redshift > low) & (whole.redshift < high)
        assert again[near].mean() == pytest.approx(whole.magnitude[near].mean(), abs=0.1)
    assert again.max() < 20
    assert np.isfinite(magnitudes_at(np.array([2e-4, 0.5, 2.0]), 1)).all()
