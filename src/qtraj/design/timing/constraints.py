"""Express limits on a motion r(u(t)) as constraints on a = u̇² and its derivatives with respect to u.

With the derivatives r', r'' and r''' of the path with respect to its parameter u, the motion has the

    velocity      √a r'
    acceleration  a r'' + ½ a' r'
    jerk          √a (a r''' + 3/2 a' r'' + ½ a'' r').

So limits on the speed, the lateral acceleration and the rates of rotation are upper bounds on a. The squares of the
longitudinal acceleration, of the yaw acceleration and of the acceleration are convex quadratic forms in (a, a'). The
square of the jerk is a·Q, where Q is a quadratic form in (a, a', a''). So a limit on the jerk is √Q ≤ limit/√a, which
becomes convex if 1/√a is replaced by its tangent. Limits on friction and power need a vehicle (see `road`).

The last axes of every array index the nodes. With b = a' and c = a'', a form in (a, b) is represented by the entries
(aa, ab, bb) of its symmetric matrix. The form in (a, b, c) is represented by its whole matrix.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Float

from qtraj.design.timing import road
from qtraj.design.timing.banded import total
from qtraj.design.timing.road import ROAD, Road
from qtraj.foundation.types import Scalar
from qtraj.path.components import dot
from qtraj.path.frenet import Invariants, yaw
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters

UPPER = ("speed", "lateral_acceleration", "yaw_rate", "angular_rate")
"""Limits that are upper bounds on a."""

FORMS = ("longitudinal_acceleration", "yaw_acceleration", "acceleration")
"""Limits whose squares are quadratic forms in a and a'."""

NAMES = (*UPPER, *FORMS, "jerk", *ROAD)
"""Limits that depend on the timing, in the order of all arrays. Without a vehicle, arrays end before `ROAD`."""

POWERS = (*(0.5 if QUANTITIES[name].per_time == 1 else 1.0 for name in UPPER), *[1.0] * len(FORMS), 1.5)
"""For each quantity an exponent p: if a is multiplied by a constant k, the quantity is multiplied by k^p.

Friction and power are not such powers, because gravity does not depend on a.
"""

JERK = 1 + len(FORMS)
"""Index of the constraint on the jerk, after the upper bound and the forms. The constraints of `ROAD` follow."""

STANDING = 1e-8
"""|r'| below this fraction of its maximum is treated as zero."""

LARGEST = 1e12
"""Bound on a where no limit bounds it."""


class Constraints(NamedTuple):
    """Constraints on v = (a, a', a'') at all nodes: a·`upper` ≤ 1, `forms`(v) ≤ 1, a·`jerk`(v) ≤ 1, and `road`.

    The coefficients of absent limits are zero. Without a vehicle, `road` is None.
    """

    upper: Float[Array, "*nodes"]
    forms: Float[Array, "3 3 *nodes"]
    jerk: Float[Array, "3 3 *nodes"]
    road: Road | None = None

    @property
    def per_node(self) -> int:
        """Number of constraints at each node."""
        return JERK + 1 + (0 if self.road is None else len(ROAD))


Gradients = Sequence[tuple[Any, ...]]
"""For each constraint, the derivatives with respect to a, a' and a''; trailing zero derivatives are omitted."""


class Parts(NamedTuple):
    """The constraints before the upper bounds are combined; `upper` has one row for each limit."""

    upper: Float[Array, "4 *nodes"]
    forms: Float[Array, "3 3 *nodes"]
    jerk: Float[Array, "3 3 *nodes"]
    road: Road | None = None

    def constraints(self) -> Constraints:
        """Return the constraints with only the lowest upper bound on a at each node."""
        upper = jnp.maximum(jnp.max(self.upper, axis=0), 1 / LARGEST)
        upper = upper if self.road is None else jnp.maximum(upper, self.road.upper)
        return Constraints(upper, self.forms, self.jerk, self.road)


def parts(
    r: Float[Array, "3 3 *nodes"], unit: Scalar, bounds: dict[str, Scalar], vehicle: RoadParameters | None = None
) -> Parts:
    """Compute the constraints from `r`, the derivatives r', r'' and r''' at the nodes.

    Derivatives of a are with respect to u/`unit`. The bounds of absent limits are infinite. Limits on friction and
    power are included only with a `vehicle`.
    """
    r1, r2, r3 = (tuple(x) for x in r)
    square = dot(r1, r1)
    moving = square > STANDING**2 * jnp.max(square)
    # Where r' = 0, use the direction of r'', in which the motion starts.
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
    aa, ab, bb = i.J, 3 * half * dot(r2, r3), 9 * half * half * i.A
    ac, bc, cc = second * i.C, 3 * half * second * i.B, second**2 * i.S
    jerk = jnp.stack([aa, ab, ac, ab, bb, bc, ac, bc, cc]).reshape(3, 3, *aa.shape)
    upper = [_upper(name, i, bounds[name], moving) for name in UPPER]
    found = Parts(jnp.stack(upper), jnp.stack(scaled), jerk / bounds["jerk"] ** 2)
    if vehicle is None:
        return found
    direction = jnp.stack(ahead) * inv_ahead[None]
    on_road = road.coefficients(direction, r2, jnp.sqrt(i.S), half, vehicle, bounds)
    # Where r' vanishes, r'' has the direction of motion or the opposite direction.
    return found._replace(road=road.without(on_road, ~moving))


def _upper(name: str, i: Any, bound: Scalar, moving: Array) -> Array:
    """Return 1/a for the largest a that satisfies the limit; the quantity is proportional to √a^`per_time`."""
    entry = QUANTITIES[name]
    square = jnp.where(moving, entry.squared(i), 0.0) / bound**2
    if entry.per_time == 1:
        return square
    return jnp.where(square > 0, jnp.sqrt(jnp.where(square > 0, square, 1.0)), 0.0)


def _inverse_root(x: Array) -> Array:
    return jnp.where(x > 0, jnp.where(x > 0, x, 1.0) ** -0.5, 0.0)


def tightened(c: Constraints, factors: Float[Array, "count *nodes"]) -> Constraints:
    """Return the same constraints with their limits divided by `factors`."""
    own = None if c.road is None else road.tightened(c.road, factors[JERK + 1 :])
    forms, jerk = c.forms * factors[1:JERK, None] ** 2, c.jerk * factors[None, JERK, None] ** 2
    return Constraints(c.upper * factors[0], forms, jerk, own)


def used(p: Parts, v: Float[Array, "3 *nodes"]) -> Float[Array, "limits *nodes"]:
    """Return each quantity divided by its limit, in the order of `NAMES`."""
    rows = [x * jnp.maximum(v[0], 0.0) for x in p.upper]
    upper = [jnp.sqrt(x) if power < 1 else x for x, power in zip(rows, POWERS, strict=False)]
    squares = [*_forms(p.forms, v), v[0] * _quadratic(p.jerk, v)]
    on_road = [] if p.road is None else road.used(p.road, v)
    return jnp.stack([*upper, *(jnp.sqrt(jnp.maximum(x, 0.0)) for x in squares), *on_road])


def values(c: Constraints, v: Float[Array, "3 *nodes"]) -> Float[Array, "count *nodes"]:
    """Return the constraint values, which must not be positive."""
    found = jnp.stack([c.upper * v[0], *_forms(c.forms, v), v[0] * _quadratic(c.jerk, v)]) - 1
    return found if c.road is None else jnp.concatenate([found, jnp.stack(road.values(c.road, v))])


def gradients(c: Constraints, v: Float[Array, "3 *nodes"]) -> Gradients:
    """Return the gradients of `values` with respect to (a, a', a'')."""
    a, b, _ = v
    slope = _times(c.jerk, v)
    jerk = [2 * a * x for x in slope]
    jerk[0] = jerk[0] + _dot(slope, v)
    forms = [(2 * (aa * a + ab * b), 2 * (ab * a + bb * b)) for aa, ab, bb in c.forms]
    return [(c.upper,), *forms, tuple(jerk), *([] if c.road is None else road.gradients(c.road, v))]


def second_derivatives(
    c: Constraints,
    v: Float[Array, "3 *nodes"],
    multipliers: Float[Array, "count *nodes"],
    ratio: Float[Array, "count *nodes"],
    a: Float[Array, "*nodes"],
) -> list[list[Array]]:
    """Return the lower triangle of Σ multiplier·(second derivatives) + ratio·gradient·gradientᵀ; `a` > 0.

    For the jerk constraint y² ≤ 1 with y = √a w, replacing 1/√a by its tangent leaves the second derivatives 2∇yᵀ∇y.
    """
    slope, last = _times(c.jerk, v), multipliers[JERK]
    found = [[2 * last * v[0] * c.jerk[i, j] for j in range(i + 1)] for i in range(3)]
    for i in range(3):
        found[i][0] = found[i][0] + (2.0 if i == 0 else 1.0) * last * slope[i]
    found[0][0] = found[0][0] + last * _dot(slope, v) / (2 * a)
    for (aa, ab, bb), z in zip(c.forms, 2 * multipliers[1:JERK], strict=True):
        found[0][0], found[1][0], found[1][1] = found[0][0] + z * aa, found[1][0] + z * ab, found[1][1] + z * bb
    if c.road is not None:
        aa, ab, bb = road.second_derivatives(c.road, multipliers[JERK + 1 :])
        found[0][0], found[1][0], found[1][1] = found[0][0] + aa, found[1][0] + ab, found[1][1] + bb
    for own, weight in zip(gradients(c, v), ratio, strict=True):
        for i, x in enumerate(own):
            for j, y in enumerate(own[: i + 1]):
                found[i][j] = found[i][j] + weight * x * y
    return found


def changes(slope: Gradients, dv: Float[Array, "3 *nodes"]) -> Float[Array, "count *nodes"]:
    """Return the changes of the linearised constraint values."""
    return jnp.stack([total(x * d for x, d in zip(own, dv, strict=False)) for own in slope])


def weighted(slope: Gradients, weights: Float[Array, "count *nodes"]) -> list[Float[Array, "*nodes"]]:
    """Return the weighted sums of the gradients."""
    return [total(own[k] * w for own, w in zip(slope, weights, strict=True) if k < len(own)) for k in range(3)]


def _forms(q: Float[Array, "3 3 *nodes"], v: Float[Array, "3 *nodes"]) -> list[Float[Array, "*nodes"]]:
    """Return the values of the quadratic forms in a and a'."""
    a, b, _ = v
    return [aa * a * a + 2 * ab * a * b + bb * b * b for aa, ab, bb in q]


def _times(q: Float[Array, "3 3 *nodes"], v: Float[Array, "3 *nodes"]) -> list[Float[Array, "*nodes"]]:
    return [_dot(row, v) for row in q]


def _dot(x: Any, y: Any) -> Any:
    return total(p * q for p, q in zip(x, y, strict=True))


def _quadratic(q: Float[Array, "3 3 *nodes"], v: Float[Array, "3 *nodes"]) -> Float[Array, "*nodes"]:
    return _dot(_times(q, v), v)
