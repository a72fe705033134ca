"""Compute the direction of motion of a vehicle at rest, on which the forces on the vehicle depend.

A path has no tangent at an instant at which its velocity is zero. Let the derivative of order m + 1 be the first
derivative that is not zero at this instant, and let s be the time from this instant. Near this instant the velocity is,
to leading order, s^m/m! times this derivative, so the derivative determines the direction of motion. With this
direction, the forces at the stop are the limiting values of the forces during the motion.
"""

from collections.abc import Callable
from typing import Any

from jaxtyping import Array

from qtraj.foundation.namespace import xp
from qtraj.path.components import Triple, dot, scaled, select
from qtraj.path.frame_components import filled
from qtraj.path.frenet import Invariants, safe_root
from qtraj.path.regularity import DEFINED_TOLERANCE, has_tangent, is_significant

ORDER = 4
"""Highest order of the derivatives used; if the derivatives of orders 1 to 4 are zero, a stop has no direction."""


def driven_invariants(
    rows: list[Triple],
    up: Triple | None,
    vehicle: Any,
    t: Array,
    duration: Array,
    span: Array,
    root: Callable[[Any], Any] = safe_root,
) -> Invariants:
    """Return the invariants of the derivatives `rows` up to `ORDER`; they are also defined where the speed is zero.

    `up` is the vertical; None means the third axis. At a stop the pace is 0, and the velocity is replaced by a vector
    in the direction of the motion after the stop. At the end of the path, the direction of the motion before the stop
    is used instead. If all derivatives are zero, as for a parked vehicle, the vector is horizontal, and normal to the
    axis of a road that has another one than the vertical.
    """
    zero = xp.zeros_like(rows[0][0])
    rows = [filled(row, zero) for row in rows]
    moving = has_tangent(Invariants(rows, up), span)
    axis = None if vehicle is None else vehicle.axis
    direction, pace = _direction(rows, up, axis, t, duration), xp.where(moving, 1.0, 0.0).astype(zero.dtype)
    rows = [rows[0], select(moving, rows[1], direction), *rows[2:]]
    return Invariants(rows, up, vehicle, root, pace)


def _direction(rows: list[Triple], up: Triple | None, axis: Any, t: Array, duration: Array) -> Triple:
    """Return a vector in the direction of motion at a stop.

    The vector is the first derivative of order 2 or higher that differs significantly from zero. If `t` is the end of
    the path and the order is even, the sign is reversed. If there is no such derivative, the vector is horizontal.
    """
    at_end = t >= duration * (1 - DEFINED_TOLERANCE * float(xp.finfo(rows[0][0].dtype).eps))
    backwards = xp.where(at_end, -1.0, 1.0).astype(rows[0][0].dtype)
    squares = [dot(row, row) for row in rows[2:]]
    found = _horizontal(rows[0][0], up) if axis is None else _across(axis, rows[0][0])
    reference = xp.zeros_like(squares[0])
    for k in reversed(range(len(squares))):
        reference = squares[k] + duration**2 * reference
        # Before a stop, the motion is opposite to the first nonzero derivative if the order of this derivative is even.
        derivative = scaled(rows[k + 2], backwards) if k % 2 == 0 else rows[k + 2]
        found = select(is_significant(squares[k], reference), derivative, found)
    # Just before a stop, the velocity is too small for its direction, but has the right sign.
    return select(dot(found, rows[1]) < 0, scaled(found, -xp.ones_like(squares[0])), found)


def _horizontal(like: Array, up: Triple | None) -> Triple:
    """Return a horizontal vector, with components shaped like `like`; `up` None means that the third axis is up."""
    zero, one = xp.zeros_like(like), xp.ones_like(like)
    if up is None:
        return one, zero, zero
    return select(up[0] ** 2 + up[1] ** 2 > 0.5, (-up[1], up[0], zero), (up[2] + zero, zero, -up[0] + zero))


def _across(axis: Triple, like: Array) -> Triple:
    """Return a horizontal vector to the right of the `axis`, in world axes; the first axis if the axis is vertical."""
    x, y, _ = axis
    zero, one = xp.zeros_like(like + x), xp.ones_like(like + x)
    return select(x * x + y * y + zero > 0, (y + zero, -x + zero, zero), (one, zero, zero))
