"""A simulated twin of a real VLBI catalogue: what it would look like, and its truth known.

713 radio sources on the sky of Truebenbach & Darling (2017, ApJS 233, 3), with errors spread like theirs, and like theirs not
the whole truth: the structure of sources moves them as well, by a few µas/yr as a rule and by tens in some, and no quoted error knows of
it. The acceleration is Gaia's, 5.05 µas/yr towards the Galactic centre. Pages of the gallery run on it::

    python examples/make_vlbi_twin.py twin.ecsv
"""

import sys

import numpy as np

import sim
from vsh import Coefficients, Field, Vector

ACCELERATION = Vector([5.05, 0, 0], np.zeros((3, 3)), "galactic").to_frame("icrs").value.round(4)
#: The quoted errors: median [µas/yr] and spread [dex] in right ascension, and the ratio of those in declination to them.
ERRORS = (7.8, 0.44), (1.28, 0.18)
#: What structure adds, Student's t with so many degrees of freedom. [µas/yr]
STRUCTURE, TAIL = 6.0, 2.0


def twin(n=713, seed=2017):
    """The catalogue as a Field."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(2 * n, rng)
    seen = np.flatnonzero(rng.uniform(size=2 * n) < np.where(lat > np.radians(-45), 1.0, 0.25))[
        :n
    ]  # from the north, mostly
    lon, lat = lon[seen], lat[seen]
    east = ERRORS[0][0] * 10 ** (ERRORS[0][1] * rng.standard_normal(n))
    sigma = np.stack([east, east * ERRORS[1][0] * 10 ** (ERRORS[1][1] * rng.standard_normal(n))])
    motion = Coefficients.from_vectors(glide=ACCELERATION).at(lon, lat) + sigma * rng.standard_normal((2, n))
    motion += STRUCTURE * rng.standard_t(TAIL, (2, n))
    return Field(lon, lat, motion, sigma, name=np.array([f"twin {i + 1}" for i in range(n)]))


if __name__ == "__main__":
    field = twin()
    truth = {
        f"{name}_{axis}": float(x)
        for name, vector in (("SPIN", np.zeros(3)), ("ACC", ACCELERATION))
        for axis, x in zip("XYZ", vector)
    }
    field.write(sys.argv[1], truth)
    print(f"written: {sys.argv[1]}, {len(field)} sources")
