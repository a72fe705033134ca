"""A rigid body under a law: SciPy, conservation of momentum, energy balance, and the residual of the error equation."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import qtraj as qt

from ..rigs import Rest, ThreeAxis

LAW = qt.AccelerationLaw(2.0, 1.0)
START, RATE = jnp.asarray([0.9, 0.5, -0.3, 0.4]), jnp.asarray([0.1, 0.4, -0.3, 0.5])
TIMES = np.linspace(0.0, 6.0, 25)
INERTIA = np.array([[3.0, 0.2, -0.1], [0.2, 2.0, 0.3], [-0.1, 0.3, 4.0]])
ASSUMED = np.array([2.5, 2.2, 3.6])
EXTERNAL = np.array([0.05, -0.08, 0.03])
PYRAMID = np.array([[1.0, 0, 1], [0, 1, 1], [-1, 0, 1], [0, -1, 1]])
LOOP = 1e-8
"""Tolerance against SciPy."""


def thrusters(assumed=ASSUMED, torque=EXTERNAL, limit=1e3):
    """A body of one structure, whatever its numbers, so that one compiled function simulates all of them."""
    return qt.RigidBody(INERTIA, assumed, torque, None, limit)


def wheeled(assumed=ASSUMED, torque=EXTERNAL, limit=1.5, largest=50.0, momentum=(0.5, -0.2, 0.1, 0.3)):
    """A body with four wheels of one structure."""
    return qt.RigidBody(INERTIA, assumed, torque, qt.ReactionWheels(PYRAMID, limit, largest, momentum))


def product(p, q):
    return np.concatenate([[p[0] * q[0] - p[1:] @ q[1:]], p[0] * q[1:] + q[0] * p[1:] + np.cross(p[1:], q[1:])])


def scipy_body(program, wheels, limit, momentum_limit, momentum):
    """An independent simulation: law, motors, Euler's equations and wheels in NumPy, integrated by SciPy's DOP853."""
    columns = None if wheels is None else (wheels / np.linalg.norm(wheels, axis=1, keepdims=True)).T
    on_time = jax.jit(lambda t: program(t))

    def flow(t, y):
        q, w, h = y[:4], y[4:8], y[8:]
        at = jax.tree.map(np.array, on_time(t))
        conjugate = np.array([1, -1, -1, -1])
        mu = product(conjugate * at.quaternion, q)
        turned = Rotation.from_quat(mu, scalar_first=True)
        back = turned.inv()
        omega = back.apply(at.rate)
        excess = w[1:] - omega
        wanted = back.apply(at.acceleration) + np.cross(omega, excess) - (2.0 + w[0]) * excess
        wanted = wanted - 2 * mu[1:] / (mu @ mu)
        virtual = -0.5 * (w[0] ** 2 - excess @ excess) - 2.0 * w[0] - 2 * (1 - mu[0] / (mu @ mu))
        stored = np.zeros(3) if wheels is None else columns @ h
        torque = np.diag(ASSUMED) @ wanted + np.cross(w[1:], np.diag(ASSUMED) @ w[1:] + stored)
        if wheels is None:
            control, u = torque * min(1.0, limit / np.linalg.norm(torque)), h
        else:
            u = -np.linalg.lstsq(columns, torque, rcond=None)[0]
            u = u / max(1.0, np.abs(u).max() / limit)
            u = np.where((np.abs(h) >= momentum_limit) & (u * h > 0), 0.0, u)
            control = -columns @ u
        epsilon = np.linalg.solve(INERTIA, control + EXTERNAL - np.cross(w[1:], INERTIA @ w[1:] + stored))
        return np.concatenate([0.5 * product(q, w), [virtual], epsilon, u])

    start = np.concatenate([START, RATE, momentum])
    return solve_ivp(flow, (0, 6), start, method="DOP853", rtol=1e-10, atol=1e-11, t_eval=TIMES).y.T


@pytest.mark.parametrize("wheels", [False, True], ids=["thrusters", "wheels"])
def test_against_an_independent_simulation(wheels):
    """Wrong inertia, an external torque, motors at their limit."""
    momentum = np.array([0.5, -0.2, 0.1, 0.3]) if wheels else np.zeros(0)
    body = wheeled(momentum=momentum) if wheels else thrusters(limit=3.0)
    program = ThreeAxis()
    expected = scipy_body(program, PYRAMID if wheels else None, 1.5 if wheels else 3.0, 50.0, momentum)
    solution = qt.simulate(program, LAW, START, RATE, TIMES, body=body)
    np.testing.assert_allclose(solution.quaternion, expected[:, :4], rtol=0, atol=LOOP)
    np.testing.assert_allclose(solution.rate, expected[:, 4:8], rtol=0, atol=LOOP)
    if wheels:
        np.testing.assert_allclose(solution.body.momentum, expected[:, 8:], rtol=0, atol=LOOP)
    else:
        assert np.isclose(np.linalg.norm(solution.body.torque, axis=1).max(), 3.0)


def test_an_exact_inertia_gives_the_closed_form():
    """With the exact inertia and no external torque the acceleration is the command, and the closed form applies."""
    plain = qt.simulate(ThreeAxis(), LAW, START, RATE, TIMES)
    for body in (thrusters(INERTIA, np.zeros(3)), wheeled(INERTIA, np.zeros(3), limit=1e3)):
        solution = qt.simulate(ThreeAxis(), LAW, START, RATE, TIMES, body=body)
        np.testing.assert_allclose(solution.quaternion, plain.quaternion, rtol=0, atol=1e-9)
        assert np.abs(solution.body.mismatch).max() < 1e-12
        assert np.abs(solution.body.residual).max() < 1e-12
        assert np.abs(solution.body.deviation).max() < 1e-9


@pytest.mark.parametrize("kind", ["body", "inertial", "additive"])
def test_the_residual_of_the_error_equation(kind):
    """ẍ + K1ẋ + K2x of the simulated error by finite differences."""
    law, step = qt.AccelerationLaw(2.0, 1.5, kind), 1e-3
    fine = 1.0 + step * np.arange(-3, TIMES.size - 4)
    solution = qt.simulate(ThreeAxis(), law, START, RATE, [0.0, *fine], body=thrusters(), rtol=1e-13, atol=1e-14)
    x = np.asarray(solution.error[1:8]) - (0 if kind == "additive" else np.array([1.0, 0, 0, 0]))
    first = np.array([-1, 9, -45, 0, 45, -9, 1]) / 60 @ x / step
    second = np.array([2, -27, 270, -490, 270, -27, 2]) / 180 @ x / step**2
    np.testing.assert_allclose(solution.body.residual[4], second + 2.0 * first + 1.5 * x[3], rtol=0, atol=1e-6)
    assert np.abs(solution.body.residual[4]).max() > 0.01


def test_wheels_conserve_momentum_and_balance_energy():
    """Without an external torque R(Jω + Ah) is constant; the work of the motors and thrusters is the energy gained."""
    body = wheeled(torque=np.zeros(3))
    solution = qt.simulate(ThreeAxis(), LAW, START, RATE, TIMES, body=body)
    turned = Rotation.from_quat(np.asarray(solution.quaternion), scalar_first=True)
    momentum = turned.apply(np.array(solution.rate[:, 1:] @ INERTIA + solution.body.momentum @ body.wheels.axes))
    np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), atol=1e-9)
    body = qt.RigidBody(INERTIA, ASSUMED, EXTERNAL)
    dense = np.linspace(0.0, 4.0, 801)
    driven = qt.simulate(ThreeAxis(), LAW, START, RATE, dense, body=body)
    rate = np.asarray(driven.rate[:, 1:])
    energy = 0.5 * np.einsum("ni,ij,nj->n", rate, INERTIA, rate)
    power = np.einsum("ni,ni->n", np.asarray(driven.body.torque) + EXTERNAL, rate)
    simpson = (dense[1] - dense[0]) / 3 * (power[:-2:2] + 4 * power[1:-1:2] + power[2::2]).sum()
    np.testing.assert_allclose(energy[-1] - energy[0], simpson, rtol=1e-8)


def test_a_wheel_at_its_maximum_momentum():
    """A constant torque saturates the wheels; after that the control fails, and the result says so."""
    wheels = qt.ReactionWheels(np.eye(3), max_momentum=0.3)
    body = qt.RigidBody(INERTIA, torque=[0.0, 0.0, 0.1], wheels=wheels)
    times = np.linspace(0.0, 8.0, 33)
    solution = qt.simulate(Rest(), LAW, [1.0, 0, 0, 0], np.zeros(4), times, body=body, rtol=1e-8, atol=1e-10)
    assert solution.successful
    momentum = np.asarray(solution.body.momentum)
    assert np.abs(momentum).max() < 0.3 + 1e-4
    assert np.isclose(momentum[-1, 2], 0.3, atol=1e-4)
    before, after = solution.angle[8], solution.angle[-1]
    assert after > 10 * before
    assert "the acceleration deviated from the command by up to" in solution.result.lower()


def test_sampled_torques_are_held():
    """Between two samples the torque of thrusters is constant."""
    body = qt.RigidBody(INERTIA, ASSUMED)
    actuator = qt.Actuator(sampling=0.5)
    solution = qt.simulate(ThreeAxis(), LAW, START, RATE, [0.0, 0.2, 0.5, 0.7], actuator=actuator, body=body)
    torque = np.asarray(solution.body.torque)
    np.testing.assert_array_equal(torque[0], torque[1])
    np.testing.assert_array_equal(torque[2], torque[3])
    assert np.abs(torque[2] - torque[1]).max() > 0.1

    def free(t, w):
        return np.linalg.solve(INERTIA, torque[0] - np.cross(w, INERTIA @ w))

    expected = solve_ivp(free, (0, 0.5), RATE[1:], method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    np.testing.assert_allclose(solution.rate[2, 1:], expected, atol=1e-9)


def test_invalid_arguments(tmp_path):
    for call, expected in (
        (lambda: qt.ReactionWheels(np.eye(3)[:2]), "at least three wheels"),
        (lambda: qt.ReactionWheels([[1.0, 0, 0], [0, 1, 0], [1, 1, 0]]), "must span three dimensions"),
        (lambda: qt.ReactionWheels(np.eye(3), max_torque=-1.0), "max_torque must be positive"),
        (lambda: qt.ReactionWheels(np.eye(3), max_momentum=[1.0, 2.0]), r"must be a scalar or have shape \(3,\)"),
        (lambda: qt.ReactionWheels(np.eye(3), momentum=[1.0, 2.0]), "the momenta of 3 wheels"),
        (
            lambda: qt.ReactionWheels(np.eye(3), max_momentum=[9.0, 1.0, 2.0], momentum=[8.0, 0.5, -2.5]),
            r"momentum of wheel 2 \(counted from 0\) is -2.5 N m s, but its max_momentum is 2 N m s: reduce",
        ),
        (lambda: qt.RigidBody(-1.0), "symmetric with positive"),
        (lambda: qt.RigidBody(1.0, wheels=np.eye(3)), "wheels must be ReactionWheels"),
        (
            lambda: qt.RigidBody(1.0, wheels=qt.ReactionWheels(np.eye(3)), max_torque=1.0),
            "limits thrusters, but wheels were given",
        ),
        (lambda: qt.simulate(Rest(), LAW, START, RATE, TIMES, body=3.0), "body must be an object such as"),
        (
            lambda: qt.simulate(Rest(), qt.RateLaw(1.0), START, RATE, TIMES, body=qt.RigidBody(1.0)),
            "a rate law commands",
        ),
    ):
        with pytest.raises(ValueError, match=expected):
            call()
    solution = qt.simulate(ThreeAxis(), LAW, START, RATE, TIMES, body=wheeled(largest=4.0))
    solution.save(tmp_path / "motion.toml")
    again = qt.load(tmp_path / "motion.toml")
    np.testing.assert_array_equal(again.body.residual, solution.body.residual)
    assert set(solution.to_xarray()) >= {"torque", "momentum", "mismatch", "residual", "deviation"}
