"""The motion of a closed loop that nothing disturbs, in closed form: the program, and the error that decays upon it."""

import os

import equinox as eqx
import jax
from jaxtyping import Array, Float

from qtraj.foundation import document
from qtraj.foundation.arrays import as_float
from qtraj.foundation.document import storable
from qtraj.foundation.record import Quantity, Record
from qtraj.foundation.result import AbstractResult, batch_prefix, extent, over
from qtraj.foundation.types import ArrayInput, Quat, Scalar
from qtraj.motion.attitude import Attitude
from qtraj.motion.control.errors import error_angle, error_quaternion, error_rate, state_from_error
from qtraj.motion.control.laws import AccelerationLaw, RateLaw
from qtraj.motion.control.response import error_state


@storable
class ClosedMotion(AbstractResult):
    """A closed loop in closed form, at the instants `times` (n,) [s].

    The law's `error` (n, 4), λ as `quaternion` (n, 4), and the `angle` (n,) [rad] between body and program, 0 … π.
    Under `vmap` everything has the lanes in front.
    """

    times: Float[Array, "*batch n"]
    error: Float[Array, "*batch n 4"]
    quaternion: Float[Array, "*batch n 4"]
    angle: Float[Array, "*batch n"]

    def __init__(self, times: ArrayInput, error: ArrayInput, quaternion: ArrayInput, angle: ArrayInput):
        self.times, self.error = as_float(times), as_float(error)
        self.quaternion, self.angle = as_float(quaternion), as_float(angle)

    def record(self) -> Record:
        """The motion over `time`, or over `sample` where each lane has times of its own."""
        along = "time" if self.times.ndim == 1 else "sample"
        axes = (along, "component")
        variables = {
            "error": Quantity(self.error, "1", "error quaternion of the law", axes),
            "quaternion": Quantity(self.quaternion, "1", "attitude, body to inertial, of any length", axes),
            "angle": Quantity(self.angle, "rad", "angle between body and program", (along,)),
        }
        lanes = batch_prefix(self.angle.shape[:-1])
        summary = f"{lanes}{over(self.times)}: angle to the program {extent(self.angle, 'rad')}"
        return Record(summary, variables, {"time": Quantity(self.times, "s", "time", (along,))}, {"frame": "body"})

    def save(self, file: str | os.PathLike[str]) -> None:
        """Write the motion to a TOML or JSON file, exactly; `qtraj.load` reads it.

        **Raises:** ValueError for another suffix.
        """
        document.save(self, file)


@eqx.filter_jit
def closed_motion(
    law: AccelerationLaw | RateLaw, references: Attitude, quaternion: Quat, rate: Quat, times: Float[Array, " n"]
) -> ClosedMotion:
    """The motion over a program if nothing disturbs it, at `times` (n,) [s].

    `references`: the program at these times, its fields (n, …). At the first of them the body has `quaternion` (4,)
    and the body rate `rate` (4,) [rad/s]; a rate law needs no rate.
    """
    kind = law.error if isinstance(law, AccelerationLaw) else "body"
    first = jax.tree.map(lambda x: x[0], references)
    error, slope = error_quaternion(first, quaternion, kind), error_rate(first, quaternion, rate, kind)

    def at(reference: Attitude, t: Scalar) -> tuple[Quat, Quat, Scalar]:
        x, v = error_state(law, error, slope, t - times[0])
        reached, _ = state_from_error(reference, x, v, kind)
        return x, reached, error_angle(reference, reached)

    return ClosedMotion(times, *jax.vmap(at)(references, times))
