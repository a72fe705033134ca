"""Define the sum of several torques."""

from collections.abc import Sequence

import equinox as eqx

from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.simulation.signals import Signal, SignalInput, at_state, checked_signal


@storable
class TorqueSum(eqx.Module):
    """The sum of several torques, which all act on the same body (body axes).

    Args:
        torques: The torques, at least one: constants (3,) [N m], functions of time [s], or functions
            (t, quaternion, rate) → (3,), such as a `GravityGradient`.

    Raises:
        ValueError: For no torque, a constant of another shape, or a function of other arguments.

    Example:
        >>> solar, residual = [1e-5, 0.0, 0.0], MagneticDipole([0.0, 0.0, 2.0], [3e-5, 0.0, 0.0])
        >>> [round(float(x), 7) for x in TorqueSum([solar, residual])(0.0, jnp.array([1.0, 0, 0, 0]), jnp.zeros(3))]
        [1e-05, 6e-05, 0.0]
    """

    torques: tuple[Signal, ...]

    def __init__(self, torques: Sequence[SignalInput]):
        if not torques:
            raise ValueError("a sum needs at least one torque, but none was given")
        self.torques = tuple(checked_signal(torque, "a torque", of_state=True) for torque in torques)

    def __repr__(self) -> str:
        return shown(self)

    @on_one_device
    def __call__(self, t: Scalar, quaternion: Quat, rate: Vec3) -> Vec3:
        """Return the torque (3,) [N m] in body axes at the time `t` [s] and the true state."""
        first, *others = (at_state(torque, t, quaternion, rate) for torque in self.torques)
        return sum(others, first)
