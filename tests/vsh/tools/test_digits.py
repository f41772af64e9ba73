"""Numbers as they are printed: digits by the error, one way for values, components and errors alone."""

import numpy as np
import pytest

from vsh.tools.digits import format_to_error_digits, format_values, format_with_error


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (5.1342, 0.3581, "5.13 ± 0.36"), (-0.004, 0.12, "0.00 ± 0.12"), (0.06, 12.3, "0 ± 12"), (-0.4, 12.3, "0 ± 12"),
        (-5.5, 2.2, "-5.5 ± 2.2"), (12345.6, 123.0, "12346 ± 123"), (1e-9, 1e-8, "1e-09 ± 1e-08"), (3.0, 0.0, "3"),
        (2.0, float("nan"), "2"), (float("nan"), 1.0, "–"),
    ],
)  # fmt: skip
def test_value_with_its_error(value, error, text):
    assert format_with_error(value, error) == text
    signed = format_with_error(value, error, "+")
    assert signed.lstrip("+") == text
    assert signed.startswith("+") == (value >= 0 and error > 0) or text.startswith("0")


def test_components_have_the_decimals_of_the_smallest_error():
    assert format_values([1.234, -0.0004, 20.0], [0.5, 0.043, 1.0]) == (
        "+1.234 ± 0.500",
        "+0.000 ± 0.043",
        "+20.000 ± 1.000",
    )
    assert format_values([np.nan] * 2, [0.5, 1.0]) == ("± 0.50", "± 1.00")
    assert format_values([1.5, -2.0], [np.nan, np.nan]) == ("+1.5", "-2")
    assert format_to_error_digits(-0.001, 0.2) == "0.00"
