"""From what users say of redshifts and flows to the equations."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, TypedDict
from warnings import warn

import numpy as np

from fit.distances import WHOLE_DISPERSION, calibrate
from fit.secular_parallax._equations import ParallaxEquations, ParallaxParts, equations
from fit.secular_parallax._solve import LeftOut
from vsh.field import Field
from vsh.io.parts import Parts
from vsh.models.cosmology import FLAT_PLANCK13, hubble_value, transverse_distance
from vsh.models.flows import FARTHEST, LINEAR_PLANCK18, FlowModes, LinearTheory, VelocityGrid, flow_modes
from vsh.tools.arguments import not_negative
from vsh.tools.errors import ParameterError, VshError, VshWarning
from vsh.tools.types import Cosmology, FloatArray

#: Dispersion of peculiar velocities in each component beyond the flows of linear theory. [km/s]
LEFT_DISPERSION = 150.0
#: So many tell the size of a flow that is left out to a few per cent.
_MODES_LEFT_OUT = 100


class DistanceOptions(TypedDict, total=False):
    """How distances follow from redshifts, and what flows galaxies share: keywords of the estimators."""

    redshift_frame: str | None
    flows: Literal["linear"] | LinearTheory | None
    n_modes: int
    reconstruction: VelocityGrid | None
    reconstruction_error: float
    density: Literal["volume", "fitted"] | Callable[[FloatArray], FloatArray] | None
    luminosity: Callable[[FloatArray], FloatArray] | None
    magnitudes: bool | None


def dispersion_of(peculiar_dispersion: float | None, options: DistanceOptions) -> float:
    """The dispersion of peculiar velocities: 750 km/s, or 150 beside the flows of linear theory. [km/s]"""
    flows = flow_theory(options)
    if peculiar_dispersion is not None:
        not_negative("peculiar_dispersion", peculiar_dispersion)
    if flows is None:
        return WHOLE_DISPERSION if peculiar_dispersion is None else peculiar_dispersion
    if peculiar_dispersion is None:
        return LEFT_DISPERSION
    if peculiar_dispersion > most_beside(flows):
        raise ParameterError(
            f"with flows a dispersion of {peculiar_dispersion:g} km/s counts them twice: they are {flows.sigma:.0f} "
            "km/s in each component by themselves, and peculiar_dispersion= is what galaxies have beside them (150 to "
            "300; 150 unless given). Without flows: flows=None, --no-flows"
        )
    return peculiar_dispersion


def most_beside(flows: LinearTheory | None) -> float:
    """The largest dispersion beside flows, which otherwise are counted twice; none without flows. [km/s]"""
    return float("inf") if flows is None else 1.3 * flows.sigma


def flow_theory(options: DistanceOptions) -> LinearTheory | None:
    """The theory of the flows that are fitted."""
    flows = options.get("flows", "linear")
    if isinstance(flows, str) and flows == "linear":
        return LINEAR_PLANCK18
    if flows is not None and not isinstance(flows, LinearTheory):
        raise ParameterError(f'flows are "linear", a vsh.models.flows.LinearTheory or None, not {flows!r}')
    if flows is None and options.get("reconstruction") is not None:
        raise ParameterError(
            "a reconstruction leaves a flow to be fitted, what it lacks: it does not go with flows=None"
        )
    return flows


def parallax_equations(
    field: Field | Parts,
    cosmology: Cosmology | None = None,
    *,
    peculiar_dispersion: float | None = None,
    ratio: float = 1.0,
    apart: bool = False,
    flow_left_out: bool = True,
    threads: int | None = None,
    **options: Any,
) -> ParallaxEquations | ParallaxParts:
    """The equations of a field; with `flow_left_out`, the means to tell what a flow that is not fitted would do."""
    unknown = set(options) - set(DistanceOptions.__annotations__)
    if unknown:
        raise ParameterError(
            f"no argument is called {', '.join(sorted(unknown))}; there are "
            f"{', '.join(DistanceOptions.__annotations__)}"
        )
    given = DistanceOptions(**options)  # type: ignore[typeddict-item]
    cosmology = FLAT_PLANCK13 if cosmology is None else cosmology
    dispersion = dispersion_of(peculiar_dispersion, given)
    flows, grid = _theory_left(given), given.get("reconstruction")
    radial = dispersion if flows is None else float(np.hypot(dispersion, flows.sigma))
    calibration = calibrate(
        field,
        given.get("redshift_frame"),
        radial,
        cosmology=cosmology,
        density=given.get("density"),
        luminosity=given.get("luminosity"),
        magnitudes=given.get("magnitudes"),
    )
    modes = None
    if flows is not None:
        modes = modes_within(calibration.flow_limits, calibration.cosmology, flows, given.get("n_modes", 250))
    how = {"ratio": ratio, "apart": apart, "threads": threads}
    rows = equations(field, calibration, theory=flows, modes=modes, reconstruction=grid, **how)
    if flows is None and flow_left_out:
        reach = modes_within(calibration.flow_limits, calibration.cosmology, LINEAR_PLANCK18, _MODES_LEFT_OUT)
        rows = replace(rows, left_out=None if reach is None else LeftOut(field, calibration, reach, how))
    return rows


def _theory_left(options) -> LinearTheory | None:
    """The theory of the flow that is fitted: of what a reconstruction lacks, where there is one."""
    theory, grid = flow_theory(options), options.get("reconstruction")
    if theory is None or grid is None:
        return theory
    if not isinstance(grid, VelocityGrid):
        raise ParameterError(f"a reconstruction is a vsh.models.flows.VelocityGrid, not {type(grid).__name__}")
    error = options.get("reconstruction_error", 0.5)
    if not 0 < error <= 1:
        raise ParameterError(f"a reconstruction errs by a fraction of the flow above 0, at most 1, not {error!r}")
    return _scaled(theory, float(error))


@lru_cache(maxsize=8)
def _scaled(theory, error):
    return replace(theory, growth_rate=theory.growth_rate * error, name=f"{theory.name}, {error:g} of it")


def modes_within(
    redshifts: tuple[float, float], cosmology: Cosmology, theory: LinearTheory, n_modes: int
) -> FlowModes | None:
    """The modes of a flow over the distances between two redshifts; None where all of them lie beyond its reach."""
    low, high = transverse_distance(np.array(redshifts), cosmology) * hubble_value(cosmology) / 100
    if low > 0.9 * FARTHEST:
        return None
    # Distances given the redshift may lie beyond that of the redshift itself.
    return flow_modes(0.5 * low, 1.2 * high, n_modes, theory)


def undeclared(field: Field | Parts, redshift_frame: str | None) -> bool:
    """Whether the frame of the redshifts is not given."""
    if redshift_frame is not None:
        return False
    first = field if isinstance(field, Field) else next(iter(field))
    return first.redshift is not None and first.redshift_frame is None


def by_frame(words: Callable[[str], str], frames: Sequence[str]) -> dict[str, tuple[bool, str]]:
    """What would be found were the redshifts in each of some frames: whether it is found, and words."""
    words_by_frame = {}
    for frame in frames:
        try:
            with np.errstate(all="ignore"):
                words_by_frame[frame] = True, words(frame)
        except VshError as error:
            words_by_frame[frame] = False, str(error)
    return words_by_frame


def noted(
    rows: Any, field: Field | Parts, redshift_frame: str | None, words: Callable[[str], str] | None = None
) -> Any:
    """The equations, with a note and a warning where the frame of the redshifts is not given."""
    if not undeclared(field, redshift_frame):
        return rows
    changes = ["what it would change fit.secular_parallax.observer_velocity tells"]
    if words is not None:
        words_by_frame = by_frame(words, ("heliocentric", "cmb"))
        changes = [
            f"as {frame} ones they give {reason}" if good else f"as {frame} ones they cannot be used ({reason})"
            for frame, (good, reason) in words_by_frame.items()
        ]
    note = (
        "the frame of the redshifts is not given, so they are taken as true ones, without velocities or "
        "errors in them. " + "; ".join(changes) + ". Say which: redshift_frame= (--redshift-frame)"
    )
    warn(note, VshWarning, stacklevel=4)
    return replace(rows, notes=(f"warning: {note}", *rows.notes))
