"""The nominal scanning law against what is published of it."""

import numpy as np
import pytest

import sim
from sim.scanning import NominalScanningLaw, TabulatedLaw
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.errors import ParameterError

LAW = NominalScanningLaw()
#: Mean counts in five years after 6 % loss, by |sin β| (docs/theory.md).
#: From the Gaia Science Performance table of geometrical factors, which PyGaia 1 carried.
PUBLISHED = {0.025: 61, 0.125: 62, 0.225: 63, 0.325: 66, 0.425: 71, 0.525: 80, 0.575: 87, 0.625: 98, 0.675: 122,
             0.725: 144, 0.775: 106, 0.825: 93, 0.875: 85, 0.925: 80, 0.975: 75}  # fmt: skip


def ecliptic(vectors):
    return rotation_matrix("icrs", "ecliptic") @ vectors


def test_speed_follows_from_the_precessions():
    assert pytest.approx(4.220745, abs=5e-7) == LAW.speed


def test_axis_views_and_sun():
    time = np.linspace(0, 5, 1001)
    z, first, second = LAW.attitude(time)
    sun, distance = LAW.sun(time)
    np.testing.assert_allclose(np.sum(ecliptic(z) * sun, 0), np.cos(np.radians(45)), atol=1e-9)
    np.testing.assert_allclose(np.sum(first * second, 0), np.cos(np.radians(106.5)), atol=1e-9)
    np.testing.assert_allclose(np.sum(first * z, 0), 0, atol=1e-9)
    np.testing.assert_allclose(np.sin(np.radians(45)) * np.sin(LAW._state["nu"](time)), ecliptic(z)[2], atol=1e-9)
    assert 0.98 < distance.min() < distance.max() < 1.02


def test_scan_rate_is_sixty_arcsec_a_second():
    """The turn about z in ten seconds, in inertial space."""
    seconds = 10.0 / (365.25 * 86400)
    time = np.linspace(0.1, 4.9, 500)
    z, before, _ = LAW.attitude(time)
    _, after, _ = LAW.attitude(time + seconds)
    turn = np.arctan2(np.sum(np.cross(before, after, axis=0) * z, 0), np.sum(before * after, 0))
    np.testing.assert_allclose(np.degrees(turn) * 3600 / 10, 60, rtol=1e-5)


def test_sun_is_astropys():
    from astropy.coordinates import get_sun
    from astropy.time import Time

    time = np.linspace(0, 5, 12)
    theirs = get_sun(Time(2014.73 + time, format="jyear", scale="tdb"))
    ours = rotation_matrix("ecliptic", "icrs") @ LAW.sun(time)[0]
    expected = theirs.cartesian.xyz.value / theirs.distance.value
    # The formula is good to 0.01°; aberration, which astropy adds here, is 0.006°.
    np.testing.assert_allclose(ours, expected, atol=np.radians(0.02))
    np.testing.assert_allclose(LAW.sun(time)[1], theirs.distance.value, atol=2e-4)


def test_transits_are_where_the_views_are():
    lon, lat = sim.uniform_sky(200, rng=1)
    transits = LAW.transits(lon, lat)
    z, first, second = LAW.attitude(transits.time)
    view = np.where(transits.view > 0, first, second)
    r = triad(lon, lat)[2][:, transits.source]
    along = np.sum(np.cross(z, view, axis=0) * r, 0)
    # The phase in a spin is interpolated: 5 arcsec at 60 arcsec/s are a tenth of a second.
    assert np.degrees(np.abs(along)).max() * 3600 < 10
    np.testing.assert_allclose(np.sin(transits.across), np.sum(z * r, 0), atol=1e-9)
    assert np.degrees(np.abs(transits.across)).max() < 0.342


@pytest.mark.parametrize("law", [
    LAW,
    NominalScanningLaw(years=0.01),
    NominalScanningLaw(spin_rate=6.0, half_height=np.radians(3.42), years=2),
    NominalScanningLaw(pole_days=28, years=0.5, dead_time=0.1, rng=1, frame="ecliptic"),
], ids=["nominal", "days", "long spins", "poles and gaps"])  # fmt: skip
def test_compiled_loop_finds_the_same(law):
    pytest.importorskip("numba")
    lon, lat = sim.uniform_sky(400, rng=4)
    lat[:2] = np.pi / 2, -np.pi / 2
    plain, compiled = (law.transits_of_block(lon, lat, compiled=each) for each in (False, True))
    assert len(plain) > 0
    for name in ("source", "view"):
        np.testing.assert_array_equal(getattr(compiled, name), getattr(plain, name))
    for name in ("time", "angle", "parallax_factor", "across"):
        np.testing.assert_allclose(getattr(compiled, name), getattr(plain, name), atol=1e-12, rtol=0)


def test_many_sources_take_the_compiled_loop(monkeypatch):
    pytest.importorskip("numba")
    law = NominalScanningLaw(years=0.2)
    lon, lat = sim.uniform_sky(1200, rng=4)
    plain = law.transits(lon, lat)
    from sim.scanning import _compiled

    used, loop = [], _compiled.find_crossings
    monkeypatch.setattr("sim.scanning._nominal._COMPILED_FROM", 1000)
    monkeypatch.setattr(_compiled, "find_crossings", lambda r, *more: used.append(len(r)) or loop(r, *more))
    again = law.transits(lon, lat, threads=1)
    assert used == [1000, 200]
    np.testing.assert_allclose(again.time, plain.time, atol=1e-14)


def passes(attitude, r, half_height):
    """How often a place crosses the fields of view, looked at on a fine grid of time."""
    z, *views = attitude
    count = 0
    for view in views:
        along = np.sum(np.cross(z, view, axis=0).T * r, 1)
        crossing = np.flatnonzero((along[:-1] > 0) != (along[1:] > 0))
        crossing = crossing[view.T[crossing] @ r > 0]
        count += np.sum(np.abs(np.arcsin(r @ z[:, crossing])) < half_height)
    return count


def test_no_transit_is_missed():
    """Step through 20 days by the attitude alone, a second look at one source on the scan."""
    lon, lat = sim.uniform_sky(30, rng=2)
    transits, r = LAW.transits(lon, lat), triad(lon, lat)[2]
    time = np.arange(0, 20 / 365.25, 15 / (365.25 * 86400))
    attitude = LAW.attitude(time)
    for k in range(30):
        found = np.sum((transits.source == k) & (transits.time < time[-1]))
        assert passes(attitude, r[:, k], np.radians(0.342)) == found


def test_scan_angle_and_parallax_factor():
    """By differences: the way the field moves over the sky, and the shift of a near source."""
    lon, lat = np.array([0.3, 2.0, 5.0]), np.array([-1.2, 0.1, 0.8])
    transits = LAW.transits(lon, lat)
    seconds = 1.0 / (365.25 * 86400)
    p, q, _ = (v[:, transits.source] for v in triad(lon, lat))
    z = LAW.attitude(transits.time)[0]
    later, now = LAW.attitude(transits.time + seconds), LAW.attitude(transits.time - seconds)
    moved = np.where(transits.view > 0, later[1] - now[1], later[2] - now[2])
    angle = np.arctan2(np.sum(moved * p, 0), np.sum(moved * q, 0))
    # Off the middle of the field the scan's direction differs by the height's square.
    np.testing.assert_allclose(np.angle(np.exp(1j * (angle - transits.angle))), 0, atol=2e-2)
    sun, distance = LAW.sun(transits.time)
    gaia = -1.01 * distance * (rotation_matrix("ecliptic", "icrs") @ sun)
    scan = np.cross(z, triad(lon, lat)[2][:, transits.source], axis=0)
    np.testing.assert_allclose(transits.parallax_factor, -np.sum(gaia * scan, 0), atol=1e-4)


def test_pairs_of_transits_are_the_basic_angle_apart():
    """A source met by the preceding field comes to the following one 106.5 minutes later."""
    lon, lat = sim.uniform_sky(500, rng=3)
    transits = LAW.transits(lon, lat)
    pair = (np.diff(transits.source) == 0) & (transits.view[:-1] > 0) & (transits.view[1:] < 0)
    gap = np.diff(transits.time)[pair] * 365.25 * 1440
    gap = gap[gap < 200]
    assert len(gap) > 5000
    assert np.median(gap) == pytest.approx(106.5, abs=0.3)


@pytest.mark.slow
def test_counts_are_the_published_ones():
    law = NominalScanningLaw(dead_time=0.06, rng=1)
    n = 200_000
    lon, lat = sim.uniform_sky(n, rng=1)
    counts = law.transits(lon, lat).counts(n)
    sine = np.abs(ecliptic(triad(lon, lat)[2])[2])
    for middle, mean in PUBLISHED.items():
        here = np.abs(sine - middle) < 0.025
        assert counts[here].mean() == pytest.approx(mean, rel=0.03)
    assert 86 < LAW.transits(lon[:20_000], lat[:20_000]).counts(20_000).mean() < 89


def test_dead_time_is_lost():
    lon, lat = sim.uniform_sky(2000, rng=1)
    lossy = NominalScanningLaw(dead_time=0.2, rng=5)
    assert len(lossy.transits(lon, lat)) / len(LAW.transits(lon, lat)) == pytest.approx(0.8, abs=0.02)
    starts, ends = lossy.lost.T
    assert (ends - starts).sum() == pytest.approx(5 * 0.2)
    assert (starts[1:] >= ends[:-1]).all()
    with pytest.raises(ValueError, match="needs rng"):
        NominalScanningLaw(dead_time=0.1)


def test_given_gaps_are_lost_too():
    lon, lat = sim.uniform_sky(500, rng=1)
    time = NominalScanningLaw(gaps=((2.0, 3.0), (0.0, 0.5), (2.1, 2.2))).transits(lon, lat).time
    whole = LAW.transits(lon, lat).time
    kept = (whole >= 0.5) & ((whole < 2.0) | (whole >= 3.0))
    np.testing.assert_array_equal(time, whole[kept])
    with pytest.raises(ValueError, match="a start and a later end"):
        NominalScanningLaw(gaps=((2.0, 1.0),))


def test_fields_pass_when_spins_are_long():
    """A mission scaled to fewer sources turns slowly; its axis moves ten degrees in a spin."""
    law = NominalScanningLaw(spin_rate=6.0, half_height=np.radians(3.42))
    lon, lat = sim.uniform_sky(300, rng=1)
    found = law.transits(lon, lat)
    z, first, second = law.attitude(found.time)
    here = triad(lon, lat)[2][:, found.source]
    view = np.where(found.view > 0, first, second)
    assert np.abs(np.sum(np.cross(z, view, axis=0) * here, 0)).max() < 1e-9
    assert np.abs(np.sum(z * here, 0)).max() <= np.sin(law.half_height)
    time = np.arange(0.1, 4.9, 600 / (365.25 * 86400))
    attitude = law.attitude(time)
    for k in range(5):  # none is missed
        mine = found.time[found.source == k]
        crossed = passes(attitude, triad(lon[k], lat[k])[2], law.half_height)
        assert np.sum((mine > 0.1) & (mine < 4.9)) == pytest.approx(crossed, abs=1)
    with pytest.raises(ValueError, match="at least 0 and below 1"):
        NominalScanningLaw(dead_time=1.5, rng=1)


def test_first_month_looks_at_the_ecliptic_poles():
    law = NominalScanningLaw(pole_days=28, years=0.5)
    pole = rotation_matrix("ecliptic", "icrs") @ [[0], [0], [1.0]]
    lat, lon = np.arcsin(pole[2]), np.arctan2(pole[1], pole[0])
    times = law.transits(lon, lat).time * 365.25
    # Two fields, four spins a day.
    assert np.sum(times < 28) == pytest.approx(28 * 8, abs=10)


def test_phases_turn_the_pattern():
    lon, lat = sim.uniform_sky(500, rng=1)
    other = NominalScanningLaw(precession_phase=1.0, spin_phase=2.0)
    assert not np.array_equal(other.transits(lon, lat).counts(500), LAW.transits(lon, lat).counts(500))


def test_threads_change_nothing():
    lon, lat = sim.uniform_sky(3000, rng=1)
    one, four = (LAW.transits(lon, lat, threads=threads) for threads in (1, 4))
    for name in ("source", "time", "angle", "parallax_factor", "view", "across"):
        np.testing.assert_array_equal(getattr(one, name), getattr(four, name))
    assert (np.diff(one.source) >= 0).all()


@pytest.mark.parametrize("law", [
    {"years": 1.0}, {"years": 0.01}, {"years": 0.3, "half_height": 0.05}, {"years": 0.5, "spin_rate": 7.0},
    {"years": 0.4, "precessions": 20.0},
])  # fmt: skip
def test_eight_spins_at_a_time_miss_none(law):
    """Pairs of a source and a spin are those of a look at every spin of every source."""
    law = NominalScanningLaw(**law)
    lon, lat = sim.uniform_sky(300, 1)
    r = triad(lon, lat)[2]
    spins = law._state["spins"]
    z = spins.z
    height = r.T @ z
    for wide in (0.001, 0.006, 0.1):
        low, high = height < wide, height > -wide
        pairs = set(zip(*np.nonzero((low[:, :-1] | low[:, 1:]) & (high[:, :-1] | high[:, 1:])), strict=True))
        source, spin, h0, h1 = spins._find_near_sources(r, wide)
        assert set(zip(source, spin, strict=True)) == pairs
        np.testing.assert_allclose(h0, height[source, spin], atol=1e-15)
        np.testing.assert_allclose(h1, height[source, spin + 1], atol=1e-15)


@pytest.mark.parametrize("time", [[0.0], [0.0, 2.0, 1.0], [0.0, 0.0, 1.0]])
def test_times_of_a_tabulated_law_rise(time):
    view = np.zeros((2, len(time)))
    with pytest.raises(ParameterError, match="rise"):
        TabulatedLaw(time, view, view + 1.0)
