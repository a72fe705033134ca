"""Derivatives of the solutions of a few problems outside jit: jets on the host, so that nothing is compiled.

The conditions are those of `sensitivity`. Jets of second order in the variables z, the time u of a peak and the data θ
contain all derivatives of the conditions with respect to z, u and θ.
"""

from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.jets import Jet
from qtraj.design.one_sided import scale_and_shift
from qtraj.design.tuning import constraints
from qtraj.design.tuning.problem import plain
from qtraj.design.tuning.search import SearchResult
from qtraj.design.tuning.subproblem import ACTIVE, AT_BOUND
from qtraj.design.tuning.task import Task
from qtraj.path.quantity import quantity

MAX_COUNT = 16
"""Largest batch that is differentiated on the host; compiled code is faster for larger ones."""

MAX_CONDITION = 1e13
"""Largest condition number of the equations for which the derivative counts as determined."""


class _Components:
    """The components of vectors, indexed as an array with the components on its last axis."""

    def __init__(self, components: list[Jet]):
        self.components = components

    def __getitem__(self, index: tuple[Any, int]) -> Jet:
        return self.components[index[1]]


class _Expansion(NamedTuple):
    """First and second derivatives of the cost and of the active constraints in z, u and θ."""

    slope: Float[np.ndarray, " m"]
    curvature: Float[np.ndarray, "m m"]
    slopes: Float[np.ndarray, "k m"]
    curvatures: Float[np.ndarray, "k m m"]


def is_supported(task: Task, moving: Task) -> bool:
    """Return whether the solutions of a batch are differentiated on the host; `moving` marks the leaves that are θ."""
    objective = task.problem.objective
    # The arrays of an objective, and with them the placement, enter by operations that jets do not have.
    parts = (moving.problem.objective, moving.problem.placement if jax.tree.leaves(objective) else ())
    return len(task.low) <= MAX_COUNT and objective.is_formula and not any(jax.tree.leaves(parts))


def derivatives(task: Task, result: SearchResult, moving: Task) -> Float[np.ndarray, "batch n p"]:
    """Return ∂z/∂θ for a batch of solutions; θ contains the components of the `moving` leaves of `task`, in order."""
    task, result = jax.tree.map(np.asarray, (task, result))
    with np.errstate(all="ignore"):
        return np.stack([_derivative(task, result, moving, b) for b in range(len(task.low))])


def _derivative(tasks: Task, results: SearchResult, moving: Task, index: int) -> Float[np.ndarray, "n p"]:
    """Return ∂z/∂θ for one solution of a batch, NaN if it is not determined, and 0 for an ill-posed problem."""
    task, result = jax.tree.map(lambda x: x[index], (tasks, results))
    n, active = result.z.size, result.multiplier > ACTIVE
    places, size = _places(task, moving, n + 1)
    if not np.isfinite(result.z).all():
        return np.zeros((n, size - n - 1))
    found = _expanded(task, result, active, places, size)
    low = result.z <= task.low + AT_BOUND
    high = (result.z >= task.high - AT_BOUND) & ~low
    at_bound = [(low, places.low), (high, places.high)]
    try:
        return _solved(found, result.time[active], n, at_bound)
    except np.linalg.LinAlgError:
        return np.full((n, size - n - 1), np.nan)


def _places(task: Task, moving: Task, first: int) -> tuple[Task, int]:
    """Return the index of the first component of each moving leaf, −1 for the other leaves, and the end."""
    leaves, structure = jax.tree.flatten(task)
    places, end = [], first
    for x, moves in zip(leaves, jax.tree.leaves(moving), strict=True):
        places.append(end if moves else -1)
        end += x.size if moves else 0
    return jax.tree.unflatten(structure, places), end


def _expanded(
    task: Task, result: SearchResult, active: Bool[np.ndarray, " peaks"], places: Task, size: int
) -> _Expansion:
    """Expand the cost and the active constraints of one problem in `size` variables: z, u and θ."""
    n, times, kinds = result.z.size, result.time[active], result.limit[active]
    data = jax.tree.map(lambda x, place: _jets(x, place, size), task, places)
    formulas = plain(data.problem)
    z = [_variable(value, k, size) for k, value in enumerate(result.z)]
    cost = formulas.cost(z)
    cubics, by = formulas.cubics(z), constraints.units(formulas, z, data.limits, False)
    constant = by._replace(limits={name: x[None] for name, x in task.limits.items()})
    slopes, curvatures = np.zeros((times.size, size)), np.zeros((times.size, size, size))
    for kind, name in enumerate(task.limits):
        own = np.flatnonzero(kinds == kind)
        if own.size:
            u = _variable(times[own], n, size)
            at = constraints.place(cubics, u, max(1, constraints.order_of((name,))))
            one_sided = quantity(name).bounds_side
            g = constraints.value(name, at, constraints.invariants(at, by), constant if one_sided else by, u)
            slopes[own] = np.broadcast_to(g.gradient, (size, own.size)).T
            if one_sided and places.limits[name] >= 0:
                # At an active limit b, the shift s in ln((x + s)/(b + s)) is arbitrary, and so counts as constant.
                scale = scale_and_shift(name, task.limits)[0]
                slopes[own, places.limits[name]] = -quantity(name).side / scale
            curvatures[own] = np.moveaxis(np.broadcast_to(g.hessian, (size, size, own.size)), 2, 0)
    gradient = np.broadcast_to(cost.gradient, (size, 1))[:, 0]
    return _Expansion(gradient, np.broadcast_to(cost.hessian, (size, size, 1))[..., 0], slopes, curvatures)


def _jets(x: np.ndarray, place: int, size: int) -> Any:
    """Return a leaf with one point on its last axis; the components of a moving leaf are jets."""
    if place < 0:
        return x[None]
    jets = [_variable(value, place + k, size) for k, value in enumerate(np.atleast_1d(x))]
    return _Components(jets) if x.ndim else jets[0]


def _variable(value: Any, index: int, size: int) -> Jet:
    gradient = np.zeros((size, 1))
    gradient[index] = 1.0
    return Jet(np.atleast_1d(value), gradient, np.zeros((size, size, 1)))


def _solved(
    found: _Expansion,
    times: Float[np.ndarray, " k"],
    n: int,
    at_bound: list[tuple[Bool[np.ndarray, " n"], int]],
) -> Float[np.ndarray, "n p"]:
    """Return ∂z/∂θ from the linearised conditions."""
    free = ~(at_bound[0][0] | at_bound[1][0])
    multipliers = _multipliers(found, free, n)
    second = found.curvature + np.einsum("k,kij->ij", multipliers, found.curvatures)
    inner = (times > 0) & (times < 1) & (found.curvatures[:, n, n] < 0)
    rates = (multipliers[:, None] * found.curvatures[:, n])[inner]
    k, moving, data = times.size, np.flatnonzero(inner), slice(n + 1, None)
    matrix = np.zeros((n + k + moving.size,) * 2)
    change = np.concatenate([second[:n, data], found.slopes[:, data], rates[:, data]])
    matrix[:n, :n], matrix[:n, n : n + k], matrix[:n, n + k :] = second[:n, :n], found.slopes[:, :n].T, rates[:, :n].T
    matrix[n : n + k, :n], matrix[n + k :, :n] = found.slopes[:, :n], rates[:, :n]
    times_of = n + k + np.arange(moving.size)
    matrix[n + moving, times_of] = matrix[times_of, n + moving] = found.slopes[moving, n]
    matrix[times_of, times_of] = rates[:, n]
    for bounded, place in at_bound:
        own = np.flatnonzero(bounded)
        matrix[own], change[own] = np.eye(len(matrix))[own], 0.0
        if place >= 0:
            change[own, place - n - 1 + own] = -1.0
    if np.linalg.cond(matrix) > MAX_CONDITION:
        raise np.linalg.LinAlgError
    return -np.linalg.solve(matrix, change)[:n]


def _multipliers(found: _Expansion, free: Bool[np.ndarray, " n"], n: int) -> Float[np.ndarray, " k"]:
    """Return the multipliers that satisfy the conditions best, which are more accurate than those of a search."""
    slopes = np.where(free, found.slopes[:, :n], 0.0)
    best = np.linalg.lstsq(slopes.T, -np.where(free, found.slope[:n], 0.0), rcond=None)[0]
    return np.maximum(best, 2 * ACTIVE)
