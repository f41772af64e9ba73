"""Sums whose order is fixed, so that the last bits do not depend on which part was ready first."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

#: So many sums are added up at a time, level by level.
BRANCHES = 8


def added(first: Any, second: Any) -> Any:
    """Two sums as one: None is nothing, dicts add key by key, tuples item by item, all else by `+`.

    Examples
    --------
    >>> added({"a": 1}, {"a": 2, "b": 3}), added((1, None), (2, 3))
    ({'a': 3, 'b': 3}, (3, 3))
    """
    if first is None or second is None:
        return second if first is None else first
    if isinstance(first, dict):
        keys = dict.fromkeys([*first, *second])
        return {key: added(first.get(key), second.get(key)) for key in keys}
    if isinstance(first, tuple):
        return tuple(added(one, two) for one, two in zip(first, second, strict=True))
    return first + second


def total_of(some: Iterable[Any]) -> Any:
    """The sum of a few, from the first to the last; None if there is none."""
    total = None
    for each in some:
        total = added(total, each)
    return total


class Tree:
    """A sum that is taken eight at a time, level by level, whatever computes the leaves and wherever.

    Examples
    --------
    >>> tree = Tree()
    >>> for leaf in range(100):
    ...     tree.add(leaf)
    >>> tree.total()
    4950
    """

    def __init__(self) -> None:
        self.levels: list[list[Any]] = [[]]

    def add(self, leaf: Any) -> None:
        """The next leaf, in the order of the parts."""
        level = 0
        while True:
            if level == len(self.levels):
                self.levels.append([])
            self.levels[level].append(leaf)
            if len(self.levels[level]) < BRANCHES:
                return
            leaf, self.levels[level] = total_of(self.levels[level]), []
            level += 1

    def total(self) -> Any:
        """The sum of all leaves; None if nothing was added."""
        carried: list[Any] = []
        for level in self.levels:
            nodes = level + carried
            carried = [total_of(nodes)] if nodes else []
        return carried[0] if carried else None


def label_of(piece: Any) -> str:
    """What a message calls a part."""
    if hasattr(piece, "__fspath__") or isinstance(piece, str):
        return str(piece)
    key = getattr(piece, "key", None)
    return str(key) if key is not None else f"a {type(piece).__name__}"
