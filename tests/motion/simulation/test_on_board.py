"""The sampled loop of an on-board computer: an independent simulation, and exact derivatives."""

import diffrax
import jax
import jax.numpy as jnp
import numpy as np
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj.motion.control import AccelerationLaw
from qtraj.motion.simulation.actuator import Actuator
from qtraj.motion.simulation.sensor import Gyros
from qtraj.motion.simulation.simulate import simulate

from ..rigs import Rest, ThreeAxis

RATE = jnp.asarray([0.1, 0.6, -0.4, 0.9])
PERIOD, LIMIT = 0.1, 1.2
BIAS = np.array([0.004, -0.003, 0.002])


def on_board_loop(program, bias, instants):
    """An independent simulation: SciPy integrates the body under each held command; the computer has gyros only."""
    k1, k2 = 2.0, 1.0

    def attitude(x):
        return Rotation.from_quat(x / np.linalg.norm(x), scalar_first=True)

    def flow(t, y, command):
        q, w = y[:4], y[4:]
        return np.concatenate(
            [
                [0.5 * (q[0] * w[0] - q[1:] @ w[1:])],
                0.5 * (q[0] * w[1:] + w[0] * q[1:] + np.cross(q[1:], w[1:])),
                command,
            ]
        )

    def law(at, q, w):
        mu = (attitude(at.quaternion).inv() * attitude(q)).as_quat(scalar_first=True) * np.linalg.norm(q)
        mu = mu * np.sign(mu[0])  # the body starts near the program, so the sign does not change
        back = attitude(mu).inv()
        omega = back.apply(at.rate)
        excess = w[1:] - omega
        vector = back.apply(at.acceleration) + np.cross(omega, excess) - (k1 + w[0]) * excess
        vector = vector - 2 * k2 * mu[1:] / (mu @ mu)
        vector = vector * min(1.0, LIMIT / np.linalg.norm(vector))
        scalar = -0.5 * (w[0] ** 2 - excess @ excess) - k1 * w[0] - 2 * k2 * (1 - mu[0] / (mu @ mu))
        return np.concatenate([[scalar], vector])

    state, known = np.concatenate([NEAR, RATE]), attitude(NEAR)
    history, last = [state], state[4:] + np.concatenate([[0.0], bias])
    for k, t in enumerate(instants[:-1]):
        reading = state[4:] + np.concatenate([[0.0], bias])
        if k:
            turn = 0.5 * PERIOD * (last + reading)[1:] + PERIOD**2 / 12 * np.cross(last[1:], reading[1:])
            known = known * Rotation.from_rotvec(turn)
        last = reading
        size = np.linalg.norm(state[:4])
        command = law(program(t), size * known.as_quat(scalar_first=True), reading)
        state = solve_ivp(flow, (0, PERIOD), state, args=(command,), method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        history.append(state)
    return np.array(history)


NEAR = np.array([0.9, 0.1, -0.2, 0.3])


def test_the_on_board_loop_with_gyros_only():
    """Sampled gyros → λ propagated on board → limited and held command (paper C, remark 1)."""
    program = ThreeAxis()
    outputs = PERIOD * np.arange(0, 41, 4)
    on_time = jax.jit(lambda t: program(t))

    def run(bias):
        sensor = Gyros(PERIOD, bias=bias)
        return simulate(
            program, AccelerationLaw(2.0, 1.0), NEAR, RATE, outputs, sensor=sensor, actuator=Actuator(LIMIT)
        )

    drifting, ideal = run(BIAS), run(np.zeros(3))
    expected = on_board_loop(lambda t: jax.tree.map(np.array, on_time(t)), BIAS, PERIOD * np.arange(41))[::4]
    np.testing.assert_allclose(drifting.quaternion, expected[:, :4], rtol=0, atol=1e-8)
    np.testing.assert_allclose(drifting.rate, expected[:, 4:], rtol=0, atol=1e-8)
    np.testing.assert_allclose(drifting.peak_command, LIMIT, rtol=1e-12)
    # The computer's attitude, and with it the body's, drifts by bias times time.
    drift = qt.quaternion.product(qt.quaternion.conjugate(ideal.quaternion[-1]), drifting.quaternion[-1])
    angle = 2 * jnp.arctan2(jnp.linalg.norm(drift[1:]), jnp.abs(drift[0]))
    np.testing.assert_allclose(angle, np.linalg.norm(BIAS) * outputs[-1], rtol=0.3)


def test_the_derivative_in_gains_and_in_switch_instants_is_exact():
    """Derivatives compared with central differences of the same loop, whose command changes at given instants."""

    def miss(point):
        k1, k2, *instants = point
        actuator = Actuator(sampling=jnp.stack([jnp.zeros(()), *instants]))
        solution = simulate(
            Rest(),
            AccelerationLaw(k1, k2),
            NEAR,
            RATE,
            [0.0, 1.7],
            actuator=actuator,
            rtol=1e-12,
            adjoint=diffrax.ForwardMode(),
        )
        return jnp.sum(solution.error[-1] * jnp.asarray([0.2, 1.0, -0.5, 0.7]))

    @jax.jit
    def with_slope(point, direction):
        return jax.jvp(miss, (point,), (direction,))

    point, step = np.array([2.1, 1.3, 0.31, 0.83, 1.2]), 1e-5
    for direction in np.eye(5):
        _, slope = with_slope(point, direction)
        ends = [with_slope(point + sign * step * direction, direction)[0] for sign in (1, -1)]
        np.testing.assert_allclose(slope, (ends[0] - ends[1]) / (2 * step), rtol=0, atol=1e-8)
        assert abs(slope) > 1e-3
