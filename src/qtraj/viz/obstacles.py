"""Draw obstacles and the body in a map, seen from above, and obstacles in space."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.patches import Circle, Ellipse, Polygon

from qtraj.design.limits import Limits
from qtraj.design.obstacles.ball import Ball
from qtraj.design.obstacles.convex_polygon import ConvexPolygon
from qtraj.design.obstacles.cylinder import Cylinder
from qtraj.design.obstacles.ellipsoid import Ellipsoid
from qtraj.design.obstacles.half_space import HalfSpace
from qtraj.design.obstacles.keep_out import centres_at
from qtraj.path.hodograph import AbstractHodograph

FILL = {"facecolor": "0.8", "edgecolor": "0.45", "lw": 0.8, "zorder": 1}
BODY = {"fill": False, "edgecolor": "#0072B2", "lw": 0.7, "alpha": 0.7, "zorder": 4}

RINGS = 5
"""The number of wires around a cylinder or walls."""

UPRIGHT = 1e-6
"""A cylinder whose axis differs less from the vertical [rad] is drawn as a circle."""


def draw_obstacles(axes: Any, limits: Limits, centre: Float[np.ndarray, " 2"] | None = None) -> None:
    """Draw the obstacles of `limits` from above, relative to `centre` (2,) [m]; those that move, at the start.

    Of an inclined cylinder, the edges are drawn; of an inclined half space, its edge at the height 0.
    """
    shift = np.zeros(2) if centre is None else np.asarray(centre, float)
    for obstacle in limits.keep_out or ():
        patch = _patch(obstacle, shift)
        if patch is not None:
            axes.add_patch(patch)
        for start, direction in _edges(obstacle, shift):
            axes.axline(start, start + direction, color=FILL["edgecolor"], lw=FILL["lw"], zorder=1)


def draw_obstacles_in_space(axes: Any, limits: Limits, centre: Float[np.ndarray, " 3"], extent: float) -> None:
    """Draw the obstacles of `limits` as wires, relative to `centre` (3,) [m]; those that move, at the start.

    Cylinders and upright walls have the height of the axes. Half spaces, and obstacles larger than the `extent` [m] of
    the path, are not drawn.
    """
    low, high = axes.get_zlim()
    for obstacle in limits.keep_out or ():
        lines = _wires(obstacle, np.asarray(centre, float), low, high)
        if lines and max(np.ptp(line, axis=0).max() for line in lines) <= 2 * extent:
            for line in lines:
                axes.plot(*line.T, color=FILL["edgecolor"], lw=0.6, zorder=1)


def _wires(obstacle: Any, centre: np.ndarray, low: float, high: float) -> list[np.ndarray]:
    """Return lines (n, 3) on the surface of an obstacle; none for a half space."""
    angle = np.linspace(0.0, 2 * np.pi, 49)
    ring = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    if isinstance(obstacle, Ball | Ellipsoid):
        if isinstance(obstacle, Ball):
            axes = float(obstacle.radius) * np.eye(3)
        else:
            squares, vectors = np.linalg.eigh(np.asarray(obstacle.shape, float))
            axes = vectors * np.sqrt(squares)
        return [np.roll(ring, k, axis=1) @ axes.T + np.asarray(obstacle.centre)[0] - centre for k in range(3)]
    heights = np.linspace(low, high, RINGS)[:, None]
    if isinstance(obstacle, Cylinder):
        along = np.asarray(obstacle.axis, float) / np.linalg.norm(np.asarray(obstacle.axis, float))
        first = np.linalg.svd(along[None])[2][1]
        round_ = float(obstacle.radius) * (ring[:, :1] * first + ring[:, 1:2] * np.cross(along, first))
        point = np.asarray(obstacle.point, float)[0] - centre
        middle = point - (point @ along) * along
        return _joined([middle + h * along + round_ for h in heights], slice(0, -1, 12))
    if isinstance(obstacle, ConvexPolygon):
        corners = np.asarray(obstacle.vertices)[[*range(len(obstacle.vertices)), 0]] - centre[:2]
        return _joined([np.append(corners, np.full((len(corners), 1), h), axis=1) for h in heights], slice(0, -1))
    return []


def _joined(rings: list[np.ndarray], points: slice) -> list[np.ndarray]:
    """Return rings, and lines that join some of their points."""
    return [*rings, *np.stack(rings, axis=1)[points]]


def draw_body(
    axes: Any,
    limits: Limits,
    path: AbstractHodograph,
    times: Float[np.ndarray, " n"],
    centre: Float[np.ndarray, " 2"] | None = None,
) -> None:
    """Draw the balls of the body at the `times` [s] of a path, relative to `centre` (2,) [m].

    On a route that reverses, they are where `clearance` assumes them.
    """
    if limits.body is None:
        return
    shift = np.zeros(2) if centre is None else np.asarray(centre, float)
    instants: Any = np.asarray(times, float)
    centres = np.asarray(centres_at(limits.body, path, instants))
    for row, radius in zip(centres, np.asarray(limits.body.radii, float), strict=True):
        for point in row:
            axes.add_patch(Circle(point[:2] - shift, radius, **BODY))


def _patch(obstacle: Any, shift: Float[np.ndarray, " 2"]) -> Any:
    """Return the area that an obstacle covers, or None."""
    if isinstance(obstacle, ConvexPolygon):
        return Polygon(np.asarray(obstacle.vertices) - shift, **FILL)
    at: Any = None if obstacle.track is None else np.asarray(obstacle.track)[0, :2] - shift
    if isinstance(obstacle, Ball):
        return Circle(at, float(obstacle.radius), **FILL)
    if isinstance(obstacle, Cylinder) and _upright(obstacle):
        return Circle(at, float(obstacle.radius), **FILL)
    if isinstance(obstacle, Ellipsoid):
        values, axes = np.linalg.eigh(np.asarray(obstacle.shape, float)[:2, :2])
        angle = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
        width, height = 2 * np.sqrt(values[::-1])
        return Ellipse(at, width, height, angle=angle, **FILL)
    return None


def _edges(obstacle: Any, shift: Float[np.ndarray, " 2"]) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return points and directions of straight edges."""
    if isinstance(obstacle, HalfSpace):
        normal = np.asarray(obstacle.normal, float)[:2]
        square = normal @ normal
        if square > 0:
            return [(normal * float(obstacle.offset) / square - shift, np.array([-normal[1], normal[0]]))]
    if isinstance(obstacle, Cylinder) and not _upright(obstacle):
        along = np.asarray(obstacle.axis, float)[:2]
        aside = np.array([-along[1], along[0]]) / np.linalg.norm(along) * float(obstacle.radius)
        point = np.asarray(obstacle.point, float)[0, :2] - shift
        return [(point + aside, along), (point - aside, along)]
    return []


def _upright(obstacle: Cylinder) -> bool:
    axis = np.asarray(obstacle.axis, float)
    return bool(np.hypot(*axis[:2]) <= UPRIGHT * abs(axis[2]))
