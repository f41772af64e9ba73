"""Damaged files for every reader: what is refused in our words, what is taken, what breaks.

`python tests/fuzz.py 8000` shares so many mutants among the readers and prints a table; it ends with status 1 if
any mutant gave a traceback of a library, hung, crashed, or took more memory than four times its file and 500 MB.
The same seed gives the same mutants.
"""

import gzip
import multiprocessing
import resource
import signal
import sys
import tempfile
import time
import warnings
from collections import Counter
from functools import partial
from pathlib import Path

import healpy
import numpy as np
from astropy.io import fits
from astropy.table import Table

import fit
import sim
from fit import storage
from fit.correlation import correlation_matrices, leakage, predict_covariance
from fit.posterior import _sampling as _checkpoint
from fit.redshift import binned
from fit.secular_parallax import observer_velocity
from vsh.io import catalogue, maps, tables
from vsh.io.epochs import read_epochs
from vsh.models.covariance import read_covariance
from vsh.tools.errors import VshError

#: A reader that takes longer hangs. [s]
SECONDS = 20
#: Beyond four times the file a reader may take so much. [bytes]
MEMORY = 500 * 2**20
ROWS = 40


def make_files(folder):
    """A whole file for each reader: a dict of name to (path, function that reads it)."""
    field = sim.observe(sim.galaxies(ROWS, 1), sim.spin((1, 2, 3)), rng=2, sigma=50.0)
    files = {}

    for ending in ("fits", "fits.gz", "ecsv", "ecsv.gz", "csv", "csv.gz", "vot", "parquet"):
        path = folder / f"field.{ending}"
        field.write(path, {"SPIN_X": 1.0})
        files[f"read_field {ending}"] = path, catalogue.read_field
        files[f"stream_fields {ending}"] = path, lambda path: list(catalogue.stream_fields(path, rows=16))
        files[f"tables.read {ending}"] = path, tables.read_table
    bins = binned(field, 1, 2)
    results = {
        "Solution": fit.fit_field(field, 2), "FrameSolution": fit.solve_frame(field), "BinnedSolution": bins,
        "VelocitySolution": observer_velocity(field, 70.0), "Prediction": predict_covariance(field, 1),
        "CorrelationMatrices": correlation_matrices(field), "Leakage": leakage(field, 1, 2),
    }  # fmt: skip
    for name, result in results.items():
        for ending in ("ecsv", "fits"):
            path = folder / f"{name}.{ending}"
            result.write(path)
            files[f"{name}.{ending}"] = path, storage.read
    icrf = "ICRF J{0:02d}0020.3-3221{0:02d} 2357-326   D   {0:02d} 00 20.39996890 -32 {0:02d} 01.2335800 0.00002000 0.0003000 0.1000\n"
    (folder / "icrf.txt").write_text("heading\n" + "".join(icrf.format(k) for k in range(20)))
    files["read_icrf"] = folder / "icrf.txt", catalogue.read_icrf
    healpy.write_map(str(folder / "map.fits"), np.arange(12.0 * 16), dtype=float, overwrite=True)
    files["read_map"] = folder / "map.fits", maps.read_map
    marks = {"data": "x"}
    chain = np.random.default_rng(1).normal(size=(20, 8, 4))
    _checkpoint.save_chain(folder / "chain.npz", marks, chain, chain[..., 0], np.random.RandomState(1).get_state())
    files["checkpoint"] = folder / "chain.npz", partial(_checkpoint.load_chain, fingerprint=marks)
    files |= _further(folder, field)
    return files


def _further(folder, field):
    """Epochs, covariances, whole tables of other formats, partitions and properties of HATS."""
    rng = np.random.default_rng(3)
    n = 3 * ROWS
    angle, when = rng.uniform(0, 360, n), np.sort(rng.uniform(5, 9, n)) * 3.15576e16
    epochs = Table({
        "source_id": np.repeat(np.arange(1, 5), n // 4), "obs_time_tcb": when, "centroid_pos_al": rng.normal(size=n),
        "centroid_pos_error_al": np.full(n, 0.1), "scan_pos_angle": angle, "parallax_factor_al": np.sin(angle),
        "ra0": np.repeat([10.0, 80.0, 200.0, 300.0], n // 4), "dec0": np.repeat([-40.0, 0.0, 30.0, 70.0], n // 4),
    })  # fmt: skip
    files = {}
    for ending in ("ecsv", "fits"):
        path = folder / f"epochs.{ending}"
        epochs.write(path)
        files[f"read_epochs {ending}"] = path, read_epochs
    matrix = np.eye(2 * ROWS) + 0.1
    np.save(folder / "matrix.npy", matrix)
    np.savetxt(folder / "matrix.txt", matrix)
    fits.PrimaryHDU(matrix).writeto(folder / "matrix.fits")
    for ending in ("npy", "txt", "fits"):
        files[f"covariance {ending}"] = (
            folder / f"matrix.{ending}",
            lambda path: np.asarray(read_covariance(path).matrix),
        )
    table = field.to_table()
    table.meta.clear()
    for name in table.colnames:
        if table[name].dtype.kind == "f":
            table[name] = np.round(table[name], 6) * (table[name].unit or 1)
    table.write(folder / "table.mrt", format="ascii.mrt")
    table.write(folder / "table.h5", path="table", serialize_meta=False)
    table.write(folder / "table.dat", format="ascii.basic")
    units = ",".join(f"{name}={table[name].unit}" for name in table.colnames if table[name].unit)
    for ending in ("mrt", "h5", "dat"):
        files[f"read_field {ending}"] = folder / f"table.{ending}", partial(_told, units=units, ending=ending)
    table.write(folder / "Npix=0.parquet")
    (folder / "hats.properties").write_text("obs_collection=x\ndataproduct_type=object\nhats_nrows=40\n")
    files["HATS partition"] = folder / "Npix=0.parquet", _hats
    files["HATS properties"] = folder / "hats.properties", partial(_hats, partition=folder / "Npix=0.parquet")
    return files


def _told(path, units, ending):
    form = "ascii" if ending == "dat" else None
    return catalogue.read_field(path, units=dict(pair.split("=") for pair in units.split(",")), format=form)


def _hats(path, partition=None):
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place, "dataset", "Norder=0", "Dir=0")
        folder.mkdir(parents=True)
        (folder / "Npix=0.parquet").write_bytes((partition or path).read_bytes())
        told = path.read_bytes() if partition else b"obs_collection=x\ndataproduct_type=object\n"
        Path(place, "hats.properties").write_bytes(told)
        return [field._derive(notes=()) for field in catalogue.parts(place)]


def mutate(content, rng):
    """One or two kinds of damage, at places drawn by rng."""
    packed = content[:2] == b"\x1f\x8b" and rng.random() < 0.7
    if packed:  # damage what is inside as well, or the checksum sees everything
        content = gzip.decompress(content)
    data = bytearray(content)
    for _ in range(rng.integers(1, 3)):
        kind, n = rng.integers(8), max(len(data), 1)
        at = int(rng.integers(n)) if rng.random() < 0.5 else int(rng.integers(min(n, 6000)))
        if kind == 0:
            data[at : at + 1] = bytes([rng.integers(256)])
        elif kind == 1:
            data = data[:at]
        elif kind == 2:
            del data[at : at + int(rng.integers(1, 200))]
        elif kind == 3:
            data[at:at] = data[at : at + int(rng.integers(1, 200))]
        elif kind == 4:
            data[at:at] = bytes(rng.integers(256, size=int(rng.integers(1, 50)), dtype=np.uint8))
        elif kind == 5:  # a number becomes another, of a size that no file has
            digits = [i for i in range(at, min(at + 500, len(data))) if 48 <= data[i] < 58]
            for i in digits[: int(rng.integers(1, 20))]:
                data[i] = 48 + int(rng.choice([0, 9, int(rng.integers(10))]))
        elif kind == 6:
            word = rng.choice(
                [b"nan", b"-9999", b"1e400", b"inf", b"null", b"\x1b[31m", b"9999999999999999", b'"', b"\x00" * 20]
            )
            data[at : at + len(word)] = word
        else:
            words = bytes(data).split(b"\n")
            i, j = rng.integers(len(words), size=2)
            words[i], words[j] = words[j], words[i]
            data = bytearray(b"\n".join(words))
    return gzip.compress(bytes(data), mtime=0) if packed else bytes(data)


def outcome(read, path, whole):
    """What a reader makes of a file: "refused", "same", "changed", or the name of what it should not raise."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = read(path)
    except VshError as error:
        message = str(error)
        return "refused" if len(message) > 10 and "\x1b" not in message else f"bare: {message!r}"
    except Exception as error:
        return f"traceback: {type(error).__name__}: {str(error)[:100]}"
    now = describe(found)
    return "same" if now == whole else f"changed: {difference(whole, now)}"


def difference(whole, now):
    """In which way a result that was taken differs: fewer or other rows, other numbers, names, notes or metadata."""
    if isinstance(whole, dict) and isinstance(now, dict):
        if set(whole) != set(now):
            return "names"
        return " ".join(sorted({f"{key}" for key in whole if whole[key] != now[key]}))[:60]
    if isinstance(whole, (list, tuple)) and isinstance(now, (list, tuple)):
        if len(whole) != len(now):
            return "rows"
        return next((difference(a, b) for a, b in zip(whole, now, strict=True) if a != b), "")
    if isinstance(whole, bytes) and isinstance(now, bytes) and len(whole) != len(now):
        return "rows"
    return "values"


def describe(found):
    """Something that is equal where two results are."""
    if isinstance(found, list):
        return [describe(each) for each in found]
    if isinstance(found, tuple):
        return tuple(describe(each) for each in found)
    if isinstance(found, np.ndarray):
        return found.tobytes()
    if hasattr(found, "colnames"):
        return {name: (str(found[name].unit), np.asarray(found[name]).tobytes()) for name in found.colnames}
    if hasattr(found, "__dataclass_fields__"):
        return {name: describe(getattr(found, name)) for name in found.__dataclass_fields__}
    return repr(found)


def mutants(seed, name, content, n):
    """n damaged copies of a file; the same for the same seed and name."""
    for k in range(n):
        yield k, mutate(content, np.random.default_rng([seed, *name.encode(), k]))


def work(seed, names, n, queue):
    """One process: whole files of its own, then the mutants of some readers."""
    resource.setrlimit(resource.RLIMIT_AS, (12 * 2**30, 12 * 2**30))
    with tempfile.TemporaryDirectory() as folder:
        files = make_files(Path(folder))
        for name in names:
            path, read = files[name]
            whole, content = describe(read(path)), path.read_bytes()
            damaged = path.with_name(f"mutant-{path.name}")
            for k, mutant in mutants(seed, name, content, n):
                damaged.write_bytes(mutant)
                queue.put(("begin", name, k, None))
                before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.monotonic()
                signal.setitimer(signal.ITIMER_REAL, SECONDS)
                try:
                    said = outcome(read, damaged, whole)
                except TimeoutError:
                    said = "hang"
                finally:
                    signal.setitimer(signal.ITIMER_REAL, 0)
                taken = 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before)
                if taken > 4 * len(mutant) + MEMORY:
                    said = f"memory: {taken / 2**20:.0f} MiB"
                if time.monotonic() - start > SECONDS:
                    said = "hang"
                queue.put(("end", name, k, said))
    queue.put(("done", None, None, None))


def _alarm(*_):
    raise TimeoutError


def main(total=8000, seed=1, processes=2):
    signal.signal(signal.SIGALRM, _alarm)
    from queue import Empty

    with tempfile.TemporaryDirectory() as folder:
        names = list(make_files(Path(folder)))
    n = -(-total // len(names))
    context = multiprocessing.get_context("fork" if sys.platform == "linux" else "spawn")
    found, bad = {name: Counter() for name in names}, []
    queues = []
    for i in range(processes):
        queue = context.Queue()
        process = context.Process(target=work, args=(seed, names[i::processes], n, queue), daemon=True)
        process.start()
        queues.append((process, queue))
    start = time.monotonic()
    for process, queue in queues:
        last = None
        while True:
            try:
                kind, name, k, said = queue.get(timeout=SECONDS * 3)
            except (Empty, EOFError):
                bad.append((*last, f"crash, exit code {process.exitcode}"))
                process.kill()
                break
            if kind == "done":
                break
            last = name, k
            if kind == "end":
                plain = said.split(":")[0]
                found[name][plain] += 1
                if plain == "changed" and len(sys.argv) > 3:
                    print("CHANGED", name, k, said)
                if plain not in ("refused", "same", "changed"):
                    bad.append((name, k, said))
    print(f"{'reader':28}{'refused':>9}{'same':>7}{'changed':>9}{'broken':>8}")
    for name, counts in found.items():
        broken = sum(counts.values()) - counts["refused"] - counts["same"] - counts["changed"]
        print(f"{name:28}{counts['refused']:9}{counts['same']:7}{counts['changed']:9}{broken:8}")
    totals = sum(found.values(), Counter())
    print(f"{sum(totals.values())} mutants in {time.monotonic() - start:.0f} s: {dict(totals)}")
    for row in bad[:60]:
        print("BROKEN", *row)
    return bool(bad)


if __name__ == "__main__":
    sys.exit(main(*map(int, sys.argv[1:3])))
