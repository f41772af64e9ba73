"""What names say: of tables, formats by their endings, a row each; of columns, what they are; and addresses.

columns.tsv has the IVOA's words for each column (UCD1+, vocabulary 1.5) and a sentence for a reader: from it VOTables,
FITS, ECSV and Parquet files describe their columns, and docs/output.md lists them.
"""

import csv
import re
from fnmatch import fnmatchcase
from functools import cache
from pathlib import Path
from typing import NamedTuple


class Format(NamedTuple):
    """A row of `FORMATS`; docs/extending.md says what else another format takes."""

    #: The name by which a user tells it where the name of a file does not (`--columns format=`).
    name: str
    #: astropy's name of it.
    kind: str
    #: Endings of file names; a further .gz, .bz2, .xz or .zst is understood.
    endings: tuple[str, ...]
    #: How its files begin; None where that says nothing.
    begins: re.Pattern[bytes] | None
    #: module:function that opens a file: (path, label) → TableSource. It is imported when the first such file is.
    opens: str
    #: What it is called among the formats in help texts; "" where it is not listed.
    title: str = ""
    #: Whether it is written, too.
    written: bool = False
    #: The extra of setup.cfg that installs its library; "" where none is needed.
    extra: str = ""


_TABLES = "vsh.io.tables."
#: A line with the position of a radio source: names, hours, minutes, seconds, degrees, minutes, seconds.
_VLBI = rb"[\s\S]*^(ICRF J|SOU_GCO:|[^#\n]*\S +\d\d \d\d \d\d\.\d+ +[-+]?\d\d \d\d \d\d\.\d+)"
#: In the order in which beginnings are tried. VOTables are XML, which may begin with a comment.
FORMATS = (
    Format("fits", "fits", (".fits", ".fit"), re.compile(rb"SIMPLE  ="), _TABLES + "_fits:open_fits", "FITS", True),
    Format("votable", "votable", (".vot", ".votable", ".xml"),
           re.compile(rb"(\xef\xbb\xbf)?\s*(<\?xml|<!--|<VOTABLE)"), _TABLES + "_votable:open_votable", "VOTable",
           True),
    Format("votable-overflow", "votable.overflow", (), None, _TABLES + "_votable:open_truncated_votable"),
    Format("ecsv", "ascii.ecsv", (".ecsv",), re.compile(rb"(\xef\xbb\xbf)?#\s*%ECSV", re.IGNORECASE),
           _TABLES + "_text:open_text", "ECSV", True),
    Format("mrt", "ascii.mrt", (".mrt",), re.compile(rb"[\s\S]*^(# ?)?Byte-by-byte Description", re.MULTILINE),
           _TABLES + "_source:open_mrt", "MRT"),
    Format("csv", "ascii.csv", (".csv",), re.compile(rb"(\xef\xbb\xbf)?[^#,\n\0][^,\n\0]*(,[^,\n\0]+){4,}\r?\n"),
           _TABLES + "_text:open_text", "CSV", True),
    Format("parquet", "parquet", (".parquet", ".pq"), re.compile(rb"PAR1"), _TABLES + "_arrow:open_parquet", "Parquet",
           True, "parquet"),
    Format("hdf5", "hdf5", (".hdf5", ".h5"), re.compile(rb"\x89HDF\r\n"), _TABLES + "_source:open_hdf5", "HDF5",
           True, "hdf5"),
    Format("cds", "ascii.cds", (), None, _TABLES + "_source:open_cds"),
    Format("vizier", "ascii.vizier", (), re.compile(rb"(\xef\xbb\xbf)?#[\s\S]*VizieR"), _TABLES + "_text:open_text",
           "VizieR"),
    Format("icrf", "ascii.icrf", (".crf", ".sou"), re.compile(_VLBI, re.MULTILINE), _TABLES + "_text:open_vlbi",
           "VLBI"),
    Format("sinex", "ascii.sinex", (".snx",), re.compile(rb"%=SNX"), _TABLES + "_sinex:open_sinex", "SINEX"),
    Format("ipac", "ascii.ipac", (".tbl",), re.compile(rb"(\\\\[^\n]*\n)*\|[^\n]*\|\s*\n\|"), _TABLES
           + "_source:open_ipac",
           "IPAC"),
    Format("ascii", "ascii", (), None, _TABLES + "_source:open_ascii"),
    Format("text", "ascii.text", (".tsv", ".tab"), re.compile(rb"(?!\s*<)[\t\n\r\x20-\x7e\x80-\xff]+\Z"),
           _TABLES + "_text:open_text", "text"),
)  # fmt: skip

#: The formats of a table in a sentence of help.
TITLES = ", ".join(row.title for row in FORMATS if row.title)
BY_KIND = {row.kind: row for row in FORMATS}
BY_NAME = {row.name: row for row in FORMATS}
#: Kinds by the endings of what is written, and of what is read.
WRITTEN = {ending: row.kind for row in FORMATS if row.written for ending in row.endings}
#: Endings of packed files, behind those of the format; only the first is written.
PACKED = (".gz", ".bz2", ".xz", ".zst")
READ = WRITTEN | {ending: row.kind for row in FORMATS for ending in row.endings}


#: A scheme in front of an address, or several of fsspec's that are chained: simplecache::https://…
_SCHEMES = re.compile(r"(?:[\w+.-]+::)*[\w+.-]{2,}://")
_ADDRESS = re.compile(_SCHEMES.pattern + r"(?:[^\s@/]*:[^\s@]*@)?[^\s'\"]+")
_LINK = re.compile(r"::(?=[\w+.-]{2,}(?:::|://))")


def is_address(text: str) -> bool:
    """Return whether a text is an address."""
    return _SCHEMES.match(text) is not None


def hide_address_secrets(text: str) -> str:
    """An address without passwords, and without what stands behind a question mark; any other text as it is."""
    return hide_secrets(text) if is_address(text) else text


def hide_secrets(text: str) -> str:
    """A message, each address in it without passwords and keys: for whatever is printed, logged or written."""
    if "://" not in text:
        return text
    return _ADDRESS.sub(lambda address: "::".join(map(_hide_link_secrets, _LINK.split(address[0]))), text)


def _hide_link_secrets(link):
    """The text of one address of a chain, without its password and what stands behind a question mark."""
    scheme, separator, location = link.partition("://")
    if not separator:
        return link
    login, at_sign, host_path = location.rpartition("@")
    # A password may hold any sign; a path or a query with an @ and no colon before it is one.
    location = host_path if at_sign and (":" in login or "/" not in login) else location
    return f"{scheme}://{re.split(r'[?#]', location, maxsplit=1)[0]}"


#: Names of standard errors: what is left of each is the name of what has the error.
_ERROR_NAME = re.compile(r"(?:(?:formal_)?sigma|error)_(.+)|(.+)_error")


class Column(NamedTuple):
    """The meaning of a column: the words of the IVOA for it, and a sentence."""

    ucd: str
    meaning: str


@cache
def _read_column_meanings():
    with Path(__file__).with_name("columns.tsv").open(encoding="utf-8", newline="") as file:
        return [(row["column"], Column(row["UCD"], row["meaning"])) for row in csv.DictReader(file, delimiter="\t")]


def find_column_meaning(name: str, unit: object = None) -> Column | None:
    """Return the meaning of a column by its name and, where that is not enough, its unit; None where none is known."""
    for pattern, column in _read_column_meanings():
        if pattern == f"{name} [{unit}]" or fnmatchcase(name, pattern):
            return column
    match = _ERROR_NAME.fullmatch(name)
    measured_column = match and find_column_meaning(match[1] or match[2], unit)
    if not measured_column:
        return None
    ucd_words = [word for word in measured_column.ucd.split(";") if not word.startswith(("stat.", "meta."))]
    return Column(";".join(["stat.error", *ucd_words]), f"Standard error of this: {measured_column.meaning}")
