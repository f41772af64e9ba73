"""2F over a map of directions, from whitened coefficients."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from fit.quality import printed_p_value
from vsh.figures.plot import COLOURS, WIDTH, draw_points, legend_above, log_ticks, panels, plot_map, styled
from vsh.models.waves import wave_templates
from vsh.modes import Modes
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad
from vsh.tools.arguments import generator
from vsh.tools.errors import DegeneracyError
from vsh.tools.notebook import Frozen
from vsh.tools.types import BoolArray, FloatArray, Rng


@dataclass(frozen=True, eq=False)
class Whitened(Frozen):
    """Equations of unit noise for some coefficients, all others free."""

    kept: BoolArray
    root: FloatArray
    values: FloatArray

    @classmethod
    def of(cls, matrix: FloatArray, rhs: FloatArray, kept: BoolArray) -> Whitened:
        """From normal equations."""
        try:
            free = cho_factor(matrix[np.ix_(~kept, ~kept)])
            across = matrix[np.ix_(~kept, kept)]
            reduced = matrix[np.ix_(kept, kept)] - across.T @ cho_solve(free, across)
            root = cholesky(reduced)
        except np.linalg.LinAlgError:
            raise DegeneracyError(
                f"these sources do not determine {len(kept)} coefficients: lower lmax, or take more of the sky"
            ) from None
        values = solve_triangular(root, rhs[kept] - across.T @ cho_solve(free, rhs[~kept]), trans="T")
        return cls(kept, root, values)


@lru_cache(maxsize=4)
def templates(lmax: int, nside: int) -> FloatArray:
    """Coefficients of both polarisations for every pixel, (2, p, 12 nside²)."""
    templates = wave_templates(triad(*centres(nside))[2], lmax)
    templates.flags.writeable = False
    return templates


def map_of(white: Whitened, modes: Modes, nside: int, copies: int = 1) -> tuple[FloatArray, FloatArray, FloatArray]:
    """2F, the best amplitudes, (2 copies, n), and their covariance, (n, 2 copies, 2 copies), for every direction."""
    seen, inverse = _basis(white, modes, nside, copies)
    g = np.tensordot(white.values, seen, axes=(0, 1))
    amplitudes = np.einsum("nij,jn->in", inverse, g)
    return np.sum(g * amplitudes, axis=0), amplitudes, inverse


def _basis(white, modes, nside, copies):
    """Whitened templates, (2 copies, q, n), and the inverse of their products, (n, 2 copies, 2 copies)."""
    single = templates(modes.lmax, nside)
    p = len(modes)
    whole = np.zeros((2 * copies, copies * p, single.shape[2]))
    for copy in range(copies):
        whole[2 * copy : 2 * copy + 2, copy * p : (copy + 1) * p] = single
    seen = np.tensordot(white.root, whole[:, white.kept], axes=(1, 1)).transpose(1, 0, 2)
    return seen, np.linalg.inv(np.einsum("iqn,jqn->nij", seen, seen))


def chance(white: Whitened, modes: Modes, nside: int, largest: float, n_skies: int, rng: Rng) -> float:
    """Probability that noise alone gives as large a 2F anywhere."""
    return share_beyond(chances(white, modes, nside, n_skies, rng), largest)


def share_beyond(maxima: FloatArray, largest: float) -> float:
    """(1 + how many of the skies reach the largest)/(1 + how many there are)."""
    return (1 + int(np.sum(maxima >= largest))) / (1 + len(maxima))


def chances(white: Whitened, modes: Modes, nside: int, n_skies: int, rng: Rng, copies: int = 1) -> FloatArray:
    """The largest 2F of each of so many skies of noise."""
    seen, inverse = _basis(white, modes, nside, copies)
    root = np.linalg.cholesky(inverse)
    rotated = np.einsum("nij,iqn->jnq", root, seen)  # 2F is the sum of squares of these with the noise
    rng, largest = generator(rng), []
    for start in range(0, n_skies, 100):
        noise = rng.standard_normal((len(white.values), min(100, n_skies - start)))
        largest.append(sum((part @ noise) ** 2 for part in rotated).max(axis=0))
    return np.concatenate(largest)


@styled
def plot_search(search: Any, *, ax: Any = None) -> Any:
    """2F and the limit of every direction that a wave may travel to."""
    heading = (
        f"largest 2F = {search.statistic.max():.1f}; p = {printed_p_value(search.p_value)} with all directions "
        "looked at"
    )
    drawn = panels(ax, 2, 1, size=(WIDTH, 5.2))
    for place, values, label, cmap, title in (
        (0, search.statistic, "2F of a wave that travels there", "viridis", heading),
        (1, search.limits, f"95 % limit on its amplitude  [{search.unit}]", "cividis", None),
    ):
        drawn[place] = plot_map(values, label, frame=search.frame, cmap=cmap, title=title, ax=drawn[place])
        draw_points(drawn[place], *np.radians(search.direction), marker="+", s=60, color=COLOURS[1])
    return drawn


@styled
def plot_spectrum(spectrum: Any, *, ax: Any = None) -> Any:
    """The strain that a wave can have, with 95 %, against its frequency: median and range over directions."""
    (axes,) = panels(ax, size=(WIDTH, 3.0))
    order = np.argsort(spectrum.frequencies)
    f, limits = spectrum.frequencies[order], spectrum.strain_limits[order]
    axes.fill_between(f, limits[:, 0], limits[:, 2], color=COLOURS[0], alpha=0.25, linewidth=0, label="by direction")
    axes.plot(
        f, limits[:, 1], "o-" if len(f) < 60 else "-", ms=3, color=COLOURS[0], label="95 % limit, median direction"
    )
    axes.set_yscale("log")
    if f[-1] > 5 * f[0]:
        axes.set_xscale("log")
        log_ticks(axes.xaxis, f[0], f[-1])
    axes.set_xlabel("frequency  [1/yr]")
    axes.set_ylabel("strain")
    legend_above(axes, 2)
    return axes
