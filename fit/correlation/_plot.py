"""Figures of correlations, influence and leakage (matplotlib)."""

from importlib.util import find_spec
from typing import Any

import numpy as np
from matplotlib.ticker import MaxNLocator

from vsh.field import Field
from vsh.figures.plot import (
    DIVERGING,
    KIND_COLOURS,
    KIND_NAMES,
    WIDTH,
    SkyAxes,
    apply_style,
    colour_bar,
    draw_map,
    draw_matrix,
    draw_sources,
    legend_above,
    panels,
    sky_axes,
)
from vsh.io.quantities import symbol
from vsh.modes import KINDS
from vsh.sky.frames import title_of
from vsh.sky.pixels import smooth_map
from vsh.tools.types import Axes, AxesArray, FloatArray, OnAxes

#: A map of influence has so many sources within its smoothing.
_SOURCES_PER_BEAM = 30


@apply_style
def plot_matrix(correlations: Any, *, ax: Axes | None = None) -> Axes:
    """The matrix of one catalogue, or of two in its two triangles, with numbers where there is room."""
    (axes,) = panels(ax, size=(WIDTH, 3.8))
    symbols = [symbol(name) for name in correlations.names]
    degree_labels = [name[:1].upper() + name[2:].split(",")[0] for name in correlations.names]
    group_labels = degree_labels if all("(" in name for name in correlations.names) else None
    image = draw_matrix(axes, correlations.combined(), symbols, group_labels)
    if len(correlations.labels) > 1:
        axes.plot([-0.5, len(symbols) - 0.5], [-0.5, len(symbols) - 0.5], color="k", linewidth=0.6)
        axes.set_title(f"above the diagonal: {correlations.labels[0]}\nbelow: {correlations.labels[1]}")
    else:
        axes.set_title(correlations.labels[0])
    colour_bar(axes, image, f"correlation ({title_of(correlations.frame)} axes)")
    return axes


@apply_style
def plot_influence(
    values: FloatArray,
    field: Field,
    title: str,
    label: str,
    *,
    max_sources: int = 3000,
    smooth: float | None = None,
    ax: Axes | None = None,
) -> SkyAxes:
    """A map of influence on the sky with the sources, as smooth as they can tell; not smoothed without healpy."""
    if smooth is None:
        smooth = float(np.clip(2 * np.degrees(np.sqrt(4 * _SOURCES_PER_BEAM / max(1, len(field)))), 0.0, 60.0))
    smooth = smooth if find_spec("healpy") else 0.0  # there is none for Windows
    sky_map = smooth_map(values, smooth) if smooth > 0 else np.asarray(values, float)
    axes = sky_axes(field.frame, ax, below=0.6 + 0.14 * title.count("\n"))
    colour_limit = float(np.percentile(np.abs(sky_map[sky_map != 0]), 99)) if np.any(sky_map) else 1.0
    exponent = int(np.floor(np.log10(colour_limit))) if colour_limit < 0.01 else 0
    colour_limit, sky_map = colour_limit / 10.0**exponent, sky_map / 10.0**exponent
    image = draw_map(axes, sky_map, cmap=DIVERGING, vmin=-colour_limit, vmax=colour_limit)
    draw_sources(axes, field.lon, field.lat, max_sources=max_sources, color="0.15", alpha=0.4)
    label += f",\nsmoothed over {smooth:.0f}°" if smooth > 0 else ""
    colour_bar(axes, image, f"{label}  [$10^{{{exponent}}}$]" if exponent else label, extend="both")
    axes.set_title(title)
    return axes


@apply_style
def plot_leakage(leakage: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """Plot the bias of spin and acceleration by each unmodelled degree: their rms bias by a power of 1 (µas/yr)² in
    it."""
    axes_array = panels(ax, 2, 1, size=(WIDTH, 3.6), sharex=True)
    degrees = np.arange(leakage.fitted.lmax + 1, leakage.unmodelled.lmax + 1)
    for axes, vector, name in zip(axes_array, ("omega", "a"), ("spin", "acceleration"), strict=True):
        for row, kind in enumerate(KINDS):
            rms = []
            for i in range(len(degrees)):
                power = np.zeros((2, len(degrees)))
                power[row, i] = 1.0
                biases = leakage.bias_of([f"{vector}_{axis}" for axis in "xyz"], power)
                rms.append(np.sqrt(sum(value**2 for value in biases.values())))
            axes.plot(degrees, rms, "os"[row] + "-", color=KIND_COLOURS[kind], label=f"from {KIND_NAMES[kind]} degrees")
        axes.set(ylabel=f"rms bias of {name}\n[µas/yr]", ylim=(0, None))
    legend_above(axes_array[0], 1)
    axes_array[1].set_xlabel("degree $\\ell$ that is left out, of power 1 (µas/yr)²")
    axes_array[1].xaxis.set_major_locator(MaxNLocator(integer=True))
    return axes_array
