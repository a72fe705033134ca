"""Decide whether the limits bound the speed of a timing.

Let u be the path parameter, a = u̇² and a' = da/du. The speed is unbounded if a profile of arbitrarily large a satisfies
all limits. At a large value of a, each node has an interval of possible a'. Without a limit on the jerk, such a profile
exists if a can be large on at least one whole cell, can increase to a large value before this cell, and can decrease
again after it. At the start, a can be large if the speed there is free. Elsewhere a can become large only where a' has
no upper bound, because bounds on a' are proportional to a. The same applies to the end, with lower bounds. A limit on
power alone bounds a' only from above. So it does not bound the speed if the start speed is free: the vehicle may start
arbitrarily fast, and drag reduces its speed only by a factor.

A limit on the jerk bounds the speed on every path that bends. On a straight path, only the profiles whose squared
speed is a linear function of the distance have no jerk.

A value of a counts as large if its ratio to a typical value is large. The typical value follows from the limits, the
length of the path and the speeds at its ends. So the result does not depend on units or on the parameter of the path.
"""

from typing import Any

import jax
import numpy as np
from jaxtyping import Bool, Float

from qtraj.design.timing.constraints import STANDING, Constraints
from qtraj.design.timing.linear_formulas import linear_limits
from qtraj.design.timing.program import Program
from qtraj.design.timing.road import LOADS, POWER_SIDES, ROAD
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.own_name import OwnName
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.road_parameters import RoadParameters

LARGEST = 1e12
"""Bound on the squared speed where no limit bounds it, relative to a typical squared speed."""

STRAIGHT = 1e-12
"""The lateral part of r'' is treated as zero if its square is less than this fraction of |r''|², or if the path turns
by less than about this angle [rad] in a cell."""


def largest(
    r1: Float[Any, "3 *nodes"],
    span: Scalar,
    bounds: dict[str, Scalar],
    ends: Float[Any, " 2"],
    vehicle: RoadParameters | None,
) -> Float[Any, "*nodes"]:
    """Return the bounds on a = u̇² for nodes at which no limit bounds a.

    `r1` contains r' at the nodes, and `span` is the duration of the path.

    For a path of length L, a limit in m^k s^-n implies the typical rate (limit/L^k)^(1/n) [1/s]. Limits on friction and
    power imply the rates of the accelerations that they allow, and the bounds `ends` on a imply |r'|√a/L. The highest
    rate counts; L times this rate is the typical speed. Infinite limits and bounds are ignored.
    """
    xp = namespace(r1, span, ends, *bounds.values(), *(() if vehicle is None else vehicle.numbers))
    square = xp.sum(r1 * r1, axis=0)
    highest = xp.max(square)
    length = span * xp.sqrt(highest)
    rates = [xp.sqrt(x * s) / length for x, s in zip(ends, (square.ravel()[0], square.ravel()[-1]), strict=True)]
    for name, bound in bounds.items():
        if isinstance(name, OwnName):
            continue
        entry = quantity("lateral_acceleration" if name == COMBINED else name)
        if name in LOADS and vehicle is not None:
            rates.append(xp.sqrt(abs(bound) / vehicle.mass / length))
        elif name not in (*ROAD, *POWER_SIDES):
            rates.append((abs(bound) / length**entry.length) ** (1 / entry.per_time))
        elif vehicle is not None:
            gravity = xp.sqrt(abs(bound) * vehicle.gravity / length)
            rates.append(gravity if name == "friction" else xp.cbrt(abs(bound) / vehicle.mass / length**2))
    known = xp.stack(rates)
    rate = xp.max(xp.where(xp.isfinite(known), known, 0.0))
    rate = xp.where(rate > 0, rate, 1 / span)
    return LARGEST * (length * rate) ** 2 / xp.maximum(square, STANDING**2 * highest)


def unbounded(program: Program, a: Float[Any, "batch 2 cells+1"], slow: Bool[Any, " 2"]) -> Bool[Any, " batch"]:
    """Return whether the speed is unbounded, or the solution `a` exceeds half of `program.largest` at some node.

    `a` contains u̇² at the nodes. `slow` indicates whether r' = 0, or the speed is fixed, at the start and at the end.
    """
    c: Constraints = jax.tree.map(_in_order, program.constraints)
    of_nodes = program.largest, program.nodes.place, program.nodes.standing
    most, place, standing = map(_in_order, of_nodes)
    at_end = np.zeros(place.shape, bool)
    at_end[0], at_end[-1] = slow
    low, high = _slopes(c, most)
    possible = (c.upper <= 2 / most) & (standing == 0) & ~at_end & (low <= high)
    if c.jerk is not None:
        found = np.all([_linear(jerk, place, most, possible, low, high) for jerk in c.jerk], axis=0)
    elif program.nodes.seam:  # a lap has no ends
        found = _any_of_lap(possible, low, high)
    else:
        found = _any(possible, low, high).any(axis=-1)
    return found | ((_in_order(a) > 0.5 * most) & (standing == 0)).any(axis=-1)


def _in_order(x: Float[Any, "*rows 2 cells+1"]) -> Float[Any, "*rows nodes"]:
    """Return the values at all nodes in the order of the path, without the padding."""
    return np.swapaxes(x, -1, -2).reshape(*x.shape[:-2], x.shape[-2] * x.shape[-1])[..., :-1]


Nodes = Float[Any, "batch nodes"]


def _slopes(c: Constraints, a: Nodes) -> tuple[Nodes, Nodes]:
    """Return bounds on a' = da/du at each node for a large `a` = u̇²; low > high if no a' is possible."""
    low, high = np.full_like(c.upper, -np.inf), np.full_like(c.upper, np.inf)
    for (aa, ab), (_, bb) in c.forms:
        limited = bb * a**2 > 1
        size = np.where(limited, bb, 1.0)
        rest = aa - np.where(limited, ab * ab / size, 0.0)
        left = 1 - np.where(limited & (rest <= STRAIGHT * aa), 0.0, rest) * a**2
        low, high = _within(low, high, limited | (left < 0), -a * ab / size, left / size)
    bends = np.zeros((len(c.sides), *a.shape)) if c.bends is None else c.bends.values(a)[0]
    own = np.zeros((0, 3, *a.shape)) if c.formulas is None else linear_limits(c.formulas).sides()
    bends = np.concatenate([bends, np.zeros((len(own), *a.shape))])
    for (shift, p, q), bend in zip(np.concatenate([c.sides, own]), bends, strict=True):
        limited, rest = np.abs(q) * a > 1, 1 - shift - bend - p * a
        slope = rest / np.where(limited, q, 1.0)
        low = np.where(limited & (q < 0), np.maximum(low, slope), np.where(~limited & (rest < 0), np.inf, low))
        high = np.where(limited & (q > 0), np.minimum(high, slope), high)
    if c.combined is not None:
        least, most = c.combined.slopes(a)
        low, high = np.maximum(low, least), np.minimum(high, most)
    if c.road is None:
        return low, high
    x0, x1, x2 = c.road.along
    y, z = (p[0] + p[1] * a for p in (c.road.across, c.road.onto))
    limited, size = x2 * a > 1, np.where(x2 > 0, x2, 1.0)
    low, high = _within(low, high, limited, -(x0 + x1 * a) / size, (z * z - y * y) / size**2)
    p0, p1, p2 = c.road.power
    limited, size = p2 * a > 1, np.where(p2 > 0, p2, 1.0)
    return low, np.where(limited, np.minimum(high, (a**-0.5 - p0 - p1 * a) / size), high)


def _within(low: Nodes, high: Nodes, limited: np.ndarray, middle: Nodes, square: Nodes) -> tuple[Nodes, Nodes]:
    """Restrict an interval to |a' − middle|² ≤ square where `limited`; a negative square makes the interval empty."""
    half = np.where(square >= 0, np.sqrt(np.maximum(square, 0.0)), -np.inf)
    return (
        np.where(limited, np.maximum(low, middle - half), low),
        np.where(limited, np.minimum(high, middle + half), high),
    )


def _any_of_lap(possible: np.ndarray, low: Nodes, high: Nodes) -> Bool[Any, " batch"]:
    """Return whether a = u̇² can be large on some cell of a lap, which is between two other laps."""
    count = possible.shape[-1] - 1
    laps = (np.tile(x[..., :-1], 3) for x in (possible, low, high))
    return _any(*laps)[..., count : 2 * count].any(axis=-1)


def _any(possible: np.ndarray, low: Nodes, high: Nodes) -> Bool[Any, "batch triples"]:
    """Return for each three consecutive nodes whether a = u̇² can be large at all of them."""
    ends = np.arange(possible.shape[-1])
    begun = _reached(possible, (high == np.inf) | (ends == 0))
    left = _reached(possible[:, ::-1], ((low == -np.inf) | (ends == ends.size - 1))[:, ::-1])[:, ::-1]
    large = begun & left
    return large[:, :-2] & large[:, 1:-1] & large[:, 2:]


def _reached(possible: np.ndarray, entered: np.ndarray) -> np.ndarray:
    """Return a mask of the nodes that possible nodes connect to an earlier node where a = u̇² can become large."""
    index = np.arange(possible.shape[-1])
    last = np.maximum.accumulate(np.where(possible & entered, index, -1), axis=-1)
    return last > np.maximum.accumulate(np.where(possible, -1, index), axis=-1)


def _linear(
    jerk: Float[Any, "3 3 batch nodes"],
    place: Float[Any, " nodes"],
    a: Nodes,
    possible: np.ndarray,
    low: Nodes,
    high: Nodes,
) -> Bool[Any, " batch"]:
    """Return whether the path is straight and the limits allow motion with zero jerk at arbitrarily high speed.

    The squared speed of such a motion is constant, or proportional to the distance from one end.
    """
    bend, mixed, square = jerk[1, 1], jerk[1, 2], jerk[2, 2]  # proportional to 9|r''|², 3r'·r'' and |r'|²
    moving = np.where(square > 0, square, 1.0)
    across = bend - np.where(square > 0, mixed**2 / moving, 0.0)
    straight = np.all(across <= STRAIGHT * bend + STRAIGHT**2 * square, axis=-1)
    speed, steady = np.sqrt(square), -2 / 3 * np.where(square > 0, mixed / moving, 0.0)
    steps = 0.5 * np.diff(place) * (speed[:, 1:] + speed[:, :-1])
    gone = np.concatenate([np.zeros_like(speed[:, :1]), np.cumsum(steps, axis=-1)], axis=-1)
    left = gone[:, -1:] - gone
    first, last = (np.arange(place.size) == k for k in (0, place.size - 1))
    found = np.zeros(straight.shape, bool)
    for at_rest, change in (
        (np.zeros_like(first), 0.0),
        (first, speed / np.where(first, 1.0, gone)),
        (last, -speed / np.where(last, 1.0, left)),
    ):
        slope = a * (steady + change)
        found |= np.all(at_rest | (possible & (low <= slope) & (slope <= high)), axis=-1)
    return straight & found
