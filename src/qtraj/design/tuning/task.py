"""A tuning problem with its limits and bounds as arrays of JAX, for derivatives and for the optimisers of optax."""

from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.tuning import constraints
from qtraj.design.tuning.problem import Problem
from qtraj.foundation.arrays import as_array, part


class Task(eqx.Module):
    """The input of a search for one problem or a batch; all arrays have leading batch axes.

    `limits` are the limits by name, and `low` and `high` the bounds on the variables.
    """

    problem: Problem
    limits: dict[str, Any]
    low: Any  # Float["*batch n"]
    high: Any  # Float["*batch n"]


def constraint_values(task: Task, z: Float[Array, " n"], u: Float[Array, "limits k"]) -> Float[Array, "limits k"]:
    """Return the constraint values of one problem, for each limit at its own instants."""
    names = tuple(task.limits)
    cubics, by = task.problem.cubics(z), constraints.units(task.problem, z, task.limits, False)

    def of_limit(name: str, times: Float[Array, " k"]) -> Float[Array, " k"]:
        order = constraints.order_of((name,))
        at = constraints.place(cubics, times, order)
        g = constraints.value(name, at, constraints.invariants(at, by), by, times)
        return jnp.broadcast_to(g, times.shape)

    return jnp.stack([of_limit(name, u[k]) for k, name in enumerate(names)])


def one(tree: Any) -> Any:
    """Return the only element of a batch."""
    return jax.tree.map(lambda x: part(x, 0) if isinstance(x, jax.Array) else x[0], tree)


def as_jax(tree: Any) -> Any:
    """Return the NumPy arrays in `tree` as arrays of JAX, unless JAX would round them to float32."""
    if jnp.result_type(float) != np.float64:
        return tree
    return jax.tree.map(lambda x: x if isinstance(x, jax.Array) else as_array(x, np.asarray(x).dtype), tree)
