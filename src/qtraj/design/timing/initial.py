"""Compute the initial iterate of the search for the fastest timing."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from qtraj.design.timing.interior_point import Program
from qtraj.design.timing.road import steady

RANGE, RAMP, SMOOTHED = 1e3, 32, 32
"""In the initial iterate, upper bounds on a are at most `RANGE` times the lowest bound. The function a grows from 0 to
the largest bound in at least 1/`RAMP` of the cells, and is averaged twice over at most 2/`SMOOTHED` of the cells."""


def initial(p: Program) -> Float[Array, " cells+3"]:
    """Return coefficients of the smoothed fastest timing for the upper bounds and the longitudinal acceleration.

    Limits on power and jerk are replaced by upper bounds: the power and the jerk for a constant a.

    Let E be the kinetic energy, and x the path length in units of 2/(largest acceleration). The limits are an upper
    bound on E, and |dE/dx| ≤ 1. So the largest E(x) is the minimum of E(y) + |x − y| over all y.
    """
    c, knots = p.constraints, p.nodes.place[0]
    count = knots.size
    highest, largest = 1 / c.upper[0], p.largest[0]
    if c.jerk is not None:
        # Without any upper bound, a limit on the jerk determines the order of magnitude: a·(a'')² is at most 1.
        steepest = jnp.max(c.jerk[5])
        typical = jnp.where(steepest > 0, jnp.cbrt(float(count) ** 4 / jnp.where(steepest > 0, steepest, 1.0)), jnp.inf)
        highest = jnp.where(jnp.all(highest > 0.5 * largest), jnp.minimum(highest, typical), highest)
        highest = 1 / jnp.maximum(1 / highest, jnp.cbrt(c.jerk[0, 0]))
    if c.road is not None:
        highest = jnp.minimum(highest, steady(c.road)[0])
    highest = jnp.minimum(highest, RANGE * jnp.min(highest))
    pace = jnp.sqrt(functools.reduce(jnp.maximum, (form[2, 0] for form in c.forms), jnp.zeros_like(highest)))
    pace = pace if c.road is None else jnp.maximum(pace, jnp.abs(c.road.along[2, 0]))
    pace = jnp.maximum(pace, 2 * count / RAMP / jnp.max(highest))  # where the acceleration is unlimited
    x = jnp.cumsum(jnp.diff(knots, prepend=knots[:1]) * (pace + jnp.concatenate([pace[:1], pace[:-1]])))
    energy = jnp.where(p.nodes.standing[0] > 0, 0.0, highest * pace**2)
    energy = jnp.minimum(jax.lax.cummin(energy - x) + x, jax.lax.cummin(energy + x, reverse=True) - x)
    a = energy / pace**2
    k = np.arange(count)
    width = np.minimum(np.minimum(k, count - 1 - k), count // SMOOTHED)
    for _ in range(2):  # averaged twice, because after one average the slope of a jumps
        whole = jnp.pad(jnp.cumsum(a), (1, 0))
        a = (whole[k + width + 1] - whole[k - width]) / (2.0 * width + 1.0)
    ends = [(2 * a[k] + a[m]) / 3 for k, m in ((0, 1), (-1, -2))]
    return jnp.concatenate([a[:1], ends[0][None], a[1:-1], ends[1][None], a[-1:]]) * p.nodes.free
