"""The objective "nearest": the change of the boundary velocities and, except in uniform motion, of the duration."""

from typing import Any, ClassVar

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.types import Scalar


class Nearest(AbstractObjective):
    """The weighted sum of squared changes of the velocities and, except in uniform motion, of the duration [m² s⁻²]."""

    name: ClassVar[str] = "nearest"

    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """Return the weighted sum [m² s⁻²]; the relative change of the duration is scaled by the reference speed."""
        duration = problem.time(z)
        changes = problem.velocities(z, duration) - problem.initial_velocities
        total = jnp.sum(problem.weights[:6].reshape(2, 3) * changes**2)
        if problem.motion.is_uniform:
            return total
        return total + problem.weights[6] * ((duration - problem.duration) / problem.duration * problem.speed) ** 2

    def scale(self, problem: Any) -> Scalar:
        """Return the squared reference speed times the largest weight."""
        max_weight = jnp.max(problem.weights)
        return problem.speed**2 * jnp.where(max_weight > 0, max_weight, 1.0)
