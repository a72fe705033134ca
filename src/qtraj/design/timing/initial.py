"""Compute the initial iterate of the search for the fastest timing."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.timing.interior_point import Program
from qtraj.design.timing.road import steady

RANGE, RAMP, SMOOTHED = 1e3, 32, 32
"""In the initial iterate, upper bounds on a = u̇² are at most `RANGE` times the lowest bound. The function a grows from
0 to the largest bound in at least 1/`RAMP` of the cells, and is averaged twice over at most 2/`SMOOTHED` of the cells.
"""


def initial(p: Program) -> Float[Array, " cells+3"]:
    """Return coefficients of the smoothed fastest timing for the upper bounds on a = u̇² and bounds on |a'| = |da/du|.

    Limits on power and jerk are replaced by the upper bounds on a that they imply for a constant a.

    Let `pace`·|a'| ≤ 1 be the bound on |a'|, E = a·pace², and x = 2∫pace du. The bound on |a'| is |dE/dx| ≤ 1/2, but
    the iterate need only satisfy |dE/dx| ≤ 1. So the largest E(x) is the minimum over all y of E_max(y) + |x − y|,
    where E_max is the upper bound on E.
    """
    c, knots = p.constraints, p.nodes.place[0]
    count = knots.size
    highest, largest = 1 / c.upper[0], p.largest[0]
    if c.jerk is not None:
        # Without any upper bound, a limit on the jerk determines the order of magnitude: a·(a'')²·c.jerk[5] ≤ 1.
        steepest = jnp.max(c.jerk[5])
        typical = jnp.where(steepest > 0, jnp.cbrt(float(count) ** 4 / jnp.where(steepest > 0, steepest, 1.0)), jnp.inf)
        highest = jnp.where(jnp.all(highest > 0.5 * largest), jnp.minimum(highest, typical), highest)
        highest = 1 / jnp.maximum(1 / highest, jnp.cbrt(c.jerk[0, 0]))
    if c.road is not None:
        highest = jnp.minimum(highest, steady(c.road)[0])
    highest = jnp.minimum(highest, jnp.minimum(RANGE * jnp.min(highest), jnp.min(largest)))  # finite at stops, too
    pace = jnp.sqrt(functools.reduce(jnp.maximum, (form[2, 0] for form in c.forms), jnp.zeros_like(highest)))
    pace = pace if c.road is None else jnp.maximum(pace, jnp.abs(c.road.along[2, 0]))
    pace = jnp.maximum(pace, 2 * count / RAMP / jnp.max(highest))  # where the acceleration is unlimited
    x = jnp.cumsum(jnp.diff(knots, prepend=knots[:1]) * (pace + jnp.concatenate([pace[:1], pace[:-1]])))
    energy = jnp.where(p.nodes.standing[0] > 0, 0.0, highest * pace**2)
    energy = jnp.minimum(jax.lax.cummin(energy - x) + x, jax.lax.cummin(energy + x, reverse=True) - x)
    a = energy / pace**2
    k = np.arange(count)
    width = np.minimum(np.minimum(k, count - 1 - k), count // SMOOTHED)
    for _ in range(2):  # averaged twice: one moving average leaves jumps in da/du
        whole = jnp.pad(jnp.cumsum(a), (1, 0))
        a = (whole[k + width + 1] - whole[k - width]) / (2.0 * width + 1.0)
    ends = [(2 * a[k] + a[m]) / 3 for k, m in ((0, 1), (-1, -2))]
    return jnp.concatenate([a[:1], ends[0][None], a[1:-1], ends[1][None], a[-1:]]) * p.nodes.free
