"""Tables: files of every format, folders of them, and objects in memory, opened without being read.

Every way a file can be unreadable ends in a TableError that names it.
"""

from vsh.system.writing import CREATOR, FORMATS, check_writable, format_of, table_of, write, write_table
from vsh.tables._fits import fits_checked
from vsh.tables._fits_layout import fits_rows
from vsh.tables._open import INPUT_FORMATS, STANDARD_INPUT, files_of, open_table
from vsh.tables._source import TableSource, check_alike
from vsh.tables._where import Where
from vsh.tables._write import as_table, read

__all__ = [
    "FORMATS",
    "INPUT_FORMATS",
    "open_table",
    "read",
    "write_table",
]
