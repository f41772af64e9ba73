"""The basic angle among the unknowns: words, the joint solution against dense matrices, what it takes of a wave."""

import inspect

import numpy as np
import pytest

import sim
from sim import agis
from sim.agis import Calibration
from study.commands import waves
from vsh import DegeneracyError, Modes, ParameterError
from vsh.io.epochs import make_design_rows
from vsh.sky.frames import rotation_matrix

YEARS = 1.0
LAW = sim.NominalScanningLaw(years=YEARS)
WORDS = "free every 40 days to order 1, known to 500 µas"


@pytest.fixture(scope="module")
def quasars():
    return sim.quasars(40, 1)


def make(quasars, calibration, knots=2 * 86400.0, **options):
    scans = agis.scans(LAW, quasars.lon, quasars.lat, 100.0, 500.0, knots=knots)
    return agis.System(scans, calibration=calibration, **options)


def half_angle(quasars, scans):
    """±1/2 times offset, cosine and sine of the spin phase in intervals of 40 days, from the transits themselves."""
    transits = LAW.transits(quasars.lon, quasars.lat)
    order = np.argsort(transits.time, kind="stable")
    np.testing.assert_array_equal(transits.source[order], scans.source)
    time, sign = scans.time(), transits.view[order] / 2
    z, preceding, following = LAW.attitude(time)
    first = rotation_matrix("ecliptic", "icrs") @ LAW.sun(time)[0]
    first -= z * np.sum(first * z, 0)
    first /= np.linalg.norm(first, axis=0)
    second = np.cross(z, first, axis=0)
    middle = preceding + following
    phase = np.arctan2(np.sum(middle * second, 0), np.sum(middle * first, 0))
    columns = np.zeros((len(time), 9, 3))
    columns[np.arange(len(time)), np.minimum(9 * time, 8).astype(int)] = np.stack(
        [np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1
    )
    return sign[:, None] * columns.reshape(len(time), -1)


def test_words():
    for words in (WORDS, "constant to order 8", "free every 0.25 days to order 0"):
        assert str(Calibration.parse(words)) == words
    assert Calibration.parse("free every 5 days, known to 1e-1 uas") == Calibration(0, 5.0, 0.1)
    assert Calibration.parse("constant to order 2").columns(LAW, np.linspace(0, 1, 7)).shape == (7, 5)
    assert Calibration.parse("none") is Calibration.parse(None) is None
    # Written out in three places, so that commands need not import this package to list their options.
    assert waves.make_parser().get_default("calibration") == agis.GAIA_CALIBRATION
    assert inspect.signature(sim.epochs).parameters["calibration"].default == agis.GAIA_CALIBRATION
    for words in ("free", "free every day", "known to 1 µas", "free every 5 days to order -1", 5):
        with pytest.raises(ParameterError, match="calibration is expected"):
            Calibration.parse(words)
    for options in ({"days": 0.0}, {"known": -1.0}, {"order": -1}):
        with pytest.raises(ParameterError):
            Calibration(**options)


def test_joint_solution_is_that_of_dense_matrices(quasars):
    """Sources, attitude and angle by one matrix of all unknowns, its six rotations left out."""
    system = make(quasars, WORDS)
    scans, n, c = system.scans, 5 * system.scans.n_sources, 3 * system.coefficients
    angle = half_angle(quasars, scans)
    size = n + c + angle.shape[1]
    columns = np.zeros((2 * len(scans), size))
    for k in range(n + c):
        unit = np.zeros(n + c)
        unit[k] = 1
        columns[:, k] = np.concatenate(system.predict(unit[:n].reshape(-1, 5), unit[n:].reshape(-1, 3)))
    columns[: len(scans), n + c :] = angle
    weights = scans.weights[:, scans.source].ravel()
    matrix = columns.T @ (weights[:, None] * columns)
    bend = np.kron(np.diff(np.eye(system.coefficients), 2, axis=0), np.eye(3)) / system.smoothing
    matrix[n : n + c, n : n + c] += bend.T @ bend
    matrix[n + c :, n + c :] += np.eye(angle.shape[1]) / 500.0**2
    rng = np.random.default_rng(2)
    observed = rng.normal(size=2 * len(scans)) / np.sqrt(weights) + 300.0 * columns[:, n + c + 3]
    scale = 1 / np.sqrt(np.diag(matrix))
    inverse = np.linalg.pinv(matrix * np.outer(scale, scale), rcond=1e-11, hermitian=True) * np.outer(scale, scale)
    solution = inverse @ (columns.T @ (weights * observed))
    found = system.solve(*np.split(observed, 2), stop=None, iterations=600)
    mine, dense = (system.without_null_space(x.reshape(-1, 5, 1))[0] for x in (found.sources, solution[:n]))
    sigma = np.sqrt(np.einsum("nii->ni", system.formal))[..., None]
    assert np.abs((mine - dense) / sigma).max() < 1e-3
    np.testing.assert_allclose(found.angle, solution[n + c :], atol=1e-3 * np.abs(found.angle).max())
    residual = observed - np.concatenate(system.predict(found.sources, found.attitude))
    residual[: len(scans)] -= angle @ found.angle
    assert np.sum(weights * residual**2) == pytest.approx(
        np.sum(weights * (observed - columns @ solution) ** 2), rel=1e-6
    )
    modes_of = system.true_covariance(1, tolerance=1e-9)
    g = agis._globals.MotionFit(system, agis._globals.as_modes(1), np.arange(len(quasars.lon))).functionals(
        np.arange(6)
    )
    rows = system._remove_null_space(g).reshape(n, -1)
    np.testing.assert_allclose(modes_of, rows.T @ inverse[:n, :n] @ rows, rtol=2e-3)
    # More unknowns make no error smaller.
    assert (np.diag(modes_of) > np.diag(make(quasars, None).true_covariance(1, tolerance=1e-9))).all()


def test_varying_angle_is_taken_by_its_calibration(quasars):
    """An angle that varies with the spin phase moves the sources, unless it is calibrated."""
    free = "free every 40 days to order 1"
    system = make(quasars, free)
    coefficients = np.random.default_rng(3).normal(size=27) * 1000.0
    along = half_angle(quasars, system.scans) @ coefficients
    observed = along, np.zeros_like(along)
    calibrated = system.solve(*observed, stop=None, iterations=600)
    plain = make(quasars, None).solve(*observed, stop=None, iterations=600)
    np.testing.assert_allclose(calibrated.angle, coefficients, atol=1.0)
    errors = [np.std(system.without_null_space(each.sources[..., None])[0][:, :2]) for each in (calibrated, plain)]
    assert plain.angle is None
    assert errors[0] < 1.0
    assert errors[1] > 50.0


def test_scale_along_the_scan_moves_no_source(quasars):
    """Nine CCDs displaced in proportion to their place in the field, by a scale that varies: their mean stays."""
    scans = agis.scans(LAW, quasars.lon, quasars.lat, 100.0, 500.0, knots=2 * 86400.0, ccds=9)
    time = scans.time()
    order = np.lexsort([time, scans.source])
    place = np.empty(len(time))
    place[order] = np.tile(np.arange(9) - 4.0, len(time) // 9)
    along = 1000.0 * place / 4 * np.cos(2 * np.pi * 3.0 * time)
    system = agis.System(scans)
    # What it adds to the equations of sources and attitude, against what the same sizes alone would.
    for mine, largest in zip(system.adjoint(along, 0 * along), system.adjoint(np.abs(along), 0 * along), strict=True):
        assert np.abs(mine).max() < 1e-4 * np.abs(largest).max()


def test_what_cannot_be_calibrated(quasars):
    with pytest.raises(ParameterError, match=r"needs knots of the attitude at most 43200 s apart, not 172800 s"):
        make(quasars, "free every 5 days")
    with pytest.raises(DegeneracyError, match="to order 40 is not determined"):
        make(quasars, "free every 20 days to order 40")


def test_prior_goes_from_free_to_none(quasars):
    """The response with a basic angle known better and better goes from that of a free one to that of a known one."""
    transits = LAW.transits(quasars.lon, quasars.lat)
    scan = np.array([np.sin(transits.angle), np.cos(transits.angle)])
    time = transits.time - YEARS / 2
    where = quasars.lon[transits.source], quasars.lat[transits.source], scan, time
    modes = Modes(2)

    def left(words, **options):
        response = agis.Response(LAW, nside=3, steps=30_000, calibration=words, **options)
        fields = response.left(
            *where, modes, lambda t: np.array([np.cos(20 * t), np.sin(20 * t)]), view=transits.view.astype(int)
        )
        for source in range(len(quasars.lon)):  # a common parallax is as good as a basic angle that goes with cos Ω
            own = transits.source == source
            root = np.linalg.qr(make_design_rows(transits.angle, transits.parallax_factor, time)[:, own].T)[0]
            fields[own] -= root @ (root.T @ fields[own])
        return np.sqrt(np.mean(fields.reshape(len(time), 2, -1)[..., modes.slice_of("S", 1)] ** 2))

    free, none = left("free every 5 days to order 1"), left(None)
    size = [left(f"free every 5 days to order 1, known to {known} µas") for known in (100, 0.1, 0.001)]
    assert size[0] == pytest.approx(free, rel=0.02)
    assert free * 1.2 < size[1] < none / 1.2
    assert size[2] == pytest.approx(none, rel=1e-3)
    # A prior counts beside what stars tell: ten times as well known is a hundred times as much information.
    assert left("free every 5 days to order 1, known to 0.01 µas") == pytest.approx(
        left("free every 5 days to order 1, known to 0.1 µas", information=agis._response.INFORMATION / 100), rel=1e-6
    )
