"""Poses: dual quaternions against homogeneous matrices, the law against closed forms and an independent SciPy loop."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import qtraj as qt
from qtraj import dual_quaternion as dual
from qtraj.motion.simulation.task import switches_of, within

RNG = np.random.default_rng(20)
TIMES = np.linspace(0.0, 2.4, 9)
LAW = qt.PoseLaw(qt.AccelerationLaw(2.0, 1.0), 3.0, [2.0, 2.5, 3.0])
POSITION, VELOCITY = np.array([8.5, 2.0, 0.3]), np.array([0.5, 3.0, -0.4])
QUATERNION, RATE = np.array([0.9, 0.2, -0.1, 0.5]), np.array([0.05, 0.3, -0.2, 0.4])
CLOSED = 1e-8
SIGNS = ("nearer", "as given")


def program():
    path = qt.SpiralHelix([8.0, 0.3, 0.1], [0.4, 0.5, 0.05], [1.0, 0.4, -0.2, 0.03], 2.5)
    return qt.PoseProgram(path, qt.FrameProgram(path, qt.Upright()))


def matrix(position, q):
    frame = np.eye(4)
    frame[:3, :3] = Rotation.from_quat(np.array(q), scalar_first=True).as_matrix()
    frame[:3, 3] = position
    return frame


def test_dual_quaternions_are_homogeneous_matrices():
    """Composition, inverse, points and the derivative, for any length of λ."""
    (r1, r2, x), (q1, q2) = jnp.asarray(RNG.normal(size=(3, 3))), jnp.asarray(RNG.normal(size=(2, 4)))
    a, b = dual.from_pose(r1, q1), dual.from_pose(r2, q2)
    position, q = dual.to_pose(dual.product(a, b))
    np.testing.assert_allclose(matrix(position, q), matrix(r1, q1) @ matrix(r2, q2), atol=1e-13)
    back = dual.to_pose(dual.inverse(a))
    np.testing.assert_allclose(matrix(*back), np.linalg.inv(matrix(r1, q1)), atol=1e-13)
    np.testing.assert_allclose(dual.product(a, dual.inverse(a)), np.eye(8)[0], atol=1e-14)
    np.testing.assert_allclose(dual.transform(a, x), (matrix(r1, q1) @ [*x, 1.0])[:3], atol=1e-13)
    np.testing.assert_allclose(dual.to_pose(dual.from_pose(r1, q1))[0], r1, atol=1e-14)
    unit = dual.from_pose(r1, q1 / jnp.linalg.norm(q1))
    np.testing.assert_allclose(dual.conjugate(unit), dual.inverse(unit), atol=1e-14)
    omega, velocity = jnp.asarray(RNG.normal(size=4)), jnp.asarray(RNG.normal(size=3))
    slope = jax.jvp(dual.from_pose, (r1, q1), (velocity, qt.quaternion.derivative(q1, omega)))[1]
    np.testing.assert_allclose(dual.derivative(a, omega, velocity), slope, atol=1e-13)


def test_the_errors_of_both_are_exactly_linear():
    """Against SciPy's matrix exponentials and `closed_pose`; the dual error contains both errors."""
    both = program()
    motion = qt.simulate_pose(both, LAW, POSITION, VELOCITY, QUATERNION, RATE, TIMES)
    assert motion.successful
    place, reference = both(0.0)
    k1, k2 = 3.0 * np.eye(3), np.diag([2.0, 2.5, 3.0])
    block = np.block([[np.zeros((3, 3)), np.eye(3)], [-k2, -k1]])
    start = np.concatenate([POSITION - place[0], VELOCITY - place[1]])
    expected = np.array([(expm(block * t) @ start)[:3] for t in TIMES])
    offset = motion.position - jax.vmap(both.path.position)(TIMES)
    np.testing.assert_allclose(offset, expected, atol=CLOSED)
    mu0 = qt.control.error_quaternion(reference, jnp.asarray(QUATERNION))
    rate0 = qt.control.error_rate(reference, jnp.asarray(QUATERNION), jnp.asarray(RATE))
    np.testing.assert_allclose(motion.error[:, :4], qt.error_response(LAW.attitude, mu0, rate0, TIMES), atol=CLOSED)
    closed = qt.closed_pose(both, LAW, *map(jnp.asarray, (POSITION, VELOCITY, QUATERNION, RATE, TIMES)))
    np.testing.assert_allclose(jax.vmap(dual.from_pose)(motion.position, motion.quaternion), closed, atol=10 * CLOSED)
    wanted = jax.vmap(both.dual)(TIMES)
    np.testing.assert_allclose(motion.error, jax.vmap(qt.pose_error)(wanted, closed), atol=10 * CLOSED)
    in_program = jax.vmap(lambda m: dual.to_pose(m)[0])(motion.error)
    np.testing.assert_allclose(np.linalg.norm(in_program, axis=1), motion.distance, atol=1e-12)
    np.testing.assert_allclose(motion.distance, np.linalg.norm(expected, axis=1), atol=CLOSED)


def test_the_switches_of_a_program_and_the_knots_of_a_route_are_instants_of_the_integration():
    """A body that starts on a time-optimal slew and a route stays on them, to round-off of the solver."""
    turn = qt.EulerTurn([1.0, 0, 0, 0], [0.5, 0.5, 0.5, 0.5], qt.TimeOptimal(1.5, 2.0))
    knots = np.array([0.0, 0.7, 1.3, 2.4])
    rows = np.random.default_rng(20).normal(size=(3, 4, 3))
    both = qt.PoseProgram(qt.Route(knots, *rows), turn)
    place, attitude = both(0.0)
    start = place[0], place[1], attitude.quaternion, [0.0, *attitude.rate]
    motion = qt.simulate_pose(both, LAW, *start, TIMES)
    assert motion.angle.max() < 1e-11
    assert motion.distance.max() < 1e-11
    whole = qt.simulate_pose(both, LAW, *start, TIMES, jumps=[])
    assert max(whole.angle.max(), whole.distance.max()) > 10 * max(motion.angle.max(), motion.distance.max())
    found = np.asarray(switches_of(turn, both.path))
    np.testing.assert_allclose(found, np.unique([*turn.switches, *knots]))
    assert within(jnp.asarray([0.5, 2.0]), jnp.asarray(found)).shape[0] < found.shape[0]


def test_disturbed_motion_against_an_independent_loop():
    """SciPy with rotation matrices and constant disturbances; the position error at rest is push/k2."""
    both, push, twist = program(), np.array([0.3, -0.2, 0.1]), np.array([0.02, 0.03, -0.01])
    on_time = jax.jit(lambda t: both(t))

    def flow(t, y):
        q, w, r, v = y[:4], y[4:8], y[8:11], y[11:]
        place, at = jax.tree.map(np.array, on_time(t))
        turned = Rotation.from_quat(at.quaternion, scalar_first=True).inv() * Rotation.from_quat(q, scalar_first=True)
        mu = np.linalg.norm(q) * turned.as_quat(scalar_first=True, canonical=True)
        back = turned.inv()
        omega = back.apply(at.rate)
        excess = w[1:] - omega
        epsilon = back.apply(at.acceleration) + np.cross(omega, excess) - (2.0 + w[0]) * excess
        epsilon = epsilon - 2 * mu[1:] / (mu @ mu) + twist
        virtual = -0.5 * (w[0] ** 2 - excess @ excess) - 2.0 * w[0] - 2 * (1 - mu[0] / (mu @ mu))
        slope = [0.5 * (q[0] * w[0] - q[1:] @ w[1:])]
        slope = np.concatenate([slope, 0.5 * (q[0] * w[1:] + w[0] * q[1:] + np.cross(q[1:], w[1:]))])
        pull = 3.0 * (v - place[1]) + np.array([2.0, 2.5, 3.0]) * (r - place[0])
        return np.concatenate([slope, [virtual], epsilon, v, place[2] - pull + push])

    start = np.concatenate([QUATERNION, RATE, POSITION, VELOCITY])
    expected = solve_ivp(flow, (0, 2.4), start, method="DOP853", rtol=1e-10, atol=1e-11, t_eval=TIMES).y.T
    motion = qt.simulate_pose(
        both, LAW, POSITION, VELOCITY, QUATERNION, RATE, TIMES, push, lambda t: jnp.asarray(twist)
    )
    np.testing.assert_allclose(motion.quaternion, expected[:, :4], atol=1e-7)
    np.testing.assert_allclose(motion.rate, expected[:, 4:8], atol=1e-7)
    np.testing.assert_allclose(motion.position, expected[:, 8:11], atol=1e-7)
    np.testing.assert_allclose(motion.velocity, expected[:, 11:], atol=1e-7)


def test_signs_storage_and_invalid_arguments(tmp_path):
    times = np.linspace(0.0, 0.5, TIMES.size)  # as many as above, whose compiled code is used again
    both, state = program(), (POSITION, VELOCITY, QUATERNION, RATE, times)
    near = qt.simulate_pose(both, LAW, *state)
    far = qt.simulate_pose(both, LAW, POSITION, VELOCITY, -QUATERNION, RATE, times)
    np.testing.assert_array_equal(near.quaternion, far.quaternion)
    closed = {
        sign: qt.closed_pose(both, LAW, POSITION, VELOCITY, -QUATERNION, RATE, times, sign=sign) for sign in SIGNS
    }
    given = qt.simulate_pose(both, LAW, POSITION, VELOCITY, -QUATERNION, RATE, times, sign="as given")
    for motion, sign in ((near, "nearer"), (given, "as given")):
        pose = jax.vmap(dual.from_pose)(motion.position, motion.quaternion)
        np.testing.assert_allclose(pose, closed[sign], atol=10 * CLOSED)
    assert np.abs(closed["nearer"] - closed["as given"]).max() > 0.1
    near.save(tmp_path / "pose.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "pose.toml").error, near.error)
    for call, expected in (
        (lambda: qt.PoseProgram(both, both.attitude), "path must be a path, such as a SpiralHelix"),
        (lambda: qt.PoseProgram(both.path, both.path), "the attitude must be an attitude program"),
        (lambda: qt.PoseLaw(qt.RateLaw(1.0), 1.0, 1.0), "has no discrete state"),
        (lambda: qt.PoseLaw(LAW.attitude, [1.0, 2.0], 1.0), "k1 must be a number, 3 numbers"),
        (lambda: qt.simulate_pose(both.path, LAW, *state), "must be a PoseProgram"),
        (lambda: qt.simulate_pose(both, LAW.attitude, *state), "must be a PoseLaw"),
        (lambda: qt.simulate_pose(both, LAW, *state, sign="far"), "sign must be"),
        (lambda: qt.simulate_pose(both, LAW, *state, push=[1.0]), r"the push must have shape \(3,\)"),
        (lambda: qt.PoseLaw(qt.HystereticLaw(LAW.attitude), 1.0, 1.0), "has no discrete state"),
        (lambda: qt.PoseLaw(LAW.attitude, [1.0, -2.0, 1.0], 1.0), "position gain k1 must be positive"),
        (lambda: qt.closed_pose(both, LAW, np.zeros(4), *state[1:]), r"the position must have shape \(3,\)"),
        (lambda: qt.closed_pose(both, LAW, *state, sign="far"), "sign must be"),
        (lambda: qt.closed_pose(both, LAW, *state[:4], [0.5, 0.0]), "times must increase"),
    ):
        with pytest.raises(ValueError, match=expected):
            call()
