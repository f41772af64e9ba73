"""Catalogues in parts: the same sums from files, tables, streams, processes and Dask; what is wrong is said."""

import os
import signal
import threading
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import POSIX

import fit
from fit import Moments
from vsh import Field, Modes
from vsh.io import tables
from vsh.io.catalogue import parts, read_field
from vsh.io.parts import Dask, InProcess, Parts, Processes, SumTree, as_parts, median, weighted_quantiles
from vsh.tools.errors import EmptyFieldError, FieldError, ParameterError, TableError


def sky(n, seed):
    rng = np.random.default_rng(seed)
    return Field(
        rng.uniform(0, 2 * np.pi, n), np.arcsin(rng.uniform(-1, 1, n)), rng.normal(size=(2, n)) * 300,
        rng.uniform(100, 400, (2, n)), rng.uniform(-0.5, 0.5, n), name=np.arange(n) + 10_000 * seed,
        magnitude=rng.uniform(15, 21, n),
    )  # fmt: skip


FIELDS = [sky(300 + 7 * i, i) for i in range(20)]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("sky")
    for i, field in enumerate(FIELDS):
        field.write(path / f"part{i:02}.parquet")
    return path


@pytest.fixture(scope="module")
def whole(folder):
    return Moments.of(read_field(folder), 4)


def close(one, two):
    for name in ("weights", "motions"):
        assert np.abs(getattr(one, name) - getattr(two, name)).max() <= 1e-12 * np.abs(getattr(two, name)).max()
    assert (one.n_data, one.frame) == (two.n_data, two.frame)


def test_every_source_of_parts_gives_the_same(folder, whole):
    import pandas
    import pyarrow.parquet

    paths = sorted(folder.iterdir())
    arrow = pyarrow.parquet.read_table(paths)
    sources = {
        "folder": folder, "its name": str(folder), "files": paths, "tables": [tables.read_table(path) for path in paths],
        "Arrow table": arrow, "Arrow stream": arrow.to_reader(), "DataFrame": arrow.to_pandas(), "fields": FIELDS,
        "frames": [pandas.read_parquet(path) for path in paths], "mixed": [*paths[:5], *FIELDS[5:]],
    }  # fmt: skip
    for name, source in sources.items():
        found = Moments.of(parts(source, rows=1000), 4)
        close(found, whole)
        assert name == "Arrow stream" or (Moments.of(parts(source, rows=1000), 4).weights == found.weights).all()


@pytest.mark.slow
def test_processes_and_threads_give_the_same_bits(folder, whole):
    here = Moments.of(parts(folder), 4)
    close(here, whole)
    for workers in (2, 3):
        assert (Moments.of(parts(folder, workers=workers), 4).weights == here.weights).all()


def test_dask_reports_each_part_once():
    dask = pytest.importorskip("dask")
    reported = []
    assert Dask().total(len, [dask.delayed(list)(range(n)) for n in (1, 2, 3, 4, 5)], lambda: reported.append(1)) == 15
    assert len(reported) == 5  # once for each part, however many sums and inputs there are


@pytest.mark.slow
def test_dask(folder, whole):
    dask = pytest.importorskip("dask")
    here = Moments.of(parts(folder), 4)
    delayed = [dask.delayed(read_field)(path) for path in sorted(folder.iterdir())]
    assert (Moments.of(parts(delayed), 4).weights == here.weights).all()
    assert (Moments.of(parts(delayed, workers=2), 4).weights == here.weights).all()
    assert len(list(parts(delayed))) == 20
    assert len(parts(delayed[0])) == 1
    frame = pytest.importorskip("dask.dataframe", exc_type=ImportError).read_parquet(sorted(map(str, folder.iterdir())))
    close(Moments.of(parts(frame), 4), whole)
    with pytest.raises(TableError, match=r"has no column 'mu_ra' for pmra: it has .*pmdec"):
        parts(frame, columns={"pmra": "mu_ra"})


class Deadly:
    """Moments, but the process that meets a certain source is killed: once, or every time."""

    def __init__(self, name, mark=None):
        self.name, self.mark = name, mark

    def __call__(self, field):
        if self.name in field.name and not (self.mark and os.path.exists(self.mark)):
            if self.mark:
                Path(self.mark).touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return Moments.of(field, 4)


@POSIX
@pytest.mark.slow
def test_worker_that_is_killed_changes_no_bit(folder, tmp_path):
    here = Moments.of(parts(folder), 4)
    found = parts(folder, workers=2).sum(Deadly(70_000, str(tmp_path / "killed")))
    assert (tmp_path / "killed").exists()
    assert (found.weights == here.weights).all()


@pytest.mark.slow
def test_part_that_kills_every_worker_is_named(folder):
    with pytest.raises(TableError, match=r"part 8 of 20, .*part07\.parquet, ended the process that read it 3 times"):
        parts(folder, workers=2).sum(Deadly(70_000))


@pytest.fixture(scope="module")
def cluster():
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, silence_logs=50
    ) as running:
        yield running


@pytest.mark.slow
def test_cluster_by_its_address(folder, whole, cluster, tmp_path):
    here = Moments.of(parts(folder), 4)
    by_address = parts(folder, scheduler=cluster.scheduler_address)
    assert "by Dask at tcp://" in repr(by_address)
    assert (Moments.of(by_address, 4).weights == here.weights).all()
    bright = by_address.map(lambda field: field[field.magnitude < 18])  # Dask sends what cannot be imported
    assert bright.sum(len) == sum(int((field.magnitude < 18).sum()) for field in FIELDS)
    killed = by_address.sum(Deadly(70_000, str(tmp_path / "killed")))
    assert (killed.weights == here.weights).all()
    with pytest.raises(TableError, match=r"part 8 of 20, .*part07\.parquet, ended every worker that computed it"):
        by_address.sum(Deadly(70_000))


def test_scheduler_that_is_away(monkeypatch):
    pytest.importorskip("distributed")
    with pytest.raises(TableError, match=r"nowhere\.json is neither an address such as"):
        parts(FIELDS, scheduler="nowhere.json").sum(len)
    monkeypatch.setattr("vsh.io.parts._engines.PATIENCE", 1)
    with pytest.raises(TableError, match="127.0.0.1:9 cannot be reached"):
        parts(FIELDS, scheduler="tcp://127.0.0.1:9").sum(len)


def test_steps_and_iteration(folder):
    bright = parts(folder).map(lambda field: field[field.magnitude < 18]).to_frame("galactic")
    assert {field.frame for field in bright} == {"galactic"}
    assert bright.sum(len) == sum(map(len, bright)) == sum(int((f.magnitude < 18).sum()) for f in FIELDS)
    same = fit.normal_equations(iter(bright), 3).matrix
    np.testing.assert_allclose(fit.normal_equations(bright, 3).matrix, same, atol=1e-12 * same.max())
    assert parts(folder).counted() == sum(map(len, FIELDS))
    assert len(parts(folder)) == 20
    assert repr(parts(folder)) == "<Parts: 20, summed here>"


def test_only_what_is_wanted_is_read(folder):
    seen = parts(folder).sum(lambda field: {(field.name is None, field.magnitude is None): 1}, roles=("magnitude",))
    assert seen == {(True, False): 20}


def test_sums_over_parts_add(folder):
    found = parts(folder).sum(lambda field: ({"n": len(field), len(field): [1]}, field.information.sum(), None))
    assert found[0]["n"] == sum(map(len, FIELDS))
    assert set(found[0]) == {"n", *map(len, FIELDS)}
    assert found[2] is None
    tree = SumTree()
    assert tree.total() is None
    for i in range(1000):
        tree.add([i])
    assert tree.total() == list(range(1000))


def test_tree_is_the_same_however_it_is_grown():
    """Dask's levels and the one that grows leaf by leaf add up the same pairs: the same rounding."""
    from vsh.io.parts._engines import BRANCHES, sum_terms

    for n in (1, 7, 8, 9, 63, 64, 65, 511, 600):
        leaves = np.random.default_rng(n).normal(size=n) * 10.0 ** np.random.default_rng(n).uniform(-8, 8, n)
        tree, level = SumTree(), list(leaves)
        for leaf in leaves:
            tree.add(leaf)
        while len(level) > 1:
            level = [sum_terms(level[i : i + BRANCHES]) for i in range(0, len(level), BRANCHES)]
        assert tree.total() == level[0]


def test_rows_that_cannot_be_used(tmp_path):
    for i, field in enumerate(FIELDS[:3]):
        table = field.to_table()
        table["pmra"][: (3, len(field), 0)[i]] = np.nan
        table.write(tmp_path / f"{i}.parquet")
    found = fit.normal_equations(parts(tmp_path, on_bad="drop"), 2)
    kept = len(FIELDS[0]) - 3 + len(FIELDS[2])
    assert found.n_data == 2 * kept
    (note,) = [note for note in found.notes if note.startswith("left out")]
    assert note.startswith(f"left out {3 + len(FIELDS[1])} of {sum(map(len, FIELDS[:3]))} rows: ")
    with pytest.raises(FieldError, match="3 of 300 rows cannot be used"):
        fit.normal_equations(parts(tmp_path), 2)
    with pytest.raises(EmptyFieldError, match="No row is left"):
        fit.normal_equations(parts([tmp_path / "1.parquet"]), 2)
    with pytest.raises(EmptyFieldError, match="no part holds a source that can be used: left out"):
        fit.normal_equations(parts([tmp_path / "1.parquet"], on_bad="drop"), 2)


def test_empty_parts_are_nothing(tmp_path):
    FIELDS[0].write(tmp_path / "1.parquet")
    tables.read_table(tmp_path / "1.parquet")[:0].write(tmp_path / "0.parquet")
    assert parts(tmp_path).sum(len) == 300


@pytest.mark.slow
def test_files_that_differ_are_refused(tmp_path):
    """As when they are read whole: a column or a unit that one of them lacks is not filled in silently."""
    FIELDS[0].write(tmp_path / "a.fits")
    plain = tables.read_table(tmp_path / "a.fits")
    for change, said in [
        (lambda table: table.remove_column("pmra_pmdec_corr"), r"b\.fits has no column pmra_pmdec_corr, which .*a\.fits has"),
        (lambda table: setattr(table["pmra"], "unit", "uas/yr"), r"b\.fits has pmra in "),
    ]:  # fmt: skip
        other = plain.copy()
        change(other)
        other.write(tmp_path / "b.fits", overwrite=True)
        for workers in (None, 2):
            with pytest.raises(TableError, match=said):
                fit.normal_equations(parts(tmp_path, workers=workers), 1)
    with pytest.raises(ParameterError, match="1 of the parts are files that stand there twice"):
        parts([tmp_path / "a.fits", tmp_path / "a.fits"])


def test_errors_name_the_part(folder, tmp_path):
    bad = tables.read_table(folder / "part03.parquet")
    bad["pmra"][5] = np.nan
    paths = sorted(folder.iterdir())
    bad.write(tmp_path / "bad.parquet")
    with pytest.raises(FieldError, match=r"bad\.parquet: 1 of \d+ rows cannot be used.*row 5"):
        parts([*paths[:3], tmp_path / "bad.parquet"]).counted()
    with pytest.raises(ZeroDivisionError) as caught:
        parts(folder).sum(lambda field: 1 / 0)
    assert "part00.parquet" in caught.value.__notes__[0]


def test_next_part_is_read_while_one_is_summed(monkeypatch):
    """Also after a part of which the sum leaves blocks out, and one that cannot be read."""
    monkeypatch.setattr("vsh.io.parts._engines._WORTH_A_THREAD", 1)
    begun = {name: threading.Event() for name in "abcd"}

    def read(piece, roles):
        begun[piece].set()
        for block in FIELDS[:3]:
            if piece == "c":
                raise EmptyFieldError("nothing is left")
            yield block

    summed = []

    def count(field):
        summed.append(len(field))
        if len(summed) == 1:  # the first block of a
            assert begun["b"].wait(10)
            assert not begun["d"].is_set()
        if len(summed) == 4:  # the first block of b: its others have no part in the sum
            raise EmptyFieldError("nothing is left")
        return len(field)

    total = Parts(tuple(begun), read, engine=InProcess(1)).sum(count)
    assert total == 2 * sum(map(len, FIELDS[:3]))
    assert all(event.is_set() for event in begun.values())
    with pytest.raises(ZeroDivisionError):
        Parts(tuple(begun), read, engine=InProcess(1)).sum(lambda field: 1 / 0)


def test_stream_that_was_read_says_so():
    import pyarrow

    stream = parts(pyarrow.table({name: np.arange(1.0, 9.0) for name in
                   ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error")}).to_reader())  # fmt: skip
    assert stream.counted() == 8
    with pytest.raises(TableError, match="can be read only once, and this needs several passes"):
        stream.counted()


def test_complete_parts_have_no_note(folder):
    for sky in (parts(folder, on_bad="drop"), parts(folder)):
        notes = fit.solve(fit.normal_equations(sky, 1)).notes
        assert not any(note.startswith("left out") for note in notes)


def test_objects_that_are_no_parts(folder):
    for wrong, said in [
        ("nowhere.fits", "no such file"), (iter(FIELDS), "read only once"), (parts(folder), "in parts already"),
    ]:  # fmt: skip
        with pytest.raises((TableError, ParameterError), match=said):
            parts(wrong)
    with pytest.raises(ParameterError, match="a step is a function"):
        parts(folder).map(3)
    with pytest.raises(ParameterError, match="is a function of a Field, not a Modes"):
        parts(folder).sum(Modes(3))
    with pytest.raises(ParameterError, match="what a step returns must be Field, not int"):
        parts(folder).map(len).sum(len)
    with pytest.raises(ParameterError, match="cannot be sent to other processes"):
        parts(folder, workers=2).sum(lambda field: len(field))
    for wrong, said in [({"workers": 0}, "workers"), ({"workers": 2, "scheduler": "x"}, "one of the two")]:
        with pytest.raises(ParameterError, match=said):
            parts(folder, **wrong)
    with pytest.raises(ParameterError, match="list of parts is empty"):
        parts([])


def test_hats_folder_is_read_without_its_thumbnail(tmp_path):
    home = tmp_path / "sky" / "dataset" / "Norder=0" / "Dir=0"
    home.mkdir(parents=True)
    for i, field in enumerate(FIELDS[:3]):
        field.write(home / f"Npix={i}.parquet")
    FIELDS[0].write(tmp_path / "sky" / "dataset" / "data_thumbnail.parquet")
    (tmp_path / "sky" / "hats.properties").write_text(f"hats_nrows={sum(map(len, FIELDS[:3]))}\n")
    (tmp_path / "sky" / "skymap.fits").touch()
    assert len(parts(tmp_path / "sky")) == 3
    assert len(read_field(tmp_path / "sky")) == sum(map(len, FIELDS[:3]))
    listed = tmp_path / "sky" / "partition_info.csv"
    listed.write_text("Norder,Npix\n0,0\n0,1\n0,2\n")
    assert len(parts(tmp_path / "sky")) == 3
    listed.write_text("Norder,Npix\n0,0\n0,1\n0,2\n1,7\n")
    with pytest.raises(TableError, match=r"lacks 1 of 4 partitions .* \(first: Norder=1, Npix=7\)"):
        parts(tmp_path / "sky")
    listed.write_text("Norder,Npix\n0," + "0" * 200_000)
    with pytest.raises(TableError, match=r"partition_info.csv is damaged"):
        parts(tmp_path / "sky")
    listed.unlink()
    (tmp_path / "collection.properties").write_text("obs_collection=x\nhats_primary_table_url=sky\n")
    assert parts(tmp_path).counted() == sum(map(len, FIELDS[:3]))
    (tmp_path / "collection.properties").write_text("obs_collection=x\n")
    with pytest.raises(TableError, match="margin cache repeats sources"):
        parts(tmp_path)


def odd(field):
    return np.abs(field.motion[0]) * 10.0 ** (field.name % 40 - 20)


def alike(field):
    """Numbers that all lie in one or two bins of the histogram."""
    return 1.5 + 1e-4 * field.lat


@pytest.mark.parametrize("number", [odd, alike])
@pytest.mark.parametrize(
    "weight", [lambda field: field.information, lambda field: np.ones(len(field))], ids=["unequal", "equal"]
)
def test_quantiles_are_exact(number, weight):
    several, joined = as_parts(FIELDS), np.concatenate([number(field) for field in FIELDS])
    assert median(several, number) == np.median(joined)
    assert median(as_parts(FIELDS[:-1]), number) == np.median(np.concatenate([number(field) for field in FIELDS[:-1]]))
    order, shares = np.argsort(joined), np.array([0.05, 0.1, 0.25, 0.5, 0.9, 0.95])
    reached = np.cumsum(np.concatenate([weight(field) for field in FIELDS])[order])
    expected = joined[order][np.searchsorted(reached, shares * reached[-1])]
    np.testing.assert_array_equal(weighted_quantiles(several, number, weight, shares), expected)


@pytest.mark.slow
def test_pool_needs_no_thread_of_ours(folder):
    """Sums in a thread other than the first: notebooks and servers do so."""
    found = []
    thread = threading.Thread(target=lambda: found.append(parts(folder, workers=2).sum(partial(Moments.of, lmax=2))))
    thread.start()
    thread.join()
    assert found[0].n_data == 2 * sum(map(len, FIELDS))
    assert str(Processes(2)) == "by 2 processes"


def test_positions_are_enough(tmp_path):
    """Correlations of a sky without motions, in parts and whole; with errors of one's own."""
    from fit.correlation import correlation_matrices
    from vsh.io.catalogue import read_sources

    for i, field in enumerate(FIELDS[:2]):
        tables.write_columns(tmp_path / f"{i}.csv", {"ra": np.degrees(field.lon), "dec": np.degrees(field.lat)})
    with pytest.raises(TableError, match="no column 'pmra'"):
        parts(tmp_path).counted()
    for sigma in (None, 50.0):
        sky, whole = parts(tmp_path, motions=False, sigma=sigma), read_sources(tmp_path, sigma=sigma)
        one, two = correlation_matrices(sky), correlation_matrices(whole)
        np.testing.assert_allclose(one.matrix(), two.matrix(), atol=1e-12)
        assert fit.normal_equations(sky, 1).notes == whole.notes
