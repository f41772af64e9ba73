"""What is assumed of distances and motions of galaxies: made and checked once, for velocity, H0, bins and posterior."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np

from fit.distances import WHOLE_DISPERSION, Calibration, calibrate
from fit.secular_parallax._equations import OmittedFlow, ParallaxEquations, ParallaxParts, make_equations
from vsh.field import Field
from vsh.io.parts import Parts, apply_step
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, select_certain_redshifts, transverse_distance
from vsh.models.flows import FARTHEST, LINEAR_PLANCK18, FlowModes, LinearTheory, VelocityGrid, flow_modes
from vsh.tools.arguments import not_negative
from vsh.tools.errors import ParameterError
from vsh.tools.notebook import InNotebook
from vsh.tools.types import Cosmology, FloatArray

#: Dispersion of peculiar velocities in each component beyond the flows of linear theory. [km/s]
LEFT_DISPERSION = 150.0
#: So many tell the size of a flow that is left out to a few per cent.
_N_OMITTED_MODES = 100


@dataclass(frozen=True, kw_only=True, eq=False)
class DistanceModel(InNotebook):
    """Distances from redshifts, and the flows and peculiar velocities of galaxies.

    Attributes
    ----------
    cosmology : astropy cosmology, optional
        The shape of the distance; its own H0 does not count. Flat, Ω_m = 0.315 unless given.
    redshift_frame : str, optional
        "heliocentric", "cmb", "local-group" or "true"; the field's own unless given.
    flows : "linear", LinearTheory or None
        Velocities that galaxies share, which are fitted: "linear", Planck's, unless given.
    n_modes : int
        Unknowns of the flow.
    reconstruction : VelocityGrid, optional
        A known velocity field. The fitted flow is the difference from it, with `reconstruction_error` times the
        standard deviation of linear theory.
    reconstruction_error : float
    peculiar_dispersion : float, optional
        Dispersion of the peculiar velocities in each component in addition to the flow. It adds (σ_pec/d)² to every
        variance, and scatters redshifts unless their frame is "true". Default: 150; 750 with flows=None. [km/s]
    density : "volume", "fitted" or function, optional
        Density of galaxies by distance, as for `fit.distances.calibrate`.
    luminosity : function, optional
        Luminosity function; fitted unless given.
    magnitudes : bool, optional
        Whether magnitudes constrain the distances. Default: if every source has one and the sample is nearly complete.

    Raises
    ------
    ParameterError
        If a flow is none, or a dispersion counts the flows twice.

    Examples
    --------
    >>> DistanceModel(flows=None).dispersion, DistanceModel().dispersion
    (750.0, 150.0)
    """

    cosmology: Cosmology | None = None
    redshift_frame: str | None = None
    flows: Literal["linear"] | LinearTheory | None = "linear"
    n_modes: int = 250
    reconstruction: VelocityGrid | None = None
    reconstruction_error: float = 0.5
    peculiar_dispersion: float | None = None
    density: Literal["volume", "fitted"] | Callable[[FloatArray], FloatArray] | None = None
    luminosity: Callable[[FloatArray], FloatArray] | None = None
    magnitudes: bool | None = None

    def __post_init__(self) -> None:
        """Check what contradicts itself."""
        flows, grid = self.flows, self.reconstruction
        if flows not in ("linear", None) and not isinstance(flows, LinearTheory):
            raise ParameterError(f'flows are "linear", a vsh.models.flows.LinearTheory or None, not {flows!r}')
        if grid is not None and flows is None:
            raise ParameterError("a reconstruction leaves a flow to be fitted: it does not go with flows=None")
        if grid is not None and not isinstance(grid, VelocityGrid):
            raise ParameterError(f"a reconstruction is a vsh.models.flows.VelocityGrid, not {type(grid).__name__}")
        if not 0 < self.reconstruction_error <= 1:
            raise ParameterError(
                f"a reconstruction errs by a fraction of the flow above 0, at most 1, not {self.reconstruction_error!r}"
            )
        if self.peculiar_dispersion is not None:
            not_negative("peculiar_dispersion", self.peculiar_dispersion)
        if self.flow is not None and self.dispersion > 1.3 * self.flow.sigma:
            raise ParameterError(
                f"with flows a dispersion of {self.dispersion:g} km/s counts them twice: they are "
                f"{self.flow.sigma:.0f} km/s in each component by themselves, and peculiar_dispersion= is "
                "what galaxies have beside them (150 to 300; 150 unless given). Without flows: flows=None, --flows no"
            )

    @cached_property
    def flow(self) -> LinearTheory | None:
        """The theory of the whole flow; None without."""
        return LINEAR_PLANCK18 if isinstance(self.flows, str) else self.flows

    @property
    def dispersion(self) -> float:
        """The dispersion of peculiar velocities beside the flow. [km/s]"""
        if self.peculiar_dispersion is not None:
            return self.peculiar_dispersion
        return WHOLE_DISPERSION if self.flow is None else LEFT_DISPERSION

    @property
    def hubble(self) -> float:
        """H0 of the distances, by which motions are products of v and H0/H_ref. [km/s/Mpc]"""
        return hubble_value(self._distance_cosmology)

    @property
    def _distance_cosmology(self):
        return FLAT_PLANCK13 if self.cosmology is None else self.cosmology

    def equations(
        self,
        field: Field | Parts,
        *,
        ratio: float = 1.0,
        apart: bool = False,
        flow_left_out: bool = True,
        threads: int | None = None,
    ) -> ParallaxEquations | ParallaxParts:
        """The equations of a field; with `flow_left_out`, the means to tell what a flow that is not fitted would do.

        Parameters
        ----------
        field : Field or Parts
            With redshifts.
        ratio : float
            H0 over that of the cosmology, in the weights.
        apart : bool
            Whether our velocity is known, so that its part is kept separate from the unknowns.
        flow_left_out : bool
            Whether, without flows, what they would add is worked out.
        threads : int, optional
            One a core unless given.
        """
        field, theory = apply_step(field, select_certain_redshifts), self.flow
        if theory is not None and self.reconstruction is not None:  # what the reconstruction lacks
            theory = _scale_growth_rate(theory, float(self.reconstruction_error))
        calibration = self._calibrate_distances(field, theory)
        limits = calibration.flow_limits
        modes = None if theory is None else make_flow_modes_within(limits, calibration.cosmology, theory, self.n_modes)
        keywords: dict[str, Any] = {"ratio": ratio, "apart": apart, "threads": threads}
        flow = {"theory": theory, "modes": modes, "reconstruction": self.reconstruction}
        rows = make_equations(field, calibration, **flow, **keywords)
        if theory is None and flow_left_out:
            extra = make_flow_modes_within(limits, calibration.cosmology, LINEAR_PLANCK18, _N_OMITTED_MODES)
            rows = replace(rows, left_out=None if extra is None else OmittedFlow(field, calibration, extra, keywords))
        return rows

    def _calibrate_distances(self, field, theory) -> Calibration:
        radial_dispersion = self.dispersion if theory is None else float(np.hypot(self.dispersion, theory.sigma))
        return calibrate(
            field,
            self.redshift_frame,
            radial_dispersion,
            cosmology=self._distance_cosmology,
            density=self.density,
            luminosity=self.luminosity,
            magnitudes=self.magnitudes,
        )


#: Names of what a model assumes: keywords of every estimate that takes one.
ASSUMED = frozenset(DistanceModel.__dataclass_fields__)


def make_distance_model(model: DistanceModel | None, options: Mapping[str, Any]) -> DistanceModel:
    """The model that an estimate was given, or its attributes one by one."""
    if unknown := sorted({*options} - ASSUMED):
        raise ParameterError(f"no argument is called {', '.join(unknown)}; there are {', '.join(sorted(ASSUMED))}")
    if model is None:
        return DistanceModel(**options)
    if options or not isinstance(model, DistanceModel):
        raise ParameterError("give a DistanceModel, or its attributes one by one")
    return model


@lru_cache(maxsize=8)
def _scale_growth_rate(theory, factor):
    return replace(theory, growth_rate=theory.growth_rate * factor, name=f"{theory.name}, {factor:g} of it")


def make_flow_modes_within(
    redshifts: tuple[float, float], cosmology: Cosmology, theory: LinearTheory, n_modes: int
) -> FlowModes | None:
    """The modes of a flow over the distances between two redshifts; None where all of them lie beyond its reach."""
    nearest, farthest = transverse_distance(np.array(redshifts), cosmology) * hubble_value(cosmology) / 100
    if nearest > 0.9 * FARTHEST:
        return None
    # Distances given the redshift may lie beyond that of the redshift itself.
    return flow_modes(0.5 * nearest, 1.2 * farthest, n_modes, theory)
