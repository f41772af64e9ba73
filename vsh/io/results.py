"""Whatever this project wrote, read back as what it was."""

import json
import re
from importlib import import_module
from typing import Any

from vsh.io import catalogue, tables
from vsh.tools.errors import TableError
from vsh.tools.files import RESULT_MARK
from vsh.tools.printing import printable
from vsh.tools.types import PathName

#: Modules whose names stand in older files, and what they are called today.
MOVED = {"fit.solving.frame": "fit.direct"}
#: The same of classes within them.
RENAMED = {
    "ByErrorClass": "ErrorClassFit", "ErrorsByRedshift": "VariancesByRedshift", "LeftOut": "OmittedFlow",
    "Lot": "ShapeDraws", "PreferredScale": "PreferredDispersion", "Share": "SourceWeights",
}  # fmt: skip
#: Modules whose results are read by their mark; a file cannot have anything else imported.
_OUR_MODULE = re.compile(r"(fit|sim|study)(\.\w+)+")


def read(path: PathName) -> Any:
    """Read a file that this project wrote: a result of a fit as that result, sources as a Field, else a table.

    Parameters
    ----------
    path : str or Path
        A result (ECSV or FITS), a field, or any other table.

    Raises
    ------
    TableError
        If the file cannot be read, or holds a result that is not as it was written.

    Examples
    --------
    >>> import tempfile
    >>> from vsh import Field, read
    >>> with tempfile.NamedTemporaryFile(suffix=".fits") as file:
    ...     Field([0.1], [0.2], [[1.0], [2.0]], [[1.0], [1.0]]).write(file.name, overwrite=True)
    ...     read(file.name)
    <Field: 1 sources, icrs, with name>
    """
    source = tables.open_table(path)
    mark = {str(key).upper(): value for key, value in source.meta.items()}.get(RESULT_MARK)
    if mark is None:
        return catalogue.read_field(path) if catalogue.has_field_columns(source.names) else tables.read_table(path)
    try:
        module_and_type = json.loads(mark)
        module, class_name = str(module_and_type["module"]), str(module_and_type["type"])
        if not _OUR_MODULE.fullmatch(module):
            raise ImportError
        return getattr(import_module(MOVED.get(module, module)), RENAMED.get(class_name, class_name)).read(path)
    except (KeyError, TypeError, ValueError, AttributeError, ImportError) as error:
        if isinstance(error, TableError):
            raise
        raise TableError(f"{printable(path)} holds a result that is not known here, or is damaged") from None
