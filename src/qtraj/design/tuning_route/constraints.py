"""Express the limits and the tube as constraints at the nodes of each segment, with their derivatives.

The constraint for a limit is (value/limit)² ≤ margin. The margin (at most 1) accounts for larger values between the
nodes. The tube bounds the horizontal and the vertical distance from the original path at equal fractions of a segment.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning_route import basis
from qtraj.design.tuning_route.basis import lifted
from qtraj.design.tuning_route.problem import RouteProblem, Segments
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity

Names = tuple[str, ...]


def orders(names: Names) -> int:
    """Return the highest order of the derivatives of the path in the limits, at least 2."""
    return max([2, *(quantity(name).order for name in names)])


def ratios(names: Names, q: Any, squares: Float[Array, " limits"]) -> Float[Array, "limits ..."]:
    """Return (value/limit)² of each limit.

    The first axis of `q` contains the components of the derivatives of r with respect to u = t/h, in ascending order,
    and then the duration h.
    """
    h = q[-1]
    order = (q.shape[0] - 1) // 3
    i = Invariants([None, *(tuple(q[3 * k + c] / h ** (k + 1) for c in range(3)) for k in range(order))])
    values = []
    for name in names:
        entry = quantity(name)
        top = entry.numerator(i)
        values.append(top if entry.denominator is None else top / entry.denominator(i))
    return jnp.stack(values) / squares.reshape(-1, *[1] * (q.ndim - 1))


def stacked(names: Names, s: Segments, nodes: Any) -> Float[Array, "q nodes n"]:
    """Return the argument `q` of `ratios` at nodes of all segments."""
    order = orders(names)
    table = basis.at_nodes(nodes, order)[1:].reshape(-1, 6)
    rows = (table @ s.ends.reshape(6, -1)).reshape(order, len(nodes), 3, -1)
    rows = jnp.moveaxis(rows, 2, 1).reshape(3 * order, len(nodes), -1)
    return jnp.concatenate([rows, jnp.broadcast_to(lifted(s.h, 3), rows[:1].shape)])


def distances(s: Segments, nodes: Any, offset: Float[Array, "3 nodes n"]) -> Float[Array, "3 nodes n"]:
    """Return the displacements from the original path."""
    table = basis.at_nodes(nodes, 0)[0]
    return jnp.moveaxis((table @ s.change.reshape(6, -1)).reshape(len(nodes), 3, -1), 1, 0) + offset


def values(names: Names, problem: RouteProblem, s: Segments, fine: bool = False) -> Float[Array, "constraints nodes n"]:
    """Return the squares of all limited quantities and of both distances, relative to their bounds."""
    nodes = basis.FINE_NODES if fine else basis.NODES
    offset, tube = (problem.fine_offset, problem.fine_tube) if fine else (problem.offset, problem.tube)
    away = distances(s, nodes, offset)
    near = jnp.stack([away[0] ** 2 + away[1] ** 2, away[2] ** 2]) / tube
    if not names:
        return near
    return jnp.concatenate([ratios(names, stacked(names, s, nodes), problem.squares), near])


class Expansion(NamedTuple):
    """The constraints at the nodes with their gradients and the weighted sum of their second derivatives.

    `slopes` (q, limits, nodes, n) and `bending` (q, q, nodes, n) are derivatives with respect to the argument of
    `ratios`. `away` (3, nodes, n) is the displacement from the original path. The last two constraints are the squares
    of the horizontal and of the vertical displacement, relative to the squared half-widths of the tube.
    """

    values: Float[Array, "constraints nodes n"]
    slopes: Float[Array, "q limits nodes n"]
    bending: Float[Array, "q q nodes n"]
    away: Float[Array, "3 nodes n"]


def expand(names: Names, problem: RouteProblem, s: Segments, weights: Float[Array, "constraints nodes n"]) -> Expansion:
    """Return the constraints and their derivatives; `weights` multiply the second derivatives."""
    away = distances(s, basis.NODES, problem.offset)
    near = jnp.stack([away[0] ** 2 + away[1] ** 2, away[2] ** 2]) / problem.tube
    q = stacked(names, s, basis.NODES)
    if not names:
        empty = jnp.zeros((q.shape[0], 0, *q.shape[1:]))
        return Expansion(near, empty, jnp.zeros((q.shape[0], *q.shape)), away)
    unit = jnp.eye(q.shape[0], dtype=q.dtype)

    def ratio(q: Array) -> Array:
        return ratios(names, q, problem.squares)

    def along(function: Any) -> Array:
        def one(e: Array) -> Array:
            return jax.jvp(function, (q,), (jnp.broadcast_to(e[:, None, None], q.shape),))[1]

        return jax.vmap(one)(unit)

    slope = jax.grad(lambda q: jnp.sum(weights[:-2] * ratio(q)))
    return Expansion(jnp.concatenate([ratio(q), near]), along(ratio), along(slope), away)
