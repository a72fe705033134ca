"""A route as an optimisation problem: variables at the joints, the data of each segment, and the objective.

The variables of a joint are the changes of its position, velocity, acceleration and time, scaled to lengths, the
vectors along and across the given path. The position changes only across it: a joint that slides along the path changes
nothing but where the path is divided, and an objective would hardly determine by how much. A segment depends on the
variables of its two joints only, so that the second derivatives of everything form a block-tridiagonal matrix. Arrays
have the segments or joints on the last axis; segments that stay as they are, and padding, have `moving` = 0 and no
constraints.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.tuning_route import basis

BLOCK = 10
"""Variables of a joint: position, velocity, acceleration, time."""

CACHED = 32
"""Segments whose derivatives are computed at once, few enough for the processor's cache."""

JERK = basis.gram(3)


class RouteProblem(NamedTuple):
    """The data of all segments; n of them with n + 1 joints.

    `ends` (6, 3, n) [m] and `durations` (n,) [s]: the end data (see `basis`) before tuning, with positions relative to
    the segment's start. `offset`, `fine_offset` (3, nodes, n) [m]: that quintic minus the given path. `squares`
    (limits,): the squares of the limits. `tube` (2, nodes, n) [m²]: the squares of the half-widths. `used`
    (limits + 2, nodes, n): which constraints count. `shortest`, `longest` (n,) [s]: bounds on the durations.

    The objective is the sum over segments of δᵀ`near`δ + `pace`(h/h₀ − 1)² + `jerk`∫|r⃛|²dt + `time`·h, where δ is the
    change of the end data; in the user's units it is `unit` times that. `free` (10, n + 1) has zeros for fixed
    variables; `scale` (10,) converts variables to SI.
    `axes` (2, 3, 3, n): unit vectors along, to the left of and above the given path at both ends, in rows.
    """

    ends: Float[Array, "6 3 n"]
    durations: Float[Array, " n"]
    moving: Float[Array, " n"]
    offset: Float[Array, "3 nodes n"]
    fine_offset: Float[Array, "3 fine n"]
    squares: Float[Array, " limits"]
    tube: Float[Array, "2 nodes n"]
    fine_tube: Float[Array, "2 fine n"]
    used: Float[Array, "constraints nodes n"]
    shortest: Float[Array, " n"]
    longest: Float[Array, " n"]
    near: Float[Array, "6 6 n"]
    pace: Float[Array, " n"]
    jerk: Float[Array, " n"]
    time: Float[Array, " n"]
    unit: Float[Array, ""]
    free: Float[Array, "10 joints"]
    scale: Float[Array, " 10"]
    axes: Float[Array, "2 3 3 n"]


class Segments(NamedTuple):
    """Segments at given variables: duration, states (6, 3, n) [SI], change of the end data, and the end data [m]."""

    h: Float[Array, " n"]
    states: Float[Array, "6 3 n"]
    change: Float[Array, "6 3 n"]
    ends: Float[Array, "6 3 n"]


_JOINT_FIELDS = ("free", "unit", "squares", "scale", "fine_offset", "fine_tube")


def by_blocks(function: Callable[..., Any], problem: RouteProblem, *trees: Any) -> Any:
    """A function of a problem and arrays with the segments last, called for blocks of segments that fit into the cache.

    It must be local: each segment's result may depend on this segment only.
    """
    n = problem.durations.shape[0]
    own = {name: x for name, x in problem._asdict().items() if name not in _JOINT_FIELDS}
    if n <= CACHED or n % CACHED:
        return function(problem, *trees)
    split = jax.tree.map(lambda x: jnp.moveaxis(x.reshape(*x.shape[:-1], n // CACHED, CACHED), -2, 0), (own, *trees))
    found = jax.lax.map(lambda x: function(problem._replace(**x[0]), *x[1:]), split)
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], n), found)


def powers(h: Float[Array, " n"]) -> Float[Array, "6 1 n"]:
    """The factors 1, h, h² of the states in the end data."""
    return jnp.stack([jnp.ones_like(h), h, h * h] * 2)[:, None]


def segments(problem: RouteProblem, z: Float[Array, "10 joints"]) -> Segments:
    """The segments at the variables `z`."""
    shifts, longer = moved(problem, z)
    h0 = problem.durations
    h = h0 + longer
    given = problem.ends / powers(h0)
    # h v − h₀v₀ = h δv + (h − h₀)v₀, and likewise for the acceleration, without cancellation.
    first = longer / h0
    growth = jnp.stack([0.0 * h, first, first * (2 + first)] * 2)[:, None]
    change = powers(h) * shifts + growth * problem.ends
    return Segments(h, given + shifts, change, problem.ends + change)


def moved(problem: RouteProblem, z: Float[Array, "10 joints"]) -> tuple[Float[Array, "6 3 n"], Float[Array, " n"]]:
    """The changes of the states at both ends of the segments [SI, world axes], and of the durations [s]."""
    move = z * problem.scale[:, None]
    own = jnp.stack([move[:9, :-1], move[:9, 1:]]).reshape(2, 3, 3, 1, -1)
    world = jnp.sum(own * problem.axes[:, None], axis=2)
    return world.reshape(6, 3, -1), problem.moving * (move[9, 1:] - move[9, :-1])


def objective(problem: RouteProblem, z: Float[Array, "10 joints"]) -> Float[Array, ""]:
    """The objective at the variables `z`."""
    s = segments(problem, z)
    bent = jnp.einsum("lm,mcn->lcn", JERK, s.ends)
    near = jnp.sum(problem.near[:, :, None] * s.change[:, None] * s.change[None])
    pace = problem.pace * (s.h / problem.durations - 1.0) ** 2
    rough = problem.jerk * s.h**-5 * jnp.sum(bent * s.ends, axis=(0, 1))
    return near + jnp.sum(pace + rough + problem.time * s.h)
