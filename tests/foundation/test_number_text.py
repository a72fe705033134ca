"""Numbers, angles and intervals as text."""

import math

import pytest

from qtraj.foundation.number_text import degrees, intervals, number


@pytest.mark.parametrize("value", [None, math.nan, math.inf])
def test_a_number_that_is_missing_is_a_dash(value):
    assert number(value) == degrees(value) == "-"


def test_numbers_and_angles():
    assert (number(1 / 3), number(1 / 3, 2, sign="+"), degrees(math.pi)) == ("0.333333", "+0.33", "180")


def test_further_intervals_are_counted():
    bounds = [(k, k + 0.5) for k in range(14)]
    assert intervals(bounds[:2]) == "0.00-0.50, 1.00-1.50"
    assert intervals(bounds).endswith("11.00-11.50 and 2 more")
