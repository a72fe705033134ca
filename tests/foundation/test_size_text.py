"""Lengths and durations are printed in the unit of their size."""

import math

import pytest

from qtraj.foundation.size_text import duration_text, length_text


@pytest.mark.parametrize(
    ("length", "text"),
    [
        (0.0, "0 m"),
        (9.0, "9.0 m"),
        (3e-6, "3.0 µm"),
        (0.0231, "23.1 mm"),
        (999.9, "999.9 m"),
        (8123.4, "8.123 km"),
        (-12.5, "-12.5 m"),
        (1.5e12, "1.500e+09 km"),
        (123456.0, "123.5 km"),
        (-3.0, "-3.0 m"),
        (math.nan, "unknown"),
        (math.inf, "infinite"),
        (-math.inf, "-infinite"),
    ],
)
def test_lengths(length, text):
    assert length_text(length) == text


@pytest.mark.parametrize(
    ("duration", "text"),
    [
        (298_800.0, "83 h"),
        (9.0, "9.0 s"),
        (0.0125, "12.5 ms"),
        (12.6491, "12.65 s"),
        (1080.0, "18 min"),
        (4e6, "46.3 days"),
        (2e-5, "20 µs"),
        (math.nan, "unknown"),
        (math.inf, "infinite"),
    ],
)
def test_durations(duration, text):
    assert duration_text(duration) == text
