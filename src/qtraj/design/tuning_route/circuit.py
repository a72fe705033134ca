"""Join the last joint of a closed route to its first joint, so that both have the same state.

The position, velocity and acceleration of the first joint are the variables; the last joint, with the index `seam`,
repeats them. The only separate variable of the last joint is its time. So the matrix of second derivatives couples the
first joint to the last segment, and is block tridiagonal with a border (see `chain`).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.solve.chain import Border
from qtraj.design.tuning_route.problem import RouteProblem
from qtraj.foundation.namespace import xp
from qtraj.path import pieces
from qtraj.path.route import Route
from qtraj.path.route_parts import JOINED


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


def require_same_heading(
    c: Float[np.ndarray, "n terms 3"], h: Float[np.ndarray, " n"], sense: Float[np.ndarray, " n"]
) -> None:
    """Raise a ValueError if a vehicle returns to the start of a closed route with the opposite heading.

    `c` are the coefficients of the curves, `h` their durations, and `sense` is −1 where the vehicle drives in reverse.
    """
    end = sense[-1] * pieces.values(c[-1:], h[-1:], 1)[1][0]
    if float(end @ c[0, 1]) < 0:
        raise ValueError(
            "the vehicle reverses an odd number of times on this closed route, so it would return to the start with "
            "the opposite heading. Add a point of reversal, or call tune_route without closed=True."
        )


def repeated(problem: RouteProblem, z: Float[Any, "joints 10"]) -> Float[Any, "joints 10"]:
    """Return the changes of all variables; the last joint of a closed route repeats the changes of the first."""
    if problem.seam is None:
        return z
    return xp.concatenate([z[:-1], z[-1:] + z[:1]])


def gathered(problem: RouteProblem, gradient: Float[Any, "joints 10"]) -> Float[Any, "joints 10"]:
    """Return derivatives with respect to the variables; those at the last joint are added at the first."""
    if problem.seam is None:
        return gradient
    return xp.concatenate([gradient[:1] + gradient[-1:], gradient[1:]])


def border(diagonal: Float[np.ndarray, "n b b"], lower: Float[np.ndarray, "n-1 b b"]) -> Border:
    """Return the rows and columns of the first joint of a closed route from the matrix of the open route."""
    side = np.zeros_like(diagonal)
    side[1] += lower[0]
    side[-2] += lower[-1].T
    side[-1] += diagonal[-1]
    return Border(diagonal[0] + diagonal[-1], side)
