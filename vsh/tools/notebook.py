"""What a notebook shows of a noun: what it is, and what it holds, a row each."""

import re
from dataclasses import fields, is_dataclass
from html import escape
from inspect import getattr_static
from typing import TYPE_CHECKING, Any, ClassVar, cast

import numpy as np

from vsh.tools.arguments import read_only

#: Longer texts are cut.
_WIDTH = 160


class InNotebook:
    """A noun's form in notebooks: its attributes in a table, arrays by shape and range, missing ones not at all."""

    #: Units of attributes, by name.
    units_shown: ClassVar[dict[str, str]] = {}

    if not TYPE_CHECKING:  # to whom every attribute would be one

        def __getattr__(self, name):
            if name.startswith("_"):
                raise AttributeError(name)
            if (attribute := getattr_static(type(self), name, None)) is not None:
                return attribute.__get__(self, type(self))  # a property whose own error is one of attributes
            from vsh.tools.errors import ATTRIBUTES, MissingAttribute

            # What is another name for one of ours, or for a call without anything to choose, is that.
            match = re.fullmatch(r'(\w+)(\((?:"(\w+)")?\))?', ATTRIBUTES.get(name, ""))
            if match and match[1] in dir(self):
                attribute = getattr(self, match[1])
                return attribute(*filter(None, [match[3]])) if match[2] else attribute
            raise MissingAttribute(name=name, obj=self)

    def _repr_html_(self) -> str:
        if type(self).__str__ is not object.__str__:  # it says itself what there is to say
            return f"<pre>{escape(str(self))}</pre>"
        names = [entry.name for entry in fields(self)] if is_dataclass(self) else list(vars(self))
        rows = {name: format_html_value(getattr(self, name)) for name in names if not name.startswith("_")}
        for name in rows.keys() & self.units_shown.keys():
            rows[name] = f"{rows[name]} {self.units_shown[name]}" if rows[name] else None
        return format_html_table(type(self).__name__, {**rows, **self._facts()}, heading=self._heading())

    def _heading(self) -> str:
        """Heading in one line; empty unless the class has a repr of its own in < >."""
        text = repr(self)  # dataclasses write their fields, which the rows say better; our own forms stand in < >
        return text.strip("<>") if text.startswith("<") and type(self).__repr__ is not object.__repr__ else ""

    def _facts(self) -> dict[str, str]:
        """Further rows, in HTML, by name."""
        return {}


def format_html_table(title: str, rows: dict[str, str | None], *, heading: str = "") -> str:
    """A table of two columns under a title."""
    cells = "".join(
        f'<tr><th style="text-align:left">{escape(name)}</th><td style="text-align:left">{value}</td></tr>'
        for name, value in rows.items()
        if value is not None
    )
    subtitle = heading.removeprefix(title).lstrip(": ")
    return f"<p><b>{escape(title)}</b>{': ' if subtitle else ''}{escape(subtitle)}</p><table>{cells}</table>"


def format_html_value(value: Any) -> str | None:
    """A value in a cell, in HTML: arrays by shape and range; None for what is missing, and for functions."""
    if value is None or (callable(value) and not hasattr(value, "_repr_html_")):
        return None
    if isinstance(value, np.ndarray):
        return escape(_describe_array(value))
    if type(value).__repr__ is object.__repr__:  # an address says nothing
        return None
    if isinstance(value, (float, np.floating)):
        return f"{value:.6g}"
    if isinstance(value, (tuple, list)) and all(isinstance(item, str) for item in value):
        return f"<ul>{''.join(f'<li>{escape(item)}</li>' for item in value)}</ul>" if value else None
    text = str(value)
    return escape(text if len(text) <= _WIDTH else f"{text[:_WIDTH]} …")


def _describe_array(values):
    if values.size <= 9 and values.dtype.kind in "iufb":
        return np.array2string(values, precision=5, separator=", ").replace("\n", "")
    shape = " × ".join(map(str, values.shape))
    if values.dtype.kind == "b":
        return f"{shape}, {values.sum()} true"
    if values.dtype.kind in "iuf" and np.isfinite(values).any():
        finite_values = values[np.isfinite(values)]
        n_missing = values.size - finite_values.size
        missing_text = f", {n_missing} missing" if n_missing else ""
        return f"{shape}, from {finite_values.min():.5g} to {finite_values.max():.5g}{missing_text}"
    return f"{shape}: {', '.join(map(str, values.ravel()[:3]))}{', …' if values.size > 3 else ''}"


class Frozen(InNotebook):
    """Base of frozen dataclasses that hold arrays: arrays, in lists and tuples too, become read-only views."""

    def __post_init__(self) -> None:
        self._set_frozen(**{entry.name: getattr(self, entry.name) for entry in fields(cast(Any, self))})

    def __setstate__(self, state):
        self._set_frozen(**state)  # NumPy gives back arrays that can be written to

    def _set_frozen(self, /, **values: Any) -> None:
        """Set attributes, arrays as read-only views: the caller's stay as they are."""
        for name, value in values.items():
            object.__setattr__(self, name, _freeze_arrays(value))


class Equal:
    """Base of dataclasses of arrays that are equal where all their numbers are; notes do not count."""

    def __eq__(self, other: object) -> bool:
        """Return whether another has the same numbers, names and frame."""
        if type(other) is not type(self):
            return NotImplemented
        names = [entry.name for entry in fields(cast(Any, self)) if entry.name != "notes"]
        return all(_is_same_attribute(getattr(self, name), getattr(other, name)) for name in names)

    def __hash__(self) -> int:
        """Return the hash of what two that are equal have in common."""
        return hash((type(self), getattr(self, "frame", None)))


def _is_same_attribute(value, other_value):
    """Return whether two attributes are the same, arrays number by number."""
    if not isinstance(value, np.ndarray) or not isinstance(other_value, np.ndarray):
        return type(value) is type(other_value) and value == other_value
    return np.array_equal(value, other_value, equal_nan=value.dtype.kind == other_value.dtype.kind == "f")


def _freeze_arrays(value):
    if isinstance(value, np.ndarray):
        return read_only(value)
    if type(value) in (list, tuple):
        return type(value)(map(_freeze_arrays, value))
    return value
