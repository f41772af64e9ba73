"""Whatever is given to a public function ends in a result or in our own error: never in a library's."""

import inspect
from contextlib import suppress

import numpy as np
import pytest
from fuzz_api import functions

import fit
import sim
from fit.posterior import Flat, Normal
from fit.redshift import binned
from sim import agis
from study.forecast import Survey, forecast_surveys
from vsh import Coefficients, Field, Modes, ScalarCoefficients, ScalarField, ScalarModes, Vector
from vsh.basis import harmonics
from vsh.io.catalogue import read_field, read_positions, read_scalars
from vsh.models import cosmology, covariance
from vsh.models.covariance import Covariance, Spectrum
from vsh.models.waves import compute_strain
from vsh.sky.pixels import draw_map_positions, pixels_of
from vsh.tools.arguments import between, choice, float_array, not_negative, number, positive, whole
from vsh.tools.errors import VshError

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
#: What an argument of each name may be: of every promised function, which `fuzz_api` finds.
ARGUMENTS = {
    "a": NAMED, "acceleration": 5.0, "b": NAMED, "binned": BINS, "catalogues": {"one": FIELD, "two": FIELD},
    "coefficients": Coefficients(2, np.zeros(16)), "cross": 0.5, "degrees": (2, 3), "direction": (0, 0, 1),
    "distance": np.ones(3), "edges": 2, "error": 1.0, "farthest": 100.0, "field": FIELD, "fields": FIELD, "fitted": 1,
    "frequency": 2.0, "function": np.cos, "hubble": 70.0, "kappa": 3.0, "l": 10, "lat": FIELD.lat, "law": LAW, "lmax": 1,
    "lon": FIELD.lon, "magnitude": np.ones(3), "mission": LAW, "modes": 1, "motion": FIELD.motion, "motions": FIELD,
    "n": 10, "n_replicates": 3, "nearest": 10.0, "normal": NORMAL_3, "normals": [NORMAL_3, NORMAL_3], "nside": 1,
    "nu": 4.0, "omega": 1e-3, "parameters": "a_x", "plus": 1.0, "population": sim.quasars(10, 1), "power": np.ones(2),
    "quasars": sim.quasars(10, 1), "redshift": FIELD.redshift, "rng": 1, "scans": SCANS, "shear": np.zeros((3, 3)),
    "sigma": 10.0, "signal": sim.spin((1, 2, 3)), "sky": "uniform", "solution": fit.solve(NORMAL_3), "sources": FIELD,
    "spectra": [Spectrum.flat()], "spectrum": Spectrum.flat(), "speed": 300.0, "start": 0.0, "tensor": np.eye(3),
    "theta": np.ones(3), "time": np.arange(5.0), "to": "galactic", "unmodelled": 2, "vector": (1, 2, 3),
    "velocity": (1, 2, 3),
}  # fmt: skip
#: Where a name means something else, or more is needed.
OF_FUNCTION = {
    "fit.galaxy.orbit": {"acceleration": fit.solve(NORMAL_3)}, "fit.motions.galaxy.orbit": {"acceleration": fit.solve(NORMAL_3)},
    "fit.pairs.correlation_function": {"edges": np.radians([0, 60, 120, 180])},
    "fit.secular_parallax.hubble_constant": {"velocity": "planck"}, "fit.secular_parallax.observer_velocity": {"hubble": 70.0},
    "sim.agis.mixture": {"mission": sim.Mission(LAW)}, "sim.agis.scans": {"sigma_along": 100.0, "sigma_across": 500.0},
    "vsh.models.cosmology.distance_modulus": {"redshift": np.ones(3)}, "vsh.models.cosmology.velocity_from_apex": {"b": 20},
    "vsh.rotate.degree_matrix": {"l": 2},
    "vsh.conventions.scalar_to_healpy": {"coefficients": ScalarCoefficients(1, np.zeros(4))},
}  # fmt: skip
#: Calls that take long, or need files, epochs, stars or a mission: their own tests have these.
ELSEWHERE = (
    "sample", "flow_modes", "compare_expansions", "compare_blocks", "permutation_test", "joint_system", "solve_mission",
    "epochs", "link", "in_time", "kinematics", "conventions", "cross_powers", "answer_of", "estimate", "predict_errors",
    "sim.observe_offsets", "expected_covariances", "waves.search", "background.shared", "combine_frames", "forecast_velocity",
)  # fmt: skip


def required(function):
    """The arguments that a function must have."""
    return [each.name for each in inspect.signature(function).parameters.values()
            if each.default is each.empty and each.kind in (each.POSITIONAL_OR_KEYWORD, each.KEYWORD_ONLY)]  # fmt: skip


#: Promised functions with arguments that work: those that read files have tests of damaged ones.
PROMISED = {
    name: (function, {each: ARGUMENTS.get(each) for each in required(function)} | OF_FUNCTION.get(name, {}))
    for name, function in functions().items()
    if not any(each in name for each in ELSEWHERE)
    and not {"path", "source", "table", "alm", "transits", "frame"} & set(required(function))
}
#: Nouns and methods, with arguments that work.
MADE = {
    Coefficients: (1, np.zeros(6)), Coefficients.from_vectors: ((1, 2, 3), (1, 2, 3), 1), Modes: (1,), Vector: ([1, 2, 3], np.eye(3)),
    Vector.from_spherical: (1.0, 10.0, 20.0), Normal: (67.0, 1.0), Flat: (50.0, 80.0), harmonics: (FIELD.lon, FIELD.lat, 1),
    pixels_of: (FIELD.lon, FIELD.lat, 1), draw_map_positions: (np.ones(12), 3, 1), Field: (FIELD.lon, FIELD.lat, FIELD.motion, FIELD.sigma),
    Field.from_columns: tuple(np.ones(3) for _ in range(6)), cosmology.velocity_in_frame: ("planck", "icrs"),
    sim.NominalScanningLaw: (2014.73, 0.2), sim.Variability: (100.0, 2.0), sim.galaxies: (10, 1), read_field: ({"ra": [1.0]},),
    Spectrum.given: (np.ones(3), np.ones(3)), Spectrum.power_law: (-1.0,), Spectrum.waves: (70.0,), Covariance: (np.eye(4),),
    covariance.of_errors: (FIELD,), covariance.from_blocks: ([([0, 1], 1.0)], 3), agis.System: (SCANS, 10.0), agis.scaled: (5000,),
    SYSTEM.solve: NOISE, SYSTEM.adjoint: NOISE,
    SYSTEM.predict: (np.zeros((60, 5)), np.zeros((SYSTEM.coefficients, 3))), SYSTEM.formal_covariance: (1, FIELD.lon, FIELD.lat),
    SYSTEM.true_covariance: (1, FIELD.lon, FIELD.lat), SYSTEM.covariance_of: (np.ones((60, 5, 1)),), SOLVED.rotated: ((1, 2, 3), (1, 2, 3)),
    PAIRS.fit: (("waves",),), fit.pairs.waves_curve: ([0.1],), compute_strain: (1.0, 1.0), Survey: (100, None, 1.0, 2.0),
    forecast_surveys: ({"one": Survey(100, sigma=1.0)},), ScalarField: (FIELD.lon, FIELD.lat, FIELD.lat, FIELD.rho + 1),
    ScalarCoefficients: (1, np.zeros(4)), ScalarModes: (1,), ScalarCoefficients.from_moments: (1.0, (1, 2, 3)),
    read_scalars: ({"ra": [1.0]},), read_positions: ({"ra": [1.0]},),
    positive: ("x", 1), not_negative: ("x", 1), number: ("x", 1), between: ("x", 1, 0, 2), whole: ("x", 1), choice: ("x", 1, (1,)),
}  # fmt: skip
BAD = [None, np.nan, np.inf, -1, 0, 0.5, "word", b"bytes", [], [1, 2], {}, object(), True, np.nan * np.ones(3),
       np.ma.masked_array([1.0, 2, 3], [True, False, False]), np.array([1, 2, 3], np.float32), np.array(["a", "b"]), 1 + 2j,
       lambda x: x, np.zeros((2, 0))]  # fmt: skip


def strange(function, good):
    """What a call ends in that is neither a result nor our own error, with each argument replaced by each bad value."""
    for place in good:
        for value in BAD:
            if callable(value) and place in ("signal", "function"):  # of the wrong kind it fails in its own words
                continue
            try:
                function(**good | {place: value})
            except VshError:
                continue
            except Exception as error:
                yield f"argument {place} = {value!r}: {type(error).__name__}: {str(error)[:80]}"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", PROMISED)
def test_bad_arguments_of_promised_functions_end_in_our_errors(name):
    """Of 1455 such calls 427 ended in bare TypeErrors, 104 in bare ValueErrors."""
    function, good = PROMISED[name]
    missing = [each for each, value in good.items() if value is None]
    assert not missing, f"give ARGUMENTS an example of {missing}"
    function(**good)
    for each in inspect.signature(function).parameters.keys() - good.keys() & ARGUMENTS.keys():
        with suppress(VshError):  # an option that excludes another
            function(**good, **{each: ARGUMENTS[each]})
            good = good | {each: ARGUMENTS[each]}
    assert not list(strange(function, good))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("function", MADE, ids=lambda f: f.__qualname__)
def test_bad_arguments_end_in_our_errors(function):
    good = dict(zip(inspect.signature(function).parameters, MADE[function], strict=False))
    if function not in (read_field, read_scalars, read_positions):
        function(**good)
    assert not list(strange(function, good))


def test_what_is_not_finite_is_refused_unless_asked_for():
    values = np.array([1.0, np.nan])
    with pytest.raises(VshError, match="1 of 2 values of x are not finite"):
        float_array("x", values)
    np.testing.assert_array_equal(float_array("x", values, finite=False), values)
