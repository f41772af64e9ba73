"""Gaia-like errors by magnitude."""

import numpy as np

from vsh.tools import arguments
from vsh.tools.arguments import explained
from vsh.tools.errors import ParameterError
from vsh.tools.types import ArrayLike, FloatArray, Release

#: For each release: the factor t on the parallax error, and σ_µα* and σ_µδ in parallax errors a year.
#: "paper" is Bachchan et al.'s five-year mission: the t of DR4 (five and a half years) times 0.886, which
#: brings the formal errors of their case A out of our magnitudes and scanning law.
RELEASES = {
    "DR3": (1.0, 1.03, 0.89),
    "DR4": (0.749, 0.58, 0.50),
    "DR5": (0.527, 0.29, 0.25),
    "paper": (0.749 * 0.886, 0.556, 0.496),
}


def parallax_error(magnitude: ArrayLike, release: Release = "DR3") -> FloatArray:
    """Sky-mean standard error of the parallax, (n,). [µas]

    Gaia's published error model: √(40 + 800 z + 30 z²) · t with z = 10^{0.4 (max(G, 13) − 15)}.
    """
    if release not in RELEASES:
        raise ParameterError(f"unknown release {release!r}: choose one of {', '.join(RELEASES)}")
    z = 10 ** (0.4 * (np.maximum(magnitude, 13.0) - 15.0))
    return np.sqrt(40 + 800 * z + 30 * z**2) * RELEASES[release][0]


@arguments.accepts(magnitude=arguments.float_array)
@explained
def gaia_errors(magnitude: ArrayLike, release: Release = "DR3") -> FloatArray:
    """Sky-mean standard errors of µ_α* and µ_δ, (2, n). [µas/yr]

    Parameters
    ----------
    magnitude : (n,) array
        G.
    release : {"DR3", "DR4", "DR5", "paper"}
        Release whose errors are drawn.

    Examples
    --------
    >>> gaia_errors(np.array([20.0]), "DR5").round().ravel()
    array([94., 81.])
    """
    error = parallax_error(magnitude, release)
    _, east, north = RELEASES[release]
    return np.stack([east * error, north * error])
