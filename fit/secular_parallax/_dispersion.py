"""What the residuals say of the dispersion of peculiar velocities.

The motions of near galaxies scatter by σ_pec/d. The likelihood of that dispersion, with velocity, acceleration and flow
marginalised, is taken on a grid: of the sources that tell most of it, those with the largest k/σ, which are chosen by
their distances and errors and not by their motions.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.interpolate import CubicSpline

from fit.secular_parallax._equations import OMEGA, ParallaxEquations
from fit.secular_parallax._solve import with_acceleration, with_flow, without_flow
from vsh.field import Field
from vsh.tools.errors import ParameterError
from vsh.tools.types import FloatArray
from vsh.vector import Vector

#: Dispersions that are tried. [km/s]
GRID = np.array([0.0, 40.0, 80.0, 120.0, 160.0, 210.0, 270.0, 350.0, 450.0, 600.0, 800.0, 1050.0, 1400.0])
_SOURCES = 4000


@dataclass(frozen=True)
class Preferred:
    """The dispersion that the residuals prefer."""

    best: float
    low: float
    high: float
    gain: float

    @property
    def constrained(self) -> bool:
        """Whether residuals constrain it: 68 % of the likelihood within a third of what was tried, not at its end."""
        return self.high - self.low < GRID[-1] / 3 and self.high < 0.95 * GRID[-1]


def preferred_dispersion(
    rows: ParallaxEquations,
    taken: float,
    excess_noise: float,
    acceleration: Vector | None,
    ratio: float,
    spin: Literal["free"] | Vector | None = None,
) -> Preferred:
    """The likelihood of the dispersion beside the flow and the spin; `taken` is that of the estimate. [km/s]"""
    few = rows.most_sensitive(_SOURCES)
    sums = with_acceleration(few.sums(GRID * ratio, excess_noise, ratio=ratio), acceleration, rows.frame)
    if rows.modes is not None:
        sums, _ = without_flow(with_flow(sums, few.design.shape[1], np.full(len(GRID), ratio)), few.design.shape[1])
    matrix, rhs, null = np.array(sums.matrix), sums.rhs, sums.chi2_null
    keep = slice(0, OMEGA.start if spin is None else OMEGA.stop)
    if isinstance(spin, Vector):  # what is known is taken away, and its error is a prior on what is left
        known = spin.to_frame(rows.frame)
        across = matrix[:, :, OMEGA] @ known.value
        null = null - 2 * rhs[:, OMEGA] @ known.value + across[:, OMEGA] @ known.value
        rhs = rhs - across
        if np.linalg.det(known.covariance) > 0:
            matrix[:, OMEGA, OMEGA] += np.linalg.inv(known.covariance)
        else:
            keep = slice(0, OMEGA.start)
    n, b = matrix[:, keep, keep], rhs[:, keep]
    n = n + 1e-12 * np.trace(n, axis1=1, axis2=2)[:, None, None] * np.eye(n.shape[1])
    chi2 = null - np.einsum("gi,gi->g", b, np.linalg.solve(n, b[..., None])[..., 0])
    log = -(chi2 + sums.logdet + np.linalg.slogdet(n)[1]) / 2
    return _summary(log, taken)


def _summary(log: FloatArray, taken: float) -> Preferred:
    """From ln L on the grid."""
    curve = CubicSpline(GRID, log)
    fine = np.linspace(0, GRID[-1], 1401)
    values = curve(fine)
    best = int(np.argmax(values))
    share = np.cumsum(np.exp(values - values[best]))
    low, high = np.interp([0.15865525, 0.84134475], share / share[-1], fine)
    gain = values[best] - float(curve(min(taken, GRID[-1])))
    return Preferred(float(fine[best]), float(low), float(high), float(max(gain, 0.0)))


def freed(estimate: Callable[..., Any], field: Any, word: str, most: float = float("inf")) -> Any:
    """An estimate with the dispersion that its residuals prefer, `most` at most; its uncertainty adds to the errors."""
    if word != "free":
        raise ParameterError(f"a dispersion is a number [km/s], or 'free', not {word!r}")
    if not isinstance(field, Field):
        raise ParameterError("a dispersion that is free needs the sources in memory: give a Field, not parts")
    solution = estimate()
    first, most = solution.peculiar_dispersion, min(most, GRID[-1])
    for _ in range(6):
        preferred = solution.preferred
        if not preferred.constrained:
            note = f"the residuals do not tell the dispersion of peculiar velocities: {first:g} km/s are taken"
            return replace(estimate(), notes=(*solution.notes, note))
        best = min(preferred.best, most)
        if abs(best - solution.peculiar_dispersion) < 0.02 * max(best, 50.0):
            break
        solution = estimate(peculiar_dispersion=best)
    ends = [estimate(peculiar_dispersion=min(x, most)) for x in (preferred.low, preferred.high)]
    if preferred.best > most:
        more = (
            f"warning: the residuals prefer {preferred.best:.0f} km/s beside the flows, more than these leave: "
            f"{most:.0f} are taken; without flows (flows=None, --no-flows) it is what they prefer"
        )
        solution = replace(solution, notes=(*solution.notes, more))
    shift = (ends[1].values - ends[0].values) / 2
    note = (
        f"the dispersion of peculiar velocities is what the residuals prefer, {preferred.low:.0f} to "
        f"{preferred.high:.0f} km/s (68 %)"
    )
    return replace(solution, covariance=solution.covariance + np.outer(shift, shift), notes=(*solution.notes, note))
