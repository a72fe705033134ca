"""Define the torque of a magnetic field on a dipole."""

import equinox as eqx
import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.foundation.arrays import as_float
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import Quat, Scalar, Vec3
from qtraj.motion.simulation.signals import Signal, SignalInput, at_instant, at_state, checked_signal


@storable
class MagneticDipole(eqx.Module):
    """The torque M = m × B of a magnetic field on the dipole of a body (body axes).

    Source: Wertz, Spacecraft Attitude Determination and Control, 1978, section 17.2.

    Args:
        dipole: The magnetic dipole m (3,) [A m²] of the body, body axes: a constant, a function of time [s], or a
            function (t, quaternion, rate) → (3,), such as a magnetic control law.
        field: The magnetic field B (3,) [T], inertial axes: a constant or a function of time [s].

    Raises:
        ValueError: For values of another shape, or functions of other arguments.

    Example:
        >>> MagneticDipole([0.0, 0.0, 2.0], [3e-5, 0.0, 0.0])(0.0, jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(3))
        Array([0.e+00, 6.e-05, 0.e+00], dtype=float64)
    """

    dipole: Signal
    field: Signal

    def __init__(self, dipole: SignalInput, field: SignalInput):
        self.dipole = checked_signal(dipole, "the dipole", of_state=True)
        self.field = checked_signal(field, "the field")

    def __repr__(self) -> str:
        return shown(self, dipole="A m²", field="T")

    @on_one_device
    def __call__(self, t: Scalar, quaternion: Quat, rate: Vec3) -> Vec3:
        """Return the torque (3,) [N m] in body axes."""
        quaternion = as_float(quaternion)
        field = rotate(conjugate(quaternion), at_instant(self.field, t).astype(quaternion.dtype))
        return jnp.cross(at_state(self.dipole, t, quaternion, rate).astype(field.dtype), field)
