"""Positions of radio sources in SINEX, the format of solutions of the IVS: estimates and their covariance.

Right ascensions and declinations (RS_RA, RS_DE) are read with the covariance of all of them, whatever else was solved
for. Reference: IERS Message 103, SINEX 2.02 (2006).
"""

from pathlib import Path

import numpy as np

from vsh.io.tables._source import TableSource, open_dict_or_array
from vsh.io.tables._text import open_lines
from vsh.tools.errors import TableError
from vsh.tools.types import FloatArray, PathName

_PARAMETERS = ("RS_RA", "RS_DE")
#: From radians. [mas]
_MAS = np.degrees(3.6e6)
#: The covariance of twice as many estimates is not read: 10⁸ numbers.
_MOST = 5000


def open_sinex(path: PathName, label: str) -> TableSource:
    """A solution of positions as a table: names, degrees, and errors in mas, of right ascension times cos δ."""
    with open_lines(path, label) as lines:
        blocks = _split_into_blocks(lines, label)
    try:
        names = {line[1:5].strip(): (line[6:14].strip(), line[15:31].strip()) for line in blocks["SOURCE/ID"]}
        estimates = [line.split() for line in blocks["SOLUTION/ESTIMATE"]]
        values = {(row[2], row[1]): tuple(map(_parse_number, row[-2:])) for row in estimates if row[1] in _PARAMETERS}
        codes = [code for code in names if all((code, parameter) in values for parameter in _PARAMETERS)]
        lon, lon_error, lat, lat_error = np.array([values[code, "RS_RA"] + values[code, "RS_DE"] for code in codes]).T
        estimate_rows = {(row[2], row[1]): k for k, row in enumerate(estimates) if row[1] in _PARAMETERS}
        errors = np.array([_parse_number(row[-1]) for row in estimates])
        matrix_rows = [estimate_rows[code, parameter] for parameter in _PARAMETERS for code in codes]
        covariance = _read_covariance(label, blocks, [int(row[0]) for row in estimates], matrix_rows, errors)
    except (KeyError, IndexError, ValueError, np.linalg.LinAlgError) as error:
        reason = f"it has no block {error}" if isinstance(error, KeyError) else f"none, or a damaged one ({error})"
        raise TableError(f"{label} is no solution of positions (RS_RA, RS_DE) in SINEX: {reason}") from None
    n_sources = len(codes)
    if covariance is not None:
        lon_error, lat_error = np.sqrt(covariance.diagonal()).reshape(2, n_sources)
    rho = np.zeros(n_sources) if covariance is None else np.diagonal(covariance, n_sources) / (lon_error * lat_error)
    columns = {
        "icrf": np.array([names[code][1].removeprefix("ICRF ") for code in codes]),
        "iers": np.array([names[code][0] for code in codes]),
        "defining": np.full(len(codes), ""),
        "ra": np.degrees(lon) % 360, "dec": np.degrees(lat),
        "ra_error": lon_error * np.cos(lat) * _MAS, "dec_error": lat_error * _MAS, "ra_dec_corr": rho,
    }  # fmt: skip
    units = {"ra": "deg", "dec": "deg", "ra_error": "mas", "dec_error": "mas"}
    source = open_dict_or_array(columns)
    notes: tuple[str, ...] = ()
    if covariance is None:
        reason = (
            f"that of more than {2 * _MOST} estimates is not read" if len(estimates) > 2 * _MOST else "it has no matrix"
        )
        notes = (f"{Path(path).name}: no covariance between sources ({reason}): their errors are taken as independent",)
    else:
        scale = _MAS * 1e3 * np.r_[np.cos(lat), np.ones(n_sources)]
        covariance *= scale * scale[:, None]
    return TableSource(label, source.names, source.read, units, notes=notes, covariance=covariance)


def _split_into_blocks(sinex_lines, label):
    """Split lines into blocks by title, without comments; that of a matrix has its triangle and kind in the title."""
    blocks, block_lines, last_line = {}, [], ""
    for line in sinex_lines:
        last_line = line if line.strip() else last_line
        if line.startswith("+"):
            block_lines = blocks.setdefault(line[1:].strip(), [])
        elif not line.startswith(("*", "-", "%")) and line.strip():
            block_lines.append(line.rstrip("\n"))
    if not last_line.startswith("%ENDSNX"):
        raise TableError(f"{label} is cut: its last line is not %ENDSNX. Fetch it again")
    return blocks


def _parse_number(text):
    """Parse a number, perhaps with an exponent of Fortran's."""
    return float(text.upper().replace("D", "E"))


def _read_covariance(label, blocks, estimate_indices, rows, errors):
    """Read the covariance of the estimates that stand in some rows; None if there is no matrix. [rad²]"""
    title = next((name for name in blocks if name.startswith("SOLUTION/MATRIX_ESTIMATE")), "")
    matrix_kind = title.split()[-1] if title else ""
    if matrix_kind not in ("COVA", "CORR", "INFO") or len(estimate_indices) > 2 * _MOST:
        return None
    row_of_index = {index: matrix_row for matrix_row, index in enumerate(estimate_indices)}
    matrix: FloatArray = np.zeros((len(estimate_indices), len(estimate_indices)))
    for line in blocks[title]:
        row_index, first_column, *numbers = line.split()
        for column, element in enumerate(numbers, int(first_column)):
            if int(row_index) not in row_of_index or column not in row_of_index:
                raise TableError(f"{label}: the matrix has an element ({row_index}, {column}) of no estimate")
            i, j = row_of_index[int(row_index)], row_of_index[column]
            matrix[i, j] = matrix[j, i] = _parse_number(element)
    if missing := int((matrix.diagonal()[rows] == 0).sum()):  # zeros may be left out, and no variance is one
        raise TableError(f"{label}: the matrix lacks {missing} of {len(rows)} diagonal elements: it is cut")
    if matrix_kind == "INFO":
        matrix = np.asarray(np.linalg.inv(matrix), float)
    elif matrix_kind == "CORR":  # whose diagonal may hold the errors
        np.fill_diagonal(matrix, 1.0)
        matrix *= errors * errors[:, None]
    matrix = matrix[np.ix_(rows, rows)]
    if not (matrix.diagonal() > 0).all():
        raise TableError(f"{label}: the matrix has variances that are not positive")
    return matrix
