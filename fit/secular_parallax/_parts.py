"""The equations of the secular parallax, of a field or of a catalogue in parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from fit.distances import Calibration
from fit.secular_parallax._equations import ParallaxEquations, ParallaxSums, equations_of
from vsh.checks.notes import merge_notes
from vsh.checks.types import ArrayLike
from vsh.cosmology import hubble_value
from vsh.errors import FrameError
from vsh.field import Field
from vsh.flows import FlowModes
from vsh.parts import DISTANCES, Parts


@dataclass(frozen=True, eq=False)
class ParallaxParts:
    """The same of a catalogue in parts: the equations stay where the parts are, sums come back.

    Attributes
    ----------
    sky : Parts
    calibration : Calibration
    options : dict
        Of `equations_of`.
    n_data : int
    smallest_variance : float
        Of all equations. [(µas/yr)²]
    largest_rate : float
        Of all equations. [µas/yr per km/s]
    hubble : float
        H_ref [km/s/Mpc]
    frame : str
    notes : tuple of str
    n_own : int
        Sources whose distance is in Mpc whatever H0 is.
    left_out : LeftOut or None
        The flow that is in reach of the sources and not among the columns.
    """

    sky: Parts
    calibration: Calibration
    options: dict[str, Any]
    n_data: int
    smallest_variance: float
    largest_rate: float
    hubble: float
    frame: str
    notes: tuple[str, ...]
    n_own: int
    left_out: Any = None

    @property
    def modes(self) -> FlowModes | None:
        """Those of the flow."""
        return self.options.get("modes")

    @classmethod
    def of(cls, sky: Parts, calibration: Calibration, options: dict[str, Any]) -> ParallaxParts:
        """The equations of a catalogue in parts."""
        work = partial(_facts_of, calibration=calibration, options=options)
        facts = sky.sum(work, roles=DISTANCES, words="redshifts")
        if len(facts["frames"]) > 1:
            raise FrameError(f"parts are in {' and '.join(sorted(facts['frames']))}: take all to one frame")
        return cls(
            sky, calibration, options, facts["n_data"], min(facts["variance"]), max(facts["rate"]),
            hubble_value(calibration.cosmology), next(iter(facts["frames"])), merge_notes(*facts["notes"]), facts["n_own"],
        )  # fmt: skip

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, ratio: float = 1.0, threads: int | None = None
    ) -> ParallaxSums:
        """As `ParallaxEquations.sums`."""
        given = {"spread": spread, "excess_noise": excess_noise, "ratio": ratio, "threads": threads}
        work = partial(_sums_of, calibration=self.calibration, options=self.options, given=given)
        return self.sky.sum(work, roles=DISTANCES, words="secular parallax")


def _facts_of(field, calibration, options):
    rows = equations_of(field, calibration, **options)
    return {
        "n_data": rows.n_data,
        "variance": [rows.smallest_variance],
        "rate": [rows.largest_rate],
        "frames": {rows.frame: None},
        "notes": [rows.notes],
        "n_own": rows.n_own,
    }


def _sums_of(field, calibration, options, given):
    return equations_of(field, calibration, **options).sums(**given)


def equations(field: Field | Parts, calibration: Calibration, **options: Any) -> ParallaxEquations | ParallaxParts:
    """The equations of a field or of parts."""
    if isinstance(field, Parts):
        return ParallaxParts.of(field, calibration, options)
    return equations_of(field, calibration, **options)
