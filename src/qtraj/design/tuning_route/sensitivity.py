"""Differentiate a tuned route with respect to the route, its limits and the tube (implicit function theorem).

The variables z of the last search, the slacks s and the multipliers λ of its constraints g(z) + s = 0 satisfy

    ∇f + Σ λ ∇g = 0,   s λ = μ,

with the objective f and the barrier parameter μ. These conditions depend smoothly on the data θ. With μ → 0 and
constant margins, differentiating them gives a linear system for dz/dθ. Its matrix is the matrix of the interior-point
method, ∇²(f + Σ λ g) + Σ (λ/s) ∇g ∇gᵀ. This matrix is block tridiagonal and symmetric, so forward and reverse mode use
the same solver. The search and the solver run in NumPy; JAX differentiates only the conditions.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.ellipse import OfSpeed
from qtraj.design.limits import Limits
from qtraj.design.tuning_route import along, circuit, geometry, traced
from qtraj.design.tuning_route.constraints import bounds, values
from qtraj.design.tuning_route.curves import chain, rebuilt
from qtraj.design.tuning_route.problem import RouteProblem, objective, segments
from qtraj.design.tuning_route.scales import scales
from qtraj.design.tuning_route.setup import LONGEST, SHORTEST
from qtraj.design.tuning_route.solution import CHANGED, UNCHANGED, Data, Searched, Solve, Structure
from qtraj.design.tuning_route.traced import Refined
from qtraj.design.tuning_route.tuned_route import TunedRoute
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path import pieces
from qtraj.path.route import Route, from_segments


def differentiable(route: Route, limits: Limits, tube: Any, s: Structure, solve: Solve) -> TunedRoute:
    """Return the result of `solve` as a differentiable function of its arguments.

    Inside `jit` and `vmap`, the search is one operation of JAX (see `traced`).
    """
    data, origin = _data(route, limits, tube, s), jax.lax.stop_gradient(route.origin)
    known, result = constants(data), None
    facts: Any
    if is_traced(known, origin):
        found, facts = traced.searched(s, known, origin, limits.vehicle, solve)
    else:
        own = traced.solved(s, known, origin, limits.vehicle, solve)
        found, result = traced.as_arrays(s, own), own.result
        facts = result
    z = variables(s, data, found)
    path, attained, displacement, delay = _assembled(s, found.fields, data, z, route.origin)
    certificate = facts.certificate(s.certified, constants(path.starts)) if result is None else result.certificate
    return TunedRoute(
        path,
        certificate,
        attained,
        facts.distance,
        facts.within,
        displacement,
        delay,
        facts.kept,
        facts.code,
        facts.iterations,
        "" if result is None else result.advice,
    )


def _data(route: Route, limits: Limits, tube: Any, s: Structure) -> Data:
    given = {n: along.typical_of(n, x) if isinstance(x, OfSpeed) else x for n, x in limits.given().items()}
    bounds = jnp.stack([jnp.asarray(given[name], float) for name in s.names]) if s.names else jnp.zeros(0)
    widths: Any = tuple(
        _width(x, len(s.curves.owner) + 1, s.padded) for x in (tube if isinstance(tube, tuple) else [tube] * 2)
    )
    return Data(route.starts, route.coefficients, route.duration, bounds, widths, route.progress, route.origin)


def _width(x: Any, joints: int, padded: bool) -> Array:
    """Return a half-width, with the last one repeated at the joints of padding."""
    x = jnp.asarray(x, float)
    if not x.ndim or not padded:
        return x
    return jnp.concatenate([x, jnp.broadcast_to(x[-1:], (joints - x.shape[0],))])


@eqx.filter_custom_jvp
def variables(s: Structure, data: Data, found: Searched) -> Array:
    """Return the variables of a search as a differentiable function of its data."""
    return jnp.asarray(found.z)


@variables.def_jvp
def _variables_jvp(primals: tuple[Structure, Data, Searched], tangents: tuple[None, Data, None]) -> tuple[Array, Array]:
    s, data, found = primals
    return jnp.asarray(found.z), _change(s, found, data, tangents[1])


def _change(s: Structure, found: Searched, data: Data, change: Data) -> Array:
    """Return the change of the variables that a change of the data causes; None for data that do not change."""
    at = traced.refined(s, found)
    return _solved(s, found.fields, found.state, at, data, change)


@eqx.filter_jit
def _solved(s: Structure, fields: dict[str, Any], state: Any, at: Refined, data: Data, change: Data) -> Array:
    problem = s.problem(fields)
    right = _right(s, problem, at, data, change)
    dz = jax.lax.custom_linear_solve(
        at.matrix.product, right, lambda _, x: traced.linear_solution(at.matrix, x), symmetric=True
    )
    # NaN in reverse mode, too, if the limits contradict each other or the refinement failed.
    factor = jnp.where(state == UNCHANGED, 0.0, jnp.where((state == CHANGED) & at.done, 1.0, jnp.nan))
    return circuit.repeated(problem, dz) * factor


def _right(s: Structure, problem: RouteProblem, at: Refined, data: Data, change: Data) -> Float[Array, "joints 10"]:
    """Return the right-hand side of the linear system."""
    length, z = _length(problem, data, s), jnp.asarray(at.z)
    problem = _with_data(problem, data, s, length)  # the arrays of the search have zeros for padding

    def constraints(problem: RouteProblem, z: Array) -> tuple[Array, Array]:
        own = segments(problem, z)
        return values(problem, own), bounds(problem, own)

    def conditions(data: Data) -> tuple[Array, tuple[Array, Array]]:
        moved = _with_data(problem, data, s, length)

        def lagrangian(z: Array) -> Array:
            terms = zip(at.multipliers, constraints(moved, z), strict=True)
            return objective(moved, segments(moved, z)) + sum(jnp.sum(m * g) for m, g in terms)

        return jax.grad(lagrangian)(z), constraints(moved, z)

    own, found = eqx.filter_jvp(conditions, (data,), (change,))
    gradient, gaps = jax.tree.map(lambda x, dx: jnp.zeros_like(x) if dx is None else dx, own, found)
    _, pull = jax.vjp(lambda z: constraints(problem, z), z)
    forces = pull(tuple(k * g for k, g in zip(at.stiffness, gaps, strict=True)))[0]
    return jnp.where(problem.free, -circuit.gathered(problem, gradient + forces), 0.0)


class _Parts(NamedTuple):
    """The segments of the route, its curves with the states of their joints, and which curves are not padding.

    The duration of padding is 1 s among the curves, and 0 in `durations`.
    """

    durations: Array
    coefficients: Array
    progress: Array | None
    c: Array
    h: Array
    states: Array
    real: Array

    @property
    def total(self) -> Array:
        """The sum of the durations of the curves."""
        return jnp.sum(jnp.where(self.real, self.h, 0.0))


def _parts(data: Data, problem: RouteProblem, s: Structure) -> _Parts:
    count = len(s.curves.owner)
    starts, rows = data.starts[:count], data.coefficients[:count]
    own = None if data.progress is None else data.progress[:count]
    durations = jnp.diff(jnp.append(jnp.minimum(starts, data.duration), data.duration))
    c, h = chain(s.curves, rows, durations, own)
    real = jnp.ones(h.shape, bool)
    if s.padded:
        real = jnp.isfinite(starts)
        h = jnp.where(real, h, 1.0)
        c = jnp.where(real[:, None, None], c, _end(c, h, jnp.sum(real) - 1)[None])
    states = geometry.joint_states(c, h, 1.0 - problem.moving, problem.seam is not None, problem.sense)
    return _Parts(durations, rows, own, c, h, states, real)


def _end(c: Array, h: Array, last: Array) -> Array:
    """Return coefficients of padding, which has the state at the end of the route at its start."""
    end = jnp.stack([x / factor for x, factor in zip(pieces.values(c[last], h[last], 2), (1, 1, 2), strict=True)])
    return jnp.pad(end, [(0, c.shape[1] - 3), (0, 0)])


def _length(problem: RouteProblem, data: Data, s: Structure) -> Array:
    """Return the unit of length of the objective "nearest"; this unit does not influence the optimal variables."""
    if s.kind != "nearest":
        return jnp.ones_like(data.duration)
    own = _parts(data, problem, s)
    return jax.lax.stop_gradient(jnp.sqrt(problem.unit * own.total / geometry.time_scale(own.h, problem.moving)))


def _with_data(problem: RouteProblem, data: Data, s: Structure, length: Array) -> RouteProblem:
    """Return the problem for other data; only the fields that occur in the optimality conditions change."""
    own = _parts(data, problem, s)
    count = len(s.curves.owner)
    widths = jnp.stack([jnp.broadcast_to(x, (count + 1,)) for x in data.tube], axis=1)
    widths = widths[np.array([own.start for own in s.curves.joint_rows()])]
    fields = geometry.smooth_fields(own.c, own.h, own.states, widths, problem.moving, problem.composed, problem.sense)
    bounds = jnp.concatenate([data.bounds, jnp.ones(len(problem.clear))])
    fields |= scales(problem.names, bounds, None if problem.shifts is None else jnp.sqrt(problem.squares))
    if problem.origins is not None:
        fields |= {"origins": own.states[:-1, 0].T + jnp.asarray(data.origin)[:, None]}
    if problem.starts is not None:
        fields |= {"starts": jnp.cumsum(own.durations) - own.durations}
    durations = fields["durations"]
    fields |= {"shortest": SHORTEST * durations, "longest": LONGEST * durations}
    if s.kind == "nearest":
        near, pace = geometry.nearest(fields["ends"], durations, problem.moving, length)
        fields |= {"near": near, "pace": pace}
    if s.padded and problem.road is not None:
        fields["road"] = jnp.where(own.real, problem.road, problem.road[..., :1])
    return problem._replace(**fields)


@eqx.filter_jit
def _assembled(
    s: Structure, fields: dict[str, Any], data: Data, z: Array, origin: Array
) -> tuple[Route, Array, Array, Array]:
    """Return the route, the objective, the displacements of the joints, and the change of the duration."""
    problem = s.problem(fields)
    length = _length(problem, data, s)
    moved = _with_data(problem, data, s, length)
    own = _parts(data, problem, s)
    _, new_h = geometry.moved_states(moved, own.states, own.h, z)
    new_c, _ = geometry.changed(moved, own.c, own.h, own.states, z)
    starts = data.starts[: len(own.durations)]
    given = from_segments(starts, own.coefficients, data.duration, origin, own.progress)
    if s.padded:
        new_c, new_h = jnp.where(own.real[:, None, None], new_c, 0.0), jnp.where(own.real, new_h, 0.0)
    durations, rows, progress = rebuilt(s.curves, own.durations, own.progress, own.h, new_c, new_h)
    times = jnp.append(jnp.zeros_like(durations[:1]), jnp.cumsum(durations))
    new_starts = jnp.where(own.real, times[:-1], jnp.inf) if s.padded else times[:-1]
    path = from_segments(new_starts, rows, times[-1], origin, progress)
    unit = length**2 * geometry.time_scale(own.h, problem.moving) / own.total if s.kind == "nearest" else problem.unit
    value = times[-1] if s.kind == "fastest" else objective(moved, segments(moved, z)) * unit
    displacement = _positions(path, len(rows)) - _positions(given, len(rows))
    return path, value, displacement, jnp.sum(durations - own.durations)


def _positions(route: Route, count: int) -> Float[Array, "joints 3"]:
    """Return the positions of the joints of a route with `count` segments; those of padding are at the end."""
    times = jnp.minimum(jnp.append(route.starts[:count], route.duration), route.duration)
    return route.sampled(times, 0)[0]
