"""Store the simulated motion of a body under a law for position and attitude."""

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
class PoseMotion(AbstractOutcome):
    """The motion of a body under a law for position and attitude, at the instants `times` (n,) [s].

    `position` (n, 3) [m], `velocity` (n, 3) [m/s] and the commanded `acceleration` (n, 3) [m/s²] are in inertial axes.
    `quaternion` (n, 4) is not normalised. `rate` (n, 4) [rad/s] is in body axes, with the virtual rate ω0 = d/dt ln|λ|²
    first. `command` (n, 4) [rad/s²]: the commanded angular acceleration, body axes, virtual part first. `error` (n, 8):
    the pose error M, a dual quaternion: first the real part μ, then the dual part [m]. `distance` (n,) [m]: the
    magnitude of the position error. `angle` (n,) [rad]: the attitude error angle, from 0 to π. Values at instants that
    were not reached are NaN. `code`: a `ResultCode`. `result`: a description of the result.
    """

    times: Float[Array, "*batch n"]
    position: Float[Array, "*batch n 3"]
    velocity: Float[Array, "*batch n 3"]
    acceleration: Float[Array, "*batch n 3"]
    quaternion: Float[Array, "*batch n 4"]
    rate: Float[Array, "*batch n 4"]
    command: Float[Array, "*batch n 4"]
    error: Float[Array, "*batch n 8"]
    distance: Float[Array, "*batch n"]
    angle: Float[Array, "*batch n"]
    code: Int[Array, "*batch"]

    def __init__(
        self,
        times: ArrayInput,
        position: ArrayInput,
        velocity: ArrayInput,
        acceleration: ArrayInput,
        quaternion: ArrayInput,
        rate: ArrayInput,
        command: ArrayInput,
        error: ArrayInput,
        distance: ArrayInput,
        angle: ArrayInput,
        code: ArrayInput,
    ):
        self.times, self.position, self.velocity = as_float(times), as_float(position), as_float(velocity)
        self.acceleration, self.quaternion, self.rate = as_float(acceleration), as_float(quaternion), as_float(rate)
        self.command, self.error = as_float(command), as_float(error)
        self.distance, self.angle = as_float(distance), as_float(angle)
        self.code = jnp.asarray(code, jnp.int32)

    def explain(self, at: tuple[int, ...]) -> str:
        """Describe the result, with advice."""
        code = ResultCode(int(np.asarray(self.code)[at]))
        return "finished: every instant was reached." if code == ResultCode.successful else code.text

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the motion without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json.
        """
        document.save(self, file)

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        world, component = (along, "world"), (along, "component")
        variables = {
            "position": Quantity(self.position, "m", "position, inertial axes", world),
            "velocity": Quantity(self.velocity, "m s-1", "velocity, inertial axes", world),
            "acceleration": Quantity(self.acceleration, "m s-2", "commanded acceleration, inertial axes", world),
            "quaternion": Quantity(self.quaternion, "1", "attitude, body to inertial, not normalised", component),
            "rate": Quantity(
                self.rate, "rad s-1", "angular rate, body axes; virtual rate d/dt ln|λ|² [s-1] first", component
            ),
            "command": Quantity(self.command, "rad s-2", "commanded angular acceleration, body axes", component),
            "error": Quantity(self.error[..., :4], "1", "real part of the pose error, the error quaternion", component),
            "dual_error": Quantity(self.error[..., 4:], "m", "dual part of the pose error", component),
            "distance": Quantity(self.distance, "m", "magnitude of the position error", (along,)),
            "angle": Quantity(self.angle, "rad", "attitude error angle", (along,)),
            "result": Quantity(np.asarray(self.result), "", "description of the result"),
            "code": Quantity(self.code, "1", "result code"),
        }
        errors = f"distance {extent(self.distance, 'm')}, attitude error {extent(self.angle, 'rad')}"
        summary = f"{batch_prefix(self.code.shape)}{times_text(self.times)}: {errors}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"})
