"""The paper's four figures, drawn from the study's own populations (matplotlib)."""

from __future__ import annotations

from pathlib import Path

import matplotlib
import matplotlib.pyplot as plt
import numpy as np

import sim
from sim.astrometry import transit_error
from sim.plot import plot_density, plot_distance_and_parallax
from sim.variability import markov_chain
from study.config import Study
from vsh.cosmology import transverse_distance
from vsh.system.files import atomic_write
from vsh.units import AU_PER_YEAR


def write_figures(study: Study, folder: Path) -> list[Path]:
    """Figures 1 to 4 as PNG and PDF; returns their paths.

    Parameters
    ----------
    study : Study
        The configuration.
    folder : str or Path
        Where to write.
    """
    matplotlib.use("agg")  # files, no windows
    figures = {
        "figure1_distance": plot_distance_and_parallax,
        "figure2_variability": lambda: _tracks(study),
        "figure3_galaxies": lambda: _galaxies(study),
        "figure4a_gums": lambda: _sky("gums"),
        "figure4b_igql": lambda: _sky("igql"),
    }
    paths = []
    for name, draw in figures.items():
        figure = draw()
        for ending in ("png", "pdf"):
            paths.append(folder / f"{name}.{ending}")
            options = {"metadata": {"CreationDate": None}} if ending == "pdf" else {}
            with atomic_write(paths[-1]) as new:
                figure.savefig(new, format=ending, dpi=150, **options)
        plt.close(figure)
    return paths


def _tracks(study):
    """Fig. 2: variable photocentres with correlation times of 2 and 10 years, three draws of each."""
    years = study.mission["years"]
    rng = np.random.default_rng(study.settings["seed"])
    quasar = sim.quasars(1, 1)
    law = sim.NominalScanningLaw(years=years, dead_time=study.mission["dead_time"], rng=1)
    times = np.sort(law.transits(quasar.lon, quasar.lat).time)
    figure, panels = plt.subplots(1, 2, figsize=(11, 5.5), sharex=True, sharey=True, layout="constrained")
    for axes, tau in zip(panels, (2.0, 10.0), strict=True):
        for colour in ("#0b5394", "#c55a11", "#38761d"):
            east, north = (markov_chain(times, 100.0, tau, rng) for _ in range(2))
            axes.plot(east, north, ".-", color=colour, linewidth=0.8, markersize=4)
        axes.set_title(f"σ = 100 µas, τ = {tau:g} yr", fontsize=14)
        axes.set_aspect("equal")
        _finish(axes, "Δα* [µas]", "Δδ [µas]")
    panels[0].invert_xaxis()  # east to the left
    return figure


def _galaxies(study):
    """Fig. 3: weight and number of galaxies by magnitude; redshifts and the secular parallax."""
    case = next(case["galaxies"] for case in study.cases if "galaxies" in case)
    galaxies = sim.galaxies(
        case["number"],
        study.settings["seed"],
        case["sky"],
        min_redshift=case["min_redshift"],
        max_redshift=case["max_redshift"],
    )
    law = sim.NominalScanningLaw(years=study.mission["years"], dead_time=study.mission["dead_time"], rng=1)
    some = slice(0, min(5000, len(galaxies)))
    error = np.hypot(transit_error(galaxies.magnitude, law, study.mission["release"]), case["excess_noise"])
    counts = law.transits(galaxies.lon[some], galaxies.lat[some]).counts(some.stop)
    figure, panels = plt.subplots(2, 2, figsize=(11, 8), layout="constrained")
    (weight, redshift), (number, parallax) = panels
    weight.semilogy(galaxies.magnitude[some], counts / error[some] ** 2, ".", color="#0b5394", markersize=2)
    _finish(weight, "G", "weight  Σ σ⁻² [µas⁻²]")
    number.hist(galaxies.magnitude, bins=60, color="#0b5394")
    _finish(number, "G", "galaxies")
    redshift.hist(galaxies.redshift, bins=60, color="#c55a11")
    _finish(redshift, "redshift", "galaxies")
    z = np.linspace(case["min_redshift"], case["max_redshift"], 300)
    parallax.plot(z, study.truth["velocity"][0] / (AU_PER_YEAR * transverse_distance(z)), color="#c55a11")
    _finish(parallax, "redshift", "cosmological proper motion [µas/yr]")
    return figure


def _sky(name):
    population = sim.quasars(500_000, 1, name)
    return plot_density(population, nside=32, title=f"{name.upper()}-like quasars")


def _finish(axes, x, y):
    axes.set_xlabel(x, fontsize=13)
    axes.set_ylabel(y, fontsize=13)
    axes.tick_params(labelsize=11)
    axes.spines[["top", "right"]].set_visible(False)
