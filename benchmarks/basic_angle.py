"""Waves in epochs whose attitude and basic angle were solved from the same sky.

`python benchmarks/basic_angle.py left`: the share of a wave's degrees 2 and 3 along the scan that is left (rms), by frequency and
calibration.

`python benchmarks/basic_angle.py joint [STARS] [NSIDE]`: a wave put into sky, attitude and basic angle, solved together, and found
again by a response with that calibration, with none, and with the attitude taken as known.

`python benchmarks/basic_angle.py limits [SKIES] [STARS]`: p-values and limits on skies of noise added to such epochs.

`python benchmarks/basic_angle.py errors [QUASARS]`: true over formal errors of spin and acceleration with each calibration.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
import time
from dataclasses import replace

import numpy as np
from time_axis import LAW, SPAN, five_parameters_of, observed, solved_system, through

from fit import in_time
from fit.waves import search_in_time
from sim import agis
from vsh import Modes
from vsh.basis import harmonics
from vsh.models.waves import wave_motions, wave_templates
from vsh.sky.pixels import centres
from vsh.sky.sphere import triad

CALIBRATIONS = (
    None,
    "constant to order 8",
    "free every 3.3 days",
    "free every 90 days to order 2",
    "free every 5 days to order 1, known to 0.1 µas",
    "free every 5 days to order 1, known to 1 µas",
    "free every 5 days to order 1",
    "free every 5 days to order 2",
)


def left(nside=6):
    some, modes = observed(300), Modes(3)
    basis = harmonics(some.lon, some.lat, modes)[:, :, some.source]
    weight = np.tile(_weights(modes), 2)
    along = np.einsum("pck,ck->pk", basis, some.design[:2])
    frequencies = (0.3, 0.5, 1.0, 1.5, 2.0, 3.8, 5.3, 5.8, 6.8, 10.0)
    print(" " * 50 + "".join(f"{f:6.1f}" for f in frequencies))
    for words in CALIBRATIONS:
        response = agis.Response(LAW, nside=int(nside), steps=200_000, calibration=words)
        shares, start = [], time.process_time()
        for f in frequencies:
            functions = in_time.waves(f, span=SPAN)
            where = some.lon[some.source], some.lat[some.source], some.design[:2], some.time, modes, functions
            fields = response.left(*where, view=some.view)
            whole = np.einsum("fk,pk->kfp", functions(some.time), along).reshape(len(some.time), -1)
            fields -= five_parameters_of(some, fields)
            shares.append(np.sqrt(np.mean(fields**2, 0) @ weight / (np.mean(whole**2, 0) @ weight)))
        cpu = time.process_time() - start
        print(f"{words!s:50}" + "".join(f"{share:6.2f}" for share in shares) + f"   {cpu:.0f} s", flush=True)


def _weights(modes):
    """Power of each coefficient of waves from all directions."""
    power = np.mean(wave_templates(triad(*centres(4))[2], modes.lmax) ** 2, (0, 2))
    return np.where(modes.degrees >= 2, power, 0.0)


def solved(stars, quasars, calibration, waves):
    """Epochs of quasars, without noise, after all was solved from a sky with each of some waves: (frequency, direction)."""
    made = solved_system(stars, quasars, calibration=calibration)
    scans, _, lon, lat, *_ = made
    t = scans.time() - scans.middle
    for f, place in waves:
        k = triad(*centres(8))[2][:, place]
        moved = wave_motions(lon, lat, k, 300.0)[:, scans.source] * np.cos(2 * np.pi * f * t)
        yield f, place, through(made, moved, iterations=80)


def joint(stars=20_000, nside=8):
    print(f"{stars} stars, 500 quasars, response of nside {nside}: amplitude and limit over the truth (300 µas)")
    print(
        f"{'calibration':50}{'1/yr':>6}{'found':>8}{'limit':>7}{'no calibration':>16}{'limit':>7}{'known':>7}{'limit':>7}"
    )
    for words in CALIBRATIONS:
        if words is not None and "known" in words:
            continue
        responses = [agis.Response(LAW, nside=int(nside), calibration=each) for each in (words, None)]
        for f, place, seen in solved(int(stars), 500, words, [(f, 200) for f in (0.5, 2.0, 5.3)]):
            row = ""
            for attitude in (*responses, "known"):
                search = search_in_time(seen, f, attitude=attitude, n_skies=2)
                row += f"{search.amplitudes[0, place] / 300:9.3f}{search.limits[place] / 300:7.2f}"
            print(f"{words!s:50}{f:6.1f}{row}", flush=True)


def limits(skies=200, stars=20_000):
    """Limits and p-values where the data were calibrated, the response with the same calibration, and with none."""
    print(
        f"{'calibration':34}{'wave/error':>11}{'p < .05':>9}{'limit holds':>13}{'without calibration: p < .05':>30}{'limit holds':>13}"
    )
    for words in ("free every 3.3 days", "free every 5 days to order 1"):
        responses = [agis.Response(LAW, nside=8, calibration=each) for each in (words, None)]
        ((f, place, seen),) = solved(int(stars), 500, words, [(2.0, 200)])
        first = search_in_time(seen, f, attitude=responses[0], n_skies=2)
        sigma = float(first.limits[place] - first.amplitudes[0, place]) / 1.64
        for size in (0.0, 2.0, 4.0, 8.0):
            results = [[], []]
            for sky in range(int(skies)):
                noise = seen.error * np.random.default_rng([int(10 * size), sky]).standard_normal(len(seen.time))
                each = replace(seen, position=seen.position * size * sigma / 300 + noise)
                for response, result in zip(responses, results, strict=True):
                    search = search_in_time(each, f, attitude=response, n_skies=200, rng=sky)
                    result.append((search.p_value < 0.05, search.limits[place] >= size * sigma))
            (p, held), (p_without, held_without) = (np.mean(result, 0) for result in results)
            print(f"{words:34}{size:11.0f}{p:9.3f}{held:13.3f}{p_without:30.3f}{held_without:13.3f}", flush=True)


def errors(quasars=2000):
    rng = np.random.default_rng(1)
    lon, lat = rng.uniform(0, 2 * np.pi, int(quasars)), np.arcsin(rng.uniform(-1, 1, int(quasars)))
    law, knots = agis.scaled(int(quasars), LAW)
    scans = agis.scans(law, lon, lat, 500.0, 2500.0, knots=knots)
    print(
        f"{quasars} quasars as if 500 000, knots {knots:.0f} s: true over formal error of the spin, of the acceleration"
    )
    for words in CALIBRATIONS:
        if words is not None and "known" in words:  # which is to be compared with the information of real stars
            continue
        start = time.process_time()
        system = agis.System(scans, calibration=words)
        ratio = np.diag(system.true_covariance(1)) / np.diag(system.formal_covariance(1))
        spin, acceleration = np.sqrt(np.mean(ratio[:3])), np.sqrt(np.mean(ratio[3:]))
        print(f"{words!s:50}{spin:7.2f}{acceleration:7.2f}   {time.process_time() - start:.0f} s", flush=True)


if __name__ == "__main__":
    {"left": left, "joint": joint, "limits": limits, "errors": errors}[sys.argv[1]](*map(int, sys.argv[2:]))
