"""S-curves between rates and accelerations: durations of another program, motions, derivatives and messages."""

import csv
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from tests.derivatives import with_jacobians

import qtraj as qt
from qtraj.motion.profiles.jerk_limited.between import scaled
from qtraj.motion.profiles.jerk_limited.durations import possible_durations
from qtraj.motion.profiles.s_curve import _task

DATA = Path(__file__).parents[2] / "data" / "jerk_limited_durations.csv"
BEYOND = 50
"""The number of the last motions of the file that may start beyond their limits."""
REFERENCE = 1e-12  # the relative accuracy of the durations in the file
MOTION = 1e-9  # of rates and accelerations at the ends, which are sums over segments of very different lengths
FINITE_DIFFERENCE = 3e-6  # of central differences with a relative step of 1e-6


def read_cases():
    with DATA.open(newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    return np.array([[float(x) for x in row.values()] for row in rows])


CASES = read_cases()


def s_curve(case, duration=None):
    """The profile of a case: distance, v0, a0, v1, a1, V, A, J."""
    _, v0, a0, v1, a1, V, A, J = case
    states = {"start_rate": v0, "start_acceleration": a0, "end_rate": v1, "end_acceleration": a1}
    return qt.SCurve(V, A, J, duration, **states)


def final_state(profile):
    """Angle, rate and acceleration at the end of the last segment, from its polynomial."""
    k = np.flatnonzero(np.asarray(profile.widths) > 0)[-1]
    curve, width = np.polynomial.Polynomial(profile.pieces[k]), float(profile.widths[k])
    return np.array([curve(1.0), curve.deriv(1)(1.0) / width, curve.deriv(2)(1.0) / width**2])


def check_motion(profile, case, within=True):
    """The profile starts and ends in its states, is continuous, and satisfies its limits."""
    distance, v0, a0, v1, a1, V, A, J = (float(x) for x in case)
    peak = max(V, profile.peak(1)[1])
    sizes = np.array([abs(distance) + peak * float(profile.duration), peak, A])
    np.testing.assert_allclose(profile.derivatives(0.0, 2) / sizes, [0, v0 / peak, a0 / A], atol=1e-14)
    np.testing.assert_allclose(final_state(profile) / sizes, np.array([distance, v1, a1]) / sizes, atol=MOTION)
    np.testing.assert_allclose(profile.derivatives(profile.duration, 2), [distance, v1, a1], rtol=1e-15)
    np.testing.assert_allclose(profile.peak(3)[1], J, rtol=1e-6)
    ends = profile.switches[:-1]
    gap = [np.abs(profile.derivatives(t * (1 - 1e-13), 2) - profile.derivatives(t, 2)) for t in ends if t > 0]
    assert np.all(np.array(gap) <= MOTION * sizes + J * 1e-12 * float(profile.duration))
    if within:
        assert profile.peak(1)[1] <= V * (1 + 1e-12)
        assert profile.peak(2)[1] <= A * (1 + 1e-12)


def test_durations_are_the_minima():
    """200 random motions with limits over four decades; the durations come from ruckig."""
    for k, case in enumerate(CASES):
        profile = s_curve(case[:8]).profile(case[0])
        np.testing.assert_allclose(profile.duration, case[8], rtol=REFERENCE)
        check_motion(profile, case[:8], within=k < len(CASES) - BEYOND)


def kinds():
    """The sets of segments of nonzero duration, of all reference motions that start within their limits."""
    profiles = [s_curve(case[:8]).profile(case[0]) for case in CASES[:-BEYOND]]
    return {tuple(np.flatnonzero(p.widths > 1e-9 * p.duration)) for p in profiles}


def test_the_reference_motions_have_many_structures():
    assert len(kinds()) >= 10


@pytest.mark.parametrize("angle_unit", [1e-6, 1.0, 1e6])
@pytest.mark.parametrize("time_unit", [1e-6, 1.0, 1e6])
def test_units_do_not_matter(angle_unit, time_unit):
    factors = angle_unit / time_unit ** np.array([0, 1, 2, 1, 2, 1, 2, 3])
    for case in CASES[:150:10]:
        scaled_case = case[:8] * factors
        duration = s_curve(scaled_case).profile(scaled_case[0]).duration
        np.testing.assert_allclose(duration / time_unit, case[8], rtol=1e-12)


def test_mirrored_and_reversed_motions_last_as_long():
    for case in CASES[:150:10]:
        distance, v0, a0, v1, a1, *limits = case[:8]
        mirrored = s_curve([-distance, -v0, -a0, -v1, -a1, *limits]).profile(-distance)
        np.testing.assert_allclose(mirrored.duration, case[8], rtol=REFERENCE)
        backwards = s_curve([distance, v1, -a1, v0, -a0, *limits])
        if abs(v0 - a0 * abs(a0) / (2 * limits[2])) <= limits[0]:
            np.testing.assert_allclose(backwards.profile(distance).duration, case[8], rtol=REFERENCE)


def test_rest_to_rest_is_the_closed_form():
    rng = np.random.default_rng(3)
    for angle, V, A, J in np.exp(rng.uniform(-3, 3, (60, 4))):
        expected = qt.SCurve(V, A, J).profile(angle)
        found = qt.SCurve(V, A, J, start_rate=0.0, end_rate=0.0).profile(angle)
        np.testing.assert_allclose(found.duration, expected.duration, rtol=2e-15)
        for t in np.linspace(0, 1, 7) * expected.duration:
            np.testing.assert_allclose(found.angle(t), expected.angle(t), rtol=0, atol=1e-14 * angle)


def test_motions_that_are_known():
    """A single ramp; no motion; a return; a braking from twice the limit on the rate."""
    ramp = qt.SCurve(9.0, 2.0, 0.5, start_rate=1.0, start_acceleration=-0.5, end_rate=1.0, end_acceleration=0.5)
    T = 1.0 / 0.5
    np.testing.assert_allclose(ramp.profile(1.0 * T - 0.25 * T**2 + 0.5 * T**3 / 6).duration, T, rtol=1e-14)
    assert qt.SCurve(2.0, 1.0, 1.0, start_rate=1.0, end_rate=1.0).profile(0.0).duration == 0.0
    # From rate v to −v at the place of the start: a ramp of length 2√(2v/J) without holds.
    back = qt.SCurve(None, 9.0, 1.0, start_rate=0.5, end_rate=-0.5).profile(0.0)
    np.testing.assert_allclose(back.duration, 2.0, rtol=1e-15)
    np.testing.assert_allclose(back.angle(1.0), 0.5 - 1 / 6, rtol=1e-15)
    fast = qt.SCurve(1.0, 9.0, 2.0, start_rate=2.0, end_rate=0.0).profile(50.0)
    # The rate decreases to the limit in √(2·1/2) s, with acceleration −2 there.
    np.testing.assert_allclose(fast.rate(1.0), 1.0, rtol=1e-14)
    np.testing.assert_allclose(fast.acceleration(1.0), -2.0, rtol=1e-14)
    assert np.all([fast.rate(t) <= 1.0 + 1e-14 for t in np.linspace(1.0, fast.duration, 200)])


def duration_and_motion(x):
    """Duration, angle and rate at one instant, from the eight numbers of a case."""
    profile = s_curve(x).profile(x[0])
    return jnp.concatenate([profile.duration[None], profile.derivatives(jnp.asarray(0.3), 1)])


def differences(function, x):
    """Central differences (n, outputs, inputs) of a function of a vector, at the points `x` (n, inputs)."""
    steps = 1e-6 * np.maximum(np.abs(x), 1e-3 * np.abs(x).max(axis=1, keepdims=True))
    unit = np.eye(x.shape[1])
    around = x[:, None, None] + np.stack([unit, -unit])[None] * steps[:, None, None]
    values = np.asarray(jax.jit(jax.vmap(jax.vmap(jax.vmap(function))))(around))
    return np.swapaxes(values[:, 0] - values[:, 1], 1, 2) / (2 * steps[:, None])


def test_derivatives_equal_finite_differences():
    """Of the duration and of the motion, with respect to the angle, the states and the limits; both modes."""
    x = CASES[[0, 3, 8, 12, 20, 31, 44, 60, 95, 120, 160, 170, 190], :8]
    _, forward, reverse = jax.jit(jax.vmap(with_jacobians(duration_and_motion)))(x)
    difference = differences(duration_and_motion, x)
    size = np.abs(forward).max(axis=2, keepdims=True) + 1
    np.testing.assert_allclose(difference / size, forward / size, rtol=0, atol=FINITE_DIFFERENCE)
    np.testing.assert_allclose(reverse / size, forward / size, rtol=0, atol=1e-12)
    assert np.all(np.abs(forward[:, 0]).max(axis=1) > 0)


def test_jax_and_numpy_agree():
    x = CASES[::20, :8]
    compiled = jax.jit(jax.vmap(lambda x: s_curve(x).profile(x[0])))(x)
    for k, case in enumerate(x):
        profile = s_curve(case).profile(case[0])
        assert isinstance(profile.widths, np.ndarray)
        np.testing.assert_allclose(compiled.widths[k], profile.widths, rtol=1e-12, atol=1e-12 * profile.duration)
        np.testing.assert_allclose(compiled.duration[k], profile.duration, rtol=1e-13)


def test_single_precision():
    """Also of motions that start beyond their limits, and brake to a state at a limit."""
    x = jnp.asarray(CASES[::5, :8], jnp.float32)
    profiles = jax.jit(jax.vmap(lambda x: s_curve(x).profile(x[0])))(x)
    assert profiles.duration.dtype == np.float32
    assert profiles.feasible.all()
    expected = [s_curve(case).profile(case[0]).duration for case in np.asarray(x, float)]
    np.testing.assert_allclose(profiles.duration, expected, rtol=1e-4)
    fixed = jax.jit(jax.vmap(lambda x, T: s_curve(x, T).profile(x[0])))(x, profiles.duration)
    assert fixed.feasible.all()


@pytest.mark.parametrize("factor", [1.0, 1.001, 1.3, 4.0, 50.0])
def test_a_fixed_duration_is_met_where_it_is_possible(factor):
    """Durations inside the named intervals are met within the limits, and others are refused."""
    met = 0
    for case in CASES[:150:6]:
        duration = factor * s_curve(case[:8]).profile(case[0]).duration
        law = s_curve(case[:8], duration)
        task = scaled(_task(law, np.asarray(case[0])))
        intervals = np.array(possible_durations(task.ends, float(task.max_rate))) * float(task.time)
        possible = factor == 1.0 or np.any((intervals[:, 0] <= duration) & (duration <= intervals[:, 1]))
        met += possible
        if possible:
            profile = law.profile(case[0])
            assert profile.duration == duration
            np.testing.assert_allclose(profile.widths.sum(), duration, rtol=1e-12)
            check_motion(profile, case[:8])
        else:
            with pytest.raises(ValueError, match="cannot last exactly"):
                law.profile(case[0])
    assert met >= (25 if factor in (1.0, 50.0) else 10)


def test_a_duration_in_a_gap_names_the_possible_ones():
    def law(duration):
        return qt.SCurve(1.0, 2.0, 8.0, duration, start_rate=0.5, end_rate=0.5)

    minimum = law(None).profile(0.2).duration
    with pytest.raises(ValueError, match=r"of 0\.2 rad cannot last exactly 0\.6 s .* It can last ") as error:
        law(0.6).profile(0.2, unit="rad")
    (numbers,) = re.findall(r"from (\S+) to (\S+) s or at least (\S+) s", str(error.value))
    low, high, longer = map(float, numbers)
    np.testing.assert_allclose(low, minimum, rtol=1e-8)
    assert high < 0.6 < longer
    for duration in (low * (1 + 1e-8), (low + high) / 2, high * (1 - 1e-8), longer * (1 + 1e-8), 100.0):
        np.testing.assert_allclose(final_state(law(duration).profile(0.2)), [0.2, 0.5, 0.0], atol=1e-12)
    with pytest.raises(ValueError, match=f"needs at least {minimum:.6f}"):
        law(0.9 * minimum).profile(0.2)


def test_a_batch_of_fixed_durations_is_the_same_as_single_ones():
    """Also where a duration is too short, or lies in a gap."""
    x = np.append(CASES[:150:5, :8], np.tile([0.9, 1.0, 1.02, 1.5, 9.0], 6)[:, None] * CASES[:150:5, 8:], axis=1)
    batch = jax.jit(jax.vmap(lambda x: s_curve(x[:8], x[8]).profile(x[0])))(x)
    single = jax.jit(lambda x: s_curve(x[:8], x[8]).profile(x[0]))
    for k, each in enumerate(x):
        alone = single(each)
        assert bool(alone.feasible) == bool(batch.feasible[k])
        np.testing.assert_allclose(batch.widths[k], alone.widths, rtol=0, atol=1e-9 * each[8])
    assert 10 < np.sum(batch.feasible) < 25


def test_derivatives_at_the_minimum_duration():
    """The motion changes with a longer duration, and with a distance that leaves time: one-sided differences."""
    for arguments, angle in [({"start_rate": 0.3, "end_rate": -0.2}, 3.0), ({"start_rate": 0.3}, 0.5)]:
        minimum = float(qt.SCurve(1.0, 2.0, 8.0, **arguments).profile(angle).duration)

        def motion(x, arguments=arguments, t=0.4 * minimum):
            return qt.SCurve(1.0, 2.0, 8.0, x[0], **arguments).profile(x[1]).derivatives(t, 1)

        x, step = np.array([minimum, angle]), 1e-6 * np.array([[1.0, 0.0], [0.0, -1.0]])
        found = jax.jit(jax.jacfwd(motion))(x)
        differences = np.stack([(motion(x + dx) - motion(x)) / dx.sum() for dx in step], axis=1)
        np.testing.assert_allclose(found, differences, rtol=1e-4)


@pytest.mark.parametrize("duration", [np.nan, np.inf])
@pytest.mark.parametrize("arguments", [{"start_rate": 0.3}, {}])
def test_a_duration_that_is_not_finite(duration, arguments):
    profile = jax.jit(lambda T: qt.SCurve(1.0, 2.0, 8.0, T, **arguments).profile(1.0))(duration)
    assert not profile.feasible
    assert np.isfinite(profile.duration)
    with pytest.raises(ValueError, match="duration must be positive and finite"):
        qt.SCurve(1.0, 2.0, 8.0, duration, **arguments)


def test_derivatives_in_a_fixed_duration():
    x = np.append(CASES[:150:30, :8], 3.0 * CASES[:150:30, 8:], axis=1)

    def motion(x):
        return s_curve(x[:8], x[8]).profile(x[0]).derivatives(0.35 * x[8], 2)

    forward = np.asarray(jax.jit(jax.vmap(jax.jacfwd(motion)))(x))
    difference = differences(motion, x)
    size = np.abs(forward).max(axis=2, keepdims=True) + 1
    np.testing.assert_allclose(difference / size, forward / size, rtol=0, atol=FINITE_DIFFERENCE)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"end_rate": 1.5}, r"\|end_rate\| must not exceed max_rate, but end_rate = 1.5 and max_rate = 1.0"),
        ({"end_acceleration": -3.0}, r"\|end_acceleration\| must not exceed max_acceleration, but end_acc.* = -3.0"),
        ({"end_rate": 0.9, "end_acceleration": -2.0}, "the rate is at 1.15 before the end, beyond max_rate = 1.0"),
        ({"end_rate": -0.9, "end_acceleration": 2.0}, "the rate is at -1.15 before the end"),
        ({"start_rate": np.nan}, "start_rate"),
        ({"start_acceleration": np.inf}, "start_acceleration"),
    ],
)
def test_states_that_limits_forbid_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        qt.SCurve(1.0, 2.0, 8.0, **arguments)


def test_a_traced_state_that_limits_forbid_is_not_feasible():
    profile = jax.jit(lambda v: qt.SCurve(1.0, 2.0, 8.0, end_rate=v).profile(3.0))(jnp.array(1.5))
    assert not profile.feasible
    assert np.isnan(profile.duration)
    assert jax.jit(lambda v: qt.SCurve(1.0, 2.0, 8.0, end_rate=v).profile(3.0))(jnp.array(0.5)).feasible


def test_a_stored_profile_is_the_same(tmp_path):
    law = s_curve(CASES[3, :8])
    qt.EulerTurn.about([0, 0, 1], 1.5, [1, 0, 0, 0], law).save(tmp_path / "slew.toml")
    assert qt.load(tmp_path / "slew.toml").law.profile(CASES[3, 0]).duration == law.profile(CASES[3, 0]).duration


@pytest.mark.parametrize(("start", "end"), [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (1.0, 0.3)])
def test_derivatives_of_a_coast_from_or_to_the_largest_rate(start, end):
    """T = D/V, plus the times lost in the ramps: derivatives in the distance and, for start 1, the end rate."""

    def duration(x):
        return qt.SCurve(1.0, 2.0, 8.0, start_rate=start, end_rate=end + x[1]).profile(x[0]).duration

    x, step = jnp.array([3.0, 0.0]), 1e-6
    found = jax.grad(duration)(x)
    assert float(found[0]) == pytest.approx(1.0, rel=1e-12)
    below = (duration(x) - duration(x.at[1].add(-step))) / step
    assert float(found[1]) == pytest.approx(float(below), abs=1e-5) or end == 1.0


def test_the_derivative_at_the_largest_acceleration():
    def duration(a0):
        return qt.SCurve(1.0, 2.0, 8.0, start_rate=0.3, start_acceleration=a0).profile(1.0).duration

    differences = [float(duration(2.0 + x) - duration(2.0)) / x for x in (-1e-6, 1e-6)]
    assert float(jax.grad(duration)(2.0)) == pytest.approx(np.mean(differences), abs=1e-5)


def test_second_derivatives_equal_finite_differences():
    def duration(x):
        return qt.SCurve(1.0, 2.0, 8.0, start_rate=x[1], end_rate=x[2]).profile(x[0]).duration

    x, slope = jnp.array([0.05, 0.1, 0.05]), jax.jit(jax.grad(duration))
    found, step = jax.jit(jax.hessian(duration))(x), 1e-6
    differences = np.stack([(slope(x + step * e) - slope(x - step * e)) / (2 * step) for e in np.eye(3)])
    np.testing.assert_allclose(found, differences, rtol=1e-5, atol=1e-4)


def test_a_motion_that_does_not_exist_is_refused():
    with pytest.raises(ValueError, match="no motion of 1 exists between these states"):
        qt.SCurve(None, 1.0, 1.0, start_rate=1e200).profile(1.0)
