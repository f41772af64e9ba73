"""Backgrounds of known shape and unknown amplitude: systematic floors, gravitational waves.

Systematic errors are a Gaussian field of a known spectrum. Its amplitude is estimated by the exact likelihood of the
normal equations, with whatever else is fitted marginalised.
"""

from typing import TYPE_CHECKING

from fit.background._amplitude import Amplitude
from fit.background._floor import SCALAR_SHAPES, SHAPES, Floor, ScalarFloor, floor
from fit.background._likelihood import Amplitudes, Axis, equations_of
from fit.normal import Template
from vsh.models.covariance import Spectrum
from vsh.tools.modules import lazy_names

if TYPE_CHECKING:
    from fit.background._cross import CrossPowers, cross_powers
    from fit.background._shared import EXTRA_DEGREES as EXTRA_DEGREES
    from fit.background._shared import ClassComparison, Verdict, shared
    from fit.background._shared import compare_classes_jointly as compare_classes_jointly
    from fit.background._shared import compute_contrast_p_value as compute_contrast_p_value
    from fit.background._shared import extend_degrees as extend_degrees
    from fit.background._shared import has_leakage as has_leakage
    from fit.background._shared import pool_draw_covariances as pool_draw_covariances
    from fit.background._shared import resample_draws as resample_draws
    from fit.background._shared import sample_class_errors as sample_class_errors
    from fit.background._waves import WaveLimit, wave_limit

__all__ = [
    "Amplitude",
    "Amplitudes",
    "ClassComparison",
    "CrossPowers",
    "Floor",
    "ScalarFloor",
    "Template",
    "Verdict",
    "WaveLimit",
    "cross_powers",
    "floor",
    "shared",
    "wave_limit",
]

# Every fit has a floor; the rest is imported when it is first asked for.
_SHARED = "EXTRA_DEGREES ClassComparison Verdict compare_classes_jointly compute_contrast_p_value extend_degrees"
_SHARED += " has_leakage pool_draw_covariances resample_draws sample_class_errors shared"
_LATER = {"_cross": ["CrossPowers", "cross_powers"], "_shared": _SHARED.split(), "_waves": ["WaveLimit", "wave_limit"]}
__getattr__, __dir__ = lazy_names(__name__, __all__, _LATER)
