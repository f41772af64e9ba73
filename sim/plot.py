"""Figures of a simulated sky (matplotlib)."""

import numpy as np

from sim.population import Population
from sim.variability import Variability, markov_chain
from vsh.figures.plot import COLOURS, WIDTH, SkyAxes, apply_style, draw_line, panels, plot_map
from vsh.models.cosmology import FLAT_PLANCK13, transverse_distance
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import mean_map, pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools.arguments import generator
from vsh.tools.types import Axes, AxesArray, Cosmology, FloatArray, OnAxes, Rng
from vsh.tools.units import AU_PER_YEAR

__all__ = ["plot_density", "plot_distance_and_parallax", "plot_histograms", "plot_tracks", "plot_transits"]


@apply_style
def plot_density(
    population: Population, nside: int = 16, title: str | None = None, *, ax: Axes | None = None
) -> SkyAxes:
    """Sources per square degree over the sky, with the ecliptic.

    Parameters
    ----------
    population : Population
        The sources.
    nside : int
        Resolution of the HEALPix pixels.
    title : str, optional
        Title of the figure.
    ax : matplotlib axes, optional
        Axes whose place the map takes; a new figure unless given.
    """
    pixel = pixels_of(population.lon, population.lat, nside)
    density = np.bincount(pixel, minlength=12 * nside**2) / (41252.96 / (12 * nside**2))
    axes = plot_map(
        density,
        "sources per square degree",
        frame=population.frame,
        title=title or f"{len(population)} sources",
        ax=ax,
        vmin=0,
        vmax=np.percentile(density, 99),
        extend="max",
    )
    ecliptic = triad(np.linspace(0, 2 * np.pi, 721), np.zeros(721))[2]
    draw_line(axes, *angles(rotation_matrix("ecliptic", population.frame) @ ecliptic), color="cyan", label="ecliptic")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.0), borderaxespad=0)
    return axes


def plot_transits(population: Population, counts: FloatArray, nside: int = 16, *, ax: Axes | None = None) -> SkyAxes:
    """Transits per source over the sky.

    Parameters
    ----------
    population : Population
        The sources.
    counts : (n,) array
        Counts from `Transits.counts`.
    nside : int
        Resolution of the HEALPix pixels.
    ax : matplotlib axes, optional
        Axes whose place the map takes; a new figure unless given.
    """
    values = mean_map(population.lon, population.lat, counts, nside)
    return plot_map(
        values, "transits per source", frame=population.frame, cmap="magma", title="transits by the scanning law", ax=ax
    )


@apply_style
def plot_histograms(population: Population, *, ax: OnAxes | None = None) -> AxesArray:
    """Magnitudes and redshifts.

    Parameters
    ----------
    population : Population
        The sources.
    ax : matplotlib axes, one for each quantity there is, optional
        Where to draw; a new figure unless given.
    """
    columns = {"G": population.magnitude, "redshift": population.redshift}
    columns = {name: values for name, values in columns.items() if values is not None}
    subplots = panels(ax, 1, len(columns), size=(WIDTH, 1.9))
    for axes, (name, values) in zip(subplots, columns.items(), strict=True):
        axes.hist(values, bins=60, color=COLOURS[0])
        axes.set(xlabel=name, ylabel="sources")
    return subplots


@apply_style
def plot_tracks(
    times: FloatArray, variability: Variability, rng: Rng, n_tracks: int = 3, *, ax: Axes | None = None
) -> Axes:
    """Variable photocentres: tracks on the sky of a few draws.

    Parameters
    ----------
    times : (k,) array
        Rising [yr]
    variability : Variability
        Variability of the photocentres.
    rng : Generator or int
        The source of all randomness.
    n_tracks : int
        How many.
    ax : matplotlib axes, optional
        Where to draw; a new figure unless given.
    """
    rng = generator(rng)
    (axes,) = panels(ax, size=(WIDTH, 3.2))
    for track in range(n_tracks):
        x, y = (markov_chain(times, variability.sigma, variability.tau, rng) for _ in range(2))
        axes.plot(x, y, ".-", linewidth=0.5, markersize=2, color=COLOURS[track % len(COLOURS)])
    axes.set_aspect("equal", adjustable="datalim")
    axes.invert_xaxis()  # east to the left
    axes.set(xlabel="Δα* [µas]", ylabel="Δδ [µas]", title=f"σ = {variability.sigma:g} µas, τ = {variability.tau:g} yr")
    return axes


@apply_style
def plot_distance_and_parallax(
    speed: float = 369.0, cosmology: Cosmology = FLAT_PLANCK13, *, ax: OnAxes | None = None
) -> AxesArray:
    """Comoving distance and the secular parallax by our velocity, against redshift.

    Parameters
    ----------
    speed : float
        Ours. [km/s]
    cosmology : astropy cosmology, optional
        The shape of the distance: flat, Ω_m = 0.315 unless given.
    ax : two matplotlib axes, optional
        Where to draw; a new figure unless given.
    """
    z = np.geomspace(1e-3, 6, 400)
    distance = transverse_distance(z, cosmology)
    upper, lower = subplots = panels(ax, 2, 1, size=(WIDTH, 3.8), sharex=True)
    upper.loglog(z, distance, color=COLOURS[0])
    upper.set_ylabel("transverse comoving\ndistance [Mpc]")
    lower.loglog(z, speed / (AU_PER_YEAR * distance), color=COLOURS[1])
    lower.set(xlabel="redshift", ylabel=f"secular parallax at 90°\nfrom {speed:g} km/s [µas/yr]")
    return subplots
