"""From a catalogue to the calibration of its distances."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np

from fit.distances._calibration import Calibration
from fit.distances._density import (
    MODULI,
    GivenDensity,
    LuminosityFunction,
    SourceDensity,
    complete_to,
    completed,
    errors_by_redshift,
    fit_density,
    fit_luminosity,
    flow_counts,
    flow_limits,
    magnitude_counts,
    median_spread,
    redshift_counts,
    variance_sums,
)
from vsh.field import Field
from vsh.io.parts import DISTANCES, Parts, as_parts
from vsh.models.cosmology import FLAT_PLANCK13, FLOW_LIMIT, distance_modulus, transverse_distance, with_redshift
from vsh.sky.frames import TRUE, check_redshift_frame
from vsh.tools.errors import FieldError, NothingLeftError, ParameterError
from vsh.tools.types import Cosmology, FloatArray

#: Dispersion of peculiar velocities in each component, those of flows among them. [km/s]
WHOLE_DISPERSION = 750.0


def calibrate(
    field: Field | Parts,
    redshift_frame: str | None = None,
    dispersion: float = WHOLE_DISPERSION,
    *,
    cosmology: Cosmology | None = None,
    density: Literal["volume", "fitted"] | Callable[[FloatArray], FloatArray] | None = None,
    luminosity: Callable[[FloatArray], FloatArray] | None = None,
    magnitudes: bool | None = None,
) -> Calibration:
    """How the distances of a catalogue follow from its redshifts.

    Parameters
    ----------
    field : Field or Parts
        With redshifts, none missing or below 1e-4; gone through twice at most.
    redshift_frame : str, optional
        "heliocentric", "cmb", "local-group" or "true"; the field's own unless given.
    dispersion : float
        Dispersion of radial peculiar velocities, those of flows among them. [km/s]
    cosmology : astropy cosmology, optional
        Flat, Ω_m = 0.315, H0 = 67.3 unless given.
    density : "volume", "fitted", or a function of distance [Mpc], optional
        Sources per comoving volume, up to a factor: one everywhere, as the catalogue's redshifts have it, or given.
        With magnitudes of all sources that there are; without, of those in the catalogue. Fitted unless given.
    luminosity : function of absolute magnitude, optional
        log φ up to a constant; fitted to the catalogue, complete to its faintest magnitude, unless given.
    magnitudes : bool, optional
        Whether to use them; unless given if all sources have one and the sample is complete to its faintest, by
        Rauzy's (2001) test.

    Raises
    ------
    ParameterError
        If a frame or a density is none, or magnitudes are asked for and there are none.
    FieldError
        If the dispersion is larger than c z of most sources, some magnitudes are missing, or redshifts cannot be used.
    """
    cosmology = FLAT_PLANCK13 if cosmology is None else cosmology
    sky = as_parts(field)
    bare = bare_calibration(field, redshift_frame, dispersion, cosmology)
    facts = sky.sum(partial(_facts, calibration=bare), roles=DISTANCES, words="redshifts")
    limits = float(min(facts["lowest"])), float(max(facts["highest"]))
    bare = replace(bare, limits=limits, flow_limits=flow_limits(facts["flow"]))
    if not facts["counts"][:, 0].any():
        return bare
    typical = median_spread(facts["counts"])
    _check_size(bare, facts, dispersion)
    known, n = facts["magnitudes"], facts["n"]
    if magnitudes is None and 0 < known < n:
        raise FieldError(
            f"{n - known} of {n} sources have no magnitude: leave those out (field[np.isfinite(field.magnitude)]), or "
            "use no magnitudes (magnitudes=False, --no-magnitudes)"
        )
    if magnitudes and known < n:
        raise ParameterError(f"magnitudes are asked for, and {n - known} of {n} sources have none")
    use = known == n if magnitudes is None else bool(magnitudes)
    notes = _mixture(facts["counts"], typical)
    given = luminosity is not None
    bright, complete = _far_enough(facts["bright"], typical, cosmology), max(facts["faintest"], default=np.nan)
    if use and not given:
        limit, brighter = complete_to(bright, complete)
        if np.isnan(limit) and magnitudes is None:
            use = False
            notes.append(
                "magnitudes are not used: the sample is complete to none of them (Rauzy's T_C below -3 for each); "
                "magnitudes=True takes it for complete to its faintest"
            )
        elif limit < complete:
            notes.append(
                f"the sample is complete to magnitude {limit:.2f}, not to its faintest, {complete:.2f} (Rauzy's T_C): "
                "luminosity function and density are those of the complete part"
            )
            bright, complete = brighter, limit
            work = partial(_counts_to, calibration=bare, limit=limit)
            facts |= {"counts": sky.sum(work, roles=DISTANCES, words="redshifts of the complete part")}
    if use:
        measured = (
            LuminosityFunction(luminosity, "luminosity function as given")
            if luminosity is not None
            else fit_luminosity(bright, complete)
        )
        bare = replace(bare, luminosity=measured)
        if not given:
            notes.append(
                "magnitudes tell distances by a luminosity function fitted to the catalogue, which is to be complete "
                "to its faintest one: magnitudes=False (--no-magnitudes) where it is not"
            )
    elif given:
        raise ParameterError("a luminosity function needs magnitudes, which are not used")
    else:
        errors = errors_by_redshift(facts["variances"])
        bare = replace(bare, errors=errors)
        notes.append(
            "no magnitudes: distances follow from redshifts alone, and where they are unsure by more than 5 % sources "
            "weigh by the mean errors of their redshift; with magnitudes results would be surer"
        )
    return replace(bare, density=_density(density, complete if use else None, facts, bare), notes=tuple(notes))


def bare_calibration(
    field: Field | Parts, redshift_frame: str | None, dispersion: float, cosmology: Cosmology
) -> Calibration:
    """The frame of the redshifts alone."""
    frame = check_redshift_frame(redshift_frame or _frame_of(as_parts(field)) or TRUE)
    return Calibration(frame, dispersion, cosmology, SourceDensity())


#: Redshifts of so many times the typical error are another kind, and so many of them bear on the errors of a velocity.
_UNSURE, _MANY = 2.0, 0.02


def _mixture(counts, typical):
    """A note where some redshifts are much less certain than most, as photometric ones among spectroscopic ones."""
    number = counts[:, 1:].sum(axis=1)
    spread = np.sqrt(counts[:, 0] / np.maximum(number, 1.0))
    unsure = int(number[spread > _UNSURE * typical].sum())
    if unsure < _MANY * number.sum():
        return []
    return [
        f"{unsure} of {int(number.sum())} redshifts have errors more than {_UNSURE:g} times the typical one, as "
        "photometric ones have: with galaxies as near as z = 0.002 the errors of a velocity are then up to 15 % too "
        "small (docs/validation.md). Leave those sources out where that matters (--where, field[mask])"
    ]


def calibrate_if_known(
    field: Field | Parts, redshift_frame: str | None, dispersion: float | None
) -> Calibration | None:
    """A calibration where the frame of redshifts is known; None where it is not, or redshifts are true ones."""
    sky = as_parts(field)
    frame = check_redshift_frame(redshift_frame or _frame_of(sky) or TRUE)
    if frame == TRUE:
        return None
    usable_ones = sky.map(partial(with_redshift, redshift_frame=frame))
    try:
        known, n = usable_ones.sum(_magnitudes, roles=DISTANCES, words="magnitudes")
    except NothingLeftError:  # no source is beyond the flow
        return None
    return calibrate(
        usable_ones,
        frame,
        WHOLE_DISPERSION if dispersion is None else dispersion,
        magnitudes=None if known == n else False,
    )


def _magnitudes(field):
    return np.array([0 if field.magnitude is None else np.isfinite(field.magnitude).sum(), len(field)])


def _density(density, limit, facts, calibration):
    if callable(density):
        return SourceDensity(GivenDensity(density), "as given")
    if density == "volume":
        return SourceDensity()
    if density not in (None, "fitted"):
        raise ParameterError(f'a density is "volume", "fitted" or a function of distance, not {density!r}')
    # A catalogue that was cut in redshifts as observed lacks, next to its limits, sources of some directions.
    low, high, shift = min(facts["lowest seen"]), max(facts["highest seen"]), max(facts["shift"])
    cut = (float(np.expm1(np.log1p(low) + shift)), float(np.expm1(np.log1p(high) - shift)))
    fitted = fit_density(facts["counts"], calibration.log_distance, calibration.limits, cut)
    if limit is None:
        return fitted
    return completed(fitted, calibration.luminosity, limit, calibration.log_distance)


def _frame_of(sky):
    """The frame that the first part says."""
    field = sky.in_memory
    return (next(iter(sky)) if field is None else field).redshift_frame


def _facts(field, calibration):
    """What of some sources bears on the calibration of all."""
    z = calibration.redshift(field)
    spread = calibration.spread(field, z)
    modulus = distance_modulus(transverse_distance(z, calibration.cosmology), z)
    known = np.zeros(len(field), bool) if field.magnitude is None else np.isfinite(field.magnitude)
    bright = field.magnitude[known] if known.any() else np.empty(0)
    return {
        "n": len(field),
        "lowest": [z.min()],
        "highest": [z.max()],
        "lowest seen": [field.redshift.min()],
        "highest seen": [field.redshift.max()],
        "shift": [np.abs(np.log1p(z) - np.log1p(field.redshift)).max()],
        "lost": int(np.sum(spread > np.log1p(z))),
        "magnitudes": int(known.sum()),
        "faintest": [bright.max()] if known.any() else [],
        "bright": magnitude_counts(bright, modulus[known]),
        "counts": redshift_counts(z, spread),
        "flow": flow_counts(z, field.information),
        "variances": variance_sums(z, field.sigma),
    }


def _counts_to(field, calibration, limit):
    """Redshifts of the sources that are as bright as a limit."""
    z = calibration.redshift(field)
    inside = field.magnitude <= limit
    return redshift_counts(z[inside], calibration.spread(field, z)[inside])


def _check_size(calibration, facts, dispersion):
    if 2 * facts["lost"] > facts["n"]:
        raise FieldError(
            f"the errors and peculiar velocities of redshifts ({dispersion:g} km/s) are larger than c z of "
            f"{facts['lost']} of {facts['n']} sources: their redshifts tell no distance. Take farther sources, or "
            "distances (distance=) that something else tells"
        )


def _far_enough(counts, spread, cosmology):
    """Counts of sources whose absolute magnitudes are not blurred by the errors of redshifts, where they are enough."""
    z = 10 * spread
    modulus = distance_modulus(transverse_distance(np.array([max(z, FLOW_LIMIT)]), cosmology)[0], z)
    far = counts * (modulus <= MODULI)
    return far if far.sum() >= max(1000, 0.2 * counts.sum()) else counts
