"""The obstacles of `Limits`, and the clearances of a body from them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.obstacles.body import POINT, Body
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.foundation.argument import described
from qtraj.foundation.arrays import is_traced
from qtraj.foundation.namespace import xp
from qtraj.path.clearance_quantity import name_of_obstacle
from qtraj.path.driving import Driving
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.trihedral import trihedral

EXAMPLE = "keep_out=[Ball([10.0, 0.0, 0.0], 2.0)]"


def obstacles_of(given: Sequence[Any] | None, body: Body | None) -> tuple[AbstractObstacle, ...] | None:
    """Return the obstacles as a tuple, or None without any.

    **Raises:** TypeError for anything but obstacles, and ValueError for a body without obstacles.
    """
    if isinstance(given, AbstractObstacle) or not (given is None or isinstance(given, Sequence)):
        raise TypeError(f"keep_out must be a list of obstacles, such as {EXAMPLE}, but {described(given)} was given")
    for k, x in enumerate(given or ()):
        if not isinstance(x, AbstractObstacle):
            raise TypeError(
                f"keep_out[{k}] must be a Ball, Cylinder, Ellipsoid, HalfSpace or ConvexPolygon, but {described(x)} "
                "was given"
            )
    if body is not None and not given:
        raise ValueError(f"a body was given without obstacles: also pass {EXAMPLE}, or omit body")
    return tuple(given) if given else None


def checked(limits: Any) -> Any:
    """Return `limits` with obstacles and a body in NumPy, made again, so that numbers that were traced are checked.

    **Raises:** ValueError as when they are made.
    """
    if limits.keep_out is None or is_traced(limits):
        return limits
    own: Any = limits.body
    body = None if own is None else Body(np.asarray(own.offsets, float), np.asarray(own.radii, float))
    obstacles = tuple(x.checked() for x in limits.keep_out)
    return eqx.tree_at(lambda x: (x.keep_out, x.body), limits, (obstacles, body), is_leaf=lambda x: x is None)


def clearances_at(
    obstacles: Sequence[AbstractObstacle], body: Body | None, path: AbstractHodograph, t: Any
) -> dict[str, Float[Array, "*n"]]:
    """Return the clearances [m] at the instants t () or (n,) [s] of one path, by the names of the obstacles."""
    own = POINT if body is None else body
    centres = centres_at(own, path, t)
    found = {}
    for k, obstacle in enumerate(obstacles):
        distance = obstacle.distance(centres, xp.broadcast_to(xp.asarray(t), centres.shape[:-1]))
        radii = own.radii.reshape(-1, *(1,) * np.ndim(t))
        found[name_of_obstacle(k)] = xp.min(distance - xp.broadcast_to(radii, distance.shape), axis=0)
    return found


def centres_at(body: Body, path: AbstractHodograph, t: Any) -> Float[Array, "m *n 3"]:
    """Return the centres [m] of the balls at the instants t () or (n,) [s] of one path, in reverse, too."""
    position, velocity = rows(path, t)
    return body.centres(position, _with_directions(body, path, t, velocity), _signs(body, path, t))


def rows(path: AbstractHodograph, t: Any) -> Any:
    """Return the positions and velocities (..., 3) at the instants t () or (n,) [s]."""
    if not np.ndim(t):
        return path.derivatives(t, 1)
    if is_traced(path, t) or path.supports_numpy:
        return path.sampled(t, 1)
    return [np.asarray(x) for x in _compiled(path, jnp.asarray(t))]


_compiled = eqx.filter_jit(lambda path, t: path.sampled(t, 1))


def refuse_obstacles(limits: Any, what: str, instead: str) -> None:
    """Raise a ValueError if `limits` contain obstacles, which `what` does not support."""
    if limits.keep_out is not None:
        raise ValueError(f"{what} does not support obstacles (keep_out): {instead}")


def _signs(body: Body, path: AbstractHodograph, t: Any) -> Any:
    """Return −1 where a vehicle on a route reverses, and 1 elsewhere."""
    ones = 1.0 + 0.0 * xp.asarray(t)
    if is_traced(path, t, body) or not body.turns or path.driven() is None:
        return ones
    frame = Driving.along(path)
    row = np.maximum(np.searchsorted(np.asarray(frame.starts, float), np.asarray(t, float), side="right") - 1, 0)
    return np.where(np.asarray(frame.signs)[row] < 0, -1.0, 1.0)


def _with_directions(body: Body, path: AbstractHodograph, t: Any, velocity: Any) -> Any:
    """Return the velocities (..., 3), with the forward axis of a vehicle on a route in place of zeros."""
    if is_traced(path, t, body) or not body.turns or path.driven() is None:
        return velocity
    still = ~np.asarray(velocity).any(axis=-1)
    if not still.any():
        return velocity
    found, frame = np.array(velocity), Driving.along(path)
    for k in np.argwhere(still):
        found[tuple(k)] = np.asarray(trihedral(path, np.asarray(t)[tuple(k)], frame).tangent)
    return found * 1.0
