"""The command `vsh-sim`."""

import argparse

from vsh.tools.errors import ParameterError


def check_calibration_words(words: str) -> str:
    """Return the words on a calibration, if they can be read."""
    from sim.agis import Calibration

    try:
        Calibration.parse(words)
    except ParameterError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return words
