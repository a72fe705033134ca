"""Points of a path at equal fractions of its arc length."""

from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from qtraj.foundation.arrays import as_float
from qtraj.foundation.namespace import in_numpy, matmul, xp
from qtraj.path.hodograph import AbstractHodograph

CELLS = 1024
"""Number of intervals of equal duration between which the arc length is tabulated."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)
NODES, WEIGHTS = (_NODES + 1) / 2, _WEIGHTS / 2
"""Nodes and weights on [0, 1] for the length of a part of an interval."""

NEWTON_STEPS = 3
"""Number of Newton steps for an instant inside an interval; the start is the linear interpolation."""


def equal_arcs(path: AbstractHodograph, count: int) -> Float[Array, "{count}+1 3"]:
    """Return the positions [m] at the fractions 0, 1/count, …, 1 of the arc length of one path, in world axes."""
    return (_points if path.supports_numpy else _compiled_points)(path, tuple(range(count + 1)))


def _positions(path: AbstractHodograph, fractions: tuple[int, ...]) -> Any:
    duration = as_float(path.duration)
    wanted = (np.asarray(fractions) / fractions[-1]).astype(duration.dtype)
    step, weights = duration / CELLS, WEIGHTS.astype(duration.dtype)
    starts = np.arange(CELLS, dtype=duration.dtype) * step
    each = step * matmul(_speeds(path, starts, step * xp.ones_like(starts)), weights)
    before = xp.concatenate([0.0 * each[:1], xp.cumsum(each)])
    rest = before[-1] * wanted
    index = xp.clip(xp.searchsorted(before, rest, side="right") - 1, 0, CELLS - 1)
    start, rest, whole = starts[index], rest - before[index], each[index]
    share = xp.clip(rest / xp.where(whole > 0, whole, 1.0), 0.0, 1.0)
    for _ in range(NEWTON_STEPS):
        reached = step * share * matmul(_speeds(path, start, step * share), weights)
        speed = step * _norm(path.sampled(start + step * share, 1)[1])
        change = (reached - rest) / xp.where(speed > 0, speed, 1.0)
        share = xp.clip(share - xp.where(speed > 0, change, 0.0), 0.0, 1.0)
    return path.sampled(start + step * share, 0)[0]


def _speeds(path: AbstractHodograph, starts: Any, lengths: Any) -> Any:
    """Return the speeds (n, nodes) at the nodes of intervals of time."""
    times = starts[:, None] + lengths[:, None] * NODES.astype(starts.dtype)[None]
    velocities = path.sampled(times.reshape(-1), 1)[1]
    return _norm(velocities).reshape(times.shape)


def _norm(v: Any) -> Any:
    square = (v * v).sum(axis=-1)
    moves = square > 0
    return xp.where(moves, xp.sqrt(xp.where(moves, square, 1.0)), 0.0)


_compiled_points = eqx.filter_jit(_positions)
_points = in_numpy(_positions, _compiled_points)
