"""Compute the initial iterate of the search for the fastest timing."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.timing.program import Program
from qtraj.design.timing.road import steady
from qtraj.design.timing.seam import repeated

RANGE, RAMP, SMOOTHED = 1e3, 32, 32
"""In the initial iterate, upper bounds on a = u̇² are at most `RANGE` times the lowest bound. The function a grows from
0 to the largest bound in at least 1/`RAMP` of the cells, and is averaged twice over at most 2/`SMOOTHED` of the cells.
"""


def initial(p: Program) -> Float[Any, "batch cells+3"]:
    """Return coefficients of the smoothed fastest timing for the upper bounds on a = u̇² and bounds on |a'| = |da/du|.

    Limits on power and jerk are replaced by the upper bounds on a that they imply for a constant a.

    Let `pace`·|a'| ≤ 1 be the bound on |a'|, E = a·pace², and x = 2∫pace du. The bound on |a'| is |dE/dx| ≤ 1/2, but
    the iterate need only satisfy |dE/dx| ≤ 1. So the largest E(x) is the minimum over all y of E_max(y) + |x − y|,
    where E_max is the upper bound on E.
    """
    c, knots = p.constraints, p.nodes.place[0]
    count = knots.size
    highest, largest = 1 / c.upper[:, 0], p.largest[:, 0]
    if c.jerk is not None:
        # Without any upper bound, a limit on the jerk determines the order of magnitude: a·(a'')²·c.jerk[:, 2, 2] ≤ 1.
        steepest = c.jerk[:, 2, 2].max(axis=(0, 2, 3))[:, None]
        typical = np.where(steepest > 0, np.cbrt(float(count) ** 4 / np.where(steepest > 0, steepest, 1.0)), np.inf)
        free = np.all(highest > 0.5 * largest, axis=1)[:, None]
        highest = np.where(free, np.minimum(highest, typical), highest)
        highest = 1 / np.maximum(1 / highest, np.cbrt(c.jerk[:, 0, 0, :, 0].max(axis=0)))
    if c.road is not None:
        highest = np.minimum(highest, steady(c.road)[:, 0])
    most = np.minimum(RANGE * highest.min(axis=1), largest.min(axis=1))  # finite at stops, too
    highest = np.minimum(highest, most[:, None])
    pace = np.sqrt(np.max(c.forms[:, 1, 1, :, 0], axis=0, initial=0.0))
    pace = np.maximum(pace, np.max(np.abs(c.sides[:, 2, :, 0]), axis=0, initial=0.0))
    if c.combined is not None:
        pace = np.maximum(pace, np.abs(c.combined.along[1] / c.combined.accelerating.start)[:, 0])
    pace = pace if c.road is None else np.maximum(pace, np.abs(c.road.along[2, :, 0]))
    # The least value matters where the acceleration is unlimited.
    pace = np.maximum(pace, 2 * count / RAMP / highest.max(axis=1, keepdims=True))
    standing, width = np.broadcast_to(p.nodes.standing[0] > 0, pace.shape), count // SMOOTHED
    if p.nodes.seam:  # a lap between two others
        laps = np.concatenate([knots[:-1] + k * (knots[-1] - knots[0]) for k in range(3)])
        highest, pace, standing = (np.tile(x[:, :-1], 3) for x in (highest, pace, standing))
        a = _reachable(laps, highest, pace, standing, width)
        own = a[:, count - 2 : 2 * count]
        return repeated(own, 1.0)
    a = _reachable(knots, highest, pace, standing, width)
    ends = [(2 * a[:, [i]] + a[:, [m]]) / 3 for i, m in ((0, 1), (-1, -2))]
    return np.concatenate([a[:, :1], ends[0], a[:, 1:-1], ends[1], a[:, -1:]], axis=1) * p.nodes.free


def _reachable(
    knots: Float[Any, " knots"],
    highest: Float[Any, "batch knots"],
    pace: Float[Any, "batch knots"],
    standing: Bool[Any, "batch knots"],
    widest: int,
) -> Float[Any, "batch knots"]:
    """Return the largest a = u̇² below `highest` whose slope satisfies the bound, averaged over `widest` knots."""
    steps = np.diff(knots, prepend=knots[:1])
    x = np.cumsum(steps * (pace + np.concatenate([pace[:, :1], pace[:, :-1]], axis=1)), axis=1)
    energy = np.where(standing, 0.0, highest * pace**2)
    rising = np.minimum.accumulate(energy - x, axis=1) + x
    falling = np.minimum.accumulate((energy + x)[:, ::-1], axis=1)[:, ::-1] - x
    a = np.minimum(rising, falling) / pace**2
    k = np.arange(knots.size)
    width = np.minimum(np.minimum(k, knots.size - 1 - k), widest)
    for _ in range(2):  # averaged twice: one moving average leaves jumps in da/du
        whole = np.concatenate([np.zeros_like(a[:, :1]), np.cumsum(a, axis=1)], axis=1)
        a = (whole[:, k + width + 1] - whole[:, k - width]) / (2.0 * width + 1.0)
    return a
