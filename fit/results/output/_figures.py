"""Figures of a solution: its spectrum, its correlations and its residuals (matplotlib)."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from fit.results.output._text import format_squared_unit
from fit.results.quality import ErrorSource
from fit.results.spectrum import compute_wilson_hilferty_z, spectrum
from vsh.coefficients import FIRST_DEGREE
from vsh.field import Field, SourcesWithErrors
from vsh.figures.plot import (
    COLOURS,
    DIVERGING,
    KIND_COLOURS,
    KIND_NAMES,
    NAMED,
    WIDTH,
    apply_style,
    colour_bar,
    draw_matrix,
    legend_above,
    panels,
    plot_field,
    plot_map,
    plot_scalar_field,
    set_log_ticks,
)
from vsh.io.parts import Parts, as_parts
from vsh.io.quantities import symbol
from vsh.modes import KINDS
from vsh.scalars import ScalarField
from vsh.sky.frames import title_of
from vsh.sky.pixels import pixels_of
from vsh.tools.digits import format_with_error
from vsh.tools.printing import printable
from vsh.tools.types import Axes, FloatArray
from vsh.vector import correlation_of

#: A degree whose p-value is above this is shown as a limit.
_SIGNAL_P_VALUE = 0.05


def plot_sky(solution: Any, field: Any = None, *, value: str | None = None, ax: Axes | None = None) -> Any:
    """The fitted field on the sky, of motions or of a scalar `value`, with its sources where a field is given."""
    title = f"{solution.n_sources} sources and the field fitted to degree {solution.modes.lmax}"
    if value:
        title = f"{printable(value.partition(',')[0])} of {title}".replace(" and ", "\nand ")
    plot_options = {"frame": solution.frame, "title": title, "ax": ax, "unit": solution.unit}
    if solution.modes.components == 1:
        return plot_scalar_field(field, solution.coefficients, covariance=solution.covariance, **plot_options)
    return plot_field(field, solution.coefficients, covariance=solution.covariance, **plot_options)


@apply_style
def plot_spectrum(solution: Any, *, ax: Axes | None = None) -> Axes:
    """Power by degree and kind: with its error where there is a signal, as an upper limit where there need be none.

    An arrow begins at the limit (95 %) of what the power may be where p > 5 %; dotted is what noise alone gives on
    average. The axis at the right is the root of the power.

    Parameters
    ----------
    solution : Solution
        What was found.
    ax : matplotlib axes, optional
        Where to draw; a new figure unless given.

    Notes
    -----
    Limits are those of `fit.spectrum.Degree.limit`.
    """
    (axes,) = panels(ax, size=(WIDTH, 2.7))
    rows = spectrum(solution)
    levels, legend_handles, has_limits = [], [], False
    offset_signs = (-1, 1) if len(solution.modes.kinds) > 1 else (0,)
    for kind, offset_sign in zip(solution.modes.kinds, offset_signs, strict=True):
        colour, marker = KIND_COLOURS[kind], "o" if kind == "T" else "s"
        kind_rows = [row for row in rows if row.kind == kind and row.l]  # the mean would hide all other degrees
        l = np.array([row.l for row in kind_rows]) + offset_sign * 0.09
        power, errors, noise, p_values = (
            np.array([getattr(row, name) for row in kind_rows], float)
            for name in ("power", "error", "noise", "p_value")
        )
        is_finite = np.isfinite(power)
        is_signal = is_finite & (p_values <= _SIGNAL_P_VALUE)
        is_limit = is_finite & ~is_signal & (noise > 0)
        axes.errorbar(l[is_signal], power[is_signal], errors[is_signal], fmt=marker, color=colour)
        limits = np.array([row.limit() for row, has_limit in zip(kind_rows, is_limit, strict=True) if has_limit])
        arrow_style: Any = {"uplims": True, "fmt": "none", "capsize": 2.5, "elinewidth": 0.8}
        axes.errorbar(l[is_limit], limits, 0.45 * limits, color=colour, **arrow_style)
        axes.hlines(noise, l - 0.14, l + 0.14, color=colour, linestyle=(0, (1, 1)), linewidth=1.4, zorder=5)
        # Errors to come have no power; where all are limits the key is one.
        key_marker = {"marker": marker if is_signal.any() else "v", "linestyle": "none"}
        marker_style: Any = key_marker if is_finite.any() else {"linestyle": ":"}
        legend_handles.append(Line2D([], [], color=colour, label=KIND_NAMES[kind], **marker_style))
        has_limits = has_limits or bool(is_limit.any())
        levels += [*power[is_signal], *(power + errors)[is_signal], *limits, *(0.5 * limits), *noise]
    # An error as large as the power has no lower end on a logarithmic axis: its bar runs out of it.
    axes.set_yscale("log", nonpositive="clip")
    positive_levels = np.array(levels)[np.isfinite(levels) & (np.array(levels) > 0)]
    power_range = (positive_levels.min() / 2, positive_levels.max() * 2) if positive_levels.size else (0.5, 2.0)
    has_floor = solution.floor is not None and solution.includes_floor
    tops = [band[-1] for band in solution.floor.bands if band[1]] if has_floor else []
    if tops := [top for top in tops if top > power_range[0] / 30]:  # floors are seen, unless they are next to nothing
        power_range = (min(power_range[0], min(tops) / 3), power_range[1])
    axes.set_ylim(power_range)
    if has_floor:
        _draw_floor_bands(axes, solution.floor, legend_handles)
    set_log_ticks(axes.yaxis, *power_range)
    if solution.modes.lmax <= 12:
        axes.set_xticks(np.unique([row.l for row in rows if row.l]))
    axes.set(xlabel="degree $\\ell$", ylabel=f"power  {format_squared_unit(solution)}")
    root_axis = axes.secondary_yaxis("right", functions=(lambda power: np.sqrt(np.maximum(power, 0)), np.square))
    root_axis.set_ylabel(f"√power  [{solution.unit}]" if solution.unit else "√power")
    set_log_ticks(root_axis.yaxis, *np.sqrt(power_range))
    if has_limits:
        legend_handles.append(
            Line2D([], [], color="0.3", marker="$\\top$", linestyle="none", label="95 % limit (bar), p > 0.05")
        )
    legend_handles.append(Line2D([], [], color="0.3", linestyle=":", label="noise alone"))
    mean_text = None
    if solution.modes.lowest == 0:
        value, error = solution.mean
        mean_text = f"mean {format_with_error(value, error, '+')} {solution.unit}".replace("-", "−")
    legend_above(axes, 2, handles=legend_handles, title=mean_text, alignment="left")
    return axes


def _draw_floor_bands(axes, floor, legend_handles):
    """The floor of low degrees, the likeliest 68 % of their power, as bands at their sides."""
    bands = [band for band in floor.bands if band[1] and band[-1] > axes.get_ylim()[0]]  # the mean is not drawn
    for kind, l, lower, upper in bands:
        band_centre = l + (0.3 if kind == "S" else -0.3)
        axes.fill_between([band_centre - 0.08, band_centre + 0.08], max(lower, upper / 30), upper, alpha=0.35,
                          color=KIND_COLOURS[kind], linewidth=0)  # fmt: skip
    legend_handles += [Patch(color="0.6", alpha=0.6, linewidth=0, label="floor, 68 %")] * bool(bands)


@apply_style
def plot_correlation(solution: Any, *, ax: Axes | None = None) -> Axes:
    """The correlation matrix of the fit, components of spin and acceleration in place of degree 1.

    Parameters
    ----------
    solution : Solution
        What was found.
    ax : matplotlib axes, optional
        Where to draw; a new figure unless given.
    """
    (axes,) = panels(ax, size=(WIDTH, 3.7))
    if hasattr(solution, "coefficients"):
        names, matrix, degree_groups = _name_and_correlate_coefficients(solution)
        kinds = [f"{kind if len(names) > NAMED else kind.lower()}: {KIND_NAMES[kind]}" for kind in solution.modes.kinds]
        title = "; ".join([*kinds * (solution.modes.lmax > 1), f"{title_of(solution.frame)} axes"])
        axes.set_title(title)
    else:
        names, matrix, degree_groups = [symbol(name) for name in solution.names], solution.correlation, None
        axes.set_title(f"{title_of(solution.frame)} axes")
    colour_bar(axes, draw_matrix(axes, matrix, names, degree_groups), "correlation")
    return axes


def _name_and_correlate_coefficients(solution):
    """Names, correlations and degrees of the coefficients, degree 1 turned into vectors along the axes."""
    modes = solution.modes
    names, transform = [symbol(str(mode)) for mode in modes], np.eye(len(modes))
    to_vector = np.linalg.inv(FIRST_DEGREE)
    for kind, vector_stem in zip(KINDS, ("omega", "a"), strict=True):
        if kind in modes.kinds:
            degree_one = modes.slice_of(kind, 1)
            transform[degree_one, degree_one] = to_vector
            symbol_stem = "omega" if vector_stem == "omega" else "a" if solution.unit == "µas/yr" else "g"
            names[degree_one] = [symbol(f"{symbol_stem}_{axis}") for axis in "xyz"]
    matrix = correlation_of(transform @ solution.covariance @ transform.T)
    return names, matrix, [f"{mode.kind}{mode.l}" for mode in modes]


@apply_style
def plot_terms(terms: Mapping[str, Mapping[str, tuple[float, float]]], unit: str, *, ax: Axes | None = None) -> Axes:
    """Values and errors of named terms, side by side for each label."""
    (axes,) = panels(ax, size=(WIDTH, 2.6))
    for label_index, (label, named_values) in enumerate(terms.items()):
        positions = np.arange(len(named_values)) + 0.7 * ((label_index + 0.5) / len(terms) - 0.5)
        values, errors = np.transpose(list(named_values.values()))
        axes.errorbar(positions, values, errors, fmt="o", ms=3, color=COLOURS[label_index % len(COLOURS)], label=label)
    names = list(next(iter(terms.values())))
    axes.axhline(0, color="0.6", linewidth=0.6, zorder=0)
    axes.set_xticks(range(len(names)), names, rotation=60 if len(names) > 6 else 0)
    axes.set_ylabel(f"value of the term  [{unit}]")
    legend_above(axes, 3)
    return axes


@apply_style
def plot_residuals(
    solution: Any,
    field: Field | ScalarField | Parts,
    *,
    nside: int | None = None,
    weights: FloatArray | None = None,
    ax: Axes | None = None,
) -> Axes:
    """Map where residuals are larger or smaller than their errors, as a normal deviate of χ² in each HEALPix pixel.

    Between −2 and 2 in 95 % of the pixels where the errors are right.

    Parameters
    ----------
    solution : Solution
        What was found.
    field : Field, ScalarField or Parts
        In the solution's frame.
    nside : int, optional
        Resolution of the pixels; at least ten sources in each on average unless given.
    weights : (n,) array, optional
        Factors on the inverse covariances of a robust fit, of sources in memory: residuals are those of their errors
        over √weight, scaled to a mean of 1.
    ax : matplotlib axes, optional
        Axes that the map replaces; a new figure unless given.
    """
    nside = nside or 2 ** int(np.clip(np.log2(max(1, solution.n_sources / 120)) / 2, 0, 6))
    if weights is not None:
        field = _scale_errors_by_weights(solution, field, weights)
    sum_by_pixel = partial(_sum_chi2_and_sources_by_pixel, solution=solution, nside=nside)
    chi2, n_sources = as_parts(field, SourcesWithErrors).sum(sum_by_pixel, roles=(), words="residuals")
    dof = n_sources * solution.modes.components
    with np.errstate(divide="ignore", invalid="ignore"):
        deviate = np.where(dof > 0, compute_wilson_hilferty_z(chi2, dof), np.nan)
    finite_deviates = deviate[np.isfinite(deviate)]
    limit = float(np.clip(np.percentile(np.abs(finite_deviates), 98), 3, None)) if finite_deviates.size else 3.0
    suffix = " by the errors of the robust fit" if weights is not None else " by the catalogue's errors"
    suffix = "" if weights is None and solution.error_source == ErrorSource.CATALOGUE else suffix
    label = f"normal deviate of χ² in a pixel{suffix}\n[σ]; χ²/n = {chi2.sum() / max(1, dof.sum()):.2f} over the sky"
    title = f"residuals of {int(n_sources.sum())} sources, pixels of {58.6 / nside:.1f}° (grey: none)"
    return plot_map(
        deviate, label, frame=solution.frame, cmap=DIVERGING, title=title, ax=ax, vmin=-limit, vmax=limit, extend="both"
    )


def _scale_errors_by_weights(solution, field, weights):
    """The sources with the errors by which a robust fit weighs them, scaled so that χ² is the number of data."""
    relative_weights = np.asarray(weights) / np.mean(weights)
    chi2 = solution.residuals(field).chi2 @ relative_weights
    sigma = field.sigma * np.sqrt(chi2 / (solution.modes.components * len(field)) / np.maximum(relative_weights, 1e-12))
    return field.with_errors(sigma, field.rho)


def _sum_chi2_and_sources_by_pixel(field, solution, nside):
    """χ² and sources by pixel."""
    pixels = pixels_of(field.lon, field.lat, nside)
    return np.array([np.bincount(pixels, weights, 12 * nside**2) for weights in (solution.residuals(field).chi2, None)])
