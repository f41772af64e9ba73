"""Chains of catalogues: frames that are put in, common noise, differences that close."""

import re
from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from conftest import few_or_many, real_catalogue
from scipy.stats import kstest

import sim
from fit.background import shared
from fit.commands.compare import main
from fit.frames.chain import combine_frames
from fit.frames.compare import compare_catalogues
from fit.normal import normal_equations
from vsh import DegeneracyError, Field, FieldError, FrameError, Modes, ParameterError
from vsh.conventions import to_icrf3_terms
from vsh.io.catalogue import read_icrf
from vsh.models.covariance import Spectrum

SPINS = {"a": (0.0, 0.0, 0.0), "b": (10.0, -20.0, 5.0), "c": (-15.0, 0.0, 30.0)}


def catalogues(seed, shared=0.0, n=300, frames=SPINS, names=None):
    """Catalogues of one sky, each with its own rotation; a part of the noise in all of them."""
    rng = np.random.default_rng([7, seed])
    lon, lat = sim.uniform_sky(n, rng)
    true = rng.normal(size=(2, n)) * 500
    common = rng.normal(size=(2, n))
    out = {}
    for label, spin in frames.items():
        sigma = rng.uniform(20, 80, (2, n))
        noise = np.sqrt(shared) * common + np.sqrt(1 - shared) * rng.normal(size=(2, n))
        motion = true + sigma * noise + sim.spin(spin)(lon, lat)
        out[label] = Field(lon, lat, motion, sigma, name=np.arange(n) if names is None else names)
    return out


def test_frames_come_back_and_close():
    listed = catalogues(1, 0.4)
    rng = np.random.default_rng(2)
    listed["c"] = listed["c"][np.sort(rng.choice(300, 220, replace=False))]  # some are in two alone
    chain = combine_frames(listed, 2, clip=False)
    for label, spin in SPINS.items():
        if label != "a":
            vector = chain.difference(label).spin
            assert np.abs((vector.value - spin) / vector.sigma).max() < 4
    one, two, both = chain.difference("b"), chain.difference("c", "b"), chain.difference("c")
    np.testing.assert_allclose(one.values + two.values, both.values, atol=1e-12)
    assert chain.common.tolist() == [[300, 300, 220], [300, 300, 220], [220, 220, 220]]
    assert np.abs(chain.correlation[np.triu_indices(3, 1)] - 0.4).max() < 0.15
    assert chain.p_value("b") < 1e-3
    assert chain.p_value("b", beyond=1) > 0.001


def test_two_independent_ones_are_a_comparison():
    listed = catalogues(3)
    chain = combine_frames({"b": listed["b"], "a": listed["a"]}, 2, shared_noise=False, clip=False)
    pair = compare_catalogues(listed["a"], listed["b"], 2, threshold=50.0)[0].by_class
    np.testing.assert_allclose(chain.values[0], pair.values, atol=1e-3)
    np.testing.assert_allclose(chain.covariance, pair.covariance, rtol=1e-3, atol=1e-3)


def sharing(rng, n, share_at):
    """Three catalogues of noise of n sources, of whose variance a share, at each error, is in all of them."""
    lon, lat = sim.uniform_sky(n, rng)
    sigma, name = 10 ** rng.uniform(0.8, 2.0, n), np.arange(n)
    share = share_at(sigma)
    common = np.sqrt(share) * sigma * rng.normal(size=(2, n))
    motions = {label: common + np.sqrt(1 - share) * sigma * rng.normal(size=(2, n)) for label in "abc"}
    return {label: Field(lon, lat, motion, [sigma, sigma], name=name) for label, motion in motions.items()}


@few_or_many(15, 100, "n_skies")
def test_noise_that_the_faint_share_alone_detects_nothing(n_skies):
    """One ρ for all sources took the errors of the bright for too small: p < 0.0027 on 18 % of rotations and glides."""
    p = []
    for seed in range(n_skies):
        fields = sharing(np.random.default_rng([7, seed]), 300, lambda sigma: np.where(sigma < 25, 0.0, 0.95))
        chain = combine_frames(fields, 2, floor=False)
        for solution in (chain.difference("b"), chain.difference("c", "b")):
            p += [solution.spin.p_value, solution.acceleration.p_value]
    assert np.mean(np.array(p) < 0.05) < 0.05 + 3 * np.sqrt(0.05 / (len(p) / 2))
    assert np.mean(np.array(p) < 0.0027) < 0.04


@few_or_many(20, 200, "n_skies")
@pytest.mark.parametrize(
    "shared", [pytest.param(0.0, marks=pytest.mark.slow), 0.5, pytest.param(0.9, marks=pytest.mark.slow)]
)
def test_p_values_of_noise_that_is_shared(shared, n_skies):
    p = []
    for seed in range(n_skies):
        chain = combine_frames(catalogues(seed, shared, 200, dict.fromkeys("abc", (0.0, 0.0, 0.0))), 2)
        p += [chain.p_value("b"), chain.p_value("c", "b", beyond=1)]
    assert kstest(p[::2], "uniform").pvalue > 0.01
    assert kstest(p[1::2], "uniform").pvalue > 0.01


def test_outliers_are_left_out():
    listed = catalogues(5)
    listed["b"].motion.setflags(write=True)
    listed["b"].motion[:, 17] += 5000
    chain = combine_frames(listed, 1)
    assert chain.names[0] == "17"
    assert len(chain.names) <= 3  # half a source is left out of a catalogue that has no outliers
    assert chain.distances[0] > 30
    assert "sources excluded; largest deviations (in standard errors): 17" in chain.report()


def test_short_report_has_rotation_and_glide_alone():
    chain = combine_frames(catalogues(5), 2)
    terms = {long: re.findall(r"^  ([RDEM]\S*) ", chain.report(long=long), re.MULTILINE) for long in (False, True)}
    assert terms[False] == ["R1", "R2", "R3", "D1", "D2", "D3"]
    assert len(terms[True]) == 16


def test_table_of_degree_four():
    chain = combine_frames(catalogues(6), Modes(4), clip=False)
    assert chain.values.shape == (2, 48)
    assert "a and b        300 sources in common" in chain.report()
    assert "Differences of motion of 3 catalogues" in chain.report()
    table = chain.to_table()
    assert len(table) == 3 * 48
    last = table[-48:]
    assert (last["catalogue"][0], last["less"][0]) == ("c", "b")
    solution = chain.difference("c", "b")
    np.testing.assert_array_equal(last["value"], solution.values)
    np.testing.assert_array_equal(last["sigma"], solution.sigma)


def test_three_icrf_like_catalogues():
    """ICRF2 and ICRF3 share most of their noise, and their rotation is that of the comparison of two."""
    one, two = (read_icrf(real_catalogue(name)) for name in ("icrf3sx.txt", "icrf2-all.txt"))
    chain = combine_frames({"icrf3": one, "icrf2": two}, 2)
    plain, _ = compare_catalogues(two, one, 2)
    with_floor = combine_frames({"icrf3": one, "icrf2": two}, 1, floor=True)
    assert {vector.unit for each in (chain, with_floor) for vector in each.vectors().values()} == {"µas"}
    assert "µas/yr" not in with_floor.verdict
    rotation = chain.difference("icrf2").spin
    assert np.abs((rotation.value - plain.solution.spin.value) / plain.solution.spin.sigma).max() < 1.5
    assert 0.02 < chain.correlation[0, 1] < 0.995
    assert len(chain.names) > 10


def bent(seed, power, n=300):
    """Catalogues with one frame, each with a field of its own to degree 10 beside its noise, half of it shared."""
    listed = catalogues(seed, 0.5, n, dict.fromkeys("abc", (0.0, 0.0, 0.0)))
    rng = np.random.default_rng([9, seed])
    return {
        label: replace(each, motion=each.motion + sim.systematics(power**2 * Spectrum.flat(), rng)(each.lon, each.lat))
        for label, each in listed.items()
    }


@pytest.mark.slow
@few_or_many(4, 200)
@pytest.mark.parametrize("power", [0.0, 20.0])
def test_frames_with_what_sources_share_over_the_sky(power, n_skies):
    p, plain = [], []
    for seed in range(n_skies):
        chain = combine_frames(bent(seed, power), 1, floor=True)
        p += [chain.shared.p_value(kind, 1, 0) for kind in "TS"]
        plain.append(chain.p_value("c", "b"))
    scatter = np.sqrt(0.05 * 0.95 / len(p))
    assert np.mean(np.array(p) < 0.05) < 0.06 + 2 * scatter
    if power:
        assert np.mean(np.array(plain) < 0.05) > 0.2


@pytest.mark.parametrize("power", [0.0, 20.0])
def test_two_catalogues_have_the_floor_of_their_difference(power):
    """Of one class alone the matrix may stand in any order of memory, and is what `shared` makes of it."""
    a, b = (bent(3, power)[label][:250] for label in "ab")  # too few for classes of quoted errors
    chain = combine_frames({"a": a, "b": b}, 1, floor=True, shared_noise=False, clip=False)
    sigma = np.hypot(a.sigma, b.sigma)
    rho = (a.rho * a.sigma.prod(0) + b.rho * b.sigma.prod(0)) / sigma.prod(0)
    alone = shared([normal_equations(Field(a.lon, a.lat, b.motion - a.motion, sigma, rho), 5)], labels=["b"], rng=1)
    np.testing.assert_allclose(chain.frames("b").values, alone.combination([1.0]).values, rtol=1e-4)
    np.testing.assert_allclose(chain.frames("b").sigma, alone.combination([1.0]).sigma, rtol=1e-4)
    assert min(chain.shared.effective) > 100


def test_frames_close_with_what_sources_share():
    chain = combine_frames(bent(3, 8.0), 2, floor=True, rng=2)
    one, two, both = chain.frames("b"), chain.frames("c", "b"), chain.frames("c")
    last = chain.to_table()[-len(chain.modes) :]
    of_frame = chain.modes.degrees == 1
    np.testing.assert_array_equal(last["value_floor"][of_frame], two.values)
    np.testing.assert_array_equal(last["sigma_floor"][of_frame], two.sigma)
    assert np.isnan(last["sigma_floor"][~of_frame]).all()
    np.testing.assert_allclose(one.values + two.values, both.values, atol=1e-10)
    bars = chain.plot().containers[0].lines[2][0].get_segments()
    half = [np.ptp(bar[:, 1]) / 2 for bar in bars]
    names = list(to_icrf3_terms(one.coefficients, one.sigma))
    np.testing.assert_allclose(half[: len(names)], [to_icrf3_terms(one.coefficients, one.sigma)[k][1] for k in names])
    np.testing.assert_allclose(chain.frames("a", "b").values, -one.values, atol=1e-12)
    # Errors are larger than those without, and the report has one of the two, as the pairs have.
    assert (one.sigma > chain.difference("b").sigma[[0, 1, 2, 8, 9, 10]]).all()
    assert "the systematic floor in rotation and glide, from degrees 2 to 5" in chain.report()
    assert "frames agree" not in chain.report()  # which knows one scale of the errors for all sources: pairs say it
    assert combine_frames(bent(3, 8.0), 2).shared is None
    with pytest.raises(ParameterError, match="floor=True"):
        combine_frames(bent(3, 8.0), 2).frames("b")


def test_messages():
    listed = catalogues(1)
    with pytest.raises(ParameterError, match="two catalogues at least"):
        combine_frames({"a": listed["a"]})
    with pytest.raises(FrameError, match="in different frames .galactic, icrs"):
        combine_frames({"a": listed["a"], "b": listed["b"].to_frame("galactic")})
    bare = Field(listed["b"].lon, listed["b"].lat, listed["b"].motion, listed["b"].sigma)
    with pytest.raises(FieldError, match="b has no names"):
        combine_frames({"a": listed["a"], "b": bare})
    twice = catalogues(1, names=np.arange(300) // 2)
    with pytest.raises(FieldError, match="150 names stand twice in a"):
        combine_frames(twice)
    with pytest.raises(DegeneracyError, match="do not determine all frames of a, b"):
        combine_frames({"a": listed["a"][:2], "b": listed["b"][:2]})
    with pytest.raises(ParameterError, match="no catalogue is called 'd': a, b, c"):
        combine_frames(listed, 1).difference("d")


def test_catalogues_that_are_matched_by_position_are_combined_too(tmp_path, capsys):
    """Gaia and the ICRF have no common names: nothing was combined, in silence."""
    quasars = sim.quasars(200, 1)
    for label, spin in (("b", (0, 0, 0)), ("c", (0, 0, 60))):
        field = sim.observe(quasars, sim.spin(spin), len(label) + spin[2], sigma=50.0)
        replace(field, name=np.array([f"{label}{i}" for i in range(200)])).write(tmp_path / f"{label}.fits")
    sim.observe(quasars, sim.spin((0, 0, 0)), 9, sigma=50.0).write(tmp_path / "a.fits")
    paths = [str(tmp_path / f"{label}.fits") for label in "abc"]
    assert main([*paths, "--match", "1", "--lmax", "1", "--output", str(tmp_path / "o"), "--format", "none"]) == 0
    assert "3 catalogues in one solution" in capsys.readouterr().out
    assert (tmp_path / "o" / "chain.ecsv").exists()


def test_noise_of_few_common_sources_is_that_of_all_of_them():
    """Classes with fewer than ten of a pair had no correlation: 0.26 for 0.9."""
    fields = sharing(np.random.default_rng(3), 600, lambda sigma: 0.9)
    chain = combine_frames(fields | {"c": fields["c"][:40]}, 1, floor=False)
    assert chain.correlation[0, 2] > 0.75
    assert chain.difference("c").spin.sigma.max() < 2.5


def test_few_sources_make_no_errors_smaller():
    p = []
    for seed in range(25):
        rng = np.random.default_rng([11, seed])
        lon, lat = sim.uniform_sky(4, rng)
        name = np.arange(4)
        fields = {x: Field(lon, lat, rng.normal(size=(2, 4)), np.ones((2, 4)), name=name) for x in "abc"}
        with suppress(DegeneracyError):
            difference = combine_frames(fields, 1, floor=False).difference("b")
            p += [difference.spin.p_value, difference.acceleration.p_value]
    assert len(p) > 20
    assert np.mean(np.array(p) < 0.0027) < 0.05


def test_a_catalogue_that_stands_twice_makes_no_errors_smaller():
    fields = catalogues(1, frames={"a": SPINS["a"], "b": SPINS["b"]})
    twice = combine_frames(fields | {"c": fields["b"]}, 1, floor=False)
    assert any("300 of 300 sources have the same values in b and c" in note for note in twice.notes)
    once = combine_frames(fields, 1, floor=False)
    assert not any("same values" in note for note in once.notes)
    for both in zip(*(chain.difference("b").spin.sigma for chain in (twice, once)), strict=True):
        assert both[0] > 0.95 * both[1]
