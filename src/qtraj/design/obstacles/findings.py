"""Findings on obstacles for one path, and for batches and tracers of spiral-helices."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np

from qtraj.design.obstacles.body import POINT, Body
from qtraj.design.obstacles.keep_out import clearances_at
from qtraj.design.obstacles.obstacle import AbstractObstacle
from qtraj.design.obstacles.proof import judged
from qtraj.design.obstacles.route_pieces import route_pieces
from qtraj.design.obstacles.turning_pieces import turning_pieces
from qtraj.design.on_host import host_callback
from qtraj.design.proof.certificate import BROKEN, SAMPLED, UNDEFINED
from qtraj.design.proof.findings import Findings
from qtraj.design.proof.maxima import find_maxima
from qtraj.design.proof.route_segments import RANK
from qtraj.foundation.arrays import constants, is_traced
from qtraj.path.clearance_quantity import name_of_obstacle
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.route import Route
from qtraj.path.spiral_helix import SpiralHelix

GRID = np.linspace(0.0, 1.0, 2049)
"""The fractions of the duration at which a path that is not polynomial is sampled."""

Obstacles = Sequence[AbstractObstacle]


def pieces_of(path: AbstractHodograph, obstacles: Obstacles, body: Body | None) -> Any:
    """Return the pieces of one path with concrete values, or None if it is not polynomial."""
    turns = body is not None and body.turns
    if isinstance(path, Route):
        return route_pieces(path, any(x.moves for x in obstacles), turns)
    return turning_pieces(path, turns)


def whole(parts: Findings) -> Findings:
    """Return the worst finding on each obstacle (obstacles,) from those on pieces (pieces, obstacles)."""
    rank = RANK[parts.codes]
    own = np.where(rank == rank.max(axis=0), parts.values, np.inf)
    row, column = np.argmin(own, axis=0), np.arange(parts.codes.shape[1])
    return Findings(*(x[row, column] for x in parts))


def on_path(path: AbstractHodograph, obstacles: Obstacles, body: Body | None) -> Findings:
    """Return the findings (obstacles,) on one path with concrete values."""
    pieces = pieces_of(path, obstacles, body)
    return sampled(path, obstacles, body) if pieces is None else whole(judged(pieces, obstacles, body or POINT))


def on_helices(path: SpiralHelix, obstacles: Obstacles, body: Body | None) -> Findings:
    """Return the findings (*batch, obstacles) on spiral-helices; their values are differentiable.

    In a trace, they are computed on the host. A path that is not finite has undefined clearances.
    """
    leaves, structure = jax.tree.flatten(constants(path))
    ranks = [np.ndim(x) for x in jax.tree.leaves(_core(path))]
    shape, count = np.shape(path.duration), len(obstacles)

    def on_host(*given: Any) -> Findings:
        arrays = [np.asarray(x, float) for x in given]
        batch = arrays[0].shape[: arrays[0].ndim - ranks[0]]
        flat = [x.reshape(math.prod(batch), *x.shape[len(batch) :]) for x in arrays]
        rows = [_on_finite([x[k] for x in flat], structure, obstacles, body) for k in range(math.prod(batch))]
        kinds = (np.int32, float, float)
        return Findings(
            *(np.array([row[k] for row in rows], kind).reshape(*batch, count) for k, kind in enumerate(kinds))
        )

    if not is_traced(leaves):
        codes, times, values = on_host(*leaves)
    else:
        float_ = jnp.result_type(float)
        kinds: list[Any] = [jax.ShapeDtypeStruct((*shape, count), x) for x in (np.int32, float_, float_)]
        codes, times, values = host_callback(on_host, Findings(*kinds), *map(jnp.asarray, leaves))
    if is_traced(path):
        values = _differentiable(path, jnp.asarray(times), obstacles, body)
    return Findings(codes, times, values)


def _core(path: SpiralHelix) -> SpiralHelix:
    """Return one path of a batch, to count the axes of its arrays."""
    return jax.tree.map(lambda x: np.zeros(x.shape[np.ndim(path.duration) :]), path)


def _on_finite(arrays: list[np.ndarray], structure: Any, obstacles: Obstacles, body: Body | None) -> Findings:
    if not all(np.isfinite(x).all() for x in arrays[:-1]):  # the mismatch, the last one, may be infinite
        nothing = np.full(len(obstacles), np.nan)
        return Findings(np.full(len(obstacles), UNDEFINED, np.int32), nothing, nothing)
    return on_path(jax.tree.unflatten(structure, arrays), obstacles, body)


@eqx.filter_jit
def _differentiable(path: SpiralHelix, times: Any, obstacles: Obstacles, body: Body | None) -> Any:
    """Return the clearances (*batch, obstacles) at the times of the smallest ones (envelope theorem)."""

    def one(path: SpiralHelix, times: Any) -> Any:
        each = [clearances_at([x], body, path, times[k])[name_of_obstacle(0)] for k, x in enumerate(obstacles)]
        return jnp.stack(each)

    function = one
    for _ in range(np.ndim(path.duration)):
        function = jax.vmap(function)
    return function(path, times)


def sampled(path: AbstractHodograph, obstacles: Obstacles, body: Body | None) -> Findings:
    """Return the findings on a path that is not polynomial, by refined sampling."""
    duration = float(np.asarray(path.duration))
    codes, times, values = [], [], []
    for obstacle in obstacles:

        def clearances(u: np.ndarray, obstacle: Any = obstacle) -> np.ndarray:
            t = np.clip(np.asarray(u, float), 0.0, 1.0) * duration
            found = clearances_at([obstacle], body, path, t.ravel())
            return -np.asarray(found[name_of_obstacle(0)], float).reshape(t.shape)

        at, value = find_maxima(clearances, GRID, clearances(GRID[:, None]))
        value = -value[0]
        codes.append(SAMPLED if value >= 0 else BROKEN)
        times.append(float(np.clip(at[0], 0.0, 1.0)) * duration)
        values.append(value)
    return Findings(np.array(codes, np.int32), np.array(times), np.array(values))
