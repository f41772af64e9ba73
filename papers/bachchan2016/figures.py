"""The paper's four figures, drawn from the study's own populations (matplotlib)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np

import sim
from sim.variability import markov_chain
from vsh.figures.plot import COLOURS, WIDTH, apply_style, draw_line, panels, plot_map, save_figures
from vsh.models.cosmology import transverse_distance
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import pixels_of
from vsh.sky.sphere import angles, triad
from vsh.tools.units import AU_PER_YEAR


def write_figures(study: Mapping[str, Any], folder: Path) -> list[Path]:
    """Figures 1 to 4 as PNG and PDF; returns their paths."""
    matplotlib.use("agg")
    figures = {
        "figure1_distance": _distance,
        "figure2_variability": lambda: _tracks(study),
        "figure3_galaxies": lambda: _galaxies(study),
        "figure4a_gums": lambda: _sky("gums"),
        "figure4b_igql": lambda: _sky("igql"),
    }
    return save_figures({name: draw() for name, draw in figures.items()}, folder, format=("png", "pdf"), overwrite=True)


@apply_style
def _tracks(study):
    """Fig. 2: variable photocentres with correlation times of 2 and 10 years, three draws of each."""
    years = study["mission"]["years"]
    rng = np.random.default_rng(study["study"]["seed"])
    quasar = sim.quasars(1, 1)
    law = sim.NominalScanningLaw(years=years, dead_time=study["mission"]["dead_time"], rng=1)
    times = np.sort(law.transits(quasar.lon, quasar.lat).time)
    drawn = panels(None, 1, 2, size=(WIDTH, 2.2), sharex=True, sharey=True)
    for axes, tau in zip(drawn, (2.0, 10.0), strict=True):
        for colour in COLOURS[:3]:
            east, north = (markov_chain(times, 100.0, tau, rng) for _ in range(2))
            axes.plot(east, north, ".-", color=colour, linewidth=0.5, markersize=2)
        axes.set(title=f"σ = 100 µas, τ = {tau:g} yr", aspect="equal", xlabel="Δα* [µas]", ylabel="Δδ [µas]")
    drawn[0].invert_xaxis()  # east to the left
    return drawn


@apply_style
def _galaxies(study):
    """Fig. 3: weight and number of galaxies by magnitude; redshifts and the secular parallax."""
    case = next(case["galaxies"] for case in study["case"])
    galaxies = sim.galaxies(
        case["number"],
        study["study"]["seed"],
        case["sky"],
        min_redshift=case["min_redshift"],
        max_redshift=case["max_redshift"],
    )
    law = sim.NominalScanningLaw(years=study["mission"]["years"], dead_time=study["mission"]["dead_time"], rng=1)
    some = slice(0, min(5000, len(galaxies)))
    error = sim.Mission(law, study["mission"]["release"]).transit_error(galaxies.magnitude, case["excess_noise"])
    counts = law.transits(galaxies.lon[some], galaxies.lat[some]).counts(some.stop)
    weight, redshift, number, parallax = drawn = panels(None, 2, 2, size=(WIDTH, 3.4))
    weight.semilogy(
        galaxies.magnitude[some], counts / error[some] ** 2, ".", color=COLOURS[0], markersize=1, rasterized=True
    )
    weight.set(xlabel="G", ylabel="weight  Σ σ⁻² [µas⁻²]")
    number.hist(galaxies.magnitude, bins=60, color=COLOURS[0])
    number.set(xlabel="G", ylabel="galaxies")
    redshift.hist(galaxies.redshift, bins=60, color=COLOURS[1])
    redshift.set(xlabel="redshift", ylabel="galaxies")
    z = np.linspace(case["min_redshift"], case["max_redshift"], 300)
    parallax.plot(z, study["truth"]["velocity"][0] / (AU_PER_YEAR * transverse_distance(z)), color=COLOURS[1])
    parallax.set(xlabel="redshift", ylabel="proper motion [µas/yr]")
    return drawn


@apply_style
def _distance():
    """Fig. 1: the comoving distance, and the secular parallax by our velocity, against redshift."""
    z = np.geomspace(1e-3, 6, 400)
    distance = transverse_distance(z)
    upper, lower = drawn = panels(None, 2, 1, size=(WIDTH, 3.8), sharex=True)
    upper.loglog(z, distance, color=COLOURS[0])
    upper.set_ylabel("transverse comoving\ndistance [Mpc]")
    lower.loglog(z, 369 / (AU_PER_YEAR * distance), color=COLOURS[1])
    lower.set(xlabel="redshift", ylabel="secular parallax at 90°\nfrom 369 km/s [µas/yr]")
    return drawn


@apply_style
def _sky(name):
    """Fig. 4: sources per square degree, with the ecliptic."""
    population = sim.quasars(500_000, 1, name)
    pixel = pixels_of(population.lon, population.lat, 32)
    density = np.bincount(pixel, minlength=12 * 32**2) / (41252.96 / (12 * 32**2))
    axes = plot_map(
        density, "sources per square degree", frame=population.frame, title=f"{name.upper()}-like quasars",
        vmin=0, vmax=np.percentile(density, 99), extend="max",
    )  # fmt: skip
    ecliptic = triad(np.linspace(0, 2 * np.pi, 721), np.zeros(721))[2]
    draw_line(axes, *angles(rotation_matrix("ecliptic", population.frame) @ ecliptic), color="cyan", label="ecliptic")
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.0), borderaxespad=0)
    return axes
