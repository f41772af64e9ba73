"""What small functions give, at values that are known: an expression in the names of its module, and how it is printed."""

import importlib

import numpy as np
import pytest
from astropy import cosmology
from astropy import units as u

from vsh import Modes

CASES = [
    ("vsh.basis", "harmonics(np.zeros(5), np.zeros(5), Modes(3)).shape", "(30, 2, 5)"),
    ("vsh.basis", "float(scalar_harmonics(np.zeros(1), np.zeros(1), 1)[2, 0].round(4))", "-0.691"),
    (
        "vsh.commands.parsing",
        'without_folder("/home/me/catalogue.fits"), without_folder("pmra / pmra_error < 5"), without_folder("mu=uas/yr")',
        "('catalogue.fits', 'pmra / pmra_error < 5', 'mu=uas/yr')",
    ),
    (
        "vsh.field",
        "multiply_weights(np.array([[2.0], [3.0], [0.5]]), np.array([[1.0], [2.0]])).ravel()",
        "array([3. , 6.5])",
    ),
    (
        "vsh.io.archive._queries",
        'of_table("user_me.galaxies", ["redshift"]).rpartition(", ")[2].splitlines()',
        "['t.redshift', 'FROM user_me.galaxies AS t', 'JOIN gaiadr3.gaia_source AS g ON g.source_id = t.source_id']",
    ),
    (
        "vsh.io.epochs._solve",
        "downweighting_factor(np.array([1.9, 2.5, -3.0])).round(4)",
        "array([1. , 0.6993, 0.3679])",
    ),
    (
        "vsh.io.parts._engines",
        'add_sums({"a": 1}, {"a": 2, "b": 3}), add_sums((1, None), (2, 3))',
        "({'a': 3, 'b': 3}, (3, 3))",
    ),
    (
        "vsh.io.tables._where",
        'Where("phot_g_mean_mag < 19 and 0.5 < redshift < 2").names',
        "('phot_g_mean_mag', 'redshift')",
    ),
    (
        "vsh.models.cosmology",
        "describe_unusable([np.nan, 0.0, -0.1, 5e-5, 0.1])",
        "'1 missing, 2 zero or negative, 1 below 0.0001'",
    ),
    ("vsh.models.cosmology", "redshift_of(transverse_distance(np.array([0.01, 1.0]))).round(6)", "array([0.01, 1. ])"),
    (
        "vsh.models.cosmology",
        "parallax_factor([100.0, 3400.0], cosmology.LambdaCDM(67.3, 0.315, 0.585)).round(4)",
        "array([1. , 1.0287])",
    ),
    (
        "vsh.models.covariance",
        "from_blocks([([0, 1], 4.0)], 3).matrix[:3, :3]",
        "array([[4., 4., 0.], [4., 4., 0.], [0., 0., 0.]])",
    ),
    ("vsh.models.covariance", "d_plus(2, [0.0, np.pi]).round(12)", "array([[ 1., 0.], [ 1., -0.]])"),
    ("vsh.models.covariance", "wave_fractions(4).round(6)", "array([0. , 0.833333, 0.116667, 0.03 ])"),
    ("vsh.models.waves", "degree_amplitudes(4).round(6)", "array([-0. , 0.660555, -0.247157, 0.125331])"),
    ("vsh.models.waves", "float(strain_of(1.0, 10.0).round(15))", "2.445e-12"),
    ("vsh.modes", "as_modes(2) == as_modes(Modes(2))", "True"),
    ("vsh.scalars", "modes_for(None, 2)", "Modes(lmax=2)"),
    (
        "vsh.sky.frames",
        'redshift_frame_in("Redshift in the CMB frame"), redshift_frame_in("Redshift")',
        "('cmb', None)",
    ),
    ("vsh.tools.arguments", 'number("extra", 3)', "3.0"),
    ("vsh.tools.arguments", 'choice("common", "higher", (None, "higher"))', "'higher'"),
    ("vsh.tools.arguments", 'indices("sources", [True, False, True], 3)', "array([0, 2])"),
    (
        "vsh.tools.bad_rows",
        'find_placeholder_rows({"pmra": np.array([-9999.0, -99.0, -99.0]), "pmdec": np.array([1.0, 2.0, -99.0])})',
        "array([ True, False, True])",
    ),
    (
        "vsh.tools.bad_rows",
        'doubtful_motion_notes({"pmra": np.array([1.0, -999.0]), "pmdec": np.array([1.0, 2.0])})[0][:55]',
        "'warning: 1 row has a motion of -999 in one component: a'",
    ),
    ("vsh.tools.printing", 'printable("red \\x1b[31m")', "'red \\\\x1b[31m'"),
    ("vsh.tools.parallel", "list(map_blocks(lambda s: (s.start, s.stop), n=5, size=2))", "[(0, 2), (2, 4), (4, 5)]"),
    ("vsh.tools.parallel", "free_memory() > 0", "True"),
    ("vsh.tools.units", "round(hubble_rate(67.3), 4), round(hubble_rate(70), 4)", "(14.1969, 14.7665)"),
    ("sim.agis.passes._scans", "[round(scaled(5000)[0].spin_rate, 9), round(scaled(5000)[1], 9)]", "[6.0, 3000.0]"),
    (
        "sim.agis.passes._scans",
        "spline_weights(np.array([0.0])).ravel().round(4)",
        "array([0.1667, 0.6667, 0.1667, 0. ])",
    ),
    ("effects", 'f"{circular_acceleration(223 * u.km / u.s, 8.2 * u.kpc):.6f}"', "'4.267305 uas / yr'"),
    ("effects", 'f"{attraction(2e10 * u.M_sun, 50 * u.kpc):.1e}"', "'2.4e-02 uas / yr'"),
    ("effects", 'f"{transverse_motion(750 * u.km / u.s, 44.44 * u.Mpc):.2f}"', "'3.56 uas / yr'"),
    ("effects", 'f"{lensing_depth(0.05 / u.Mpc**3, 1e11 * u.M_sun, 5 * u.Gpc, 10 * u.Gpc):.2f}"', "'0.08'"),
    (
        "sim.variability",
        "np.abs(np.diff(markov_chain(np.linspace(0, 5, 1000), sigma=100.0, tau=2.0, rng=1))).max() < 50",
        "True",
    ),
    ("fit.background._waves", "round(probability_above(18.30704, np.ones(10), np.zeros(10)), 5)", "0.05"),
    ("fit.motions.galaxy", "round(angular_speed(), 2)", "28.89"),
    ("fit.motions.galaxy", "round(angular_speed_error(), 3)", "0.26"),
    (
        "fit.results.output._text",
        '[cell(x) for x in (0.123456, 1215942.0, float("nan"), "T1", 7)]',
        "['0.1235', '1215942', '', 'T1', '7']",
    ),
    ("fit.pairs._correlation", "waves_curve([0.0, 0.2, 1.3]).round(7)", "array([ 1. , 0.9330074, -0.2881578])"),
    (
        "fit.posterior._summary",
        '[round(x, 2) for x in intervals({"x": np.arange(101.0)})["x"]]',
        "[50.0, 15.87, 84.13, 2.5, 97.5, 50.0, 29.3]",
    ),
    ("fit.results.quality", "round(float(log_p_value(2000.0, 3)), 2)", "-996.42"),
    (
        "fit.results.quality",
        "round(float(normal_deviate(12, 3)), 4), round(float(normal_deviate(2000, 3)), 1)",
        "(2.4381, 44.5)",
    ),
    ("fit.results.quality", "norm_limit(np.array([0.0, 10.0]), np.ones(2), 3).round(2)", "array([ 2.45, 11.55])"),
    (
        "fit.robust._clip",
        "[round(float(np.sqrt(truncation_factors(kappa**2 * np.log(2))[0])), 3) for kappa in (3, 2.5, 2, 1.5)]",
        "[1.006, 1.03, 1.108, 1.308]",
    ),
    (
        "fit.posterior._sampling",
        "integrable_with_inverse_cube(Flat(50.0, 80.0)), integrable_with_inverse_cube(Normal(67.3, 15.0))",
        "(True, False)",
    ),
    ("fit.results.spectrum", "round(float(wilson_hilferty(12, 3)), 4)", "2.4304"),
]


@pytest.mark.parametrize(("module", "expression", "printed"), CASES, ids=[f"{m}: {e[:40]}" for m, e, _ in CASES])
def test_value(module, expression, printed):
    names = {"np": np, "u": u, "cosmology": cosmology, "Modes": Modes} | vars(importlib.import_module(module))
    value = eval(expression, names)
    assert " ".join(repr(value.item() if isinstance(value, np.generic) else value).split()) == printed
