"""Boundary states of a batch in cylindrical components, and back: in NumPy for concrete values, otherwise in JAX."""

from typing import Any

import numpy as np

from qtraj.foundation.namespace import xp
from qtraj.path.boundary import BoundaryState, Cylindrical
from qtraj.path.boundary_problem import AZIMUTH_TOLERANCE


def cylindrical(position: Any, velocity: Any, origin: Any, orientation: Any, xp: Any) -> Cylindrical:
    """Convert positions and velocities (*batch, 3) in world axes to cylindrical components about the axis."""
    x, y, z = _components(_rotated(orientation, position - origin, -1, xp))
    radius = xp.hypot(x, y)
    on_axis = radius == 0
    safe = xp.where(on_axis, 1.0, radius)
    # On the axis the radial direction is undefined. A fixed direction keeps the values finite.
    cos, sin = xp.where(on_axis, 1.0, x / safe), xp.where(on_axis, 0.0, y / safe)
    a, b, c = _components(_rotated(orientation, velocity, -1, xp))
    largest = xp.maximum(abs(position).max(axis=-1), abs(origin).max(axis=-1))
    return Cylindrical(
        radius=radius,
        azimuth=xp.arctan2(sin, cos),
        height=z,
        velocity=xp.stack([a * cos + b * sin, b * cos - a * sin, c], axis=-1),
        acceleration=None,
        planar=xp.stack([x, y, xp.zeros_like(x)], axis=-1),
        rounding=np.finfo(np.float64).eps * (1 + largest / safe),
    )


def in_world(state: Cylindrical, components: tuple[Any, Any, Any], orientation: Any, xp: Any) -> Any:
    """Return the velocity (*batch, 3) in world axes with the given cylindrical components at a boundary state."""
    radial, angular, up = components
    cos, sin = (state.planar[..., k] / state.radius for k in range(2))
    up = xp.broadcast_to(up, cos.shape)
    local = xp.stack([radial * cos - angular * sin, radial * sin + angular * cos, up], axis=-1)
    return _rotated(orientation, local, 1, xp)


def local(vectors: Any, placement: Any, are_points: bool = True) -> Any:
    """Return points or directions (*batch, n, 3) in world axes in the axes of a placement."""
    origin = placement.origin[..., None, :] if are_points else 0.0
    return _rotated(placement.orientation[..., None, :], vectors - origin, -1, xp)


def vertical(orientation: Any, xp: Any) -> Any:
    """Return the world's z axis (*batch, 3) in the axes of the placement."""
    return _rotated(orientation, xp.zeros_like(orientation[..., :3]) + np.array([0.0, 0.0, 1.0]), -1, xp)


def signed_turn(a: Cylindrical, b: Cylindrical, turns: int, turn: Any, xp: Any) -> Any:
    """Return the signed turn [rad] from `a` to `b`.

    Without the user's `turn`, its sense is the sense of V_φ at `a`, and its magnitude is an angle in [0, 2π) plus whole
    `turns`. Otherwise it is the turn closest to the user's that leads to the azimuth of `b`.
    """
    p, q = a.planar, b.planar
    short = xp.arctan2(p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0], (p * q).sum(axis=-1))
    short = xp.where(short <= -np.pi, -short, short)
    if turn is not None:
        return short + 2 * np.pi * xp.round((turn - short) / (2 * np.pi))
    sense = xp.where(a.velocity[..., 1] < 0, -1.0, 1.0)
    ahead = sense * short
    equal = abs(ahead) <= AZIMUTH_TOLERANCE * (a.rounding + b.rounding)
    ahead = xp.where(equal, 0.0 * ahead, xp.where(ahead < 0, ahead + 2 * np.pi, ahead))
    return sense * (ahead + 2 * np.pi * turns)


def at(state: BoundaryState, velocity: Any) -> BoundaryState:
    """Return a boundary state with another velocity."""
    changed = object.__new__(BoundaryState)
    for name, value in (("position", state.position), ("velocity", velocity), ("acceleration", None)):
        object.__setattr__(changed, name, value)
    return changed


def _components(v: Any) -> tuple[Any, Any, Any]:
    return v[..., 0], v[..., 1], v[..., 2]


def _rotated(q: Any, v: Any, sense: int, xp: Any) -> Any:
    """Return the vectors `v` rotated by the quaternions `q`, or backwards if `sense` is −1."""
    scale = abs(q).max(axis=-1, keepdims=True)
    q = q / xp.where(scale > 0, scale, 1.0)
    s, u = q[..., :1], sense * q[..., 1:]
    return v + 2 * xp.cross(u, s * v + xp.cross(u, v)) / (q * q).sum(axis=-1, keepdims=True)
