"""Vectors, sources and maps on the whole sky (matplotlib)."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from vsh.coefficients import Coefficients
from vsh.field import Field
from vsh.sky.frames import ANGLES
from vsh.sky.sphere import angles, triad
from vsh.system.files import atomic_write
from vsh.types import ArrayLike, Axes, Figure, FloatArray, PathName

__all__ = [
    "draw_map",
    "draw_sources",
    "draw_vectors",
    "even_grid",
    "map_angles",
    "on_map",
    "plot_field",
    "save_figures",
    "sky_axes",
]


def sky_axes(frame: str = "icrs", axes: Axes | None = None) -> Any:
    """An all-sky map in the Hammer-Aitoff projection, longitude increasing to the left.

    Parameters
    ----------
    frame : str
        Named on the map.
    axes : matplotlib axes in the "hammer" projection, optional
        With a map projection; new ones unless given.

    Returns
    -------
    matplotlib axes
    """
    if axes is None:
        axes = plt.figure(figsize=(9, 5), layout="constrained").add_subplot(projection="hammer")
    lon, lat = ANGLES[frame]
    axes.set_xticks(np.radians(np.arange(-120, 121, 60)))
    axes.set_xticklabels([f"{-degrees % 360}°" for degrees in range(-120, 121, 60)], fontsize=9, color="0.35")
    axes.set_yticks(np.radians(np.arange(-60, 61, 30)))
    axes.tick_params(axis="y", labelsize=9, labelcolor="0.35")
    axes.grid(color="0.8", linewidth=0.6)
    axes.set_axisbelow(True)
    name = "ICRS" if frame == "icrs" else frame
    axes.text(0.99, 0.01, f"{name}: {lon} ←, {lat} ↑", transform=axes.transAxes, ha="right", fontsize=10, color="0.35")
    return axes


def on_map(lon: FloatArray) -> FloatArray:
    """Longitude as the map's abscissa: east to the left, between -π and π.

    Parameters
    ----------
    lon : (n,) array
        Longitude. [rad]

    Returns
    -------
    array
    """
    return -((np.asarray(lon) + np.pi) % (2 * np.pi) - np.pi)


def draw_sources(axes: Any, lon: FloatArray, lat: FloatArray, *, max_sources: int = 20_000, **style: Any) -> Any:
    """Sources as small dots; every k-th of more than `most`.

    Parameters
    ----------
    axes : matplotlib Axes
        Where to draw.
    lon : (n,) array
        Longitude. [rad]
    lat : (n,) array
        Latitude. [rad]
    max_sources : int
        Beyond which only every k-th is drawn.
    **style
        Of the dots.

    Returns
    -------
    object
    """
    step = max(1, len(lon) // max_sources)
    style = {"s": 3, "color": "0.6", "linewidths": 0, "zorder": 1} | style
    return axes.scatter(on_map(lon[::step]), lat[::step], **style)


def draw_vectors(
    axes: Any, lon: FloatArray, lat: FloatArray, motion: FloatArray, *, scale: float | None = None, **style: Any
) -> Any:
    """Motions as arrows that point where the motion goes on this map.

    matplotlib would draw north as up everywhere; the direction is taken instead from a small
    step along the motion, projected.

    Parameters
    ----------
    lon, lat : (n,) arrays
        [rad]
    motion : (2, n) array
        East and north [µas/yr]
    scale : float, optional
        The motion that is drawn as long as a tenth of the map; the
        largest unless given.
    axes : matplotlib Axes
        Where to draw.
    **style
        Of the arrows.

    Returns
    -------
    matplotlib.quiver.Quiver
    """
    amplitude = np.hypot(*motion)
    scale = scale or float(amplitude.max()) or 1.0
    angle = map_angles(axes, lon, lat, motion)
    u, v = amplitude * np.cos(angle), amplitude * np.sin(angle)
    style = {"width": 0.0028, "zorder": 3, "pivot": "tail"} | style
    return axes.quiver(on_map(lon), lat, u, v, angles=np.degrees(angle), scale=scale * 11, scale_units="width", **style)


def map_angles(axes: Any, lon: FloatArray, lat: FloatArray, motion: FloatArray, step: float = 1e-4) -> FloatArray:
    """Angle of each motion on the map, anticlockwise from its right, (n,). [rad]

    Parameters
    ----------
    axes : matplotlib Axes
        Where to draw.
    lon : (n,) array
        Longitude. [rad]
    lat : (n,) array
        Latitude. [rad]
    motion : (2, n) array
        µ_α* and µ_δ. [µas/yr]
    step : float
        By which to move along the motion. [rad]

    Returns
    -------
    array
    """
    p, q, r = triad(lon, lat)
    with np.errstate(invalid="ignore"):
        unit = np.nan_to_num(motion / np.hypot(*motion))
    ahead, behind = (angles(r + sign * step * (unit[0] * p + unit[1] * q)) for sign in (1, -1))
    # A step over the map's edge comes back on the other side: keep it beyond the edge.
    x0 = on_map(lon)
    points = []
    for stepped_lon, stepped_lat in (ahead, behind):
        turn = (on_map(stepped_lon) - x0 + np.pi) % (2 * np.pi) - np.pi
        points.append(axes.transProjection.transform(np.stack([x0 + turn, stepped_lat], axis=1)))
    dx, dy = (points[0] - points[1]).T
    return np.arctan2(dy, dx)


def plot_field(field: Field, coefficients: Coefficients, *, title: str | None = None, unit: str = "µas/yr") -> Figure:
    """The sources of a field and the motions that were fitted to them, with their scale.

    Parameters
    ----------
    field : Field
        The sources.
    coefficients : Coefficients
        The field. [µas/yr]
    title : str, optional
        Of the figure.
    unit : str
        Beside the arrow of the legend.

    Returns
    -------
    matplotlib figure
    """
    axes = sky_axes(field.frame)
    draw_sources(axes, field.lon, field.lat)
    lon, lat = even_grid()
    motion = coefficients.at(lon, lat)
    largest = float(np.hypot(*motion).max())
    arrows = draw_vectors(axes, lon, lat, motion, color="#0b5394")
    round_number = _round(largest)
    axes.quiverkey(arrows, 0.08, 0.04, round_number, f"{round_number:g} {unit}", labelpos="E", coordinates="axes")
    if coefficients.glide.any():
        lon, lat = angles(coefficients.glide)
        axes.scatter(
            on_map(lon),
            lat,
            marker="*",
            s=220,
            color="#f1c232",
            edgecolor="k",
            zorder=4,
            label="acceleration" if unit == "µas/yr" else "glide",
        )
        axes.legend(loc="lower left", bbox_to_anchor=(0.0, 0.08), frameon=False, fontsize=10, handletextpad=0.2)
    axes.set_title(title or f"{len(field)} sources and the field fitted to degree {coefficients.modes.lmax}", pad=16)
    return axes.figure


def draw_map(axes: Any, values: ArrayLike, cmap: str = "viridis", **style: Any) -> Any:
    """A HEALPix map (ring order) on sky axes; empty pixels (nan) stay blank.

    Parameters
    ----------
    axes : matplotlib Axes
        Where to draw.
    values : (12 nside²,) array
        In ring order.
    cmap : str
        The colours.
    **style
        Of the image.

    Returns
    -------
    object
    """
    from vsh.sky.pixels import pixels_of  # healpy

    values = np.asarray(values)
    nside = int(np.sqrt(values.size / 12))
    x, y = np.linspace(-np.pi, np.pi, 721), np.linspace(-np.pi / 2, np.pi / 2, 361)
    lon, lat = np.meshgrid(-(x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2)
    picture = np.asarray(values)[pixels_of(lon.ravel(), lat.ravel(), nside)].reshape(lon.shape)
    return axes.pcolormesh(x, y, picture, cmap=cmap, rasterized=True, zorder=0.5, **style)


def even_grid(step: float = 12.0) -> tuple[FloatArray, FloatArray]:
    """Positions about `step` degrees apart all over the sky: lon, lat. [rad]

    Parameters
    ----------
    step : float
        Between points. [deg]

    Returns
    -------
    tuple[array, array]
    """
    lon, lat = [], []
    for degrees in np.arange(-90 + step / 2, 90, step):
        around = max(1, round(360 * np.cos(np.radians(degrees)) / step))
        lon.append((np.arange(around) + 0.5) * 2 * np.pi / around)
        lat.append(np.full(around, np.radians(degrees)))
    return np.concatenate(lon), np.concatenate(lat)


def save_figures(figures: dict[str, Figure], folder: PathName) -> list[Path]:
    """Write figures by name as PNG into a folder and close them; returns their paths.

    Parameters
    ----------
    figures : dict of str to figure
        By name of file.
    folder : str or Path
        Where to write.

    Returns
    -------
    list[Path]
    """
    paths = []
    for name, figure in figures.items():
        paths.append(Path(folder) / f"{name}.png")
        with atomic_write(paths[-1]) as new:
            figure.savefig(new, format="png", dpi=150)
        plt.close(figure)
    return paths


def _round(x):
    """A round number not far below x: 1, 2 or 5 times a power of ten."""
    power = 10 ** np.floor(np.log10(x)) if x > 0 else 1.0
    return float(max(k * power for k in (1, 2, 5) if k == 1 or k * power <= x))
