"""Express limits on friction and power of a vehicle as constraints on a = u̇² and a' (see `constraints` and `contact`).

The force of the road on the vehicle, divided by the mass, has components along the path (X), in the plane of the road
across the path (Y), and normal to the road (Z). The motion has the acceleration a r'' + ½ a' r' and the squared speed
a S, where S = |r'|². So X, Y and Z are affine functions of a and a'. With the mass m, the friction coefficients μ and
the coefficient C_rr of rolling resistance, the limits are

    friction   √((X/μ_along)² + (Y/μ_across)²) ≤ limit·Z, a second-order cone
    power      √(a S) m (X + C_rr Z) ≤ limit.

With μ and the limit absorbed in X and Y, the limit on friction is X² + Y² − Z² ≤ 0. Replacing the concave term −Z² by
its tangent gives a convex set inside the feasible set. Divided by √a, the limit on power has the right side limit/√a,
and becomes linear in (a, a') if 1/√a is replaced by its tangent. So the Hessian of the Lagrangian omits the second
derivatives of −Z² and of the power.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.components import cross, scaled
from qtraj.path.road_parameters import RoadParameters

ROAD = ("friction", "power")
"""Limits that need a vehicle, and have constraints of their own."""

LOADS = ("normal_load", "normal_load_min", "normal_load_max")
"""Limits that need a vehicle, and are affine in a."""

POWER_SIDES = ("power_min", "power_max")
"""Both sides of a limit on the power, which are imposed like formulas of the user (see `formulas`)."""

ON_ROAD = (*ROAD, *LOADS, *POWER_SIDES)
"""All limits that need a vehicle."""

LEAST_LOAD = 1e-6
"""Lower bound on the divisor Z in the ratio of the friction to its limit, relative to the normal force at rest."""


SLOWEST = 0.9
"""Smallest factor on a = u̇² with which the whole timing is slowed down to satisfy limits on friction and power."""


class Road(NamedTuple):
    """The coefficients of 1, a and a' in affine functions at all nodes, where a = u̇².

    The functions are the components X, Y and Z of the force of the road (see the module). `along` and `across` are X
    and Y divided by μ and by the limit on friction, `onto` is Z; all are divided by the normal force at rest. `power`
    is the power divided by √a and by its limit. `across` and `onto` do not depend on a'. `upper` is 1/a for the upper
    bound on a that the lateral force alone implies.
    """

    along: Float[Any, "3 *nodes"]
    across: Float[Any, "2 *nodes"]
    onto: Float[Any, "2 *nodes"]
    power: Float[Any, "3 *nodes"]
    upper: Float[Any, "*nodes"]


def coefficients(
    ahead: Float[Any, "3 *nodes"],
    second: tuple[Any, ...],
    speed: Float[Any, "*nodes"],
    half: Scalar,
    vehicle: RoadParameters,
    bounds: Mapping[str, Scalar],
) -> Road:
    """Compute the coefficients from the direction of motion `ahead`, r'' (`second`) and |r'| (`speed`) at the nodes.

    The acceleration along the path contains the derivative a' of a = u̇² with the factor `half`·|r'|. A limit that is
    infinite or not in `bounds` is absent.
    """
    xp, z = namespace(*ahead, *vehicle.numbers, *bounds.values()), ahead[2]
    g, forward = vehicle.gravity, _dot(ahead, second)
    along = xp.stack([g * z, forward + vehicle.drag * speed**2, half * speed])
    across, onto = _normal(ahead, second, vehicle, xp)
    resistance = vehicle.rolling * xp.stack([*onto, 0.0 * z])
    power = (vehicle.mass * speed / bounds.get("power", np.inf))[None] * (along + resistance)
    # On a road with another axis than the vertical, the normal force at rest may be zero.
    at_rest = onto[0] if vehicle.axis is None else g + 0.0 * z
    at_rest = xp.where(at_rest > 0, at_rest, 1.0)
    limit = bounds.get("friction", np.inf)
    inverse = ((1 / limit) / at_rest)[None]  # an infinite limit has finite derivatives
    grip = vehicle.inv_long * along * inverse, vehicle.inv_lat * across * inverse, onto / at_rest[None]
    neutral = xp.stack([xp.ones_like(z), xp.zeros_like(z)])
    grip = grip[0], grip[1], xp.where(xp.isfinite(limit), grip[2], neutral)
    return Road(*grip, power, _upper(*grip[1:]))


def normal_load(ahead: Float[Any, "3 *nodes"], second: tuple[Any, ...], vehicle: RoadParameters) -> Any:
    """Return the coefficients of 1 and a in the normal load [N]; the arguments are those of `coefficients`."""
    return vehicle.mass * _normal(ahead, second, vehicle, namespace(*ahead, *vehicle.numbers))[1]


def _normal(ahead: Any, second: Any, vehicle: RoadParameters, xp: Any) -> tuple[Any, Any]:
    """Return the coefficients of 1 and a in the components Y and Z of the force."""
    left, upwards = _upright(ahead, xp) if vehicle.axis is None else _about(vehicle.axis, ahead, xp)
    g, cos, sin, to_left, up = vehicle.gravity, vehicle.cos, vehicle.sin, _dot(left, second), _dot(upwards, second)
    across = xp.stack([cos * g * left[2] - sin * g * upwards[2], cos * to_left - sin * up])
    return across, xp.stack([cos * g * upwards[2] + sin * g * left[2], cos * up + sin * to_left])


def _dot(p: Any, q: Any) -> Any:
    return sum(x * y for x, y in zip(p, q, strict=True))


def _upright(ahead: Any, xp: Any) -> tuple[Any, Any]:
    """Return the axes n and b of the upright frame, which are zero if the motion is vertical."""
    x, y, z = ahead
    square = x * x + y * y
    safe = xp.sqrt(xp.where(square > 0, square, 1.0))  # keeps derivatives finite if the motion is vertical
    return (-y / safe, x / safe, 0.0 * z), (-x * z / safe, -y * z / safe, xp.where(square > 0, safe, 0.0))


def _about(axis: Any, ahead: Any, xp: Any) -> tuple[Any, Any]:
    """Return the axes n and b of the frame about another axis than the vertical, which is in world axes."""
    ahead = tuple(ahead)
    n = cross(axis, ahead)
    square = _dot(n, n)
    n = scaled(n, 1 / xp.sqrt(xp.where(square > 0, square, 1.0)))
    return n, cross(ahead, n)


def _upper(across: Any, onto: Any) -> Any:
    """Return 1/a for the largest a = u̇² with |Y| ≤ Z, where `across` is Y and `onto` is Z.

    The result is 0 if a is unbounded. A side on which the inequality is violated at rest is ignored.
    """
    xp = namespace(across, onto)
    found = xp.zeros_like(onto[0])
    for sign in (-1.0, 1.0):
        reserve, rate = onto[0] - sign * across[0], sign * across[1] - onto[1]
        found = xp.maximum(found, xp.where(reserve > 0, rate / xp.where(reserve > 0, reserve, 1.0), 0.0))
    return found


def steady(r: Road) -> Float[Any, "*nodes"]:
    """Return a lower bound on the largest constant a = u̇² for which the power suffices; infinite without a limit."""
    slope, drag = np.maximum(2 * r.power[0], 0.0), np.maximum(2 * r.power[1], 0.0)
    bounds = [np.where(x > 0, np.where(x > 0, x, 1.0) ** e, np.inf) for x, e in ((slope, -2.0), (drag, -2 / 3))]
    return np.minimum(*bounds)


def without(r: Road, omitted: Any) -> Road:
    """Replace the constraints at the nodes where `omitted` is true by constraints that are always satisfied."""
    xp = namespace(*r)
    neutral = Road(*(xp.zeros_like(x) for x in r))
    neutral = neutral._replace(onto=xp.stack([xp.ones_like(r.upper), xp.zeros_like(r.upper)]))
    return Road(*(xp.where(xp.broadcast_to(omitted, x.shape), x, y) for x, y in zip(neutral, r, strict=True)))


def tightened(r: Road, factors: Float[Any, "2 *nodes"]) -> Road:
    """Return the same constraints with their limits divided by `factors`.

    Where the tyres hold the vehicle at rest, only the parts of the force components X and Y that depend on the timing
    are multiplied by the factors for friction. Otherwise gravity on a slope or a banked road could violate a reduced
    limit at every speed. Elsewhere, as at the top of a loop, a faster motion may reduce the friction demand, and the
    whole components are multiplied.
    """
    friction, power = factors[:1], factors[1:]
    xp = namespace(*r, factors)
    x, y, z = r.along[:1], r.across[:1], r.onto[:1]
    held = xp.where((z > 0) & (x * x + y * y < z * z), 1.0, friction)
    along = xp.concatenate([x * held, r.along[1:] * friction])
    across = xp.concatenate([y * held, r.across[1:] * friction])
    return r._replace(along=along, across=across, power=r.power * power)


def values(r: Road, v: Float[Any, "orders *nodes"]) -> list[Any]:
    """Return the constraint values, which must not be positive."""
    x, y, z = _grip(r, v)
    return [x * x + y * y - z * z, _root(v[0]) * _affine(r.power, v) - 1]


def used(r: Road, v: Float[Any, "orders *nodes"]) -> list[Any]:
    """Return the friction and the power divided by their limits."""
    xp, (x, y, z) = namespace(v, r.power), _grip(r, v)
    return [xp.sqrt(x * x + y * y) / xp.maximum(z, LEAST_LOAD), _root(v[0]) * _affine(r.power, v)]


def slowing(usage: Float[Any, "2 *cells"], at_rest: Float[Any, "2 *cells"], allowed: float) -> Float[Any, "2 *cells"]:
    """Return the factors on a = u̇² with which friction and power satisfy their limits approximately, or 1.

    A relative violation of at most `allowed` gets the factor 1, because a slower timing may need more power where the
    vehicle brakes uphill.

    `at_rest` is the usage for a = 0. On a slope or a banked road, the tyres balance a part of gravity at every speed,
    so only the rest of the friction decreases with a. A factor less than `SLOWEST` is replaced by 1. Then the violation
    remains, because a much slower timing would be useless.
    """
    xp, over = namespace(usage, at_rest), usage > 1 + allowed
    friction = (1 - at_rest[0]) / xp.where(over[0], usage[0] - at_rest[0], 1.0)
    power = 1 / xp.where(over[1], usage[1], 1.0) ** 2
    factors = xp.stack([friction, power])
    return xp.where(over & (factors >= SLOWEST), factors, 1.0)


def gradients(r: Road, v: Float[Any, "orders *nodes"]) -> list[tuple[Any, ...]]:
    """Return the gradients of `values` with respect to a = u̇² and a'."""
    x, y, z = _grip(r, v)
    xp, root = namespace(v, r.power), _root(v[0])
    inverse = xp.where(root > 0, 1 / xp.where(root > 0, root, 1.0), 0.0)
    friction = 2 * (x * r.along[1] + y * r.across[1] - z * r.onto[1]), 2 * x * r.along[2]
    return [friction, (0.5 * inverse * _affine(r.power, v) + root * r.power[1], root * r.power[2])]


def second_derivatives(r: Road, multipliers: Float[Any, "2 *nodes"]) -> tuple[Any, Any, Any]:
    """Return the entries (aa, ab, bb) of Σ multiplier·(second derivatives), without the terms that are not convex.

    The derivatives are with respect to a = u̇² and b = a'.
    """
    twice = 2 * multipliers[0]
    (_, p, q), (_, s) = r.along, r.across
    return twice * (p * p + s * s), twice * p * q, twice * q * q


def _grip(r: Road, v: Float[Any, "orders *nodes"]) -> tuple[Any, Any, Any]:
    return _affine(r.along, v), r.across[0] + r.across[1] * v[0], r.onto[0] + r.onto[1] * v[0]


def _affine(c: Float[Any, "3 *nodes"], v: Float[Any, "orders *nodes"]) -> Any:
    return c[0] + c[1] * v[0] + c[2] * v[1]


def _root(a: Any) -> Any:
    xp, positive = namespace(a), a > 0
    return xp.where(positive, xp.sqrt(xp.where(positive, a, 1.0)), 0.0)
