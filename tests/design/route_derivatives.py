"""Derivatives of the problem of a route by JAX, for comparison."""

import jax
import jax.numpy as jnp
import numpy as np

import qtraj as qt
from qtraj.design.solve.iterate import Iterate
from qtraj.design.solve.polishing import polished
from qtraj.design.tuning_route import circuit, constraints, sensitivity
from qtraj.design.tuning_route.problem import objective, segments
from qtraj.design.tuning_route.program import RouteProgram

STEP = 1e-5
"""The step of finite differences."""


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


def compare_with_automatic(program, rng, size):
    """Compare the first and second derivatives of a problem with those by JAX, at random variables of a size.

    Return the variables, a direction, and the linearised problem.
    """
    free = program.problem.free
    z, direction = (rng.normal(0, scale, free.shape) * free for scale in (size, 1.0))
    multipliers, stiffness = (rng.uniform(0.1, 1, program.full.shape) for _ in range(2))
    gradient, product = automatic(program, z, direction, multipliers, stiffness)
    linear = program.linearise(circuit.repeated(program.problem, z), multipliers, stiffness)
    np.testing.assert_allclose(linear.residual, gradient, rtol=0, atol=1e-10 * np.abs(gradient).max())
    found = linear.matrix.product(direction) * free
    np.testing.assert_allclose(found, product, rtol=0, atol=1e-10 * np.abs(product).max())
    return z, direction, linear


def compared(arguments, theta, direction, monkeypatch):
    """Compare derivatives of `tune_route` with finite differences of the last search, with its margins; its values.

    `arguments` returns the route, the limits and the tube.
    """
    seen, change = [], sensitivity._change
    monkeypatch.setattr(sensitivity, "_change", lambda *x: seen.append(x) or change(*x))

    def tuned(theta):
        best = qt.tune_route(*arguments(theta))
        return best.path.coefficients, best.path.duration, best.objective, best.displacement

    values, slopes = jax.jvp(tuned, (theta,), (direction,))
    structure, found, data, _ = seen[0]
    given = structure.problem(found.fields)
    length = sensitivity._length(given, data, structure)

    def solved(sign):
        route, limits, tube = arguments(theta + sign * STEP * direction)
        own = data._replace(starts=route.starts, coefficients=route.coefficients, duration=route.duration)
        known = limits.given()
        bounds = [data.bounds[k] if n in structure.by_speed else known[n] for k, n in enumerate(structure.names)]
        own = own._replace(bounds=jnp.stack([jnp.asarray(x) for x in bounds]), tube=(tube, tube))
        problem = sensitivity._with_data(given, own, structure, length)
        program = RouteProgram(
            type(problem)(*(x if isinstance(x, tuple) or x is None else np.asarray(x) for x in problem))
        )
        flat = (program.flat(*x) for x in (found.slacks, found.multipliers, found.margins))
        at, _, done = polished(program, Iterate(found.z, *flat))
        assert done
        path, *rest = sensitivity._assembled(structure, found.fields, own, at.z, route.origin)
        return path.coefficients, path.duration, *rest[:2]

    for slope, above, below in zip(slopes, solved(1.0), solved(-1.0), strict=True):
        known = (above - below) / (2 * STEP)
        np.testing.assert_allclose(slope, known, rtol=1e-5, atol=1e-5 * np.abs(known).max())
    return values
