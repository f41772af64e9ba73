"""What is known besides the motions: the amplitudes of a flow, the acceleration, the Local Group's velocity.

Each adds to the normal equations where they are solved, never to their sums.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

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


@dataclass(frozen=True, eq=False)
class LocalGroup:
    """The Local Group's velocity as a measurement of the flow where we are.

    The modes' amplitudes c are in units of H0/H_ref = h, as all that the motions tell, and the velocity is in km/s:
    V h = D c + noise, with D the modes where we are.

    Attributes
    ----------
    modes : FlowModes
    velocity : (3,) array
        V, in the frame of the microwave background, along the axes of the equations. [km/s]
    covariance : (3, 3) array
        Of V as a measurement of the modes' flow: of linear motions that they leave, and of motions that are none, too.
    """

    modes: FlowModes
    velocity: FloatArray
    covariance: FloatArray

    def added(
        self,
        left: ParallaxSums,
        flow: Amplitudes,
        ratio: float,
        ours: FloatArray | None = None,
        here_found: FloatArray | None = None,
    ) -> tuple[ParallaxSums, Amplitudes]:
        """Normal equations, and the flow given the other parameters, with this measurement as well.

        Parameters
        ----------
        left : ParallaxSums
            Of `without_flow`.
        flow : Amplitudes
            Of `without_flow`.
        ratio : float
            h.
        ours, here_found : (3,) arrays, optional
            Where h is not known but u·v/v², to first order about `ratio`: our velocity v, and D c as it was found. [km/s]
        """
        here = self.modes.at_origin()
        change = here @ flow.slope
        known = self.velocity * ratio
        if ours is not None and here_found is not None:
            change[:, U] += np.outer(here_found, ours) / (ours @ ours) / ratio
            known = known - here_found
        across = flow.covariance @ here.T
        spread = here @ across + self.covariance * ratio**2
        weight = np.linalg.inv(spread)
        away = known - here @ flow.mean
        sums = replace(
            left,
            matrix=left.matrix + change.T @ weight @ change,
            rhs=left.rhs - change.T @ weight @ away,
            chi2_null=left.chi2_null + away @ weight @ away,
            logdet=left.logdet + np.linalg.slogdet(spread)[1] - 6 * np.log(ratio),
        )
        gain = across @ weight
        return sums, Amplitudes(flow.mean + gain @ away, flow.slope - gain @ change, flow.covariance - gain @ across.T)

    def follow(self, left: ParallaxSums, flow: Amplitudes, misfit: Callable[[ParallaxSums, float], float]) -> float:
        """H0/H_ref at which motions and the Local Group agree best.

        That is no linear problem; were H0 taken as known in it, the assumed one would come back.

        Parameters
        ----------
        left : ParallaxSums
            Of `without_flow`.
        flow : Amplitudes
            Of `without_flow`.
        misfit : function
            From sums and H0/H_ref to −2 log of the likelihood.
        """
        from scipy.optimize import minimize_scalar

        def at(log_ratio):
            ratio = float(np.exp(log_ratio))
            return misfit(self.added(left, flow, ratio)[0], ratio)

        steps = np.log(np.geomspace(0.05, 8.0, 40))
        best = int(np.argmin([at(step) for step in steps]))
        bounds = steps[max(best - 1, 0)], steps[min(best + 1, len(steps) - 1)]
        return float(np.exp(minimize_scalar(at, bounds=bounds, method="bounded", options={"xatol": 1e-7}).x))
