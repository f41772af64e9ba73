"""Errors and motions that sources share: spectra of fields, covariance functions, matrices.

A `Spectrum` is the mean power of a random field in each kind and degree; `from_function` and the like make the dense
covariance matrix that such a field gives to the motions of some sources.
"""

from vsh.covariance._angular import LINDEGREN_2021, VASILIEV_BAUMGARDT_2021, d_minus, d_plus
from vsh.covariance._laws import wave_fractions
from vsh.covariance._matrix import MAX_SOURCES, Covariance, as_covariance, check_size
from vsh.covariance._shared import from_blocks, from_function, from_spectrum, of_errors, read
from vsh.covariance._spectrum import Spectrum

__all__ = [
    "LINDEGREN_2021",
    "VASILIEV_BAUMGARDT_2021",
    "Covariance",
    "Spectrum",
    "d_minus",
    "d_plus",
    "from_blocks",
    "from_function",
    "from_spectrum",
    "read",
    "wave_fractions",
]
