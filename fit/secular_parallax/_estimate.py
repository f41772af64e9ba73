"""Our velocity for a known Hubble constant, or the Hubble constant for a known velocity.

Least squares as in Bachchan, Hobbs & Lindegren (2016, A&A 589, A71), sect. 4. Velocities are
ours with respect to the background and point toward the apex; galaxies move the other way.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from fit.secular_parallax._equations import OMEGA, A, U, check_determined
from fit.secular_parallax._parts import parallax_equations
from fit.secular_parallax._solution import HubbleSolution, VelocitySolution
from vsh.checks import arguments
from vsh.cosmology import velocity_along
from vsh.errors import DegeneracyError, ParameterError
from vsh.field import Field
from vsh.parts import Parts
from vsh.types import ArrayLike, Cosmology
from vsh.vector import Vector

_PRODUCT = "the proper motions constrain only the product of our velocity and the Hubble constant, v · H0"


@arguments.accepts(
    field=arguments.a(Field, Parts),
    hubble=arguments.positive,
    excess_noise=arguments.not_negative,
    peculiar_dispersion=arguments.not_negative,
)
def observer_velocity(
    field: Field | Parts,
    hubble: float | None = None,
    *,
    cosmology: Cosmology | None = None,
    peculiar_dispersion: float = 750.0,
    spin: Literal["free"] | Vector | None = None,
    excess_noise: float = 0.0,
) -> VelocitySolution:
    """Our velocity and the acceleration, θ = (v, ã), for a known Hubble constant.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4 (`vsh.cosmology.with_redshift`, also as a step of parts).
    hubble : float
        H0. [km/s/Mpc]
    cosmology : astropy cosmology, optional
        The shape of the distance; its own H0 does not count. Flat, Ω_m = 0.315 unless given.
    peculiar_dispersion : float
        Dispersion of the peculiar velocities in each component, which adds (σ_pec/d)² to
        every variance. [km/s]
    spin : None, "free" or Vector
        None takes the frame not to spin; a Vector (of the quasars, say) is held fixed and its
        covariance propagated. [µas/yr]
    excess_noise : float
        Noise beyond the catalogue's, in each component. [µas/yr]

    Returns
    -------
    VelocitySolution

    Raises
    ------
    DegeneracyError
        Without a Hubble constant, or if the sources cannot tell the parameters apart.
    ParameterError
        If H0 is not positive.
    FieldError
        If a redshift is missing, not positive or below the flow; the message counts them.
    """
    if hubble is None:
        raise DegeneracyError(
            f"{_PRODUCT}: give hubble=, or a velocity to fit.secular_parallax.hubble_constant, or priors to fit.posterior.sample"
        )
    rows = parallax_equations(field, cosmology)
    ratio = hubble / rows.hubble
    sums = rows.sums(peculiar_dispersion * ratio, excess_noise)
    to_u = np.eye(9)
    to_u[U, U] *= ratio  # u = v H0/H_ref
    names = ("v_x", "v_y", "v_z", "a_x", "a_y", "a_z")
    found = _solve(sums, to_u[:, : OMEGA.start], names, spin, rows)
    return VelocitySolution(**found, peculiar_dispersion=peculiar_dispersion, assumed_hubble=hubble)


@arguments.accepts(
    field=arguments.a(Field, Parts),
    hubble=arguments.positive,
    excess_noise=arguments.not_negative,
    peculiar_dispersion=arguments.not_negative,
)
def hubble_constant(
    field: Field | Parts,
    velocity: str | Vector | ArrayLike | None = None,
    *,
    cosmology: Cosmology | None = None,
    peculiar_dispersion: float = 750.0,
    spin: Literal["free"] | Vector | None = None,
    excess_noise: float = 0.0,
    hubble: float | None = None,
) -> HubbleSolution:
    """The Hubble constant and the acceleration, θ = (H0, ã), for a known velocity.

    Parameters
    ----------
    field, cosmology, peculiar_dispersion, spin, excess_noise
        As for `observer_velocity`.
    velocity : "planck", "paper", Vector or (3,) array
        Ours, toward the apex; an array is along the field's axes. The covariance of a Vector
        is propagated. [km/s]
    hubble : float, optional
        The H0 for which the peculiar velocities are weighed; the cosmology's unless given. It
        shifts no expectation. [km/s/Mpc]

    Returns
    -------
    HubbleSolution

    Raises
    ------
    DegeneracyError, ParameterError, FieldError
        As for `observer_velocity`; ParameterError too for a velocity of zero length.
    """
    if velocity is None:
        raise DegeneracyError(
            f"{_PRODUCT}: give velocity=, or a Hubble constant to fit.secular_parallax.observer_velocity, or priors to "
            "fit.posterior.sample"
        )
    rows = parallax_equations(field, cosmology)
    velocity = velocity_along(velocity, rows.frame)
    ratio = 1.0 if hubble is None else hubble / rows.hubble
    sums = rows.sums(peculiar_dispersion * ratio, excess_noise)
    names = ("H0", "a_x", "a_y", "a_z")

    def given(v):
        to_u = np.zeros((9, 4))
        to_u[U, 0] = v / rows.hubble
        to_u[A, 1:] = np.eye(3)
        return _solve(sums, to_u, names, spin, rows)

    found = given(velocity.value)
    if velocity.covariance.any():
        step = 1e-4 * velocity.amplitude
        slopes = np.stack(
            [(given(velocity.value + s)["values"] - given(velocity.value - s)["values"]) / (2 * step)
             for s in step * np.eye(3)], axis=1,
        )  # fmt: skip
        found["covariance"] = found["covariance"] + slopes @ velocity.covariance @ slopes.T
    return HubbleSolution(**found, peculiar_dispersion=peculiar_dispersion, assumed_velocity=velocity)


def _solve(sums, to_u, names, spin, rows):
    """Least squares for θ with (u, ã, ω) = to_u θ, and the spin fixed, free or none."""
    matrix, rhs, chi2_null = sums.matrix, sums.rhs, sums.chi2_null
    if isinstance(spin, str) and spin == "free":
        to_u = np.concatenate([to_u, np.eye(9)[:, OMEGA]], axis=1)
        names = (*names, "omega_x", "omega_y", "omega_z")
    elif spin is not None and not isinstance(spin, Vector):
        raise ParameterError(f"spin is None, 'free' or a Vector, not {spin!r}")
    normal = to_u.T @ matrix @ to_u
    check_determined(normal, names, sums.n_data // 2)
    inverse = np.linalg.inv(normal)
    covariance = (inverse + inverse.T) / 2
    if isinstance(spin, Vector):
        spin = spin.to_frame(rows.frame)
        chi2_null = chi2_null - 2 * rhs[OMEGA] @ spin.value + spin.value @ matrix[OMEGA, OMEGA] @ spin.value
        rhs = rhs - matrix[:, OMEGA] @ spin.value
        carry = covariance @ to_u.T @ matrix[:, OMEGA]
        covariance = covariance + carry @ spin.covariance @ carry.T
    rhs = to_u.T @ rhs
    values = inverse @ rhs
    return {
        "names": names,
        "values": values,
        "covariance": covariance,
        "chi2": float(chi2_null - values @ rhs),
        "n_data": sums.n_data,
        "frame": rows.frame,
        "notes": rows.notes,
    }
