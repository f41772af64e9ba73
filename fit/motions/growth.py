"""The growth rate of structure from proper motions of galaxies and the flow that their density predicts.

Linear theory has velocities v = −β H ∇ ∇⁻² δ from the density of galaxies δ, with β = f/b, the growth rate over the
bias.
Proper motions across the line of sight are compared with it:

    µ = β v_⊥(β = 1)/(4.740470 d) − v_⊙⊥/(4.740470 d) + spin + glide.

The flow (`vsh.models.flows.flow_of_galaxies`, or a published reconstruction) carries the cross-correlation of motions
and density on all scales at once, each weighted by what linear theory expects of it.
"""

from dataclasses import dataclass

import numpy as np

from fit.background import Amplitude
from fit.results.solution import NamedSolution
from vsh.field import Field, multiply_weights
from vsh.io import tables
from vsh.io.sections import Answer, Section
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import LINEAR_PLANCK18, VelocityGrid
from vsh.sky.sphere import triad
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, FieldError
from vsh.tools.types import FloatArray
from vsh.tools.units import AU_PER_YEAR
from vsh.vector import Vector

_NAMES = ("beta", "v_x", "v_y", "v_z", "omega_x", "omega_y", "omega_z", "a_x", "a_y", "a_z")
#: Redshifts that are distances to within a fifth for velocities of 300 km/s.
_NEAREST = 0.005


@dataclass(frozen=True, eq=False)
class Growth(NamedSolution):
    """Growth rate of structure over the bias of the galaxies, from motions.

    Attributes
    ----------
    names : tuple of str
        beta; v_x, v_y, v_z, our velocity [km/s]; omega_x, omega_y, omega_z, a_x, a_y, a_z, spin and acceleration
        [µas/yr].
    values : (10,) array
    covariance : (10, 10) array
        From the errors of the motions, the dispersion, and the error of the reconstruction.
    chi2 : float
    n_data : int
    frame : str
    notes : tuple of str
    dispersion : float
        Dispersion of velocities about the flow, in each component. [km/s]
    reconstruction_error : float
        Error of β by what the flow misses, as a fraction of it.
    """

    dispersion: float = np.nan
    reconstruction_error: float = 0.0

    @property
    def beta(self) -> tuple[float, float]:
        """β = f/b and its error."""
        return float(self.values[0]), float(self.sigma[0])

    @property
    def velocity(self) -> Vector:
        """Our velocity with respect to the galaxies, a Vector in km/s."""
        return self._vector("v", "km/s")

    def limit(self, probability: float = 0.95) -> float:
        """The β below which the true one lies with a `probability`, flat in β above zero.

        The error of the reconstruction goes with the true β, so that the posterior has a tail.
        """
        value, error = self.beta
        noise = error**2 - (self.reconstruction_error * value) ** 2
        beta = np.linspace(0, max(value, 0) + 12 * error, 4001)
        variance = noise + (self.reconstruction_error * beta) ** 2
        log_likelihood = -((value - beta) ** 2) / (2 * variance) - np.log(variance) / 2
        return Amplitude(np.sqrt(beta), log_likelihood - log_likelihood.max()).quantile(probability)

    def model(self, field: Field) -> FloatArray:
        """The motions by our velocity, spin and acceleration at a `field` with redshifts, (2, n), without the flow."""
        rate = 1 / (AU_PER_YEAR * transverse_distance(field.redshift))
        return np.tensordot(self.values[1:], _fields(field, rate), 1)

    @property
    def answer(self) -> Answer:
        """The line to quote."""
        value, error = self.beta
        return Answer((("growth", f"f/b < {self.limit():.3g} (95 %), {value:.3g} ± {error:.2g}"),))

    def _sections(self, long):
        value, error = self.beta
        facts = [
            ("sources", f"{self.n_data // 2} galaxies, {self.frame} axes"),
            ("f/b", f"{value:.3g} ± {error:.2g}, {value / error:.1f} errors from zero"),
            ("limit", f"f/b < {self.limit():.3g} (95 %, flat above zero)"),
            ("dispersion", f"{self.dispersion:.0f} km/s in each component about the flow"),
            ("χ²/dof", f"{self.chi2:.6g} / {self.dof} = {self.reduced_chi2:.3f}"),
        ]
        units = ["", *["km/s"] * 3, *["µas/yr"] * 6]
        columns = {"parameter": list(self.names), "value": self.values, "sigma": self.sigma, "unit": units}
        return (Section("Growth of structure from motions", facts, tables.table_of(columns), notes=self.notes),)


@arguments.accepts(field=arguments.a(Field), flow=arguments.a(VelocityGrid))
def growth(
    field: Field,
    flow: VelocityGrid,
    *,
    beta: float = LINEAR_PLANCK18.growth_rate,
    dispersion: float = 300.0,
    reconstruction_error: float = 0.2,
) -> Growth:
    """Fit the growth rate of structure to proper motions of galaxies.

    Parameters
    ----------
    field : Field
        Motions of galaxies with redshifts; those below 0.005 are left out, whose distances do not follow from them.
    flow : VelocityGrid
        The flow that the density of galaxies predicts.
    beta : float
        The f/b that the flow was made with.
    dispersion : float
        Dispersion of velocities about the flow, in each component. [km/s]
    reconstruction_error : float
        Error of β by what the flow misses, as a fraction of it.

    Returns
    -------
    Growth
        f/b with our velocity, spin and acceleration.

    Raises
    ------
    FieldError
        If the galaxies have no redshifts.
    DegeneracyError
        If too few of them lie within the grid.

    Notes
    -----
    With flows by `flow_of_galaxies` from galaxies to 90 Mpc/h whose density is log-normal, β is right on average to 4 %
    and scatters by 20 % from sky to sky, which `reconstruction_error` allows for: from no flow to six errors from zero
    the coverage of 68 % intervals is .645 to .705, and that of limits .95 or more (docs/validation.md). Distances are
    taken from redshifts.

    References
    ----------
    Duncan et al. 2023, arXiv:2305.15893, who forecast this cross-correlation.
    """
    beta, dispersion = arguments.positive("beta", beta), arguments.not_negative("dispersion", dispersion)
    reconstruction_error = arguments.not_negative("reconstruction_error", reconstruction_error)
    if field.redshift is None:
        raise FieldError("growth is from galaxies with redshifts, and these have none")
    is_near = ~(field.redshift > _NEAREST)
    field = field[~is_near]
    distance = transverse_distance(field.redshift)
    velocity, inside = flow.at(field.lon, field.lat, distance * hubble_value(FLAT_PLANCK13) / 100, field.frame)
    field, distance, velocity = field[inside], distance[inside], velocity[:, inside]
    if len(field) < 100:
        raise DegeneracyError(f"{len(field)} galaxies lie within the flow: too few for ten parameters")
    notes = [*field.notes]
    if is_near.any():
        notes.append(f"growth: {is_near.sum()} galaxies with redshifts below {_NEAREST} left out")
    if not inside.all():
        notes.append(f"growth: {np.sum(~inside)} galaxies outside of the flow left out")
    p, q, _ = triad(field.lon, field.lat)
    rate = 1 / (AU_PER_YEAR * distance)
    predicted = rate * np.stack([np.sum(velocity * p, 0), np.sum(velocity * q, 0)]) / beta
    east, north = field.sigma
    wider = np.hypot(field.sigma, dispersion * rate)
    field_in_flow = field.with_errors(wider, field.rho * east * north / (wider[0] * wider[1]))
    fields = np.concatenate([predicted[None], _fields(field, rate)])
    weighted = multiply_weights(field_in_flow.weights, fields)
    normal = np.einsum("pin,qin->pq", weighted, fields)
    scale = np.sqrt(np.diag(normal))
    if np.linalg.cond(normal / np.outer(scale, scale)) > 1e10:
        raise DegeneracyError(f"{len(field)} galaxies do not determine {', '.join(_NAMES)}: take more of the sky")
    covariance = np.linalg.inv(normal)
    rhs = np.einsum("pin,in->p", weighted, field.motion)
    values = covariance @ rhs
    covariance[0, 0] += (reconstruction_error * values[0]) ** 2
    residual = field.motion - np.tensordot(values, fields, 1)
    chi2 = float(np.sum(field_in_flow.inner(residual, residual)))
    return Growth(
        _NAMES, values, covariance, chi2, 2 * len(field), field.frame, tuple(notes), dispersion, reconstruction_error
    )


def _fields(field, rate):
    """Motions by one of each component of our velocity, the spin and the acceleration, (9, 2, n)."""
    p, q, _ = triad(field.lon, field.lat)
    glide, spin = np.stack([p, q], axis=1), np.stack([q, -p], axis=1)
    return np.concatenate([-rate * glide, spin, glide])
