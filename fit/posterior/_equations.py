"""The equations of a catalogue under priors: what users say of redshifts, flows and what is known before."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from fit.posterior._priors import DISTANCES, ModelPriors, Priors, checked_priors
from fit.secular_parallax import (
    OMEGA,
    DistanceOptions,
    ParallaxEquations,
    ParallaxParts,
    flow_covariance,
    noted,
    parallax_equations,
)
from vsh.checks.types import Cosmology
from vsh.errors import ParameterError
from vsh.field import Field
from vsh.parts import Parts


def distances_of(options: dict[str, Any]) -> DistanceOptions:
    """Those of the keywords that say how distances follow from redshifts."""
    return DistanceOptions(**{name: value for name, value in options.items() if name in DISTANCES})  # type: ignore[typeddict-item]


def posterior_equations(
    field: Field | Parts, priors: Priors, cosmology: Cosmology | None, distances: DistanceOptions
) -> tuple[ParallaxEquations | ParallaxParts, ModelPriors]:
    """The equations of a catalogue, and the priors along its axes."""
    first = field if isinstance(field, Field) else next(iter(field))
    given = checked_priors(priors, first.frame, distances)
    rows = parallax_equations(field, cosmology, peculiar_dispersion=given.typical_dispersion, **distances)
    if rows.n_own:
        raise ParameterError(
            f"{rows.n_own} sources have distances in Mpc, of which the motions tell v, not v · H0: the posterior takes redshifts "
            "alone. Leave those distances out, or fit with fit.secular_parallax.observer_velocity"
        )
    rows = noted(rows, field, distances.get("redshift_frame"))
    if rows.left_out is not None:
        rows = replace(rows, notes=(_left_out(rows, given), *rows.notes))
    if rows.modes is not None:
        given = replace(given, flows=f"{len(rows.modes)} modes of {rows.modes.theory.name}")
    return rows, given


def _left_out(rows, given):
    """What flows that were left out would add, as a note."""
    sums = rows.left_out.sums(given.typical_dispersion, 0.0, rows.n_data // 2)
    size = np.sqrt(np.diag(flow_covariance(sums, np.eye(9)[:, : OMEGA.start], 1.0)))
    return (
        "warning: not in the intervals: flows of linear theory, which galaxies share, add about "
        f"± {np.sqrt(np.mean(size[:3] ** 2)):.0f} km/s to each component of v H0/H_ref, and ± "
        f"{np.sqrt(np.mean(size[3:] ** 2)):.2g} µas/yr to the acceleration's"
    )
