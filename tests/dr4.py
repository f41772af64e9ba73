"""The day of DR4 as docs/dr4.md prints it, from the archive to the page, offline: `make dr4`.

A catalogue is simulated with everything that could deceive, a server on 127.0.0.1 answers like the archive, and every
line of the page is run as a command of its own; the time of each is printed at the end.
"""

import argparse
import io
import re
import resource
import shlex
import subprocess
import sys
import time
import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from astropy.table import Table
from tap_server import posting, serving

import sim

ROOT = Path(__file__).resolve().parent.parent


def lines(page: str) -> list[str]:
    """The commands of the page."""
    return [line.strip() for line in page.splitlines() if re.match(r" {4,}vsh-", line)]


def run(line: str, more: list[str], folder: Path) -> tuple[float, float]:
    """Run one command; returns its real and its CPU time."""
    program, *words = shlex.split(line)
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    command = [sys.executable, "-m", "vsh", program.removeprefix("vsh-"), *words, *more]
    subprocess.run(command, cwd=folder, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    cpu = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.perf_counter() - begin, cpu


def answer(table: Table, adql: str) -> bytes:
    """The rows of a catalogue as the archive would send them: the columns that the query names, and no others."""
    selection = adql.partition("FROM")[0].removeprefix("SELECT").replace("\n", " ").split(",")
    names = [column.strip().rpartition(".")[2] for column in selection]
    columns = {name: table[name] if name in table.colnames else np.full(len(table), np.nan) for name in names}
    body = io.BytesIO()
    Table(columns).write(body, format="fits")
    return body.getvalue()


#: Of so many sources the archive of the rehearsal has epochs.
_WITH_EPOCHS = 60


def epochs(table: Table) -> Table:
    """Epochs of some sources as the archive has them: a row a transit, arrays of the CCDs, no reference position."""
    rows = table[np.linspace(0, len(table) - 1, _WITH_EPOCHS).astype(int)]
    population = sim.quasars(_WITH_EPOCHS, 1)
    lon, lat = (np.radians(np.asarray(rows[name])) for name in ("ra", "dec"))
    seen = sim.epochs(replace(population, lon=lon, lat=lat), sim.acceleration((-0.3, -4.4, -2.3)), 2, complete=True)
    seen["source_id"] = np.asarray(rows["source_id"])[np.asarray(seen["source_id"]) - 1]
    seen.remove_columns(["ra0", "dec0"])
    return seen


def sent(seen: Table, form: dict[str, str]) -> tuple[int, bytes]:
    """The answer of DataLink: a zip archive with one VOTable of the sources that were asked for."""
    if form["DATA_STRUCTURE"] != "DATAMODEL_GAIA":
        return 500, b"Invalid Data Structure parameter: valid ones are: DATAMODEL_GAIA"
    table, body = io.BytesIO(), io.BytesIO()
    seen[np.isin(seen["source_id"], np.array(form["ID"].split(","), int))].write(table, format="votable")
    with zipfile.ZipFile(body, "w") as archive:
        archive.writestr("EPOCH_ASTROMETRY-Gaia DR4.xml", table.getvalue())
    return 200, body.getvalue()


def day(folder: Path, number: int | None) -> list[tuple[str, float, float]]:
    """All of it in a folder; returns the command, the real and the CPU time of each."""
    page = (ROOT / "docs" / "dr4.md").read_text(encoding="utf-8")
    done = []
    for line in lines(page):
        more = ["--overwrite"]
        if line.startswith("vsh-sim"):
            more += [] if number is None else ["--number", str(number)]
        if "--check" in line:
            with serving(b"") as (url, _):
                done.append((line, *run(line, ["--url", url], folder)))
        elif line.startswith("vsh-archive epochs"):
            seen = epochs(Table.read(folder / "qso4.fits"))
            with posting(lambda _, form, seen=seen: sent(seen, form)) as (url, _):
                done.append((line, *run(line, ["--url", url], folder)))
        elif line.startswith("vsh-archive"):
            published = folder / "published.fits"
            (folder / "qso4.fits").replace(published)
            table = Table.read(published)
            with serving(lambda adql, table=table: answer(table, adql)) as (url, _):
                done.append((line, *run(line, [*more, "--url", url], folder)))
        else:
            done.append((line, *run(line, more, folder)))
    return done


def main() -> None:
    """Run the day and print its times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--output", type=Path, default=Path("dr4"))
    parser.add_argument("--number", type=int, help="sources with five parameters; as many as Gaia-CRF3 unless given")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    done = day(options.output, options.number)
    print(f"\n{'real s':>8}{'CPU s':>8}  command")
    for line, real, cpu in done:
        print(f"{real:8.1f}{cpu:8.1f}  {line}")
    print(f"{sum(real for _, real, _ in done):8.1f}{sum(cpu for *_, cpu in done):8.1f}  all of it")


if __name__ == "__main__":
    main()
