"""Units and short names of what a posterior is of."""

from __future__ import annotations

UNITS = {
    "v_x": "km/s", "v_y": "km/s", "v_z": "km/s", "speed": "km/s", "H0": "km/s/Mpc", "peculiar_dispersion": "km/s",
    "excess_noise": "µas/yr", "outlier_fraction": "", "a_x": "µas/yr", "a_y": "µas/yr", "a_z": "µas/yr",
    "omega_x": "µas/yr", "omega_y": "µas/yr", "omega_z": "µas/yr",
}  # fmt: skip

#: Names that are too long for the table.
SHORT_NAMES = {"peculiar_dispersion": "dispersion"}
#: The same as standards for tables want them.
FITS_UNITS = {"km/s": "km / s", "km/s/Mpc": "km / (Mpc s)", "µas/yr": "uas / yr"}
