"""What the tests share: random fields, and real catalogues where they are at hand."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import settings

import sim
from vsh import Field

# The same examples every time; a slow machine is no failure.
settings.register_profile("project", deadline=None, derandomize=True, print_blob=True)
settings.load_profile("project")

ROOT = Path(__file__).parents[1]
#: Real catalogues, which are not part of the project.
DATA = Path(os.environ.get("VSH_TEST_DATA", ROOT.parent / "shared" / "data"))


def real_catalogue(name):
    """The path of a real catalogue; skips the test where it is not at hand."""
    path = DATA / name
    if not path.exists():
        pytest.skip(f"the real catalogue {name} is not at hand (name its folder in VSH_TEST_DATA)")
    return path


def random_field(n, seed, rho=0.9, frame="icrs"):
    """Unrelated motions with unequal, correlated errors."""
    rng = np.random.default_rng(seed)
    lon, lat = sim.uniform_sky(n, rng)
    sigma = 10 ** rng.uniform(0, 2, (2, n))
    return Field(lon, lat, sigma * rng.normal(size=(2, n)), sigma, rng.uniform(-rho, rho, n), frame=frame)


def triad(lon, lat):
    """Unit vectors east, north and outwards, written out once more: (3, 3) rows."""
    east = [-np.sin(lon), np.cos(lon), 0]
    north = [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)]
    out = [np.cos(lat) * np.cos(lon), np.cos(lat) * np.sin(lon), np.sin(lat)]
    return np.array([east, north, out])
