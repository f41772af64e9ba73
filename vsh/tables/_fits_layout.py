"""The layout of FITS files: every size that a header declares is held against the file."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from vsh.checks.types import PathName
from vsh.errors import TableError

_BLOCK, _CARD = 2880, 80
_BYTES = {"L": 1, "B": 1, "I": 2, "J": 4, "K": 8, "A": 1, "E": 4, "D": 8, "C": 8, "M": 16, "P": 8, "Q": 16}
_CODE = re.compile(r"\s*(\d*)([LXBIJKAEDCMPQ])")


def check_layout(path: PathName, label: str) -> Any:
    """Walk through the headers of a FITS file; a list of dicts of keywords, one a unit."""
    found = []
    with open(path, "rb") as file:
        size = file.seek(0, 2)
        file.seek(0)
        while file.tell() < size:
            header = _header(file, label, first=not found)
            if header is None:  # blocks of nothing behind the last unit are allowed
                break
            found.append(header)
            axes = header.get("NAXIS", 0)
            if not (isinstance(axes, int) and 0 <= axes <= 999):
                raise TableError(f"{label} is damaged: NAXIS = {axes}")
            lengths = [header.get(f"NAXIS{i + 1}", -1) for i in range(axes)]
            extra, groups = header.get("PCOUNT", 0), header.get("GCOUNT", 1)
            bits = header.get("BITPIX", 8)
            if not all(isinstance(x, int) and x >= 0 for x in (*lengths, extra, groups)) or not isinstance(bits, int):
                raise TableError(f"{label} is damaged: a header declares sizes of {lengths}")
            elements = int(np.prod([int(x) for x in lengths], dtype=object)) if axes else 0
            data = abs(bits) // 8 * groups * (extra + elements) if axes else 0
            start = file.tell()
            if data > size - start:
                raise TableError(
                    f"{label} is truncated or damaged: a header declares {data} bytes where {size - start} are left. "
                    "Fetch it again"
                )
            if header.get("XTENSION") == "BINTABLE":
                _check_row(header, lengths, label)
            padded = -(-data // _BLOCK) * _BLOCK
            file.seek(start + data)
            rest = file.read(min(padded - data, size - start - data))
            if rest.strip(b"\x00 "):
                raise TableError(f"{label} is damaged: there are data behind the last of the declared rows")
            file.seek(start + padded)
    if not found:
        raise TableError(f"{label} is empty")
    return found


def _header(file, label, first):
    header, cards = {}, 0
    start = file.tell()
    while True:
        block = file.read(_BLOCK)
        if not block.strip(b"\x00") and not header and not first:
            return None
        for k in range(0, len(block), _CARD):
            card = block[k : k + _CARD]
            key = card[:8].strip().decode("latin-1")
            if not cards and key not in ("SIMPLE", "XTENSION"):
                raise TableError(f"{label} is damaged or not FITS: a header begins with {key!r} at byte {start}")
            cards += 1
            if key == "END" and not card[3:].strip():
                return header
            if card[8:10] == b"= ":
                header.setdefault(key, _value(card[10:].decode("latin-1")))
        if len(block) < _BLOCK or cards > 200_000:
            raise TableError(f"{label} is truncated or damaged: the header at byte {start} does not end")


def _value(text):
    text = text.strip()
    if text.startswith("'"):
        end = re.match(r"'((?:[^']|'')*)'", text)
        return end.group(1).replace("''", "'").rstrip() if end else text
    word = text.split("/")[0].strip()
    try:
        return int(word)
    except ValueError:
        return word


def _check_row(header, lengths, label):
    """The columns of a binary table make up its rows."""
    if header.get("BITPIX") != 8 or len(lengths) != 2:
        raise TableError(f"{label} is damaged: its table is not made of bytes in rows")
    width, fields = 0, header.get("TFIELDS", 0)
    for i in range(1, (fields if isinstance(fields, int) else 0) + 1):
        form = _CODE.match(str(header.get(f"TFORM{i}", "")))
        if form is None:
            raise TableError(f"{label} is damaged: column {i} has the format {header.get(f'TFORM{i}')!r}")
        repeat = int(form.group(1) or 1)
        width += -(-repeat // 8) if form.group(2) == "X" else repeat * _BYTES[form.group(2)]
    if width != lengths[0]:
        raise TableError(f"{label} is damaged: its columns take {width} bytes, its rows {lengths[0]}")


def fits_rows(path: PathName, label: str) -> int:
    """How many rows the first table of a FITS file has, once the file is known to be whole."""
    for header in check_layout(path, label):
        if header.get("XTENSION") in ("BINTABLE", "TABLE"):
            return int(header["NAXIS2"])
    raise TableError(f"{label} holds no table")
