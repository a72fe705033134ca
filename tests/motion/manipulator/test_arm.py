"""Serial arms: kinematics against homogeneous matrices, control against the closed form and a SciPy loop."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import qtraj as qt

LAW = qt.AccelerationLaw(2.0, 1.0, "inertial")
JOINTS = np.array([0.3, -0.7, 0.5, 0.4, 0.9, -0.2])
RATES = np.array([0.1, -0.2, 0.05, 0.3, -0.1, 0.2])
TIMES = np.linspace(0.0, 4.0, 9)
RIGHT = np.pi / 2
DH = np.zeros((6, 4))
DH[:, 1] = [-RIGHT, RIGHT, 0.0, -RIGHT, RIGHT, 0.0]
DH[[0, 1, 5], 2] = [0.412, 0.154, 0.263]
DH[2, 3] = -RIGHT
CLOSED = 1e-8
"""Tolerance of the gripper's error against the closed form of a free body, with default tolerances."""


def homogeneous(q):
    """The frame of the gripper from Denavit–Hartenberg matrices, and the frames of all joints."""
    frame, before = np.eye(4), []
    for k, (a, alpha, d, theta) in enumerate(DH):
        before.append(frame)
        theta, d = (theta, d + q[k]) if k == 2 else (theta + q[k], d)
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("ZX", [theta, alpha]).as_matrix()
        turn[:3, 3] = [a * np.cos(theta), a * np.sin(theta), d]
        frame = frame @ turn
    return frame, before


def geometric(q):
    """The geometric Jacobian from those frames."""
    end, before = homogeneous(q)
    columns = [
        np.concatenate([np.zeros(3), f[:3, 2]])
        if k == 2
        else np.concatenate([f[:3, 2], np.cross(f[:3, 2], end[:3, 3] - f[:3, 3])])
        for k, f in enumerate(before)
    ]
    return np.stack(columns, axis=1)


def test_pose_and_jacobian_against_homogeneous_matrices():
    arm, rng = qt.stanford_arm(), np.random.default_rng(20)
    for _ in range(5):
        q, q_dot = jnp.asarray(rng.normal(size=6)), rng.normal(size=6)
        position, attitude = arm.pose(q)
        frame, _ = homogeneous(np.array(q))
        np.testing.assert_allclose(position, frame[:3, 3], atol=1e-14)
        np.testing.assert_allclose(qt.rotation.to_dcm(attitude).T, frame[:3, :3], atol=1e-14)
        np.testing.assert_allclose(arm.jacobian(q), geometric(np.array(q)), atol=1e-14)
        step = 1e-5
        slope = (geometric(np.array(q) + step * q_dot) - geometric(np.array(q) - step * q_dot)) / (2 * step)
        np.testing.assert_allclose(arm.bias(q, jnp.asarray(q_dot)), slope @ q_dot, atol=1e-8)


def test_modified_parameters_against_craigs_matrices():
    """Craig, Introduction to Robotics, (3.6), written out; joint 3 is prismatic."""
    rows, kinds = np.random.default_rng(4).uniform(-1.5, 1.5, (4, 4)), ["revolute"] * 2 + ["prismatic", "revolute"]
    arm = qt.Arm.from_dh(rows, kinds, convention="modified")
    for q in np.random.default_rng(5).uniform(-2, 2, (3, 4)):
        frame = np.eye(4)
        for (a, alpha, d, theta), kind, value in zip(rows, kinds, q, strict=True):
            d, theta = (d, theta + value) if kind == "revolute" else (d + value, theta)
            ca, sa, ct, st = np.cos(alpha), np.sin(alpha), np.cos(theta), np.sin(theta)
            frame = frame @ [
                [ct, -st, 0, a],
                [st * ca, ct * ca, -sa, -sa * d],
                [st * sa, ct * sa, ca, ca * d],
                [0, 0, 0, 1],
            ]
        position, attitude = arm.pose(q)
        np.testing.assert_allclose(position, frame[:3, 3], atol=1e-14)
        np.testing.assert_allclose(qt.rotation.to_dcm(attitude).T, frame[:3, :3], atol=1e-14)


def test_an_unknown_convention_is_refused():
    with pytest.raises(ValueError, match="'classic' or 'modified', but 'craig'"):
        qt.Arm.from_dh(DH, convention="craig")


def test_an_arm_can_be_made_inside_a_trace():
    inside = jax.jit(lambda q: qt.stanford_arm().pose(q)[0])(jnp.asarray(JOINTS))
    np.testing.assert_allclose(inside, homogeneous(JOINTS)[0][:3, 3], atol=1e-14)
    with pytest.raises(ValueError, match="must be concrete, but a traced array"):
        jax.jit(lambda rows: qt.Arm.from_dh(rows).home_position)(jnp.asarray(DH))


def program():
    start = qt.stanford_arm().pose(jnp.asarray(JOINTS))[1]
    off = qt.rotation.from_rotation_vector(jnp.asarray([0.4, -0.3, 0.5]))
    end = qt.quaternion.product(start, qt.rotation.from_rotation_vector(jnp.asarray([-0.3, 0.8, 0.4])))
    return qt.EulerTurn(qt.quaternion.product(off, start), end, qt.Septic(duration=4.0))


@pytest.mark.parametrize("kind", ["inertial", "body", "additive"])
def test_the_gripper_has_the_linear_error_of_a_free_body(kind):
    """Attitude alone, six joints: law (2.2), the Jacobian and the bias together, against the closed form."""
    law, turn = qt.AccelerationLaw(2.0, 1.0, kind), program()
    motion = qt.simulate_arm(qt.stanford_arm(), turn, law, JOINTS, RATES, TIMES)
    assert motion.successful
    assert motion.angular_acceleration_error.max() < 1e-10
    body = qt.quaternion.rotate(qt.quaternion.conjugate(motion.quaternion[0]), motion.rate[0, 1:])
    first = jnp.concatenate([jnp.zeros(1), body])
    closed = qt.control.closed_motion(law, jax.vmap(turn)(TIMES), motion.quaternion[0], first, jnp.asarray(TIMES))
    np.testing.assert_allclose(motion.error, closed.error, atol=CLOSED)
    np.testing.assert_allclose(motion.angle, closed.angle, atol=CLOSED)


START = homogeneous(JOINTS)[0][:3, 3]


def circle(t):
    """The path of the gripper, near its initial position."""
    return START + 0.1 * jnp.stack([jnp.sin(0.8 * t), 1 - jnp.cos(0.8 * t), 0.3 * jnp.sin(0.5 * t) + 0.2])


def test_pose_against_an_independent_loop():
    """Attitude and position, six joints: SciPy integrates q̈ of its own Jacobian, feedback in rotation matrices."""
    turn, path = program(), qt.Curve(circle, 4.0)
    motion = qt.simulate_arm(qt.stanford_arm(), turn, LAW, JOINTS, RATES, TIMES, path, gains=(3.0, 2.25))
    on_time = jax.jit(lambda t: (turn.at(t, axes="inertial"), path.derivatives(t, 2)))

    def flow(t, y):
        q, q_dot, log_norm, omega0 = y[:6], y[6:12], y[12], y[13]
        at, r = jax.tree.map(np.array, on_time(t))
        frame, _ = homogeneous(q)
        jacobian = geometric(q)
        h = 1e-6
        bias = (geometric(q + h * q_dot) - geometric(q - h * q_dot)) / (2 * h) @ q_dot
        twist = jacobian @ q_dot
        turned = Rotation.from_matrix(frame[:3, :3]) * Rotation.from_quat(at.quaternion, scalar_first=True).inv()
        mu = np.exp(log_norm) * turned.as_quat(scalar_first=True, canonical=True)
        # The inertial form with scalar gains, by its vectors: ε = R*ε⁰ + Ω×w − (k1 + ω0)Ω − 2k2 μ_v/|μ|², Ω = ω − w.
        w = turned.apply(at.rate)
        excess = twist[:3] - w
        epsilon = turned.apply(at.acceleration) + np.cross(excess, w) - (2.0 + omega0) * excess
        epsilon = epsilon - 2 * mu[1:] / (mu @ mu)
        virtual = -0.5 * (omega0**2 - excess @ excess) - 2.0 * omega0 - 2 * (1 - mu[0] / (mu @ mu))
        push = r[2] - 3.0 * (twist[3:] - r[1]) - 2.25 * (frame[:3, 3] - r[0])
        return np.concatenate(
            [q_dot, np.linalg.solve(jacobian, np.concatenate([epsilon, push]) - bias), [0.5 * omega0, virtual]]
        )

    start = np.concatenate([JOINTS, RATES, [0.0, 0.0]])
    expected = solve_ivp(flow, (0, 4), start, method="DOP853", rtol=1e-9, atol=1e-10, t_eval=TIMES).y.T
    assert motion.smallest_singular_value.min() > 0.06
    np.testing.assert_allclose(motion.joints, expected[:, :6], rtol=0, atol=1e-6)
    np.testing.assert_allclose(motion.joint_rates, expected[:, 6:12], rtol=0, atol=1e-6)


def test_the_position_has_a_linear_error():
    path, k = qt.Curve(circle, 4.0), 1.5
    motion = qt.simulate_arm(qt.stanford_arm(), program(), LAW, JOINTS, np.zeros(6), TIMES, path, gains=(2 * k, k * k))
    x = np.asarray(motion.position[0] - circle(0.0))
    v = -np.asarray(jax.jvp(circle, (0.0,), (1.0,))[1])
    expected = np.exp(-k * TIMES)[:, None] * (x + TIMES[:, None] * (v + k * x))
    found = motion.position - jax.vmap(circle)(TIMES)
    np.testing.assert_allclose(found, expected, atol=CLOSED)
    np.testing.assert_allclose(motion.distance, np.linalg.norm(expected, axis=1), atol=CLOSED)


def test_a_singular_wrist():
    """The fifth joint at zero: three wrist axes in a plane. Accelerations stay finite; the result has the deviation."""
    joints, path = JOINTS.copy(), qt.Curve(circle, 4.0)
    joints[4] = 1e-3
    start = qt.stanford_arm().pose(jnp.asarray(joints))[1]
    end = qt.quaternion.product(start, qt.rotation.from_rotation_vector(jnp.asarray([0.9, 0.0, 0.0])))
    turn = qt.EulerTurn(start, end, qt.Septic(duration=4.0))
    motion = qt.simulate_arm(
        qt.stanford_arm(),
        turn,
        LAW,
        joints,
        np.zeros(6),
        TIMES,
        path,
        damping=qt.Damping(0.1, 0.1),
        rtol=1e-7,
        atol=1e-9,
    )
    assert motion.successful
    assert np.all(np.isfinite(motion.joints))
    assert motion.smallest_singular_value[0] < 0.01
    assert np.abs(motion.joint_accelerations).max() < 50.0
    assert motion.angular_acceleration_error.max() > 1e-3
    assert motion.acceleration_error.max() > 1e-3
    assert re.search(r"deviated from the command by up to \S+ rad/s² and \S+ m/s²\.", motion.result)


def redundant():
    """Four joints for an attitude, their angles and rates, and a program that stays at the first attitude."""
    arm = qt.Arm([qt.Joint(axis) for axis in ([0, 0, 1.0], [0, 1.0, 0], [1.0, 0, 0], [0, 0, 1.0])], [0.0, 0, 1.0])
    joints, rates = np.array([0.2, 0.5, -0.3, 0.4]), np.array([0.5, 0.1, -0.4, -0.6])
    start = arm.pose(jnp.asarray(joints))[1]
    return arm, qt.EulerTurn(start, start, qt.Quintic(duration=1.0)), joints, rates


def test_redundant_joints_come_to_rest():
    """The gripper follows, and joint motion that does not move it decays."""
    arm, turn, joints, rates = redundant()
    motion = qt.simulate_arm(arm, turn, LAW, joints, rates, np.linspace(0.0, 16.0, 17))
    assert motion.successful
    np.testing.assert_allclose(motion.joint_rates[-1], 0.0, atol=1e-4)
    assert motion.angle[-1] < 1e-4


def test_batches_agree_with_single_motions_which_are_stored(tmp_path):
    arm, turn, joints, rates = redundant()
    times = np.linspace(0.0, 0.8, 17)  # as many as in the test above, whose compiled code is used again
    many = jax.vmap(lambda q: qt.simulate_arm(arm, turn, LAW, q, rates, times))(jnp.stack([joints, joints + 0.1]))
    assert many.joints.shape == (2, 17, 4)
    one = qt.simulate_arm(arm, turn, LAW, joints, rates, times)
    np.testing.assert_allclose(many.joints[0], one.joints, atol=1e-12)
    one.save(tmp_path / "arm.toml")
    np.testing.assert_array_equal(qt.load(tmp_path / "arm.toml").joints, one.joints)


def test_invalid_arguments():
    arm, turn = qt.stanford_arm(), program()
    short = qt.Arm([qt.Joint([0, 0, 1.0])] * 3, [0.0, 0, 1.0])
    for call, expected in (
        (lambda: qt.Joint([0.0, 0, 0]), "must not be zero"),
        (lambda: qt.Joint([0.0, 0, 1], kind="ball"), "'revolute' or 'prismatic', but 'ball'"),
        (lambda: qt.Arm([], [0.0, 0, 1]), "non-empty sequence of Joint"),
        (lambda: qt.Arm.from_dh(np.zeros((2, 3))), r"rows must have shape \(n, 4\)"),
        (lambda: qt.Arm.from_dh(np.zeros((2, 4)), ["revolute"]), "one entry for each of 2 rows"),
        (lambda: qt.simulate_arm(3.0, turn, LAW, JOINTS, RATES, TIMES), "the arm must be an Arm"),
        (lambda: qt.simulate_arm(arm, 3.0, LAW, JOINTS, RATES, TIMES), "the program must be an attitude program"),
        (lambda: qt.simulate_arm(arm, turn, qt.RateLaw(1.0), JOINTS, RATES, TIMES), "has no discrete state"),
        (lambda: qt.simulate_arm(arm, turn, LAW, JOINTS[:5], RATES, TIMES), r"the joints must have shape \(6,\)"),
        (lambda: qt.simulate_arm(short, turn, LAW, [0, 0, 0], [0, 0, 0], TIMES, qt.Curve(circle, 4.0)), "6 joints"),
        (lambda: qt.Damping(-1.0), "threshold of damping must be positive"),
        (lambda: qt.Damping(idle=-1.0), "decay rate 'idle' must not be negative"),
        (lambda: qt.Arm(3, [0.0, 0, 1]), "non-empty sequence of Joint"),
        (lambda: qt.Arm(arm.joints, [0.0, 0, 1], np.zeros(4)), "home quaternion must not be zero"),
        (lambda: qt.simulate_arm(arm, turn, LAW, JOINTS, RATES, TIMES, gains=4.0), r"two numbers, \(k1, k2\)"),
        (
            lambda: qt.simulate_arm(arm, turn, LAW, JOINTS, RATES, TIMES, gains=(4.0, -1.0)),
            "position gain k2 must be",
        ),
        (lambda: qt.simulate_arm(arm, turn, qt.HystereticLaw(LAW), JOINTS, RATES, TIMES), "has no discrete state"),
        (lambda: qt.simulate_arm(arm, turn, LAW, JOINTS, RATES, TIMES, jumps=1.0), "jumps must be a vector"),
    ):
        with pytest.raises(ValueError, match=expected):
            call()


def test_numpy_arrays_are_computed_in_numpy(compiled):
    arm = qt.stanford_arm()
    position, attitude = arm.pose(np.zeros(6))
    columns = arm.jacobian([0, 0, 0, 0, 0, 0])
    assert all(type(x) is np.ndarray and x.dtype == np.float64 for x in (position, attitude, columns))
    assert not compiled
    np.testing.assert_allclose(columns, jax.jit(lambda q: arm.jacobian(q))(np.zeros(6)), atol=1e-15)
