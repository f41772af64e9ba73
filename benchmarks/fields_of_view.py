"""Motions by one field of view and by the other: p-values without a difference, and a difference of known size.

    python benchmarks/fields_of_view.py [SKIES]

Epochs of 40 quasars, solved by either field of view (`read_epochs(…, where=)`); the difference of both catalogues is fitted
to degree 1. Printed are quantiles of the p-values of its spin and acceleration, which are uniform where the fields agree,
and, with observations of one field turned by a spin of 300 µas/yr, as by a basic angle that drifts, the mean of what is
found, its rms pull, and how often p < 0.0027.
"""

import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial

import numpy as np

import fit
import sim
from vsh import Field
from vsh.io.epochs import read_epochs

SPIN = np.array([0.0, 0.0, 300.0])


def differences(seed, spin):
    """Spin, its error, and p-values of spin and acceleration of the difference between the fields of view, (8,)."""
    quasars = sim.quasars(40, rng=seed, max_magnitude=19.5)
    table = sim.epochs(quasars, sim.acceleration((0, 5, 0)), rng=seed + 1_000_000)
    is_first = (np.asarray(table["transit_id"]) >> 15) & 3 == 0
    angle, years = np.radians(table["scan_pos_angle"]), np.asarray(table["obs_time_tcb"]) / (365.25 * 86400e9) - 7.5
    east, north = sim.spin(spin)(np.radians(table["ra0"]), np.radians(table["dec0"])) / 1000
    shift = (is_first * (east * np.sin(angle) + north * np.cos(angle)))[:, None] * years  # mas
    table["centroid_pos_al"] = table["centroid_pos_al"] + shift
    one, two = (read_epochs(table, where=f"field of view {number}", robust=False) for number in (1, 2))
    found = fit.fit_field(Field(one.lon, one.lat, one.motion - two.motion, np.hypot(one.sigma, two.sigma)), 1)
    return [*found.spin.value, *found.spin.sigma, found.spin.p_value, found.acceleration.p_value]


def main(n_skies=100):
    """Print both skies."""
    with ProcessPoolExecutor() as pool:
        for spin in (0 * SPIN, SPIN):
            found = np.array(list(pool.map(partial(differences, spin=spin), range(n_skies))))
            pulls = (found[:, :3] - spin) / found[:, 3:6]
            quantiles = np.quantile(found[:, 6:], [0.1, 0.25, 0.5, 0.75, 0.9], axis=0).T
            print(
                f"spin {spin[2]:g} µas/yr: found {found[:, 2].mean():.1f} ± {found[:, 2].std() / np.sqrt(n_skies):.1f}, rms"
            )
            print(
                f"  pull {np.sqrt(np.mean(pulls**2)):.2f}, p < 0.0027 on {np.mean(found[:, 6] < 0.0027):.3f}, quantiles of p:"
            )
            for name, row in zip(("spin", "acceleration"), quantiles, strict=True):
                print(f"  {name:12} {' '.join(f'{value:.2f}' for value in row)} (0.10 0.25 0.50 0.75 0.90)", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
