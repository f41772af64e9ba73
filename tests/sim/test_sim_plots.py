"""Figures of simulated catalogues: what is drawn is what was given."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

import sim
from sim import plot


def test_every_figure_shows_its_numbers():
    quasars = sim.quasars(2000, 1)
    sky = plot.plot_density(quasars, 4, "quasars")
    assert sky is not None
    assert plot.plot_transits(quasars, np.full(2000, 70.0), 4) is not None
    one = plot.plot_histograms(quasars)
    assert one is not None
    axes = plot.plot_tracks(np.linspace(0, 5, 40), sim.Variability(100.0, 2.0), rng=1, n_tracks=2)
    assert len(axes.get_lines()) >= 2
    assert plot.plot_distance_and_parallax() is not None
    assert plt.get_fignums()
    plt.close("all")


@pytest.mark.slow
def test_galaxies_that_cluster_do_cluster():
    galaxies, _ = sim.clustered_galaxies(3000, 1)
    assert len(galaxies) == 3000
    counts = np.histogram2d(galaxies.lon, np.sin(galaxies.lat), (8, 4))[0]
    # Poisson counts would have a variance of their mean.
    assert counts.var() > 1.5 * counts.mean()
