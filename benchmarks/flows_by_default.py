"""Do the answers of `vsh-redshift` hold where galaxies share flows? Velocity, H0 and bins with nothing said but H0 and v.

    python benchmarks/flows_by_default.py [skies] [galaxies] [dispersion beside the flow, km/s] [first seed]

Skies as `vsh-sim galaxies --velocity planck --flow linear --redshifts heliocentric --errors expected --release DR5` makes them:
0.002 < z < 0.03, linear flows in motions and redshifts. Truth: 369.8 km/s, 67.3 km/s/Mpc.
"""

from __future__ import annotations

import sys
import warnings

import numpy as np

import sim
from fit.redshift import binned
from fit.secular_parallax import hubble_constant, observer_velocity
from sim.expected import errors_by_place
from vsh.models.cosmology import CMB_VELOCITY_PLANCK18

H0, GLIDE = 67.3, np.array([-0.235965, -3.755779, -2.080491])


def sky(seed, number, dispersion):
    """A catalogue of galaxies with its flow."""
    places, gaps, observed, noise = np.random.default_rng([7, seed]).spawn(4)
    galaxies = sim.galaxies(number, places, min_redshift=0.001, max_redshift=0.03)
    signal = sim.acceleration(GLIDE) + sim.secular_parallax(CMB_VELOCITY_PLANCK18.to_frame("icrs").value, hubble=H0)
    signal += sim.peculiar(dispersion, noise, flow="linear", hubble=H0)
    mission = sim.Mission(sim.NominalScanningLaw(years=10.0, rng=gaps), "DR5")
    sigma, rho = errors_by_place(galaxies.magnitude, galaxies.lon, galaxies.lat, mission)
    field = sim.observe(galaxies, signal, observed, sigma=sigma, rho=rho, redshifts="heliocentric")
    return field[np.asarray(field.redshift) > 0.002]


def main(skies: int = 100, number: int = 10_000, dispersion: int = 250, first: int = 0) -> None:
    """Print pulls and coverage of v and H0, and how often the bins contradict what is true."""
    warnings.simplefilter("ignore")
    truth = CMB_VELOCITY_PLANCK18.to_frame("icrs").value
    pulls, hubble, p_values = [], [], []
    for seed in range(first, first + skies):
        field = sky(seed, number, float(dispersion))
        v = observer_velocity(field, H0).velocity
        pulls.append((v.value - truth) / v.sigma)
        h = hubble_constant(field, CMB_VELOCITY_PLANCK18)
        hubble.append((h.hubble - H0) / h.hubble_error)
        test = binned(field, 1, 3).secular_parallax(CMB_VELOCITY_PLANCK18)[1]
        p_values.append([test.p_value, test.p_value_quoted])
        print(f"\r{seed - first + 1} of {skies} skies", end="", file=sys.stderr, flush=True)
    print(f"\r{skies} skies of {number} galaxies, linear flows and {dispersion} km/s beside them", flush=True)
    for name, values in (("velocity", np.array(pulls)), ("H0", np.array(hubble))):
        away = np.abs(values)
        print(
            f"{name:10} pulls {values.mean():+.2f} ± {values.std():.2f}   within 68 %: {np.mean(away < 1):.2f}"
            f"   within 95 %: {np.mean(away < 1.96):.2f}"
        )
    p = np.array(p_values)
    print(f"bins: constant ã − v/d, which is true, has p < 0.05 on {100 * np.mean(p[:, 0] < 0.05):.0f} % of skies (scaled), "
          f"{100 * np.mean(p[:, 1] < 0.05):.0f} % (as quoted)")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
