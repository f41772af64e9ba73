"""Coefficients of a vector field: powers against integrals over the sky."""

import numpy as np
import pytest

from vsh import Coefficients, Modes
from vsh.sky.pixels import centres


@pytest.mark.parametrize("kind", ["T", "S"])
@pytest.mark.parametrize("l", [1, 2, 4])
def test_power_is_the_integral_of_the_square(kind, l):
    modes = Modes(5)
    values = np.zeros(len(modes))
    degree = modes.slice_of(kind, l)
    values[degree] = np.random.default_rng(l).normal(size=2 * l + 1)
    field = Coefficients(modes, values)
    east, north = field.at(*centres(32))
    assert np.mean(east**2 + north**2) * 4 * np.pi == pytest.approx(field.power(kind, l), rel=1e-3)
    assert field.power("S" if kind == "T" else "T", l) == 0


def test_repr_says_what_is_largest():
    field = Coefficients.from_vectors(rotation=(0, 0, 5), lmax=2)
    assert repr(field) == "<Coefficients: 16, degrees 1 to 2, rms 3.62, largest t(1,0)>"
