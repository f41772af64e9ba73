"""What was opened is what is read, in every pass, and nothing else: no other file, no other version of it."""

import gzip
import shutil
from dataclasses import replace
from functools import partial
from http.server import BaseHTTPRequestHandler
from pathlib import Path

import numpy as np
import pytest
from tap_server import running

import fit
import sim
from vsh.io.catalogue import parts, read_field
from vsh.io.tables import open_table
from vsh.io.tables._source import number_twins
from vsh.tools.errors import FieldError, TableError
from vsh.tools.files import read_arrays

N = 400


@pytest.fixture
def field():
    return replace(sim.observe(sim.quasars(N, 1), sim.spin((0, 0, 30)), 2, sigma=50.0), name=np.arange(N))


@pytest.fixture
def folder(field, tmp_path):
    home = tmp_path / "parts"
    home.mkdir()
    for k in range(4):
        field[k * 100 : (k + 1) * 100].write(home / f"{k}.fits")
    return home


@pytest.mark.parametrize("estimate", [partial(fit.robust.clip, threshold=2.5), fit.robust.student_t])
@pytest.mark.parametrize("when", [3, 6])
def test_a_part_that_is_replaced_between_passes_ends_the_fit(folder, estimate, when):
    seen = []

    def step(field):
        seen.append(1)
        if len(seen) == when:
            shutil.copy(folder / "0.fits", folder / "copy")
            (folder / "copy").replace(folder / "2.fits")
        return field

    with pytest.raises(TableError, match=r"2\.fits changed since it was opened"):
        estimate(parts(folder).map(step), 1)


def test_hash_of_a_run_is_of_what_was_opened(field, tmp_path, monkeypatch, capsys):
    from fit.commands.fit import main
    from vsh.io import catalogue
    from vsh.tools.files import digest

    path = tmp_path / "q.ecsv"
    field.write(path)
    opened = digest(path)
    read = catalogue.read_field

    def swapped(source, **options):
        found = read(source, **options)
        if field is not None and path.exists():
            with path.open("a") as file:
                file.write("\n")
        return found

    monkeypatch.setattr(catalogue, "read_field", swapped)
    assert main([str(path), "--lmax", "1", "--output", str(tmp_path / "o"), "--format", "none"]) == 1
    assert "changed since it was opened" in capsys.readouterr().err
    monkeypatch.undo()
    field.write(path, overwrite=True)
    assert digest(path) == opened
    assert main([str(path), "--lmax", "1", "--output", str(tmp_path / "o"), "--format", "none"]) == 0
    assert opened in (tmp_path / "o" / "provenance.json").read_text()


@pytest.mark.parametrize("kind", ["external", "virtual", "large", "deep"])
def test_hdf5_reads_nothing_from_elsewhere(kind, tmp_path):
    h5py = pytest.importorskip("h5py")
    n, path = 20, tmp_path / "t.h5"
    (tmp_path / "secret").write_bytes(b"not ours to read" * 50)
    with h5py.File(tmp_path / "inner.h5", "w") as file:
        file["x"] = np.ones(n)
    with h5py.File(path, "w") as file:
        for name in ("ra", "dec", "pmra", "pmdec", "pmra_error"):
            file[name] = np.linspace(1, 80, n)
        if kind == "external":
            file.create_dataset("source_id", (n,), "S40", external=[(str(tmp_path / "secret"), 0, 40 * n)])
        elif kind == "virtual":
            layout = h5py.VirtualLayout((n,), "f8")
            layout[:] = h5py.VirtualSource(str(tmp_path / "inner.h5"), "x", (n,))
            file.create_virtual_dataset("pmdec_error", layout)
        elif kind == "large":
            file.create_dataset("pmdec_error", (6 * 10**8,), "f8", chunks=(10**6,))
        else:
            file["/".join("g" * 50)] = np.ones(n)
    words = {"large": "GiB or more", "deep": "groups within"}
    with pytest.raises(TableError, match=words.get(kind, "another file")):
        read_field(path)


def test_nothing_is_unpacked_to_much_more_than_a_catalogue_could_be(field, tmp_path):
    """Two gigabytes of zeros behind a table, equal rows without end, a chain: they took minutes, or all the memory."""
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    field.write(tmp_path / "t.fits")
    with gzip.open(tmp_path / "t.fits.gz", "wb") as file:
        file.write((tmp_path / "t.fits").read_bytes())
        for _ in range(80):
            file.write(bytes(2**20))
    ones = pa.table({name: pa.array(np.ones(10**6)) for name in ("ra", "dec", "pmra", "pmdec", "e", "f")})
    with pq.ParquetWriter(tmp_path / "t.parquet", ones.schema) as writer:
        for _ in range(2):
            writer.write_table(ones)
    np.savez_compressed(tmp_path / "t.npz", chain=np.zeros(10**7))
    for name, read in (("t.fits.gz", read_field), ("t.parquet", read_field), ("t.npz", read_arrays)):
        with pytest.raises(TableError, match=f"{name} would be 0.0.* GiB or more"):
            read(tmp_path / name)


def test_many_columns_are_no_matter(tmp_path):
    """Names were looked for in each other: 200 000 took minutes."""
    names = [f"c{k}" for k in range(40_000)]
    (tmp_path / "t.csv").write_text(",".join(names) + "\n" + ",".join(["1"] * len(names)) + "\n")
    assert open_table(tmp_path / "t.csv").names == tuple(names)
    assert number_twins(["a", "a", "a_2"]) == (["a", "a_3", "a_2"], ("a",))


class _Refuses(BaseHTTPRequestHandler):
    def do_GET(self):
        self.send_response(int(self.path.split("/")[1]))
        self.send_header("Content-Length", "0")
        self.end_headers()

    do_HEAD = do_GET

    def log_message(self, *_):
        pass


@pytest.mark.parametrize(("status", "hint"), [(503, "try again later"), (404, "look at the address")])
@pytest.mark.parametrize("ending", ["fits", "csv", "parquet"])
def test_what_a_server_answers_is_told(status, hint, ending):
    pytest.importorskip("aiohttp")
    said = rf"the server answers {status} \(.*\): {hint}"
    with running(_Refuses) as (_, address), pytest.raises(TableError, match=said):
        read_field(f"{address}/{status}/q.{ending}")


@pytest.mark.parametrize("change", ["unit", "missing"])
def test_files_of_a_folder_of_parquet_are_alike(field, change, tmp_path):
    """Units and columns of the first file were taken for all."""
    pytest.importorskip("pyarrow")
    for k in range(3):
        table = field[k * 100 : (k + 1) * 100].to_table()
        if k == 1 and change == "unit":
            for name in ("pmra", "pmdec", "pmra_error", "pmdec_error"):
                table[name] = (table[name].quantity.to("uas/yr")).value
                table[name].unit = "uas/yr"
        elif k == 1:
            table.remove_column("pmra_pmdec_corr")
        table.write(tmp_path / f"{k}.parquet")
    for read in (read_field, lambda path: parts(path).sum(len)):
        with pytest.raises((TableError, FieldError), match="pmra"):
            read(tmp_path)
    dataset = pytest.importorskip("pyarrow.dataset").dataset([str(path) for path in sorted(tmp_path.glob("*.parquet"))])
    with pytest.raises(TableError, match="pmra"):
        parts(dataset).sum(len)


def test_numbers_as_text_in_one_file_of_a_folder(field, tmp_path):
    pytest.importorskip("pyarrow")
    for k in range(3):
        table = field[k * 100 : (k + 1) * 100].to_table()
        if k == 1:
            table["pmra"] = table["pmra"].astype(str)
        table.write(tmp_path / f"{k}.parquet")
    with pytest.raises(TableError, match="pmra is double .* and string"):
        read_field(tmp_path)
    found = np.concatenate([part.motion for part in parts(tmp_path)], axis=1)
    np.testing.assert_allclose(found, field[:300].motion, rtol=1e-12)


def test_hats_partitions_are_those_of_its_list(field, tmp_path):
    pytest.importorskip("pyarrow")
    home = tmp_path / "dataset" / "Norder=0" / "Dir=0"
    home.mkdir(parents=True)
    for k in range(4):
        field[k * 100 : (k + 1) * 100].write(home / f"Npix={k}.parquet")
    (tmp_path / "hats.properties").write_text(f"hats_nrows={N}\n")
    (tmp_path / "partition_info.csv").write_text("Norder,Npix\n0,0\n0,1\n0,2\n0,3\n")
    for stray in ("Npix=3 (1).parquet", "._Npix=3.parquet", "Npix=7.parquet"):
        shutil.copy(home / "Npix=3.parquet", home / stray)
    assert parts(tmp_path).counted() == N
    assert len(read_field(tmp_path)) == N
    (tmp_path / "hats.properties").write_text(f"hats_nrows={N + 1}\n")
    with pytest.raises(TableError, match=f"has {N} rows, and its hats.properties says {N + 1}"):
        parts(tmp_path)


@pytest.mark.parametrize("name", ["url", "checkpoint", "output", "log", "scheduler"])
def test_a_configuration_neither_writes_nor_sends(name, tmp_path, capsys):
    from fit.commands.redshift import main as redshift
    from vsh.commands.archive import main as archive

    path = Path(tmp_path, "run.toml")
    command, main = ("vsh-archive", archive) if name == "url" else ("vsh-redshift", redshift)
    path.write_text(f'command = "{command}"\n[options]\n{name} = "http://localhost:1/x"\n')
    try:
        status = main(["--config", str(path)])
    except SystemExit as end:
        status = end.code
    assert status
    assert "is taken from the command line alone" in capsys.readouterr().err.replace("\n", " ")
