"""Tests of estimates in bins: least squares with a joint covariance, and p-values whose scales were estimated.

Flows that galaxies share, as the bins of redshift see them.

A flow moves whole neighbourhoods: it does not average out over the sources of a bin, and neighbouring bins share it. Of
every bin's normal equations N c = b it changes b by X a, with X = Σ Aᵀ W F over its sources, F the modes of a flow, and
a their amplitudes, one on average. The coefficients of all bins then have the covariance (N⁻¹X)(N⁻¹X)ᵀ more.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from fit.distances import flow_counts, flow_limits
from fit.secular_parallax import LEFT_DISPERSION, modes_within
from fit.storage import Result
from vsh.basis import harmonics
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts, as_parts
from vsh.models.cosmology import FLAT_PLANCK13, FLOW_LIMIT, hubble_value, usable
from vsh.models.flows import FlowModes, LinearTheory
from vsh.modes import Modes
from vsh.tools.types import Axes, FloatArray, Table
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector


class ChiSquare(NamedTuple):
    """A χ² with its degrees of freedom, and the probability of as much or more.

    `chi2` and `p_value` are with the errors of each bin multiplied by the root of its own χ²/dof, which makes them
    right whatever their scale is in each bin; `quoted` and `p_value_quoted` with the catalogue's errors as they are.
    Where errors are wrong by different factors within one bin, those of its faint sources for example, p-values may
    be too large (0.05 came out in 1 % of skies instead of 5): put an edge of a bin there.
    """

    chi2: float
    dof: int
    p_value: float
    quoted: float = float("nan")
    p_value_quoted: float = float("nan")


@dataclass(frozen=True, eq=False)
class Trend(Result):
    """Coefficients that change linearly: c(x) = c_0 + slope (x − x_0).

    Attributes
    ----------
    slopes : (q,) array
        Slope of each coefficient that is free in every bin. [µas/yr per unit of x]
    covariance : (q, q) array
    test : ChiSquare
        Test of no slope.
    misfit : ChiSquare
        Misfit of the bins about the trend.
    spin, acceleration : Vector
        The slopes of degree 1 as vectors.
    """

    slopes: FloatArray
    covariance: FloatArray
    test: ChiSquare
    misfit: ChiSquare
    spin: Vector
    acceleration: Vector

    def report(self) -> str:
        """The slopes and their test as text."""
        lines = [
            f"slopes of {name:14}" + "".join(f"{x:+10.3f} ± {s:.3f}" for x, s in zip(v.value, v.sigma, strict=True))
            for name, v in (("spin", self.spin), ("acceleration", self.acceleration))
        ]
        lines.append(f"no slope: χ² = {self.test.chi2:.2f} for {self.test.dof}, p-value {self.test.p_value:.4g}")
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """The slopes of spin and acceleration with their errors as an astropy Table."""
        names = [f"{name}_{axis}" for name in ("spin", "acceleration") for axis in "xyz"]
        return tables.table_of(
            {
                "parameter": names,
                "slope": np.concatenate([self.spin.value, self.acceleration.value]),
                "sigma": np.concatenate([self.spin.sigma, self.acceleration.sigma]),
            }
        )

    def plot(self, *, ax: Axes | None = None) -> Axes:
        """The slopes with their errors, on matplotlib axes."""
        from fit.redshift._plot import plot_trend

        return plot_trend(self, ax=ax)


def welch(binned: Any, steps: int) -> tuple[float, float]:
    """By what a scaled χ² is divided, and the degrees of freedom of its scale (Welch 1951), for `steps` contrasts."""
    weight, dof = information(binned)
    share = weight / weight.sum()
    spread = np.sum((1 - share) ** 2 / dof)
    k = steps + 1
    return 1 + 2 * (k - 2) / (k * k - 1) * spread, (k * k - 1) / (3 * spread)


def information(binned: Any) -> tuple[FloatArray, FloatArray]:
    """Weight of each bin with scaled errors, and the degrees of freedom of its scale."""
    size = len(binned.free)
    noise = [np.trace(binned.covariance[i : i + size, i : i + size]) for i in range(0, size * len(binned), size)]
    weight = 1 / np.array(noise) / binned.scales
    return weight, np.array([max(s.dof, 1) for s in binned.solutions])


def slope_of(estimate: tuple[FloatArray, float, FloatArray], q: int) -> float:
    """χ² of no slope, from what `gls` found for constants and slopes."""
    theta, _, spread = estimate
    return float(theta[q:] @ np.linalg.solve(spread[q:, q:], theta[q:]))


def equality_chi2(values: FloatArray, covariance: FloatArray) -> float:
    """χ² of the differences of independent bins: values (B, q), covariance (B, q, q)."""
    weight = np.linalg.inv(covariance)
    pull = np.einsum("bij,bj->bi", weight, values)
    return float(np.sum(values * pull) - pull.sum(0) @ np.linalg.solve(weight.sum(0), pull.sum(0)))


def slope_chi2(values: FloatArray, covariance: FloatArray, x: FloatArray) -> float:
    """χ² that a straight line takes away from independent bins: that of no slope."""
    weight = np.linalg.inv(covariance)
    design = np.stack([np.ones_like(x), x - x.mean()])
    normal = np.einsum("kb,lb,bij->kilj", design, design, weight).reshape(2 * weight.shape[1], -1)
    rhs = np.einsum("kb,bij,bj->ki", design, weight, values)
    return float(rhs.ravel() @ np.linalg.solve(normal, rhs.ravel()) - rhs[0] @ np.linalg.solve(weight.sum(0), rhs[0]))


#: From this share in a variance on, a flow matters to the tests of bins.
FLOW_MATTERS = 0.05
_BLOCK = 4096


@dataclass(frozen=True, eq=False)
class SharedFlow:
    """The modes of a flow over the distances of a catalogue, and what galaxies move beside it."""

    theory: LinearTheory
    modes: FlowModes
    dispersion: float

    def of(self, field: Field, rate: FloatArray, modes: Modes) -> tuple[Field, FloatArray]:
        """Sources with errors that hold their own motions, and X (p, m) of those within reach of the flow."""
        near = np.flatnonzero(rate > 0)
        distance = hubble_value(FLAT_PLANCK13) / 100 / (AU_PER_YEAR * rate[near])
        left = np.full(near.size, self.theory.sigma**2)
        reach = distance <= self.modes.radii[-1]
        left[reach] = self.modes.left(distance[reach])[0]
        added = np.zeros(len(field))
        added[near] = rate[near] ** 2 * (left + self.dispersion**2)
        sigma = np.sqrt(field.sigma**2 + added)
        field = field.with_errors(sigma, field.rho * np.prod(field.sigma, 0) / np.prod(sigma, 0))
        near, distance = near[reach], distance[reach]
        total = np.zeros((len(modes), len(self.modes)))
        a, b, c = field.weights
        for start in range(0, near.size, _BLOCK):
            rows, far = near[start : start + _BLOCK], distance[start : start + _BLOCK]
            east, north = self.modes.at(field.lon[rows], field.lat[rows], far)[0] * rate[rows, None]
            basis = harmonics(field.lon[rows], field.lat[rows], modes)
            total += (basis[:, 0] * a[rows] + basis[:, 1] * c[rows]) @ east
            total += (basis[:, 0] * c[rows] + basis[:, 1] * b[rows]) @ north
        return field, total


def _counts(field, low, high):
    if field.redshift is None:
        return 0.0
    inside = usable(field.redshift) & (field.redshift >= low) & (field.redshift < high)
    return flow_counts(field.redshift[inside], field.information[inside]) if inside.any() else 0.0


def shared_flow(
    field: Any, edges: FloatArray, theory: LinearTheory, dispersion: float | None, n_modes: int
) -> SharedFlow | None:
    """The flow of the sources between some redshifts; None where they are all beyond its reach."""
    low, high = max(edges[0], FLOW_LIMIT), max(edges[-1], FLOW_LIMIT)
    if isinstance(field, Field | Parts):
        counts = as_parts(field).sum(partial(_counts, low=low, high=high), roles=("redshift",), words="redshifts")
        if np.any(counts):
            low, high = flow_limits(counts)
    modes = modes_within((low, high), FLAT_PLANCK13, theory, n_modes)
    return None if modes is None else SharedFlow(theory, modes, LEFT_DISPERSION if dispersion is None else dispersion)
