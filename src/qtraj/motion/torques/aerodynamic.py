"""Define the torque of air drag."""

import equinox as eqx
import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, real_scalar, real_vector, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Quat, Scalar, Vec3
from qtraj.motion.simulation.signals import Signal, SignalInput, at_instant, checked_signal


@storable
class AerodynamicTorque(eqx.Module):
    """The torque M = s × F of the drag F = −½ρC_D A|v|v (body axes).

    s is the vector from the centre of mass to the centre of pressure. The drag does not depend on the attitude (the
    same area A from all sides), so this is the usual first estimate; write an own function for other shapes. Source:
    Wertz, Spacecraft Attitude Determination and Control, 1978, section 17.2.

    Args:
        centre: The centre of pressure s (3,) [m] relative to the centre of mass, body axes.
        area: The area A [m²] across the flow.
        density: The density ρ [kg/m³] of the air.
        velocity: The velocity v (3,) [m/s] of the body relative to the air, inertial axes: a constant or a function of
            time [s], such as `CircularOrbit(...).velocity`.
        drag: The drag coefficient C_D; 2.2 is usual for satellites.

    Raises:
        ValueError: For values of another shape, or an area, density or drag that is not positive.

    Example:
        >>> air = AerodynamicTorque([0.1, 0.0, 0.0], 2.0, 1e-11, [0.0, 7500.0, 0.0])
        >>> air(0.0, jnp.array([1.0, 0.0, 0.0, 0.0]), jnp.zeros(3)).round(9)
        Array([ 0.00e+00,  0.00e+00, -1.24e-04], dtype=float64)
    """

    centre: Vec3
    area: Scalar
    density: Scalar
    velocity: Signal
    drag: Scalar

    def __init__(
        self,
        centre: ArrayInput,
        area: ArrayInput,
        density: ArrayInput,
        velocity: SignalInput,
        drag: ArrayInput = 2.2,
    ):
        self.centre = real_vector(centre, "the centre of pressure", 3)
        self.area, self.density = real_scalar(area, "the area"), real_scalar(density, "the density")
        self.drag = real_scalar(drag, "the drag coefficient")
        for value, name, unit in (
            (self.area, "the area", "m²"),
            (self.density, "the density", "kg/m³"),
            (self.drag, "the drag coefficient", ""),
        ):
            require_positive(value, name, unit)
        self.velocity = checked_signal(velocity, "the velocity")

    def __repr__(self) -> str:
        return shown(self, centre="m", area="m²", density="kg/m³", velocity="m/s")

    @on_one_device
    def __call__(self, t: Scalar, quaternion: Quat, rate: Vec3) -> Vec3:
        """Return the torque (3,) [N m] in body axes at the attitude `quaternion`; `rate` has no effect."""
        quaternion = as_float(quaternion)
        velocity = rotate(conjugate(quaternion), at_instant(self.velocity, t).astype(quaternion.dtype))
        factor = 0.5 * (self.density * self.drag * self.area).astype(velocity.dtype) * norm(velocity)
        return -factor * jnp.cross(self.centre.astype(velocity.dtype), velocity)
