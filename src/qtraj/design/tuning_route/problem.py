"""Define the optimisation problem of a route: variables at the joints, data of the segments, and objective.

The variables of a joint are the changes of its position, velocity, acceleration and time, scaled to lengths. Vectors
have components along and across the original path. The position changes only across the path. A shift of a joint along
the path would change only the subdivision into segments, and the objective would hardly determine this shift. A segment
depends only on the variables of its two joints, so the matrix of second derivatives is block tridiagonal. Segments
and joints are always the last axis of an array. Segments that do not change, and the padding, have `moving` = 0 and no
constraints.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from qtraj.design.tuning_route import basis

BLOCK = 10
"""Number of variables of a joint: position, velocity, acceleration (3 each) and time."""

CACHED = 32
"""Number of segments whose derivatives are computed at once; their data fit into the cache of the processor."""

JERK = basis.gram(3)


class RouteProblem(NamedTuple):
    """The data of n segments with n + 1 joints.

    `ends` (6, 3, n) [m]: the scaled end states (see `basis`) of the original segments, with positions relative to the
    start of the segment. `durations` (n,) [s]: the original durations. `offset`, `fine_offset` (3, nodes, n) [m]: the
    quintic through the end states minus the original path. `squares` (limits,): the squares of the limits. `tube`
    (2, nodes, n) [m²]: the squares of the half-widths. `used` (limits + 2, nodes, n): 1 for the constraints that are
    used. `shortest`, `longest` (n,) [s]: bounds on the durations.

    The objective is the sum over segments of δᵀ`near`δ + `pace`(h/h₀ − 1)² + `jerk`∫|r⃛|²dt + `time`·h, where δ is the
    change of the scaled end states, h the duration and h₀ the original duration. `unit` times this sum is the objective
    in the user's units. `free` (10, n + 1) is 0 for fixed variables; `scale` (10,) converts variables to SI. `axes`
    (2, 3, 3, n): unit vectors along, to the left of and above the original path at both ends (end, unit vector,
    component, segment). `seam`: the index of the last joint of a closed route, which has the state of the first joint;
    otherwise None.
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
    seam: Int[Array, ""] | None = None


class Segments(NamedTuple):
    """The segments for some variables.

    `h` are the durations, `states` (6, 3, n) the position, velocity and acceleration at both ends [SI], `ends` the
    scaled end states (see `basis`) [m], and `change` the changes of the scaled end states [m].
    """

    h: Float[Array, " n"]
    states: Float[Array, "6 3 n"]
    change: Float[Array, "6 3 n"]
    ends: Float[Array, "6 3 n"]


_FINE_FIELDS = ("fine_offset", "fine_tube")
_WHOLE_FIELDS = ("free", "unit", "squares", "scale", "seam")


def by_blocks(function: Callable[..., Any], problem: RouteProblem, *trees: Any, fine: bool = False) -> Any:
    """Call a function of a problem and arrays (segments last) for blocks of segments that fit into the cache.

    The function must process each segment independently of the others. It may use the data of the finer nodes only with
    `fine`, because they are large.
    """
    n = problem.durations.shape[0]
    whole = _WHOLE_FIELDS if fine else (*_WHOLE_FIELDS, *_FINE_FIELDS)
    own = {name: x for name, x in problem._asdict().items() if name not in whole}
    if n <= CACHED or n % CACHED:
        return function(problem, *trees)
    split = jax.tree.map(lambda x: jnp.moveaxis(x.reshape(*x.shape[:-1], n // CACHED, CACHED), -2, 0), (own, *trees))
    found = jax.lax.map(lambda x: function(problem._replace(**x[0]), *x[1:]), split)
    return jax.tree.map(lambda x: jnp.moveaxis(x, 0, -2).reshape(*x.shape[1:-1], n), found)


def powers(h: Float[Array, " n"]) -> Float[Array, "6 1 n"]:
    """Return the factors 1, h, h² that convert derivatives with respect to t into derivatives with respect to t/h."""
    return jnp.stack([jnp.ones_like(h), h, h * h] * 2)[:, None]


def segments(problem: RouteProblem, z: Float[Array, "10 joints"]) -> Segments:
    """Return the segments for the variables `z`."""
    shifts, longer = moved(problem, z)
    h0 = problem.durations
    h = h0 + longer
    given = problem.ends / powers(h0)
    # h v − h₀v₀ = h δv + (h − h₀)v₀ avoids cancellation; the acceleration is treated in the same way.
    first = longer / h0
    growth = jnp.stack([0.0 * h, first, first * (2 + first)] * 2)[:, None]
    change = powers(h) * shifts + growth * problem.ends
    return Segments(h, given + shifts, change, problem.ends + change)


def moved(problem: RouteProblem, z: Float[Array, "10 joints"]) -> tuple[Float[Array, "6 3 n"], Float[Array, " n"]]:
    """Return the changes of the states at both ends of the segments [SI, world axes], and of the durations [s]."""
    move = z * problem.scale[:, None]
    own = jnp.stack([move[:9, :-1], move[:9, 1:]]).reshape(2, 3, 3, 1, -1)
    world = jnp.sum(own * problem.axes[:, None], axis=2)
    return world.reshape(6, 3, -1), problem.moving * (move[9, 1:] - move[9, :-1])


def objective(problem: RouteProblem, z: Float[Array, "10 joints"]) -> Float[Array, ""]:
    """Return the objective for the variables `z`."""
    s = segments(problem, z)
    bent = jnp.einsum("lm,mcn->lcn", JERK, s.ends)
    near = jnp.sum(problem.near[:, :, None] * s.change[:, None] * s.change[None])
    pace = problem.pace * (s.h / problem.durations - 1.0) ** 2
    rough = problem.jerk * s.h**-5 * jnp.sum(bent * s.ends, axis=(0, 1))
    return near + jnp.sum(pace + rough + problem.time * s.h)
