"""Influence maps: the derivative of a result with respect to the weight of each pixel."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from scipy.linalg import eigh

from fit.correlation._matrices import FRAME, named
from fit.normal import normal_equations
from fit.solution import at_sources
from fit.solving import solve
from fit.storage import Result
from vsh import Coefficients
from vsh.basis import harmonics
from vsh.field import Field
from vsh.io import tables
from vsh.modes import Modes, as_modes
from vsh.tools import arguments
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, AxesArray, BoolArray, FloatArray, OnAxes, Table


@arguments.accepts(nside=arguments.whole)
def influence_map(
    sources: Any,
    modes: Modes | int | Literal["spin+acceleration"],
    parameters: str | Sequence[str],
    nside: int = 16,
    *,
    quantity: Literal["value"] | None = None,
    sigma: ArrayLike | None = None,
) -> FloatArray:
    """How a result changes with the weight of each HEALPix pixel; exact, from the normal matrix.

    Parameters
    ----------
    sources : Field, or positions with errors as for `fit.correlation.predict_covariance`
        As for `fit.correlation.predict_covariance`.
    modes : Modes, or the degree lmax, or "spin+acceleration" (degree 1)
        What to fit, or the degree lmax.
    parameters : (str, str) or str
        Two names of parameters ("omega_y", "a_x", "t(2,0)"): their correlation. One: its variance.
    nside : int
        Resolution of the HEALPix pixels.
    quantity : "value", optional
        What is mapped: the value of one parameter, in place of its variance; needs motions.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    (12 nside²,) array, ring order, axes of the sources
        d ρ / d ln w, d ln σ² / d ln w or dθ/d ln w [µas/yr], w the weight of all sources in a pixel:
        what doubling them would change, to first order.

    Notes
    -----
    With C = N⁻¹ and N = Σ wₖ Nₖ, ∂C/∂wₖ = −C Nₖ C. Between two parameters that is −Σ gᵢᵀ W gⱼ over the sources of the
    pixel, where gᵢ is the vector field whose coefficients are the column of C that belongs to parameter i.
    """
    from vsh.sky.pixels import pixels_of

    field = Field.without_motions(sources, sigma)
    pixels = pixels_of(field.lon, field.lat, nside)
    return np.bincount(pixels, _by_source(field, modes, parameters, quantity), 12 * nside**2).astype(float)


@arguments.accepts(nside=arguments.whole, n_sources=arguments.positive, sigma=arguments.positive)
def gain_of_sources(
    sources: Any,
    modes: Modes | int | Literal["spin+acceleration"],
    parameters: str | Sequence[str],
    nside: int = 16,
    *,
    n_sources: int = 1000,
    sigma: float | None = None,
    quantity: Literal["value"] | None = None,
) -> FloatArray:
    """How a result would change if new sources were added in each pixel.

    Notes
    -----
    n sources of error σ at one place add (n/σ²) V Vᵀ to N, V the (p, 2) harmonics there, so that
    C' = C − C V (1 σ²/n + Vᵀ C V)⁻¹ Vᵀ C.
    """
    from vsh.sky.pixels import centres

    if quantity == "value":
        raise ParameterError("added sources have no motions: the change of a value cannot be predicted")
    field = Field.without_motions(sources)
    sigma = float(np.median(field.sigma)) if sigma is None else sigma
    lon, lat = centres(nside)
    covariance, first, second, chosen = _prepared(field, modes, parameters)
    v = harmonics(lon, lat, chosen.modes)
    inner = np.linalg.inv(
        np.einsum("pin,pq,qjn->nij", v, covariance, v, optimize=True) + sigma**2 / n_sources * np.eye(2)
    )

    def after(f, g):
        return f @ covariance @ g - np.einsum(
            "in,nij,jn->n", np.tensordot(covariance @ f, v, 1), inner, np.tensordot(covariance @ g, v, 1)
        )

    if second is None:
        return np.log(after(first, first) / (first @ covariance @ first))
    before = (first @ covariance @ second) / np.sqrt((first @ covariance @ first) * (second @ covariance @ second))
    return after(first, second) / np.sqrt(after(first, first) * after(second, second)) - before


def _by_source(field, modes, parameters, quantity):
    """The derivative by each source's own weight, (n,)."""
    covariance, first, second, chosen = _prepared(field, modes, parameters)
    g = at_sources(Coefficients(chosen.modes, covariance @ first), field)
    if quantity == "value":
        if len(chosen) != 1:
            raise ParameterError('quantity="value" is of one parameter')
        residual = solve(normal_equations(field, chosen.modes)).residuals(field).motion
        return field.inner(g, residual)
    if quantity is not None:
        raise ParameterError(f'quantity is None or "value", not {quantity!r}')
    h = None if second is None else at_sources(Coefficients(chosen.modes, covariance @ second), field)
    return _change(covariance, first, second, g, h, field)


def _change(covariance, first, second, g, h, field):
    """dρ, or d ln σ² where there is one parameter only."""
    c_ii = first @ covariance @ first
    if second is None:
        return -field.inner(g, g) / c_ii
    c_jj, c_ij = second @ covariance @ second, first @ covariance @ second
    rho = c_ij / np.sqrt(c_ii * c_jj)
    own = field.inner(g, g) / c_ii + field.inner(h, h) / c_jj
    return -field.inner(g, h) / np.sqrt(c_ii * c_jj) + rho / 2 * own


def _prepared(field, modes, parameters):
    if not isinstance(parameters, (str, tuple, list)) or not all(isinstance(name, str) for name in parameters):
        raise ParameterError(f"one or two names of parameters are wanted, not {parameters!r}")
    names = (parameters,) if isinstance(parameters, str) else tuple(parameters)
    if len(names) not in (1, 2) or len(set(names)) != len(names):
        raise ParameterError(f"one or two different parameters are wanted, not {parameters!r}")
    modes = as_modes(1 if isinstance(modes, str) and modes == FRAME else modes)
    chosen = named(names, modes)
    covariance = solve(normal_equations(field, modes)).covariance
    return covariance, chosen.rows[0], chosen.rows[1] if len(names) == 2 else None, chosen


def most_influential(influence: ArrayLike, fraction: float = 0.5) -> BoolArray:
    """A mask (12 nside²,) of the pixels that hold `fraction` of an influence of the sign that prevails."""
    m = arguments.float_array("influence", influence, finite=False)
    if not 0 < fraction <= 1:
        raise ParameterError(f"a fraction lies between 0 and 1, not at {fraction}")
    positive, negative = m[m > 0].sum(), -m[m < 0].sum()
    signed = m if positive >= negative else -m
    order = np.argsort(-signed)
    held = np.cumsum(np.maximum(signed[order], 0))
    mask = np.zeros(m.size, bool)
    mask[order[: np.searchsorted(held, fraction * held[-1]) + 1]] = True
    return mask & (signed > 0)


@dataclass(frozen=True, eq=False)
class Eigenmodes(Result):
    """Fields that a sky measures independently of each other, from the worst to the best.

    Attributes
    ----------
    information : (p,) array
        Rising: how well each is measured beside a uniform sky of the same weight; 0.01 is ten times the error.
    fields : list of Coefficients
        Each of ∫|V|² dΩ = 1.
    frame : str
    """

    information: FloatArray
    fields: list
    frame: str

    def report(self) -> str:
        """How well the best and the worst are measured, as text."""
        error = 1 / np.sqrt(self.information)
        lines = [
            f"Fields that this sky measures independently ({self.frame} axes): {len(error)}, with errors of "
            f"{error[-1]:.3f} (best) to {error[0]:.3g} (worst) times those of the same weight on a uniform sky",
            "The worst, with what they are made of:",
        ]
        for i, field in enumerate(self.fields[:3]):
            names = list(map(str, field.modes))
            largest = np.argsort(-np.abs(field.values))[:3]
            made = ", ".join(f"{field.values[k]:+.2f} {names[k]}" for k in largest)
            lines.append(f"  {error[i]:>8.3g} × the error   {made}")
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """Information of each as an astropy Table, from the worst to the best."""
        return tables.table_of({"information": self.information}, {"frame": self.frame})

    def plot(self, n_fields: int = 2, *, ax: OnAxes | None = None) -> AxesArray:
        """The worst and the best as maps of arrows; on matplotlib axes.

        Parameters
        ----------
        n_fields : int
            How many of the worst and of the best.
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        from fit.correlation._plot import plot_eigenmodes

        return plot_eigenmodes(self, n_fields, ax=ax)


def eigenmodes(sources: Any, modes: Modes | int, *, sigma: ArrayLike | None = None) -> Eigenmodes:
    """An orthogonal basis on the given sky.

    Parameters
    ----------
    sources
        As for `leakage`.
    modes : Modes, or the degree lmax
        What to fit.
    sigma : float or (2, n) array, optional
        Errors in place of the sources' own. [µas/yr]

    Returns
    -------
    Eigenmodes
        Solutions of N v = λ M v, M the normal matrix of a uniform sky of the same total weight.
    """
    modes = as_modes(modes)
    field = Field.without_motions(sources, sigma)
    normal = normal_equations(field, modes).matrix
    # ∫ |V|² dΩ = Σ norm2 c²; a uniform sky measures its mean, by half the trace of the weights.
    norm = np.diag(modes.norm2.astype(float))
    values, vectors = eigh(normal, norm)
    even = field.information.sum() / 2 / (4 * np.pi)
    return Eigenmodes(values / even, [Coefficients(modes, v) for v in vectors.T], field.frame)
