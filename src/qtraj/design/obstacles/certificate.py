"""Add the findings on obstacles to the certificate of a path."""

from __future__ import annotations

from typing import Any

import jax.numpy as jnp
import numpy as np

from qtraj.design.limits import Limits
from qtraj.design.obstacles.body import POINT
from qtraj.design.obstacles.findings import on_helices, on_path, pieces_of, sampled, whole
from qtraj.design.obstacles.intervals import intervals
from qtraj.design.obstacles.keep_out import checked
from qtraj.design.obstacles.proof import judged
from qtraj.design.proof.certificate import Certificate
from qtraj.design.proof.findings import Findings
from qtraj.design.proof.route_certificate import RouteCertificate
from qtraj.design.timing.timing import RetimedPath
from qtraj.foundation.arrays import is_traced
from qtraj.path.clearance_quantity import name_of_obstacle
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.shape import Shape
from qtraj.path.spiral_helix import SpiralHelix


def with_obstacles(found: Any, path: AbstractHodograph | Shape, limits: Limits) -> Any:
    """Return the certificate with a finding for each obstacle of `limits`; unchanged without obstacles.

    **Raises:** ValueError for obstacles that are traced, for a batch or a tracer of a path that is not a spiral-helix,
    and for obstacles that move and a path without times.
    """
    if limits.keep_out is None:
        return found
    is_helix = isinstance(path, SpiralHelix)
    if is_traced(limits.keep_out, limits.body) or (is_traced(path) and not is_helix):
        raise ValueError(
            "certify with obstacles needs concrete values, except for the path if it is a SpiralHelix: call it outside "
            "jit, grad and vmap. qtraj.clearance is differentiable"
        )
    limits = checked(limits)
    obstacles: Any = limits.keep_out
    body = limits.body
    if is_helix:
        return _joined(found, on_helices(path, obstacles, body))
    own: Any = path.route if isinstance(path, Shape) else path
    if own.duration.ndim:
        raise ValueError(
            "certify with obstacles accepts a batch only of SpiralHelix: call it once for each path of the batch"
        )
    moves = any(x.moves for x in obstacles)
    if moves and isinstance(path, Shape):
        raise ValueError("a shape has no times, so obstacles that move cannot be checked: certify its timing instead")
    if isinstance(path, RetimedPath):
        if not moves and (pieces := pieces_of(path.path, obstacles, body)) is not None:
            worst = whole(judged(pieces, obstacles, body or POINT))
            return _joined(found, worst._replace(times=np.asarray(path.timing.times_of(worst.times))))
        return _joined(found, sampled(path, obstacles, body))
    if not isinstance(own, Route):
        return _joined(found, on_path(own, obstacles, body))
    pieces = pieces_of(own, obstacles, body)
    parts = judged(pieces, obstacles, body or POINT)
    if not isinstance(found, RouteCertificate):
        return _joined(found, whole(parts))
    count = len(found.names)
    broken = [(count + j, x) for j, x in intervals(pieces, parts, obstacles, body or POINT)]
    return RouteCertificate(
        _joined(found.whole, whole(parts)),
        _joined(found.segments, parts),
        found.starts,
        np.concatenate([np.asarray(found.broken), np.reshape([x for _, x in broken], (-1, 2))]),
        np.append(np.asarray(found.broken_limits), [j for j, _ in broken]),
    )


def _joined(found: Certificate, own: Findings) -> Certificate:
    names = tuple(name_of_obstacle(k) for k in range(own.codes.shape[-1]))
    columns = (*own, np.zeros(own.codes.shape))
    xp: Any = jnp if is_traced(found, columns) else np
    pairs = zip((found.codes, found.times, found.values, found.limits), columns, strict=True)
    return Certificate(
        (*found.names, *names), *(xp.concatenate([xp.asarray(a), xp.asarray(b)], axis=-1) for a, b in pairs)
    )
