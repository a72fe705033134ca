"""The first pass over the segments of a route: its proofs are correct, and its largest values are those of samples."""

from fractions import Fraction

import numpy as np
import pytest

from qtraj.design.proof import first_pass, segment_parts
from qtraj.path.quantity import QUANTITIES

NAMES = ("curvature", "torsion", "speed", "acceleration", "lateral_acceleration", "longitudinal_acceleration", "slope",
         "jerk", "yaw_rate")  # fmt: skip


@pytest.fixture(scope="module")
def segments():
    """Coefficients and durations of random segments, some of them slow at one end."""
    rng = np.random.default_rng(5)
    h = rng.uniform(0.3, 2.0, 200)
    c = rng.normal(size=(200, 6, 3)) * (0.5 ** np.arange(6))[None, :, None]
    c[:, 1, 0] += rng.uniform(1.0, 20.0, 200)
    return c, h, first_pass.derivatives(c, c, h, np.zeros(200, bool))


def densely(of, entry):
    return np.sqrt(first_pass._sampled(of, entry, np.linspace(0, 1, 4001))) / of.h**entry.per_time


@pytest.mark.parametrize("name", NAMES)
def test_largest_values_and_proofs(segments, name):
    _, h, of = segments
    entry = QUANTITIES[name]
    assert first_pass.is_simple(entry)
    seen = densely(of, entry).max(axis=0)
    value, time = first_pass.largest(of, entry)
    assert np.all((time >= 0) & (time <= h))
    even = first_pass.proved(of, [entry], np.array([1e6]), 3)[:, 0]  # the divisor is positive and nearly constant
    assert even.sum() > 50
    assert np.all(value[even] >= seen[even] * (1 - 1e-9))
    np.testing.assert_allclose(value[even], seen[even], rtol=1e-4)
    for factor in (0.999, 1.1, 2.0):
        bound = factor * float(np.median(seen[even]))
        proved = first_pass.proved(of, [entry], np.array([bound]), 3)[:, 0]
        assert not np.any(proved & (seen > bound))
        if factor == 2.0 and name != "torsion":
            assert proved[even].mean() > 0.4


def test_a_limit_at_the_largest_value_is_not_proved(segments):
    """Within rounding errors of the maximum at an end, where the Bernstein coefficient is the value."""
    _, _, of = segments
    entry = QUANTITIES["jerk"]
    values, _ = first_pass.largest(of, entry)
    for row in range(0, 200, 20):
        one = of.rows(np.array([row]))
        tight = [values[row] * (1 + x) for x in (-1e-15, 0.0, 1e-15)]
        assert not any(first_pass.proved(one, [entry], np.array([bound]), 3)[0, 0] for bound in tight)


def test_shifted_segments_are_rounded_once(segments):
    c, h, _ = segments
    for row, duration in zip(c[:10], h[:10], strict=True):
        time, found = Fraction(float(duration)), segment_parts.exactly_shifted(row, float(duration))
        for axis in range(3):
            terms = [Fraction(float(x)) for x in row[:, axis]]
            for k in range(5):
                for i in range(4, k - 1, -1):
                    terms[i] += time * terms[i + 1]
            assert found[:, axis].tolist() == [float(x) for x in terms]
