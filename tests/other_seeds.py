"""Every seed is another: `OTHER_SEEDS=1 pytest -p tests.other_seeds` finds tests that hold for one seed alone.

A test that fails with one number in some is too near its bound; some name numbers of the one sky, and may fail.
"""

import os
from numbers import Integral

import numpy as np

_REAL = np.random.default_rng
_SHIFT = int(os.environ.get("OTHER_SEEDS", "1"))


def _other(seed=None):
    given = list(np.ravel(np.asarray(seed, object)))
    return _REAL([*map(int, given), _SHIFT] if all(isinstance(each, Integral) for each in given) else seed)


def pytest_configure():
    """Not when it is imported: whoever looks for doctests imports it, too."""
    np.random.default_rng = _other
