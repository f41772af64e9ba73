"""What is said of fields that change with time, on skies with a known truth.

`python benchmarks/time_axis.py dips`: which share of a wave's degrees 2 and 3 along the scan is left, by frequency.

`python benchmarks/time_axis.py waves [STARS] [NSIDE] [CROWD]`: a wave put into sky and attitude, solved together, and found again; with
stars so many times as dense in the Galactic plane as at its poles.

`python benchmarks/time_axis.py limits [SKIES]`: p-values and limits of the search with a response, noise alone drawn anew.
"""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
from scipy.stats import kstest

import sim
from fit import in_time
from fit.waves import search_in_time
from sim import agis
from vsh import Modes
from vsh.basis import harmonics
from vsh.io.epochs import Observations, make_design_rows
from vsh.models.covariance import wave_fractions
from vsh.models.waves import wave_motions
from vsh.sky.frames import rotation_matrix
from vsh.sky.pixels import centres, pixels_of
from vsh.sky.sphere import angles, triad

YEARS = 5.5
LAW = sim.NominalScanningLaw(years=YEARS)
SPAN = (-YEARS / 2, YEARS / 2)


def observed(n=800, error=1000.0, seed=3):
    """Transits of quasars without noise."""
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    transits = LAW.transits(lon, lat)
    t = transits.time - YEARS / 2
    design = make_design_rows(transits.angle, transits.parallax_factor, t)
    view = transits.view.astype(int)
    k = len(t)
    return Observations(lon, lat, transits.source, t, design, np.zeros(k), np.full(k, error), np.arange(n), (), view)


def dips(nside=8):
    response, modes = agis.Response(LAW, nside=int(nside), steps=200_000), Modes(3)
    some = observed(400)
    basis = harmonics(some.lon, some.lat, modes)[:, :, some.source]
    degrees = np.maximum(modes.degrees, 2)
    share_of = wave_fractions(modes.lmax)[degrees - 1] / (2 * (2 * degrees + 1)) * (modes.degrees > 1)
    weight = np.tile(4 * np.pi * share_of / modes.norm2, 2)
    print("f [1/yr], share of a wave's degrees 2 and 3 along the scan that is left (rms)")
    for f in (
        0.05,
        0.1,
        0.2,
        0.3,
        0.5,
        0.95,
        1,
        1.05,
        2,
        2.5,
        3.8,
        4.2,
        4.8,
        5.3,
        5.8,
        6.8,
        7.3,
        7.8,
        10,
        11.6,
        12.6,
        15,
    ):
        functions = in_time.waves(f, span=SPAN)
        left = response.left(some.lon[some.source], some.lat[some.source], some.design[:2], some.time, modes, functions, view=some.view)  # fmt: skip
        phase = 2 * np.pi * f * some.time
        whole = np.array([np.cos(phase), np.sin(phase)])[:, None] * np.einsum("pck,ck->pk", basis, some.design[:2])
        left -= five_parameters_of(some, left)
        share = np.mean(left**2, 0) @ weight / (np.mean(whole.reshape(len(weight), -1) ** 2, 1) @ weight)
        print(f"{f:6.2f}  {np.sqrt(share):.2f}", flush=True)


def five_parameters_of(some, columns):
    """What five parameters of each source take of columns."""
    out = np.zeros_like(columns)
    bounds = np.searchsorted(some.source, np.arange(len(some.lon) + 1))
    for first, last in pairwise(bounds):
        root = np.linalg.qr(some.design[:, first:last].T)[0]
        out[first:last] = root @ (root.T @ columns[first:last])
    return out


def solved_system(stars, quasars, seed=5, crowd=1, knots=900.0, calibration=None):
    rng, n = np.random.default_rng(seed), stars + quasars
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    if crowd > 1:
        u, v = rng.uniform(0, 2 * np.pi, 2 * crowd * stars), rng.uniform(-1, 1, 2 * crowd * stars)
        keep = np.flatnonzero(rng.uniform(0, crowd - 1, len(u)) < 1 / (np.abs(v) + 1 / (crowd - 1)))[:stars]
        galactic = triad(u[keep], np.arcsin(v[keep]))[2]
        lon[:stars], lat[:stars] = angles(rotation_matrix("galactic", "icrs") @ galactic)
    sigma = np.where(np.arange(n) < stars, 100.0, 1000.0)
    scans = agis.scans(LAW, lon, lat, sigma, 5 * sigma, knots=knots)
    return scans, agis.System(scans, calibration=calibration), lon, lat, stars, quasars


def through(made, moved, noise=None, iterations=30):
    """Epochs of quasars after all unknowns of a system were solved from displacements (east, north) of every transit."""
    scans, system, lon, lat, stars, quasars = made
    sin, cos = scans.sin.astype(float), scans.cos.astype(float)
    east, north = moved
    along, across = east * sin + north * cos, north * sin - east * cos
    if noise is not None:
        along, across = along + noise[0], across + noise[1]
    solution = system.solve(along, across, stop=None, iterations=iterations)
    taken, _ = system.predict(np.zeros((stars + quasars, 5)), solution.attitude, solution.angle)
    mine = np.flatnonzero(scans.source >= stars)
    mine = mine[np.argsort(scans.source[mine], kind="stable")]
    t = (scans.time() - scans.middle)[mine]
    design = np.array([sin[mine], cos[mine], scans.along_factor[mine].astype(float), sin[mine] * t, cos[mine] * t])
    k = len(t)
    return Observations(
        lon[stars:], lat[stars:], scans.source[mine] - stars, t, design, (along - taken)[mine], np.full(k, 1000.0),
        np.arange(quasars),
    )  # fmt: skip


def waves(stars=20_000, nside=12, crowd=1):
    made = solved_system(stars, 500, crowd=crowd)
    _, _, lon, lat, *_ = made
    weights = np.bincount(pixels_of(lon[:stars], lat[:stars], nside, any_size=True), minlength=12 * nside**2)
    print(f"{stars} stars, {crowd} : 1, nside {nside}: found / put in (plus cos, cross sin), largest other amplitude")
    _each_wave(made, agis.Response(LAW, None if crowd == 1 else weights, nside), (200, 37, 600))


def _each_wave(made, response, places):
    scans, _, lon, lat, *_ = made
    t = scans.time() - scans.middle
    for period in (0.1, 0.173, 0.25, 0.5, 1.0, 2.0, 4.0):
        for place in places:
            k, phase = triad(*centres(8))[2][:, place], 2 * np.pi * t / period
            plus, cross = (wave_motions(lon, lat, k, *each)[:, scans.source] for each in ((300.0, 0.0), (0.0, 300.0)))
            seen = through(made, plus * np.cos(phase) + cross * np.sin(phase))
            search = search_in_time(seen, 1 / period, attitude=response, n_skies=2)
            a = search.amplitudes[:, place] / 300
            known = search_in_time(seen, 1 / period, attitude="known", n_skies=2).amplitudes[:, place] / 300
            print(
                f"{period:6.3f} yr, direction {place:3d}: {a[0]:.3f} {a[3]:.3f}; {np.abs(a[1:3]).max():.3f}; as if known "
                f"{known[0]:.3f} {known[3]:.3f}; limit {search.limits[place] / 300 / np.sqrt(2):.2f}",
                flush=True,
            )


def limits(skies=300):
    response, some = agis.Response(LAW, nside=4, steps=100_000), observed(300)
    rng = np.random.default_rng(1)
    some = replace(some, error=np.repeat(10 ** rng.uniform(2.3, 3.3, 300), np.bincount(some.source)))
    modes, functions, place = Modes(5), in_time.waves(2.0), 50
    left = response.left(some.lon[some.source], some.lat[some.source], some.design[:2], some.time, modes, functions, view=some.view)  # fmt: skip
    from vsh.models.waves import wave_templates

    wave = left[:, : len(modes)] @ wave_templates(triad(*centres(4))[2][:, [place]], 5)[0, :, 0]
    first = search_in_time(some, 2.0, attitude=response, nside=4, n_skies=2)
    sigma = float(np.median(first.limits)) / 2.5
    print(f"{'wave / error':>12}{'p < .05':>9}{'KS':>7}{'limit holds':>13}{'amplitude':>11}")
    for size in (0, 2, 6, 20):
        p, held, amplitude = [], [], []
        for sky in range(int(skies)):
            noise = some.error * np.random.default_rng([size, sky]).standard_normal(len(some.time))
            each = search_in_time(replace(some, position=size * sigma * wave + noise), 2.0, attitude=response, nside=4, n_skies=200, rng=sky)  # fmt: skip
            p.append(each.p_value)
            held.append(each.limits[place] >= size * sigma)
            amplitude.append(each.amplitudes[0, place] / (size * sigma) if size else np.nan)
        ks = kstest(p, "uniform").pvalue if not size else np.nan
        print(
            f"{size:>12}{np.mean(np.array(p) < 0.05):>9.3f}{ks:>7.2f}{np.mean(held):>13.3f}{np.mean(amplitude):>11.3f}",
            flush=True,
        )


if __name__ == "__main__":
    {"dips": dips, "waves": waves, "limits": limits}[sys.argv[1]](*map(int, sys.argv[2:]))
