"""Define the gravity-gradient torque."""

import equinox as eqx
import jax.numpy as jnp

from qtraj.algebra.quaternion import conjugate, rotate
from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import as_float, concrete, real_scalar, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Mat3, Quat, Scalar, Vec3
from qtraj.motion.dynamics import inertia_matrix
from qtraj.motion.simulation.signals import Signal, SignalInput, at_instant, checked_signal
from qtraj.motion.torques.circular_orbit import EARTH


@storable
class GravityGradient(eqx.Module):
    """The gravity-gradient torque M = 3μ/|r|⁵ r × Jr of a spherical planet (body axes).

    The torque turns the axis of the smallest moment of inertia towards the planet. Sources: Hughes, Spacecraft Attitude
    Dynamics, 1986, chapter 8; Wertz, Spacecraft Attitude Determination and Control, 1978, section 17.2; Wie, Space
    Vehicle Dynamics and Control, 2008, section 6.10.

    Args:
        inertia: The inertia J [kg m²]: a scalar, principal moments (3,), or a tensor (3, 3), body axes.
        position: The position r (3,) [m] from the centre of the planet, inertial axes: a constant, or a function of
            time [s] such as a `CircularOrbit`.
        mu: The gravitational parameter μ [m³/s²]; by default that of the Earth.

    Raises:
        ValueError: For an inertia that is not symmetric and positive definite, a position of another shape or
            zero, or a `mu` that is not positive.

    Example:
        >>> gravity = GravityGradient([10.0, 12.0, 5.0], [7e6, 0.0, 0.0])
        >>> gravity(0.0, jnp.array([1.0, 0.1, 0.0, 0.1]), jnp.zeros(3)).shape
        (3,)
    """

    inertia: Mat3
    position: Signal
    mu: Scalar

    def __init__(self, inertia: ArrayInput, position: SignalInput, mu: ArrayInput = EARTH):
        self.inertia = inertia_matrix(inertia)
        self.position = checked_signal(position, "the position")
        value = None if callable(self.position) else concrete(self.position)
        if value is not None and not value.any():
            raise ValueError("the position must not be zero, because the torque of the planet is then not defined")
        self.mu = real_scalar(mu, "mu")
        require_positive(self.mu, "mu", "m³/s²")

    def __repr__(self) -> str:
        return shown(self, inertia="kg m²", position="m", mu="m³/s²")

    @on_one_device
    def __call__(self, t: Scalar, quaternion: Quat, rate: Vec3) -> Vec3:
        """Return the torque (3,) [N m] in body axes at the attitude `quaternion`; `rate` has no effect."""
        quaternion = as_float(quaternion)
        position = at_instant(self.position, t).astype(quaternion.dtype)
        distance = norm(position)
        down = rotate(conjugate(quaternion), position / distance)
        factor = 3 * self.mu.astype(down.dtype) / distance**3
        return factor * jnp.cross(down, jnp.matmul(self.inertia.astype(down.dtype), down, precision="highest"))
