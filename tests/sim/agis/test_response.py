"""What a solved attitude leaves of motions that change with time: closed form, a global solution, searches for waves."""

import numpy as np
import pytest
from exact_response import power_after_attitude_solution

import sim
from fit.waves import search_in_time
from sim import agis
from sim.agis import Calibration, Response
from vsh import FrameError, Modes, ParameterError
from vsh.basis import harmonics
from vsh.io.epochs import Observations, make_design_rows
from vsh.models.waves import wave_motions
from vsh.sky.pixels import centres
from vsh.sky.sphere import angles, triad

YEARS = 5.5
LAW = sim.NominalScanningLaw(years=YEARS)


def swing(rate):
    return lambda time: np.array([np.cos(rate * time), np.sin(rate * time)])


@pytest.fixture(scope="module")
def coarse():
    return Response(LAW, nside=4, steps=60_000)


@pytest.mark.parametrize("l", [1, 2, 3, 4, 5])
def test_closed_form_is_that_of_a_scan_circle(l):
    """A field of random coefficients along many great circles, and its difference at two places Γ apart."""
    rng, modes, gamma = np.random.default_rng(l), Modes(5), np.radians(106.5)
    for kind in "TS":
        own = modes.slice_of(kind, l)
        phase = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        left = whole = 0.0
        for _ in range(12):
            pole = rng.normal(size=3)
            pole /= np.linalg.norm(pole)
            u = np.cross(pole, [0.3, -0.5, 0.8])
            u /= np.linalg.norm(u)
            w = np.cross(pole, u)
            fields = []
            for angle in (phase, phase + gamma):
                r = u[:, None] * np.cos(angle) + w[:, None] * np.sin(angle)
                m = w[:, None] * np.cos(angle) - u[:, None] * np.sin(angle)
                p, q, _ = triad(*angles(r))
                basis = harmonics(*angles(r), modes)[own] / np.sqrt(modes.norm2[own])[:, None, None]
                fields.append(basis[:, 0] * np.sum(m * p, 0) + basis[:, 1] * np.sum(m * q, 0))
            whole += np.sum(fields[0] ** 2)
            left += np.sum((fields[0] - fields[1]) ** 2) / 4
        # Summed over all orders the circle does not matter.
        assert left / whole == pytest.approx(power_after_attitude_solution(l, kind), abs=1e-12)
    assert power_after_attitude_solution(1, "T") < 1e-30
    assert power_after_attitude_solution(1, "S") == pytest.approx(0.642, abs=1e-3)


def test_rotation_in_time_is_attitude_and_a_glide_is_seen(coarse):
    rng = np.random.default_rng(3)
    time = rng.uniform(-YEARS / 2, YEARS / 2, 4000)
    _, preceding, _ = LAW.attitude(time + YEARS / 2)
    z = LAW.attitude(time + YEARS / 2)[0]
    lon, lat = angles(preceding)
    p, q, _ = triad(lon, lat)
    m = np.cross(z, preceding, axis=0)
    scan = np.array([np.sum(m * p, 0), np.sum(m * q, 0)])
    modes, functions = Modes(2), swing(2 * np.pi * 2.0)
    left = coarse.left(lon, lat, scan, time, modes, functions)
    known = np.einsum("fk,pck,ck->kfp", functions(time), harmonics(lon, lat, modes), scan).reshape(len(time), -1)
    # The same by hand: half the difference of the fields, and what stars in both take up.
    _, _, following = LAW.attitude(time + YEARS / 2)
    both = [known]
    other = np.cross(z, following, axis=0)
    p, q, _ = triad(*angles(following))
    swept = np.array([np.sum(other * p, 0), np.sum(other * q, 0)])
    basis = harmonics(*angles(following), modes)
    both.append(np.einsum("fk,pck,ck->kfp", functions(time), basis, swept).reshape(len(time), -1))
    x = coarse.taken(modes, functions)
    stars = [
        np.einsum(
            "ik,kin->kn",
            coarse._compute_parameter_partials(pixel, direction, time),
            x[5 * pixel[:, None] + np.arange(5)],
        )
        for r, direction in ((preceding, m), (following, other))
        for pixel in [coarse._find_pixels(r)]
    ]
    np.testing.assert_allclose(left, (both[0] - both[1] + stars[0] + stars[1]) / 2, atol=1e-9)
    size = np.sqrt(np.mean(left**2, 0) / np.mean(known**2, 0)).reshape(2, -1)
    rotation, glide = (modes.slice_of(kind, 1) for kind in "TS")
    assert size[:, rotation].max() < 1e-6
    assert size[:, glide].min() > 0.6
    assert size[:, glide].max() < 0.95
    assert np.sqrt(np.mean(size[:, modes.degrees == 2] ** 2)) == pytest.approx(
        np.sqrt((power_after_attitude_solution(2, "T") + power_after_attitude_solution(2, "S")) / 2), abs=0.12
    )


def test_factor_is_kept(coarse, tmp_path):
    modes, functions = Modes(2), swing(10.0)
    first = coarse.taken(modes, functions)
    assert Response(LAW, nside=3, steps=20_000).taken(modes, functions).shape == (5 * 12 * 9, 2 * len(modes))
    coarse.save(tmp_path / "factor.npz")
    again = Response.read(tmp_path / "factor.npz", LAW, steps=60_000)
    np.testing.assert_array_equal(again.taken(modes, functions), first)
    with pytest.raises(ParameterError, match="other steps"):
        Response.read(tmp_path / "factor.npz", LAW, steps=50_000)
    with pytest.raises(FrameError, match="ICRS"):
        Response(sim.NominalScanningLaw(years=1.0, frame="galactic"), nside=2, steps=1000)
    with pytest.raises(ParameterError, match="days"):
        Response(LAW, nside=2, steps=1000, calibration=Calibration(1, 0.0))
    with pytest.raises(ParameterError, match="one a pixel"):
        Response(LAW, np.ones(5), nside=2, steps=1000)


@pytest.mark.parametrize(
    ("free", "glide", "second"),
    [("free every 5 days", (0.9, 1.01), (0.9, 1.01)), ("free every 5 days to order 1", (0.005, 0.06), (0.4, 0.75))],
)
def test_calibration_of_the_basic_angle_takes_what_is_left(free, glide, second):
    """The power that is left with it, over that without: .015 to .027 of a glide, .58 to .60 of degree 2 with (1, 5)."""
    rng, modes, functions = np.random.default_rng(2), Modes(2), swing(2 * np.pi * 2.0)
    lon, lat = rng.uniform(0, 2 * np.pi, 80), np.arcsin(rng.uniform(-1, 1, 80))
    transits = LAW.transits(lon, lat)
    time = transits.time - YEARS / 2
    scan = np.array([np.sin(transits.angle), np.cos(transits.angle)])
    where = lon[transits.source], lat[transits.source], scan, time, modes, functions
    power = []
    for calibration in (None, free):
        response = Response(LAW, nside=3, steps=100_000, calibration=calibration)
        left = response.left(*where, view=transits.view.astype(int))
        for source in range(len(lon)):  # what a common parallax and the basic angle share is the sources' own
            own = transits.source == source
            root = np.linalg.qr(make_design_rows(transits.angle, transits.parallax_factor, time)[:, own].T)[0]
            left[own] -= root @ (root.T @ left[own])
        power.append(np.mean(left**2, 0).reshape(2, -1))
    one, two = np.zeros(len(modes), bool), modes.degrees == 2
    one[modes.slice_of("S", 1)] = True
    for which, (low, high) in ((one, glide), (two, second)):
        assert low < power[1][:, which].sum() / power[0][:, which].sum() < high
    assert "order" in repr(response)


def through_a_solution(stars, quasars, period, strain=300.0, place=200, seed=5):
    """Epochs of quasars after sources and attitude were solved from a sky with a wave, without noise."""
    rng, n = np.random.default_rng(seed), stars + quasars
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    sigma = np.where(np.arange(n) < stars, 100.0, 1000.0)
    scans = agis.scans(LAW, lon, lat, sigma, 5 * sigma, knots=900.0)
    system, time = agis.System(scans), scans.time() - scans.middle
    sin, cos = scans.sin.astype(float), scans.cos.astype(float)
    mine = np.flatnonzero(scans.source >= stars)
    mine = mine[np.argsort(scans.source[mine], kind="stable")]
    k = triad(*centres(8))[2][:, place]
    east, north = wave_motions(lon, lat, k, strain)[:, scans.source] * np.cos(2 * np.pi * time / period)
    solution = system.solve(east * sin + north * cos, north * sin - east * cos, stop=None, iterations=60)
    taken, _ = system.predict(np.zeros((n, 5)), solution.attitude)
    seen = (east * sin + north * cos - taken)[mine]
    t = time[mine]
    design = np.array([sin[mine], cos[mine], scans.along_factor[mine].astype(float), sin[mine] * t, cos[mine] * t])
    source = scans.source[mine] - stars
    errors = np.full(len(t), 1000.0)
    return Observations(lon[stars:], lat[stars:], source, t, design, seen, errors, np.arange(quasars)), place, strain


@pytest.mark.slow
@pytest.mark.parametrize("period", [0.25, 0.5, 2.0])
def test_wave_through_a_global_solution_comes_back(period):
    """As if the attitude were known .6 of it is found, and a 95 % limit below it; with the response all but 4 %."""
    seen, place, strain = through_a_solution(20_000, 500, period)
    known = search_in_time(seen, 1 / period, attitude="known", n_skies=2)
    solved = search_in_time(seen, 1 / period, attitude=Response(LAW, nside=8), n_skies=2)
    assert known.amplitudes[0, place] < 0.7 * strain
    assert known.limits[place] < 0.85 * strain
    assert 0.94 < solved.amplitudes[0, place] / strain < 1.02
    assert np.abs(solved.amplitudes[1:, place]).max() < 0.02 * strain
    assert solved.limits[place] > strain


def test_search_knows_the_response(coarse):
    """A wave of which the attitude took its share, by the response itself: found whole, as a known attitude is not."""
    rng, n = np.random.default_rng(7), 60
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    transits = LAW.transits(lon, lat)
    source, time = transits.source, transits.time - YEARS / 2
    from vsh.models.waves import wave_templates

    design = make_design_rows(transits.angle, transits.parallax_factor, time)
    place, rate = 50, 2 * np.pi * 2.3
    k = triad(*centres(4))[2][:, [place]]
    modes = Modes(5)
    plus = wave_templates(k, 5)[0, :, 0]
    fields = coarse.left(lon[source], lat[source], design[:2], time, modes, swing(rate))
    position = 80.0 * fields[:, : len(modes)] @ plus
    error = np.full(len(time), 50.0)
    noisy = Observations(
        lon, lat, source, time, design, position + 0.01 * rng.normal(size=len(time)), error, np.arange(n)
    )
    found = search_in_time(noisy, 2.3, attitude=coarse, nside=4, n_skies=20)
    assert found.amplitudes[0, place] == pytest.approx(80.0, rel=0.01)
    assert np.abs(found.amplitudes[1:, place]).max() < 1.0
    assert "attitude solved from the same sky" in found.report()
    assert search_in_time(noisy, 2.3, attitude="known", nside=4, n_skies=20).amplitudes[0, place] < 65.0
    with pytest.raises(ParameterError, match="attitude= is missing"):
        search_in_time(noisy, 2.3)
    with pytest.raises(ParameterError, match="known"):
        search_in_time(noisy, 2.3, attitude="solved")


def test_templates_that_differ_late_are_two():
    """Functions were told apart by what they are within a year of the middle."""
    response = Response(LAW, nside=1, steps=4000)
    early, late = (response.taken(Modes(1), lambda time, when=when: (time > when)[None] * 1.0) for when in (1.5, 2.2))
    assert np.abs(early - late).max() > 1e-3 * np.abs(late).max()


def test_a_factor_of_another_law_is_refused(tmp_path):
    law = sim.NominalScanningLaw(years=1.0)
    Response(law, nside=1, steps=2000).save(tmp_path / "f.npz")
    assert Response.read(tmp_path / "f.npz", law, steps=2000).nside == 1
    other = sim.NominalScanningLaw(years=1.0, precession_phase=1.0)
    for wrong, options in ((other, {}), (law, {"epoch": 2021.0}), (law, {"calibration": Calibration(1)})):
        with pytest.raises(ParameterError, match="another scanning law"):
            Response.read(tmp_path / "f.npz", wrong, steps=2000, **options)


def test_gaps_that_overlap_count_once():
    def scale(gaps):
        law = sim.NominalScanningLaw(years=1.0, gaps=gaps)
        return Response(law, nside=1, steps=2000, calibration="constant to order 1, known to 1 µas")._scale

    assert scale(((0.0, 0.5), (0.1, 0.5))) == pytest.approx(scale(((0.0, 0.5),)))
