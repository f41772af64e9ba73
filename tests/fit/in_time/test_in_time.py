"""Fields that change with time: sums that add, what is put in comes back, backgrounds and their limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import kstest

import sim
from fit.in_time import Functions, normal_equations, solve, waves
from sim.agis import Response
from vsh import Coefficients, DegeneracyError, Modes, ModesError, ParameterError
from vsh.basis import harmonics
from vsh.io.epochs import Observations, make_design_rows, read_observations
from vsh.tools.errors import EmptyFieldError, TableError

YEARS = 3.0
LAW = sim.NominalScanningLaw(years=YEARS)
SPAN = (-1.5, 1.5)


def observed(n=120, error=200.0, seed=1, true=None, functions=None, own=300.0):
    """Transits of the scanning law, with five parameters and displacements in time."""
    rng = np.random.default_rng(seed)
    lon, lat = rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n))
    transits = LAW.transits(lon, lat)
    source, t = transits.source, transits.time - YEARS / 2
    design = make_design_rows(transits.angle, transits.parallax_factor, t)
    position = np.einsum("ki,ik->k", own * rng.normal(size=(n, 5))[source], design) + error * rng.normal(size=len(t))
    if true is not None:
        fields = np.einsum("fp,pcn->fcn", true, harmonics(lon, lat, Modes(2)))[:, :, source]
        position += np.einsum("fk,fck,ck->k", functions(t), fields, design[:2])
    view = transits.view.astype(int)
    return Observations(lon, lat, source, t, design, position, np.full(len(t), error), np.arange(n), (), view)


@pytest.mark.parametrize("functions", [waves(0.5, 1.0), waves(2.0) + waves(3.3)], ids=lambda f: f.names[0])
def test_no_function_holds_a_straight_line(functions):
    start, end = functions.span
    node, weight = np.polynomial.legendre.leggauss(200)
    time = (start + end) / 2 + (end - start) / 2 * node
    values = functions(time)
    assert len(functions) == len(values) == len(functions.names)
    np.testing.assert_allclose([values @ weight, values @ (weight * time)], 0, atol=1e-4)
    assert np.linalg.cond((values * weight) @ values.T) < 1e3


def test_messages_of_functions():
    with pytest.raises(ParameterError, match="twice"):
        waves(1.0, 1.0)
    with pytest.raises(ParameterError, match="frequency"):
        waves()
    with pytest.raises(ParameterError, match="span"):
        Functions((("cos", 1.0),), (1.0, 0.0))
    with pytest.raises(ParameterError, match="different spans"):
        waves(1.0) + waves(2.0, span=SPAN)


def test_signal_is_recovered_with_its_errors():
    functions = waves(1.3, span=SPAN) + waves(0.8, span=SPAN)
    rng = np.random.default_rng(4)
    true = 100 * rng.normal(size=(len(functions), len(Modes(2))))
    pulls, chi2 = [], []
    for seed in range(12):
        some = observed(seed=seed, true=true, functions=functions)
        solution = solve(normal_equations(some, 2, functions, attitude="known"))
        pulls.append(((solution.values - true) / solution.sigma).ravel())
        chi2.append(solution.quality.reduced)
    assert kstest(np.ravel(pulls), "norm").pvalue > 0.01
    assert np.mean(chi2) == pytest.approx(1, abs=0.01)
    # A map at a time is the sum of its functions.
    at, spread = solution.at(0.7)
    assert isinstance(at, Coefficients)
    np.testing.assert_allclose(at.values, functions([0.7])[:, 0] @ solution.values)
    step = np.kron(functions([0.7])[:, 0], np.eye(len(Modes(2))))
    np.testing.assert_allclose(spread, step @ solution.covariance @ step.T)
    assert solution.vector("S", 0.7).unit == "µas"
    assert solution.rest("S")[2] < 1e-6
    assert solution.scaled.quality.reduced == pytest.approx(1)
    power, noise, p_value = solution.power("cos 0.8", "S", 2)
    assert power > noise
    assert p_value < 1e-3
    with pytest.raises(ModesError, match="no function"):
        solution.power("cos 9", "S", 2)


def test_sums_add_and_do_not_depend_on_order_or_threads():
    functions, some = waves(2.0, span=SPAN), observed()
    whole = normal_equations(some, 2, functions, attitude="known")

    def part(which):
        chosen = np.flatnonzero(np.isin(some.source, which))
        number = np.searchsorted(which, some.source[chosen])
        return Observations(
            some.lon[which], some.lat[which], number, some.time[chosen], some.design[:, chosen], some.position[chosen],
            some.error[chosen], some.name[which], (), some.view[chosen],
        )  # fmt: skip

    parts = [part(np.arange(k, 120, 7)) for k in (3, 1, 0, 2, 6, 5, 4)]
    together = normal_equations(parts, 2, functions, attitude="known")
    np.testing.assert_allclose(together.matrix, whole.matrix, rtol=1e-11, atol=1e-12 * whole.matrix.max())
    np.testing.assert_allclose(together.rhs, whole.rhs, rtol=1e-9)
    assert together.n_data == whole.n_data
    again = sum(normal_equations(each, 2, functions, attitude="known") for each in parts)
    np.testing.assert_array_equal(again.matrix, together.matrix)
    one, two = (normal_equations(some, 2, functions, attitude="known", threads=threads) for threads in (1, 2))
    np.testing.assert_array_equal(one.matrix, two.matrix)
    with pytest.raises(TableError, match="two parts"):
        normal_equations([parts[0], parts[0]], 2, functions, attitude="known")
    with pytest.raises(ModesError, match="different functions"):
        whole + normal_equations(some, 2, waves(1.0, span=SPAN), attitude="known")


def test_pseudocolours_are_taken_out_with_their_prior():
    """One matrix of all unknowns, sources' own six among them and the prior as an observation of each."""
    functions, rng = waves(2.3, span=SPAN), np.random.default_rng(4)
    some = observed(15)
    some = replace(some, colour=2000.0 * rng.normal(size=len(some.time)))
    equations = normal_equations(some, 2, functions, attitude="known")
    basis = harmonics(some.lon, some.lat, Modes(2))[:, :, some.source]
    along = np.einsum("pck,ck->pk", basis, some.design[:2])
    templates = np.einsum("fk,pk->fpk", functions(some.time), along).reshape(-1, len(some.time))
    own = np.zeros((6 * 15, len(some.time)))
    for k, row in enumerate([*some.design, -some.colour]):
        own[6 * some.source + k, np.arange(len(some.time))] = row
    matrix = np.vstack([templates, own]) / some.error
    normal, rhs = matrix @ matrix.T, matrix @ (some.position / some.error)
    sixth = len(templates) + 6 * np.arange(15) + 5
    normal[sixth, sixth] += 1 / 0.085**2
    p = len(templates)
    schur = np.linalg.solve(normal[p:, p:], np.column_stack([normal[p:, :p], rhs[p:]]))
    np.testing.assert_allclose(equations.matrix, normal[:p, :p] - normal[:p, p:] @ schur[:, :-1], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(equations.rhs, rhs[:p] - normal[:p, p:] @ schur[:, -1], rtol=1e-6, atol=1e-6)


def test_response_leaves_no_rotation():
    functions, some = waves(2.3, span=SPAN), observed(60)
    response = Response(LAW, nside=2, steps=20_000)
    equations = normal_equations(some, 2, functions, attitude=response)
    assert equations.unconstrained_terms.sum() == 6
    solution = solve(equations)
    assert "rotation in time  not seen" in solution.report()
    assert solution.rest("T")[1] == 0
    assert (solution.values[:, Modes(2).slice_of("T", 1)] == 0).all()
    # The view of the transits is the nearer field.
    blind = normal_equations(replace(some, view=None), 2, functions, attitude=response)
    np.testing.assert_allclose(blind.matrix, equations.matrix)


def test_parallaxes_at_one_a_year_are_named():
    functions = waves(1.0, span=SPAN)
    solution = solve(normal_equations(observed(300), 3, functions, attitude="known"))
    assert solution.lost
    assert f"{len(solution.lost)} combinations are taken" in solution.report()
    assert (solution.seen < 0.99).any()


def test_messages(tmp_path):
    some, functions = observed(20), waves(2.0, span=SPAN)
    with pytest.raises(ParameterError, match="attitude= is missing"):
        normal_equations(some, 2, functions)
    with pytest.raises(ParameterError, match="files of epochs"):
        normal_equations(3, 2, functions, attitude="known")
    with pytest.raises(DegeneracyError, match="combinations"):
        solve(normal_equations(observed(2), 8, functions, attitude="known"))
    few = replace(some, source=some.source[:3], time=some.time[:3], design=some.design[:, :3], position=some.position[:3],
                  error=some.error[:3], view=None)  # fmt: skip
    with pytest.raises(EmptyFieldError, match="five parameters"):
        normal_equations(few, 2, functions, attitude="known")


@pytest.mark.slow
def test_sums_of_a_cluster():
    """Parts summed by Dask, elsewhere: equations and responses travel."""
    dask = pytest.importorskip("dask")
    response, functions = Response(LAW, nside=2, steps=20_000), waves(2.0, span=SPAN)
    parts = [observed(20, seed=seed) for seed in range(3)]
    parts = [replace(part, name=part.name + 100 * k) for k, part in enumerate(parts)]
    made = [dask.delayed(normal_equations)(part, 2, functions, attitude=response, threads=1) for part in parts]
    whole = normal_equations(parts, 2, functions, attitude=response)
    summed = dask.delayed(sum)(made).compute(scheduler="processes", num_workers=2)
    np.testing.assert_allclose(summed.matrix, whole.matrix, rtol=1e-9, atol=1e-12 * whole.matrix.max())
    assert summed.n_sources == 60


def test_folder_is_read_file_by_file(tmp_path):
    population = sim.quasars(24, 1)
    table = sim.epochs(population, sim.spin((0, 0, 0)), 1, mission=LAW)
    for k in range(2):
        table[np.asarray(table["source_id"]) % 2 == k].write(tmp_path / f"{k}.fits")
    functions = waves(2.0, span=SPAN)
    folder = normal_equations(tmp_path, 2, functions, attitude="known")
    whole = normal_equations(read_observations(table).by_transit(), 2, functions, attitude="known")
    np.testing.assert_allclose(folder.matrix, whole.matrix, rtol=1e-9, atol=1e-12 * whole.matrix.max())
    assert folder.n_sources == 24
