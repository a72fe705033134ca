"""Obstacles in a search: the constraints that the balls of the body stay clear of them.

The constraint value is half of `occupancy` − 1, so about the depth to which a ball enters the obstacle, divided by the
sum of both radii; for walls it is divided by a part of the length of the path. It is a polynomial of the centre of the
ball, or nearly so, and needs no logarithm.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import jax
import numpy as np

from qtraj.algebra.jets import cos, exp, sin
from qtraj.design.obstacles.body import Body
from qtraj.design.obstacles.clear import Clear, clears
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.foundation.arrays import is_traced
from qtraj.path.clearance_quantity import name_of_obstacle

WALL = 0.1
"""The fraction of the length of the path by which the depth behind a wall is divided."""

STRICTER = 4e-9
"""The constraint value at which a ball touches an obstacle, so that rounding errors cannot move it inside."""


class Clearances:
    """The balls and obstacles of a search by the names of their constraints; equal for equal numbers.

    They are static data of a problem, the same for all problems of a batch.
    """

    def __init__(self, keep_out: Sequence[AbstractObstacle], body: Body | None):
        self.keep_out, self.body = tuple(keep_out), body
        balls = [x._replace(radius=max(x.radius, x.obstacle.rounding)) for x in clears(keep_out, body)]
        self.by_name = {f"{x.name}[{k}]": x for k, x in enumerate(balls)}
        self._key = repr([(x.name, type(x.obstacle), _numbers(x.obstacle), *x[2:]) for x in balls])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Clearances) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def only(self, kept: Collection[str]) -> Clearances | None:
        """Return those of some obstacles, whose names then are different; None without obstacles."""
        keep_out = [x for k, x in enumerate(self.keep_out) if name_of_obstacle(k) in kept]
        return Clearances(keep_out, self.body) if keep_out else None

    @property
    def obstacles(self) -> dict[str, list[str]]:
        """The names of the constraints on each obstacle, by the names of the obstacles."""
        found: dict[str, list[str]] = {}
        for name, x in self.by_name.items():
            found.setdefault(x.name, []).append(name)
        return found


def _numbers(obstacle: Any) -> list[Any]:
    return [np.asarray(x, float).tolist() for x in jax.tree.leaves(obstacle)]


def clearances_of(limits: Any) -> Clearances | None:
    """Return the balls and obstacles of limits, or None without obstacles.

    **Raises:** ValueError for obstacles that are traced.
    """
    if limits.keep_out is None:
        return None
    if is_traced(limits.keep_out, limits.body):
        raise ValueError(
            "tune needs obstacles and a body with concrete values: create them outside jit, grad and vmap. Its results "
            "have no derivatives with respect to them"
        )
    return Clearances(limits.keep_out, limits.body)


def axes_of(placement: Any) -> tuple[Any, ...]:
    """Return the components of the origin and of the three axes of a placement in the world."""
    q = [placement.orientation[..., k] for k in range(4)]
    origin = tuple(placement.origin[..., k] for k in range(3))
    w, x, y, z = q
    square = 1.0 / (w * w + x * x + y * y + z * z)
    two = square + square
    return (
        *origin,
        *(1.0 - two * (y * y + z * z), two * (x * y + w * z), two * (x * z - w * y)),
        *(two * (x * y - w * z), 1.0 - two * (x * x + z * z), two * (y * z + w * x)),
        *(two * (x * z + w * y), two * (y * z - w * x), 1.0 - two * (x * x + y * y)),
    )


def value(name: str, at: Any, by: Any, u: Any) -> Any:
    """Return the constraint value of a ball and an obstacle at the instants `u`; see `constraints.value`."""
    own: Clear = by.clearances.by_name[name]
    position, velocity = _world(at, by.axes, own.offset != (0.0, 0.0, 0.0))
    time = None if own.track is None else u * exp(by.log_duration)
    depth = own.value(position, velocity, time) - 1.0
    return depth * (0.5 / (WALL * by.length) if own.obstacle.occupied_length else 0.5) + STRICTER


def _world(at: Any, axes: tuple[Any, ...], moves: bool) -> tuple[list[Any], list[Any] | None]:
    """Return the components of the position [m], and of its derivative with respect to u if it `moves`."""
    radius, angle, height = at.radius, at.angle, at.height
    c, s = cos(angle[0]), sin(angle[0])
    position = in_world((radius[0] * c, radius[0] * s, height[0]), axes)
    if not moves:
        return position, None
    across = radius[0] * angle[1]
    return position, _rotated((radius[1] * c - across * s, radius[1] * s + across * c, height[1]), axes)


def in_world(point: Sequence[Any], axes: tuple[Any, ...]) -> list[Any]:
    """Return the world coordinates of a point in the axes of the placement."""
    return [x + p for x, p in zip(_rotated(point, axes), axes[:3], strict=True)]


def _rotated(vector: Sequence[Any], axes: tuple[Any, ...]) -> list[Any]:
    x, y, z = vector
    return [x * axes[3 + k] + y * axes[6 + k] + z * axes[9 + k] for k in range(3)]
