"""Motion profiles: limits, minimum times, derivatives, values outside the duration, storage, errors."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from qtraj.foundation.document import load, save
from qtraj.motion.profiles.s_curve import SCurve
from qtraj.motion.profiles.smooth_step import Cubic, Quintic, Septic
from qtraj.motion.profiles.time_optimal import TimeOptimal

from .factories import FROM_LIMITS, IN_TIME

ROUND_OFF = 1e-11  # relative, of a sequence of pieces
DEGREE = math.pi / 180


def motion(profile, t):
    return profile.derivatives(t, 3)


def sample(profile):
    """Φ … Φ⃛ and their t-derivatives at instants over the profile, with the profile."""
    times = profile.duration * jnp.linspace(0.0, 1.0, 401)
    return profile, *jax.vmap(lambda t: jax.jvp(lambda t: motion(profile, t), (t,), (jnp.ones_like(t),)))(times)


def sampled(make, *arguments):
    """`sample` of the profile that `make` returns for each row of the arguments, as NumPy arrays."""
    return jax.tree.map(np.asarray, jax.jit(jax.vmap(lambda *x: sample(make(*x))))(*arguments))


def check_consistency(profiles, values, slopes, acceleration):
    """Each row is the derivative of the one before, and the angle is the integral of the rate, without jumps."""
    np.testing.assert_allclose(slopes[:, :-1, :3], values[:, :-1, 1:], rtol=ROUND_OFF, atol=1e-9)
    step = profiles.duration[:, None] / 400
    trapezoids = step * (values[:, 1:, 1] + values[:, :-1, 1]) / 2
    bound = step**2 / 4 * acceleration[:, None] + 1e-14  # the trapezoid's error under this limit
    assert np.all(np.abs(np.diff(values[:, :, 0], axis=1) - trapezoids) <= bound)


def cases(count=60, seed=3):
    """Random angles, rates, accelerations and jerks that cover all regimes."""
    rng = np.random.default_rng(seed)
    angle = math.pi * rng.uniform(0.001, 1.0, count)
    return angle, *np.exp(rng.uniform(math.log(0.03), math.log(5.0), (3, count)))


@pytest.mark.parametrize("name", FROM_LIMITS)
def test_minimum_time_profiles_reach_and_satisfy_their_limits(name):
    angle, v, a, j = cases()
    profiles, values, slopes = sampled(lambda angle, *limits: FROM_LIMITS[name](*limits).profile(angle), angle, v, a, j)
    check_consistency(profiles, values, slopes, a)
    np.testing.assert_allclose(values[:, 0, :2], 0, atol=1e-15)
    np.testing.assert_allclose(values[:, -1, 0], angle, rtol=1e-15)
    np.testing.assert_array_equal(values[:, -1, 1:], 0)
    limits = np.stack([v, a, j], axis=1)
    used = np.abs(values[:, :, 1:]).max(axis=1) / limits
    active = {"time-optimal": [0, 1], "bang-bang": [1], "cubic": [0, 1]}.get(name, [0, 1, 2])
    assert np.all(used[:, active] <= 1 + ROUND_OFF)
    assert np.all(used[:, active].max(axis=1) >= 1 - 1e-4)  # the grid may miss the peak of a polynomial


@pytest.mark.parametrize(
    ("motion_profile", "angle", "duration"),
    [
        (TimeOptimal(DEGREE, 0.05 * DEGREE), 90 * DEGREE, 110.0),
        (TimeOptimal(DEGREE, 0.05 * DEGREE), 10 * DEGREE, math.sqrt(800)),  # 28.284 s
        (TimeOptimal(None, 1.0), math.pi, 3.5449077018110318),
        (TimeOptimal(math.inf, 1.0), math.pi / 2, 2.5066282746310002),
        (TimeOptimal(1.0, 1.0, start_rate=1.0, end_rate=1.0), 2.5, 2.5),
        (TimeOptimal(1.0, 1.0, start_rate=-1.0), 0.0, 1 + math.sqrt(2)),  # out for 1 s, back in √2
        (TimeOptimal(1.0, 1.0), -2.5, 3.5),
        (SCurve(10.0, 10.0, 2.0), 1.0, 4 * 0.25 ** (1 / 3)),
        (SCurve(1.0, 10.0, 4.0), 2.0, 3.0),
        (SCurve(1.0, 0.5, 1.0), 4.0, 6.5),
        (SCurve(10.0, 1.0, 1.0), 6.0, 6.0),
        (Cubic(max_rate=1.5), 1.0, 1.0),
        (Cubic(max_acceleration=6.0), 4.0, 2.0),
        (Quintic(max_acceleration=10 / math.sqrt(3)), 1.0, 1.0),
        (Quintic(max_rate=1.875, max_jerk=60.0), 8.0, 8.0),
        (Septic(max_jerk=52.5), 8.0, 2.0),
        (Septic(max_acceleration=84 * math.sqrt(5) / 25), 1.0, 1.0),
        (Septic(duration=7.0), 1.0, 7.0),
    ],
    ids=lambda x: type(x).__name__ if not isinstance(x, float) else None,
)
def test_durations(motion_profile, angle, duration):
    np.testing.assert_allclose(motion_profile.profile(angle).duration, duration, rtol=1e-14)


def test_end_rates_are_met_in_minimum_time():
    rng = np.random.default_rng(5)
    angle, a = rng.uniform(-3, 3, 60), rng.uniform(0.2, 3, 60)
    v0, v1 = rng.uniform(-1, 1, (2, 60))

    def fastest(v0, v1, v, a, angle):
        return TimeOptimal(v, a, v0, v1).profile(angle)

    # A rate limit of 100 is never reached.
    both = [np.concatenate([x, y]) for x, y in ((v0, v1), (v1, v0), (100 + 0 * a, 1 + 0 * a), (a, a), (angle, angle))]
    profiles, values, slopes = sampled(fastest, *both)
    check_consistency(profiles, values, slopes, both[3])
    np.testing.assert_allclose(values[:, 0, 1], both[0], atol=1e-14)
    np.testing.assert_array_equal(values[:, -1, :3], np.stack([both[4], both[1], 0 * both[1]], axis=1))
    assert np.all(np.abs(values[:, :, 2]) <= both[3][:, None] * (1 + ROUND_OFF))
    assert np.abs(values[60:, :, 1]).max() <= 1 + ROUND_OFF

    free, limited = profiles.duration[:60], profiles.duration[60:]
    # In time T the angles in mT ± (AT²/4 − Δ²/4A) are possible; at the minimum T the angle is an end of that interval.
    spread = np.abs(angle - (v0 + v1) / 2 * free)
    np.testing.assert_allclose(spread, a * free**2 / 4 - (v1 - v0) ** 2 / (4 * a), rtol=1e-9, atol=1e-12)
    # Reversed in time the slew takes as long: the second half swaps the end rates, and has a rate limit.
    unlimited = values[:60, :, 1].max(axis=1) < 1
    unlimited &= values[:60, :, 1].min(axis=1) > -1
    assert 10 < unlimited.sum() < 50
    np.testing.assert_allclose(limited[unlimited], free[unlimited], rtol=1e-12)
    assert np.all(limited[~unlimited] > free[~unlimited])


@pytest.mark.parametrize("name", IN_TIME)
def test_fixed_durations_satisfy_the_limits(name):
    def make(angle, v, a, j, factor):
        minimum = FROM_LIMITS[name](v, a, j).profile(angle).duration
        return IN_TIME[name](v, a, j, factor * minimum).profile(angle)

    angle, v, a, j = (np.tile(x, 4) for x in cases(seed=8))
    factor = np.repeat([1.0, 1.02, 1.7, 12.0], 60)
    profiles, values, slopes = sampled(make, angle, v, a, j, factor)
    assert np.all(profiles.feasible)
    check_consistency(profiles, values, slopes, a)
    # The polynomial of the last piece reaches the whole angle.
    np.testing.assert_allclose(profiles.pieces.sum(axis=2)[:, -1], 1, rtol=1e-12)
    used = np.abs(values[:, :, 1:]).max(axis=1) / np.stack([v, a, j], axis=1)
    assert np.all(used[:, : 2 if name == "time-optimal" else 3] <= 1 + ROUND_OFF)
    shortest, fastest, _ = sampled(
        lambda angle, *x: FROM_LIMITS[name](*x).profile(angle), *(x[:60] for x in (angle, v, a, j))
    )
    np.testing.assert_allclose(profiles.duration, factor * np.tile(shortest.duration, 4), rtol=1e-15)
    np.testing.assert_allclose(values[:60, :, :2], fastest[:, :, :2], rtol=1e-6, atol=1e-6)


def test_a_fixed_duration_meets_end_rates():
    def make(duration):
        return TimeOptimal(1.0, 1.0, start_rate=0.5, end_rate=-0.25, duration=duration).profile(1.0)

    profiles, values, slopes = sampled(make, np.array([9.0, 20.0]))
    check_consistency(profiles, values, slopes, np.ones(2))
    np.testing.assert_allclose(values[:, [0, -1], 1], [[0.5, -0.25]] * 2, atol=1e-14)
    np.testing.assert_allclose(profiles.pieces[:, -1].sum(axis=1), 1.0, rtol=1e-12)
    assert np.abs(values[:, :, 2]).max() <= 1 + ROUND_OFF
    after = TimeOptimal(1.0, 1.0, 0.5, 0.5).profile(1.0)
    assert motion(after, after.duration * 1.001).tolist() == [1, 0, 0, 0]


@pytest.mark.parametrize("name", IN_TIME)
def test_a_duration_too_short_is_refused_with_the_minimum(name):
    minimum = float(FROM_LIMITS[name](1.0, 0.7, 2.0).profile(2.0).duration)
    with pytest.raises(
        ValueError, match=f"needs at least {minimum:.14g}"[:26] + r".*within the limits \(max_rate = 1 and "
    ):
        IN_TIME[name](1.0, 0.7, 2.0, 0.999 * minimum).profile(2.0)
    traced = jax.jit(lambda T: IN_TIME[name](1.0, 0.7, 2.0, T).profile(2.0))
    assert not traced(0.5 * minimum).feasible
    np.testing.assert_allclose(traced(0.5 * minimum).duration, minimum, rtol=1e-15)


def test_an_s_curve_in_its_own_minimum_duration_is_the_fastest():
    """Its coasting rate is almost a double root if the acceleration rises in a tiny part of the duration."""
    rng = np.random.default_rng(21)
    angle, a, v = np.exp(rng.uniform(-8, 1, 200)), np.exp(rng.uniform(-4, 4, 200)), np.exp(rng.uniform(-3, 3, 200))
    j = a * np.exp(rng.uniform(-2, 16, 200))
    for row in zip(v, a, j, angle, strict=True):
        for limits in (row[:3], (None, *row[1:3])):
            fastest = SCurve(*limits).profile(row[3])
            found = SCurve(*limits, duration=fastest.duration).profile(row[3])
            assert abs(float(np.sum(found.pieces, axis=1)[-1]) - 1) <= 1e-13
            assert float(found.peak(1)[1]) <= float(fastest.peak(1)[1]) * (1 + ROUND_OFF)
            assert np.all(np.diff(np.concatenate([[0.0], found.switches])) >= 0)


@pytest.mark.parametrize("name", FROM_LIMITS)
def test_switches_are_not_negative_and_ascend(name):
    for angle in (0.0, -0.0, 1e-40, 1e-12, *cases(40)[0]):
        for v, a, j in zip(*cases(10)[1:], strict=True):
            switches = np.asarray(FROM_LIMITS[name](v, a, j).profile(angle).switches)
            assert np.all(np.diff(np.concatenate([[0.0], switches])) >= 0)


@pytest.mark.parametrize("scale", [1.0, 250.0])
def test_a_profile_of_a_distance_has_no_unit_of_an_angle(scale):
    """Metres or any other unit: the values scale with the unit, and nothing is called rad."""
    law, unit = SCurve(2.5 * scale, 1.0 * scale, 1.5 * scale), SCurve(2.5, 1.0, 1.5)
    found = law.profile(30.0 * scale, unit="m")
    np.testing.assert_allclose(found.duration, unit.profile(30.0).duration, rtol=1e-15)
    np.testing.assert_allclose(motion(found, 3.0), scale * motion(unit.profile(30.0), 3.0), rtol=1e-12)
    assert "rad" not in repr(law)
    slow = TimeOptimal(2.0, 1.0, duration=1.0)
    with pytest.raises(
        ValueError, match=r"a motion of 30 m with .* \(max_rate = 2 m/s and max_acceleration = 1 m/s²\)"
    ):
        slow.profile(30.0, unit="m")
    with pytest.raises(ValueError, match=r"a motion of 30 with .* \(max_rate = 2 and max_acceleration = 1\)"):
        slow.profile(30.0)
    with pytest.raises(ValueError, match=r"max_rate must be positive and finite \[rad/s or m/s\], but -2.0 was given"):
        TimeOptimal(-2.0, 1.0)


def test_a_longer_duration_that_the_end_rates_do_not_allow_is_refused():
    with pytest.raises(ValueError, match="some longer durations are impossible too"):
        TimeOptimal(2.0, 1.0, start_rate=1.0, end_rate=1.0, duration=1.0).profile(0.1)


def test_the_angle_is_constant_outside_the_duration():
    profile = SCurve(1.0, 1.0, 1.0).profile(0.5)
    assert motion(profile, -1.0).tolist() == [0, 0, 0, 0]
    assert motion(profile, 1e6).tolist() == [0.5, 0, 0, 0]
    assert motion(profile, profile.duration).tolist() == [0.5, 0, 0, 0]
    assert np.isnan(motion(profile, math.nan)[0])


def test_at_a_switch_the_later_side_counts():
    profile = TimeOptimal(1.0, 0.5).profile(5.0)
    assert [float(profile.acceleration(t)) for t in (0.0, 2.0, 5.0, 7.0)] == [0.5, 0.0, -0.5, 0.0]


def test_single_precision():
    for motion_profile in (TimeOptimal(1.0, 1.0), SCurve(1.0, 1.0, 1.0), Septic(max_acceleration=1.0)):
        profile = motion_profile.profile(jnp.float32(1e-9))
        angle = profile.angle(0.5 * profile.duration)
        assert angle.dtype == np.float32
        np.testing.assert_allclose(angle, 0.5e-9, rtol=1e-5)


@pytest.mark.parametrize(
    "make",
    [lambda: TimeOptimal(0.3, 0.2, start_rate=0.1), *(lambda m=m: m(0.3, 0.2, 0.1, 99.0) for m in IN_TIME.values())],
)
@pytest.mark.parametrize("suffix", [".toml", ".json"])
def test_profiles_are_stored_exactly(make, suffix, tmp_path):
    motion_profile = make()
    for thing in (motion_profile, motion_profile.profile(0.7)):
        save(thing, tmp_path / f"x{suffix}")
        again = load(tmp_path / f"x{suffix}")
        assert jax.tree.structure(again) == jax.tree.structure(thing)
        assert jax.tree.all(jax.tree.map(np.array_equal, again, thing))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: TimeOptimal(-1.0, 1.0), "max_rate must be positive"),
        (lambda: TimeOptimal(1.0, 0.0), "max_acceleration must be positive"),
        (lambda: TimeOptimal(1.0, math.inf), "max_acceleration must be positive and finite"),
        (lambda: TimeOptimal(1.0, 1.0, end_rate=-1.5), "end_rate = -1.5 and max_rate = 1.0 were given"),
        (lambda: TimeOptimal(1.0, 1.0, start_rate=math.nan), "start_rate must be finite"),
        (lambda: SCurve(1.0, 1.0, math.nan), "max_jerk must be positive"),
        (lambda: Quintic(), "needs a duration"),
        (lambda: Cubic(duration=0.0), "duration must be positive"),
        (lambda: Cubic(duration=1.0).profile(math.nan), "angle or distance of a profile must be finite"),
        (lambda: Cubic(duration=1.0).profile([1.0, 2.0]), "must be a scalar"),
    ],
)
def test_bad_input_is_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()
