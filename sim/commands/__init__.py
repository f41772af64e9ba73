"""The command `vsh-sim`."""

import argparse

from vsh.tools.errors import ParameterError


def calibration_words(text: str) -> str:
    """Words on a calibration, if they can be read."""
    from sim.agis import Calibration

    try:
        Calibration.parse(text)
    except ParameterError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text
