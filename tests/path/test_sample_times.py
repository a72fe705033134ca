"""Instants by their number, or by the time between them."""

import numpy as np
import pytest

import qtraj as qt


@pytest.mark.parametrize(
    ("duration", "samples", "step", "expected"),
    [
        (2.0, 3, None, [0, 1, 2]),
        (2.0, None, 1.0, [0, 1, 2]),
        (2.5, None, 1.0, [0, 1, 2, 2.5]),
        (0.3, None, 0.1, [0, 0.1, 0.2, 0.3]),
        (2.0, None, 5.0, [0, 2]),
        (2.0, None, None, np.linspace(0, 2, 25)),
    ],
)
def test_both_ends_are_included(duration, samples, step, expected):
    assert qt.sample_times(duration, samples, step) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("samples", "step", "words"),
    [
        (3, 1.0, "both given: pass one of them"),
        (10**9, None, "samples must be at most 1000000, but 1000000000 was given"),
        (None, 0.0, "step must be positive"),
        (None, np.nan, "but nan s was given"),
        (None, 1e-9, "at most 1000000 instants, but 1e-09 s was given for a path of 2 s"),
    ],
)
def test_contradictions_and_too_many_instants_are_errors(samples, step, words):
    with pytest.raises(ValueError, match=words):
        qt.sample_times(2.0, samples, step)
