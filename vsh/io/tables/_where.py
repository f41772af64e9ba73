"""Conditions on the columns of a table, as one types them: a closed list of operators, over Python's own parser."""

import ast
import operator
import os
from collections.abc import Callable, Iterator, Mapping
from difflib import get_close_matches
from functools import lru_cache
from typing import Any

import numpy as np

from vsh.tools.errors import TableError
from vsh.tools.notebook import InNotebook
from vsh.tools.printing import printable
from vsh.tools.types import BoolArray, FloatArray

#: What may be called. `column("e_pm-RA")` names a column whose name is no word, `ismissing(redshift)` asks for gaps.
FUNCTIONS: dict[str, Callable[..., Any]] = {
    name: getattr(np, name)
    for name in ("abs", "sqrt", "exp", "log", "log10", "hypot", "sin", "cos", "tan", "radians", "degrees", "floor")
}
_ARITHMETIC = {ast.Add: np.add, ast.Sub: np.subtract, ast.Mult: np.multiply, ast.Div: np.divide, ast.Mod: np.mod,
            ast.FloorDiv: np.floor_divide}  # fmt: skip
_COMPARISONS = {
    ast.Lt: operator.lt, ast.LtE: operator.le, ast.Gt: operator.gt, ast.GtE: operator.ge,
    ast.Eq: operator.eq, ast.NotEq: operator.ne,
}  # fmt: skip
#: What keeps the parser and the stack safe; members of a list behind `in` count little, since they are no expressions.
MAX_LENGTH, MAX_PARTS, MAX_DEPTH, MAX_POWER = 10**6, 2000, 100, 20.0
#: A list of names in a file has at most so many bytes.
MAX_LIST = 2**28


#: From here on a float does not hold every integer.
_EXACT = 2**53
#: What is calculated of integers as integers.
_INTEGER_FUNCTIONS = (np.mod, np.floor_divide, np.negative, np.positive, np.abs)


def _calculate_numbers(function, operands, is_missing):
    """Calculate numbers of rows, exact for remainders and whole quotients of integers, and where they are undefined."""
    if function in _INTEGER_FUNCTIONS and all(operand.dtype.kind in "iu" for operand in operands):
        if any(operand.dtype == np.uint64 for operand in operands) and all((x >= 0).all() for x in operands):
            operands = [operand.astype(np.uint64) for operand in operands]
        if len(operands) == 1:
            return function(operands[0]), np.False_
        is_zero = operands[1] == 0
        return function(operands[0], np.where(is_zero, 1, operands[1])), is_zero
    if function is not np.divide:
        for operand in operands:
            known = np.where(is_missing, 0, operand) if operand.dtype.kind in "iu" and operand.ndim else operand
            if known.dtype.kind in "iu" and known.size and max(int(known.max()), -int(known.min())) > _EXACT:
                raise TableError(
                    "--where: a number has more than 53 bits, of which this calculation would lose some: of such "
                    "integers there are exact comparisons, remainders (%) and whole quotients (//) by integers"
                )
    numbers = function(*(np.asarray(operand, float) for operand in operands))
    return numbers, np.isnan(numbers)


class Where(InNotebook):
    """A condition on the rows of a table."""

    def __init__(self, text: str) -> None:
        self.text = " ".join(str(text).split())
        if not self.text or len(self.text) > MAX_LENGTH:
            raise TableError(f"--where is a condition of at most {MAX_LENGTH} characters, not {len(self.text)}")
        try:
            self._tree = ast.parse(self.text, mode="eval").body
        except (SyntaxError, ValueError, MemoryError, RecursionError) as error:
            raise TableError(
                f"--where {self.shown!r} cannot be understood: {getattr(error, 'msg', error)}. A range is 0 < dec < 1, "
                "two conditions are (a > 1) & (b < 2)"
            ) from None
        _check_condition_size(self._tree)
        self.names = tuple(dict.fromkeys(self._check_and_list_columns(self._tree)))

    @property
    def shown(self) -> str:
        """The condition as messages have it; a long one cut short."""
        return printable(self.text if len(self.text) <= 200 else f"{self.text[:150]} … {self.text[-40:]}")

    def check(self, names: tuple[str, ...], label: str) -> None:
        """Raise TableError unless a table has all columns; the message names the nearest."""
        for name in [name for name in self.names if name not in names]:
            nearest_names = [column for column in names if column.lower() == name.lower()]
            nearest_names = nearest_names or get_close_matches(name, names, 3, 0.6)
            name_list = ", ".join(map(printable, nearest_names or names[:50]))
            hint = f"; nearest: {name_list}" if nearest_names else f". It has {name_list}"
            raise TableError(
                f"--where: {label} has no column {printable(name)!r}{hint}. Conditions take the table's own names"
            )

    def calculate(self, block: Mapping[str, Any]) -> FloatArray:
        """Calculate numbers of the columns; nan where one is missing."""
        with np.errstate(all="ignore"):
            value, is_missing = self._evaluate_node(self._tree, block)
        if np.asarray(value).dtype.kind not in "iuf":
            raise TableError(f"{self.shown!r} is a condition or a text, not a number")
        return np.where(is_missing, np.nan, np.asarray(value, float))

    def select_rows(self, block: Mapping[str, Any]) -> tuple[BoolArray, BoolArray]:
        """Select rows: the mask of the selected ones, and of rows with missing values, which are not selected."""
        n_rows = len(next(iter(block.values()))[0])
        with np.errstate(all="ignore"):
            value, missing = self._evaluate_node(self._tree, block)
        value = _read_truth(value)
        if value.dtype != bool:
            raise TableError(f"--where {self.shown!r} is a number or a text, not a condition: compare it, < 19 say")
        value, missing = np.broadcast_to(value, n_rows), np.broadcast_to(missing, n_rows)
        return value & ~missing, missing.copy()

    def _check_and_list_columns(self, node) -> Iterator[str]:
        """List the columns, in order; raise TableError where there is something that is not allowed."""
        inner: list[ast.expr] = []
        match node:
            case ast.Constant(value=bool() | int() | float() | str()):
                pass
            case (
                ast.Name(id=name)
                | ast.Call(func=ast.Name(id="column"), args=[ast.Constant(value=str() as name)], keywords=[])
            ):
                yield name
            case ast.Call(func=ast.Name(id=name), args=inner, keywords=[]) if name in FUNCTIONS or name == "ismissing":
                if len(inner) != (2 if name == "hypot" else 1):
                    raise TableError(f"--where: {name}() takes {2 if name == 'hypot' else 1} argument")
            case ast.UnaryOp(op=ast.USub() | ast.UAdd() | ast.Not() | ast.Invert(), operand=operand):
                inner = [operand]
            case ast.BinOp(left=left, op=op, right=right) if type(op) in (*_ARITHMETIC, ast.Pow, ast.BitAnd, ast.BitOr):
                if isinstance(op, ast.Pow) and not _is_small_power(right):
                    raise TableError(f"--where: a power is a number between −{MAX_POWER:g} and {MAX_POWER:g}")
                inner = [left, right]
            case ast.BoolOp(values=inner):
                pass
            case ast.Compare(left=left, ops=ops, comparators=comparators):
                inner = [left]
                for comparison, value in zip(ops, comparators, strict=True):
                    if isinstance(comparison, ast.In | ast.NotIn):
                        if _find_list_file(value) is not None:
                            read_name_list(_find_list_file(value))  # what is wrong with it is said before rows are read
                            continue
                        if not isinstance(value, ast.Tuple | ast.List) or not value.elts:
                            raise TableError("--where: what stands behind `in` is a list: in (1, 2)")
                        inner += value.elts
                    elif type(comparison) in _COMPARISONS:
                        inner.append(value)
                    else:
                        raise _make_refusal(node)
            case _:
                raise _make_refusal(node)
        for value in inner:
            yield from self._check_and_list_columns(value)

    def _evaluate_node(self, node, block):
        """Evaluate a node: its values, and the mask of those that are not known."""
        match node:
            case ast.Constant(value=value):
                return value, np.False_
            case ast.Name(id=name) | ast.Call(func=ast.Name(id="column"), args=[ast.Constant(value=name)]):
                return _convert_to_comparable(*block[name])
            case ast.Call(func=ast.Name(id="ismissing"), args=[inner]):
                _, missing = self._evaluate_node(inner, block)
                return np.asarray(missing), np.False_
            case ast.Call(func=ast.Name(id=name), args=args):
                return self._apply(FUNCTIONS[name], args, block)
            case ast.UnaryOp(op=ast.Not() | ast.Invert(), operand=inner):
                value, missing = self._evaluate_condition(inner, block)
                return ~value, missing
            case ast.UnaryOp(op=op, operand=inner):
                return self._apply(np.negative if isinstance(op, ast.USub) else np.positive, [inner], block)
            case ast.BinOp(left=left, op=ast.BitAnd() | ast.BitOr() as op, right=right):
                return self._join_conditions(isinstance(op, ast.BitAnd), [left, right], block)
            case ast.BinOp(left=left, op=op, right=right):
                return self._apply(np.power if isinstance(op, ast.Pow) else _ARITHMETIC[type(op)], [left, right], block)
            case ast.BoolOp(op=op, values=values):
                return self._join_conditions(isinstance(op, ast.And), values, block)
            case ast.Compare():
                return self._evaluate_comparison(node, block)

    def _apply(self, function, nodes, block):
        operands = [self._evaluate_node(node, block) for node in nodes]
        for node, (value, _) in zip(nodes, operands, strict=True):
            if np.asarray(value).dtype.kind not in "iufb":
                raise TableError(f"--where: {printable(ast.unparse(node))} is text, not a number")
        missing = np.logical_or.reduce(np.broadcast_arrays(*(is_missing for _, is_missing in operands)))
        value, undefined = _calculate_numbers(function, [np.asarray(value) for value, _ in operands], missing)
        return value, undefined | missing

    def _evaluate_condition(self, node, block):
        value, missing = self._evaluate_node(node, block)
        value = _read_truth(value)
        if value.dtype != bool:
            raise TableError(
                f"--where: {printable(ast.unparse(node))} is no condition; & and | bind closer than <: put parentheses,"
                " or say and, or"
            )
        return value, np.asarray(missing)

    def _join_conditions(self, is_and, nodes, block):
        """Kleene's logic: what is false whatever the missing value is, is false."""
        conditions = [self._evaluate_condition(node, block) for node in nodes]
        value, missing = conditions[0]
        for operand, is_unknown in conditions[1:]:
            decisive = [((a if not is_and else ~a) & ~b) for a, b in ((value, missing), (operand, is_unknown))]
            missing = (missing | is_unknown) & ~(decisive[0] | decisive[1])
            value = value & operand if is_and else value | operand
        return value, missing

    def _evaluate_comparison(self, node, block):
        value, missing = np.True_, np.False_
        left = self._evaluate_node(node.left, block)
        for op, comparator in zip(node.ops, node.comparators, strict=True):
            if isinstance(op, ast.In | ast.NotIn):
                right, (is_true, is_missing) = left, self._evaluate_membership(left, comparator, node, block)
                is_true = ~is_true if isinstance(op, ast.NotIn) else is_true
            else:
                right = self._evaluate_node(comparator, block)
                is_true, is_missing = _compare_operands(op, left, right, node), left[1] | right[1]
            value, missing, left = value & is_true, missing | is_missing, right
        return np.asarray(value, bool), missing

    def _evaluate_membership(self, left, members, node, block):
        """Find whether each value is one of a list, or of the names in a file; and where that is not known."""
        path = _find_list_file(members)
        if path is not None:
            return np.isin(left[0], _convert_listed_names(left[0], read_name_list(path), path)), left[1]
        constants = [member.value for member in members.elts if isinstance(member, ast.Constant)]
        text_flags = {isinstance(value, str) for value in constants}
        is_text = np.asarray(left[0]).dtype.kind in "US"
        if len(constants) == len(members.elts) and text_flags == {is_text}:
            return np.isin(left[0], np.array(constants)), left[1]
        operands = [self._evaluate_node(member, block) for member in members.elts]
        is_equal = [_compare_operands(ast.Eq(), left, operand, node) & ~operand[1] for operand in operands]
        is_true = np.logical_or.reduce(np.broadcast_arrays(*is_equal))
        unknown = np.logical_or.reduce(np.broadcast_arrays(*(missing for _, missing in operands), is_true)) & ~is_true
        return is_true, left[1] | unknown


def _check_condition_size(tree):
    """Raise TableError where a condition is too large or too deep for the functions that walk through it."""
    n_nodes, todo = 0, [(tree, 1)]
    while todo:
        node, depth = todo.pop()
        n_nodes += 1
        if depth > MAX_DEPTH or n_nodes > MAX_PARTS:
            raise TableError(
                f"--where: a condition has at most {MAX_PARTS} parts, and {MAX_DEPTH} within each other; a long list "
                "of names goes into a file: name in file('list.txt')"
            )
        inner = ast.iter_child_nodes(node)
        todo += [(child, depth + 1) for child in inner if not isinstance(child, ast.Constant | ast.Load | ast.operator)]


def _find_list_file(node):
    """Find the path in file('list.txt'); None of anything else."""
    match node:
        case ast.Call(func=ast.Name(id="file"), args=[ast.Constant(value=str() as path)], keywords=[]):
            return path
    return None


def read_name_list(path: str) -> tuple[str, ...]:
    """Read the names in a file, one a line; what stands behind a # is no name."""
    try:
        stat = os.stat(path)
        if not os.path.isfile(path) or stat.st_size > MAX_LIST:
            raise TableError(f"--where: {printable(path)} is no list of names, one a line")
        return _read_cached_names(os.path.abspath(path), stat.st_mtime_ns, stat.st_size)
    except OSError as error:
        raise TableError(f"--where: {printable(path)} cannot be read: {error.strerror}") from None


@lru_cache(8)
def _read_cached_names(path, *_):
    try:
        with open(path, encoding="utf-8-sig") as file:
            listed_names = tuple(name for line in file if (name := line.partition("#")[0].strip().strip("\"'")))
    except UnicodeDecodeError:
        raise TableError(f"--where: {printable(path)} is no text in UTF-8") from None
    if not listed_names:
        raise TableError(f"--where: {printable(path)} holds no names")
    return listed_names


def _convert_listed_names(values, names, path):
    """Convert the names of a list to what the column holds, numbers or text."""
    type_code = np.asarray(values).dtype.kind
    if type_code in "US":
        return np.array(names)
    try:
        return np.array(names).astype(np.asarray(values).dtype if type_code in "iu" else float)
    except (ValueError, OverflowError):
        raise TableError(f"--where: the column holds numbers, and {printable(path)} has lines that are none") from None


def _compare_operands(op, left, right, node):
    operand_types = {"text" if np.asarray(operand).dtype.kind in "USO" else "number" for operand, _ in (left, right)}
    if len(operand_types) > 1:
        text = next(np.ravel(operand)[:1] for operand, _ in (left, right) if np.asarray(operand).dtype.kind in "USO")
        example = f": {printable(text[0])} is a text" if text.size else ""
        raise TableError(f"--where: {printable(ast.unparse(node))} compares a text with a number{example}")
    left_value, right_value = (_convert_to_integer(a, b) for a, b in ((left[0], right[0]), (right[0], left[0])))
    return np.asarray(_COMPARISONS[type(op)](left_value, right_value), bool)


def _convert_to_integer(value, other_value):
    """Convert a whole number that is compared with integers to one of them: 3e18 has no digit too few."""
    is_whole = isinstance(value, float) and value.is_integer() and abs(value) < 2**62
    return int(value) if is_whole and np.asarray(other_value).dtype.kind in "iu" else value


def _convert_to_comparable(values, mask):
    values = np.asarray(values)
    is_missing = np.zeros(len(values), bool) if mask is None else np.array(mask, bool)
    if values.dtype.kind == "f":
        is_missing = is_missing | np.isnan(values)
    elif values.dtype.kind == "O":
        is_missing = is_missing | np.array([value is None or value != value for value in values])
        values = np.array(["" if missing else str(entry) for entry, missing in zip(values, is_missing, strict=True)])
    elif values.dtype.kind == "S":
        values = np.char.decode(values, "utf-8", "replace")
    return values, is_missing


def _read_truth(value):
    """A condition from words that are true or false throughout, as CSV has them; everything else as it is."""
    value = np.asarray(value)
    words = np.char.lower(value) if value.dtype.kind == "U" else np.array("other")
    return words == "true" if np.isin(words, ("true", "false", "")).all() else value


def _is_small_power(node):
    node = node.operand if isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub) else node
    return isinstance(node, ast.Constant) and isinstance(node.value, int | float) and abs(node.value) <= MAX_POWER


def _make_refusal(node):
    return TableError(
        f"--where: {printable(ast.unparse(node))[:80]} is not allowed; there are columns, numbers, text, comparisons, "
        f"and, or, not, in, column(), ismissing(), file(), {', '.join(f'{name}()' for name in FUNCTIONS)}"
    )
