"""A thousand random slews with end rates and a thousand S-curves, compared with integrations and searches in NumPy."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.time_optimal import TimeOptimal

COUNT = 1000
BRUTE = 1e-9
"""Of angles [rad] up to π and of rates [rad/s] up to 5, and relative of durations."""
CELLS = 96


def sampled(make, arguments, times):
    """The profiles of `make`, and Φ … Φ⃛ at the ends and midpoints of the cells between `times`, (n, m, 4)."""
    middles = (times[:, 1:] + times[:, :-1]) / 2

    @jax.jit
    @jax.vmap
    def run(arguments, ends, middles):
        profile = make(*arguments)
        return profile, *(jax.vmap(lambda t: profile.derivatives(t, 3))(t) for t in (ends, middles))

    return jax.tree.map(np.asarray, run(arguments, times, middles))


def cells(duration, switches):
    """Instants from 0 to the duration in increasing order: evenly spaced ones and the switches."""
    even = duration[:, None] * np.linspace(0, 1, CELLS + 1)
    return np.sort(np.concatenate([even, np.clip(switches, 0, duration[:, None])], axis=1), axis=1)


def integrated(times, jerk, acceleration, rate):
    """Φ and Φ̇ at `times` from the jerk in each cell and the acceleration in its middle; constant jerk is exact."""
    h = np.diff(times, axis=1)
    rates = rate[:, None] + np.cumsum(acceleration * h, axis=1)
    before = np.concatenate([rate[:, None], rates[:, :-1]], axis=1)
    angles = np.cumsum((before + rates) / 2 * h - jerk * h**3 / 12, axis=1)
    zero = np.zeros_like(rate)[:, None]
    return np.concatenate([zero, angles], axis=1), np.concatenate([rate[:, None], rates], axis=1)


def largest_angle(T, v0, v1, V, A):
    """The largest angle in time T: ∫ min(V, v0 + At, v1 + A(T − t)) dt by trapezoids between all possible corners."""
    corners = np.stack([0 * T, (V - v0) / A, T - (V - v1) / A, T / 2 + (v1 - v0) / (2 * A), T])
    t = np.sort(np.clip(corners, 0, T), axis=0)
    rate = np.minimum(np.minimum(v0 + A * t, v1 + A * (T - t)), V)
    return np.sum(np.diff(t, axis=0) * (rate[1:] + rate[:-1]) / 2, axis=0)


def angle_range(T, v0, v1, V, A):
    """The smallest and the largest angle of a slew of duration T with these end rates."""
    return -largest_angle(T, -v0, -v1, V, A), largest_angle(T, v0, v1, V, A)


def minimum_duration(angle, v0, v1, V, A):
    """Bisection on T from |v1 − v0|/A, where a single angle is possible: one end of the range moves across Φ."""
    low = np.abs(v1 - v0) / A
    forward = angle >= angle_range(low, v0, v1, V, A)[1]
    high = low + np.abs(angle) / V + 10 * V / A + 1
    for _ in range(80):
        middle = (low + high) / 2
        smallest, largest = angle_range(middle, v0, v1, V, A)
        possible = np.where(forward, largest >= angle, smallest <= angle)
        low, high = np.where(possible, low, middle), np.where(possible, middle, high)
    return high


def end_rate_cases():
    rng = np.random.default_rng(11)
    V, A = np.exp(rng.uniform(math.log(0.05), math.log(5.0), (2, COUNT)))
    v0, v1 = V * rng.uniform(-1, 1, (2, COUNT))
    return math.pi * rng.uniform(-1, 1, COUNT), v0, v1, V, A


def check_motion(profile, times, ends, middles, start_rate, end_rate):
    """Angle and rate are the integrals of the acceleration, up to the end of the slew."""
    angles, rates = integrated(times, middles[:, :, 3], middles[:, :, 2], start_rate)
    np.testing.assert_allclose(angles, ends[:, :, 0], rtol=0, atol=BRUTE)
    # Round-off may put the last instant after the duration, where the rate is zero.
    np.testing.assert_allclose(rates[:, :-1], ends[:, :-1, 1], rtol=0, atol=BRUTE)
    np.testing.assert_allclose(rates[:, -1], end_rate, rtol=0, atol=BRUTE)
    np.testing.assert_allclose(angles[:, -1], profile.total, rtol=0, atol=BRUTE)


def test_slews_with_end_rates():
    """Switches from the textbook, the motion by integration, the duration by a search over the range of angles."""
    angle, v0, v1, V, A = end_rate_cases()
    sense = np.where(angle - (v0 + v1) * np.abs(v1 - v0) / (2 * A) < 0, -1.0, 1.0)
    free = np.sqrt(sense * A * angle + (v0**2 + v1**2) / 2)
    peak = sense * np.minimum(free, V)
    first, last = (peak - v0) / (sense * A), (peak - v1) / (sense * A)
    coast = np.where(free > V, (angle - sense * (2 * V**2 - v0**2 - v1**2) / (2 * A)) / (sense * V), 0)
    duration = first + coast + last
    times = cells(duration, np.stack([first, first + coast], axis=1))
    profile, ends, middles = sampled(
        lambda angle, v0, v1, V, A: TimeOptimal(V, A, v0, v1).profile(angle), (angle, v0, v1, V, A), times
    )
    np.testing.assert_allclose(profile.duration, duration, rtol=BRUTE)
    np.testing.assert_allclose(profile.duration, minimum_duration(angle, v0, v1, V, A), rtol=BRUTE)
    assert 100 < np.sum(free > V) < 900  # both kinds of slew
    check_motion(profile, times, ends, middles, v0, v1)
    long = np.diff(times, axis=1) > 1e-9  # exclude cells of round-off at a switch
    bound = A[:, None] * (1 + BRUTE)
    assert np.all((np.abs(middles[:, :, 2]) <= bound) & (np.abs(middles[:, :, 1]) <= V[:, None] * (1 + BRUTE)))
    full = np.isclose(np.abs(middles[:, :, 2]), A[:, None]) | np.isclose(np.abs(middles[:, :, 1]), V[:, None])
    assert np.all(full | ~long)  # rate or acceleration is at its limit everywhere


def test_slews_with_end_rates_of_a_fixed_duration():
    """Feasible exactly where the angle is possible in that time; then angle and end rates are met."""
    angle, v0, v1, V, A = end_rate_cases()
    shortest = minimum_duration(angle, v0, v1, V, A)
    duration = shortest * np.tile([0.9, 1.0 + 1e-9, 1.02, 1.1, 3.0], COUNT // 5)
    smallest, largest = angle_range(duration, v0, v1, V, A)
    possible = (smallest <= angle) & (angle <= largest) & (np.abs(v1 - v0) <= A * duration)
    arguments = (angle, v0, v1, V, A, duration)

    def make(angle, v0, v1, V, A, T):
        return TimeOptimal(V, A, v0, v1, T).profile(angle)

    profile = sampled(make, arguments, cells(duration, np.zeros((COUNT, 1))))[0]
    np.testing.assert_array_equal(profile.feasible, possible)
    assert np.sum(~possible[duration < shortest]) == COUNT // 5
    assert np.sum(~possible[duration > shortest]) >= 4  # longer durations that the end rates do not allow
    good = np.flatnonzero(possible)
    times = cells(duration[good], profile.starts[good])
    profile, ends, middles = sampled(make, tuple(x[good] for x in arguments), times)
    check_motion(profile, times, ends, middles, v0[good], v1[good])
    limits = np.stack([V[good], A[good]], axis=1)[:, None] * (
        1 + 1e-7
    )  # a double root at the minimum T has half the digits
    assert np.all(np.abs(middles[:, :, 1:3]) <= limits)


def test_s_curves():
    """Switches from the textbook, the motion by integration; a limit is active at every instant."""
    rng = np.random.default_rng(12)
    angle = math.pi * rng.uniform(0.001, 1, COUNT)
    V, A, J = np.exp(rng.uniform(math.log(0.05), math.log(5.0), (3, COUNT)))
    pointed = V * J < A**2
    corner = np.where(pointed, np.sqrt(V / J), A / J)
    ramp = np.where(pointed, 2 * corner, corner + V / A)
    coast = angle / V - ramp
    flat = angle >= 2 * A**3 / J**2
    slow_corner = np.where(flat, A / J, np.cbrt(angle / (2 * J)))
    slow_ramp = np.where(flat, (A / J + np.sqrt((A / J) ** 2 + 4 * angle / A)) / 2, 2 * slow_corner)
    short = coast < 0
    corner, ramp, coast = (
        np.where(short, a, b) for a, b in ((slow_corner, corner), (slow_ramp, ramp), (0 * coast, coast))
    )
    kinds = short.astype(int) * 2 + np.where(short, flat, pointed)
    assert np.bincount(kinds).min() > 50  # all four kinds
    duration = 2 * ramp + coast
    half = np.stack([corner, ramp - corner, ramp], axis=1)
    times = cells(duration, np.concatenate([half, duration[:, None] - half], axis=1))
    profile, ends, middles = sampled(lambda *x: SCurve(*x[1:]).profile(x[0]), (angle, V, A, J), times)
    np.testing.assert_allclose(profile.duration, duration, rtol=BRUTE)
    check_motion(profile, times, ends, middles, 0 * angle, 0 * angle)
    np.testing.assert_allclose(np.cumsum(middles[:, :, 3] * np.diff(times, axis=1), axis=1)[:, -1], 0, atol=BRUTE)
    limits = np.stack([V, A, J], axis=1)[:, None]
    used = np.abs(middles[:, :, 1:]) / limits
    assert used.max() <= 1 + BRUTE
    long = np.diff(times, axis=1) > 1e-9
    assert np.all((used.max(axis=2) >= 1 - BRUTE) | ~long)


def test_the_search_reproduces_classical_slews():
    """Bang–bang from rest to rest, and out and back."""
    one = np.ones(1)
    np.testing.assert_allclose(
        minimum_duration(3.0 * one, 0 * one, 0 * one, 9 * one, one), 2 * math.sqrt(3), rtol=1e-14
    )
    np.testing.assert_allclose(minimum_duration(0 * one, -one, 0 * one, one, one), 1 + math.sqrt(2), rtol=1e-14)
    assert jnp.asarray(largest_angle(4 * one, 0 * one, 0 * one, one, one))[0] == 3.0
