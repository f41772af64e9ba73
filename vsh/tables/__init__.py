"""Tables: files of every format, folders of them, and objects in memory, opened without being read.

Every way a file can be unreadable ends in a TableError that names it.
"""

from vsh.tables._fits import fits_checked
from vsh.tables._fits_layout import fits_rows
from vsh.tables._open import FORMATS, INPUT_FORMATS, STANDARD_INPUT, files_of, format_of, open_table
from vsh.tables._source import TableSource, check_alike
from vsh.tables._where import Where
from vsh.tables._write import as_table, check_writable, read, table_of, write, write_table

__all__ = [
    "FORMATS",
    "INPUT_FORMATS",
    "open_table",
    "read",
    "write_table",
]
