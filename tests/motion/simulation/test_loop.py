"""The closed loop with jumps, samples, disturbances and single precision, and failures within a batch."""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.foundation.types import Quat
from qtraj.motion import control

from ..rigs import Rest, ThreeAxis

AT_DEFAULTS = 1e-9
START = jnp.asarray([0.9, 0.1, -0.2, 0.3])
RATE = jnp.asarray([0.1, 0.6, -0.4, 0.9])
LAW = qt.AccelerationLaw(2.0, 1.0)


def test_jumps_of_a_program_cost_nothing_when_passed():
    """With `jumps`, a bang–bang slew is as accurate as a smooth program, in few steps."""
    turn = qt.EulerTurn([1.0, 0, 0, 0], [0.3, 0.5, -0.4, 0.6], qt.TimeOptimal(0.6, 0.4))
    switches, times = turn.profile.switches, np.linspace(0.0, 6.0, 4)
    assert np.all((switches > 0.1) & (switches < 5.9))  # none of them an output
    solution = qt.simulate(turn, LAW, START, RATE, times, jumps=switches, max_steps=16)
    at = turn(0.0)
    expected = control.error_response(
        LAW, control.error_quaternion(at, START), control.error_rate(at, START, RATE), times
    )
    np.testing.assert_allclose(solution.error, expected, rtol=0, atol=AT_DEFAULTS)
    without_jumps = qt.simulate(turn, LAW, START, RATE, times, max_steps=16)
    assert "as jumps" in without_jumps.result


@pytest.mark.slow
def test_the_derivative_in_the_time_of_a_jump_is_exact():
    def miss(switch):
        def disturbance(t):
            return jnp.where(t < switch, 0.5, -0.3) * jnp.asarray([1.0, 0.4, -0.2])

        motion = qt.simulate(
            Rest(), LAW, START, RATE, [0.0, 2.0], disturbance=disturbance, jumps=switch[None], rtol=1e-12, max_steps=64
        )
        return motion.quaternion[-1] @ jnp.asarray([0.2, 1.0, -0.5, 0.7])

    slope = jax.jit(lambda s: jax.jvp(miss, (s,), (1.0,)))
    switch, step = 0.77, 1e-5
    difference = (slope(switch + step)[0] - slope(switch - step)[0]) / (2 * step)
    assert abs(difference) > 0.05
    np.testing.assert_allclose(slope(switch)[1], difference, rtol=1e-8)


class Held(eqx.Module):
    """A constant command under a varying disturbance."""

    command: Quat

    def __call__(self, t, quaternion, rate):
        return self.command + jnp.concatenate([jnp.zeros(1), disturbance(t)])


def disturbance(t):
    return jnp.stack([0.3 * jnp.sin(2 * t), 0.1 * t, -0.2 * jnp.cos(t)])


def test_a_sampled_sensor_with_noise_bias_limits_and_a_disturbance():
    """Compared with one open-loop integration from sample to sample."""
    program, period, count = ThreeAxis(), 0.25, 8
    sensor = qt.Sensor(
        rate_bias=[0.02, -0.01, 0.03],
        rate_noise=0.05,
        attitude_bias=[0.01, 0.02, -0.01],
        attitude_noise=0.02,
        sampling=period,
        key=jax.random.key(3),
    )
    actuator = qt.Actuator([0.8, 0.5, 0.9], "axis")
    between = [0.0, 0.3, 0.5, 1.1, 1.75, 2.0]
    solution = qt.simulate(program, LAW, START, RATE, between, disturbance, sensor, actuator)

    @jax.jit
    def command(k, t, quaternion, rate):
        known, seen, _ = sensor.measure(k, jnp.asarray(period), quaternion, rate, None)
        return actuator(LAW(program(t), known, seen))

    state, expected = (START, RATE), {}
    for k in range(count):
        held = command(jnp.asarray(k), k * period, *state)
        inside = [t for t in between if k * period <= t < (k + 1) * period]
        middle = inside[-1] if inside and inside[-1] > k * period else (k + 0.5) * period
        motion = qt.integrate(Held(held), *state, [k * period, middle, (k + 1) * period])
        for t in inside:
            row = int(t > k * period)
            expected[t] = np.concatenate([motion.quaternion[row], motion.rate[row], held])
        state = (motion.quaternion[-1], motion.rate[-1])
    expected[2.0] = np.concatenate([*state, command(jnp.asarray(count), 2.0, *state)])
    result = np.concatenate([solution.quaternion, solution.rate, solution.command], axis=1)
    np.testing.assert_allclose(result, [expected[t] for t in between], rtol=0, atol=AT_DEFAULTS)
    assert np.any(np.isclose(np.abs(result[:, 9:]), [0.8, 0.5, 0.9]))  # the limits are active
    assert np.abs(result[:, 9:]).min() < 0.4


SINGLE = 2e-5
"""Some roundings of float32 numbers of size 1."""


def single(**parts):
    """A simulation in float32, except for the program."""
    start, rate, times = (jnp.asarray(x, jnp.float32) for x in (START, RATE, [0, 1, 2, 3]))
    solution = qt.simulate(ThreeAxis(), LAW, start, rate, times, **parts)
    assert solution.successful
    for x in (solution.quaternion, solution.rate, solution.command, solution.error, solution.angle):
        assert x.dtype == np.float32
    return solution


def test_single_precision():
    at = jax.jit(lambda: ThreeAxis()(0.0))()
    mu0, slope = control.error_quaternion(at, START), control.error_rate(at, START, RATE)
    expected = control.error_response(LAW, mu0, slope, np.arange(4.0))
    np.testing.assert_allclose(single().error, expected, rtol=0, atol=SINGLE)


def test_single_precision_with_samples():
    """The last sample is at the end, although the end is not a multiple of the float32 period."""
    parts = {"sensor": qt.Gyros(0.1), "actuator": qt.Actuator(1.0)}
    double = qt.simulate(ThreeAxis(), LAW, START, RATE, np.arange(4.0), **parts)
    result = single(**parts)
    for name in ("quaternion", "rate", "command"):
        np.testing.assert_allclose(getattr(result, name), getattr(double, name), rtol=0, atol=SINGLE)


BIAS = np.array([0.02, -0.03, 0.05])


def test_biases_are_small_rotations_in_body_axes_and_rates():
    sensor = qt.Sensor(attitude_bias=BIAS, rate_bias=[1.0, 2.0, 3.0])
    quaternion, rate, _ = sensor.measure(jnp.asarray(0), jnp.asarray(0.0), 2 * START, RATE, None)
    true, seen = (Rotation.from_quat(q, scalar_first=True) for q in (START, quaternion))
    np.testing.assert_allclose((true.inv() * seen).as_rotvec(), BIAS, atol=1e-15)
    np.testing.assert_allclose(rate, RATE + np.arange(4.0), atol=1e-15)


def test_a_continuous_sensor_shifts_the_body_by_its_bias():
    """The body settles where the sensor measures no error: at λ⁰∘exp(−b/2)."""
    solution = qt.simulate(Rest(), LAW, START, RATE, [0.0, 40.0], sensor=qt.Sensor(attitude_bias=BIAS))
    expected = Rotation.from_rotvec(-BIAS).as_quat(scalar_first=True)
    np.testing.assert_allclose(solution.quaternion[-1], expected, rtol=0, atol=AT_DEFAULTS)
    np.testing.assert_allclose(solution.angle[-1], np.linalg.norm(BIAS), rtol=AT_DEFAULTS)


@pytest.mark.parametrize("sampled", [False, True])
def test_failed_elements_do_not_affect_the_rest_of_a_batch(sampled):
    """Values that are not finite, a zero quaternion, a pole, and gains that need too many steps."""
    count = 12
    start, rate = np.tile(START, (count, 1)), np.tile(RATE, (count, 1))
    start += 0.05 * np.random.default_rng(2).normal(size=start.shape)
    stiffness, torque = np.full(count, 1.0), np.full(count, 0.1)
    times = np.linspace(0.0, 2.0, 3)
    parts = {"sensor": qt.Gyros(0.5), "actuator": qt.Actuator(5.0)} if sampled else {}

    @jax.jit
    @jax.vmap
    def run(start, rate, stiffness, torque):
        law = qt.AccelerationLaw(2.0, stiffness)
        late = qt.DisturbanceAcceleration(lambda t: jnp.where(t > 1.2, torque, 0.1) * jnp.ones(3))
        return qt.simulate(Rest(), law, start, rate, times, late, max_steps=256, **parts)

    healthy = run(start, rate, stiffness, torque)
    assert healthy.successful.all()
    start[1], rate[2], start[3], stiffness[4], torque[5], stiffness[6] = np.nan, np.inf, 0.0, np.nan, np.nan, 1e9
    if not sampled:
        start[7], rate[7], torque[7] = -np.eye(4)[0], 0.0, 0.0  # reaches the pole
    failed = np.arange(1, 7 if sampled else 8)
    both = run(start, rate, stiffness, torque)
    good = np.setdiff1d(np.arange(count), failed)
    assert both.successful[good].all()
    for name in ("quaternion", "rate", "command", "error"):
        np.testing.assert_array_equal(getattr(both, name)[good], getattr(healthy, name)[good])
    if sampled:  # a held command is limited, so stiffness is harmless
        assert not both.successful[failed[:5]].any()
    else:
        assert not both.successful[failed[:-1]].any()
    reached = [both.result[k].count("Last instant reached: t = 1 s") for k in (4, 5)]
    assert reached == [0, 1]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"disturbance": lambda t: jnp.zeros(4)}, r"a disturbance must return a vector \(3,\)"),
        ({"jumps": [[1.0]]}, "jumps must be a vector"),
        ({"jumps": [np.nan]}, "jumps must be finite"),
    ],
)
def test_invalid_disturbances_and_jumps_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        qt.simulate(Rest(), LAW, START, RATE, [0.0, 1.0], **change)
