"""Our own motion through the Universe, as the dipole of the microwave background tells it."""

from vsh.vector import Vector

#: Planck Collaboration (2020, A&A 641, A1), table 3: toward the apex. [km/s]
PLANCK = Vector.from_polar(369.82, 264.021, 48.253, (0.11, 0.011, 0.005), "galactic", "km/s")
#: What Bachchan, Hobbs & Lindegren (2016, A&A 589, A71) put into their simulations. [km/s]
PAPER = Vector.from_polar(369.0, 263.99, 48.26, frame="galactic", unit="km/s")
