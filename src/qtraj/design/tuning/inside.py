"""Problems whose body is inside an obstacle at the start or the end of the path, which cannot move."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.obstacles.clear import Clear
from qtraj.design.tuning.clearances import axes_of, in_world
from qtraj.design.tuning.problem import Problem

DEPTH = 1e-9
"""The smallest depth inside an obstacle that is a fault, as a fraction of the length of the path."""

HEADINGS, PITCHES = 48, 13
"""The numbers of headings and pitches of the body that are tried at an end, over their whole ranges."""

DIRECTIONS = HEADINGS * PITCHES, 3
"""The shape of one point for each direction."""

STEPS = np.pi / HEADINGS + 0.5 * np.pi / (PITCHES - 1)
"""No attitude is farther than this angle [rad] from one that is tried: half a heading and half a pitch."""


def occurs(problem: Problem, xp: Any) -> Any:
    """Return whether the body of each problem is inside an obstacle at an end; `xp` is the module of the arrays."""
    inside = xp.zeros(problem.speed.shape, bool)
    for depths in _depths(problem, xp).values():
        for depth in depths:
            inside = inside | (depth > DEPTH * problem.speed * problem.duration)
    return inside


def message(problem: Problem) -> str:
    """Return the message for one problem whose body is inside an obstacle."""
    name, depths = max(_depths(problem, np).items(), key=lambda item: max(map(float, item[1])))
    where = ("start", "end")[int(np.argmax(depths))]
    own = problem.clearances
    turns = own is not None and own.body is not None and own.body.turns
    return (
        f"at the {where}, whose position is fixed, the body is inside {name}, by {max(map(float, depths)):.4g} m"
        f"{' or more' if turns else ''}: move the {where} or the obstacle"
    )


def _depths(problem: Problem, xp: Any) -> dict[str, list[Any]]:
    """Return lower bounds on how far [m] the body is inside each obstacle at both ends, whatever its direction there.

    An obstacle that moves counts at the start only, whose time is known.
    """
    own, found = problem.clearances, {}
    if own is None:
        return found
    ends = _ends(problem, xp)
    for name, rows in own.obstacles.items():
        balls = [own.by_name[row] for row in rows]
        track = balls[0].track
        point = np.zeros(3) if track is None else np.array([c[0] for c in track])
        positions = [p - xp.broadcast_to(point, p.shape) for p in ends[: 2 if track is None else 1]]
        found[name] = [_depth(balls, p, xp) for p in positions]
    return found


def _depth(balls: list[Clear], position: Any, xp: Any) -> Any:
    """Return a lower bound on the depth [m] of the balls in their obstacle at positions (*batch, 3), in any direction.

    In any direction a ball is at most its offset nearer to the position. If several balls are on different sides of the
    position, the deepest one is deeper than that: many directions are tried, and between them a ball moves by at most
    `STEPS` times its offset.
    """
    away = -balls[0].obstacle.distance(position, 0.0 * position[..., 0])
    lengths = [float(np.linalg.norm(x.offset)) for x in balls]
    least = away + max(x.radius - length for x, length in zip(balls, lengths, strict=True))
    most = away + max(x.radius + length for x, length in zip(balls, lengths, strict=True))
    if not any(lengths):
        return least
    if xp is not np:
        return xp.maximum(least, _in_all_directions(balls, position, lengths, xp))
    found, open_ = np.array(least), (least <= 0) & (most > 0)
    if np.any(open_):
        found[open_] = np.maximum(found[open_], _in_all_directions(balls, position[open_], lengths, np))
    return found


def _in_all_directions(balls: list[Clear], position: Any, lengths: list[float], xp: Any) -> Any:
    """Return the smallest depth of the deepest ball over all directions, less the motion between these."""
    deepest = None
    for x in balls:
        centres = position[..., None, :] + xp.broadcast_to(_turned(x.offset), (*position.shape[:-1], *DIRECTIONS))
        depth = x.radius - x.obstacle.distance(centres, 0.0 * centres[..., 0])
        deepest = depth if deepest is None else xp.maximum(deepest, depth)
    return xp.min(deepest, axis=-1) - STEPS * max(lengths)


def _turned(offset: tuple[float, float, float]) -> Float[np.ndarray, "directions 3"]:
    """Return an offset, in the axes of the upright frame, in the world for all headings and pitches."""
    heading = 2 * np.pi / HEADINGS * np.arange(HEADINGS)[:, None]
    pitch = np.linspace(-0.5 * np.pi, 0.5 * np.pi, PITCHES)
    forward, left, up = offset
    ahead, above = forward * np.cos(pitch) - up * np.sin(pitch), forward * np.sin(pitch) + up * np.cos(pitch)
    x = ahead * np.cos(heading) - left * np.sin(heading)
    y = ahead * np.sin(heading) + left * np.cos(heading)
    return np.stack(np.broadcast_arrays(x, y, above), axis=-1).reshape(DIRECTIONS)


def _ends(problem: Problem, xp: Any) -> list[Any]:
    """Return the positions (*batch, 3) at both ends in world axes."""
    axes = axes_of(problem.placement)
    local = [[x.planar[..., 0], x.planar[..., 1], x.height] for x in (problem.start, problem.end)]
    return [xp.stack(in_world(point, axes), axis=-1) for point in local]
