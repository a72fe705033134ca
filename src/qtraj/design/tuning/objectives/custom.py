"""A user-defined objective."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.types import Scalar


class Custom(AbstractObjective):
    """A user-defined objective, which is a differentiable function of a path.

    If the function is a pytree, such as a `jax.tree_util.Partial` or an `equinox.Module`, then its arrays are
    `parameters`: they can be differentiated, and other values of them use the same compiled code. As in
    `equinox.filter_jit`, all other leaves are static.
    """

    name: ClassVar[str] = "custom"
    is_smooth: ClassVar[bool] = False
    parameters: tuple[Array | None, ...]
    others: tuple[Any, ...] = eqx.field(static=True)
    structure: Any = eqx.field(static=True)

    def __init__(self, function: Callable[..., Any]):
        leaves, self.structure = jax.tree.flatten(function)
        self.parameters = tuple(x if eqx.is_array(x) else None for x in leaves)
        self.others = tuple(None if eqx.is_array(x) else x for x in leaves)

    @property
    def function(self) -> Callable[..., Any]:
        """The user's function."""
        return self._with(self.parameters)

    def value(self, problem: Any, z: Float[Array, " n"]) -> Scalar:
        """Return the value of the user's function for the path with the variables `z`."""
        return jnp.asarray(self.function(problem.path(z)))

    def scale(self, problem: Any) -> Scalar:
        """Return the magnitude of the objective for the initial path, or 1 if it is zero."""
        size = jnp.abs(self.value(problem, jnp.zeros(problem.size, problem.speed.dtype)))
        if size.ndim != 0:
            raise ValueError(f"the objective must be one number, but it is an array of shape {size.shape}")
        return jnp.where(size == 0, 1.0, size)

    def with_closure(self, problem: Any) -> "Custom":
        """Return an equal objective whose `parameters` include the traced arrays that the function closes over.

        JAX cannot differentiate a solution with respect to an array that reaches it only by a closure.
        """

        def function(parameters: tuple[Array | None, ...], path: Any) -> Any:
            return self._with(parameters)(path)

        path = problem.path(jnp.zeros(problem.size, problem.speed.dtype))
        explicit = eqx.filter_closure_convert(function, self.parameters, path)
        return Custom(eqx.Partial(explicit, self.parameters)) if is_traced(explicit) else self

    def _with(self, parameters: tuple[Array | None, ...]) -> Callable[..., Any]:
        pairs = zip(parameters, self.others, strict=True)
        return jax.tree.unflatten(self.structure, [other if array is None else array for array, other in pairs])
