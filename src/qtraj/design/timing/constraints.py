"""Limits on a motion r(u(t)) as constraints on the squared path speed a = u̇² and its derivatives in u.

With r', r'', r''' the derivatives of the path in its parameter u,

    velocity      √a r'
    acceleration  a r'' + ½ a' r'
    jerk          √a (a r''' + 3/2 a' r'' + ½ a'' r').

So limits on the speed, the lateral acceleration and rates of rotation bound a itself. Limits on the longitudinal
acceleration and the yaw acceleration are linear in a and a', that on the acceleration is a cone in them. The jerk limit
|√a w| ≤ j, with w linear in a, a' and a'', is convex once 1/√a in |w| ≤ j/√a is replaced by its tangent.
"""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.timing.spline import assembled, assembled_band, local
from qtraj.foundation.types import Scalar
from qtraj.path.frenet import yaw
from qtraj.path.hodograph import AbstractHodograph
from qtraj.path.quantity import QUANTITIES
from qtraj.path.values import invariants_at

UPPER = ("speed", "lateral_acceleration", "yaw_rate", "angular_rate")
"""Limits that bound the squared path speed alone."""

NAMES = (*UPPER, "longitudinal_acceleration", "yaw_acceleration", "acceleration", "jerk")
"""Limits that the timing along a path decides on."""

COUNT = 7
"""Constraints at each node: upper bound, ± longitudinal acceleration, ± yaw acceleration, acceleration, jerk."""

LARGEST = 1e12
"""Bound on a where nothing else bounds it."""


class Constraints(NamedTuple):
    """Constraints g ≤ 0 at all nodes, on the values (a, a', a'') there, derivatives per cell.

    `linear` · (a, a') ≤ 1; |`cone` (a, a')| ≤ 1; √a |`jerk` (a, a', a'')| ≤ 1. What is not limited is zero.
    """

    linear: Float[Array, "5 cells nodes 2"]
    cone: Float[Array, "cells nodes 3 2"]
    jerk: Float[Array, "cells nodes 3 3"]


def constraints(
    path: AbstractHodograph, at: Float[Array, "cells nodes"], per_cell: Scalar, bounds: dict[str, Scalar]
) -> Constraints:
    """The constraints at the parameters `at`; `per_cell` is the parameter's length of a cell; absent bounds are inf."""
    return jax.vmap(jax.vmap(lambda u: _at_one(path, u, per_cell, bounds), 0, 0), 0, 0)(at)._transposed()


class _AtOne(NamedTuple):
    linear: Any
    cone: Any
    jerk: Any

    def _transposed(self) -> Constraints:
        return Constraints(jnp.moveaxis(self.linear, 2, 0), self.cone, self.jerk)


def _at_one(path: AbstractHodograph, u: Scalar, per_cell: Scalar, bounds: dict[str, Scalar]) -> _AtOne:
    r = path.derivatives(u, 3)
    i = invariants_at(path, u, 3)
    inv_speed, inv_level = (jnp.where(x > 0, jnp.where(x > 0, x, 1.0) ** -0.5, 0.0) for x in (i.S, i.H))
    rate, growth = yaw(i, inv_speed, inv_level)
    half = 0.5 / per_cell
    along = jnp.stack([i.B * inv_speed, half / jnp.where(inv_speed > 0, inv_speed, 1.0)])
    turning = jnp.stack([growth, half * rate])
    upper = jnp.stack([upper_coefficient(name, i, bounds[name]) for name in UPPER])
    first = jnp.stack([jnp.maximum(jnp.max(upper), 1 / LARGEST), jnp.zeros_like(half)])
    along, turning = along / bounds["longitudinal_acceleration"], turning / bounds["yaw_acceleration"]
    linear = jnp.stack([first, along, -along, turning, -turning])
    cone = jnp.stack([r[2], half * r[1]], axis=1) / bounds["acceleration"]
    jerk = jnp.stack([r[3], 3 * half * r[2], half / per_cell * r[1]], axis=1) / bounds["jerk"]
    return _AtOne(linear, cone, jerk)


def upper_coefficient(name: str, i: Any, bound: Scalar) -> Scalar:
    """1 over the largest a that this limit allows; the quantity grows with the power `per_time` of √a."""
    entry = QUANTITIES[name]
    square = entry.squared(i) / bound**2
    return square if entry.per_time == 1 else jnp.sqrt(jnp.where(square > 0, square, 0.0) + 1e-300)


def tightened(c: Constraints, factors: Float[Array, "7 cells"]) -> Constraints:
    """The same constraints with their limits divided by `factors`, for each cell."""
    by = factors[:, :, None, None]
    return Constraints(c.linear * by[:5], c.cone * by[5][..., None], c.jerk * by[6][..., None])


def used(c: Constraints, v: Float[Array, "cells nodes 3"]) -> Float[Array, "7 cells nodes"]:
    """How much of each limit is used: 1 where it is reached."""
    g = values(c, v)
    return jnp.concatenate([g[:5] + 1, jnp.sqrt(jnp.maximum(g[5:] + 1, 0.0))])


def at_nodes(basis: Array, coefficients: Array) -> Float[Array, "cells nodes 3"]:
    """a and its derivatives per cell at the nodes."""
    return jnp.sum(basis * local(coefficients)[:, None, None, :], axis=-1)


def values(c: Constraints, v: Float[Array, "cells nodes 3"]) -> Float[Array, "7 cells nodes"]:
    """g at all nodes."""
    linear = jnp.sum(c.linear * v[..., :2], axis=-1) - 1
    y, w = _vectors(c, v)
    return jnp.concatenate([linear, jnp.stack([jnp.sum(y * y, -1) - 1, v[..., 0] * jnp.sum(w * w, -1) - 1])])


def _vectors(c: Constraints, v: Array) -> tuple[Array, Array]:
    return jnp.sum(c.cone * v[..., None, :2], axis=-1), jnp.sum(c.jerk * v[..., None, :], axis=-1)


def gradients(c: Constraints, v: Float[Array, "cells nodes 3"]) -> Float[Array, "7 cells nodes 3"]:
    """Those of g in (a, a', a'')."""
    y, w = _vectors(c, v)
    cone = 2 * jnp.sum(c.cone * y[..., None], axis=-2)
    jerk = 2 * v[..., :1] * jnp.sum(c.jerk * w[..., None], axis=-2)
    jerk = jerk.at[..., 0].add(jnp.sum(w * w, -1))
    rows = [jnp.pad(c.linear, [(0, 0)] * 3 + [(0, 1)]), jnp.pad(cone, [(0, 0)] * 2 + [(0, 1)])[None], jerk[None]]
    return jnp.concatenate(rows)


def curvature(
    c: Constraints, v: Float[Array, "cells nodes 3"], multipliers: Float[Array, "7 cells nodes"]
) -> Float[Array, "cells nodes 3 3"]:
    """Second derivatives of the convex model of g, weighed by the multipliers.

    That of the jerk constraint is 2∇yᵀ∇y with y = √a w: the tangent of 1/√a makes just this of it.
    """
    cone = 2 * jnp.sum(c.cone[..., :, None] * c.cone[..., None, :], axis=-3)
    _, w = _vectors(c, v)
    slope = c.jerk.at[..., 0].add(w / (2 * v[..., :1]))
    jerk = 2 * v[..., :1, None] * jnp.sum(slope[..., :, None] * slope[..., None, :], axis=-3)
    return jnp.pad(multipliers[5][..., None, None] * cone, [(0, 0)] * 2 + [(0, 1)] * 2) + (
        multipliers[6][..., None, None] * jerk
    )


def gathered(basis: Array, parts: Float[Array, "cells nodes 3"]) -> Float[Array, "cells+3"]:
    """What derivatives in the values at the nodes are as derivatives in the coefficients."""
    return assembled(jnp.sum(basis * parts[..., None], axis=(1, 2)))


def gathered_band(basis: Array, parts: Float[Array, "cells nodes 3 3"]) -> Float[Array, "4 cells+3"]:
    """The same of second derivatives, a band matrix."""
    inner = jnp.sum(parts[..., :, :, None] * basis[:, :, None], axis=-2)  # (cells, nodes, 3, 4)
    cells = jnp.sum(basis[..., :, None] * inner[..., None, :], axis=(1, 2))
    return assembled_band(cells)
