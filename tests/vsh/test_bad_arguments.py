"""Whatever is given to a public function ends in a result or in our own error: never in a library's."""

import inspect

import numpy as np
import pytest

import fit
import sim
from fit import background
from fit.correlation import correlation_matrices, influence_map, leakage, lmax_table, predict_covariance
from fit.posterior import Flat, Normal, grid
from fit.redshift import binned, equal_information, permutation_test
from fit.secular_parallax import hubble_constant, observer_velocity
from sim import agis
from study.forecast import Survey, forecast_surveys
from vsh import Coefficients, Field, Modes, ScalarCoefficients, ScalarField, ScalarModes, Vector
from vsh.basis import harmonics
from vsh.io.catalogue import match, read_field, read_positions, read_scalars
from vsh.models import cosmology, covariance
from vsh.models.cosmology import transverse_distance
from vsh.models.covariance import Covariance, Spectrum
from vsh.models.waves import strain_of, wave_coefficients
from vsh.rotate import rotate
from vsh.sky.pixels import pixels_of, random_positions
from vsh.tools.arguments import between, choice, float_array, not_negative, number, positive, whole
from vsh.tools.errors import VshError
from vsh.transform import adjoint, synthesis

FIELD = sim.observe(sim.galaxies(60, 1), sim.spin((1, 2, 3)), 2, sigma=10.0)
BINS = binned(FIELD, 1, 2, flows=None)
NORMAL = fit.normal_equations(FIELD, 1)
NORMAL_3 = fit.normal_equations(FIELD, 3)
LAW = sim.NominalScanningLaw(years=1.0)
SCANS = agis.scans(LAW, FIELD.lon, FIELD.lat, 100.0, 500.0, 4 * 86400.0)
SYSTEM = agis.System(SCANS)
NOISE = agis.observations(SCANS, 1)
SOLVED = SYSTEM.solve(*NOISE)
PAIRS = fit.pairs.correlation_function(FIELD, np.radians([0, 60, 120, 180]), nside=1)
NAMED = Field(FIELD.lon, FIELD.lat, FIELD.motion, FIELD.sigma, name=np.arange(60))
#: A call that works; each of its arguments is replaced by each of the values below.
CALLS = {
    fit.normal_equations: (FIELD, 1), fit.solve: (NORMAL,), fit.fit_field: (FIELD, 1), fit.solve_frame: (FIELD,),
    fit.cross_check: (FIELD,), fit.gaussian_prior: (1, 1.0), fit.clip: (FIELD, 1, 3.0),
    fit.robust.student_t: (FIELD, 1, 4.0), fit.robust.excess_noise: (FIELD, 1),
    fit.resample.bootstrap: (FIELD, 1, 3, 1), fit.resample.jackknife: (FIELD, 1, 1), fit.resample.block_bootstrap: (FIELD, 1, 1, 3, 1),
    binned: (FIELD, 1, 2),
    permutation_test: (FIELD, BINS, 3, 1), equal_information: (FIELD, 2), observer_velocity: (FIELD, 70.0),
    hubble_constant: (FIELD, "planck"), grid: (FIELD, "planck", Flat(20, 150)), predict_covariance: (FIELD, 1), correlation_matrices: (FIELD,),
    influence_map: (FIELD, 1, "a_x", 1), leakage: (FIELD, 1, 2), lmax_table: (FIELD, 2),

    Coefficients: (1, np.zeros(6)), Coefficients.from_vectors: ((1, 2, 3), (1, 2, 3), 1), Modes: (1,), Vector: ([1, 2, 3], np.eye(3)),
    Vector.from_spherical: (1.0, 10.0, 20.0), Normal: (67.0, 1.0), Flat: (50.0, 80.0), harmonics: (FIELD.lon, FIELD.lat, 1),
    synthesis: (Coefficients(1, np.zeros(6)), FIELD.lon, FIELD.lat), adjoint: (1, FIELD.lon, FIELD.lat, FIELD.motion),
    rotate: (Coefficients(1, np.zeros(6)), "galactic"), pixels_of: (FIELD.lon, FIELD.lat, 1), random_positions: (np.ones(12), 3, 1),
    transverse_distance: (FIELD.redshift,), match: (FIELD, FIELD, "position"), Field: (FIELD.lon, FIELD.lat, FIELD.motion, FIELD.sigma),
    Field.from_columns: tuple(np.ones(3) for _ in range(6)), read_field: ({"ra": [1.0]},), cosmology.velocity_along: ("planck", "icrs"),
    cosmology.velocity_from_apex: (300, 10, 20), sim.quasars: (10, 1, "uniform", 20.0), sim.galaxies: (10, 1), sim.observe: (sim.quasars(10, 1), sim.spin((1, 2, 3)), 1, 10.0),
    sim.spin: ((1, 2, 3),), sim.secular_parallax: ((1, 2, 3),), sim.peculiar: (300.0, 1), sim.random_field: (np.ones(2), 1), sim.wave_background: (1e-3, 1),
    sim.anisotropic_expansion: (np.zeros((3, 3)),), sim.NominalScanningLaw: (2014.73, 0.2),
    sim.Variability: (100.0, 2.0), sim.uniform_sky: (10, 1), sim.vlbi_quasars: (sim.quasars(10, 1), 3, 1), sim.gaia_errors: (np.ones(3),),
    background.floor: (NORMAL_3, (2, 3)), background.fit_amplitudes: (NORMAL_3, [Spectrum.flat()], True), background.wave_limit: (NORMAL_3, (2,)),
    sim.systematics: (Spectrum.flat(), 1),
    Spectrum.given: (np.ones(3), np.ones(3)), Spectrum.power_law: (-1.0,), Spectrum.waves: (70.0,), Covariance: (np.eye(4),),
    covariance.of_errors: (FIELD,), covariance.from_function: (FIELD, np.cos), covariance.from_spectrum: (FIELD, Spectrum.flat(), 2),
    covariance.from_blocks: ([([0, 1], 1.0)], 3),
    sim.stars: (10, 1), agis.scans: (LAW, FIELD.lon, FIELD.lat, 100.0, 500.0, 4 * 86400.0), agis.System: (SCANS, 10.0),
    agis.observations: (SCANS, 1), agis.start_errors: (SCANS, 1), agis.scaled: (5000,), agis.plan: (LAW, FIELD.lon, FIELD.lat, 30.0),
    agis.global_motion: (FIELD.lon, FIELD.lat, 1), agis.correlation_by_angle: (np.ones((10, 60)), FIELD.lon, FIELD.lat, [0.0, 1.0]),
    agis.ratio_by: (np.ones(60), np.ones(60), np.zeros(60, int)), agis.mixture: (sim.Mission(LAW), sim.quasars(10, 1)),
    SYSTEM.solve: NOISE, SYSTEM.predict: (np.zeros((60, 5)), np.zeros((SYSTEM.coefficients, 3))), SYSTEM.adjoint: NOISE,
    SYSTEM.formal_covariance: (1, FIELD.lon, FIELD.lat), SYSTEM.true_covariance: (1, FIELD.lon, FIELD.lat),
    SYSTEM.covariance_of: (np.ones((60, 5, 1)),), SOLVED.rotated: ((1, 2, 3), (1, 2, 3)),
    fit.pairs.correlation_function: (FIELD, np.radians([0, 60, 120, 180])), PAIRS.fit: (("waves",),), fit.pairs.waves_curve: ([0.1],),
    sim.plane_wave: ((0, 0, 1), 1.0), wave_coefficients: ((0, 0, 1), 1.0), strain_of: (1.0, 1.0), fit.waves.search: (NORMAL_3,),
    fit.shear.expansion: (fit.solve(NORMAL_3),), fit.shear.from_tensor: (np.eye(3),), fit.galaxy.orbit: (fit.solve(NORMAL),),
    fit.galaxy.circular_speed: (5.0, 0.3), fit.galaxy.distance_of_centre: (5.0, 0.3), fit.galaxy.expected_acceleration: (8.2,), fit.compare.compare_catalogues: (NAMED, NAMED, 1),
    ScalarField: (FIELD.lon, FIELD.lat, FIELD.lat, FIELD.rho + 1), ScalarCoefficients: (1, np.zeros(4)), ScalarModes: (1,),
    ScalarCoefficients.from_moments: (1.0, (1, 2, 3)), forecast_surveys: ({"one": Survey(100, sigma=1.0)},), Survey: (100, None, 1.0, 2.0), read_scalars: ({"ra": [1.0]},), read_positions: ({"ra": [1.0]},),
    positive: ("x", 1), not_negative: ("x", 1), number: ("x", 1), between: ("x", 1, 0, 2), whole: ("x", 1), choice: ("x", 1, (1,)),
}  # fmt: skip
BAD = [None, np.nan, np.inf, -1, 0, 0.5, "word", b"bytes", [], [1, 2], {}, object(), True, np.nan * np.ones(3),
       np.ma.masked_array([1.0, 2, 3], [True, False, False]), np.array([1, 2, 3], np.float32), np.array(["a", "b"]), 1 + 2j,
       lambda x: x, np.zeros((2, 0))]  # fmt: skip


#: Names of the arguments in CALLS, where they are not the first ones.
NAMES = {sim.observe: ["population", "signal", "rng", "sigma"]}


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("function", CALLS, ids=lambda f: f.__qualname__)
def test_bad_arguments_end_in_our_errors(function):
    """Of 1455 such calls 427 ended in bare TypeErrors, 104 in bare ValueErrors."""
    names = NAMES.get(function, list(inspect.signature(function).parameters))
    good = dict(zip(names, CALLS[function], strict=False))
    if function not in (read_field, read_scalars, read_positions):
        function(**good)
    strange = []
    # A function of the wrong kind fails in its own words: it is the caller's code.
    for place in good:
        for value in BAD:
            if callable(value) and function is sim.observe and place == "signal":
                continue
            try:
                function(**good | {place: value})
            except VshError:
                continue
            except Exception as error:
                strange.append(f"argument {place} = {value!r}: {type(error).__name__}: {str(error)[:80]}")
    assert not strange, f"{len(strange)} of {len(good) * len(BAD)}\n" + "\n".join(strange[:40])
    assert inspect.signature(function)


def test_what_is_not_finite_is_refused_unless_asked_for():
    values = np.array([1.0, np.nan])
    with pytest.raises(VshError, match="1 of 2 values of x are not finite"):
        float_array("x", values)
    np.testing.assert_array_equal(float_array("x", values, finite=False), values)
