"""Compute the motion of a closed loop without disturbances in closed form, from the program and the error."""

import os

import equinox as eqx
import jax
from jaxtyping import Array, Float

from qtraj.foundation import document
from qtraj.foundation.arrays import as_float
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, times_text
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_angle, error_quaternion, error_rate, state_from_error
from qtraj.motion.control.laws import AccelerationLaw, RateLaw, require_linear
from qtraj.motion.control.response import error_state


@storable
class ClosedMotion(AbstractResult):
    """The motion of a closed loop in closed form, at the instants `times` (n,) [s].

    `error` (n, 4): the error quaternion of the law. `quaternion` (n, 4): the quaternion λ of the body. `angle` (n,)
    [rad]: the attitude error angle, from 0 to π. Under `vmap` all fields have leading batch axes.
    """

    times: Float[Array, "*batch n"]
    error: Float[Array, "*batch n 4"]
    quaternion: Float[Array, "*batch n 4"]
    angle: Float[Array, "*batch n"]

    def __init__(self, times: ArrayInput, error: ArrayInput, quaternion: ArrayInput, angle: ArrayInput):
        self.times, self.error = as_float(times), as_float(error)
        self.quaternion, self.angle = as_float(quaternion), as_float(angle)

    def record(self) -> Record:
        """Return the fields with units, along `time`, or along `sample` if each batch element has its own times."""
        along = "time" if self.times.ndim == 1 else "sample"
        axes = (along, "component")
        variables = {
            "error": Quantity(self.error, "1", "error quaternion of the law", axes),
            "quaternion": Quantity(self.quaternion, "1", "attitude, body to inertial, not normalised", axes),
            "angle": Quantity(self.angle, "rad", "attitude error angle", (along,)),
        }
        batch = batch_prefix(self.angle.shape[:-1])
        summary = f"{batch}{times_text(self.times)}: attitude error {extent(self.angle, 'rad')}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the motion without loss of precision to a TOML or JSON file, which `qtraj.load` reads.

        **Raises:** ValueError for a suffix other than .toml or .json.
        """
        document.save(self, file)


@on_one_device
@eqx.filter_jit
def closed_motion(
    law: AccelerationLaw | RateLaw, references: Attitude, quaternion: Quat, rate: Quat, times: Float[Array, " n"]
) -> ClosedMotion:
    """Compute the motion of a body that follows a program without disturbances, at `times` (n,) [s].

    `references`: the attitudes of the program at these times, with fields (n, …). `quaternion` (4,) and `rate` (4,)
    [rad/s], body axes, virtual rate first: the state at times[0]. A rate law does not use `rate`.

    **Raises:** ValueError for a law of another class, whose error equation is not linear: use `simulate`.
    """
    require_linear(law, "the motion under a law")
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    first = jax.tree.map(lambda x: x[0], references)
    error, derivative = error_quaternion(first, quaternion, kind), error_rate(first, quaternion, rate, kind)

    def at(reference: Attitude, t: Scalar) -> tuple[Quat, Quat, Scalar]:
        x, v = error_state(law, error, derivative, t - times[0])
        body, _ = state_from_error(reference, x, v, kind)
        return x, body, error_angle(reference, body)

    return ClosedMotion(times, *jax.vmap(at)(references, times))
