"""What small functions give, at values that are known: an expression in the names of its module, and how it is printed."""

import importlib

import numpy as np
import pytest
from astropy import cosmology
from astropy import units as u

from vsh import Modes

CASES = [
    ("vsh.basis", "float(scalar_harmonics(np.zeros(1), np.zeros(1), 1)[2, 0].round(4))", "-0.691"),
    ("vsh.field", "multiply_weights(np.array([[2.0], [3.0], [0.5]]), np.array([[1.0], [2.0]])).ravel()", "array([3. , 6.5])"),
    ("vsh.io.epochs._solve", "downweighting_factor(np.array([1.9, 2.5, -3.0])).round(4)", "array([1. , 0.6993, 0.3679])"),
    ("vsh.io.tables._where", 'Where("phot_g_mean_mag < 19 and 0.5 < redshift < 2").names', "('phot_g_mean_mag', 'redshift')"),
    ("vsh.models.covariance", "wave_fractions(4).round(6)", "array([0. , 0.833333, 0.116667, 0.03 ])"),
    ("vsh.scalars", "modes_for(None, 2)", "Modes(lmax=2)"),
    ("vsh.tools.arguments", 'number("extra", 3)', "3.0"),
    ("vsh.tools.arguments", 'choice("common", "higher", (None, "higher"))', "'higher'"),
    ("vsh.tools.arguments", 'indices("sources", [True, False, True], 3)', "array([0, 2])"),
    ("vsh.tools.bad_rows", 'doubtful_motion_notes({"pmra": np.array([1.0, -999.0]), "pmdec": np.array([1.0, 2.0])})[0][:55]', "'warning: 1 row has a motion of -999 in one component: a'"),
    ("vsh.tools.parallel", "free_memory() > 0", "True"),
    ("vsh.tools.units", "round(hubble_rate(67.3), 4), round(hubble_rate(70), 4)", "(14.1969, 14.7665)"),
    ("sim.agis.passes._scans", "evaluate_splines(np.array([0.0])).ravel().round(4)", "array([0.1667, 0.6667, 0.1667, 0. ])"),
    ("effects", 'f"{circular_acceleration(223 * u.km / u.s, 8.2 * u.kpc):.6f}"', "'4.267305 uas / yr'"),
    ("effects", 'f"{attraction(2e10 * u.M_sun, 50 * u.kpc):.1e}"', "'2.4e-02 uas / yr'"),
    ("effects", 'f"{transverse_motion(750 * u.km / u.s, 44.44 * u.Mpc):.2f}"', "'3.56 uas / yr'"),
    ("effects", 'f"{lensing_depth(0.05 / u.Mpc**3, 1e11 * u.M_sun, 5 * u.Gpc, 10 * u.Gpc):.2f}"', "'0.08'"),
    ("fit.background._waves", "round(compute_probability_above(18.30704, np.ones(10), np.zeros(10)), 5)", "0.05"),
    ("fit.motions.galaxy", "round(angular_speed(), 2)", "28.89"),
    ("fit.motions.galaxy", "round(angular_speed_error(), 3)", "0.26"),
    ("fit.results.output._text", '[cell(x) for x in (0.123456, 1215942.0, float("nan"), "T1", 7)]', "['0.1235', '1215942', '', 'T1', '7']"),
    ("fit.pairs._correlation", "waves_curve([0.0, 0.2, 1.3]).round(7)", "array([ 1. , 0.9330074, -0.2881578])"),
    ("fit.posterior._summary", '[round(x, 2) for x in compute_intervals({"x": np.arange(101.0)})["x"]]', "[50.0, 15.87, 84.13, 2.5, 97.5, 50.0, 29.3]"),
    ("fit.results.quality", "round(float(log_p_value(2000.0, 3)), 2)", "-996.42"),
    ("fit.results.quality", "round(float(normal_deviate(12, 3)), 4), round(float(normal_deviate(2000, 3)), 1)", "(2.4381, 44.5)"),
    ("fit.results.quality", "norm_limit(np.array([0.0, 10.0]), np.ones(2), 3).round(2)", "array([ 2.45, 11.55])"),
    ("fit.robust._clip", "[round(float(np.sqrt(compute_truncation_factors(kappa**2 * np.log(2))[0])), 3) for kappa in (3, 2.5, 2, 1.5)]", "[1.006, 1.03, 1.108, 1.308]"),
    ("fit.posterior._sampling", "is_integrable_with_inverse_cube(Flat(50.0, 80.0)), is_integrable_with_inverse_cube(Normal(67.3, 15.0))", "(True, False)"),
]  # fmt: skip


@pytest.mark.parametrize(("module", "expression", "printed"), CASES, ids=[f"{m}: {e[:40]}" for m, e, _ in CASES])
def test_value(module, expression, printed):
    names = {"np": np, "u": u, "cosmology": cosmology, "Modes": Modes} | vars(importlib.import_module(module))
    value = eval(expression, names)
    assert " ".join(repr(value.item() if isinstance(value, np.generic) else value).split()) == printed
