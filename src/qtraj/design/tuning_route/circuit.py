"""Join the last joint of a closed route to its first joint, so that both have the same state.

The position, velocity and acceleration of the first joint are the variables; the last joint, with the index `seam`,
repeats them. The only separate variable of the last joint is its time. So the matrix of second derivatives couples the
first joint to the last segment, and is block tridiagonal with a border (see `chain`).
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from qtraj.design.tuning_route.chain import Border, Chain
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.path.route import JOINED, Route


def require_closed(route: Route) -> None:
    """Raise a ValueError if a route does not end where it starts, or has only one segment."""
    first, last = np.asarray(route.joints(0))[[0, -1], 0]
    gap, size = float(np.linalg.norm(last - first)), float(np.max(np.abs(first)))
    if gap > max(JOINED, 16 * size * float(np.finfo(float).eps)):
        raise ValueError(
            f"a closed route must end where it starts, but it starts at {first.tolist()} and ends at {last.tolist()}, "
            f"{gap:.6g} m away. Add a segment that leads back to the start, or call tune_route without closed=True."
        )
    if route.segments == 1:
        raise ValueError(
            "a closed route must have at least two segments, but this route has one: divide it at a time t [s] by "
            "route.window(0, t) + route.window(t, route.duration)"
        )


def gathered(problem: RouteProblem, gradient: Float[Array, "10 joints"]) -> Float[Array, "10 joints"]:
    """Return derivatives with respect to the free variables; derivatives at the last joint are added at the first."""
    if problem.seam is not None:
        gradient = gradient.at[:, 0].add(gradient[:, problem.seam])
    return gradient * problem.free


def repeated(problem: RouteProblem, change: Float[Array, "10 joints"]) -> Float[Array, "10 joints"]:
    """Return the changes of all variables; the last joint of a closed route repeats the changes of the first."""
    change = change * problem.free
    return change if problem.seam is None else change.at[:, problem.seam].add(change[:, 0])


def bordered(
    free: Float[Array, "n b"], seam: Int[Array, ""], diagonal: Float[Array, "n b b"], lower: Float[Array, "n-1 b b"]
) -> Chain:
    """Return the matrix of a closed route from the matrix of the open route.

    The rows and columns of fixed variables, and of the state that the last joint repeats, are rows and columns of the
    identity matrix.
    """
    unit = jnp.eye(diagonal.shape[1], dtype=diagonal.dtype)
    shared, own = free[0], free.at[0].set(0.0)
    corner = (diagonal[0] + diagonal[seam]) * shared[:, None] * shared[None] + (1 - shared)[:, None] * unit
    side = jnp.zeros_like(diagonal).at[1].add(lower[0]).at[seam - 1].add(lower[seam - 1].T).at[seam].add(diagonal[seam])
    side = side * own[:, :, None] * shared[None, None]
    diagonal = diagonal * own[:, :, None] * own[:, None] + (1 - own)[:, :, None] * unit[None]
    return Chain(diagonal, lower * own[1:, :, None] * own[:-1, None], Border(corner, side))
