"""What is known besides the motions: the amplitudes of a flow, the acceleration, the Local Group's velocity.

Each adds to the normal equations where they are solved, never to their sums.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from fit.secular_parallax._equations import A, ParallaxSums, U
from vsh.checks.types import FloatArray
from vsh.errors import ParameterError
from vsh.flows import FlowModes
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

    Returns
    -------
    tuple[ParallaxSums, Amplitudes]
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


@dataclass(frozen=True, eq=False)
class LocalGroup:
    """The Local Group's velocity as a measurement of the flow where we are.

    Given that velocity V, the amplitudes of the modes are c ± P on average, with

        c = Dᵀ (D Dᵀ + Σ)⁻¹ V,   P = (1 + Dᵀ Σ⁻¹ D)⁻¹,

    D the modes where we are and Σ what else there is in V. The motions tell amplitudes times h = H0/H_ref, so that their
    mean is h c; P stands for H_ref, as all variances of the flow. This is linear in h, and the Group's speed by itself
    says nothing of H0: had h been taken as known, or V as drawn from flows of known size, H_ref would come back.

    Attributes
    ----------
    modes : FlowModes
    velocity : (3,) array
        V, in the frame of the microwave background, along the axes of the equations. [km/s]
    covariance : (3, 3) array
        Σ: of its measurement, of linear motions that the modes leave, and of motions that are none.
    """

    modes: FlowModes
    velocity: FloatArray
    covariance: FloatArray

    def added(self, sums: ParallaxSums, width: int, ratio: float, ours: FloatArray | None) -> ParallaxSums:
        """Normal equations, the flow's prior among them, with this measurement as well."""
        here = self.modes.at_origin()
        across = here.T @ np.linalg.inv(self.covariance) / ratio**2
        mean = here.T @ np.linalg.solve(here @ here.T + self.covariance, self.velocity)
        pull, size = across @ self.velocity, self.velocity @ across.T @ mean
        matrix, rhs, chi2_null = sums.matrix.copy(), sums.rhs.copy(), sums.chi2_null
        matrix[width:, width:] += across @ here
        if ours is None:
            rhs[width:] += pull * ratio
            chi2_null = chi2_null + size * ratio**2
        else:
            toward = ours / (ours @ ours)
            matrix[U, U] += size * np.outer(toward, toward)
            matrix[width:, U] -= np.outer(pull, toward)
            matrix[U, width:] = matrix[width:, U].T
        return replace(sums, matrix=matrix, rhs=rhs, chi2_null=chi2_null)
