"""Scales whose luminance never turns back, and classes that the colour-blind tell apart."""

from itertools import combinations

import matplotlib as mpl
import numpy as np
import pytest
from colorspacious import cspace_convert, deltaE

from vsh.figures.plot import COLOURS, DIVERGING, FADED, KIND_COLOURS, SEQUENTIAL, SIGNIFICANCE


def luminance(name, n=256):
    return cspace_convert(mpl.colormaps[name](np.linspace(0, 1, n))[:, :3], "sRGB1", "CIELab")[:, 0]


@pytest.mark.parametrize("name", [SEQUENTIAL, SIGNIFICANCE, "cividis", "magma"])
def test_luminance_goes_one_way(name):
    steps = np.diff(luminance(name))
    assert (steps > 0).all() or (steps < 0).all()


def test_luminance_of_either_sign_falls_from_the_middle():
    light = luminance(DIVERGING)
    assert (np.diff(light[:124]) > 0).all()
    assert (np.diff(light[132:]) < 0).all()
    assert light[128] > 90


@pytest.mark.parametrize("kind", ["normal", "deuteranomaly", "protanomaly"])
def test_classes_are_told_apart(kind):
    """ΔE in CAM02-UCS (Luo et al. 2006), with the dichromats of Machado et al. (2009)."""
    assert {*KIND_COLOURS.values()} <= {*COLOURS}
    seen = np.array([mpl.colors.to_rgb(colour) for colour in (*COLOURS, FADED)])
    if kind != "normal":
        seen = np.clip(cspace_convert(seen, {"name": "sRGB1+CVD", "cvd_type": kind, "severity": 100}, "sRGB1"), 0, 1)
    for i, j in combinations(range(len(seen)), 2):
        assert deltaE(seen[i], seen[j], input_space="sRGB1") > 10, (i, j)
