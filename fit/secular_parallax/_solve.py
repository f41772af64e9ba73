"""Least squares on the equations of the secular parallax, with what is known besides.

What is known besides the motions: the amplitudes of a flow, the acceleration, the Local Group's velocity.

Each adds to the normal equations where they are solved, never to their sums.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal

import numpy as np

from fit.distances import Calibration
from fit.secular_parallax._equations import OMEGA, A, ParallaxEquations, ParallaxParts, ParallaxSums, U, V, equations
from fit.secular_parallax._flow import flow_of
from vsh.field import Field
from vsh.io.parts import Parts
from vsh.models.flows import FlowModes
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.types import FloatArray
from vsh.vector import Vector


def with_acceleration(sums: ParallaxSums, acceleration: Vector | None, frame: str) -> ParallaxSums:
    """The same with the acceleration known from elsewhere, from quasars say."""
    if acceleration is None:
        return sums
    if not isinstance(acceleration, Vector):
        raise ParameterError(f"the acceleration is a Vector with its covariance, not {type(acceleration).__name__}")
    known = acceleration.to_frame(frame)
    if not np.linalg.eigvalsh(known.covariance)[0] > 0:
        raise ParameterError("an acceleration that is known needs errors in all three components")
    weight = np.linalg.inv(known.covariance)
    matrix, rhs = sums.matrix.copy(), sums.rhs.copy()
    matrix[..., A, A] += weight
    rhs[..., A] += weight @ known.value
    return replace(sums, matrix=matrix, rhs=rhs, chi2_null=sums.chi2_null + known.value @ weight @ known.value)


def with_flow(sums: ParallaxSums, width: int, scale: FloatArray | float) -> ParallaxSums:
    """The same with amplitudes of the modes that are `scale` on average."""
    matrix = sums.matrix.copy()
    modes = np.arange(width, matrix.shape[-1])
    matrix[..., modes, modes] += 1 / np.asarray(scale)[..., None] ** 2
    count = len(modes) * np.log(np.asarray(scale) ** 2)
    return replace(sums, matrix=matrix, logdet=sums.logdet + count)


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """What the motions tell of a flow's modes, given the other parameters θ: mean − slope θ, and a covariance."""

    mean: FloatArray
    slope: FloatArray
    covariance: FloatArray


def without_flow(sums: ParallaxSums, width: int) -> tuple[ParallaxSums, Amplitudes]:
    """The modes marginalised: normal equations of what is left, and the modes given that."""
    own, modes = slice(0, width), slice(width, None)
    matrix, rhs = sums.matrix, sums.rhs
    inner = matrix[..., modes, modes]
    root = np.linalg.cholesky(inner)
    logdet = 2 * np.log(np.einsum("...ii->...i", root)).sum(-1)
    solved = np.linalg.solve(inner, np.concatenate([matrix[..., modes, own], rhs[..., modes, None]], axis=-1))
    slope, mean = solved[..., :-1], solved[..., -1]
    across = matrix[..., own, modes]
    left = ParallaxSums(
        matrix[..., own, own] - across @ slope,
        rhs[..., own] - np.einsum("...ij,...j->...i", across, mean),
        sums.chi2_null - np.einsum("...i,...i->...", rhs[..., modes], mean),
        sums.logdet + logdet,
        sums.n_data,
    )
    covariance = np.asarray(np.linalg.inv(inner) if inner.ndim == 2 else (), float)
    return left, Amplitudes(mean, slope, covariance)


@dataclass(frozen=True, eq=False)
class LocalGroup:
    """The Local Group's velocity as a measurement of the flow where we are.

    Given that velocity V, the amplitudes of the modes are c ± P on average, with

        c = Dᵀ (D Dᵀ + Σ)⁻¹ V,   P = (1 + Dᵀ Σ⁻¹ D)⁻¹,

    D the modes where we are and Σ what else there is in V. The motions tell amplitudes times h = H0/H_ref, so that
    their mean is h c; P stands for H_ref, as all variances of the flow. This is linear in h, and the Group's speed by
    itself says nothing of H0: had h been taken as known, or V as drawn from flows of known size, H_ref would come back.
    """

    modes: FlowModes
    velocity: FloatArray
    covariance: FloatArray

    def added(self, sums: ParallaxSums, width: int, ratio: float, ours: FloatArray | None) -> ParallaxSums:
        """Normal equations with this measurement as well; they hold the flow's prior already. `ratio` is H0/H_ref."""
        here = self.modes.at_origin()
        gain = here.T @ np.linalg.inv(self.covariance) / ratio**2
        mean = here.T @ np.linalg.solve(here @ here.T + self.covariance, self.velocity)
        pull = gain @ self.velocity
        size = pull @ mean
        matrix, rhs, chi2_null = sums.matrix.copy(), sums.rhs.copy(), sums.chi2_null
        matrix[width:, width:] += gain @ here
        if ours is None:
            rhs[width:] += pull * ratio
            chi2_null = chi2_null + size * ratio**2
        else:
            toward = ours / (ours @ ours)
            matrix[U, U] += size * np.outer(toward, toward)
            matrix[width:, U] -= np.outer(pull, toward)
            matrix[U, width:] = matrix[width:, U].T
        return replace(sums, matrix=matrix, rhs=rhs, chi2_null=chi2_null)


#: Size of the subsample; it determines the omitted flow to a few per cent.
_SOURCES = 20_000


@dataclass(frozen=True, eq=False)
class LeftOut:
    """A catalogue that is fitted without a flow, and the modes that would describe it."""

    field: Field | Parts
    calibration: Calibration
    modes: FlowModes
    options: dict[str, Any]

    def sums(self, spread: float, excess_noise: float, n_sources: int) -> ParallaxSums:
        """Normal matrix and right-hand side with the flow's columns, from a subsample, scaled to all sources."""
        step = max(1, n_sources // _SOURCES)
        subsample = (
            self.field.map(partial(_every_nth, step=step)) if isinstance(self.field, Parts) else self.field[::step]
        )
        rows = equations(subsample, self.calibration, modes=self.modes, **self.options)
        sums = rows.sums(spread, excess_noise)
        scale = n_sources / (sums.n_data // 2)  # of small parts more than one in `step` is taken
        return replace(sums, matrix=sums.matrix * scale, rhs=sums.rhs * scale)


def flow_covariance(sums: ParallaxSums, to_u: FloatArray, ratio: float) -> FloatArray:
    """The covariance that an omitted flow induces in the fitted parameters."""
    width = len(to_u)
    normal = to_u.T @ sums.matrix[:width, :width] @ to_u
    response = np.linalg.solve(normal, to_u.T @ sums.matrix[:width, width:]) * ratio
    return response @ response.T


def _every_nth(field, step):
    return field[::step]


def solve_for(
    sums: ParallaxSums,
    to_u: FloatArray,
    names: tuple[str, ...],
    spin: Literal["free"] | Vector | None,
    rows: ParallaxEquations | ParallaxParts,
    acceleration: Vector | None,
    ratio: float,
    group: LocalGroup | None = None,
    velocity: FloatArray | None = None,
    left_out: ParallaxSums | None = None,
) -> dict[str, Any]:
    """Least squares for θ with (u, ã, ω[, v]) = to_u θ: the spin fixed, free or none, the flow marginalised.

    `to_u` is (9 or 12, p), `ratio` H0/H_ref in the weights, `group` a measurement of the flow where we are, `velocity`
    ours where H0 is the first of θ; `left_out` are the sums with the columns of a flow that the fit leaves out. Returns
    what a solution is made with.
    """
    width = 9 if velocity is None else 12
    sums = with_acceleration(sums, acceleration, rows.frame)
    alone, amplitudes = sums.matrix[:width, :width], None
    if isinstance(spin, str) and spin == "free":
        to_u = np.concatenate([to_u, np.eye(width)[:, OMEGA]], axis=1)
        names = (*names, "omega_x", "omega_y", "omega_z")
    elif spin is not None and not isinstance(spin, Vector):
        raise ParameterError(f"spin is None, 'free' or a Vector, not {spin!r}")
    fixed = np.zeros(width)
    if velocity is not None:
        fixed[V] = velocity
    if isinstance(spin, Vector):
        spin = spin.to_frame(rows.frame)
        fixed[OMEGA] = spin.value
    if rows.modes is not None:
        sums = with_flow(sums, width, ratio)
        if group is not None:
            sums = group.added(sums, width, ratio, velocity)
        sums, amplitudes = without_flow(sums, width)
    normal = to_u.T @ sums.matrix @ to_u
    check_determined(normal, names, sums.n_data // 2)
    inverse = np.linalg.inv(normal)
    covariance = (inverse + inverse.T) / 2
    rhs = to_u.T @ (sums.rhs - sums.matrix @ fixed)
    values = inverse @ rhs
    chi2 = sums.chi2_null - 2 * sums.rhs @ fixed + fixed @ sums.matrix @ fixed - values @ rhs
    noise = np.linalg.inv(to_u.T @ alone @ to_u) if rows.modes is not None else covariance
    if isinstance(spin, Vector):
        carry = covariance @ to_u.T @ sums.matrix[:, OMEGA]
        covariance = covariance + carry @ spin.covariance @ carry.T
    parts = {
        "names": names,
        "values": values,
        "covariance": covariance,
        "chi2": float(chi2),
        "n_data": sums.n_data,
        "frame": rows.frame,
        "notes": rows.notes,
        "noise_covariance": noise,
    }
    if left_out is not None:
        left_out = with_acceleration(left_out, acceleration, rows.frame)
        parts["flow_covariance"] = flow_covariance(left_out, to_u, ratio)
    if amplitudes is not None:
        parts["flow"] = flow_of(rows, amplitudes, to_u @ values + fixed, to_u, covariance, ratio)
    return parts


def check_determined(matrix: FloatArray, names: Sequence[str], sources: int, limit: float = 1e10) -> None:
    """Raise DegeneracyError where the data leave a combination of parameters unseen."""
    diagonal = np.diag(matrix)
    if 2 * sources >= len(names) and (diagonal > 0).all():
        scaled = matrix / np.sqrt(np.outer(diagonal, diagonal))
        values = np.linalg.eigvalsh(scaled)
        if values[0] * limit > values[-1]:
            return
    raise DegeneracyError(
        f"{sources} sources cannot separate {', '.join(names)}: more sources, over more of the sky and of "
        "more than one distance, are needed"
    )
