"""Differentiate a tuned route with respect to the route, its limits and the tube (implicit function theorem).

The variables z of the last search, the slacks s and the multipliers λ of its constraints g(z) + s = 0 satisfy

    ∇f + Σ λ ∇g = 0,   s λ = μ,

with the objective f and the barrier parameter μ. These conditions depend smoothly on the data θ. With μ → 0 and
constant margins, differentiating them gives a linear system for dz/dθ. Its matrix is the matrix of the interior-point
method, ∇²(f + Σ λ g) + Σ (λ/s) ∇g ∇gᵀ. This matrix is block tridiagonal and symmetric, so forward and reverse mode use
the same solver. The search and the solver run in NumPy; JAX differentiates only the conditions.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.limits import Limits, limits_of
from qtraj.design.tuning_route import circuit, geometry
from qtraj.design.tuning_route.chain import Chain
from qtraj.design.tuning_route.constraints import bounds, values
from qtraj.design.tuning_route.curves import Curves, chain, rebuilt
from qtraj.design.tuning_route.interior import Iterate, linearised, longest, newton, residual, restarted
from qtraj.design.tuning_route.problem import RouteProblem, objective, segments
from qtraj.design.tuning_route.program import RouteProgram
from qtraj.design.tuning_route.scales import scales
from qtraj.design.tuning_route.setup import LONGEST, SHORTEST
from qtraj.design.tuning_route.solution import Data, Known, Solution
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.arrays import is_traced
from qtraj.path.route import Route, from_segments

STEPS = 60
"""Maximum number of Newton steps with which the last search is continued."""

BARRIERS, LEAST, TOLERANCE = (1e-3, 1e-5, 1e-7), 1e-7, 1e-10
"""Initial barrier parameters, tried from the largest down until one leads to convergence; the final barrier parameter,
for which the conditions are differentiated; and the largest residual accepted there. A smaller final parameter would
noticeably increase the rounding errors of the derivatives."""

REFINEMENTS = 2
"""Number of iterative refinements of the solution; the linear system is ill-conditioned."""

DECREASE, KEEP = 0.2, 0.995
"""The factor by which the barrier parameter decreases in each step, and the largest fraction by which a step may reduce
a slack or a multiplier."""


Solve = Callable[[Route, Limits, tuple[np.ndarray, np.ndarray]], Solution]


def differentiable(
    route: Route, limits: Limits, tube: Any, names: tuple[str, ...], kind: str, solve: Solve
) -> TunedRoute:
    """Return the result of `solve` as a differentiable function of its arguments; `kind` is the objective.

    **Raises:** ValueError if the arguments have no concrete values (inside jit or vmap).
    """
    pair = tube if isinstance(tube, tuple) else (tube, tube)
    bounds = jnp.stack([jnp.asarray(limits.given()[name], float) for name in names]) if names else jnp.zeros(0)
    data = Data(
        route.starts,
        route.coefficients,
        route.duration,
        bounds,
        (jnp.asarray(pair[0], float), jnp.asarray(pair[1], float)),
        route.progress,
        route.origin,
    )
    solutions: list[Solution] = []

    @jax.custom_jvp
    def variables(data: Data) -> Array:
        if is_traced(data):
            raise ValueError(
                "tune_route needs concrete values: differentiate it with grad, jvp, jacfwd or jacrev, but call these "
                "outside jit and vmap, once for each route"
            )
        count = int(np.isfinite(np.asarray(data.starts)).sum())
        plain = from_segments(
            np.asarray(data.starts)[:count],
            np.asarray(data.coefficients)[:count],
            np.asarray(data.duration),
            np.asarray(data.origin),
            None if data.progress is None else np.asarray(data.progress)[:count],
        )
        values = dict(zip(names, np.asarray(data.bounds).tolist(), strict=True))
        solutions.append(
            solve(plain, limits_of(values, limits.vehicle), (np.asarray(data.tube[0]), np.asarray(data.tube[1])))
        )
        return jnp.asarray(solutions[-1].z)

    @variables.defjvp
    def _(primals: tuple[Data], tangents: tuple[Data]) -> tuple[Array, Array]:
        z = variables(*primals)
        found = solutions[-1]
        return z, _change(kind, found, primals[0], tangents[0])

    z = variables(data)
    found = solutions[-1]
    known = Known((found.curves, found.problem.composed))
    own = found.problem._replace(composed=None)
    path, attained, displacement, delay = _assembled(own, data, z, route.origin, known, kind)
    result = found.result
    return TunedRoute(
        path,
        result.certificate,
        attained,
        result.distance,
        result.within,
        displacement,
        delay,
        result.kept,
        result.code,
        result.iterations,
        result.advice,
    )


def _change(kind: str, found: Solution, data: Data, change: Data) -> Array:
    """Return the change of the variables that a change of the data causes."""
    problem = found.problem
    if found.at is None:
        return jnp.zeros(problem.free.shape)
    if found.at.excess is not None:  # the limits contradict each other
        size = sum(jnp.sum(x) for x in jax.tree.leaves(change))  # NaN in reverse mode, too
        return jnp.full(problem.free.shape, jnp.nan) * size
    program = RouteProgram(problem)
    at, matrix, done = polished(program, found.at)
    weights, stiffness = (program.spread(x) for x in (at.multipliers, at.multipliers / at.slacks))
    known, own = Known((found.curves, problem.composed)), problem._replace(composed=None)
    right = _right(kind, own, at.z, weights, stiffness, data, change, known)
    shape = jax.ShapeDtypeStruct(right.shape, right.dtype)

    def solve(_: Any, right: Array) -> Array:
        return jax.pure_callback(lambda x: _refined(matrix, np.asarray(x)), shape, right, vmap_method="sequential")

    dz = jax.lax.custom_linear_solve(matrix.product, right, solve, symmetric=True)
    return circuit.repeated(problem, dz) * (1.0 if done else np.nan)  # NaN in reverse mode, too


def _refined(matrix: Chain, right: np.ndarray) -> np.ndarray:
    """Return the solution of the linear system; NaN if the matrix is singular."""
    solver = matrix.solver(indefinite=True)
    if solver is None:
        return np.full(right.shape, np.nan)
    found = solver(right)
    for _ in range(REFINEMENTS):
        found = found + solver(right - matrix.product(found))
    return found


def polished(program: RouteProgram, at: Iterate) -> tuple[Iterate, Chain, bool]:
    """Refine an iterate until it satisfies the optimality conditions; also return the matrix and whether it converged.

    The slacks and multipliers start from a larger barrier parameter, because with tiny slacks the steps would be too
    short.
    """
    with np.errstate(all="ignore"):  # a failed refinement ends with NaN
        found = _polished(program, restarted(program, at, BARRIERS[0]), BARRIERS[0])
        for barrier in BARRIERS[1:]:
            if not found[2]:
                found = _polished(program, restarted(program, at, barrier), barrier)
    return found


def _polished(program: RouteProgram, at: Iterate, mu: float) -> tuple[Iterate, Chain, bool]:
    """Refine an iterate by full Newton steps, starting with the barrier parameter `mu`.

    There is no line search, because the rounding errors of a merit function would stop it this close to the optimum,
    and the matrix may be indefinite until the slacks and multipliers fit together.
    """
    linear = linearised(program, at)
    for _ in range(STEPS):
        if mu <= LEAST and residual(at, linear, mu) <= TOLERANCE:
            return at, linear.matrix, True
        step = newton(at, linear, mu, indefinite=True)
        if step is None:
            break
        primal, dual = longest(at.slacks, step.slacks, KEEP), longest(at.multipliers, step.multipliers, KEEP)
        at = Iterate(
            at.z + primal * step.z,
            at.slacks + primal * step.slacks,
            at.multipliers + dual * step.multipliers,
            at.margins,
        )
        linear, mu = linearised(program, at), max(LEAST, DECREASE * mu)
    return at, linear.matrix, False


@eqx.filter_jit
def _right(
    kind: str,
    problem: RouteProblem,
    z: Any,
    multipliers: tuple[Any, Any],
    stiffness: tuple[Any, Any],
    data: Data,
    change: Data,
    known: Known,
) -> Float[Array, "joints 10"]:
    """Return the right-hand side of the linear system."""
    curves, composed = known.arrays
    problem = problem._replace(composed=composed)
    length = _length(problem, data, curves, kind)

    def constraints(problem: RouteProblem, z: Array) -> tuple[Array, Array]:
        s = segments(problem, z)
        return values(problem, s), bounds(problem, s)

    def conditions(data: Data) -> tuple[Array, tuple[Array, Array]]:
        moved = _with_data(problem, data, curves, kind, length)

        def lagrangian(z: Array) -> Array:
            terms = zip(multipliers, constraints(moved, z), strict=True)
            return objective(moved, segments(moved, z)) + sum(jnp.sum(m * g) for m, g in terms)

        return jax.grad(lagrangian)(z), constraints(moved, z)

    _, (gradient, gaps) = jax.jvp(conditions, (data,), (change,))
    _, pull = jax.vjp(lambda z: constraints(problem, z), z)
    forces = pull(tuple(k * g for k, g in zip(stiffness, gaps, strict=True)))[0]
    return jnp.where(problem.free, -circuit.gathered(problem, gradient + forces), 0.0)


def _rows(data: Data, curves: Curves) -> tuple[Array, Array, Array | None]:
    """Return the coefficients, durations and progress of the segments of the route."""
    count = len(curves.owner)
    durations = jnp.diff(jnp.append(data.starts[:count], data.duration))
    return data.coefficients[:count], durations, None if data.progress is None else data.progress[:count]


def _parts(data: Data, problem: RouteProblem, curves: Curves) -> tuple[Array, Array, Array]:
    """Return the coefficients and the durations of the curves, and the states of the joints."""
    c, h = chain(curves, *_rows(data, curves))
    return c, h, geometry.joint_states(c, h, 1.0 - problem.moving, problem.seam is not None)


def _length(problem: RouteProblem, data: Data, curves: Curves, kind: str) -> Array:
    """Return the unit of length of the objective "nearest"; this unit does not influence the optimal variables."""
    if kind != "nearest":
        return jnp.ones_like(data.duration)
    h = _parts(data, problem, curves)[1]
    time = geometry.time_scale(h, problem.moving)
    return jax.lax.stop_gradient(jnp.sqrt(problem.unit * jnp.sum(h) / time))


def _with_data(problem: RouteProblem, data: Data, curves: Curves, kind: str, length: Array) -> RouteProblem:
    """Return the problem for other data; only the fields that occur in the optimality conditions change."""
    c, h, states = _parts(data, problem, curves)
    count = len(curves.owner)
    widths = jnp.stack([jnp.broadcast_to(x, (count + 1,)) for x in data.tube], axis=1)
    widths = widths[np.array([own.start for own in curves.joint_rows()])]
    fields = geometry.smooth_fields(c, h, states, widths, problem.moving, problem.composed)
    fields |= scales(problem.names, data.bounds, None if problem.shifts is None else jnp.sqrt(problem.squares))
    if problem.origins is not None:
        fields |= {"origins": states[:-1, 0].T + jnp.asarray(data.origin)[:, None]}
    durations = fields["durations"]
    fields |= {"shortest": SHORTEST * durations, "longest": LONGEST * durations}
    if kind == "nearest":
        near, pace = geometry.nearest(fields["ends"], durations, problem.moving, length)
        fields |= {"near": near, "pace": pace}
    return problem._replace(**fields)


@eqx.filter_jit
def _assembled(
    problem: RouteProblem, data: Data, z: Array, origin: Array, known: Known, kind: str
) -> tuple[Route, Array, Array, Array]:
    """Return the route, the objective, the displacements of the joints, and the change of the duration."""
    curves, composed = known.arrays
    problem = problem._replace(composed=composed)
    length = _length(problem, data, curves, kind)
    moved = _with_data(problem, data, curves, kind, length)
    c, h, states = _parts(data, problem, curves)
    _, new_h = geometry.moved_states(moved, states, h, z)
    new_c, _ = geometry.changed(moved, c, h, states, z)
    rows, durations, own = _rows(data, curves)
    given = from_segments(data.starts[: len(rows)], rows, data.duration, origin, own)
    new_durations, new_rows, new_own = rebuilt(curves, durations, own, h, new_c, new_h)
    times = jnp.append(jnp.zeros_like(h[:1]), jnp.cumsum(new_durations))
    path = from_segments(times[:-1], new_rows, times[-1], origin, new_own)
    time = geometry.time_scale(h, problem.moving)
    unit = length**2 * time / jnp.sum(h) if kind == "nearest" else problem.unit
    value = times[-1] if kind == "fastest" else objective(moved, segments(moved, z)) * unit
    displacement = _positions(path, len(rows)) - _positions(given, len(rows))
    return path, value, displacement, jnp.sum(new_durations - durations)


def _positions(route: Route, count: int) -> Float[Array, "joints 3"]:
    """Return the positions of the joints of a route with `count` segments."""
    return route.sampled(jnp.append(route.starts[:count], route.duration), 0)[0]
