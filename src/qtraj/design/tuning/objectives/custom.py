"""A user-defined objective."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.types import Scalar


class Custom(AbstractObjective):
    """A user-defined objective, which is a differentiable function of a path."""

    name: ClassVar[str] = "custom"
    is_smooth: ClassVar[bool] = False
    function: Callable[..., Any] = eqx.field(static=True)

    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """Return the value of the user's function for the path with the variables `z`."""
        return jnp.asarray(self.function(problem.path(z)))

    def scale(self, problem: Any) -> Scalar:
        """Return the magnitude of the objective for the initial path, or 1 if it is zero."""
        size = jnp.abs(self.value(problem, jnp.zeros(problem.size, problem.speed.dtype)))
        if size.ndim != 0:
            raise ValueError(f"the objective must be one number, but it is an array of shape {size.shape}")
        return jnp.where(size == 0, 1.0, size)
