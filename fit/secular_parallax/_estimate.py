"""Our velocity for a known Hubble constant, or the Hubble constant for a known velocity; of catalogues to come, too.

Least squares as in Bachchan, Hobbs & Lindegren (2016, A&A 589, A71), sect. 4, with redshifts as they are and coherent
flows. Velocities are ours with respect to the background and point toward the apex; galaxies move the other way.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Literal
from warnings import warn

import numpy as np

from fit.distances import declared_frame, has_distance_or_parallax
from fit.results.storage import Result
from fit.secular_parallax._equations import OMEGA, A, LocalGroup, ParallaxEquations, ParallaxParts, U, solve_for
from fit.secular_parallax._model import DistanceModel, make_distance_model
from fit.secular_parallax._solution import HubbleSolution, VelocitySolution, find_preferred_dispersion
from vsh.field import Field
from vsh.io import tables
from vsh.io.parts import Parts
from vsh.io.sections import Section
from vsh.models.cosmology import LOCAL_GROUP, velocity_in_frame, with_redshift
from vsh.tools import arguments
from vsh.tools.errors import DegeneracyError, ParameterError, VshWarning
from vsh.tools.notes import CodedNote
from vsh.tools.types import ArrayLike, AxesArray, OnAxes, Table
from vsh.vector import Vector


def is_redshift_frame_undeclared(field: Field | Parts, redshift_frame: str | None) -> bool:
    """Return whether the frame of the redshifts is not given."""
    if redshift_frame is not None:
        return False
    first_field = field if isinstance(field, Field) else next(iter(field))
    return first_field.redshift is not None and first_field.redshift_frame is None


def warn_of_undeclared_frame(equations: Any, field: Field | Parts, redshift_frame: str | None) -> Any:
    """The equations, with a note and a warning where the frame of the redshifts is not given."""
    if not is_redshift_frame_undeclared(field, redshift_frame):
        return equations
    note = (
        "the frame of the redshifts is not given, so they are taken as true ones, without velocities or errors in "
        "them. Say which: redshift_frame= (--redshift-frame)"
    )
    warn(note, VshWarning, stacklevel=4)
    return replace(equations, notes=(f"warning: {note}", *equations.notes))


#: By which the Local Group departs from the flow of the modes: with 250 of them they leave 106 km/s of linear flows,
#: and the rest is for what is none. [km/s]
LOCAL_SCATTER = 150.0
_PRODUCT = "the proper motions constrain only the product of our velocity and the Hubble constant, v · H0"


@arguments.accepts(field=arguments.a(Field, Parts), hubble=arguments.positive, excess_noise=arguments.not_negative)
def observer_velocity(
    field: Field | Parts,
    hubble: float | None = None,
    model: DistanceModel | None = None,
    *,
    spin: Literal["free"] | Vector | None = None,
    acceleration: Vector | None = None,
    excess_noise: float = 0.0,
    **options: Any,
) -> VelocitySolution:
    """Our velocity and the acceleration, θ = (v, ã), for a known Hubble constant.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4 (`vsh.models.cosmology.with_redshift`, also as a step of parts). For
        clusters, masers and stars with distances but no redshifts, use `fit.kinematics`.
    hubble : float
        H0. [km/s/Mpc]
    model : DistanceModel, optional
        What is assumed of distances and flows.
    spin : None, "free" or Vector
        None takes the frame not to spin; a Vector (of the quasars, say) is held fixed and its
        covariance propagated. [µas/yr]
    acceleration : Vector, optional
        Known from elsewhere, from quasars say, with its covariance; free unless given. [µas/yr]
    excess_noise : float
        Noise beyond the catalogue's, in each component. [µas/yr]
    **options
        Attributes of a `DistanceModel` in its place: redshift_frame, flows, peculiar_dispersion, cosmology, …

    Raises
    ------
    DegeneracyError
        Without a Hubble constant, or if the sources cannot separate the parameters.
    ParameterError
        If H0 is not positive, if a frame or a flow is unknown, or if the dispersion is so large that it includes the
        flows.
    FieldError
        If a redshift is missing, not positive or below the flow, if some magnitudes are missing, or if redshifts do not
        determine distances; the message gives the number of sources.

    Notes
    -----
    Flows of linear theory are unknowns unless flows=None: on the real sky they are nearly the whole error. On simulated
    skies with such flows, 10⁴ galaxies to z = 0.03 and heliocentric redshifts, 68 and 95 % intervals cover 0.71 and
    0.96, those of `hubble_constant` 0.73 and 0.98 (benchmarks/flows_by_default.py), of an observer who takes no part in
    the flow. If the observer moves with the local flow, the intervals of the components have the same coverage, but the
    speed is too low, by 270 of 370 km/s: nearby galaxies move with us, and the fit gives the velocity relative to them.
    Errors of measured distances are taken as Gaussian in the distance: where they are fractions of it, as those of
    distance moduli are, the velocity is 5 % too small for 10 % and 13 % for 20 %, coverage of 95 % intervals 85 %.
    Without flows, on skies of independent velocities of 300 and 750 km/s, pulls are 1.0 and the bias below 0.2 standard
    errors, with magnitudes and without; `flow_covariance` then says what flows would add. Sources whose redshift has an
    error above half of itself, and no distance, are left out and named. A dispersion that is wrong biases: 300 km/s
    taken as 450 gives pulls of 1.2; `preferred` says what the residuals prefer.
    """
    if isinstance(field, Field) and field.redshift is None and has_distance_or_parallax(field).all():
        raise ParameterError(
            "redshifts tell the flows and the place of each source: stars and clusters with distances alone are for "
            "fit.kinematics(field), galaxies with distances need their redshifts, too"
        )
    if hubble is None:
        raise DegeneracyError(
            f"{_PRODUCT}: give hubble=, or a velocity to fit.secular_parallax.hubble_constant, or priors to "
            "fit.posterior.sample"
        )
    model = make_distance_model(model, options)
    equations = model.equations(field, ratio=hubble / model.hubble)
    equations = warn_of_undeclared_frame(equations, field, model.redshift_frame)
    fit_options = {"spin": spin, "acceleration": acceleration, "excess_noise": excess_noise}
    return _solve_for_velocity(equations, hubble, model.dispersion, **fit_options)


def _solve_for_velocity(equations, hubble, dispersion, **fit_options):
    """Our velocity from equations with distances for this H0; of the rest `local_group` is for forecasts alone."""
    ratio = hubble / equations.hubble
    solve_equations, dispersions = _make_solver_and_dispersions(equations, dispersion, ratio, **fit_options)
    to_u = np.eye(9)
    to_u[U, U] *= ratio  # u = v H0/H_ref
    attributes = solve_equations(to_u[:, : OMEGA.start], ("v_x", "v_y", "v_z", "a_x", "a_y", "a_z"))
    return VelocitySolution(**attributes, **dispersions, assumed_hubble=hubble)


def _make_solver_and_dispersions(
    equations, dispersion, ratio, *, spin=None, acceleration=None, excess_noise=0.0, local_group=None, preferred=True
):
    """Solver of these equations, a function of to_u, the names and our velocity; and the dispersions of the result.

    The dispersion that the residuals prefer is None for parts, and where it is not `preferred`, asked for.
    """
    group = make_local_group(local_group, equations)
    sums = equations.sums(dispersion * ratio, excess_noise, ratio=ratio)
    omitted, preferred_dispersion = equations.left_out, None
    left_out = None if omitted is None else omitted.sums(dispersion * ratio, excess_noise, equations.n_data // 2)
    if preferred and isinstance(equations, ParallaxEquations):
        preferred_dispersion = find_preferred_dispersion(equations, dispersion, excess_noise, acceleration, ratio, spin)
    known = {"spin": spin, "equations": equations, "acceleration": acceleration, "ratio": ratio}
    solve = partial(solve_for, sums, **known, local_group_measurement=group, omitted_flow_sums=left_out)
    return solve, {"preferred": preferred_dispersion, "peculiar_dispersion": dispersion}


@arguments.accepts(field=arguments.a(Field, Parts), hubble=arguments.positive, excess_noise=arguments.not_negative)
def hubble_constant(
    field: Field | Parts,
    velocity: str | Vector | ArrayLike | None = None,
    model: DistanceModel | None = None,
    *,
    spin: Literal["free"] | Vector | None = None,
    acceleration: Vector | None = None,
    excess_noise: float = 0.0,
    hubble: float | None = None,
    local_group: Vector | bool | None = None,
    **options: Any,
) -> HubbleSolution:
    """The Hubble constant and the acceleration, θ = (H0, ã), for a known velocity.

    Parameters
    ----------
    field, model, spin, acceleration, excess_noise, **options
        As for `observer_velocity`.
    velocity : "planck", "paper", Vector or (3,) array
        Ours, toward the apex; an array is along the field's axes. The covariance of a Vector is propagated. [km/s]
    hubble : float, optional
        H0 that the weights of the peculiar velocities assume. Default: that of the cosmology. It does not bias the
        estimate. [km/s/Mpc]
    local_group : Vector, optional
        Velocity of the Local Group relative to the microwave background, as a measurement of the flow at our position;
        True for that of Kogut et al. (1993), 627 ± 22 km/s. It requires flows. [km/s]

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
    model = make_distance_model(model, options)
    equations = warn_of_undeclared_frame(model.equations(field, apart=True), field, model.redshift_frame)
    fit_options = {"spin": spin, "acceleration": acceleration, "excess_noise": excess_noise, "local_group": local_group}
    solution = _solve_for_hubble(equations, velocity, model.dispersion, hubble, **fit_options)
    frame = model.redshift_frame or declared_frame(field)
    return replace(solution, notes=(*solution.notes, *make_notes_on_local_group(equations, local_group, frame)))


#: The code of the note on a fit that takes the Local Group's motion for the flow where we are.
WITH_LOCAL_GROUP = "the Local Group's motion"


def make_notes_on_local_group(
    equations: ParallaxEquations | ParallaxParts, local_group: Vector | bool | None, frame: str | None
) -> list[CodedNote]:
    """Return a note on the flow where we are: which was assumed, or that none was where there should be one.

    Without it H0 is too low by 1.0 to 1.2 errors on 28 to 61 skies of 2500 galaxies to z = 0.03 whose flow at the
    origin is in our velocity. `local_group=False` says that we do not move with the flow, as in simulations.
    """
    if local_group is None or local_group is False:
        text = "warning: where we move with the galaxies nearby, H0 is too low by about its error"
        is_missing = local_group is None and equations.modes is not None and frame not in (None, "true")
        return [CodedNote(f"{text}: use the Local Group's motion, local_group=True (--flows yes)", "")] * is_missing
    velocity = LOCAL_GROUP if local_group is True else local_group
    text = f"the galaxies nearby move as the Local Group, {velocity.amplitude:.0f} km/s in the microwave background"
    return [CodedNote(f"{text}, and we with them; without that: --flows alone (local_group=False)", WITH_LOCAL_GROUP)]


def _solve_for_hubble(equations, velocity, dispersion, hubble=None, **fit_options):
    """The Hubble constant from equations with V apart; the rest as for `_make_solver_and_dispersions`."""
    velocity = velocity_in_frame(velocity, equations.frame)
    if equations.n_own and 2 * equations.n_own >= equations.n_data:
        raise ParameterError(
            f"all {equations.n_own} sources have measured distances, of which the motions tell v and nothing of H0: "
            "leave the distances out (--columns distance=), or fit v with observer_velocity (--h0)"
        )
    ratio = 1.0 if hubble is None else hubble / equations.hubble
    solve_equations, dispersions = _make_solver_and_dispersions(equations, dispersion, ratio, **fit_options)

    def solve_at(v):
        to_u = np.zeros((12, 4))
        to_u[U, 0] = v / equations.hubble
        to_u[A, 1:] = np.eye(3)
        return solve_equations(to_u, ("H0", "a_x", "a_y", "a_z"), velocity=v)

    attributes = solve_at(velocity.value)
    if velocity.covariance.any():
        step = 1e-4 * velocity.amplitude
        v, steps = velocity.value, step * np.eye(3)
        slopes = np.stack([solve_at(v + s)["values"] - solve_at(v - s)["values"] for s in steps], axis=1) / (2 * step)
        attributes["covariance"] = attributes["covariance"] + slopes @ velocity.covariance @ slopes.T
    return HubbleSolution(**attributes, **dispersions, assumed_velocity=velocity)


def make_local_group(value: Vector | bool | None, equations: ParallaxEquations | ParallaxParts) -> LocalGroup | None:
    """The Local Group's velocity as a measurement of the flow of some equations."""
    if value is None or value is False:
        return None
    if equations.modes is None:
        raise ParameterError(
            "the Local Group tells the flow where we are: local_group= needs galaxies with a flow (z < 0.2, not "
            "flows=None)"
        )
    if value is not True and not isinstance(value, Vector):
        raise ParameterError(f"local_group is a Vector in km/s, or True, not {value!r}")
    velocity = (LOCAL_GROUP if value is True else value).to_frame(equations.frame)
    return LocalGroup(equations.modes, velocity.value, velocity.covariance + LOCAL_SCATTER**2 * np.eye(3))


def predict_errors(
    sources: Any,
    hubble: float = 67.3,
    velocity: str | Vector | ArrayLike = "planck",
    *,
    sigma: ArrayLike | None = None,
    local_group: Vector | bool | None = None,
    left_out: bool = True,
    **options: Any,
) -> tuple[VelocitySolution, HubbleSolution]:
    """Forecast the errors of our velocity and of H0: a VelocitySolution and a HubbleSolution whose values are nan.

    Parameters
    ----------
    sources, sigma
        As for `fit.correlation.predict_covariance`, with redshifts: true ones unless another frame is given.
    hubble : float
        For the velocity, and the scale of H0's error [km/s/Mpc]
    velocity
        As for `fit.secular_parallax.hubble_constant`.
    local_group : Vector or bool, optional
        As for `hubble_constant`. The error of our velocity is then too small, because the velocity of the Local Group
        is treated as independent of it.
    left_out : bool
        With flows=None: whether what flows would add to the errors is worked out beside them.
    **options
        Other arguments of `fit.secular_parallax.observer_velocity` except `hubble`, such as flows="linear".
    """
    motionless_field = Field.from_positions(sources, sigma)
    motionless_field = motionless_field.minus(motionless_field.motion)
    options = {"redshift_frame": motionless_field.redshift_frame or "true"} | options
    fit_options = {name: options[name] for name in ("spin", "acceleration", "excess_noise") if name in options}
    model = make_distance_model(None, {name: value for name, value in options.items() if name not in fit_options})
    solver_options: dict[str, Any] = fit_options | {"local_group": local_group, "preferred": False}
    equations = model.equations(motionless_field, ratio=hubble / model.hubble, flow_left_out=left_out)
    hubble_equations = model.equations(motionless_field, apart=True, flow_left_out=left_out)
    velocity_solution = _solve_for_velocity(equations, hubble, model.dispersion, **solver_options)
    hubble_solution = _solve_for_hubble(hubble_equations, velocity, model.dispersion, hubble, **solver_options)
    nan = float("nan")
    return (
        replace(velocity_solution, values=np.full(len(velocity_solution.names), nan), chi2=nan),
        replace(hubble_solution, values=np.full(len(hubble_solution.names), nan), chi2=nan),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class VelocityForecast(Result):
    """Errors of our velocity and of H0 by catalogue, redshift limit and what is known besides.

    Attributes
    ----------
    catalogues : tuple of str
    limits : tuple of float
        Redshifts up to which sources are used.
    known : tuple of str
        What is taken to be known.
    sources : (c, z) array
        How many there are.
    velocity, hubble : (c, z, k) arrays
        Standard errors of a component of v [km/s], on average, and of H0 [km/s/Mpc]
    """

    catalogues: tuple[str, ...]
    limits: tuple[float, ...]
    known: tuple[str, ...]
    sources: Any
    velocity: Any
    hubble: Any

    def _sections(self, long):
        table = self.to_table()
        forms = {name: ".0f" if name.startswith("velocity") else ".1f" for name in table.colnames[3:]}
        facts = [("errors", "of a component of our velocity [km/s], and of H0 [km/s/Mpc]")]
        remarks = [
            "Errors contain the cosmic variance of linear flows. With the Local Group's motion v is not independent of "
            "it; H0 is, and is fitted together with the flow."
        ]
        return (Section("Errors to come", facts, table, forms=forms, remarks=remarks),)

    def to_table(self) -> Table:
        """A row for each catalogue and limit, as an astropy Table."""
        index_pairs = [(i, j) for i in range(len(self.catalogues)) for j in range(len(self.limits))]
        columns: dict[str, Any] = {
            "catalogue": [self.catalogues[i] for i, _ in index_pairs],
            "z_limit": [self.limits[j] for _, j in index_pairs],
            "sources": [int(self.sources[i, j]) for i, j in index_pairs],
        }
        for k, name in enumerate(self.known):
            columns[f"velocity, {name}"] = [float(self.velocity[i, j, k]) for i, j in index_pairs]
            columns[f"H0, {name}"] = [float(self.hubble[i, j, k]) for i, j in index_pairs]
        return tables.table_of(columns)

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Errors of H0 against the redshift limit, a panel a catalogue; on matplotlib axes."""
        from fit.secular_parallax._plot import plot_forecast

        return plot_forecast(self, ax=ax)


#: What may be known besides the galaxies' motions: options of `predict`, and the columns of a forecast.
_LINEAR_FLOWS: dict[str, Any] = {"flows": "linear"}


def _make_glide_options(glide_error):
    return {"acceleration": Vector(np.zeros(3), glide_error**2 * np.eye(3))}


KNOWN_ASSUMPTIONS: dict[str, dict[str, Any]] = {
    "independent": {"peculiar_dispersion": 306.0, "flows": None},
    "flows": _LINEAR_FLOWS,
    "+ glide 0.35": _LINEAR_FLOWS | _make_glide_options(0.35),
    "+ glide 0.1": _LINEAR_FLOWS | _make_glide_options(0.1),
    "+ Local Group": _LINEAR_FLOWS | {"local_group": True},
    "+ both": _LINEAR_FLOWS | _make_glide_options(0.1) | {"local_group": True},
}


@arguments.accepts(catalogues=arguments.a(Mapping))
def forecast_velocity(
    catalogues: Mapping[str, Field],
    limits: Sequence[float] = (0.01, 0.02, 0.03),
    *,
    hubble: float = 67.3,
    n_modes: int = 250,
    redshift_frame: str = "cmb",
) -> VelocityForecast:
    """Errors of our velocity and of H0 for catalogues to come, with and without coherent flows.

    Parameters
    ----------
    catalogues : dict of str to Field
        Simulated future catalogues by name: galaxies with their expected errors; the values of the motions are not
        used.
    limits : sequence of float
        Redshifts up to which sources are used.
    hubble : float
        [km/s/Mpc]
    n_modes : int
        Unknowns of the flow.
    redshift_frame : str
        Frame in which the redshifts will be measured; "true": cosmological redshifts without peculiar velocities.

    Returns
    -------
    VelocityForecast
        In columns: independent velocities of 306 km/s; flows of linear theory; with the quasars' glide known to
        0.35 or 0.1 µas/yr in each component; with the Local Group's motion; with the latter two.

    Raises
    ------
    ParameterError
        If there is no catalogue.
    """
    if not catalogues:
        raise ParameterError("a forecast is of one catalogue at least")
    sources, velocity_errors, hubble_errors = [], [], []
    for field in map(with_redshift, catalogues.values()):
        for limit in limits:
            selection = field[np.asarray(field.redshift) < limit]
            sources.append(len(selection))
            for options in KNOWN_ASSUMPTIONS.values():
                prediction_options = (
                    {"redshift_frame": redshift_frame} | options | ({"n_modes": n_modes} if options["flows"] else {})
                )
                velocity_solution, hubble_solution = predict_errors(selection, hubble, **prediction_options)
                velocity_errors.append(np.sqrt(np.trace(velocity_solution.velocity.covariance) / 3))
                hubble_errors.append(hubble_solution.hubble_error)
    shape = len(catalogues), len(limits)
    return VelocityForecast(
        catalogues=tuple(catalogues),
        limits=tuple(map(float, limits)),
        known=tuple(KNOWN_ASSUMPTIONS),
        sources=np.reshape(sources, shape),
        velocity=np.reshape(velocity_errors, (*shape, len(KNOWN_ASSUMPTIONS))),
        hubble=np.reshape(hubble_errors, (*shape, len(KNOWN_ASSUMPTIONS))),
    )
