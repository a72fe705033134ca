"""Time-optimal slews that consist of a single ramp, on which the minimum duration depends discontinuously on the angle.

A ramp from v0 to v1 takes |v1 − v0|/A. If v0 and v1 have the same sign, a slew by a slightly smaller angle must
reverse. The references are computed from the decimal numbers by rational arithmetic.
"""

import itertools
from fractions import Fraction

import jax
import numpy as np
import pytest

from qtraj.motion.profiles.time_optimal import TimeOptimal

ROUND_OFF = 1e-14  # of durations [s], relative to the larger of the duration and V/A
TENTHS = [Fraction(k, 10) for k in range(-9, 10)]
ACCELERATIONS = [Fraction(x) for x in ("0.1", "0.2", "0.3", "0.7", "1.1")]
RATE_LIMIT = 1.0
RAMPS = [
    (v0, v1, a, (v0 + v1) * abs(v1 - v0) / (2 * a)) for v0, v1, a in itertools.product(TENTHS, TENTHS, ACCELERATIONS)
]
DISCONTINUOUS = [ramp for ramp in RAMPS if ramp[0] * ramp[1] > 0]
CHANGING = [ramp for ramp in DISCONTINUOUS if ramp[0] != ramp[1]]
SCALES = [(x, t) for x in (1e-6, 1.0, 1e6) for t in (1e-6, 1.0, 1e6)]
"""Units of the angle and of the time."""


def profile(ramp, factor=1.0, scale=(1.0, 1.0), duration=None):
    v0, v1, a, angle = (float(x) for x in ramp)
    x, t = scale
    law = TimeOptimal(RATE_LIMIT * x / t, a * x / t**2, v0 * x / t, v1 * x / t, duration)
    return law.profile(angle * x * factor)


def reversing(ramp):
    """The duration of a slew that must first pass the end rate, reverse its sense and return to the end rate."""
    v0, v1, a, _ = (float(x) for x in ramp)
    slowest = min(abs(v0), abs(v1))
    return abs(v1 - v0) / a + 4 * slowest / a


def assert_ramps(ramps, found, scale=(1.0, 1.0)):
    expected = np.array([float(abs(v1 - v0) / a) for v0, v1, a, _ in ramps]) * scale[1]
    size = np.maximum(expected, np.array([RATE_LIMIT / float(a) for _, _, a, _ in ramps]) * scale[1])
    assert np.max(np.abs(np.array(found) - expected) / size) <= ROUND_OFF


@pytest.mark.parametrize(
    ("arguments", "angle", "duration"), [((1, 0.2, 0.5, 0.3), 0.4, 1.0), ((1, 0.1, 0.3, 0.5), 0.8, 2.0)]
)
def test_a_ramp_does_not_reverse(arguments, angle, duration):
    found = TimeOptimal(*arguments).profile(angle)
    assert float(found.duration) == pytest.approx(duration, rel=ROUND_OFF)
    assert np.all(np.asarray(found.widths) >= 0)
    assert found.peak(1)[1] == 0.5


@pytest.mark.parametrize("factor", [1.0, 1 + 1e-15, 1 - 1e-15])
def test_ramps_of_decimal_numbers_take_their_time(factor):
    """Slews that end at rest are not included: their duration is continuous, but with an infinite slope."""
    ramps = [ramp for ramp in RAMPS if ramp[1] != 0 or factor == 1.0]
    assert_ramps(ramps, [profile(ramp, factor).duration for ramp in ramps])


@pytest.mark.parametrize("scale", SCALES)
def test_ramps_in_other_units_take_their_time(scale):
    ramps = DISCONTINUOUS[::7]
    assert_ramps(ramps, [profile(ramp, scale=scale).duration for ramp in ramps], scale)


@pytest.mark.parametrize("scale", SCALES[::4])
def test_beside_a_ramp_a_slew_reverses_or_is_slightly_longer(scale):
    """At 1e-12 beside the ramp, which is more than round-off, both sides are distinguished."""
    for ramp in CHANGING[::11]:
        v0, v1, a, angle = (float(x) for x in ramp)
        short, long = (float(profile(ramp, 1 + e, scale).duration) / scale[1] for e in (-1e-12, 1e-12))
        assert short == pytest.approx(reversing(ramp), rel=1e-9)
        slower = min(abs(v0), abs(v1))
        assert abs(v1 - v0) / a <= long * (1 + ROUND_OFF)
        assert long == pytest.approx(abs(v1 - v0) / a, abs=3e-12 * abs(angle) / slower)


def test_the_motion_of_a_ramp_is_a_ramp():
    for v0, v1, a, angle in ((float(x) for x in ramp) for ramp in CHANGING[::13]):
        found = TimeOptimal(RATE_LIMIT, a, v0, v1).profile(angle)
        assert float(np.sum(found.pieces, axis=1)[-1]) == pytest.approx(angle, rel=1e-13, abs=1e-15)
        assert found.peak(1)[1] == pytest.approx(max(abs(v0), abs(v1)), rel=1e-14)
        switches = np.asarray(found.switches)
        assert np.all(np.diff(np.concatenate([[0.0], switches])) >= 0)


def test_the_duration_of_a_ramp_can_be_prescribed():
    close = (Fraction("0.99"), Fraction(1), Fraction("0.1"), Fraction("0.0995"))
    for ramp in (*CHANGING[::5], close):
        v0, v1, a, angle = (float(x) for x in ramp)
        found = profile(ramp, duration=float(abs(ramp[1] - ramp[0]) / ramp[2]))
        middle = float(found.angle(found.duration / 2))
        assert middle == pytest.approx((3 * v0 + v1) * abs(v1 - v0) / (8 * a), rel=1e-7)
        assert float(np.sum(found.pieces, axis=1)[-1]) == pytest.approx(angle, rel=1e-12)


def test_the_minimum_duration_of_a_slew_near_a_ramp_can_be_prescribed():
    """Where the end rates are large and almost equal, the minimum is a small difference of long ramps."""
    rng = np.random.default_rng(4)
    for v0, v1, a in zip(*np.round(rng.uniform(-5, 5, (2, 200)), 2), np.exp(rng.uniform(-3, 2, 200)), strict=True):
        for start, end in ((v0, v1), (v0, v0 + 0.01)):
            for factor in (1.0, 1 + 1e-15, 1 + 1e-12, 1 - 1e-12, 1 + 1e-9):
                angle = (start + end) * abs(end - start) / (2 * a) * factor
                duration = TimeOptimal(None, a, start, end).profile(angle).duration
                found = TimeOptimal(None, a, start, end, duration).profile(angle)
                fastest = max(abs(start), abs(end))
                round_off = 1e-14 * fastest**2 / a + 1e-12 * fastest * float(duration)
                assert float(np.sum(found.pieces, axis=1)[-1]) == pytest.approx(angle, abs=round_off)
                assert np.all(np.diff(np.concatenate([[0.0], found.switches])) >= 0)


def test_derivatives_at_a_ramp_are_those_of_slightly_larger_angles():
    """dT/dΦ is 1/v_p with the sign of the rates; round-off of the peak rate v_p does not change it."""
    slopes = jax.jit(
        jax.vmap(lambda *x: jax.grad(lambda x: TimeOptimal(RATE_LIMIT, x[2], x[0], x[1]).profile(x[3]).duration)(x))
    )(*np.array([[float(x) for x in ramp] for ramp in RAMPS]).T)
    assert all(np.isfinite(x).all() for x in slopes)
    for ramp, slope in zip(RAMPS, np.asarray(slopes[3]), strict=True):
        if ramp[0] * ramp[1] > 0:
            assert slope == pytest.approx(1 / max(ramp[:2], key=abs), rel=1e-12)
