"""The motion "uniform", with rotation at a constant rate, as in paper S."""

from typing import ClassVar

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning.motions.motion import VELOCITIES, AbstractMotion
from qtraj.foundation.types import Scalar, Vec3
from qtraj.path.boundary import Cylindrical


class Uniform(AbstractMotion):
    """The motion with constant angular rate ω; V_ρ and V_h at both ends are variables, and V_φ = ωρ."""

    name: ClassVar[str] = "uniform"
    velocities: ClassVar[tuple[str, ...]] = tuple(v for v in VELOCITIES if not v.endswith("V_phi"))
    is_uniform: ClassVar[bool] = True

    def boundary_velocities(
        self, a: Cylindrical, b: Cylindrical, changes: Float[Array, " n"], turn: Scalar, duration: Scalar
    ) -> tuple[Vec3, Vec3]:
        """Return the initial V_ρ and V_h plus the changes, and V_φ for the constant rate."""
        rate, angular = turn / duration, np.asarray([[False, True, False]])
        changed = changes.reshape(2, 2) @ jnp.asarray([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], changes.dtype)
        radii, initial = jnp.stack([a.radius, b.radius]), jnp.stack([a.velocity, b.velocity])
        velocities = jnp.where(angular, (rate * radii)[:, None], initial + changed)
        return velocities[0], velocities[1]

    def duration(self, a: Cylindrical, b: Cylindrical, turn: Scalar) -> Scalar:
        """Return the turn divided by the angular rate that fits V_φ at both ends in the least-squares sense."""
        return turn * (a.radius**2 + b.radius**2) / (a.radius * a.velocity[1] + b.radius * b.velocity[1])
