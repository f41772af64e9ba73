"""Catalogues at addresses: servers on 127.0.0.1, with the same bits as from a disk."""

import http.server
import os
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from conftest import random_field
from tap_server import running

import fit
from fit.commands.fit import main
from vsh import TableError
from vsh.io.catalogue import parts, read_field
from vsh.io.tables import is_address, open_table

pq = pytest.importorskip("pyarrow.parquet")
fsspec = pytest.importorskip("fsspec")


@pytest.fixture
def folder(tmp_path):
    for k in range(3):
        random_field(400, k).write(tmp_path / f"part{k}.parquet")
    random_field(300, 9).write(tmp_path / "one.fits")
    random_field(300, 9).write(tmp_path / "one.csv")
    return tmp_path


class Ranges(http.server.SimpleHTTPRequestHandler):
    """Files by byte ranges; counts the bytes it sends, and dies after so many."""

    sent, dies_after = 0, None

    def log_message(self, *_):
        pass

    def do_HEAD(self):
        self.answer(body=False)

    def do_GET(self):
        self.answer(body=True)

    def answer(self, body):
        path = self.translate_path(self.path)
        if not os.path.isfile(path):
            self.send_error(404)
            return
        data = Path(path).read_bytes()
        first, last, code = 0, len(data) - 1, 200
        if asked := self.headers.get("Range"):
            low, _, high = asked.removeprefix("bytes=").partition("-")
            first, last, code = int(low), min(int(high) if high else last, last), 206
        part = data[first : last + 1]
        self.send_response(code)
        self.send_header("Accept-Ranges", "bytes")
        self.send_header("ETag", f'"{os.stat(path).st_mtime_ns}"')
        self.send_header("Content-Length", str(len(part)))
        if code == 206:
            self.send_header("Content-Range", f"bytes {first}-{last}/{len(data)}")
        self.end_headers()
        if body:
            cls = type(self)
            if cls.dies_after is not None and cls.sent + len(part) > cls.dies_after:
                self.wfile.write(part[: len(part) // 2])
                self.connection.close()
                return
            self.wfile.write(part)
            cls.sent += len(part)


@pytest.fixture
def server(folder):
    pytest.importorskip("aiohttp")
    handler = type("Handler", (Ranges,), {"sent": 0, "dies_after": None})
    with running(partial(handler, directory=str(folder))) as (_, address):
        yield address, handler


def test_a_part_that_is_replaced_on_the_server_ends_the_fit(server, folder):
    address, _ = server
    places, passes = [f"{address}/part{k}.parquet" for k in range(3)], []

    def step(field):
        passes.append(1)
        if len(passes) == 5:  # in the second pass; of the same size
            random_field(400, 2).write(folder / "new.parquet")
            (folder / "new.parquet").replace(folder / "part2.parquet")
        return field

    with pytest.raises(TableError, match=r"part2\.parquet changed since it was opened"):
        fit.robust.clip(parts(places).map(step), 1, 2.5)


@pytest.mark.parametrize("name", ["part0.parquet", "one.fits", "one.csv"])
def test_http_gives_the_same_bits(name, server, folder):
    address, handler = server
    field = read_field(f"{address}/{name}")
    np.testing.assert_array_equal(field.motion, read_field(folder / name).motion)
    assert handler.sent > 0


def test_only_the_columns_that_are_wanted_are_fetched(server, folder):
    """Of 60 columns eight are used: the bytes that are sent are those of the eight, and the footer."""
    import pyarrow as pa

    rng = np.random.default_rng(1)
    field = random_field(100_000, 1)
    table = {name: np.asarray(column) for name, column in field.to_table().items()}
    table |= {f"other{k}": rng.normal(size=len(field)) for k in range(52)}
    pq.write_table(pa.table(table), folder / "wide.parquet")
    pq.write_table(pa.table({name: table[name] for name in list(table)[:8]}), folder / "narrow.parquet")
    address, handler = server
    np.testing.assert_allclose(read_field(f"{address}/wide.parquet").motion, field.motion, rtol=1e-14)
    assert handler.sent < 1.3 * os.path.getsize(folder / "narrow.parquet")


def test_server_that_dies_is_said_and_started_again_it_goes_on(server, folder, capsys):
    address, handler = server
    handler.dies_after = 20_000
    assert main([f"{address}/one.fits", "--lmax", "1"]) == 1
    assert "one.fits cannot be read" in capsys.readouterr().err
    handler.dies_after = None
    assert main([f"{address}/one.fits", "--lmax", "1"]) == 0
    there = capsys.readouterr().out
    assert main([str(folder / "one.fits"), "--lmax", "1"]) == 0
    assert there.replace(f"{address}/", "") == capsys.readouterr().out.replace(f"{folder}/", "")
    with pytest.raises(TableError, match="no such file|cannot be read"):
        read_field(f"{address}/none.fits")


@pytest.mark.slow
def test_passwords_and_keys_are_written_nowhere(server, tmp_path, capsys):
    address = server[0].replace("://", "://me:sesame1@") + "/one.fits?key=sesame2"
    pages = ["--output", str(tmp_path / "run"), "--html", str(tmp_path / "page.html")]
    assert main([address, "--lmax", "2", *pages]) == 0
    assert main([address.replace("one", "none"), "--lmax", "2"]) == 1
    printed = capsys.readouterr()
    assert "127.0.0.1" in printed.out
    assert "none.fits" in printed.err
    assert "sesame" not in printed.out + printed.err
    written = [path for path in tmp_path.rglob("*") if path.is_file() and path.parent.name != "out"]
    assert {"run.toml", "provenance.json", "solution.ecsv", "page.html"} <= {path.name for path in written}
    assert not [path.name for path in written if b"sesame" in path.read_bytes()]


def test_no_server_and_no_such_protocol():
    with pytest.raises(TableError, match="cannot be read|library is missing"):
        read_field("http://127.0.0.1:9/x.fits")
    with pytest.raises(TableError, match="cannot be read"):
        open_table("nosuch://bucket/x.fits")
    assert not is_address("a:/b.fits")


def test_memory_and_folders(folder):
    memory = fsspec.filesystem("memory")
    for k in range(3):
        with memory.open(f"/catalogue/part{k}.parquet", "wb") as file:
            file.write((folder / f"part{k}.parquet").read_bytes())
    local = fit.fit_field(parts([folder / f"part{k}.parquet" for k in range(3)]), 2)
    far = fit.fit_field(parts("memory://catalogue"), 2)
    np.testing.assert_array_equal(far.values, local.values)
    with pytest.raises(TableError, match="holds 3 files: go through them with vsh.io.catalogue.parts"):
        read_field("memory://catalogue")
    with pytest.raises(TableError, match="no such file or folder"):
        read_field("memory://nowhere/x.parquet")
    memory.rm("/catalogue", recursive=True)


def test_path_of_fsspec(folder):
    upath = pytest.importorskip("upath")
    field = read_field(upath.UPath(f"file://{folder}/part0.parquet"))
    np.testing.assert_array_equal(field.motion, read_field(folder / "part0.parquet").motion)


def test_s3(folder, monkeypatch):
    moto = pytest.importorskip("moto.server")
    boto3 = pytest.importorskip("boto3")
    server = moto.ThreadedMotoServer(ip_address="127.0.0.1", port=0)
    server.start()
    host, port = server.get_host_and_port()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://{host}:{port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "x")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "y")
    monkeypatch.setenv("AWS_REGION", "us-east-1")
    client = boto3.client("s3", endpoint_url=f"http://{host}:{port}", region_name="us-east-1")
    client.create_bucket(Bucket="quasars", ACL="public-read")
    for path in [*folder.glob("*.parquet"), folder / "one.fits"]:
        client.upload_file(str(path), "quasars", f"all/{path.name}" if path.suffix == ".parquet" else path.name)
    local = fit.fit_field(parts([folder / f"part{k}.parquet" for k in range(3)]), 2)
    np.testing.assert_array_equal(fit.fit_field(parts("s3://quasars/all"), 2).values, local.values)
    field = read_field("s3://quasars/one.fits")
    np.testing.assert_array_equal(field.motion, read_field(folder / "one.fits").motion)
    with pytest.raises(TableError, match="no such file or folder"):
        read_field("s3://quasars/none.fits")
    server.stop()


@pytest.mark.filterwarnings("ignore:warning")
def test_datasets_and_plans(folder):
    import pyarrow.dataset as ds

    dataset = ds.dataset([str(folder / f"part{k}.parquet") for k in range(3)])
    wanted = fit.fit_field(parts([folder / f"part{k}.parquet" for k in range(3)]), 2)
    np.testing.assert_allclose(fit.fit_field(read_field(dataset), 2).values, wanted.values, rtol=1e-10)
    np.testing.assert_allclose(fit.fit_field(parts(dataset), 2).values, wanted.values, rtol=1e-10)
    polars = pytest.importorskip("polars")
    lazy = polars.scan_parquet(folder / "part0.parquet")
    np.testing.assert_array_equal(read_field(lazy).motion, read_field(folder / "part0.parquet").motion)
    narrow = polars.scan_parquet(folder / "part0.parquet").filter(polars.col("pmra") > 0)
    assert 0 < len(read_field(narrow)) < 400
