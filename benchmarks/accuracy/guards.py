"""Record the deviations that tests compare with their tolerances, for tables in documents."""

import contextlib

import numpy as np


@contextlib.contextmanager
def recorded(monitor):
    """Append (largest deviation, largest fraction of the tolerance) to `monitor` for each comparison in the context."""
    compare = np.testing.assert_allclose

    def note(actual, desired, rtol=1e-7, atol=0, **how):
        compare(actual, desired, rtol=rtol, atol=atol, **how)
        gap = np.abs(np.asarray(actual, float) - np.asarray(desired, float))
        allowed = np.asarray(atol + rtol * np.abs(np.asarray(desired, float)))
        if gap.size:
            used = np.max(gap / np.maximum(allowed, np.finfo(float).tiny))
            monitor.append((float(np.max(gap)), float(used)))

    np.testing.assert_allclose = note
    try:
        yield
    finally:
        np.testing.assert_allclose = compare


def used(test, *arguments):
    """Return the largest fraction of its tolerances that a test uses."""
    monitor = []
    with recorded(monitor):
        test(*arguments)
    return max(part for _, part in monitor)
