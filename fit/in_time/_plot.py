"""Figures of what changes with time (matplotlib)."""

import io
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from PIL import Image

from vsh.figures.plot import (
    COLOURS,
    STYLE,
    WIDTH,
    apply_style,
    arrow_grid,
    draw_vectors,
    legend_above,
    panels,
    sky_axes,
)
from vsh.tools.files import MARK
from vsh.tools.types import Axes, AxesArray, OnAxes


@apply_style
def plot_in_time(solution: Any, *, ax: OnAxes | None = None) -> AxesArray:
    """√power of every function, a line a degree, beside what noise gives; T above, S below."""
    subplots = panels(ax, 2, 1, size=(WIDTH, 4.6), sharex=True)
    names = solution.functions.names
    x = np.arange(len(names))
    for axes, kind, label in zip(subplots, "TS", ("toroidal", "spheroidal"), strict=True):
        for l in range(1, solution.modes.lmax + 1):
            power, noise, p_value = np.array([solution.power(name, kind, l) for name in names]).T
            is_finite = np.isfinite(p_value)
            if not is_finite.any():
                continue
            colour = COLOURS[(l - 1) % len(COLOURS)]
            axes.plot(x[is_finite], np.sqrt(power[is_finite]), "o-", ms=3, color=colour, label=f"degree {l}")
            axes.plot(x[is_finite], np.sqrt(noise[is_finite]), ":", color=colour, linewidth=0.9)
        axes.set_ylabel(f"{label}, √power  [µas]")
        axes.set_ylim(bottom=0)
    legend_above(subplots[0], 5, handles=subplots[1].get_legend_handles_labels()[0])
    subplots[1].set_xticks(x, names, rotation=60 if len(names) > 6 else 0, ha="right" if len(names) > 6 else "center")
    subplots[1].set_xlabel("function of time (dotted: what noise gives)")
    return subplots


@apply_style
def plot_bands(background: Any, *, ax: Axes | None = None) -> Axes:
    """√P of each band: 68 % and the 95 % limit."""
    (axes,) = panels(ax, size=(WIDTH, 2.8))
    interval, limits = background.interval(), background.limits()
    x = np.arange(len(background.bands))
    axes.vlines(x, interval[:, 0], interval[:, 1], color=COLOURS[0], linewidth=3, label="68 %")
    axes.plot(x, limits, "v", color=COLOURS[1], label="95 % limit")
    axes.set_xticks(x, background.bands, rotation=0 if len(x) < 6 else 60, ha="center" if len(x) < 6 else "right")
    axes.set_xlim(-0.5, len(x) - 0.5)
    axes.set_ylim(bottom=0)
    axes.set_ylabel("rms displacement  [µas]")
    legend_above(axes, 2)
    return axes


def movie_of(solution: Any, frames: int = 40) -> bytes:
    """The displacements of the sky over the span, as a GIF."""
    start, end = solution.functions.span
    times = np.linspace(float(start), float(end), frames)
    pictures = []
    with plt.rc_context(STYLE):
        axes = sky_axes(solution.frame)
        figure: Any = axes.figure
        lon, lat = arrow_grid(axes)
        fields = [solution.at(time)[0].at(lon, lat) for time in times]
        largest = max(float(np.hypot(*field).max()) for field in fields)
        titles = [f"{time:+.2f} yr; the longest arrow is {largest:.3g} µas" for time in times]
        # The map is drawn once; on it, frame by frame, what moves.
        figure.set_dpi(110)
        title = axes.set_title(titles[0])
        figure.canvas.draw()
        figure.set_layout_engine("none")
        position = title.get_position()
        title.set_text("")
        figure.canvas.draw()
        still, before = figure.canvas.copy_from_bbox(figure.bbox), len(axes.collections)
        title.set_position(position)
        for text, field in zip(titles, fields, strict=True):
            figure.canvas.restore_region(still)
            draw_vectors(axes, lon, lat, field, scale=largest)
            title.set_text(text)
            for artist in (title, *axes.collections[before:]):
                axes.draw_artist(artist)
            for artist in list(axes.collections[before:]):
                artist.remove()
            picture = Image.fromarray(np.array(figure.canvas.buffer_rgba())[..., :3])
            pictures.append(picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=64))
        plt.close(figure)
    buffer = io.BytesIO()
    options: Any = {"format": "GIF", "save_all": True, "duration": 120, "loop": 0, "comment": MARK.encode()}
    pictures[0].save(buffer, append_images=pictures[1:], **options)
    return buffer.getvalue()
