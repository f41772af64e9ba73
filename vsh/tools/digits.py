"""Numbers as they are printed everywhere: digits by the error, and no minus before what is rounded to zero."""

from collections.abc import Iterable
from typing import Any

import numpy as np


def decimals_of_error(errors: Any) -> int:
    """Decimals by which the smallest error has two digits, 0 to 6."""
    smallest_error = np.min(errors, initial=np.inf, where=np.asarray(errors) > 0)
    return int(np.clip(1 - np.floor(np.log10(smallest_error)), 0, 6)) if np.isfinite(smallest_error) else 3


def format_with_error(value: Any, error: Any, sign: str = "") -> str:
    """A value with its error, of which two digits are printed; `sign` "+" prints a sign of positive values, too."""
    value, error = (float(x) if isinstance(x, (int, np.number)) else x for x in (value, error))
    if not (isinstance(value, float) and isinstance(error, float) and np.isfinite(value) and error > 0):
        return format_to_error_digits(value, error)
    if not 1e-6 < error < 1e6:
        return f"{value:{sign}.5g} ± {error:.2g}"
    decimals = decimals_of_error(error)
    return f"{value:{sign}z.{decimals}f} ± {error:.{decimals}f}"


def format_values(values: Iterable[float], errors: Any) -> tuple[str, ...]:
    """Values with their errors, all with the decimals of the smallest error; an error alone where a value is nan."""
    if np.isnan(errors).all():  # errors are not known
        return tuple(f"{v:+.4g}" for v in values)
    if not 1e-6 < np.nanmax(errors) < 1e6:
        return tuple(f"{v:+.5g} ± {s:.2g}" for v, s in zip(values, errors, strict=True))
    decimals, pairs = decimals_of_error(errors), zip(values, errors, strict=True)
    return tuple(f"± {s:.{decimals}f}" if np.isnan(v) else f"{v:+z.{decimals}f} ± {s:.{decimals}f}" for v, s in pairs)


def format_to_error_digits(value: Any, error: Any) -> str:
    """A value with the decimals that its error would have."""
    has_error = isinstance(value, float) and isinstance(error, float) and np.isfinite(value) and 1e-6 < error < 1e6
    return f"{value:z.{decimals_of_error(error)}f}" if has_error else format_cell(value)


def format_three_digits(value: float) -> str:
    """Three digits at least, and no power of ten for what is large."""
    return f"{value:.0f}" if abs(value) >= 100 else f"{value:#.3g}"


def format_p_value(p: float) -> str:
    """A probability as it is printed."""
    return f"{p:.4f}" if p > 1e-3 else f"{p:.1e}" if p > 0 else "<1e-300" if p == 0 else "–"


def format_simulated_p_value(p_value: float, n_skies: int) -> str:
    """Format a p-value from `n_skies` simulated skies, with "at most" if none of them reached the value."""
    return "at most " * is_reached_by_no_sky(p_value, n_skies) + format_p_value(p_value)


def is_reached_by_no_sky(p_value: float, n_skies: int) -> bool:
    """Return whether none of the simulated skies reached the value."""
    return p_value * (1 + n_skies) < 1.5


def format_cell(value: Any, digits: int = 4) -> str:
    """A value of a table as text: numbers to so many digits, and all digits of what is larger."""
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        if not np.isfinite(value):
            return "–"
        return f"{value:.0f}" if 10.0**digits <= abs(float(value)) < 1e9 else f"{value:.{digits}g}"
    return "" if value is None else str(value)
