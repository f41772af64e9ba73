"""From observations to a field: starts, stopping, checkpoints, frames, global motions."""

import dataclasses
import textwrap

import numpy as np
import pytest
from conftest import POSIX, run_python

import fit
import sim
from sim import agis
from vsh import Modes
from vsh.tools.errors import CheckpointError, ParameterError, VshWarning

LAW = sim.NominalScanningLaw(years=2.0)


@pytest.fixture(scope="module")
def system():
    quasars = sim.quasars(300, 1)
    return agis.System(agis.scans(LAW, quasars.lon, quasars.lat, 100.0, 500.0, knots=86400.0))


@pytest.fixture(scope="module")
def observed(system):
    return agis.observations(system.scans, 2)


def test_sources_first_forgets_the_start(system, observed):
    """With an attitude of 10 µas, errors of 100 mas are gone after the first update."""
    start, attitude = agis.start_errors(system.scans, 3)
    silent = np.zeros((2, len(system.scans)))
    sizes = {}
    for first in ("sources", "attitude"):
        seen = []
        system.solve(*silent, start=start, attitude=attitude, first=first, iterations=12, stop=None, watch=lambda i, x, seen=seen: seen.append(np.abs(system.without_null_space(x[..., None])[0]).max()))  # fmt: skip
        sizes[first] = seen
    assert sizes["sources"][0] < 100
    assert sizes["attitude"][0] > 1e5


def test_rule_stops_near_the_end(system, observed):
    found = system.solve(*observed)
    last = system.solve(*observed, stop=None, iterations=2000)
    assert found.converged
    assert found.iterations == len(found.history) < last.iterations
    away = np.abs(found.history[-1] - last.history[-1]) / np.sqrt(np.diag(found.formal_low))
    assert away.max() < 0.05
    moved = np.ptp(found.history[-11:], axis=0) / np.sqrt(np.diag(found.formal_low))
    assert moved.max() < 0.05
    assert (np.ptp(found.history[-12:-1], axis=0) / np.sqrt(np.diag(found.formal_low))).max() >= 0.05


def test_run_that_is_not_at_rest_says_so(system, observed):
    with pytest.warns(VshWarning, match="not converged after 3 iterations"):
        found = system.solve(*observed, iterations=3)
    assert not found.converged
    assert any("had not come to rest" in note for note in found.field().notes)


def test_fields_hold_truth_and_formal_errors(system, observed):
    found = system.solve(*observed)
    truth = sim.acceleration((5.0, 0.0, 0.0))
    field = found.field(truth, magnitude=np.arange(300.0))
    np.testing.assert_allclose(field.motion, found.sources[:, 3:].T + truth(field.lon, field.lat, None), atol=1e-12)
    np.testing.assert_allclose(field.sigma**2, np.einsum("nii->ni", found.formal)[:, 3:].T)
    np.testing.assert_array_equal(field.magnitude, np.arange(300.0))
    few = found.field(sources=[3, 5], kind="position")
    np.testing.assert_array_equal(few.motion, found.sources[[3, 5], :2].T)
    assert fit.fit_field(field, 1).acceleration.value.shape == (3,)
    with pytest.raises(ParameterError, match="sources are indices or a mask of 300"):
        found.field(sources=[300])
    with pytest.raises(ParameterError, match="kind must be one of"):
        found.field(kind="parallax")


def test_rotated_takes_a_rotation_away(system, observed):
    found = system.solve(*observed)
    turn = np.array([1.0, -2.0, 3.0, 0.5, 0.2, -0.4])
    turned = dataclasses.replace(found, sources=found.sources + np.einsum("k,kni->ni", turn, system.null_space()))
    back = turned.rotated(turn[:3], turn[3:])
    np.testing.assert_allclose(back.sources, found.sources, atol=1e-5)


def test_killed_and_resumed_is_the_same_to_the_last_bit(tmp_path, system, observed):
    whole = system.solve(*observed)
    path = tmp_path / "checkpoint.npz"

    class Killed(Exception):
        pass

    def kill(iteration, _):
        if iteration == whole.iterations - 3:
            raise Killed

    with pytest.raises(Killed):
        system.solve(*observed, checkpoint=path, watch=kill)
    steps = []
    resumed = system.solve(*observed, checkpoint=path, watch=lambda i, _: steps.append(i))
    assert steps[0] == (whole.iterations - 3) // 5 * 5 > 1  # where the file was, not at the start
    for name in ("sources", "attitude", "history", "updates"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
    with pytest.raises(CheckpointError, match="belongs to another solution"):
        system.solve(2 * observed[0], observed[1], checkpoint=path)
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(CheckpointError, match="is damaged"):
        system.solve(*observed, checkpoint=path)


@POSIX
@pytest.mark.slow
def test_killed_by_the_system_too(tmp_path):
    """A process killed in its iterations; another goes on, and ends in the bytes of one that was not."""
    script = textwrap.dedent("""
        import os, signal, sys
        import numpy as np
        import sim
        from sim import agis
        quasars = sim.quasars(200, 1)
        law = sim.NominalScanningLaw(years=2.0)
        system = agis.System(agis.scans(law, quasars.lon, quasars.lat, 100.0, 500.0, knots=86400.0))
        kill = int(sys.argv[2])
        def watch(i, _):
            if i == kill:
                os.kill(os.getpid(), signal.SIGKILL)
        found = system.solve(*agis.observations(system.scans, 1), checkpoint=sys.argv[1], watch=watch)
        print(found.sources.tobytes().hex()[:4000], found.iterations)
    """)
    whole = run_python("-c", script, tmp_path / "a.npz", -1)
    run_python("-c", script, tmp_path / "b.npz", 13, status=-9)
    assert (tmp_path / "b.npz").exists()
    assert run_python("-c", script, tmp_path / "b.npz", -1).stdout == whole.stdout


def test_known_attitudes_pull_to_what_is_known(system):
    quasars = sim.quasars(300, 1)
    tight = agis.System(system.scans, prior=0.01)
    known = 100.0 * np.random.default_rng(1).standard_normal((tight.coefficients, 3))
    found = tight.solve(*np.zeros((2, len(system.scans))), known=known, stop=None)
    np.testing.assert_allclose(found.attitude, known, atol=1.0)
    with pytest.raises(ParameterError, match="give System a prior"):
        system.solve(*np.zeros((2, len(system.scans))), known=known)
    assert tight.true_covariance(1, quasars.lon, quasars.lat) == pytest.approx(
        tight.formal_covariance(1), rel=1e-3, abs=1e-6
    )


def test_sources_are_told_by_their_positions(system):
    some = slice(100, 200)
    lon, lat = system.scans.lon, system.scans.lat
    few = system.formal_covariance(1, lon[some], lat[some])
    assert (np.diag(few) > np.diag(system.formal_covariance(1))).all()
    with pytest.raises(ParameterError, match="1 of 2 positions are of no source"):
        system.formal_covariance(1, [lon[0], 0.1], [lat[0], 0.1])


@pytest.mark.slow
def test_observe_with_a_solved_attitude():
    """The whole chain: scaled to half a million, errors larger than quoted, the same for the same seed."""
    quasars = sim.quasars(800, 1)
    field = sim.observe(quasars, sim.acceleration((5.0, 0.0, 0.0)), 2, attitude="solved")
    assert any("mission scaled to 800 sources" in note for note in field.notes)
    assert fit.fit_field(field, 1).chi2 / (2 * 800) > 1.1
    again = sim.observe(quasars, sim.acceleration((5.0, 0.0, 0.0)), 2, attitude="solved", threads=1)
    np.testing.assert_array_equal(again.motion, field.motion)
    offsets = sim.observe_offsets(sim.vlbi_quasars(quasars, 200, 1), sim.spin((0, 0, 0)), 3, sim.Mission(sim.NominalScanningLaw(), "DR4", "solved"))  # fmt: skip
    assert len(offsets) == 200
    with pytest.raises(ParameterError, match="quote_variability is for an attitude in µas"):
        sim.observe(quasars, sim.spin((0, 0, 0)), 2, attitude="solved", quote_variability=True)
    with pytest.raises(ParameterError, match="attitude must be one of 'solved'"):
        sim.observe(quasars, sim.spin((0, 0, 0)), 2, attitude="perfect")
    with pytest.raises(ParameterError, match="errors of different sources are correlated"):
        sim.expected_covariances(quasars, sim.Mission(sim.NominalScanningLaw(), "DR4", "solved"))


def test_number_as_attitude_is_that_of_the_mission():
    quasars = sim.quasars(50, 1)
    mission = sim.Mission(sim.NominalScanningLaw(years=1.0), "DR4", 300.0)
    wanted = sim.observe(quasars, sim.spin((0, 0, 0)), 2, mission=mission)
    found = sim.observe(
        quasars, sim.spin((0, 0, 0)), 2, mission=sim.Mission(mission.scanning_law, "DR4"), attitude=300.0
    )
    np.testing.assert_array_equal(found.motion, wanted.motion)


def test_mixtures_hold_each_kind():
    mission = sim.Mission(sim.NominalScanningLaw(years=1.0))
    found = agis.mixture(mission, sim.quasars(5, 1), sim.galaxies(4, 2), sim.stars(3, 3), star_error=77.0)
    assert [int(found.are(kind).sum()) for kind in agis.KINDS] == [5, 4, 3]
    np.testing.assert_array_equal(found.sigma[found.are("stars")], 77.0)
    assert np.isfinite(found.redshift[found.are("galaxies")]).all()
    with pytest.raises(ParameterError, match="the quasars have none"):
        agis.mixture(mission, sim.Population(np.zeros(2), np.zeros(2)))


def test_star_counts_are_the_published_ones():
    stars = sim.stars(200_000, 1, min_magnitude=10.0)
    for magnitude, count in ((15.0, 26.0), (18.0, 250.0)):
        share = (count - 0.34) / (1000 - 0.34)
        assert np.mean(stars.magnitude < magnitude) == pytest.approx(share, rel=0.05)
    with pytest.raises(ParameterError, match="rise between 10 and 20"):
        sim.stars(10, 1, min_magnitude=5.0)


def test_observations_are_noise_of_their_size(system):
    along, across = agis.observations(system.scans, 1)
    assert along.std() == pytest.approx(100, rel=0.03)
    assert across.std() == pytest.approx(500, rel=0.03)
    varying = agis.observations(system.scans, 1, variability=sim.Variability(300.0, 1.0), variable=np.arange(300) < 150)
    still = system.scans.source >= 150
    np.testing.assert_array_equal(varying[0][still], along[still])
    assert (varying[0] - along)[~still].std() == pytest.approx(300, rel=0.15)


@pytest.mark.slow
def test_variability_adds_what_it_scatters(system):
    """The exact covariance with photocentres that vary, against 300 draws."""
    from sim.agis import MotionFit

    variability = sim.Variability(300.0, 1.0)
    exact = system.true_covariance(1, variability=variability, tolerance=1e-6)
    fitted = MotionFit(system, Modes(1), np.arange(300))
    draws = []
    for seed in range(300):
        observed = agis.observations(system.scans, [1, seed], variability=variability)
        found = agis.in_own_frame(system, system.solve(*observed, stop=1e-3))
        draws.append(fitted.compute_coefficients(found.sources[..., None])[:, 0])
    np.testing.assert_allclose(np.mean(np.square(draws), 0), np.diag(exact), rtol=0.3)
    assert np.mean(np.mean(np.square(draws), 0) / np.diag(exact)) == pytest.approx(1, abs=0.1)
