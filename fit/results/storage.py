"""Results as files, and back.

Results as tables, and back: ECSV or FITS, every bit of every number, readable by astropy alone.

What does not fit into columns stands as JSON under RESULT in the metadata: FITS headers keep
neither all digits of a number nor letters beyond ASCII.

Each kind of result says itself how it is packed; this file knows none of them by name. A file is
checked as strictly as a field is: what was written is what comes back, or an error that says what is wrong.
"""

from __future__ import annotations

import base64
import json
import re
import textwrap
import zlib
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass
from importlib import import_module
from typing import Any, Self, cast

import numpy as np

from vsh.io import tables
from vsh.io.results import MOVED, RENAMED
from vsh.io.sections import Answer, Section, as_json_value, text_of
from vsh.modes import Modes
from vsh.tools.errors import TableError, VshError
from vsh.tools.files import RESULT_MARK, check_overwrite_allowed
from vsh.tools.notebook import Frozen
from vsh.tools.notes import CodedNote
from vsh.tools.printing import printable
from vsh.tools.types import PathName, Table

__all__ = ["Result", "read"]


def is_same(first: Any, second: Any) -> bool:
    """Return whether two values, arrays and sequences of them among them, are equal; nan equals nan."""
    if isinstance(first, np.ndarray) or isinstance(second, np.ndarray):
        first, second = np.asarray(first), np.asarray(second)
        return first.shape == second.shape and np.array_equal(first, second, equal_nan=first.dtype.kind == "f")
    if isinstance(first, (list, tuple)) and isinstance(second, (list, tuple)):
        is_same_kind = getattr(first, "_fields", None) == getattr(second, "_fields", None)
        return is_same_kind and len(first) == len(second) and all(map(is_same, first, second))
    if isinstance(first, dict) and isinstance(second, dict):
        return [*first] == [*second] and all(is_same(first[key], second[key]) for key in first)
    if isinstance(first, float) and isinstance(second, float) and np.isnan(first):
        return bool(np.isnan(second))
    if is_dataclass(first) and not isinstance(first, type) and type(first) is type(second):
        return all(is_same(getattr(first, name), getattr(second, name)) for name in _list_attributes(type(first)) or ())
    return bool(first == second)


def encode_value(value: Any) -> Any:
    """A value as plain JSON, every bit of it: arrays as compressed bytes, results and nouns by their attributes."""
    if isinstance(value, np.ndarray):
        array = np.ascontiguousarray(value).astype(value.dtype.newbyteorder("<"))
        compressed_text = base64.b85encode(zlib.compress(array.tobytes(), 6)).decode()
        return {"array": compressed_text, "kind": array.dtype.str, "shape": list(array.shape)}
    if type(value).__module__.split(".")[0] in ("fit", "vsh") and (is_dataclass(value) or hasattr(value, "_fields")):
        about = {"type": type(value).__name__, "module": type(value).__module__}
        return about | {"fields": {name: encode_value(getattr(value, name)) for name in _list_attributes(type(value))}}
    if isinstance(value, np.bool_):
        return bool(value)
    if isinstance(value, (bool, int, np.integer)) or value is None:
        return value if value is None or isinstance(value, (bool, int)) else int(value)
    if isinstance(value, (float, np.floating)):
        return {"float": to_hex(float(value))}
    if isinstance(value, dict):
        return {"dict": [[encode_value(key), encode_value(item)] for key, item in value.items()]}
    if isinstance(value, (list, tuple)):
        return {"list" if isinstance(value, list) else "tuple": [encode_value(item) for item in value]}
    if isinstance(value, CodedNote) and value.code:
        return {"note": str(value), "code": value.code}
    return str(value)


def _list_attributes(record_class):
    """Names of what a dataclass or a NamedTuple is made with; None for anything else."""
    if is_dataclass(record_class):
        return [entry.name for entry in fields(record_class) if entry.init]
    is_tuple = isinstance(record_class, type) and issubclass(record_class, tuple) and hasattr(record_class, "_fields")
    return list(record_class._fields) if is_tuple else None


def decode_value(encoded: Any) -> Any:
    """Decode what `encode_value` wrote."""
    if not isinstance(encoded, dict):
        return encoded
    if "array" in encoded:
        dtype = np.dtype(encoded["kind"])
        shape = tuple(check_count(length) for length in encoded["shape"])
        if dtype.hasobject or dtype.itemsize * int(np.prod(shape, dtype=float)) > 2**34:
            raise TableError("an array")
        n_bytes = dtype.itemsize * int(np.prod(shape))
        try:
            raw_bytes = zlib.decompressobj().decompress(base64.b85decode(encoded["array"]), n_bytes + 1)
        except zlib.error as error:
            raise TableError(f"an array ({error})") from None
        if len(raw_bytes) != n_bytes:
            raise TableError("the size of an array")
        return np.frombuffer(raw_bytes, dtype).reshape(shape).astype(dtype.newbyteorder("="))
    if "float" in encoded:
        return from_hex(encoded["float"])
    if "note" in encoded:
        return CodedNote(str(encoded["note"]), str(encoded["code"]))
    if "dict" in encoded:
        return {decode_value(key): decode_value(item) for key, item in encoded["dict"]}
    if "list" in encoded:
        return [decode_value(item) for item in encoded["list"]]
    if "tuple" in encoded:
        return tuple(decode_value(item) for item in encoded["tuple"])
    if not re.fullmatch(r"(fit|vsh)(\.\w+)+", encoded["module"]):
        raise TableError(f"a {encoded['type']}")
    record_class: Any = _import_class(encoded["module"], encoded["type"])
    if _list_attributes(record_class) is None:
        raise TableError(f"a {encoded['type']}")
    return record_class(**{name: decode_value(item) for name, item in encoded["fields"].items()})


def _import_class(module, class_name):
    """Import a class from the module that a file names, or from the package that exports it."""
    module, class_name = MOVED.get(module, module), RENAMED.get(class_name, class_name)
    for module_name in (module, module.partition("._")[0]):
        with suppress(ImportError, AttributeError):
            return getattr(import_module(module_name), class_name)
    raise TableError(f"a {class_name}")


def make_coefficient_columns(modes: Modes) -> dict[str, list[Any]]:
    """The columns that name each coefficient."""
    mode_list = list(modes)
    return {
        "coefficient": [str(mode) for mode in mode_list],
        "kind": [mode.kind for mode in mode_list],
        "l": [mode.l for mode in mode_list],
        "m": [mode.m for mode in mode_list],
        "part": [mode.part or "-" for mode in mode_list],
    }


def to_hex(number: Any) -> str:
    """A number in hexadecimal: every bit, nan and inf among them."""
    return float(number).hex()


def from_hex(text: Any) -> Any:
    """Convert what `to_hex` wrote to a number; return anything but text as it is."""
    return float.fromhex(text) if isinstance(text, str) else text


def check_strings(values: Any) -> tuple[str, ...]:
    """A list of strings, checked, as a tuple."""
    if not isinstance(values, list) or not all(isinstance(value, str) for value in values):
        raise TableError(f"a list of words is expected, not {values!r}")
    return tuple(values)


def check_count(value: Any) -> int:
    """A whole number of at least zero, checked."""
    if isinstance(value, bool) or not isinstance(value, int) or value < 0:
        raise TableError(f"{value!r} is no count")
    return value


#: Kinds of results whose modules have been imported, by name.
_RESULT_CLASSES: dict[str, type[Result]] = {}
#: A file names the module of its kind; none but ours is ever imported.
_OUR_MODULES = re.compile(r"fit(\.\w+)+")


class Result(Frozen):
    """Base of all results: report, table, figure, file, notebook.

    A class gives `_sections(long)`, `plot()` and, where its arrays are not its table, `to_table()`. It is packed
    attribute by attribute unless it says otherwise: `_pack()` → (columns, the rest as plain values, units of
    columns) and the class method `_unpack(columns, rest)`, which may raise anything on what is not right.
    """

    def sections(self, *, long: bool = False) -> tuple[Section, ...]:
        """The parts of the result that its text, page and files are made from.

        Parameters
        ----------
        long : bool
            Everything there is to say, and not only what most readers need.
        """
        return self._sections(long)

    def _sections(self, long):
        raise NotImplementedError

    def report(self, *, long: bool = False, **about: Any) -> str:
        """The result as text: the lines to quote, and the sections.

        Parameters
        ----------
        long, **about
            As for `sections`.
        """
        answer: Any = getattr(self, "answer", Answer())
        return "\n\n".join([str(answer)] * bool(answer.lines) + [text_of(self.sections(long=long, **about))])

    def plot(self, *, ax: Any = None) -> Any:  # axes, or an array of them: each result says which
        """The result on matplotlib axes.

        Parameters
        ----------
        ax : matplotlib axes, or as many as there are panels, optional
            Where to draw; a new figure unless given.
        """
        raise NotImplementedError

    def to_table(self) -> Table:
        """The result as an astropy Table: the columns that `write` writes."""
        columns, _, units = self._pack()
        return tables.table_of(columns, self._plain_facts(), units)

    def summary(self) -> Table:
        """The result as an astropy Table: `to_table`."""
        return self.to_table()

    def to_dict(self) -> dict[str, Any]:
        """The lines to quote, the notes and `to_table` as plain values; numbers that are not finite are None."""
        answer: Any = getattr(self, "answer", Answer())
        contents = {"type": type(self).__name__, "answer": dict(answer.lines), "notes": getattr(self, "notes", ())}
        return {name: as_json_value(value) for name, value in (contents | {"table": self.to_table()}).items()}

    def to_json(self) -> str:
        """Write `to_dict` as a JSON document."""
        return json.dumps(self.to_dict(), ensure_ascii=False, allow_nan=False)

    def __repr__(self) -> str:
        """Name and attributes in one line, arrays by their shapes."""
        attributes = [f"{entry.name} {_format_short(getattr(self, entry.name))}" for entry in fields(cast(Any, self))]
        return f"<{type(self).__name__}: {textwrap.shorten(', '.join(attributes), 200, placeholder=' …')}>"

    def _repr_html_(self) -> str:
        """The lines to quote and the sections, for a notebook."""
        from vsh.figures import page

        answer: Any = getattr(self, "answer", Answer())
        panels = [page.facts_panel(answer.lines), *map(page.section_panel, self.sections())]
        return "\n".join(panel.html for panel in panels)

    def _plain_facts(self):
        """Facts for the header of the table."""
        facts = {"frame": getattr(self, "frame", None), "n_data": getattr(self, "n_data", None)}
        return {key: value for key, value in facts.items() if isinstance(value, str | int)}

    def _pack(self):
        table = type(self).to_table(self)
        columns = {name: np.asarray(table[name]) for name in table.colnames}
        units = {name: str(table[name].unit) for name in table.colnames if table[name].unit is not None}
        attributes = {entry.name: encode_value(getattr(self, entry.name)) for entry in fields(cast(Any, self))}
        return columns, {"fields": attributes}, units

    @classmethod
    def _unpack(cls, columns, metadata):
        stored_fields = metadata["fields"]  # an older version may not have had a field with a default
        entries = [entry for entry in fields(cast(Any, cls)) if entry.name in stored_fields or entry.default is MISSING]
        return cls(**{entry.name: decode_value(stored_fields[entry.name]) for entry in entries})

    def __init_subclass__(cls, **options):
        super().__init_subclass__(**options)
        if "__repr__" not in cls.__dict__:  # or a dataclass writes its own, with every number of every array
            cls.__repr__ = cls.__repr__  # type: ignore[method-assign]
        _RESULT_CLASSES[cls.__name__] = cls

    def write(self, path: PathName, meta: dict[str, Any] | None = None, *, overwrite: bool = False) -> None:
        """Write to an ECSV or FITS file, which takes its name when it is complete.

        Parameters
        ----------
        path : str or Path
            The file.
        meta : dict, optional
            Provenance, plain values.
        overwrite : bool
            Whether a file that is there is replaced.

        Raises
        ------
        TableError
            If the name ends otherwise.
        WriteError
            If the file exists, and is not to be replaced.
        """
        _check_file_suffix(path)
        check_overwrite_allowed(path, overwrite)
        columns, metadata, units = self._pack()
        result_mark = json.dumps({"type": type(self).__name__, "module": type(self).__module__} | metadata)
        header_facts = self._plain_facts()
        if getattr(self, "notes", None) and tables.format_of(path) == "ascii.ecsv":  # a FITS header has no lists
            header_facts["notes"] = list(map(str, getattr(self, "notes", ())))
        tables.write_columns(path, columns, header_facts | (meta or {}) | {RESULT_MARK: result_mark}, units, overwrite)

    @classmethod
    def read(cls, path: PathName) -> Self:
        """Read what `write` wrote, bit for bit.

        Parameters
        ----------
        path : str or Path
            An ECSV or FITS file.

        Raises
        ------
        TableError
            If the file holds no result, one of another kind, or one that is not as it was written.
        """
        result = read(path)
        if not isinstance(result, cls):
            raise TableError(
                f"{printable(path)} holds a {type(result).__name__}, not a {cls.__name__}: fit.storage.read takes "
                "either"
            )
        return result

    def __eq__(self, other: object) -> bool:
        """Return whether two results are of one kind and the same in every number."""
        if type(other) is not type(self):
            return NotImplemented
        return all(is_same(getattr(self, entry.name), getattr(other, entry.name)) for entry in fields(cast(Any, self)))

    def __hash__(self) -> int:
        return hash((type(self).__name__, repr(self)))


def _format_short(value):
    """A value in a few letters: arrays and sequences by their sizes."""
    if isinstance(value, np.ndarray):
        return f"({' × '.join(map(str, value.shape))})"
    if isinstance(value, (list, tuple, dict)) and len(value) > 3:
        return f"({len(value)})"
    return f"{value:.6g}" if isinstance(value, float) else str(value)


def read(path: PathName) -> Result:
    """Read any result that was written to a file.

    Parameters
    ----------
    path : str or Path
        An ECSV or FITS file.

    Raises
    ------
    TableError
        If the file holds none, or one that is not as it was written.
    """
    _check_file_suffix(path)
    table, file_name = tables.read_table(path), printable(path)
    try:
        metadata = json.loads({key.upper(): value for key, value in table.meta.items()}[RESULT_MARK])
        type_name, module = str(metadata.pop("type")), str(metadata.pop("module"))
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError, ImportError):
        raise TableError(f"{file_name} holds no result of a fit: it lacks its mark, RESULT, in the metadata") from None
    try:
        result_class = _find_result_class(type_name, module)
    except (KeyError, ImportError):
        raise TableError(
            f"{file_name} holds a {printable(type_name)} of the module {printable(module)}, which is not known here: "
            "import it first"
        ) from None
    try:
        columns = {name: _convert_to_native_array(name, table[name]) for name in table.colnames}
        result = result_class._unpack(columns, metadata)
        _check_packed_columns(result, columns, table)
    except (VshError, KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError) as error:
        reason = f"{error} is missing" if isinstance(error, KeyError) else str(error)
        raise TableError(
            f"{file_name} is damaged: its {type_name} is not as it was written ({printable(reason)[:300]})"
        ) from error
    return result


def _find_result_class(class_name, module):
    if class_name not in _RESULT_CLASSES and _OUR_MODULES.fullmatch(module):
        with suppress(TableError):
            _import_class(module, class_name)
    return _RESULT_CLASSES[class_name]


def _check_packed_columns(result, read_columns, table):
    """Packed again, the result must give the columns that were read, in their order and units."""
    from astropy.units import Unit

    packed_columns, _, units = result._pack()
    if set(packed_columns) != set(read_columns):
        raise TableError(f"columns {', '.join(sorted(set(packed_columns) ^ set(read_columns)))}")
    for name, values in packed_columns.items():
        if not is_same(np.asarray(values).astype(read_columns[name].dtype), read_columns[name]):
            raise TableError(f"column {name} does not go with the others")
        unit, expected_unit = table[name].unit, units.get(name)
        if (unit is None) != (expected_unit is None) or (expected_unit is not None and unit != Unit(expected_unit)):
            raise TableError(f"column {name} is in {unit}, not in {expected_unit}")


def _check_file_suffix(path):
    lower_name = str(path).lower().removesuffix(".gz")
    if not lower_name.endswith((".ecsv", ".fits", ".fit")):
        raise TableError(f"{printable(path)}: results are written as .ecsv or .fits, which keep every bit")


def _convert_to_native_array(name, column):
    if np.any(getattr(column, "mask", False)):
        raise TableError(f"{np.sum(column.mask)} values of column {name} are missing")
    array = np.asarray(column)
    return array.astype(array.dtype.newbyteorder("=")) if array.dtype.kind in "fi" else array.astype(str)
