"""Derivatives of the problem of a route by JAX, for comparison."""

import jax
import jax.numpy as jnp

from qtraj.design.tuning_route import circuit, constraints
from qtraj.design.tuning_route.problem import objective, segments


def automatic(program, x, direction, multipliers, stiffness):
    """The gradient of the Lagrangian, and the product of the matrix with a direction, by JAX."""
    problem = program.problem
    weights, steep = program.spread(multipliers), program.spread(stiffness)

    @jax.jit
    def known(x, direction):
        def both(x):
            s = segments(problem, circuit.repeated(problem, x))
            return constraints.values(problem, s), constraints.bounds(problem, s)

        def lagrangian(x):
            s = segments(problem, circuit.repeated(problem, x))
            return objective(problem, s) + sum((m * g).sum() for m, g in zip(weights, both(x), strict=True))

        gradient, bent = jax.jvp(jax.grad(lagrangian), (x,), (direction,))
        _, change = jax.jvp(both, (x,), (direction,))
        pull = jax.vjp(both, x)[1](tuple(k * c for k, c in zip(steep, change, strict=True)))[0]
        return tuple(jnp.where(problem.free, x, 0.0) for x in (gradient, bent + pull))

    return known(x, direction)
