"""Store the simulated motion of an arm: joints, gripper, errors, and the effect of singularities."""

import os

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.foundation import document
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.outcome import AbstractOutcome, ResultCode
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import batch_prefix, extent, times_text
from qtraj.foundation.types import ArrayInput


@storable
class ArmMotion(AbstractOutcome):
    """The motion of an arm with m joints under a law, at the instants `times` (n,) [s].

    `joints`, `joint_rates`, `joint_accelerations` (n, m): angles [rad] or lengths [m], and their time derivatives.
    `position` (n, 3) [m], `quaternion` λ (n, 4), not normalised, and `rate` (n, 4) [rad/s] of the gripper. Position and
    rate are in inertial axes; the virtual rate ω0 = d/dt ln|λ|² is first. `error` (n, 4): the error quaternion of the
    law. `angle` (n,) [rad]: the attitude error angle, from 0 to π. `distance` (n,) [m]: the distance between the
    gripper and the point of the path at the same instant. `smallest_singular_value` (n,): the smallest singular value
    of the Jacobian (in rad and m); without a path, only the three rows for ω are used. `angular_acceleration_error`
    (n,) [rad/s²] and `acceleration_error` (n,) [m/s²]: the magnitudes of the differences between actual and commanded
    acceleration of the gripper; where the damping is not active, they are round-off. Without a path, `distance` and
    `acceleration_error` are None. Values at instants that were not reached are NaN. `code`: a `ResultCode`. `result`: a
    description of the result.
    """

    times: Float[Array, "*batch n"]
    joints: Float[Array, "*batch n m"]
    joint_rates: Float[Array, "*batch n m"]
    joint_accelerations: Float[Array, "*batch n m"]
    position: Float[Array, "*batch n 3"]
    quaternion: Float[Array, "*batch n 4"]
    rate: Float[Array, "*batch n 4"]
    error: Float[Array, "*batch n 4"]
    angle: Float[Array, "*batch n"]
    smallest_singular_value: Float[Array, "*batch n"]
    angular_acceleration_error: Float[Array, "*batch n"]
    code: Int[Array, "*batch"]
    distance: Float[Array, "*batch n"] | None
    acceleration_error: Float[Array, "*batch n"] | None

    def __init__(
        self,
        times: ArrayInput,
        joints: ArrayInput,
        joint_rates: ArrayInput,
        joint_accelerations: ArrayInput,
        position: ArrayInput,
        quaternion: ArrayInput,
        rate: ArrayInput,
        error: ArrayInput,
        angle: ArrayInput,
        smallest_singular_value: ArrayInput,
        angular_acceleration_error: ArrayInput,
        code: ArrayInput,
        distance: ArrayInput | None = None,
        acceleration_error: ArrayInput | None = None,
    ):
        self.times, self.joints, self.joint_rates = as_float(times), as_float(joints), as_float(joint_rates)
        self.joint_accelerations, self.position = as_float(joint_accelerations), as_float(position)
        self.quaternion, self.rate, self.error = as_float(quaternion), as_float(rate), as_float(error)
        self.angle, self.smallest_singular_value = as_float(angle), as_float(smallest_singular_value)
        self.angular_acceleration_error = as_float(angular_acceleration_error)
        self.code = jnp.asarray(code, jnp.int32)
        self.distance = None if distance is None else as_float(distance)
        self.acceleration_error = None if acceleration_error is None else as_float(acceleration_error)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the motion without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json.
        """
        document.save(self, file)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result, with the largest deviation of the gripper's acceleration from the command."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        text = "finished: every instant was reached." if code == ResultCode.successful else code.text
        errors = {"rad/s²": self.angular_acceleration_error, "m/s²": self.acceleration_error}
        rows = {unit: np.asarray(x)[at] for unit, x in errors.items() if x is not None}
        if not any(np.isfinite(x).any() for x in rows.values()):
            return f"{text} No instant was reached."
        deviation = " and ".join(f"{np.nanmax(x):.3g} {unit}" for unit, x in rows.items())
        return f"{text} The gripper's acceleration deviated from the command by up to {deviation}."

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        per_joint, component = (along, "joint"), (along, "component")
        columns = {
            "joints": Quantity(self.joints, "", "angles [rad] or lengths [m] of the joints", per_joint),
            "joint_rates": Quantity(self.joint_rates, "", "rates of the joints [rad/s, m/s]", per_joint),
            "joint_accelerations": Quantity(
                self.joint_accelerations, "", "accelerations of the joints [rad/s², m/s²]", per_joint
            ),
            "position": Quantity(self.position, "m", "position of the gripper, inertial axes", (along, "world")),
            "quaternion": Quantity(self.quaternion, "1", "quaternion of the gripper, not normalised", component),
            "rate": Quantity(
                self.rate,
                "rad s-1",
                "angular rate of the gripper, inertial axes; virtual rate d/dt ln|λ|² [s-1] first",
                component,
            ),
            "error": Quantity(self.error, "1", "error quaternion of the law", component),
            "angle": Quantity(self.angle, "rad", "attitude error angle of the gripper", (along,)),
            "distance": Quantity(
                self.distance, "m", "distance between the gripper and the point of the path", (along,)
            ),
            "smallest_singular_value": Quantity(
                self.smallest_singular_value,
                "",
                "smallest singular value of the Jacobian in rad and m",
                (along,),
            ),
            "angular_acceleration_error": Quantity(
                self.angular_acceleration_error,
                "rad s-2",
                "magnitude of the actual minus the commanded angular acceleration of the gripper",
                (along,),
            ),
            "acceleration_error": Quantity(
                self.acceleration_error,
                "m s-2",
                "magnitude of the actual minus the commanded acceleration of the gripper",
                (along,),
            ),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
            "code": Quantity(self.code, "1", "result code"),
        }
        summary = f"{batch_prefix(self.code.shape)}{times_text(self.times)}: attitude error {extent(self.angle, 'rad')}"
        return Record(
            f"{summary}, smallest singular value {extent(self.smallest_singular_value)}",
            {name: q for name, q in columns.items() if q.values is not None},
            {"time": Quantity(self.times, "s", "time", (along,))},
            {"frame": "inertial"},
        )
