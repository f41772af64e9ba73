"""Other people's warnings, where our users can do nothing about them."""

import warnings
from contextlib import contextmanager


@contextmanager
def quiet_imports():
    """Import a library within this, and what it says of itself when imported is not shown.

    arviz, which corner imports too, warns of its own next version once a day by a stamp in the
    user's cache: a test run that passed yesterday would fail today, and a report begin with it.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield
