"""Our velocity from the secular parallax of galaxies for a known H0, and H0 for a known velocity."""

from fit.secular_parallax._equations import OMEGA, A, DriftRows, DriftSums, U, check_determined, drift_rows
from fit.secular_parallax._estimate import (
    DriftSolution,
    HubbleSolution,
    VelocitySolution,
    hubble_constant,
    observer_velocity,
)
from fit.secular_parallax._forecast import predict
from fit.secular_parallax._report import report_bins, report_drift

__all__ = [
    "A",
    "DriftRows",
    "DriftSolution",
    "DriftSums",
    "HubbleSolution",
    "OMEGA",
    "U",
    "VelocitySolution",
    "check_determined",
    "drift_rows",
    "hubble_constant",
    "observer_velocity",
    "predict",
    "report_bins",
    "report_drift",
]
