"""Distances of galaxies and quasars (the only astropy.cosmology)."""

import numpy as np
from astropy.cosmology import FlatLambdaCDM

from vsh.errors import FieldError

#: Below this redshift a source moves with its neighbours, not with the expansion.
FLOW_LIMIT = 1e-4
#: Flat, Ω_m = 0.315, H0 = 67.3 km/s/Mpc: Bachchan, Hobbs & Lindegren (2016).
PAPER = FlatLambdaCDM(H0=67.3, Om0=0.315)


def transverse_distance(redshift, cosmology=PAPER, hubble=None):
    """Transverse comoving distance d_M, (n,). [Mpc]

    Parameters
    ----------
    redshift : (n,) array
    cosmology : astropy cosmology — its shape; its H0 too unless `hubble` is given
    hubble : float, optional — H0, to which distances are inversely proportional [km/s/Mpc]

    Raises
    ------
    FieldError
        If any redshift is missing, not positive, or below the flow (z < 1e-4): astropy would
        return 0 Mpc for a nan and a negative distance for a negative redshift.

    Examples
    --------
    >>> transverse_distance(np.array([0.001, 0.01, 1.0])).round(2)
    array([   4.45,   44.44, 3406.32])
    """
    if redshift is None:
        raise FieldError("these sources have no redshifts, which a distance needs")
    redshift = np.asarray(redshift, float)
    unusable = ~(np.isfinite(redshift) & (redshift >= FLOW_LIMIT))
    if unusable.any():
        missing, low = np.isnan(redshift).sum(), (redshift < FLOW_LIMIT).sum()
        raise FieldError(
            f"{unusable.sum()} of {redshift.size} redshifts give no distance: {missing} missing, {low} below "
            f"{FLOW_LIMIT:g} (zero and negative ones among them); leave those sources out first"
        )
    distance = cosmology.comoving_transverse_distance(redshift).to_value("Mpc")
    return distance if hubble is None else distance * (cosmology.H0.to_value("km / (s Mpc)") / hubble)
