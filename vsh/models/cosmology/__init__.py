"""Distances, usable redshifts, and our own motion through the Universe."""

from vsh.models.cosmology._apex import (
    BACHCHAN_2016,
    CMB_VELOCITY_PLANCK18,
    FLOW_LIMIT,
    LOCAL_GROUP,
    REDSHIFT_FRAMES,
    VELOCITIES,
    count_unusable,
    to_cmb,
    usable,
    velocity_along,
    velocity_from_apex,
    with_redshift,
)
from vsh.models.cosmology._distance import (
    FLAT_PLANCK13,
    distance_modulus,
    flat,
    hubble_value,
    parallax_factor,
    redshift_of,
    transverse_distance,
)

__all__ = [
    "BACHCHAN_2016",
    "CMB_VELOCITY_PLANCK18",
    "FLAT_PLANCK13",
    "distance_modulus",
    "to_cmb",
    "transverse_distance",
    "velocity_from_apex",
    "with_redshift",
]
