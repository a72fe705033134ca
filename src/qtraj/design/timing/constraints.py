"""Express limits on a motion r(u(t)) as constraints on a = u̇² and its derivatives with respect to u.

With the derivatives r', r'' and r''' of the path with respect to its parameter u, the motion has the

    velocity      √a r'
    acceleration  a r'' + ½ a' r'
    jerk          √a (a r''' + 3/2 a' r'' + ½ a'' r').

So limits on the speed, the lateral acceleration and the rates of rotation are upper bounds on a. The squares of the
longitudinal acceleration, of the yaw acceleration and of the acceleration are convex quadratic forms in (a, a'). The
square of the jerk is a·Q, where Q is a quadratic form in (a, a', a''). So a limit on the jerk is √Q ≤ limit/√a. This
inequality becomes convex if 1/√a is replaced by its tangent. Limits on friction and power need a vehicle (see `road`).

The last axes of every array index the nodes. With b = a' and c = a'', a form in (a, b) is represented by the entries
(aa, ab, bb) of its symmetric matrix, and the form in (a, b, c) by the entries (aa, ab, bb, ac, bc, cc). No code is
compiled for absent limits.
"""

import functools
from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from jaxtyping import Array, Float

from qtraj.design.timing import road
from qtraj.design.timing.namespace import namespace, total
from qtraj.design.timing.road import ROAD, Road
from qtraj.foundation.types import Scalar
from qtraj.path.components import dot
from qtraj.path.frenet import Invariants, yaw
from qtraj.path.quantity import QUANTITIES
from qtraj.path.vehicle import RoadParameters

UPPER = ("speed", "lateral_acceleration", "yaw_rate", "angular_rate")
"""Limits that are upper bounds on a = u̇²."""

FORMS = ("longitudinal_acceleration", "yaw_acceleration", "acceleration")
"""Limits on quantities whose squares are quadratic forms in a = u̇² and a' = da/du."""

NAMES = (*UPPER, *FORMS, "jerk", *ROAD)
"""Limits that depend on the timing. Arrays have this order, and omit absent limits."""

POWERS = {name: 0.5 * QUANTITIES[name].per_time for name in NAMES if name not in ROAD}
"""For each quantity an exponent p: if a = u̇² is multiplied by a constant k, the quantity is multiplied by k^p.

Friction and power have no such exponent, because gravity does not depend on a.
"""

STANDING = 1e-8
"""|r'| below this fraction of its maximum is treated as zero."""


def listed(bounds: Collection[str], vehicle: bool) -> tuple[str, ...]:
    """Return the names of the limits in `bounds`, in the order of the rows of arrays.

    With a `vehicle`, the names include all of `ROAD`, even if `bounds` does not.
    """
    return tuple(name for name in NAMES if (vehicle if name in ROAD else name in bounds))


class Constraints(NamedTuple):
    """Constraints on v = (a, a', a'') at all nodes: a·`upper` ≤ 1, `forms`(v) ≤ 1, a·`jerk`(v) ≤ 1, and `road`.

    Here a = u̇², and a prime denotes the derivative with respect to the path parameter u. There is one form for each
    limit of `FORMS` that is set. `jerk` is None without a limit on the jerk, and `road` is None without a vehicle.
    """

    upper: Float[Array, "*nodes"]
    forms: tuple[Float[Array, "3 *nodes"], ...]
    jerk: Float[Array, "6 *nodes"] | None = None
    road: Road | None = None

    @property
    def per_node(self) -> int:
        """Number of constraints at each node."""
        return self.before_road + (0 if self.road is None else len(ROAD))

    @property
    def before_road(self) -> int:
        """Number of constraints at each node without those of `road`: the upper bound, the forms and the jerk."""
        return 1 + len(self.forms) + (self.jerk is not None)

    @property
    def orders(self) -> int:
        """Number of components of v that the constraints contain: a, a' and, with a limit on the jerk, a''."""
        return 2 if self.jerk is None else 3


Gradients = Sequence[tuple[Any, ...]]
"""For each constraint, the derivatives with respect to a = u̇², a' and a''; trailing zero derivatives are omitted."""


class Parts(NamedTuple):
    """The constraints before the upper bounds are combined; `upper` has one row for each limit."""

    upper: Float[Array, "uppers *nodes"]
    forms: tuple[Float[Array, "3 *nodes"], ...]
    jerk: Float[Array, "6 *nodes"] | None = None
    road: Road | None = None

    def constraints(self, largest: Float[Array, "*nodes"]) -> Constraints:
        """Return the constraints with only the lowest upper bound on a at each node, at most `largest`."""
        xp = namespace(self.upper, largest)
        upper = functools.reduce(xp.maximum, self.upper, 1 / largest)
        upper = upper if self.road is None else xp.maximum(upper, self.road.upper)
        return Constraints(upper, self.forms, self.jerk, self.road)


def parts(
    r: Float[Array, "3 3 *nodes"], unit: Scalar, bounds: dict[str, Scalar], vehicle: RoadParameters | None = None
) -> Parts:
    """Compute the constraints on a = u̇² from `r`, the derivatives r', r'' and r''' at the nodes.

    The first axes of `r` are the order of the derivative and the component. Derivatives of a are with respect to
    u/`unit`. Limits on friction and power are included only with a `vehicle`.
    """
    xp, (r1, r2, r3) = namespace(r, unit, *bounds.values(), *(vehicle or ())), (tuple(x) for x in r)
    square = dot(r1, r1)
    moving = square > STANDING**2 * xp.max(square)
    # Where r' = 0, use the direction of r'', in which the motion starts.
    ahead = tuple(xp.where(moving, p, q) for p, q in zip(r1, r2, strict=True))
    i = Invariants([None, r1, r2, r3])
    inv_speed, inv_level, inv_ahead = (
        _inverse_root(x) for x in (xp.where(moving, i.S, 0.0), xp.where(moving, i.H, 0.0), dot(ahead, ahead))
    )
    rate, growth = yaw(i, inv_speed, inv_level)
    half = 0.5 / unit
    along = dot(ahead, r2) * inv_ahead, half * xp.sqrt(i.S)
    turning = growth, half * rate
    forms = dict(zip(FORMS, (_square(*along), _square(*turning), (i.A, half * i.B, half * half * i.S)), strict=True))
    scaled = tuple(xp.stack(forms[name]) / bounds[name] ** 2 for name in FORMS if name in bounds)
    jerk, second = None, half / unit
    if "jerk" in bounds:
        level = i.J, 3 * half * dot(r2, r3), 9 * half * half * i.A
        jerk = xp.stack([*level, second * i.C, 3 * half * second * i.B, second**2 * i.S]) / bounds["jerk"] ** 2
    upper = [_upper(name, i, bounds[name], moving) for name in UPPER if name in bounds]
    found = Parts(xp.stack(upper) if upper else xp.zeros((0, *square.shape), square.dtype), scaled, jerk)
    if vehicle is None:
        return found
    direction = xp.stack(ahead) * inv_ahead[None]
    on_road = road.coefficients(direction, r2, xp.sqrt(i.S), half, vehicle, bounds)
    # Where r' vanishes, r'' may be opposite to the direction of motion, so omit friction and power there.
    return found._replace(road=road.without(on_road, ~moving))


def _upper(name: str, i: Any, bound: Scalar, moving: Array) -> Array:
    """Return 1/a for the largest a = u̇² that satisfies the limit; the quantity is proportional to √a^`per_time`."""
    entry = QUANTITIES[name]
    xp, square = namespace(moving, bound, i.S), entry.numerator(i)
    if entry.denominator is not None:
        # Where the divisor is zero, the path is straight or vertical, and the numerator is zero, too.
        divisor = entry.denominator(i)
        square = xp.where(divisor > 0, square / xp.where(divisor > 0, divisor, 1.0), 0.0)
    square = xp.where(moving, square, 0.0) / bound**2
    if entry.per_time == 1:
        return square
    return xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0)


def _inverse_root(x: Array) -> Array:
    xp = namespace(x)
    return xp.where(x > 0, xp.where(x > 0, x, 1.0) ** -0.5, 0.0)


def _square(p: Array, q: Array) -> tuple[Array, Array, Array]:
    """Return the entries (aa, ab, bb) of the quadratic form (p·a + q·b)², where b = a'."""
    return p * p, p * q, q * q


def tightened(c: Constraints, factors: Float[Array, "count *nodes"]) -> Constraints:
    """Return the same constraints with their limits divided by `factors`."""
    own = None if c.road is None else road.tightened(c.road, factors[c.before_road :])
    squares = factors[1:] ** 2
    forms = tuple(form * x[None] for form, x in zip(c.forms, squares, strict=False))
    return Constraints(c.upper * factors[0], forms, None if c.jerk is None else c.jerk * squares[None, len(forms)], own)


def used(p: Parts, v: Float[Array, "orders *nodes"]) -> Float[Array, "limits *nodes"]:
    """Return each quantity divided by its limit in the order of `NAMES`, or a divided by its bound for `UPPER`.

    `v` contains a = u̇² and its derivatives with respect to the path parameter.
    """
    squares = [_form(form, v) for form in p.forms] + ([] if p.jerk is None else [v[0] * _quadratic(p.jerk, v)])
    on_road = [] if p.road is None else road.used(p.road, v)
    xp = namespace(v, p.upper)
    upper = [x * xp.maximum(v[0], 0.0) for x in p.upper]
    return xp.stack([*upper, *(xp.sqrt(xp.maximum(x, 0.0)) for x in squares), *on_road])


def ratios(found: Float[Array, "limits *nodes"], rows: tuple[str, ...]) -> Float[Array, "limits *nodes"]:
    """Convert the result of `used` to ratios of quantities to their limits; `rows` are the names of its rows."""
    linear = [name in UPPER and POWERS[name] < 1 for name in rows]
    xp = namespace(found)
    return xp.stack([xp.sqrt(x) if root else x for x, root in zip(found, linear, strict=True)])


def values(c: Constraints, v: Float[Array, "orders *nodes"]) -> Float[Array, "count *nodes"]:
    """Return the constraint values, which must not be positive."""
    squares = [_form(form, v) for form in c.forms] + ([] if c.jerk is None else [v[0] * _quadratic(c.jerk, v)])
    on_road = [] if c.road is None else road.values(c.road, v)
    return namespace(v, c.upper).stack([*(x - 1 for x in (c.upper * v[0], *squares)), *on_road])


def gradients(c: Constraints, v: Float[Array, "orders *nodes"]) -> Gradients:
    """Return the gradients of `values` with respect to the components of v = (a, a', a''), where a = u̇²."""
    a, b = v[:2]
    found: list[tuple[Any, ...]] = [(c.upper,)]
    found += [(2 * (aa * a + ab * b), 2 * (ab * a + bb * b)) for aa, ab, bb in c.forms]
    if c.jerk is not None:
        slope = _times(c.jerk, v)
        whole, *others = (2 * a * x for x in slope)
        found.append((whole + _dot(slope, v), *others))
    return found if c.road is None else [*found, *road.gradients(c.road, v)]


def second_derivatives(
    c: Constraints,
    v: Float[Array, "orders *nodes"],
    multipliers: Float[Array, "count *nodes"],
    ratio: Float[Array, "count *nodes"],
    a: Float[Array, "*nodes"],
) -> list[list[Array]]:
    """Return the lower triangle of Σ multiplier·(second derivatives) + ratio·gradient·gradientᵀ; `a` > 0.

    The derivatives are with respect to v = (a, a', a''), where a = u̇². The jerk constraint is |y|² ≤ 1, y = √a·w, with
    w linear in v. Replacing 1/√a by its tangent leaves the second derivatives 2YᵀY, where Y is the Jacobian of y.
    """
    found: list[list[Any]] = [[0.0 * a] * (i + 1) for i in range(c.orders)]
    for (aa, ab, bb), z in zip(c.forms, 2 * multipliers[1:], strict=False):
        found[0][0], found[1][0], found[1][1] = found[0][0] + z * aa, found[1][0] + z * ab, found[1][1] + z * bb
    if c.jerk is not None:
        slope, last = _times(c.jerk, v), multipliers[1 + len(c.forms)]
        for i, row in enumerate(_matrix(c.jerk)):
            for j in range(i + 1):
                found[i][j] = found[i][j] + 2 * last * v[0] * row[j]
            found[i][0] = found[i][0] + (2.0 if i == 0 else 1.0) * last * slope[i]
        found[0][0] = found[0][0] + last * _dot(slope, v) / (2 * a)
    if c.road is not None:
        aa, ab, bb = road.second_derivatives(c.road, multipliers[c.before_road :])
        found[0][0], found[1][0], found[1][1] = found[0][0] + aa, found[1][0] + ab, found[1][1] + bb
    for own, weight in zip(gradients(c, v), ratio, strict=True):
        for i, x in enumerate(own):
            for j, y in enumerate(own[: i + 1]):
                found[i][j] = found[i][j] + weight * x * y
    return found


def changes(slope: Gradients, dv: Float[Array, "orders *nodes"]) -> Float[Array, "count *nodes"]:
    """Return the changes of the linearised constraint values for the changes `dv` of a and its derivatives."""
    return namespace(dv, *slope[0]).stack([total(x * d for x, d in zip(own, dv, strict=False)) for own in slope])


def weighted(slope: Gradients, weights: Float[Array, "count *nodes"]) -> list[Float[Array, "*nodes"]]:
    """Return the weighted sums of the gradients."""
    orders = max(map(len, slope))
    return [total(own[k] * w for own, w in zip(slope, weights, strict=True) if k < len(own)) for k in range(orders)]


def _form(q: Float[Array, "3 *nodes"], v: Float[Array, "orders *nodes"]) -> Float[Array, "*nodes"]:
    """Return the value of a quadratic form in a = u̇² and a' = da/du."""
    (aa, ab, bb), a, b = q, v[0], v[1]
    return aa * a * a + 2 * ab * a * b + bb * b * b


def _matrix(q: Float[Array, "6 *nodes"]) -> tuple[tuple[Any, ...], ...]:
    """Return the rows of the symmetric matrix of a quadratic form in a = u̇², a' and a''."""
    aa, ab, bb, ac, bc, cc = q
    return (aa, ab, ac), (ab, bb, bc), (ac, bc, cc)


def _times(q: Float[Array, "6 *nodes"], v: Float[Array, "3 *nodes"]) -> list[Float[Array, "*nodes"]]:
    return [_dot(row, v) for row in _matrix(q)]


def _dot(x: Any, y: Any) -> Any:
    return total(p * q for p, q in zip(x, y, strict=True))


def _quadratic(q: Float[Array, "6 *nodes"], v: Float[Array, "3 *nodes"]) -> Float[Array, "*nodes"]:
    return _dot(_times(q, v), v)
