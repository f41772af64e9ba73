"""What a catalogue to come will tell of our velocity and of H0."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fit.results.output import WIDTH
from fit.results.storage import Result
from fit.secular_parallax._estimate import dispersion_of, hubble_from, parallax_equations, velocity_from
from fit.secular_parallax._solution import HubbleSolution, VelocitySolution
from vsh.field import Field
from vsh.io import tables
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value
from vsh.tools.arguments import explained
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, AxesArray, OnAxes, Table
from vsh.vector import Vector


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
    """Errors of our velocity and of H0 to come: a VelocitySolution and a HubbleSolution with nan for values.

    Parameters
    ----------
    sources, sigma
        As for `fit.correlation.predict_covariance`, with redshifts: true ones unless another frame is given.
    hubble : float
        For the velocity, and the scale of H0's error [km/s/Mpc]
    velocity
        As for `fit.secular_parallax.hubble_constant`.
    local_group : Vector or bool, optional
        As there. It lowers the error of the velocity as if it were independent of ours, which it is not.
    left_out : bool
        With flows=None: whether what flows would add to the errors is worked out beside them.
    **options
        Those of `fit.secular_parallax.observer_velocity`, but hubble: flows="linear", acceleration=Vector, …
    """
    still = Field.without_motions(sources, sigma)
    still = still.minus(still.motion)
    options = {"redshift_frame": still.redshift_frame or "true"} | options
    apart = {name: options[name] for name in ("spin", "acceleration", "excess_noise") if name in options}
    rest = {name: value for name, value in options.items() if name not in apart}
    cosmology = rest.get("cosmology")
    ratio = hubble / hubble_value(FLAT_PLANCK13 if cosmology is None else cosmology)
    dispersion = dispersion_of(rest.get("peculiar_dispersion"), rest)  # type: ignore[arg-type]
    rest |= {"peculiar_dispersion": dispersion, "flow_left_out": left_out}
    more: dict[str, Any] = apart | {"local_group": local_group, "preferred": False}
    ours = velocity_from(parallax_equations(still, ratio=ratio, **rest), hubble, dispersion, **more)
    constant = hubble_from(parallax_equations(still, apart=True, **rest), velocity, dispersion, **more, hubble=hubble)
    nothing = float("nan")
    return (
        replace(ours, values=np.full(len(ours.names), nothing), chi2=nothing),
        replace(constant, values=np.full(len(constant.names), nothing), chi2=nothing),
    )


@dataclass(frozen=True, eq=False)
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

    def report(self) -> str:
        """The table as text."""
        lines = [
            (
                "Errors to come: a component of our velocity [km/s] / H0 [km/s/Mpc], with the cosmic variance of linear"
                " flows"
            ),
            "─" * WIDTH,
            f"{'':8}{'z below':>8}{'sources':>9}" + "".join(f"{name:>16}" for name in self.known),
        ]
        for i, catalogue in enumerate(self.catalogues):
            for j, limit in enumerate(self.limits):
                cells = "".join(
                    f"{v:8.0f} /{h:5.1f} " for v, h in zip(self.velocity[i, j], self.hubble[i, j], strict=True)
                )
                lines.append(f"{catalogue:8}{limit:8.3g}{self.sources[i, j]:9d}{cells}")
        lines.append(
            "With the Local Group's motion v is not independent of it; H0 is, and is fitted together with the flow."
        )
        return "\n".join(lines) + "\n"

    def to_table(self) -> Table:
        """A row for each catalogue and limit, as an astropy Table."""
        pairs = [(i, j) for i in range(len(self.catalogues)) for j in range(len(self.limits))]
        columns: dict[str, Any] = {
            "catalogue": [self.catalogues[i] for i, _ in pairs],
            "z_limit": [self.limits[j] for _, j in pairs],
            "sources": [int(self.sources[i, j]) for i, j in pairs],
        }
        for k, name in enumerate(self.known):
            columns[f"velocity, {name}"] = [float(self.velocity[i, j, k]) for i, j in pairs]
            columns[f"H0, {name}"] = [float(self.hubble[i, j, k]) for i, j in pairs]
        return tables.table_of(columns)

    def plot(self, *, ax: OnAxes | None = None) -> AxesArray:
        """Errors of H0 against the redshift limit, a panel a catalogue; on matplotlib axes."""
        from fit.secular_parallax._plot import plot_forecast

        return plot_forecast(self, ax=ax)


#: What may be known besides the galaxies' motions: options of `predict`, and the columns of a forecast.
_FLOWS: dict[str, Any] = {"flows": "linear"}


def _glide(error):
    return {"acceleration": Vector(np.zeros(3), error**2 * np.eye(3))}


KNOWN: dict[str, dict[str, Any]] = {
    "independent": {"peculiar_dispersion": 306.0, "flows": None},
    "flows": _FLOWS,
    "+ glide 0.35": _FLOWS | _glide(0.35),
    "+ glide 0.1": _FLOWS | _glide(0.1),
    "+ Local Group": _FLOWS | {"local_group": True},
    "+ both": _FLOWS | _glide(0.1) | {"local_group": True},
}


@explained
def forecast_velocity(
    catalogues: Mapping[str, Field],
    limits: Sequence[float] = (0.01, 0.02, 0.03),
    *,
    hubble: float = 67.3,
    n_modes: int = 250,
    redshift_frame: str = "cmb",
) -> VelocityForecast:
    """Errors of our velocity and of H0 for catalogues to come, with and without the flows that galaxies share.

    Parameters
    ----------
    catalogues : dict of str to Field
        Galaxies with their errors to be, by name; motions do not matter.
    limits : sequence of float
        Redshifts up to which sources are used.
    hubble : float
        [km/s/Mpc]
    n_modes : int
        Unknowns of the flow.
    redshift_frame : str
        With redshifts as they will be seen; "true" for ones without velocities.

    Returns
    -------
    Forecast
        In columns: independent velocities of 306 km/s; flows of linear theory; with the quasars' glide known to
        0.35 or 0.1 µas/yr in each component; with the Local Group's motion; with the latter two.

    Raises
    ------
    ParameterError
        If there is no catalogue.
    """
    if not catalogues:
        raise ParameterError("a forecast is of one catalogue at least")
    sources, velocity, constant = [], [], []
    for field in catalogues.values():
        for limit in limits:
            chosen = field[np.asarray(field.redshift) < limit]
            sources.append(len(chosen))
            for options in KNOWN.values():
                given = (
                    {"redshift_frame": redshift_frame} | options | ({"n_modes": n_modes} if options["flows"] else {})
                )
                ours, h = predict_errors(chosen, hubble, **given)
                velocity.append(np.sqrt(np.trace(ours.velocity.covariance) / 3))
                constant.append(h.hubble_error)
    shape = len(catalogues), len(limits)
    return VelocityForecast(
        tuple(catalogues),
        tuple(map(float, limits)),
        tuple(KNOWN),
        np.reshape(sources, shape),
        np.reshape(velocity, (*shape, len(KNOWN))),
        np.reshape(constant, (*shape, len(KNOWN))),
    )
