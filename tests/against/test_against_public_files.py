"""Public catalogues with at most one option, each beside a least squares of its own.

The files are not part of the project: put those of public_files.tsv, which says where they are, into a folder and name it
in VSH_PUBLIC_FILES.
"""

import csv
import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
from astropy.table import Table

from fit.commands.fit import main

FOLDER = os.environ.get("VSH_PUBLIC_FILES")
with Path(__file__).with_name("public_files.tsv").open(encoding="utf-8", newline="") as file:
    ROWS = list(csv.DictReader(file, delimiter="\t"))


def columns_of(row):
    """Degrees, mas/yr and correlations of the rows that have all: read by astropy alone."""
    path = Path(FOLDER, row["file"])
    if path.suffix == ".dat":
        names, *lines = path.read_text().splitlines()
        cells = [line.split() for line in lines if line.strip() and not line.startswith("#")]
        table = dict(zip(names.lstrip("#").split(), zip(*cells, strict=True), strict=True))
    else:
        table = Table.read(path, format="ascii.csv" if path.suffix == ".csv" else None)
    size = len(table[row["ra"]])

    def column(name):
        if row[name] == "-":
            return np.zeros(size)
        if row[name].isdecimal():  # one error for all, in µas/yr
            return np.full(size, float(row[name]) / 1000)
        return np.ma.filled(np.ma.asarray(table[row[name]]).astype(float), np.nan)

    values = np.stack([column(name) for name in ("ra", "dec", "pmra", "pmdec", "pmra_error", "pmdec_error", "corr")])
    kept = np.isfinite(values).all(0) & (np.abs(values) < 1e19).all(0) & (values[4:6] > 0).all(0)
    kept &= ~((values[2] == values[3]) & (values[2] <= -99))  # marks of missing values
    if isinstance(table, Table) and "Solved" in table.colnames:
        kept &= np.ma.filled(np.ma.asarray(table["Solved"]).astype(float), 0) != 3
    return values[:, kept]


def least_squares(ra, dec, pmra, pmdec, pmra_error, pmdec_error, corr):
    """Spin and acceleration with their errors, by whitened rows and a singular value decomposition. [µas/yr]"""
    a, d, zero = np.radians(ra), np.radians(dec), np.zeros_like(ra)
    east = np.stack([-np.sin(d) * np.cos(a), -np.sin(d) * np.sin(a), np.cos(d), -np.sin(a), np.cos(a), zero], 1)
    north = np.stack([np.sin(a), -np.cos(a), zero, -np.cos(a) * np.sin(d), -np.sin(a) * np.sin(d), np.cos(d)], 1)
    east, y_east = east / pmra_error[:, None], pmra / pmra_error
    rest = np.sqrt(1 - corr**2)
    north = (north / pmdec_error[:, None] - corr[:, None] * east) / rest[:, None]
    y = np.concatenate([y_east, (pmdec / pmdec_error - corr * y_east) / rest])
    u, s, v = np.linalg.svd(np.concatenate([east, north]), full_matrices=False)
    return 1000 * v.T @ (u.T @ y / s), 1000 * np.sqrt(np.sum((v.T / s) ** 2, axis=1))


@pytest.mark.skipif(not FOLDER, reason="VSH_PUBLIC_FILES names no folder with the files of public_files.tsv")
@pytest.mark.parametrize("row", ROWS, ids=lambda row: row["file"])
def test_public_file_is_fitted_with_one_option(row, capsys, monkeypatch, tmp_path):
    path = Path(FOLDER, row["file"])
    if not path.is_file():
        pytest.skip(f"{path} is not there: {row['repository']} {row['commit']}:{row['path']}")
    assert hashlib.sha256(path.read_bytes()).hexdigest() == row["sha256"]
    monkeypatch.chdir(tmp_path)
    assert main([str(path), *row["option"].split(), "--method", "least-squares", "--lmax", "1", "--json"]) == 0
    vectors = json.loads(capsys.readouterr().out)["tables"]["vectors"]
    columns = {name: column["values"] for name, column in vectors["columns"].items()}
    values, errors = (np.array([columns[f"{p}{x}"][k] for k in (0, 1) for x in "xyz"]) for p in ("", "formal_sigma_"))
    expected, sigma = least_squares(*columns_of(row))
    np.testing.assert_allclose(errors, sigma, rtol=1e-6)
    assert np.max(np.abs(values - expected) / sigma) < 1e-5
