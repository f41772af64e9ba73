"""Tables: files of every format, folders of them, and objects in memory, opened without being read.

Every way a file can be unreadable ends in a TableError that names it.
"""

from vsh.io.sections import cell, printed, printed_p_value, three_digits, two_digits
from vsh.io.tables._fits import fits_checked, fits_rows
from vsh.io.tables._open import STANDARD_INPUT, Place, as_table, files_of, is_address, mark_of, open_table, read_table
from vsh.io.tables._source import TableSource, cache_rows, check_alike
from vsh.io.tables._where import Where
from vsh.tools.files import CREATOR, check_writable, format_of, table_of, write, write_table

__all__ = ["open_table", "read_table", "write_table"]
