"""The equations of the secular parallax, of a field or of a catalogue in parts."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

from fit.secular_parallax._equations import ParallaxEquations, ParallaxSums, equations_of
from vsh.checks.notes import merge_notes
from vsh.cosmology import PLANCK_2013, hubble_value
from vsh.errors import FrameError
from vsh.field import Field
from vsh.parts import Parts
from vsh.types import ArrayLike, Cosmology


@dataclass(frozen=True, eq=False)
class ParallaxParts:
    """The same of a catalogue in parts: the equations stay where the parts are, sums come back.

    Attributes
    ----------
    sky : Parts
    cosmology : astropy cosmology
    n_data : int
    smallest_variance : float
        Of all equations. [(µas/yr)²]
    largest_rate : float
        Of all equations. [µas/yr per km/s]
    hubble : float
        H_ref [km/s/Mpc]
    frame : str
    notes : tuple of str
    """

    sky: Parts
    cosmology: Cosmology
    n_data: int
    smallest_variance: float
    largest_rate: float
    hubble: float
    frame: str
    notes: tuple[str, ...]

    @classmethod
    def of(cls, sky: Parts, cosmology: Cosmology) -> ParallaxParts:
        """The equations of a catalogue in parts.

        Parameters
        ----------
        sky : Parts
            With redshifts.
        cosmology : astropy cosmology
            The shape of the distance.

        Raises
        ------
        FrameError
            If parts stand in different frames.
        """
        facts = sky.sum(partial(_facts_of, cosmology=cosmology), roles=("redshift",), words="redshifts")
        if len(facts["frames"]) > 1:
            raise FrameError(f"parts are in {' and '.join(sorted(facts['frames']))}: take all to one frame")
        return cls(
            sky, cosmology, facts["n_data"], min(facts["variance"]), max(facts["rate"]), hubble_value(cosmology),
            next(iter(facts["frames"])), merge_notes(*facts["notes"]),
        )  # fmt: skip

    def sums(
        self, spread: ArrayLike = 0.0, excess_noise: ArrayLike = 0.0, *, threads: int | None = None
    ) -> ParallaxSums:
        """As `ParallaxEquations.sums`.

        Parameters
        ----------
        spread, excess_noise, threads
            As there.

        Returns
        -------
        ParallaxSums
        """
        work = partial(_sums_of, cosmology=self.cosmology, spread=spread, excess_noise=excess_noise, threads=threads)
        return self.sky.sum(work, roles=("redshift",), words="secular parallax")


def _facts_of(field, cosmology):
    rows = equations_of(field, cosmology)
    return {
        "n_data": rows.n_data,
        "variance": [rows.smallest_variance],
        "rate": [rows.largest_rate],
        "frames": {rows.frame: None},
        "notes": [rows.notes],
    }


def _sums_of(field, cosmology, spread, excess_noise, threads):
    return equations_of(field, cosmology).sums(spread, excess_noise, threads=threads)


def parallax_equations(field: Field | Parts, cosmology: Cosmology | None = None) -> ParallaxEquations | ParallaxParts:
    """The equations of a field.

    Parameters
    ----------
    field : Field or Parts
        With redshifts. Parts are gone through once for every set of sums that is asked for.
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.

    Returns
    -------
    ParallaxEquations, or ParallaxParts of parts

    Raises
    ------
    FieldError
        If a redshift is missing, not positive or below the flow.
    """
    cosmology = PLANCK_2013 if cosmology is None else cosmology
    if isinstance(field, Parts):
        return ParallaxParts.of(field, cosmology)
    return equations_of(field, cosmology)
