"""Convert a shape to the arguments of `tune_route`: a route along the middle of the track, timed as fast as possible.

The distances to the right and to the left edge usually differ. Therefore the reference line is moved to the middle
between the edges, along the horizontal normals at the joints, and the tube has half of the total width on both sides.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.design.limits import Limits
from qtraj.design.timing.outcome import Retimed
from qtraj.design.timing.own_requirements import imposable
from qtraj.design.timing.retime import retime
from qtraj.foundation.arrays import concrete, constants, is_traced
from qtraj.path.route import Route
from qtraj.path.shape import Shape

MARGIN = 1.0
"""Default distance [m] that the route keeps from both edges: half the width of a vehicle that is 2 m wide."""

VERTICAL = 0.05
"""Vertical half-width of the tube [m]: a route stays on the road."""


class RouteInTube(NamedTuple):
    """A route, timed as fast as possible, and the horizontal and vertical half-widths of the tube around it."""

    route: Route
    tube: tuple[Any, Any]


def route_in_tube(shape: Shape, limits: Limits, tube: Any) -> RouteInTube:
    """Return the route of a shape and its tube.

    `tube` [m]: None for the widths of the shape less `MARGIN`; distances (n, 2) to the right and to the left; or
    half-widths as for a route.

    **Raises:** ValueError for a shape without widths and tube, a track that is too narrow, or limits that do not bound
    the speed.
    """
    if tube is None:
        if shape.widths is None:
            raise ValueError(
                "tune_route needs the widths of the track, but this shape has none: pass tube=, a half-width or "
                "distances (n, 2) to the right and to the left [m], or create the shape with widths="
            )
        tube = np.asarray(shape.widths, float) - MARGIN
    sides = None if isinstance(tube, tuple) else concrete(tube)
    if sides is not None and np.ndim(sides) == 2:
        shape, tube = _middle(shape, np.asarray(sides, float))
    return RouteInTube(_timed(shape, limits), tube if isinstance(tube, tuple) else (tube, VERTICAL))


def _middle(shape: Shape, sides: Float[np.ndarray, "n 2"]) -> tuple[Shape, Float[np.ndarray, " n"]]:
    """Return the line in the middle between the edges, and half of the distance between them at its joints."""
    joints = np.asarray(shape.route.joints(1), float)
    if sides.shape != (len(joints), 2):
        raise ValueError(
            f"the distances to the right and to the left must have shape ({len(joints)}, 2), one row for each joint of "
            f"the shape, but an array of shape {sides.shape} was given"
        )
    half = 0.5 * sides.sum(axis=1)
    if not (np.isfinite(half).all() and (half > 0).all()):
        k = int(np.flatnonzero(~(np.isfinite(half) & (half > 0)))[0])
        raise ValueError(
            f"the track is too narrow: {sides[k].tolist()} m to the right and to the left of joint {k}, after the "
            f"margin (by default {MARGIN:g} m on each side). Pass a smaller margin, as in tube=shape.widths - 0.5"
        )
    x, y = joints[:, 1, 0], joints[:, 1, 1]
    level = np.hypot(x, y)
    if not (level > 0).all():
        raise ValueError("the track is vertical at a joint, so it has no right and left side: pass tube= as a number")
    left = np.stack([-y / level, x / level, 0 * x], axis=1)
    points = joints[:, 0] + left * (0.5 * (sides[:, 1] - sides[:, 0]))[:, None]
    moved = Shape.through(points, closed=shape.closed)
    if moved.route.segments != len(points) - 1:
        raise ValueError("joints of the shape coincide in the middle of the track: pass fewer points")
    return moved, half


def _timed(shape: Shape, limits: Limits) -> Route:
    """Return the shape with its fastest timing as a route with the same joints.

    **Raises:** ValueError inside jit or vmap, if the limits do not bound the speed, or if the timing fails.
    """
    known = constants(imposable(shape, limits))
    if is_traced(known):
        raise ValueError(
            "tune_route needs concrete values: differentiate it with grad, jvp, jacfwd or jacrev, but call these "
            "outside jit and vmap, once for each shape"
        )
    timed = retime(shape, known)
    if not np.isfinite(np.asarray(timed.timing.times)).all() or not timed.converged:
        raise ValueError(
            f"tune_route starts from the fastest timing of the shape, but the search for it failed: {timed.result}"
        )
    return _as_route(shape, timed)


def _as_route(shape: Shape, timed: Retimed) -> Route:
    """Return the route through the states of the retimed path at the joints, which are knots of its timing."""
    joints, knots = np.asarray(shape.route.joints(2), float), np.asarray(timed.timing.knots)
    u, c = np.asarray(shape.route.times), np.asarray(timed.timing.coefficients)
    k = np.searchsorted(0.5 * (knots[1:] + knots[:-1]), u)
    cell = np.minimum(k, len(c) - 1)
    place, length = (u - knots[cell]) / np.diff(knots)[cell], np.diff(knots)[cell]
    powers = place[:, None] ** np.arange(4)
    square = np.sum(c[cell] * powers, axis=1)[:, None]
    slope = (np.sum(c[cell][:, 1:] * powers[:, :3] * [1, 2, 3], axis=1) / length)[:, None]
    velocity = np.sqrt(square) * joints[:, 1]
    acceleration = square * joints[:, 2] + 0.5 * slope * joints[:, 1]
    states = [joints[:, 0], velocity, acceleration]
    if shape.closed:
        for x in states:
            x[-1] = x[0]
    return Route(np.asarray(timed.timing.times)[k], *states)
