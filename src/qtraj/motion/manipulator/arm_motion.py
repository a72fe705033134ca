"""The simulated motion of an arm: joints, gripper and its errors, and the effect of singularities."""

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
    """An arm under a law at the instants `times` (n,) [s].

    `joints`, `joint_rates`, `joint_accelerations` (n, m): angles [rad] or lengths [m], and their derivatives.
    `position` (n, 3) [m], `quaternion` (n, 4), not normalised, and `rate` (n, 4) [rad/s] of the gripper; the rate is in
    inertial axes, ω0 = d/dt ln|λ|² first. `error` (n, 4): the error quaternion of the law. `angle` (n,) [rad]: the
    angle between gripper and program. `distance` (n,) [m]: the distance between gripper and path, None without a path.
    `smallest` (n,): the smallest singular value of the Jacobian. `missed` (n,): the norm of the difference between
    actual and commanded acceleration [rad/s², m/s²]; zero up to round-off if damping is not active. Values at instants
    that were not reached are NaN. `code` is a `ResultCode`, and `result` its text.
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
    smallest: Float[Array, "*batch n"]
    missed: Float[Array, "*batch n"]
    code: Int[Array, "*batch"]
    distance: Float[Array, "*batch n"] | None

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
        smallest: ArrayInput,
        missed: ArrayInput,
        code: ArrayInput,
        distance: ArrayInput | None = None,
    ):
        self.times, self.joints, self.joint_rates = as_float(times), as_float(joints), as_float(joint_rates)
        self.joint_accelerations, self.position = as_float(joint_accelerations), as_float(position)
        self.quaternion, self.rate, self.error = as_float(quaternion), as_float(rate), as_float(error)
        self.angle, self.smallest, self.missed = as_float(angle), as_float(smallest), as_float(missed)
        self.code = jnp.asarray(code, jnp.int32)
        self.distance = None if distance is None else as_float(distance)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the motion exactly to a TOML file, or to JSON if every instant was reached; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix.
        """
        document.save(self, file)

    def explain(self, at: tuple[int, ...]) -> str:
        """The result in words, with the effect of singularities."""
        code, missed = ResultCode(int(np.asarray(self.code)[at])), np.asarray(self.missed)[at]
        text = "finished: every instant was reached." if code == ResultCode.successful else code.text
        finite = missed[np.isfinite(missed)]
        if not finite.size:
            return f"{text} No instant was reached."
        deviation = f"{finite.max():.3g} (rad/s², m/s²)"
        return f"{text} The gripper's acceleration deviated from the command by up to {deviation}."

    def record(self) -> Record:
        """The motion over `time`, or over `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        per_joint, component = (along, "joint"), (along, "component")
        columns = {
            "joints": Quantity(self.joints, "", "angles [rad] or lengths [m] of the joints", per_joint),
            "joint_rates": Quantity(self.joint_rates, "", "rates of the joints [rad/s, m/s]", per_joint),
            "joint_accelerations": Quantity(
                self.joint_accelerations, "", "accelerations of the joints [rad/s², m/s²]", per_joint
            ),
            "position": Quantity(self.position, "m", "position of the gripper", (along, "world")),
            "quaternion": Quantity(self.quaternion, "1", "quaternion of the gripper, not normalised", component),
            "rate": Quantity(
                self.rate,
                "rad s-1",
                "angular rate of the gripper, inertial axes; virtual rate d/dt ln|λ|² [s-1] first",
                component,
            ),
            "error": Quantity(self.error, "1", "error quaternion of the law", component),
            "angle": Quantity(self.angle, "rad", "angle between gripper and program", (along,)),
            "distance": Quantity(self.distance, "m", "distance of the gripper from its path", (along,)),
            "smallest": Quantity(
                self.smallest,
                "",
                "smallest singular value of the Jacobian in rad and m",
                (along,),
            ),
            "missed": Quantity(self.missed, "", "norm of actual minus commanded acceleration [rad/s², m/s²]", (along,)),
            "result": Quantity(np.asarray(self.result), "", "the result in words"),
            "code": Quantity(self.code, "1", "result code"),
        }
        summary = (
            f"{batch_prefix(self.code.shape)}{times_text(self.times)}: angle to the program {extent(self.angle, 'rad')}"
        )
        return Record(
            f"{summary}, smallest singular value {extent(self.smallest)}",
            {name: q for name, q in columns.items() if q.values is not None},
            {"time": Quantity(self.times, "s", "time", (along,))},
            {"frame": "inertial"},
        )
