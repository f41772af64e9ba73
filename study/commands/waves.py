"""`vsh-waves`: waves and backgrounds within the mission from epoch astrometry, on the command line.

It knows both the fits and the scanning law whose attitude took a part of what is looked for.
"""

import argparse
from pathlib import Path
from typing import Any

import numpy as np

import sim
import vsh
from sim.commands import check_calibration_words
from vsh.commands import finishing, parsing, reading, running
from vsh.io.sections import Section
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.errors import TableError
from vsh.tools.printing import printable
from vsh.tools.units import DEGREE


def make_parser() -> argparse.ArgumentParser:
    """The parser of its options."""
    parser = parsing.make_parser(
        prog="vsh-waves",
        description=(
            "Look for gravitational waves within the mission in epoch astrometry: limits by frequency, with what an"
            " attitude solved from the same sky took of them."
        ),
        examples=(
            "vsh-waves epochs.fits --frequencies 0.25:4:16 --output waves",
            "vsh-waves epochs.fits --frequencies 0.5,1,2 --attitude known",
            "vsh-waves epochs.fits --frequencies 2 --calibration 'free every 5 days to order 1'",
        ),
    )
    add = parsing.adder(parser)
    add("epochs", "a file of epoch astrometry in DR4's columns, or a folder of them")
    add(
        "--frequencies LOW:HIGH:N",
        "frequencies to search, N per year from LOW to HIGH, or a list such as 0.5,1,2 (default: 0.25:4:16)",
        _parse_frequencies,
        _parse_frequencies("0.25:4:16"),
    )
    add(
        "--attitude",
        "attitude that was solved from the same sky, as that of Gaia, or known from elsewhere",
        ("solved", "known"),
        "solved",
    )
    add(
        "--calibration WORDS",
        "what was calibrated of the basic angle together with an attitude that was solved | as 'free every 5 days to "
        "order 1, known to 0.1 µas', or none; default: constant to order 8, as in DR2",
        check_calibration_words,
        "constant to order 8",
    )
    add("--law FILE", "scanning law, the commanded_scan_law of Gaia (default: a nominal one)")
    add("--positions FILE", "table of source_id, ra and dec, for epochs without ra0 and dec0")
    add("--lmax", "highest degree of the search", parsing.count(2, 20), 5)
    add("--nside", "NSIDE of the map of directions", parsing.parse_nside, 8)
    add("--skies N", "number of simulated skies of noise, for p-values", parsing.count(1), 1000)
    add("--seed", "seed of the simulated skies", int, 1)
    reading.add_output(parser)
    return parsing.add_common(parser)


def _parse_frequencies(text):
    if ":" not in text:
        frequencies = parsing.parse_numbers(text)
        if not all(frequency > 0 for frequency in frequencies):
            raise argparse.ArgumentTypeError(f"frequencies above zero are expected, not {text!r}")
        return frequencies
    try:
        low_text, high_text, count_text = text.split(":")
        low_high_count = float(low_text), float(high_text), int(count_text)
    except ValueError:
        low_high_count = (0.0, 0.0, 0)
    if not (0 < low_high_count[0] < low_high_count[1] and 1 < low_high_count[2] <= 10_000):
        raise argparse.ArgumentTypeError(f"LOW:HIGH:N with 0 < LOW < HIGH is expected, as 0.25:4:16, not {text!r}")
    low, high, n_frequencies = low_high_count
    return tuple(low + (high - low) * i / (n_frequencies - 1) for i in range(n_frequencies))


#: NSIDE of the map of the stars' response.
_RESPONSE_NSIDE = 8
#: The mean axis may be so far from the law's before it is said. [deg]
_MAX_AXIS_OFFSET = 1.0
CAPTIONS = {
    "waves": "The strain that one wave can have, with 95 %, against its frequency: median and range over directions."
}


def check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End with what contradicts itself, before anything is read."""
    if options.attitude == "known" and options.calibration != parser.get_default("calibration"):
        parser.error("--calibration goes with --attitude solved: nothing is calibrated where the attitude is known")


def _run(options):
    run = finishing.Run(options)
    from fit.waves import search_in_time

    epoch_files = vsh.io.epochs.epoch_files(options.epochs)
    chunks = list(vsh.io.epochs.iterate_observations(options.epochs, positions=options.positions))
    span = float(min(chunk.time.min() for chunk in chunks)), float(max(chunk.time.max() for chunk in chunks))
    attitude, notes, is_far = "known", [], False
    if options.attitude != "known":
        attitude, notes, is_far = _make_response(chunks, span, options)
    search = search_in_time(
        chunks, options.frequencies, attitude=attitude, lmax=options.lmax, nside=options.nside, n_skies=options.skies,
        rng=options.seed,
    )  # fmt: skip

    def make_sections(long):
        return [
            *search.sections(long=long),
            *([Section("The attitude", remarks=notes)] if notes and (long or is_far) else ()),
        ]

    run.finish(
        [finishing.Part("waves", search, "Waves")],
        sections=make_sections,
        answer=search.answer,
        notes=(*search.notes, *notes),
        paths=[*epoch_files],
        counts={"sources": sum(len(chunk.lon) for chunk in chunks)},
        captions=CAPTIONS,
        title=f"Waves in {Path(options.epochs).name}",
    )


def _make_response(chunks, span, options):
    """Response of the attitude by a law, of a table or fitted to epochs, notes on its axis, and if it is far off."""
    epoch = vsh.io.archive.DR4.epoch
    if any(chunk.view is None for chunk in chunks) and not options.law:
        raise TableError(
            f"{printable(options.epochs)} does not say in which field of view a source was seen (transit_id does): "
            "an attitude that was solved needs it. --law FILE, Gaia's commanded scanning law, tells it from the times"
        )
    if options.law:
        law: Any = _read_scanning_law(options.law)
        if law.start > epoch + span[0] or law.start + law.years < epoch + span[1]:
            raise TableError(
                f"{printable(options.law)} goes from {law.start:.2f} to {law.start + law.years:.2f}, the epochs from "
                f"{epoch + span[0]:.2f} to {epoch + span[1]:.2f}"
            )
    else:
        times = np.sort(np.concatenate([chunk.time for chunk in chunks]))
        longest = max(0.003, 30 * float(np.median(np.diff(times))))
        start = epoch + span[0]
        law = _fit_nominal_law(chunks, start, span[1] - span[0], sim.find_gaps(epoch + times, start, longest=longest))
    response = sim.agis.Response(law, nside=_RESPONSE_NSIDE, epoch=epoch, calibration=options.calibration)
    axis_offset = np.degrees(np.median([_compute_median_axis_offset(chunk, law) for chunk in chunks]))
    note = f"spin axis of the scanning law: {axis_offset:.2g}° from that of the transits, median"
    if axis_offset > _MAX_AXIS_OFFSET:
        note = f"warning: {note}; --law takes the law as it was commanded"
    return response, [note], axis_offset > _MAX_AXIS_OFFSET


def _fit_nominal_law(chunks, start, years, gaps):
    """A nominal law whose axis is, at the first transit, where it was seen: r × m of the scan."""
    axes, times = _compute_spin_axes_and_times(min(chunks, key=lambda chunk: chunk.time.min()))
    first_transit = int(np.argmin(times))
    sun_longitude, _ = sim.scanning.sun_position(start, np.zeros(1))
    perpendicular_to_sun = np.array([-np.sin(sun_longitude[0]), np.cos(sun_longitude[0]), 0.0])
    ecliptic_axis = rotation_matrix("icrs", "ecliptic") @ axes[:, first_transit]
    return sim.NominalScanningLaw(
        start=start,
        years=years,
        precession_phase=float(np.arctan2(ecliptic_axis[2], ecliptic_axis @ perpendicular_to_sun)),
        gaps=tuple(gaps),
    )


def _compute_spin_axes_and_times(observations):
    """The spin axis at every transit, r × m, (3, k), and the times."""
    p, q, r = triad(observations.lon[observations.source], observations.lat[observations.source])
    scan_direction = p * observations.design[0] + q * observations.design[1]
    return np.cross(r, scan_direction / np.linalg.norm(scan_direction, axis=0), axis=0), observations.time


def _compute_median_axis_offset(observations, law):
    """Median offset of the axis of the law. [rad]"""
    spin_axes, times = _compute_spin_axes_and_times(observations)
    law_axes = law.attitude(np.clip(times + (vsh.io.archive.DR4.epoch - law.start), 0, law.years))[0]
    return np.median(np.arccos(np.clip(np.sum(spin_axes * law_axes, 0), -1, 1)))


def _read_scanning_law(path):
    """The columns of Gaia's commanded_scan_law, or time [Julian years] in place of its days."""
    table = vsh.io.tables.open_table(path)
    names = ("ra_fov1", "dec_fov1", "ra_fov2", "dec_fov2")
    time_column = next((name for name in ("jd_time", "time") if name in table.names), None)
    missing = [name for name in names if name not in table.names] + ([] if time_column else ["jd_time"])
    if missing:
        raise TableError(f"{table.label}: a scanning law has jd_time, {', '.join(names)}; missing {', '.join(missing)}")
    columns = {name: np.asarray(table.columns((name,))[name][0], float) for name in (*names, str(time_column))}
    times = columns[str(time_column)]
    # Days since J2010.0 in Gaia's table, whole Julian dates elsewhere, years where the column says so.
    years = times if time_column == "time" else 2010.0 + (times - (2455197.5 if times[0] > 1e6 else 0.0)) / 365.25
    order = np.argsort(years, kind="stable")
    pointings = [np.array([columns[f"{axis}_fov{k}"][order] for axis in ("ra", "dec")]) * DEGREE for k in (1, 2)]
    return sim.TabulatedLaw(years[order], *pointings)


main, run = running.make_entry(__name__, _run)
