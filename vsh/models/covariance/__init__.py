"""Errors and motions that sources share: spectra of fields, covariance functions, matrices.

A `Spectrum` is the mean power of a random field in each kind and degree; `from_function` and the like make the dense
covariance matrix that such a field gives to the motions of some sources.
"""

from vsh.models.covariance._matrix import (
    MAX_SOURCES,
    Covariance,
    as_covariance,
    check_size,
    from_blocks,
    from_function,
    from_spectrum,
    of_errors,
    read_covariance,
)
from vsh.models.covariance._spectrum import (
    LINDEGREN_2021,
    VASILIEV_BAUMGARDT_2021,
    Spectrum,
    d_minus,
    d_plus,
    wave_fractions,
)

__all__ = ["LINDEGREN_2021", "Covariance", "Spectrum", "from_function", "from_spectrum", "read_covariance"]
