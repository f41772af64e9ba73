"""What is known besides the motions: the amplitudes of a flow, the acceleration, the Local Group's velocity.

Each adds to the normal equations where they are solved, never to their sums.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.secular_parallax._equations import A, ParallaxSums, U
from vsh.errors import ParameterError
from vsh.flows import FlowModes
from vsh.types import FloatArray
from vsh.vector import Vector


def with_acceleration(sums: ParallaxSums, acceleration: Vector | None, frame: str) -> ParallaxSums:
    """The same with the acceleration known from elsewhere, from quasars say.

    Parameters
    ----------
    sums : ParallaxSums
        Of a catalogue.
    acceleration : Vector or None
        With its covariance. [µas/yr]
    frame : str
        Of the axes.

    Raises
    ------
    ParameterError
        If it is no Vector, or has no errors.
    """
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
    """The same with amplitudes of the modes that are `scale` on average.

    Parameters
    ----------
    sums : ParallaxSums
        Whose columns beyond `width` are modes.
    width : int
        How many columns there are before.
    scale : float or array
        H0/H_ref, times the flow's amplitude where that is not one; one for each of the sums.
    """
    matrix = sums.matrix.copy()
    modes = np.arange(width, matrix.shape[-1])
    matrix[..., modes, modes] += 1 / np.asarray(scale)[..., None] ** 2
    count = len(modes) * np.log(np.asarray(scale) ** 2)
    return replace(sums, matrix=matrix, logdet=sums.logdet + count)


def with_local_group(
    sums: ParallaxSums, modes: FlowModes, velocity: Vector, scatter: float, ratio: float, width: int
) -> ParallaxSums:
    """The same with the Local Group's velocity as what the flow is where we are, for a known H0.

    Parameters
    ----------
    sums : ParallaxSums
        With the flow's prior.
    modes : FlowModes
        Of the flow.
    velocity : Vector
        Of the Local Group in the microwave background, along the axes of the equations. [km/s]
    scatter : float
        By which it departs from the flow of the modes: of linear motions that they leave, and of motions that are
        none. [km/s]
    ratio : float
        H0/H_ref: amplitudes of the modes are in units of it, as all that the motions tell.
    width : int
        How many columns there are before the modes.
    """
    weight = np.linalg.inv(velocity.covariance + scatter**2 * np.eye(3))
    rows = modes.at_origin() / ratio
    matrix, rhs = sums.matrix.copy(), sums.rhs.copy()
    matrix[width:, width:] += rows.T @ weight @ rows
    rhs[width:] += rows.T @ weight @ velocity.value
    return replace(sums, matrix=matrix, rhs=rhs, chi2_null=sums.chi2_null + velocity.value @ weight @ velocity.value)


def hubble_with_local_group(
    sums: ParallaxSums, modes: FlowModes, velocity: Vector, scatter: float, ours: FloatArray, width: int, solve: Any
) -> tuple[float, ParallaxSums]:
    """H0/H_ref at which motions and the Local Group agree best, and the equations about it.

    The motions tell the flow in units of H0, the Local Group in km/s: where the flow is seen, the two tell H0. That is
    no linear problem; were H0 taken as known in it, the assumed one would come back. The likelihood, all else
    marginalised, is followed to its maximum.

    Parameters
    ----------
    sums, modes, velocity, scatter, width
        As for `with_local_group`.
    ours : (3,) array
        Our own velocity. [km/s]
    solve : function
        From sums and H0/H_ref to −2 log of the likelihood.
    """
    from scipy.optimize import minimize_scalar

    def misfit(log_ratio):
        ratio = float(np.exp(log_ratio))
        left, _ = without_flow(with_local_group(sums, modes, velocity, scatter, ratio, width), width)
        return solve(left, ratio)

    steps = np.log(np.geomspace(0.05, 8.0, 40))
    best = int(np.argmin([misfit(step) for step in steps]))
    low, high = steps[max(best - 1, 0)], steps[min(best + 1, len(steps) - 1)]
    ratio = float(np.exp(minimize_scalar(misfit, bounds=(low, high), method="bounded", options={"xatol": 1e-7}).x))
    fixed = with_local_group(sums, modes, velocity, scatter, ratio, width)
    u = ours * ratio
    amplitudes = np.linalg.solve(fixed.matrix[width:, width:], fixed.rhs[width:] - fixed.matrix[width:, U] @ u)
    # The flow where we are is D c/(H0/H_ref), to first order about what was found.
    here = modes.at_origin()
    rows = np.zeros((3, sums.matrix.shape[-1]))
    rows[:, width:] = here / ratio
    rows[:, U] = -np.outer(here @ amplitudes, ours) / (ours @ ours) / ratio**2
    weight = np.linalg.inv(velocity.covariance + scatter**2 * np.eye(3))
    known = velocity.value - here @ amplitudes / ratio
    about = replace(
        sums,
        matrix=sums.matrix + rows.T @ weight @ rows,
        rhs=sums.rhs + rows.T @ weight @ known,
        chi2_null=sums.chi2_null + known @ weight @ known,
    )
    return ratio, about


@dataclass(frozen=True, eq=False)
class Amplitudes:
    """What the motions tell of a flow's modes, given the other parameters θ: mean − slope θ, and a covariance.

    Attributes
    ----------
    mean : (p,) array
    slope : (p, q) array
    covariance : (p, p) array
    """

    mean: FloatArray
    slope: FloatArray
    covariance: FloatArray


def without_flow(sums: ParallaxSums, width: int) -> tuple[ParallaxSums, Amplitudes]:
    """The modes marginalised: normal equations of what is left, and the modes given that.

    Parameters
    ----------
    sums : ParallaxSums
        With the flow's prior; perhaps several, along a leading axis.
    width : int
        How many columns there are before the modes.
    """
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
    covariance = np.linalg.inv(inner) if inner.ndim == 2 else np.empty(0)
    return left, Amplitudes(mean, slope, covariance)
