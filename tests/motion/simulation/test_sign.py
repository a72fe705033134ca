"""λ and −λ are one attitude: the loop starts with the nearer one, and a hysteretic law keeps or changes its sign."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

import qtraj as qt
from qtraj.motion import control

from ..rigs import Rest, ThreeAxis

LAW = qt.AccelerationLaw(2.0, 1.0)
STILL = np.zeros(4)
TIMES = np.linspace(0.0, 12.0, 121)
LOOP = 1e-8
"""Tolerance against SciPy."""
NOISE = 0.1
"""Of the attitude [rad] per sample: μ0 near a half turn moves by half of that."""


def tilted(angle, axis=(1.0, -2.0, 2.0)):
    """The quaternion of a turn about an axis."""
    axis = np.asarray(axis) / np.linalg.norm(axis)
    return jnp.asarray([np.cos(angle / 2), *(np.sin(angle / 2) * axis)])


def turned_through(solution):
    """The total angle through which the body rotates [rad], by the trapezoidal rule."""
    return np.trapezoid(np.linalg.norm(solution.rate[:, 1:], axis=-1), solution.times)


@pytest.mark.parametrize("law", [LAW, qt.AccelerationLaw(2.0, 1.0, "additive"), qt.RateLaw(1.0)])
def test_both_signs_of_one_attitude_move_alike(law):
    """With the default sign; with "as given", the farther one takes the long way round."""
    start = tilted(np.radians(33.0))
    near, far = (qt.simulate(Rest(), law, sign * start, STILL, TIMES) for sign in (1.0, -1.0))
    np.testing.assert_array_equal(near.quaternion, far.quaternion)
    np.testing.assert_array_equal(near.command, far.command)
    same = qt.simulate(Rest(), law, start, STILL, TIMES, sign="as given")
    np.testing.assert_allclose(near.quaternion, same.quaternion, rtol=0, atol=1e-14)
    around = qt.simulate(Rest(), law, -start, STILL, TIMES, sign="as given", max_steps=256)
    np.testing.assert_allclose(near.angle.max(), np.radians(33.0), rtol=1e-12)
    assert np.nanmax(around.angle) > np.radians(100.0)
    assert np.nanmax(np.abs(around.command)) > 20 * np.max(np.abs(near.command))


def test_the_sign_is_chosen_for_each_element_of_a_batch_without_changing_derivatives():
    start = tilted(np.radians(33.0))

    def off(scale, sign):
        return qt.simulate(Rest(), LAW, sign * scale * start, STILL, [0.0, 2.0]).angle[-1]

    each, slopes = jax.jit(jax.vmap(jax.value_and_grad(off), (None, 0)))(1.0, jnp.asarray([1.0, -1.0]))
    np.testing.assert_array_equal(each[0], each[1])
    np.testing.assert_allclose(slopes[0], slopes[1], rtol=1e-12)
    assert abs(slopes[0]) > 1e-3


def test_another_sign_is_refused():
    with pytest.raises(ValueError, match=r"sign must be 'nearer'.*or 'as given', but 'far'"):
        qt.simulate(Rest(), LAW, tilted(1.0), STILL, TIMES, sign="far")


def hybrid(law, half_width, period, start, rate, looks):
    """An independent loop: SciPy integrates between updates of h by Mayhew's rule. Returns λ without sign, and h."""
    k1, k2 = 2.0, 1.0

    def product(p, q):
        return np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])

    def flow(t, y, h):
        q, w = y[:4], y[4:]
        mu = h * q  # the program is at rest at the identity
        if law == "feedback":
            command = np.concatenate([[0.0], -k1 * w[1:] - k2 * 2 * mu[1:] / np.linalg.norm(mu)])
        else:
            scalar = -0.5 * (w[0] ** 2 - w[1:] @ w[1:]) - k1 * w[0] - 2 * k2 * (1 - mu[0] / (mu @ mu))
            command = np.concatenate([[scalar], -(k1 + w[0]) * w[1:] - 2 * k2 * mu[1:] / (mu @ mu)])
        return np.concatenate([0.5 * product(q, w), command])

    y, h, states, signs = np.concatenate([start, rate]), 1.0, [], []
    for _ in range(looks):
        if h * y[0] < -half_width * np.linalg.norm(y[:4]):
            h = -h
        states.append(y)
        signs.append(h)
        y = solve_ivp(flow, (0.0, period), y, args=(h,), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return np.array(states), np.array(signs)


@pytest.mark.parametrize("kind", ["linear", "feedback"])
def test_the_hysteretic_loop_against_an_independent_one(kind):
    """A body that rotates beyond a half turn: the sign stays until μ0 < −δ, then changes once."""
    inner = LAW if kind == "linear" else qt.QuaternionFeedback(2.0, 1.0)
    law = qt.HystereticLaw(inner, 0.3, sampling=0.05)
    start, rate = tilted(np.radians(150.0), (0, 0, 1.0)), np.array([0.0, 0.0, 0.3, 6.0])
    expected, signs = hybrid(kind, 0.3, 0.05, np.asarray(start), rate, 120)
    solution = qt.simulate(Rest(), law, start, rate, 0.05 * np.arange(120))
    assert np.sum(np.diff(signs) != 0) >= 1
    np.testing.assert_allclose(solution.quaternion, signs[:, None] * expected[:, :4], rtol=0, atol=LOOP)
    np.testing.assert_allclose(solution.rate, expected[:, 4:], rtol=0, atol=LOOP)
    wrapped = qt.simulate(Rest(), inner, start, rate, 0.05 * np.arange(120))
    assert np.abs(wrapped.rate - solution.rate).max() > 0.1  # without memory the motion differs


def noisy(law, seed):
    """A body near a half turn; its attitude is measured with noise ten times per second."""
    sensor = qt.Sensor(attitude_noise=NOISE, key=jax.random.key(seed), sampling=0.1)
    return qt.simulate(Rest(), law, tilted(np.radians(179.9)), STILL, TIMES, sensor=sensor, rtol=1e-8, atol=1e-10)


def sign_changes(solution):
    mu = np.asarray(solution.quaternion)
    return int(np.sum(np.sum(mu[1:] * mu[:-1], axis=-1) < 0))


def test_noise_does_not_make_the_sign_chatter():
    """Near a half turn the nearer sign changes repeatedly; with hysteresis the sign does not change."""
    chattering = [sign_changes(noisy(qt.HystereticLaw(qt.QuaternionFeedback(2.0, 1.0), 0.0), k)) for k in range(4)]
    calm = [sign_changes(noisy(qt.HystereticLaw(qt.QuaternionFeedback(2.0, 1.0), 0.25), k)) for k in range(4)]
    linear = [sign_changes(noisy(qt.HystereticLaw(LAW), k)) for k in range(4)]
    assert sum(chattering) >= 8
    assert calm == linear == [0, 0, 0, 0]


def test_without_half_width_it_is_the_established_feedback():
    """δ = 0 uses the nearer sign at each sample, like `QuaternionFeedback`."""
    alone, wrapped = (
        noisy(law, 1)
        for law in (qt.QuaternionFeedback(2.0, 1.0), qt.HystereticLaw(qt.QuaternionFeedback(2.0, 1.0), 0.0))
    )
    np.testing.assert_allclose(alone.rate, wrapped.rate, atol=1e-9)


def test_it_does_not_unwind():
    """From the farther sign a law without memory rotates the body by nearly 360°; a hysteretic law does not."""
    start = -tilted(np.radians(20.0))
    plain = qt.simulate(Rest(), LAW, start, STILL, TIMES, sign="as given", max_steps=512)
    smart = qt.simulate(Rest(), qt.HystereticLaw(LAW, sampling=0.1), start, STILL, TIMES, sign="as given")
    assert turned_through(plain) > np.radians(330.0)
    np.testing.assert_allclose(turned_through(smart), np.radians(20.0), rtol=1e-3)


def test_between_changes_the_error_is_linear():
    """After each change the closed form applies: here from the first instant, on a moving program."""
    program, times = ThreeAxis(), np.linspace(0.0, 6.0, 25)
    start, rate = jnp.asarray([0.9, 0.7, -0.5, 0.6]), jnp.asarray([0.1, 0.6, -0.4, 0.9])
    solution = qt.simulate(program, qt.HystereticLaw(LAW, sampling=0.1), -start, rate, times)
    closed = control.closed_motion(LAW, jax.vmap(program)(times), start, rate, jnp.asarray(times))
    np.testing.assert_allclose(solution.error, closed.error, atol=1e-9)


def test_invalid_arguments_of_a_hysteretic_law(tmp_path):
    with pytest.raises(ValueError, match="needs an AccelerationLaw or a QuaternionFeedback"):
        qt.HystereticLaw(qt.GeometricFeedback(2.0, 1.0))
    with pytest.raises(ValueError, match=r"in \[0, 1\), but 1.0 was given"):
        qt.HystereticLaw(LAW, 1.0)
    with pytest.raises(ValueError, match="updates its sign at sampling instants"):
        qt.simulate(Rest(), qt.HystereticLaw(LAW), tilted(1.0), STILL, TIMES)
    law = qt.HystereticLaw(LAW, sampling=0.1)
    with pytest.raises(ValueError, match="must have the same sampling"):
        qt.simulate(Rest(), law, tilted(1.0), STILL, TIMES, actuator=qt.Actuator(sampling=0.2))
    law = qt.HystereticLaw(qt.QuaternionFeedback(2.0, 1.0), 0.1, 0.05)
    law.save(tmp_path / "law.toml")
    again = qt.load(tmp_path / "law.toml")
    assert all(np.array_equal(x, y) for x, y in zip(jax.tree.leaves(again), jax.tree.leaves(law), strict=True))
