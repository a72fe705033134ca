"""Define a circular orbit, the usual position of a satellite in its torques."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.algebra.vector import norm
from qtraj.foundation.arrays import concrete, one_instant, real_scalar, real_vector, require_positive
from qtraj.foundation.devices import on_one_device
from qtraj.foundation.document import storable
from qtraj.foundation.shown import shown
from qtraj.foundation.types import ArrayInput, Scalar, ScalarLike, Vec3

PARALLEL = 1e-9
"""Two vectors are parallel if the sine of the angle between them is at most this."""

EARTH = 3.986004418e14
"""The gravitational parameter of the Earth [m³/s²] (WGS 84)."""


@storable
class CircularOrbit(eqx.Module):
    """The position (3,) [m] on a circular orbit as a function of time, inertial axes, from the centre of the planet.

    The angular rate is n = √(μ/radius³). See Wertz, Spacecraft Attitude Determination and Control, 1978, chapter 3.

    Args:
        radius: The radius [m], from the centre of the planet.
        start: A vector (3,) towards the position at t = 0, not necessarily normalised.
        normal: A vector (3,) normal to the orbit; the motion is counter-clockwise about it. Only its component normal
            to `start` is used.
        mu: The gravitational parameter μ [m³/s²]; by default that of the Earth.

    Raises:
        ValueError: For values that are not positive, or a `normal` along `start`.

    Example:
        >>> CircularOrbit(7e6)(0.0)
        Array([7000000.,       0.,       0.], dtype=float64)
    """

    radius: Scalar
    start: Vec3
    normal: Vec3
    mu: Scalar

    @on_one_device
    def __init__(
        self,
        radius: ArrayInput,
        start: ArrayInput = (1.0, 0.0, 0.0),
        normal: ArrayInput = (0.0, 0.0, 1.0),
        mu: ArrayInput = EARTH,
    ):
        self.radius, self.mu = real_scalar(radius, "the radius"), real_scalar(mu, "mu")
        require_positive(self.radius, "the radius", "m")
        require_positive(self.mu, "mu", "m³/s²")
        self.start, self.normal = real_vector(start, "start", 3), real_vector(normal, "normal", 3)
        known = concrete(self.start), concrete(self.normal)
        if known[0] is not None and known[1] is not None and _parallel(*known):
            raise ValueError("normal must not be zero or along start, because the orbit is then not defined")

    def __repr__(self) -> str:
        return shown(self, radius="m", mu="m³/s²")

    @property
    def rate(self) -> Scalar:
        """The angular rate n [rad/s]."""
        return jnp.sqrt(self.mu / self.radius**3)

    @on_one_device
    def __call__(self, t: ScalarLike) -> Vec3:
        """Return the position (3,) [m] at the time `t` [s]."""
        t = one_instant(t)
        along, ahead = self._axes()
        angle = self.rate * t
        return self.radius * (jnp.cos(angle) * along + jnp.sin(angle) * ahead)

    def velocity(self, t: ScalarLike) -> Vec3:
        """Return the velocity (3,) [m/s] at the time `t` [s]."""
        t = one_instant(t)
        along, ahead = self._axes()
        angle = self.rate * t
        return self.radius * self.rate * (jnp.cos(angle) * ahead - jnp.sin(angle) * along)

    def _axes(self) -> tuple[Array, Array]:
        along, side = jnp.asarray(self.start), jnp.cross(self.normal, self.start)
        return along / norm(along), side / norm(side)


def _parallel(a: Any, b: Any) -> bool:
    """Return whether two vectors are parallel up to round-off, or one of them is zero."""
    return bool(np.linalg.norm(np.cross(a, b)) <= PARALLEL * np.linalg.norm(a) * np.linalg.norm(b))
