"""A user-defined objective, which JAX evaluates and differentiates; the searches compile nothing else."""

from collections.abc import Callable
from typing import Any, ClassVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from qtraj.design.tuning.objectives.objective import AbstractObjective
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar

MIN_BATCH = 8
"""Minimum size of padded batches. Padding to powers of two allows batches of different sizes to share compiled code."""


class Custom(AbstractObjective):
    """A user-defined objective, which is a differentiable function of a path.

    If the function is a pytree, such as a `jax.tree_util.Partial` or an `equinox.Module`, then its arrays are
    `parameters`: they can be differentiated, and other values of them use the same compiled code. As in
    `equinox.filter_jit`, all other leaves are static. In the problems of a batch, the parameters have batch axes.
    """

    name: ClassVar[str] = "custom"
    is_formula: ClassVar[bool] = False
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

    def value(self, problem: Any, z: Any) -> Scalar:
        """Return the value of the user's function for the path with the variables `z`, for one problem."""
        return jnp.asarray(self.function(problem.path(z)))

    def scale(self, problem: Any) -> Any:
        """Return 1, or the value for the initial path if it is not finite; `rescaling` sets the scale of a search."""
        value = values(problem, np.zeros((problem.size, *problem.speed.shape)))
        xp = namespace(value)
        return xp.where(xp.isfinite(value), 1.0, value)

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


def values(problem: Any, z: Any) -> Any:
    """Return the values of the user's function for a batch of problems, with variables (n, batch)."""
    return _on_batch(_values, problem, z)


def derivatives(problem: Any, z: Any) -> tuple[Any, Any]:
    """Return the gradients (n, batch) and the Hessians (n, n, batch) of the objective divided by its scale."""
    slope, curvature = _on_batch(_derivatives, problem, z)
    return np.moveaxis(slope, 0, -1), np.moveaxis(curvature, 0, -1)


def _on_batch(function: Callable[..., Any], problem: Any, z: Any) -> Any:
    """Call a compiled function for a padded batch; return NumPy arrays for concrete values."""
    if is_traced(problem, z):
        return function(problem, jnp.moveaxis(z, 0, -1))
    count = z.shape[1]
    size = max(MIN_BATCH, 1 << (count - 1).bit_length())
    index = np.minimum(np.arange(size), count - 1)
    padded = jax.tree.map(lambda x: np.asarray(x)[index], problem)
    result = function(padded, np.moveaxis(np.asarray(z), 0, -1)[index])
    # The function may close over numbers that are differentiated.
    return jax.tree.map(lambda x: (x if is_traced(x) else np.asarray(x))[:count], result)


@eqx.filter_jit
def _values(problem: Any, z: Any) -> Any:
    def one(problem: Any, z: Any) -> Any:
        value = problem.objective.value(problem, z)
        if value.ndim != 0:
            raise ValueError(f"the objective must be one number, but it is an array of shape {value.shape}")
        return value

    return eqx.filter_vmap(one)(problem, z)


@eqx.filter_jit
def _derivatives(problem: Any, z: Any) -> Any:
    def one(problem: Any, z: Any) -> Any:
        def cost(z: Any) -> Any:
            return problem.objective.value(problem, z) / problem.scale

        gradient = jax.grad(cost)  # a user's function may have derivatives in reverse mode only
        return gradient(z), jax.jacfwd(gradient)(z)

    return eqx.filter_vmap(one)(problem, z)
