"""Limits on a motion r(u(t)) as constraints on the squared path speed a = u̇² and its derivatives in u.

With r', r'', r''' the derivatives of the path in its parameter u,

    velocity      √a r'
    acceleration  a r'' + ½ a' r'
    jerk          √a (a r''' + 3/2 a' r'' + ½ a'' r').

So limits on the speed, the lateral acceleration and the rates of rotation are upper bounds on a. The squares of the
longitudinal acceleration, of the yaw acceleration and of the acceleration are convex quadratic forms in (a, a'). The
square of the jerk is a·Q with a quadratic form Q in (a, a', a''); √Q ≤ jerk/√a becomes convex if 1/√a is replaced by
its tangent.

The nodes are on the last axis of all arrays. A form is stored by its coefficients of (aa, ab, bb) or (aa, ab, bb, ac,
bc, cc), where b = a' and c = a''.
"""

from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.foundation.types import Scalar
from qtraj.path.components import dot
from qtraj.path.frenet import Invariants, yaw
from qtraj.path.quantity import QUANTITIES

UPPER = ("speed", "lateral_acceleration", "yaw_rate", "angular_rate")
"""Limits that are upper bounds on the squared path speed."""

FORMS = ("longitudinal_acceleration", "yaw_acceleration", "acceleration")
"""Limits whose squares are quadratic forms in a and a'."""

NAMES = (*UPPER, *FORMS, "jerk")
"""Limits that depend on the timing, in the order of all arrays."""

COUNT = 2 + len(FORMS)
"""Constraints at each node: one upper bound, the forms, and the jerk."""

STANDING = 1e-8
"""|r'| below this fraction of its maximum is zero to rounding."""

LARGEST = 1e12
"""Bound on a where no limit bounds it."""


class Constraints(NamedTuple):
    """Constraints at all nodes on the values v = (a, a', a'') there: a·`upper` ≤ 1, `forms`(v) ≤ 1, a·`jerk`(v) ≤ 1.

    The coefficients of absent limits are zero.
    """

    upper: Float[Array, " nodes"]
    forms: Float[Array, "3 3 nodes"]
    jerk: Float[Array, "6 nodes"]


class Parts(NamedTuple):
    """The constraints before the upper bounds of several limits are combined: one row of `upper` for each limit."""

    upper: Float[Array, "4 nodes"]
    forms: Float[Array, "3 3 nodes"]
    jerk: Float[Array, "6 nodes"]

    def constraints(self) -> Constraints:
        """The constraints with only the lowest upper bound on a at each node."""
        return Constraints(jnp.maximum(jnp.max(self.upper, axis=0), 1 / LARGEST), self.forms, self.jerk)


def parts(r: Float[Array, "3 3 nodes"], unit: Scalar, bounds: dict[str, Scalar]) -> Parts:
    """The constraints, from r', r'' and r''' at the nodes.

    Derivatives of a are with respect to the parameter divided by `unit`. The bounds of absent limits are infinite.
    """
    r1, r2, r3 = (tuple(x) for x in r)
    square = dot(r1, r1)
    moving = square > STANDING**2 * jnp.max(square)
    # Where r' = 0, use the direction of r'', in which the path starts to move.
    ahead = tuple(jnp.where(moving, p, q) for p, q in zip(r1, r2, strict=True))
    i = Invariants([None, r1, r2, r3])
    inv_speed, inv_level, inv_ahead = (
        _inverse_root(x) for x in (jnp.where(moving, i.S, 0.0), jnp.where(moving, i.H, 0.0), dot(ahead, ahead))
    )
    rate, growth = yaw(i, inv_speed, inv_level)
    half = 0.5 / unit
    along = dot(ahead, r2) * inv_ahead, half * jnp.sqrt(i.S)
    turning = growth, half * rate
    whole = i.A, half * i.B, half * half * i.S
    forms = [jnp.stack([p * p, p * q, q * q]) for p, q in (along, turning)] + [jnp.stack(whole)]
    scaled = [form / bounds[name] ** 2 for name, form in zip(FORMS, forms, strict=True)]
    second = half / unit
    jerk = (i.J, 3 * half * dot(r2, r3), 9 * half * half * i.A, second * i.C, 3 * half * second * i.B, second**2 * i.S)
    upper = [_upper(name, i, bounds[name], moving) for name in UPPER]
    return Parts(jnp.stack(upper), jnp.stack(scaled), jnp.stack(jerk) / bounds["jerk"] ** 2)


def _upper(name: str, i: Any, bound: Scalar, moving: Array) -> Array:
    """1 divided by the largest a that satisfies the limit; the quantity is proportional to √a^`per_time`."""
    entry = QUANTITIES[name]
    square = jnp.where(moving, entry.squared(i), 0.0) / bound**2
    if entry.per_time == 1:
        return square
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _inverse_root(x: Array) -> Array:
    return jnp.where(x > 0, jnp.where(x > 0, x, 1.0) ** -0.5, 0.0)


def tightened(c: Constraints, factors: Float[Array, "5 nodes"]) -> Constraints:
    """The same constraints with their limits divided by `factors`."""
    return Constraints(c.upper * factors[0], c.forms * factors[1:-1, None] ** 2, c.jerk * factors[-1:] ** 2)


def used(p: Parts, v: Float[Array, "3 nodes"]) -> Float[Array, "8 nodes"]:
    """Each quantity divided by its limit, in the order of `NAMES`."""
    powers = jnp.asarray([0.5 if QUANTITIES[name].per_time == 1 else 1.0 for name in UPPER])[:, None]
    upper = (p.upper * jnp.maximum(v[:1], 0.0)) ** powers
    squares = jnp.stack([*(_form(q, v) for q in p.forms), v[0] * _form(p.jerk, v)])
    return jnp.concatenate([upper, jnp.sqrt(jnp.maximum(squares, 0.0))])


def values(c: Constraints, v: Float[Array, "3 nodes"]) -> Float[Array, "5 nodes"]:
    """The constraint values, which must not be positive."""
    return jnp.stack([c.upper * v[0], *(_form(q, v) for q in c.forms), v[0] * _form(c.jerk, v)]) - 1


def gradients(c: Constraints, v: Float[Array, "3 nodes"]) -> Float[Array, "5 3 nodes"]:
    """The gradients of `values` with respect to (a, a', a'')."""
    zero = jnp.zeros_like(v[0])
    rows = [jnp.stack([c.upper, zero, zero])]
    rows += [2 * jnp.stack([q[0] * v[0] + q[1] * v[1], q[1] * v[0] + q[2] * v[1], zero]) for q in c.forms]
    slope = _times(c.jerk, v)
    of_jerk = 2 * v[:1] * slope
    rows.append(of_jerk.at[0].add(jnp.sum(slope * v, axis=0)))
    return jnp.stack(rows)


def curvature(
    c: Constraints, v: Float[Array, "3 nodes"], multipliers: Float[Array, "5 nodes"], a: Float[Array, " nodes"]
) -> Float[Array, "3 3 nodes"]:
    """Second derivatives of the convex model of the constraints, weighted by the multipliers; `a` > 0.

    For the jerk constraint y² ≤ 1 with y = √a w, the model with the tangent of 1/√a has the second derivatives 2∇yᵀ∇y.
    """
    z, last = 2 * multipliers[1:-1], 2 * multipliers[-1]
    aa, ab, bb = (jnp.sum(z * c.forms[:, k], axis=0) for k in range(3))
    q, slope = c.jerk, _times(c.jerk, v)
    y = v[0] * last
    corner = last * (slope[0] + jnp.sum(slope * v, axis=0) / (4 * a))
    rows = [
        [aa + y * q[0] + corner, ab + y * q[1] + 0.5 * last * slope[1], y * q[3] + 0.5 * last * slope[2]],
        [None, bb + y * q[2], y * q[4]],
        [None, None, y * q[5]],
    ]
    return jnp.stack([jnp.stack([rows[min(i, j)][max(i, j)] for j in range(3)]) for i in range(3)])  # type: ignore[misc]


def _form(q: Array, v: Array) -> Array:
    """The value of a quadratic form."""
    if q.shape[0] == 3:
        return v[0] * (q[0] * v[0] + 2 * q[1] * v[1]) + q[2] * v[1] * v[1]
    return jnp.sum(_times(q, v) * v, axis=0)


def _times(q: Float[Array, "6 nodes"], v: Float[Array, "3 nodes"]) -> Float[Array, "3 nodes"]:
    """The product of the form's matrix with v."""
    aa, ab, bb, ac, bc, cc = q
    return jnp.stack(
        [aa * v[0] + ab * v[1] + ac * v[2], ab * v[0] + bb * v[1] + bc * v[2], ac * v[0] + bc * v[1] + cc * v[2]]
    )
