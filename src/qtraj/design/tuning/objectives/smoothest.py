"""The objective "smoothest", which is the integral of the squared jerk at fixed duration."""

from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.types import Scalar
from qtraj.path.spiral_helix import SpiralHelix

JERK_NODES = 16  # Gauss–Legendre nodes, exact for |r⃛|² of cubics with a cubic angle (degree 18 ≤ 31)


class Smoothest(AbstractObjective):
    """The integral ∫|r⃛|²dt of the squared jerk as the objective [m² s⁻⁵]."""

    name: ClassVar[str] = "smoothest"
    fixes_duration: ClassVar[bool] = True

    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """Return the integral over the path for the variables `z`."""
        return integrated_squared_jerk(problem.path(z))

    def scale(self, problem: Any) -> Scalar:
        """Return the value for the initial path, or 1 if it is zero."""
        size = self.value(problem, jnp.zeros(problem.size, problem.speed.dtype))
        return jnp.where(size == 0, 1.0, size)


def integrated_squared_jerk(path: SpiralHelix) -> Scalar:
    """Return ∫|r⃛|²dt over the path [m² s⁻⁵], exactly if ρ, φ and h are polynomials of degree 3 or less."""
    nodes, weights = np.polynomial.legendre.leggauss(JERK_NODES)
    t = path.duration * jnp.asarray((nodes + 1) / 2, path.duration.dtype)
    jerks = jax.vmap(lambda t: path.rotating_derivatives(t, 3)[3])(t)
    return path.duration / 2 * jnp.sum(jnp.asarray(weights, t.dtype) * jnp.sum(jerks**2, axis=-1))
