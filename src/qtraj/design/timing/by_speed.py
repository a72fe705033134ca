"""Limits that depend on the speed, as constraints on a = u̇² and a' (see `constraints`).

The speed is |r'|√a. A limit by speed is a sum of hinges max(v − v_k, 0). In the constraints, the hinges are rounded off
such that they are smooth and the limit is nowhere less strict; the exact limit is proved afterwards. A limit that falls
with the speed makes the feasible set nonconvex, because √a is concave: as for the power (see `road`), the Hessian of
the Lagrangian omits negative second derivatives, which replaces √a by its tangent.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import FIELDS, Ellipse
from qtraj.path.quantity import COMBINED

LATERAL = "lateral_acceleration"

ROUNDED = 0.01
"""A hinge is rounded off over this fraction of the shorter line next to it."""


class Curve(NamedTuple):
    """The function `start` + Σ `slopes`·hinge(v − `speeds`) of the speed v at all nodes, with hinges of some `widths`.

    The axis before those of the nodes is that of the hinges. A hinge with a negative width is rounded off on its lower
    side. `pace` is |r'|, so that the speed is pace·√a.
    """

    start: Float[Any, "*nodes"]
    slopes: Float[Any, "hinges *nodes"]
    speeds: Float[Any, "hinges *nodes"]
    widths: Float[Any, "hinges *nodes"]
    pace: Float[Any, "*nodes"]

    def values(self, a: Any) -> tuple[Any, Any, Any]:
        """Return the values, and their first and second derivatives with respect to a."""
        root = np.sqrt(np.maximum(a, 0.0))
        speed = self.pace * root
        value, slope, bend = _hinge(speed - self.speeds, self.widths)
        first, second = (np.sum(self.slopes * x, axis=0) for x in (slope, bend))
        rate = np.divide(0.5 * self.pace, root, out=np.zeros_like(speed), where=root > 0)
        turn = np.divide(-0.5 * rate, a, out=np.zeros_like(speed), where=root > 0)
        return self.start + np.sum(self.slopes * value, axis=0), first * rate, second * rate**2 + first * turn

    def in_jax(self, a: Any) -> Any:
        """Return the values as a function of JAX, for positive arrays `a` with as many axes as the nodes."""
        slopes, speeds, widths, pace = (jnp.asarray(x) for x in self[1:])
        x = (pace * jnp.sqrt(a))[None] - speeds
        width = jnp.abs(widths)
        t = jnp.clip(x / width, -1.0, 1.0)
        s = jnp.clip(t, 0.0, 1.0)
        rounded = jnp.where(widths > 0, 0.25 * width * (t + 1) ** 2, width * s**2 * (2 - s))
        return self.start + jnp.sum(slopes * jnp.where(x > width, x, rounded), axis=0)

    def scaled(self, factor: Any) -> "Curve":
        """Return the function multiplied by `factor`, a number or an array at the nodes."""
        return self._replace(start=self.start * factor, slopes=self.slopes * factor)


def curve_of(limit: BySpeed, pace: Float[Any, "*nodes"], side: int = 1, rounded: float = ROUNDED) -> Curve:
    """Return a limit as a curve that is nowhere less strict on this `side`.

    Hinges are rounded off over the fraction `rounded` of the shorter line next to them.
    """
    v, f = (np.asarray(x, float) for x in (limit.speeds, limit.values))
    slopes = side * np.diff(np.concatenate([[0.0], np.diff(f) / np.diff(v), [0.0]]))
    lengths = np.diff(v, prepend=0.0)
    shorter = np.minimum(np.where(lengths > 0, lengths, np.inf), np.append(lengths[1:], np.inf))
    widths = rounded * np.where(np.isfinite(shorter), shorter, 1.0)
    shape = (-1, *[1] * pace.ndim)
    widths = np.where(slopes < 0, widths, -widths)
    slopes, speeds, widths = (np.broadcast_to(x.reshape(shape), (v.size, *pace.shape)) for x in (slopes, v, widths))
    return Curve(np.full(pace.shape, side * f[0]), slopes, speeds, widths, pace)


def _hinge(x: Any, widths: Any) -> tuple[Any, Any, Any]:
    """Return a smooth function and its derivatives: at least max(x, 0) for positive `widths`, and otherwise at most."""
    width = np.abs(widths)
    t, s = np.clip(x / width, -1.0, 1.0), np.clip(x / width, 0.0, 1.0)
    over = 0.25 * width * (t + 1) ** 2, 0.5 * (t + 1), np.where(np.abs(t) < 1, 0.5 / width, 0.0)
    under = width * s**2 * (2 - s), s * (4 - 3 * s), np.where((s > 0) & (s < 1), (4 - 6 * s) / width, 0.0)
    value, slope, bend = (np.where(widths > 0, p, q) for p, q in zip(over, under, strict=True))
    return np.where(x > width, x, value), slope, bend


def largest_squares(limit: BySpeed, across: Float[Any, "*nodes"], pace: Float[Any, "*nodes"]) -> Float[Any, "*nodes"]:
    """Return 1/a for the lowest a = u̇² at which the lateral acceleration `across`·a reaches its limit, or 0."""
    v, f = (np.asarray(x, float) for x in (limit.speeds, limit.values))
    slopes, high = np.append(np.diff(f) / np.diff(v), 0.0), np.append(v[1:], np.inf)
    turns = (across > 0) & (pace > 0)
    curvature = np.where(turns, across / np.where(pace > 0, pace, 1.0) ** 2, 1.0)
    found = np.full(pace.shape, np.inf)
    ends = [*([(0.0, f[0], 0.0, v[0])] if v[0] > 0 else []), *zip(v, f, slopes, high, strict=True)]
    for low, first, slope, last in ends:
        start = first - slope * low
        size = np.sqrt(np.maximum(slope**2 + 4 * curvature * start, 0.0))
        root = (slope + size) / (2 * curvature) if slope > 0 else 2 * start / (size - slope)  # without cancellation
        found = np.where(np.isinf(found) & (root <= last), np.maximum(root, low), found)
    square = np.where(turns, found, np.inf) / np.where(pace > 0, pace, 1.0)
    return 1 / square**2


def one_interval(bounds: Mapping[str, Any]) -> bool:
    """Return whether the lateral limits allow all speeds up to a largest one, whatever the curvature of the path.

    This is so if f(v)/v² does not increase, where f is the limit. Otherwise `largest_squares` omits faster speeds.
    """
    limits = [x.lateral if isinstance(x, Ellipse) else x for name, x in bounds.items() if name in (LATERAL, COMBINED)]
    return all(_falls_relative_to_square(x) for x in limits if isinstance(x, BySpeed))


def _falls_relative_to_square(limit: BySpeed) -> bool:
    v, f = (np.asarray(x, float) for x in (limit.speeds, limit.values))
    rise = np.diff(f) / np.diff(v)
    return bool(np.all(2 * f[:-1] >= rise * v[:-1]) and np.all(2 * f[1:] >= rise * v[1:]))


def side_by_speed(
    limit: BySpeed, side: int, rates: tuple[Any, Any], pace: Float[Any, "*nodes"]
) -> tuple[tuple[Any, Any, Any], Curve]:
    """Return the coefficients of 1, a and a' in the imposed function of a limit on one side, and the rest of it.

    `rates` are the coefficients of a and a' in the acceleration x. The function is 1 + (x − limit)/size for an upper
    bound; it must be at most 1.
    """
    (p, q), size = rates, limit.size
    return (1.0 + 0.0 * p, side * p / size, side * q / size), curve_of(limit, pace, side).scaled(-1.0 / size)


def stacked(curves: list[Curve | None], pace: Float[Any, "*nodes"]) -> Curve | None:
    """Return several functions as one, with an axis before those of the nodes; None if there is no function.

    A function that is None is zero.
    """
    count = max((len(x.slopes) for x in curves if x is not None), default=0)
    if not count:
        return None
    zeros, ones = np.zeros((count, *pace.shape)), np.ones((count, *pace.shape))
    absent = Curve(zeros[0], zeros, zeros, ones, pace)
    each: list[Any] = [absent if x is None else x for x in curves]
    hinges = (
        [np.concatenate([own, fill[len(own) :]]) for own, fill in zip(x[1:4], absent[1:4], strict=True)] for x in each
    )
    slopes, speeds, widths = (np.stack(x, axis=1) for x in zip(*hinges, strict=True))
    return Curve(np.stack([x.start for x in each]), slopes, speeds, widths, np.stack([x.pace for x in each]))


class Combined(NamedTuple):
    """The limit on the combined acceleration.

    `along` are the coefficients of a and a' in the longitudinal acceleration, and `across` is that of a in the lateral
    one. `factor` is at least 1, by which the limit is tightened, and `upper` is 1/a for the largest a that the lateral
    acceleration allows.
    """

    along: Float[Any, "2 *nodes"]
    across: Float[Any, "*nodes"]
    braking: Curve
    accelerating: Curve
    lateral: Curve
    factor: Float[Any, "*nodes"]
    upper: Float[Any, "*nodes"]

    def without(self, omitted: Any) -> "Combined":
        """Return the same limit, which is always satisfied at the nodes where `omitted` is true."""
        kept = ~omitted
        return self._replace(along=self.along * kept, across=self.across * kept, upper=self.upper * kept)

    def used(self, v: Any) -> Any:
        """Return the ratio of the combined acceleration to its limit."""
        (x, _), (y, _) = self._ratios(v)
        return np.hypot(x, y)

    def value(self, v: Any) -> Any:
        """Return the constraint value, which must not be positive."""
        (x, _), (y, _) = self._ratios(v)
        return x * x + y * y - 1

    def gradient(self, v: Any) -> tuple[Any, Any]:
        """Return the derivatives of `value` with respect to a and a'."""
        (x, dx), (y, dy) = self._ratios(v)
        return 2 * (x * dx[0] + y * dy[0]), 2 * x * dx[1]

    def second(self, v: Any) -> tuple[Any, Any, Any]:
        """Return the second derivatives (aa, ab, bb) of `value`, b = a', without those of the ratios."""
        (_, dx), (_, dy) = self._ratios(v)
        return 2 * (dx[0] ** 2 + dy[0] ** 2), 2 * dx[0] * dx[1], 2 * dx[1] ** 2

    def slopes(self, a: Any) -> tuple[Any, Any]:
        """Return the lowest and the highest a' that the limit allows for large values of a; low > high for none.

        Where a' is hardly limited relative to a, the bounds are infinite.
        """
        (p, q), lateral = self.along, self.factor * self.across * a / self.lateral.values(a)[0]
        rest = np.sqrt(np.maximum(1 - lateral**2, 0.0)) / self.factor
        found = []
        for curve, sign in ((self.braking, -1.0), (self.accelerating, 1.0)):
            limit = curve.values(a)[0]
            limited = q * a > limit
            own = (sign * rest * limit - p * a) / np.where(limited, q, 1.0)
            found.append(np.where(limited, own, sign * np.inf))
        return np.where(lateral > 1, np.inf, found[0]), np.where(lateral > 1, -np.inf, found[1])

    def _ratios(self, v: Any) -> tuple[tuple[Any, tuple[Any, Any]], tuple[Any, Any]]:
        """Return the ratios of both accelerations to their limits, with their derivatives with respect to a and a'."""
        along = self.along[0] * v[0] + self.along[1] * v[1]
        each = zip(self.accelerating.values(v[0]), self.braking.values(v[0]), strict=True)
        limit, change, _ = (np.where(along > 0, p, q) for p, q in each)
        x, most, fall = self.factor * along / limit, *self.lateral.values(v[0])[:2]
        dx = (self.factor * self.along[0] - x * change) / limit, self.factor * self.along[1] / limit
        y = self.factor * self.across * v[0] / most
        return (x, dx), (y, ((self.factor * self.across - y * fall) / most, 0.0))


def combined_of(limit: Ellipse, along: Any, across: Any, pace: Any) -> Combined:
    """Return the limit on the combined acceleration; `along` and `across` are the fields of `Combined`."""
    braking, accelerating, lateral = (curve_of(getattr(limit, name), pace) for name in FIELDS)
    upper = largest_squares(limit.lateral, across, pace)
    return Combined(np.stack(along), across, braking, accelerating, lateral, np.ones_like(pace), upper)
