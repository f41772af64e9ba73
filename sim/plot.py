"""Figures of a simulated sky (matplotlib)."""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np

from sim.population import Population
from sim.variability import Variability, markov_chain
from vsh.checks.arguments import generator
from vsh.cosmology import PLANCK_2013, transverse_distance
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import mean_map, pixels_of
from vsh.sky.plot import draw_map, on_map, sky_axes
from vsh.sky.sphere import angles, triad
from vsh.types import Cosmology, Figure, FloatArray, Rng
from vsh.units import AU_PER_YEAR

__all__ = [
    "plot_density",
    "plot_distance_and_parallax",
    "plot_histograms",
    "plot_tracks",
    "plot_transits",
]


def plot_density(population: Population, nside: int = 16, title: str | None = None) -> Figure:
    """Sources per square degree over the sky, with the ecliptic. Returns the figure.

    Parameters
    ----------
    population : Population
        The sources.
    nside : int
        Of the HEALPix pixels.
    title : str, optional
        Of the figure.

    Returns
    -------
    Figure
    """
    pixel = pixels_of(population.lon, population.lat, nside)
    density = np.bincount(pixel, minlength=12 * nside**2) / (41252.96 / (12 * nside**2))
    axes = sky_axes(population.frame)
    image = draw_map(axes, density, vmin=0, vmax=np.percentile(density, 99))
    _bar(axes, image, "sources per square degree")
    lon, lat = angles(
        rotation_matrix("ecliptic", population.frame) @ triad(np.linspace(0, 2 * np.pi, 721), np.zeros(721))[2]
    )
    order = np.argsort(on_map(lon))
    axes.plot(on_map(lon)[order], lat[order], color="cyan", linewidth=1.5, label="ecliptic")
    axes.legend(loc="lower left", frameon=False, fontsize=11)
    axes.set_title(title or f"{len(population)} sources", pad=16)
    return axes.figure


def plot_transits(population: Population, counts: FloatArray, nside: int = 16) -> Figure:
    """Transits per source over the sky. Returns the figure.

    Parameters
    ----------
    counts : (n,) array
        Of `Transits.counts`.
    population : Population
        The sources.
    nside : int
        Of the HEALPix pixels.

    Returns
    -------
    Figure
    """
    axes = sky_axes(population.frame)
    image = draw_map(axes, mean_map(population.lon, population.lat, counts, nside), cmap="magma")
    _bar(axes, image, "transits per source")
    axes.set_title("transits by the scanning law", pad=16)
    return axes.figure


def plot_histograms(population: Population) -> Figure:
    """Magnitudes and redshifts. Returns the figure.

    Parameters
    ----------
    population : Population
        The sources.

    Returns
    -------
    Figure
    """
    columns = {"G": population.magnitude, "redshift": population.redshift}
    columns = {name: values for name, values in columns.items() if values is not None}
    figure, axes = plt.subplots(1, len(columns), figsize=(5 * len(columns), 4), layout="constrained", squeeze=False)
    for ax, (name, values) in zip(axes[0], columns.items(), strict=True):
        ax.hist(values, bins=60, color="#0b5394")
        _finish(ax, name, "sources")
    return figure


def plot_tracks(times: FloatArray, variability: Variability, rng: Rng, n_tracks: int = 3) -> Figure:
    """Variable photocentres: tracks on the sky of a few draws. Returns the figure.

    Parameters
    ----------
    times : (k,) array
        Rising [yr]
    variability : Variability
        Of the photocentres.
    rng : Generator or int
        The source of all randomness.
    n_tracks : int
        How many.

    Returns
    -------
    Figure
    """
    rng = generator(rng)
    figure, ax = plt.subplots(figsize=(5.5, 5.5), layout="constrained")
    for _ in range(n_tracks):
        x, y = (markov_chain(times, variability.sigma, variability.tau, rng) for _ in range(2))
        ax.plot(x, y, ".-", linewidth=0.8, markersize=4)
    ax.set_aspect("equal", adjustable="datalim")
    ax.invert_xaxis()  # east to the left
    _finish(ax, "Δα* [µas]", "Δδ [µas]")
    ax.set_title(f"σ = {variability.sigma:g} µas, τ = {variability.tau:g} yr", fontsize=12)
    return figure


def plot_distance_and_parallax(speed: float = 369.0, cosmology: Cosmology = PLANCK_2013) -> Figure:
    """Comoving distance and the secular parallax by our velocity, against redshift. Returns the figure.

    Parameters
    ----------
    speed : float
        Ours. [km/s]
    cosmology : astropy cosmology, optional
        The shape of the distance: flat, Ω_m = 0.315 unless given.

    Returns
    -------
    Figure
    """
    z = np.geomspace(1e-3, 6, 400)
    distance = transverse_distance(z, cosmology)
    figure, (left, right) = plt.subplots(1, 2, figsize=(10, 4), layout="constrained")
    left.loglog(z, distance, color="#0b5394")
    _finish(left, "redshift", "transverse comoving distance [Mpc]")
    right.loglog(z, speed / (AU_PER_YEAR * distance), color="#c55a11")
    _finish(right, "redshift", f"secular parallax at 90° from {speed:g} km/s [µas/yr]")
    return figure


def _bar(axes, image, words):
    axes.figure.colorbar(image, ax=axes, orientation="horizontal", shrink=0.6, pad=0.06).set_label(words, fontsize=12)


def _finish(ax, x, y):
    ax.set_xlabel(x, fontsize=13)
    ax.set_ylabel(y, fontsize=13)
    ax.tick_params(labelsize=11)
    ax.spines[["top", "right"]].set_visible(False)
