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
        (1.0, None, (1 - 1e-10) / 3, [0, 1 / 3, 2 / 3, 1]),
        (0.0, None, 0.1, [0]),
        (2.0, None, None, np.linspace(0, 2, 25)),
    ],
)
def test_both_ends_are_included(duration, samples, step, expected):
    times = qt.sample_times(duration, samples, step)
    assert times == pytest.approx(expected)
    assert times[-1] == duration  # exactly, because a path ends there


@pytest.mark.parametrize("duration", [-1.0, np.nan, np.inf])
@pytest.mark.parametrize("step", [None, 0.1])
def test_an_invalid_duration_is_an_error(duration, step):
    with pytest.raises(ValueError, match="the duration must be finite and not negative"):
        qt.sample_times(duration, step=step)


@pytest.mark.parametrize(
    ("samples", "step", "words"),
    [
        (3, 1.0, "both given: pass one of them"),
        (10**9, None, "samples must be at most 1000000, but 1000000000 was given"),
        (1, None, "samples must be an integer, 2 or more, but 1 was given"),
        (2.5, None, "samples must be an integer, 2 or more, but 2.5 was given"),
        (None, 0.0, "step must be positive"),
        (None, np.nan, "but nan s was given"),
        (None, 1e-9, "at most 1000000 instants, but 1e-09 s was given for a path of 2 s"),
    ],
)
def test_contradictions_and_too_many_instants_are_errors(samples, step, words):
    with pytest.raises(ValueError, match=words):
        qt.sample_times(2.0, samples, step)
