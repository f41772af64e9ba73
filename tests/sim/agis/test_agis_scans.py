"""Transits in the order of time: against the scanning law, in memory and on disk."""

import mmap
import sys

import numpy as np
import pytest

import sim
from sim.agis import System, observations, plan, scans
from vsh.sky.frames import rotation_matrix
from vsh.sky.sphere import triad
from vsh.tools.errors import DegeneracyError, ParameterError, VshWarning

LAW = sim.NominalScanningLaw(years=1.0)
QUASARS = sim.quasars(300, 1)
SECONDS = 365.25 * 86400


def make(knots=86400.0, law=LAW, quasars=QUASARS, along=100.0, across=500.0, **options):
    return scans(law, quasars.lon, quasars.lat, along, across, knots=knots, **options)


def test_they_are_the_transits_of_the_law_in_the_order_of_time():
    found, wanted = make(), LAW.transits(QUASARS.lon, QUASARS.lat)
    order = np.argsort(wanted.time, kind="stable")
    np.testing.assert_allclose(found.time(), wanted.time[order], atol=1e-9)
    assert (np.diff(found.time()) > -1e-9).all()
    np.testing.assert_array_equal(found.source, wanted.source[order])
    np.testing.assert_allclose(found.sin, np.sin(wanted.angle[order]), atol=1e-7)
    np.testing.assert_allclose(found.along_factor, wanted.parallax_factor[order], atol=1e-7)
    np.testing.assert_array_equal(found.counts, wanted.counts(300))
    assert found.knot.max() < found.intervals == 366


def test_parallax_factors_are_the_barycentre_seen_along_and_across():
    """Both components of a parallax: their squares are the Sun's distance from the source, in astronomical units."""
    found = make()
    size = np.hypot(found.along_factor, found.across_factor)
    sun, distance = LAW.sun(found.time())
    here = triad(QUASARS.lon, QUASARS.lat)[2][:, found.source]
    elongation = np.arccos(np.sum(rotation_matrix("ecliptic", "icrs") @ sun * here, 0))
    np.testing.assert_allclose(size, 1.01 * distance * np.sin(elongation), atol=1e-5)


def test_nine_ccds_weigh_as_much_as_a_transit():
    one, nine = make(), make(ccds=9)
    assert len(nine) == 9 * len(one)
    wanted = System(one).formal_covariance(1)  # but for what lies within 20 s of a gap or an end
    np.testing.assert_allclose(System(nine).formal_covariance(1), wanted, rtol=0, atol=3e-3 * np.diag(wanted).max())
    spread = np.ptp(np.sort(nine.time()[nine.source == 0])[:9]) * SECONDS
    assert spread == pytest.approx(8 * 4.85, abs=0.1)


def test_threads_and_blocks_change_nothing(monkeypatch):
    whole = make(threads=1)
    monkeypatch.setattr("sim.agis.passes._scans._BLOCK_SOURCES", 70)
    monkeypatch.setattr("sim.agis.passes._scans._BLOCK_SORTED", 1000)
    for name in ("source", "knot", "frac", "sin", "along_factor", "across_factor"):
        np.testing.assert_array_equal(getattr(make(threads=2), name), getattr(whole, name))


def test_mapped_scans_are_those_in_memory(tmp_path):
    folder = tmp_path / "scans"
    first = make(folder=folder)
    assert _mapped(first.source)
    assert not _mapped(make().source)
    stamp = (folder / "source.npy").stat().st_mtime_ns
    again = make(folder=folder)
    assert (folder / "source.npy").stat().st_mtime_ns == stamp  # read, not made again
    for name in ("source", "knot", "frac", "sin", "cos", "along_factor", "across_factor"):
        np.testing.assert_array_equal(getattr(again, name), getattr(make(), name))
    other = make(folder=folder, along=50.0)
    assert other.weights[0, 0] == 1 / 2500
    rng = np.random.default_rng(1)
    along, across = 100 * rng.standard_normal((2, len(first)))
    np.testing.assert_array_equal(
        System(again).solve(along, across).sources, System(make()).solve(along, across).sources
    )


def test_transits_of_a_killed_run_are_not_followed_again(tmp_path, monkeypatch):
    monkeypatch.setattr("sim.agis.passes._scans._BLOCK_SOURCES", 40)
    follow, followed = sim.NominalScanningLaw.transits, []

    def transits(law, lon, lat, **options):
        followed.append(len(lon))
        if len(followed) == 4:
            raise KeyboardInterrupt
        return follow(law, lon, lat, **options)

    whole = make()
    monkeypatch.setattr(sim.NominalScanningLaw, "transits", transits)
    folder = tmp_path / "scans"
    with pytest.raises(KeyboardInterrupt):
        make(folder=folder)
    resumed = make(folder=folder)
    assert sum(followed) == resumed.n_sources + 40  # the interrupted block alone was begun twice
    for name in ("source", "place", "knot", "frac", "sin", "cos", "along_factor", "across_factor"):
        np.testing.assert_array_equal(getattr(resumed, name), getattr(whole, name))
    assert {path.suffix for path in folder.iterdir()} == {".npy", ".json"}
    assert [path.name for path in tmp_path.iterdir()] == ["scans"]


def _mapped(array):
    while array is not None and not isinstance(array, mmap.mmap):
        array = getattr(array, "base", None)
    return array is not None


def test_from_a_folder_to_the_byte(tmp_path, monkeypatch):
    """Transits, observations and the factor on disk change no bit, however many transits are looked at together."""
    monkeypatch.setattr("sim.agis.passes._make.BLOCK_TRANSITS", 700)
    monkeypatch.setattr("sim.agis.passes._scans.BLOCK_TRANSITS", 900)
    monkeypatch.setattr("sim.agis._globals._BLOCK_SOURCES", 77)
    results = []
    for folder in (None, tmp_path / "scans"):
        system = System(make(folder=folder), compiled=True)
        root = system.factor
        while isinstance(root, np.ndarray) and root.base is not None:
            root = root.base
        assert isinstance(root, mmap.mmap) == bool(folder)
        observed = observations(system.scans, 1)
        assert isinstance(observed[0], np.memmap) == bool(folder)
        solution = system.solve(*observed, iterations=12, stop=None)
        results.append([*observed, solution.sources, solution.attitude, solution.history, system.true_covariance(1)])
    for here, there in zip(*results, strict=True):
        assert here.tobytes() == there.tobytes()
    names = {path.suffix for path in (tmp_path / "scans").iterdir()}
    assert names == {".npy", ".json"}  # what was only for this run has no name


def test_full_disk_is_said_at_once(tmp_path, monkeypatch):
    made = make(folder=tmp_path / "scans")

    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.posix_fallocate", full)
    with pytest.raises(OSError, match="No space left"):
        System(made, compiled=True)


def test_folder_of_something_else_is_left_alone(tmp_path):
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(ParameterError, match=r"holds other files \(thesis.tex"):
        make(folder=tmp_path)
    assert (tmp_path / "thesis.tex").exists()
    with pytest.raises(ParameterError, match="is a file"):
        make(folder=tmp_path / "thesis.tex")


def test_days_without_transits_are_no_error():
    """Six days lost, hundreds of intervals empty: the smoothing bridges them."""
    law = sim.NominalScanningLaw(years=1.0, gaps=((0.3, 0.3 + 6 / 365.25),))
    found = make(law=law, knots=6 * 3600.0)
    empty = np.setdiff1d(np.arange(found.intervals), found.knot)
    assert len(empty) >= 20
    system = System(found)
    solution = system.solve(*observations(found, 1))
    assert np.isfinite(solution.sources[system.solved]).all()
    assert np.isfinite(solution.attitude).all()


def test_messages(monkeypatch):
    found = make()
    with pytest.raises(DegeneracyError, match="no across-scan data: .* coefficient 0 of the attitude"):
        System(make(across=None))
    with pytest.raises(DegeneracyError, match="no across-scan data"):
        System(make(across=np.inf))
    System(make(across=None), prior=10.0)  # then the rest is known from elsewhere
    with pytest.raises(DegeneracyError, match=r"too few sources for the knots: .* Take knots of \d+ s or more"):
        System(make(knots=30.0))
    with pytest.raises(VshWarning, match="is a statement on the attitude"):
        System(make(), smoothing=100.0)
    with pytest.raises(ParameterError, match="2 errors of transits are zero or negative"):
        make(along=np.r_[0.0, -1.0, np.ones(298)])
    with pytest.raises(ParameterError, match="knots .* in a mission of 1 years"):
        make(knots=4e7)
    with pytest.raises(ParameterError, match="ccds must be one of 1, 9"):
        make(ccds=3)
    with pytest.raises(DegeneracyError, match="none of 300 sources has transits enough"):
        System(scans(sim.NominalScanningLaw(years=0.05), QUASARS.lon, QUASARS.lat, 1.0, 1.0, knots=86400.0), prior=1.0)
    monkeypatch.setattr("sim.agis.passes._scans.free_memory", lambda: 1e4)
    with pytest.raises(ParameterError, match="transits would need .* GiB, and 0.0 GiB are free: give a folder="):
        make()
    with pytest.raises(ParameterError, match="the normal equations would need .* GiB"):
        System(found)


def test_without_numba_many_transits_are_refused(monkeypatch):
    found = make()
    monkeypatch.setattr("sim.agis.passes._make.COMPILED_FROM", 0)
    monkeypatch.setitem(sys.modules, "sim.agis.passes._kernels", None)
    monkeypatch.delattr("sim.agis.passes._kernels", raising=False)
    assert System(found).solved.any()  # the sparse passes do
    monkeypatch.setattr("sim.agis.passes._make.MAX_SPARSE_TRANSITS", 100)
    with pytest.raises(ParameterError, match=r"need numba: pip install 'vsh-astrometry\[agis\]'"):
        System(found)


def test_sources_with_few_transits_are_left_out():
    law = sim.NominalScanningLaw(years=0.5)
    system = System(make(law=law, knots=86400.0))
    assert 0 < system.solved.sum() < 300
    solution = system.solve(*observations(system.scans, 1))
    assert np.isnan(solution.sources[~system.solved]).all()
    field = solution.field()
    assert len(field) == system.solved.sum()
    assert any(f"left out {300 - len(field)} of 300 sources" in note for note in field.notes)


def test_plans_foretell_transits_and_memory():
    told = plan(LAW, QUASARS.lon, QUASARS.lat, 86400.0)
    assert told.transits == pytest.approx(len(make()), rel=0.05)
    assert told.coefficients == pytest.approx(369, abs=1)
    assert plan(LAW, QUASARS.lon, QUASARS.lat, 86400.0, ccds=9).transits == pytest.approx(9 * told.transits)
    assert "CPU seconds for each" in str(told)
