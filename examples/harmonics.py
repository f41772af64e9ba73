"""
The harmonics of degrees 1 and 2
================================

What each coefficient multiplies. The toroidal field t(1,0) is a rotation about the pole, the
spheroidal s(1,0) a flow toward it: spin and acceleration. Degree 2 holds four-cornered patterns:
gravitational waves, an expansion that is not the same in all directions, errors of a catalogue.
"""

import matplotlib.pyplot as plt
import numpy as np

from vsh import Coefficients, Modes
from vsh.figures.plot import KIND_COLOURS, WIDTH, arrow_grid, draw_vectors, sky_axes
from vsh.io.quantities import symbol

# %%
# The real fields that the coefficients multiply, in ICRS: one panel for each of degree 1 and 2.
modes = Modes(2)
for l in (1, 2):
    chosen = [i for i, mode in enumerate(modes) if mode.l == l]
    rows = 2 * l + 1  # toroidal at the left, spheroidal at the right
    figure = plt.figure(figsize=(2 * WIDTH, 1.1 * rows * WIDTH / 2 + 0.6), layout="constrained")
    for place, i in enumerate(chosen):
        row, column = place % rows, place // rows
        axes = sky_axes("icrs", figure.add_subplot(rows, 2, 2 * row + column + 1))
        field = Coefficients(modes, np.eye(len(modes))[i])
        mode = list(modes)[i]
        lon, lat = arrow_grid(axes, 24.0)
        draw_vectors(axes, lon, lat, field.at(lon, lat), longest=20.0, color=KIND_COLOURS[mode.kind])
        axes.set_title(symbol(str(mode)))
    figure.savefig(f"harmonics_{l}.png", dpi=300)
