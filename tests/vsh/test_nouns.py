"""Nouns go through pickles and deep copies unchanged and read-only; what was left out is counted once."""

import copy
import importlib
import inspect
import pickle
import pkgutil
from dataclasses import is_dataclass, replace

import numpy as np
import pytest
from conftest import random_field
from every_result import RESULTS, result_of
from gaia_table import table

import fit
import sim
import study
from fit.correlation import leakage, predict_covariance
from fit.redshift import binned
from fit.results.storage import Result, is_same
from vsh import Coefficients, Field, Modes, Vector
from vsh.io.catalogue import match, stream_fields
from vsh.tools.errors import VshError
from vsh.tools.notes import DroppedRows, merge_notes


def dropped_field(seed=1, rows=300):
    galaxies = sim.galaxies(rows, seed)
    field = sim.observe(galaxies, sim.spin((1, 2, 3)), seed, sigma=10.0)
    bad = np.zeros(rows)
    bad[seed % rows] = np.nan
    return Field.from_columns(np.degrees(field.lon), np.degrees(field.lat), field.motion[0] / 1000 + bad, field.motion[1] / 1000,
                              field.sigma[0] / 1000, field.sigma[1] / 1000, redshift=field.redshift, redshift_frame="true", on_bad="drop")  # fmt: skip


FIELD = dropped_field()
LAW = sim.NominalScanningLaw(years=0.5, dead_time=0.05, rng=1)
#: Of vsh and sim; every result of a fit goes the same way.
NOUNS = {
    "Field": FIELD,
    "Coefficients": Coefficients.from_vectors((1, 2, 3)),
    "Modes": Modes(3),
    "Vector": Vector([1, 2, 3], np.eye(3)),
    "NormalEquations": fit.normal_equations(FIELD, 2),
    "Solution": fit.fit_field(FIELD, 2),
    "matched": match(FIELD[:20], FIELD[:20], by="position"),
    "Signal": sim.spin((1, 2, 3))
    + sim.secular_parallax((300, 0, 0))
    + sim.peculiar(300, 1)
    + sim.wave_background(1e-3, 1),
    "Shear": sim.anisotropic_expansion(np.diag([1, -1, 0])),
    "NominalScanningLaw": LAW,
    "Transits": LAW.transits([1.0], [0.5]),
    "Population": sim.quasars(10, 1),
    "Variability": sim.Variability(100, 2),
}
#: Those that hold no array.
PLAIN = {"Signal", "Shear", "Variability", "Modes", "NominalScanningLaw", "floor", "floor of a scalar field", "samples"}


def arrays(thing, seen=()):
    """All arrays that hang on an object."""
    if isinstance(thing, np.ndarray):
        yield thing
    elif isinstance(thing, (list, tuple)):
        for each in thing:
            yield from arrays(each)
    elif hasattr(thing, "__dataclass_fields__"):
        for name in thing.__dataclass_fields__:
            try:
                value = getattr(thing, name)
            except VshError:  # the covariance that a matrix-free solution does not have
                continue
            yield from arrays(value)


@pytest.mark.parametrize("name", [*NOUNS, *RESULTS])
@pytest.mark.parametrize("again", [lambda x: pickle.loads(pickle.dumps(x)), copy.deepcopy], ids=["pickle", "deep copy"])
def test_nouns_travel(name, again):
    """Refusals could not be made again, arrays came back writeable, signals were closures."""
    noun = NOUNS[name] if name in NOUNS else result_of(name)
    other = again(noun)
    assert type(other) is type(noun)
    pairs = list(zip(arrays(noun), arrays(other), strict=True))
    assert all(is_same(one, two) for one, two in pairs)
    if name not in PLAIN:
        assert pairs
        assert not any(two.flags.writeable for one, two in pairs if not one.flags.writeable)
        assert not any(one.flags.writeable for one, _ in pairs)
    assert getattr(other, "notes", ()) == getattr(noun, "notes", ())


def test_signals_and_laws_are_the_same_after_a_pickle():
    lon, lat, z = sim.uniform_sky(50, 1)[0], sim.uniform_sky(50, 1)[1], np.full(50, 0.02)
    signal, law = pickle.loads(pickle.dumps(NOUNS["Signal"])), pickle.loads(pickle.dumps(LAW))
    np.testing.assert_array_equal(signal(lon, lat, z), NOUNS["Signal"](lon, lat, z))
    np.testing.assert_array_equal(law.transits(lon, lat).time, LAW.transits(lon, lat).time)
    assert repr(signal).startswith("<Signal: BandLimitedSignal + SecularParallax + RandomVelocities")


def test_rows_left_out_count_once_however_they_come_in():
    """Told apart by id(), they counted twice after a copy and grew by a line a part."""
    twin = pickle.loads(pickle.dumps(FIELD))
    total = fit.normal_equations(FIELD, 1) + fit.normal_equations(twin, 1)
    assert total.notes == FIELD.notes
    parts = [dropped_field(seed, 60) for seed in range(400)]
    whole = sum(fit.normal_equations(part.add_note(f"part {k}"), 1) for k, part in enumerate(parts))
    assert len(whole.notes) <= 10
    (counted,) = [note for note in whole.notes if isinstance(note, DroppedRows)]
    assert str(counted) == "left out 400 of 24000 rows: proper motion not finite: 400"
    assert "and 392 more notes" in whole.notes[-1]
    assert fit.solve(whole).notes == whole.notes
    halves = sum(fit.normal_equations(p, 1) for p in parts[:200]) + sum(fit.normal_equations(p, 1) for p in parts[200:])
    assert [n for n in halves.notes if isinstance(n, DroppedRows)] == [counted]


def test_notes_of_one_table_are_all_kept():
    lines = tuple(f"note {k}" for k in range(30))
    assert merge_notes(lines) == lines


def test_process_pool_takes_fields_with_bad_rows(tmp_path):
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    t = table()
    t["pmra"][3] = np.nan
    t.write(tmp_path / "c.fits")
    parts = list(stream_fields(tmp_path / "c.fits", rows=15, on_bad="drop"))
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        total = sum(pool.map(fit.normal_equations, parts, [1, 1]))
    assert total.notes == ("left out 1 of 30 rows: proper motion not finite: 1",)
    assert is_same(total.matrix, fit.normal_equations(parts, 1).matrix)


def test_results_are_equal_where_their_numbers_are(tmp_path):
    """Solution.read(s.write()) == s was False."""
    solution = NOUNS["Solution"]
    solution.write(tmp_path / "s.ecsv")
    back = fit.Solution.read(tmp_path / "s.ecsv")
    assert back == solution
    assert hash(back) == hash(solution)
    assert back != fit.fit_field(FIELD, 1)
    assert solution != 3


def test_frame_solutions_carry_notes_and_quality():
    found = fit.solve_frame(FIELD)
    assert found.notes == FIELD.notes
    assert found.reduced_chi2 == pytest.approx(found.chi2 / found.dof)


@pytest.mark.parametrize("call", [
    lambda m: fit.fit_field(FIELD, m).coefficients.values,
    lambda m: fit.normal_equations(FIELD, m).matrix,
    lambda m: fit.gaussian_prior(m, 1.0).matrix,
    lambda m: fit.resample.bootstrap(FIELD, m, 3, 1).replicates,
    lambda m: fit.resample.block_bootstrap(FIELD, m, 2, 3, 1).replicates,
    lambda m: fit.resample.jackknife(FIELD, m, 1).replicates,
    lambda m: fit.clip(FIELD, m).solution.coefficients.values,
    lambda m: fit.robust.student_t(FIELD, m).weights,
    lambda m: fit.robust.excess_noise(FIELD, m).solution.sigma,
    lambda m: binned(FIELD, m, 2).covariance,
    lambda m: predict_covariance(FIELD, m).covariance,
    lambda m: leakage(FIELD, m, 3).matrix,
    lambda m: __import__("vsh.basis", fromlist=["x"]).harmonics(FIELD.lon, FIELD.lat, m),
    lambda m: __import__("vsh.transform", fromlist=["x"]).adjoint(m, FIELD.lon, FIELD.lat, FIELD.motion),
    lambda m: Coefficients(m, np.arange(16.0)).values,
])  # fmt: skip
def test_modes_are_modes_or_a_degree(call):
    # Threads of the transforms add in any order: the last bits vary from call to call.
    np.testing.assert_allclose(call(2), call(Modes(2)), rtol=1e-11)
    with pytest.raises(VshError):
        call(0)
    with pytest.raises(VshError):
        call("two")


def test_every_deliberate_error_is_ours():
    """28 plain ValueErrors and TypeErrors."""
    from conftest import ROOT

    from vsh.tools import errors

    for package in ("vsh", "sim", "fit", "study"):
        for path in (ROOT / package).rglob("*.py"):
            text = path.read_text(encoding="utf-8")
            assert "raise ValueError" not in text, path
            assert "raise TypeError" not in text, path
    kinds = [kind for kind in vars(errors).values() if isinstance(kind, type) and issubclass(kind, errors.VshError)]
    assert all(issubclass(kind, ValueError) for kind in kinds if kind is not errors.VshError)


def test_fields_and_vectors_are_equal_where_their_numbers_are():
    field = random_field(30, 1)
    vector = Vector([1.0, 2.0, np.nan], np.eye(3))
    for thing, other in ((field, field[::-1]), (vector, Vector([1.0, 2.0, 3.0], np.eye(3)))):
        for twin in (pickle.loads(pickle.dumps(thing)), copy.copy(thing)):
            assert twin == thing
            assert hash(twin) == hash(thing)
        assert other != thing
        assert thing != 3


def test_a_source_is_in_a_field_by_its_name():
    field = replace(random_field(3, 1), name=np.array(["a", "b", "c"]))
    assert "b" in field
    assert "d" not in field
    assert "b" not in random_field(3, seed=1)  # nobody has a name
    assert "b" not in random_field(3, 1)


def test_columns_of_a_field_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        random_field(3, 1).pmra[0] = 1.0


def test_results_answer_for_their_solution_and_by_usual_names():
    """Hints sent to attributes one level down, which the object that everybody gets had not."""
    import fit

    result, field = fit.recommended(random_field(100, 1)), random_field(100, 1)
    for name in (*(name for name in dir(fit.Solution) if not name.startswith("_")), "coefficients", "chi2", "notes"):
        assert hasattr(result, name), name
        assert name in dir(result)
    assert result.n_sources == result.solution.n_sources == 100
    assert result.cov is result.covariance
    assert result.save == result.write
    assert (result.spin.std == result.spin.sigma).all()
    assert np.array_equal(result.predict(field.lon, field.lat), result.solution.predict(field.lon, field.lat))
    with pytest.raises(AttributeError) as caught:
        _ = result.spin.save
    assert "write" not in str(caught.value)


def heirs(kind):
    return {heir for each in kind.__subclasses__() for heir in (each, *heirs(each))}


def test_results_are_built_by_keyword():
    """A field that comes between two others cannot change what a call by place means."""
    for package in (fit, study):
        for module in pkgutil.walk_packages(package.__path__, f"{package.__name__}."):
            importlib.import_module(module.name)
    parameters = {kind: inspect.signature(kind).parameters.values() for kind in heirs(Result) if is_dataclass(kind)}
    long = {kind.__name__: all(p.kind is p.KEYWORD_ONLY for p in ps) for kind, ps in parameters.items() if len(ps) > 5}
    assert len(long) > 30
    assert [name for name, by_keyword in long.items() if not by_keyword] == []
