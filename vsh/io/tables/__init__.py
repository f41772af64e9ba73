"""Tables: files of every format, folders of them, and objects in memory, opened without being read.

Every way a file can be unreadable ends in a TableError that names it.
"""

from vsh.io.sections import format_table
from vsh.io.tables._fits import count_fits_rows, open_checked_fits
from vsh.io.tables._open import (
    STANDARD_INPUT,
    RemotePath,
    as_table,
    files_of,
    fingerprint_of,
    is_address,
    open_table,
    read_table,
)
from vsh.io.tables._source import TableSource, as_table_error, cache_columns, check_layout, take_rows
from vsh.io.tables._where import Where
from vsh.tools.files import CREATOR, check_writable, format_of, table_of, table_of_rows, write_columns, write_table

__all__ = ["open_table", "read_table", "write_table"]
