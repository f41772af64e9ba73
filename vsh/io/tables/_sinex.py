"""Positions of radio sources in SINEX, the format of solutions of the IVS: estimates and their covariance.

Right ascensions and declinations (RS_RA, RS_DE) are read with the correlation of both of a source; what sources have in
common stands in the matrix, too, and is not used. Reference: IERS Message 103, SINEX 2.02 (2006).
"""

from pathlib import Path

import numpy as np

from vsh.io.tables._source import TableSource, open_dict_or_array
from vsh.io.tables._text import open_lines
from vsh.tools.errors import TableError
from vsh.tools.types import PathName

_KINDS = ("RS_RA", "RS_DE")
#: From radians. [mas]
_MAS = np.degrees(3.6e6)


def open_sinex(path: PathName, label: str) -> TableSource:
    """A solution of positions as a table: names, degrees, and errors in mas, of right ascension times cos δ."""
    with open_lines(path, label) as lines:
        blocks = _blocks_of(lines)
    try:
        names = {line[1:5].strip(): (line[6:14].strip(), line[15:31].strip()) for line in blocks["SOURCE/ID"]}
        estimates = [line.split() for line in blocks["SOLUTION/ESTIMATE"]]
        values = {(row[2], row[1]): tuple(map(_number, row[-2:])) for row in estimates if row[1] in _KINDS}
        number = {(row[2], row[1]): int(row[0]) for row in estimates if row[1] in _KINDS}
        codes = [code for code in names if all((code, kind) in values for kind in _KINDS)]
        lon, east, lat, north = np.array([values[code, "RS_RA"] + values[code, "RS_DE"] for code in codes]).T
        pairs = [(number[code, "RS_RA"], number[code, "RS_DE"]) for code in codes]
        rho = _correlations_of(blocks, pairs)
    except (KeyError, IndexError, ValueError) as error:
        reason = f"it has no block {error}" if isinstance(error, KeyError) else f"none, or a damaged one ({error})"
        raise TableError(f"{label} is no solution of positions (RS_RA, RS_DE) in SINEX: {reason}") from None
    columns = {
        "icrf": np.array([names[code][1].removeprefix("ICRF ") for code in codes]),
        "iers": np.array([names[code][0] for code in codes]),
        "defining": np.full(len(codes), ""),
        "ra": np.degrees(lon) % 360, "dec": np.degrees(lat),
        "ra_error": east * np.cos(lat) * _MAS, "dec_error": north * _MAS, "ra_dec_corr": rho,
    }  # fmt: skip
    units = {"ra": "deg", "dec": "deg", "ra_error": "mas", "dec_error": "mas"}
    note = f"{Path(path).name}: what the errors of two sources have in common, by the matrix of SINEX, is not used"
    source = open_dict_or_array(columns)
    return TableSource(label, source.names, source.read, units, notes=(note,))


def _blocks_of(lines):
    """The lines of each block, without comments; that of a matrix with its triangle and kind in the title."""
    blocks, block = {}, []
    for line in lines:
        if line.startswith("+"):
            block = blocks.setdefault(line[1:].strip(), [])
        elif not line.startswith(("*", "-", "%")) and line.strip():
            block.append(line.rstrip("\n"))
    return blocks


def _number(text):
    """A number, perhaps with an exponent of Fortran's."""
    return float(text.upper().replace("D", "E"))


def _correlations_of(blocks, pairs):
    """The correlation of both coordinates of each source, (n,); zero where the file has no matrix of them."""
    title = next((name for name in blocks if name.startswith("SOLUTION/MATRIX_ESTIMATE")), "")
    if not title.endswith(("COVA", "CORR")):
        return np.zeros(len(pairs))
    wanted = {place for i, j in pairs for place in ((i, i), (j, j), (min(i, j), max(i, j)))}
    elements = dict.fromkeys(wanted, 0.0)
    for line in blocks[title]:
        row, column, *numbers = line.split()
        for offset, text in enumerate(numbers):
            place = tuple(sorted((int(row), int(column) + offset)))
            if place in wanted:
                elements[place] = _number(text)
    cross = np.array([elements[min(pair), max(pair)] for pair in pairs])
    if title.endswith("CORR"):  # whose diagonal may hold the errors
        return cross
    return cross / np.sqrt([elements[i, i] * elements[j, j] for i, j in pairs])
