"""Results as files, and back."""

from fit.storage._plain import coefficient_columns, count, decoded, encoded, exact, number, same, words
from fit.storage._result import Result, read

__all__ = [
    "Result",
    "read",
]
