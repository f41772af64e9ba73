"""The motion of the Sun, and Oort's constants, from motions of stars, clusters or masers at known distances.

To first order in the distance d the velocity of sources at d r with respect to the Sun is −v + M d r: their mean motion
past us, and a gradient (Ogorodnikov 1932, Z. Astrophys. 4, 190; Milne 1935, MNRAS 95, 560). Proper motions tell its
rotation and its shear:

    µ = (−v_⊥/d + ω × r + (S r)_⊥) / 4.740470,

and nothing of an expansion alike in all directions. In Galactic axes (x to the centre, y along the rotation, z north)

    A = S_xy,  B = ω_z,  C = (S_xx − S_yy)/2,  K = (S_xx + S_yy)/2 − S_zz.
"""

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from fit.distances import inverse_distances_from_measurements
from fit.results.solution import NamedSolution
from vsh.field import Field, multiply_weights
from vsh.io import tables
from vsh.io.sections import Section
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.arguments import choice, not_negative, positive
from vsh.tools.digits import format_with_error
from vsh.tools.errors import DegeneracyError, ParameterError
from vsh.tools.types import FloatArray
from vsh.tools.units import AU_PER_YEAR, SPEED_OF_LIGHT
from vsh.vector import GAIA_EDR3, Vector

_VELOCITY_NAMES = ("v_x", "v_y", "v_z")
_GRADIENT_NAMES = ("w_x", "w_y", "w_z", "A", "C", "K", "S_xz", "S_yz")
#: A median distance above this is one of galaxies. [Mpc]
_NEAREST_GALAXIES = 1.0
#: From km/s/kpc to µas/yr.
_KM_S_KPC = 1000 / AU_PER_YEAR
#: Symmetric tensors of A, C, K, S_xz and S_yz; K is of the plane against the pole.
_SHEAR_TENSORS = np.array([
    [[0, 1, 0], [1, 0, 0], [0, 0, 0]],
    [[1, 0, 0], [0, -1, 0], [0, 0, 0]],
    [[1, 0, 0], [0, 1, 0], [0, 0, 0]],
    [[0, 0, 1], [0, 0, 0], [1, 0, 0]],
    [[0, 0, 0], [0, 0, 1], [0, 1, 0]],
], float)  # fmt: skip
#: Largest velocity dispersion that is tried. [km/s]
_LARGEST_DISPERSION = 3000.0


@dataclass(frozen=True, eq=False, kw_only=True)
class Kinematics(NamedSolution):
    """Our velocity with respect to sources at known distances, and the gradient of their velocities.

    Attributes
    ----------
    names : tuple of str
        v_x, v_y, v_z [km/s]; with a gradient also w_x, w_y, w_z, A, C, K, S_xz, S_yz [km/s/kpc].
    values : (p,) array
    covariance : (p, p) array
        From the scatter of the sources about the model, source by source, and from what another density of the sources
        would change.
    chi2 : float
        For the dispersion that was found.
    n_data : int
    frame : str
    notes : tuple of str
    dispersion : float
        Dispersion of the velocities about the model, in each component. [km/s]
    length : float
        Scale length of the density of sources, by which distances were inverted. [kpc]
    power : float
        Power of that density.
    covariance_dof : float
        Degrees of freedom of the covariance, by which p-values and limits of few sources are those of Student's t.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> from dataclasses import replace
    >>> near = replace(field, distance=np.full(500, 1e-3), distance_error=np.full(500, 1e-5))
    >>> kinematics(near, gradient=True, dispersion=10.0).values.shape
    (11,)
    """

    dispersion: float = np.nan
    length: float = np.nan
    power: float = 2.0
    covariance_dof: float = np.inf

    @property
    def velocity(self) -> Vector:
        """Our velocity with respect to the sources, toward its apex, a Vector in km/s."""
        return replace(self._make_vector("v", "km/s"), dof=self.covariance_dof)

    @property
    def rotation(self) -> Vector | None:
        """ω of the velocities, a Vector in km/s/kpc; None without a gradient."""
        if "w_x" not in self.names:
            return None
        return replace(self._make_vector("w", "km/s/kpc"), dof=self.covariance_dof)

    @property
    def oort(self) -> dict[str, tuple[float, float]]:
        """A, B, C and K with their errors; empty without a gradient. [km/s/kpc]"""
        if "A" not in self.names:
            return {}
        parameters = {"A": "A", "B": "w_z", "C": "C", "K": "K"}
        indices = {name: self.names.index(parameter) for name, parameter in parameters.items()}
        return {name: (float(self.values[i]), float(self.sigma[i])) for name, i in indices.items()}

    @property
    def vertex(self) -> tuple[float, float] | None:
        """The longitude of the vertex, tan 2l = −C/A, and its error; None without a gradient. [deg]"""
        if "A" not in self.names:
            return None
        columns = [self.names.index("A"), self.names.index("C")]
        a, c = self.values[columns]
        slope = np.array([c, -a]) / (2 * (a * a + c * c))
        error = np.sqrt(slope @ self.covariance[np.ix_(columns, columns)] @ slope)
        return float(np.degrees(np.arctan2(-c, a) / 2)), float(np.degrees(error))

    def model(self, field: Field) -> FloatArray:
        """The motions of the model at the sources of a `field` with distances or parallaxes, (2, n). [µas/yr]"""
        field.check_frame(self.frame)
        rates = inverse_distances_from_measurements(field, self.length / 1000, self.power)
        return np.tensordot(self.values, _compute_design(field, rates.mean, "A" in self.names), 1)

    def _sections(self, long):
        speed, (lon, lat) = self.velocity.amplitude, self.velocity.direction
        facts = [
            ("sources", f"{self.n_data // 2} at known distances, {self.frame} axes"),
            ("dispersion", f"{self.dispersion:.1f} km/s in each component about the model"),
            ("χ²/dof", f"{self.chi2:.6g} / {self.dof} = {self.reduced_chi2:.3f}"),
            ("speed", f"{speed:.2f} km/s toward {lon:.1f}°, {lat:+.1f}°"),
        ]
        if speed > SPEED_OF_LIGHT:
            facts.append(("warning", "faster than light: are distances and motions in the unit that was taken?"))
        if self.oort:
            constants = ", ".join(
                f"{name} = {format_with_error(value, error, '+')}" for name, (value, error) in self.oort.items()
            )
            assert self.vertex is not None
            facts += [("Oort constants", f"{constants} km/s/kpc"), ("vertex", f"{format_with_error(*self.vertex)}°")]
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma}
        columns["unit"] = ["km/s" if name in _VELOCITY_NAMES else "km/s/kpc" for name in self.names]
        return (Section("Our velocity with respect to stars", facts, tables.table_of(columns), notes=self.notes),)


@arguments.accepts(field=arguments.a(Field))
def kinematics(
    field: Field,
    *,
    gradient: bool = True,
    dispersion: float | Literal["free"] = "free",
    length: float | None = None,
    power: float | None = None,
    frame: str = "galactic",
) -> Kinematics:
    """The Sun's motion and Oort's constants from proper motions at known distances.

    Parameters
    ----------
    field : Field
        With `distance` and `distance_error` [Mpc], or `parallax` and `parallax_error` [mas], for each source.
    gradient : bool
        Whether velocities change with place to first order: rotation and shear (Oort's A, B, C, K); else our velocity
        alone.
    dispersion : float or "free"
        Dispersion of the sources' velocities about that, in each component, that of greatest (restricted) likelihood
        unless given. [km/s]
    length : float, optional
        Scale length of the density of sources, d^κ exp(−d/L); that of greatest likelihood unless given. [Mpc]
    power : float, optional
        κ of that density, if it is known: 2 of sources in a ball about us, 1 of those in a thin disc. Unless given, 2,
        and what one more or less would change at the same L is added to the errors.
    frame : {"galactic", "icrs", "ecliptic"}
        Axes of the result; Oort's constants are defined in Galactic ones.

    Raises
    ------
    FieldError
        If a source has neither a distance nor a parallax.
    DegeneracyError
        If the sources cannot separate the parameters.
    ParameterError
        If they are galaxies, at more than a megaparsec: the acceleration of the Solar System, which moves all sources
        by 5 µas/yr, is then more than the velocities, and no parameter of this model.

    Notes
    -----
    Errors are from the scatter of the sources (a sandwich, HC3), so they also hold where velocities scatter more along
    one axis than another, or with distance; not where groups of sources move together. Stars that are not the same in
    all directions and depths also see the curvature of the rotation: A and B are then means over their volume. Errors
    of distances are taken as Gaussian in the distance; where they are fractions of it, as those of distance moduli are,
    velocities are 1 % too small for 0.2 mag and 6 % for 0.4 mag.

    References
    ----------
    Ogorodnikov 1932; Milne 1935; Bovy 2017, MNRAS 468, L63.

    Examples
    --------
    >>> from vsh import Field
    >>> rng = np.random.default_rng(1)
    >>> lon, lat = rng.uniform(0, 6.28, 500), np.arcsin(rng.uniform(-1, 1, 500))
    >>> field = Field(lon, lat, 30 * rng.normal(size=(2, 500)), np.full((2, 500), 30.0))
    >>> from dataclasses import replace
    >>> near = replace(field, distance=np.full(500, 1e-3), distance_error=np.full(500, 1e-5))
    >>> solution = kinematics(near, gradient=False, dispersion=10.0)
    >>> solution.names
    ('v_x', 'v_y', 'v_z')
    """
    choice("frame", frame, ("galactic", "icrs", "ecliptic"))
    field = field.to_frame(frame)
    names = (*_VELOCITY_NAMES, *_GRADIENT_NAMES) if gradient else _VELOCITY_NAMES
    if 2 * len(field) <= len(names):
        raise DegeneracyError(f"{len(field)} sources cannot determine {len(names)} parameters")
    is_free = isinstance(dispersion, str)
    if is_free and dispersion != "free":
        raise ParameterError(f"a dispersion is a number [km/s], or 'free', not {dispersion!r}")
    kappa = 2.0 if power is None else positive("power", power)
    rates = inverse_distances_from_measurements(field, length, kappa)
    if (distance := float(np.median(1 / rates.mean)) / AU_PER_YEAR) > _NEAREST_GALAXIES:
        raise ParameterError(
            f"half of the sources are beyond {distance:.3g} Mpc, where the Solar System's acceleration alone is "
            f"{AU_PER_YEAR * distance * GAIA_EDR3.amplitude:.0f} km/s: fit.secular_parallax.observer_velocity fits both"
            " (it needs redshifts beside the distances)"
        )
    values, velocity_dispersion, (design, weights, normal) = _solve(
        field, rates, names, None if is_free else not_negative("dispersion", dispersion)
    )
    covariance, chi2, dof = _compute_sandwich_and_chi2(design, field.motion, values, weights, normal)
    if power is None:  # cuts change the slope of the density, too
        steeper, flatter = (
            _solve(field, inverse_distances_from_measurements(field, rates.length, each), names, velocity_dispersion)[0]
            for each in (kappa + 1, kappa - 1)
        )
        covariance += np.multiply.outer(steeper - flatter, steeper - flatter) / 4
    notes = [*field.notes]
    if rates.n_parallaxes:
        thinning = f"sources that thin out with d^{kappa:g} exp(−d/{1000 * rates.length:.3g} kpc)"
        notes.append(f"{rates.n_parallaxes} distances by parallax, for {thinning}; power= takes another law")
    return Kinematics(
        names=names, values=values, covariance=covariance, chi2=chi2, n_data=2 * len(field), frame=frame,
        notes=tuple(notes), dispersion=float(velocity_dispersion), length=1000 * rates.length, power=kappa,
        covariance_dof=dof,
    )  # fmt: skip


def _solve(field, rates, names, dispersion):
    """Solve for the parameters and the dispersion (of greatest likelihood where it is None), with their matrices."""
    design, errors = _compute_design(field, rates.mean, len(names) > len(_VELOCITY_NAMES)), _stack_covariances(field)
    velocity_motion, is_free = np.zeros((2, len(field))), dispersion is None
    for _ in range(4):  # what an unsure distance adds depends on the velocity
        across = velocity_motion / np.where(rates.mean > 0, rates.mean, 1.0)
        error_covariance = errors + rates.variance * np.stack([across[0] ** 2, across[1] ** 2, across[0] * across[1]])
        if is_free:
            _check_separable(
                _sum_equations(design, field.motion, _invert_covariances(error_covariance, 0.0, rates)[0])[0], names
            )
            dispersion = _fit_dispersion(design, field.motion, error_covariance, rates)
        weights, _ = _invert_covariances(error_covariance, dispersion, rates)
        normal, rhs = _sum_equations(design, field.motion, weights)
        _check_separable(normal, names)
        values = np.linalg.solve(normal, rhs)
        velocity_motion = np.tensordot(values[:3], design[:3], 1)
    return values, dispersion, (design, weights, normal)


def _compute_design(field, inverse_distance, has_gradient):
    """Compute the motions by one of each parameter, (p, 2, n)."""
    p, q, r = triad(field.lon, field.lat)
    columns = [np.stack([-inverse_distance * p[i], -inverse_distance * q[i]]) for i in range(3)]
    if has_gradient:
        columns += [_KM_S_KPC * np.stack([q[i], -p[i]]) for i in range(3)]
        columns += [_KM_S_KPC * np.stack([np.sum(p * (s @ r), 0), np.sum(q * (s @ r), 0)]) for s in _SHEAR_TENSORS]
    return np.array(columns)


def _stack_covariances(field):
    sigma_lon, sigma_lat = field.sigma
    return np.stack([sigma_lon**2, sigma_lat**2, field.rho * sigma_lon * sigma_lat])


def _invert_covariances(error_covariance, dispersion, rates):
    """Invert the covariance of each source, (3, n), and sum the log determinants of the covariances."""
    dispersion_variance = dispersion**2 * (rates.mean**2 + rates.variance)
    a, b, c = error_covariance[0] + dispersion_variance, error_covariance[1] + dispersion_variance, error_covariance[2]
    determinant = a * b - c * c
    return np.stack([b, a, -c]) / determinant, float(np.log(determinant).sum())


def _sum_equations(design, motion, weights):
    weighted_design = multiply_weights(weights, design).reshape(len(design), -1)
    return weighted_design @ design.reshape(len(design), -1).T, weighted_design @ motion.ravel()


def _fit_dispersion(design, motion, error_covariance, rates):
    """Fit the dispersion of greatest restricted likelihood. [km/s]"""
    from scipy.optimize import minimize_scalar  # slow to import

    def find_deviance(dispersion):
        weights, logdet = _invert_covariances(error_covariance, dispersion, rates)
        normal, rhs = _sum_equations(design, motion, weights)
        chi2 = np.sum(motion * multiply_weights(weights, motion)) - rhs @ np.linalg.solve(normal, rhs)
        return logdet + chi2 + np.linalg.slogdet(normal)[1]

    # Its logarithm first, so that a large range costs little; then whether none at all is likelier.
    dispersions = np.geomspace(0.1, _LARGEST_DISPERSION, 25)
    best_index = int(np.argmin([find_deviance(trial) for trial in dispersions]))
    lower, upper = dispersions[max(best_index - 1, 0)], dispersions[min(best_index + 1, 24)]
    optimum = minimize_scalar(find_deviance, bounds=(lower, upper), method="bounded", options={"xatol": 1e-3 * lower})
    return 0.0 if find_deviance(0.0) <= optimum.fun else float(optimum.x)


def _check_separable(normal, names):
    scale = np.sqrt(np.diag(normal))
    if not (scale > 0).all() or np.linalg.cond(normal / np.outer(scale, scale)) > 1e12:
        raise DegeneracyError(f"these sources cannot separate {', '.join(names)}: too few, or too close together")


def _compute_sandwich_and_chi2(design, motion, values, weights, normal):
    """Compute the covariance from the residuals of each source (HC3), χ², and degrees of freedom of the covariance."""
    residual = motion - np.tensordot(values, design, 1)
    weighted_design = multiply_weights(weights, design)
    inverse = np.linalg.inv(normal)
    leverage = np.einsum("pin,pq,qin->n", weighted_design, inverse, design, optimize=True) / 2
    scores = np.einsum("pin,in->pn", weighted_design, residual) / (1 - np.minimum(leverage, 0.99))
    chi2, p = float(np.sum(residual * multiply_weights(weights, residual))), len(design)
    dof = min(p * (p + 1) / (6 * float(leverage @ leverage)), 2.0 * motion.shape[1] - p)  # Zhang (2012), two components
    return inverse @ (scores @ scores.T) @ inverse, chi2, dof
