"""Tables as a reader wants them: errors in the cells of their values, digits by the error, units in the heads."""

import numpy as np
import pytest
from astropy.table import Table

from vsh.io.tables import format_table
from vsh.tools.digits import decimals_of_error, format_cell, format_three_digits


@pytest.mark.parametrize(
    ("value", "text"),
    [(1 / 3, "0.3333"), (204370.4, "204370"), (np.True_, "yes"), (None, ""), (12345, "12345"), ("x", "x")],
)
def test_cells(value, text):
    assert format_cell(value) == text


def test_value_has_two_digits_of_its_error():
    table = Table({"parameter": ["a", "b", "c"], "value": [-515.86, 0.01234, 3.0], "sigma": [266.44, 0.00567, np.nan]})
    heads, rows = format_table(table)
    assert heads == ["parameter", "value"]
    assert [row[1] for row in rows] == ["-516 ± 266", "0.0123 ± 0.0057", "3"]
    table = Table({"spin_x": [1.234e9, np.nan], "spin_x_error": [2e7, 1.0]})
    assert format_table(table)[1] == [["1.234e+09 ± 2e+07"], ["–"]]


def test_errors_have_the_digits_of_values():
    table = Table({"median": [85.812], "low68": [41.93], "mean": [88.01], "sigma": [43.8], "r_hat": [1.00123]})
    assert format_table(table)[1] == [["86", "42", "88", "44", "1.001"]]


def test_units_stand_in_the_heads_or_in_a_column():
    table = Table({"rate": [1.5], "unit": ["km / (s Mpc)"], "correlation_a_x": [0.12345]})
    table["rate"].unit = "uas / yr"
    heads, rows = format_table(table)
    assert heads == ["rate [µas/yr]", "unit", "r(a_x)"]
    assert rows == [["1.5", "km/s/Mpc", "+0.123"]]


@pytest.mark.parametrize(("sigma", "digits"), [(266.0, 0), (0.367, 2), (12.0, 0), (1.2, 1), (0.0, 3), ([0.02, 5.0], 3)])
def test_two_digits(sigma, digits):
    assert decimals_of_error(sigma) == digits


@pytest.mark.parametrize(("value", "text"), [(1128.3, "1128"), (19.02, "19.0"), (0.123456, "0.123"), (0.0, "0.00")])
def test_three_digits(value, text):
    assert format_three_digits(value) == text
