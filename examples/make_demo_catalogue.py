"""How the catalogue of the demo was made.

Four thousand bright quasars as Gaia's last release will measure them, in a frame that spins
by 1.3 µas/yr, with the acceleration that Gaia found. Run it to write the same file again:

    python examples/make_demo_catalogue.py fit/demo.fits
"""

import sys

import numpy as np

import sim
from vsh import Vector
from vsh.io import tables

SPIN = (0.6, -1.0, 0.5)  # µas/yr, ICRS
ACCELERATION = Vector([5.05, 0, 0], np.zeros((3, 3)), "galactic").to_frame("icrs").value.round(4)


def demo_columns(seed=2026):
    """The columns of the demo's table, in Gaia's names and units."""
    rng = np.random.default_rng(seed)
    sources = sim.quasars(4000, rng, sky="plane-avoiding", max_magnitude=18.5)
    rho = rng.uniform(-0.4, 0.4, len(sources))
    field = sim.observe(sources, sim.spin(SPIN) + sim.acceleration(ACCELERATION), rng, rho=rho, release="DR5")
    mas = field.motion / 1000, field.sigma / 1000
    return {
        "source_id": np.arange(1, len(field) + 1),
        "ra": np.degrees(field.lon),
        "dec": np.degrees(field.lat),
        "pmra": mas[0][0].astype("f4"),
        "pmdec": mas[0][1].astype("f4"),
        "pmra_error": mas[1][0].astype("f4"),
        "pmdec_error": mas[1][1].astype("f4"),
        "pmra_pmdec_corr": rho.astype("f4"),
        "phot_g_mean_mag": field.magnitude.astype("f4"),
    }


if __name__ == "__main__":
    truth = {
        f"{name}_{axis}": value
        for name, vector in (("SPIN", SPIN), ("ACC", ACCELERATION.tolist()))
        for axis, value in zip("XYZ", vector)
    }
    units = dict.fromkeys(["ra", "dec"], "deg") | dict.fromkeys(
        ["pmra", "pmdec", "pmra_error", "pmdec_error"], "mas / yr"
    )
    tables.write_columns(sys.argv[1], demo_columns(), truth, units, overwrite=True)
    print(f"written: {sys.argv[1]}")
