"""Define a serial arm by its joints, and compute the pose of its gripper and the geometric Jacobian.

Each joint is described by its axis for joint values of zero, in base coordinates (product of exponentials). The pose of
the gripper is the product of the motions of the joints, in order from the base, and of the pose for zero joint values.
With the joint values q, the angular and the linear velocity of the gripper are (ω, v) = J(q) q̇. Its angular and its
linear acceleration are (ε, a) = J q̈ + J̇ q̇. The components are in inertial
axes, the axes of the base.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.algebra import quaternion, rotation
from qtraj.algebra.quaternion import product, rotate
from qtraj.algebra.vector import cross, norm
from qtraj.foundation.arrays import as_float, concrete, real_vector
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.namespace import as_floats, in_numpy, scan, xp
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Vec3

REVOLUTE, PRISMATIC = "revolute", "prismatic"
CLASSIC, MODIFIED = "classic", "modified"

Joints = Float[Array, " n"]
Jacobian = Float[Array, "6 n"]


@storable
class Joint(eqx.Module):
    """A joint of an arm, described in the axes of the base for joint values of zero.

    `axis` (3,): a vector along the joint axis, not necessarily normalised. `point` (3,) [m]: a point on the axis, not
    used for a prismatic joint. `kind`: "revolute" (the joint value is an angle [rad]) or "prismatic" (the joint value
    is a length [m]).

    **Raises:** ValueError for an axis that is zero, an array of another shape, or an unknown `kind`.
    """

    axis: Vec3
    point: Vec3
    kind: str = eqx.field(static=True)

    def __repr__(self) -> str:
        return shown(self, point="m")

    def __init__(self, axis: ArrayInput, point: ArrayInput = (0.0, 0.0, 0.0), kind: str = REVOLUTE):
        axis = real_vector(axis, "the axis of a joint", 3)
        values = concrete(axis)
        if values is not None and not values.any():
            raise ValueError("the axis of a joint must not be zero: pass the direction of the axis")
        if kind not in (REVOLUTE, PRISMATIC):
            raise ValueError(f"the kind of a joint must be 'revolute' or 'prismatic', but {kind!r} was given")
        self.axis = axis / norm(axis)
        self.point = real_vector(point, "the point on the axis of a joint", 3).astype(axis.dtype)
        self.kind = kind


@storable
class Arm(eqx.Module):
    """A serial arm, described by its `joints` from the base to the gripper and the pose for zero joint values.

    `home_position` (3,) [m] and `home_quaternion` (4,), gripper to base, are the pose of the gripper for zero joint
    values. `Arm.from_dh` creates an arm from Denavit–Hartenberg parameters.

    **Raises:** ValueError if `joints` is not a non-empty sequence of `Joint`, if the position or the quaternion has
    another shape, or if the quaternion is zero.
    """

    joints: tuple[Joint, ...]
    home_position: Vec3
    home_quaternion: Quat

    def __repr__(self) -> str:
        return shown(self, home_position="m")

    def __init__(
        self,
        joints: Sequence[Joint],
        home_position: ArrayInput,
        home_quaternion: ArrayInput = (1.0, 0.0, 0.0, 0.0),
    ):
        self.joints = tuple(joints) if isinstance(joints, Sequence) else ()
        if not self.joints or not all(isinstance(joint, Joint) for joint in self.joints):
            raise ValueError(
                f"the joints of an arm must be a non-empty sequence of Joint(axis, point), but {joints!r} was given"
            )
        self.home_position = real_vector(home_position, "the home position", 3)
        attitude = real_vector(home_quaternion, "the home quaternion", 4)
        values = concrete(attitude)
        if values is not None and not values.any():
            raise ValueError("the home quaternion must not be zero, because zero does not represent an attitude")
        self.home_quaternion = quaternion.unit(attitude)

    @classmethod
    def from_dh(cls, rows: ArrayInput, kinds: Sequence[str] | None = None, convention: str = CLASSIC) -> Arm:
        """Create an arm from its classic or modified Denavit–Hartenberg parameters.

        `rows` (n, 4): the parameters a [m], α [rad], d [m] and θ [rad] of each joint for joint values of zero; the
        joint value is added to θ or d. `kinds` (n,): "revolute" or "prismatic"; with None, all joints are revolute.

        With the `convention` "classic", joint i rotates about, or moves along, the z axis of frame i − 1, and frame i
        is frame i − 1 after d and θ about this axis, and then a and α about its own x axis. With "modified" (Craig,
        Introduction to Robotics, section 3.4), row i contains a and α of link i − 1, which are applied first; then d
        and θ about the z axis of frame i, which is the axis of joint i. The gripper is the last frame.

        **Raises:** ValueError for rows that are traced, not finite or of another shape; if `kinds` and `rows` have
        different lengths; and for another `convention`.
        """
        if convention not in (CLASSIC, MODIFIED):
            raise ValueError(f"the convention must be {CLASSIC!r} or {MODIFIED!r}, but {convention!r} was given")
        with jax.ensure_compile_time_eval():  # constants stay concrete inside a trace
            table = concrete(as_float(rows))
        if table is None:
            raise ValueError(
                "Denavit–Hartenberg rows must be concrete, but a traced array was given: use Arm(joints, home_position)"
            )
        if table.ndim != 2 or table.shape[0] == 0 or table.shape[1] != 4:
            raise ValueError(
                f"rows must have shape (n, 4), with columns a, alpha, d and theta, but shape {table.shape} was given"
            )
        if not np.isfinite(table).all():
            raise ValueError(f"Denavit–Hartenberg rows must be finite, but {table.tolist()} was given")
        kinds = [REVOLUTE] * len(table) if kinds is None else list(kinds)
        if len(kinds) != len(table):
            raise ValueError(f"kinds must have one entry for each of {len(table)} rows, but {len(kinds)} were given")
        frame, joints = np.eye(4), []
        for (a, alpha, d, theta), kind in zip(table, kinds, strict=True):
            link, screw = _along_x(a, alpha), _along_z(d, theta)
            frame = frame @ link if convention == MODIFIED else frame
            joints.append(Joint(frame[:3, 2], frame[:3, 3], kind))
            frame = frame @ screw if convention == MODIFIED else frame @ screw @ link
        axes: Any = frame[:3, :3].T
        return cls(joints, frame[:3, 3], rotation.from_dcm(axes))

    def pose(self, q: Joints) -> tuple[Vec3, Quat]:
        """Return position [m] and unit quaternion of the gripper; the quaternion is a continuous function of `q`.

        `q` (n,): the joint values, angles [rad] and lengths [m].
        """
        return self.kinematics(q)[:2]

    def jacobian(self, q: Joints) -> Jacobian:
        """Return the Jacobian J (6, n) with (ω, v) = J q̇, the rate and the velocity of the gripper in inertial axes."""
        return self.kinematics(q)[2]

    @on_one_device
    def bias(self, q: Joints, q_dot: Joints) -> Float[Array, 6]:
        """Return J̇ q̇ (6,), the angular [rad/s²] and linear [m/s²] acceleration of the gripper for q̈ = 0."""
        q, q_dot = jnp.asarray(as_floats(q)), jnp.asarray(as_floats(q_dot))
        expected = (len(self.joints),)
        if q.shape != expected or q_dot.shape != expected:
            raise ValueError(
                f"q and q_dot must have shape {expected}, but shapes {q.shape} and {q_dot.shape} were given: use "
                "jax.vmap for a batch"
            )
        return jax.jvp(lambda q: jnp.matmul(self.jacobian(q), q_dot, precision="highest"), (q,), (q_dot,))[1]

    def kinematics(self, q: Joints) -> tuple[Vec3, Quat, Jacobian]:
        """Return the position [m], the unit quaternion and the Jacobian (6, n) of the gripper, computed in one pass."""
        return _kinematics(self, as_floats(q))


def stanford_arm() -> Arm:
    """Return the Stanford arm, which has six joints; the third joint is prismatic.

    The Denavit–Hartenberg parameters are from Fu, Gonzalez and Lee (1987): d1 = 0.412 m, d2 = 0.154 m and d6 = 0.263 m.
    The wrist is singular if the fifth joint value is zero, and the arm is singular if the third joint value is zero.
    """
    quarter = np.pi / 2
    rows = [
        [0.0, -quarter, 0.412, 0.0],
        [0.0, quarter, 0.154, 0.0],
        [0.0, 0.0, 0.0, -quarter],
        [0.0, -quarter, 0.0, 0.0],
        [0.0, quarter, 0.0, 0.0],
        [0.0, 0.0, 0.263, 0.0],
    ]
    return Arm.from_dh(rows, [REVOLUTE, REVOLUTE, PRISMATIC, REVOLUTE, REVOLUTE, REVOLUTE])


@in_numpy
def _kinematics(arm: Arm, q: Joints) -> tuple[Vec3, Quat, Jacobian]:
    axes = xp.stack([joint.axis.astype(q.dtype) for joint in arm.joints])
    points = xp.stack([joint.point.astype(q.dtype) for joint in arm.joints])
    turns = np.array([joint.kind == REVOLUTE for joint in arm.joints])
    start = np.eye(4, dtype=q.dtype)[0], np.zeros(3, q.dtype)
    (rotated, shift), (axes, points) = scan(_after_joint, start, (axes, points, turns, q))
    tip = rotate(rotated, arm.home_position.astype(q.dtype)) + shift
    arms = xp.where(turns[:, None], cross(axes, tip[None] - points), axes)
    columns = xp.concatenate([xp.where(turns[:, None], axes, 0.0), arms], axis=1)
    return tip, product(rotated, arm.home_quaternion.astype(q.dtype)), columns.T


def _after_joint(frame: tuple[Quat, Vec3], joint: Any) -> tuple[tuple[Quat, Vec3], tuple[Vec3, Vec3]]:
    """Return the motion of the frame after a joint, and the current axis of the joint and a point on it.

    `frame` is the rotation and the translation of the frame before the joint. `joint`: the axis and the point for joint
    values of zero, whether the joint is revolute, and its value.
    """
    (rotated, shift), (axis, point, turns, value) = frame, joint
    axis, point = rotate(rotated, axis), rotate(rotated, point) + shift
    spin = quaternion.exp(0.5 * xp.where(turns, value, 0.0) * axis)
    moved = xp.where(turns, point + rotate(spin, shift - point), shift + value * axis)
    return (product(spin, rotated), moved), (axis, point)


def _along_x(a: float, alpha: float) -> np.ndarray:
    """Return the transformation (4, 4) from a frame that is moved by `a` [m] and turned by `alpha` [rad] about x."""
    c, s = np.cos(alpha), np.sin(alpha)
    return np.array([[1, 0, 0, a], [0, c, -s, 0], [0, s, c, 0], [0, 0, 0, 1]])


def _along_z(d: float, theta: float) -> np.ndarray:
    """Return the transformation (4, 4) from a frame that is moved by `d` [m] and turned by `theta` [rad] about z."""
    c, s = np.cos(theta), np.sin(theta)
    return np.array([[c, -s, 0, 0], [s, c, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
