"""Least squares on the equations of the secular parallax, with what is known besides."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from fit.secular_parallax._equations import OMEGA, ParallaxEquations, ParallaxSums, V
from fit.secular_parallax._flow import flow_of
from fit.secular_parallax._known import LocalGroup, with_acceleration, with_flow, without_flow
from fit.secular_parallax._left_out import flow_covariance
from fit.secular_parallax._parts import ParallaxParts
from vsh.checks.types import FloatArray
from vsh.errors import DegeneracyError, ParameterError
from vsh.vector import Vector


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

    `to_u` is (9 or 12, p), `ratio` H0/H_ref in the weights, `group` a measurement of the flow where we are, `velocity` ours
    where H0 is the first of θ; `left_out` are the sums with the columns of a flow that the fit leaves out. Returns what a
    solution is made with.
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
    found = {
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
        found["flow_covariance"] = flow_covariance(left_out, to_u, ratio)
    if amplitudes is not None:
        found["flow"] = flow_of(rows, amplitudes, to_u @ values + fixed, to_u, covariance, ratio)
    return found


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
