"""Compute constraints on a = u̇² and its derivatives at nodes of a path, with one function for each kind of limit.

The names follow `constraints`: upper bounds on a, quadratic forms, functions at most 1, and the form of the jerk.
"""

import functools
from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.one_sided import scale_and_shift
from qtraj.design.timing import forms
from qtraj.design.timing.by_speed import Curve, largest_squares, side_by_speed
from qtraj.design.timing.road import LOADS
from qtraj.design.timing.sided import RATES, SIDED, SIDES_OF_RATES, row
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.components import dot
from qtraj.path.frenet import Invariants, yaw
from qtraj.path.quantity import quantity

UPPER = ("speed", "lateral_acceleration", *RATES, *SIDES_OF_RATES, "angular_rate")
"""Limits that are upper bounds on a = u̇²."""

FORMS = ("longitudinal_acceleration", "yaw_acceleration", "vertical_acceleration", "acceleration")
"""Limits on quantities whose squares are quadratic forms in a = u̇² and a' = da/du."""


class AtNodes:
    """The path at nodes: its invariants, the direction of motion, and coefficients of accelerations.

    `r` (3, 3, *nodes) are the first three derivatives; derivatives of a are with respect to u/`unit`. |r'|² up to
    `still` counts as zero. There, the direction is that of r'', in which the motion starts, or against which it ends if
    `before_stop`. A pair of coefficients (p, q) stands for p·a + q·a'.
    """

    def __init__(self, r: Float[Any, "3 3 *nodes"], unit: Scalar, before_stop: Any, still: Any, xp: Any):
        r1, r2, r3 = (tuple(x) for x in r)
        self.r2, self.r3, self.xp, self.half = r2, r3, xp, 0.5 / unit
        self.i = Invariants([None, r1, r2, r3])
        self.moving = still < self.i.S
        self.inv_speed = inverse_root(xp.where(self.moving, self.i.S, 0.0))
        self.ahead, self.inv_ahead, self.has_direction = r1, self.inv_speed, self.moving
        if xp is not np or not self.moving.all():
            turned = (xp.where(before_stop, -x, x) for x in r2)
            self.ahead = tuple(xp.where(self.moving, p, q) for p, q in zip(r1, turned, strict=True))
            self.inv_ahead, self.has_direction = inverse_root(dot(self.ahead, self.ahead)), dot(*2 * [self.ahead]) > 0

    @functools.cached_property
    def along(self) -> tuple[Any, Any]:
        """The coefficients of the acceleration along the path."""
        return dot(self.ahead, self.r2) * self.inv_ahead, self.half * self.i.v

    @functools.cached_property
    def turning(self) -> tuple[Any, Any]:
        """The coefficients of the yaw acceleration."""
        rate, growth = yaw(self.i, self.inv_speed, inverse_root(self.xp.where(self.moving, self.i.H, 0.0)))
        return growth, self.half * rate

    @functools.cached_property
    def climbing(self) -> tuple[Any, Any]:
        """The coefficients of the vertical acceleration."""
        return self.i.W, self.half * self.i.V

    @functools.cached_property
    def across(self) -> Any:
        """The coefficient of a in the lateral acceleration."""
        return self.xp.where(self.moving, self.xp.sqrt(self.i.N / self.xp.where(self.i.S > 0, self.i.S, 1.0)), 0.0)

    def stacked(self, rows: list[Any], shape: tuple[int, ...]) -> Any:
        """Return the rows as one array; each row has the axes `shape` before those of the nodes."""
        xp = namespace(self.i.S, *rows)
        return xp.stack(rows) if rows else xp.zeros((0, *shape, *self.i.S.shape), self.i.S.dtype)


def of_forms(at: AtNodes, bounds: dict[str, Any]) -> Float[Any, "forms 2 2 *nodes"]:
    """Return the matrices of the quadratic forms that are limited, in the order of `FORMS`."""
    rows = [at.xp.stack(_form(at, name)) / bounds[name] ** 2 for name in FORMS if name in bounds]
    return at.stacked([forms.symmetric(x) for x in rows], (2, 2))


def _form(at: AtNodes, name: str) -> tuple[Any, Any, Any]:
    """Return the entries (aa, ab, bb) of one of `FORMS`."""
    match name:
        case "longitudinal_acceleration":
            return forms.square(*at.along)
        case "yaw_acceleration":
            return forms.square(*at.turning)
        case "vertical_acceleration":
            return forms.square(*at.climbing)
        case _:
            return forms.squared_norm(at.i, at.half)


def of_sides(
    at: AtNodes, bounds: dict[str, Any], by_speed: dict[str, Any], load: tuple[Any, Any]
) -> tuple[Float[Any, "sides 3 *nodes"], list[Curve | None]]:
    """Return the coefficients of the limits on one side, in the order of `SIDED`, and the curves of those by speed.

    `load` are the coefficients of 1 and of a in the load.
    """
    rows, curves = [], []
    for name in SIDED:
        if name not in bounds and name not in by_speed:
            continue
        value, known = _side(at, name, load[1])
        if name in by_speed:
            affine, curve = side_by_speed(by_speed[name], quantity(name).side, value, at.i.v)
            curves.append(curve.scaled(known))
        else:
            affine = row(name, value, bounds, load[0] if name in LOADS else 0.0)
            curves.append(None)
        rows.append(at.xp.where(known[None], at.xp.stack(affine), 0.0))
    return at.stacked(rows, (3,)), curves


def _side(at: AtNodes, name: str, load: Any) -> tuple[tuple[Any, Any], Any]:
    """Return the coefficients of a and a' in the quantity of one of `SIDED`, and where they are known.

    Where r' = 0, the acceleration of the yaw is unknown, and that along the path and the load without r'', too.
    """
    if name in LOADS:
        return (load, 0.0 * at.i.S), at.has_direction
    base = quantity(name).base
    if base == "longitudinal_acceleration":
        return at.along, at.has_direction
    if base == "yaw_acceleration":
        return at.turning, at.moving
    if base == "vertical_acceleration":
        return at.climbing, at.i.S >= 0
    return (at.i.S, 0.0 * at.i.S), at.moving


def of_jerk(at: AtNodes, bounds: dict[str, Any], second: Scalar) -> Float[Any, "1 3 3 *nodes"] | None:
    """Return the matrix of the squared jerk divided by a, or None without a limit; `second` is the factor of r'·a''."""
    if "jerk" not in bounds:
        return None
    i, half = at.i, at.half
    level = i.J, 3 * half * dot(at.r2, at.r3), 9 * half * half * i.A
    entries = at.xp.stack([*level, second * i.C, 3 * half * second * i.B, second**2 * i.S])
    return forms.symmetric(entries / bounds["jerk"] ** 2)[None]


def of_upper(at: AtNodes, bounds: dict[str, Any], by_speed: dict[str, Any]) -> Float[Any, "uppers *nodes"]:
    """Return 1/a for the largest a that satisfies each limit of `UPPER`."""
    rows = []
    for name in UPPER:
        if name in bounds:
            rows.append(_upper(name, at.i, bounds, at.moving))
        elif name in by_speed:
            rows.append(largest_squares(by_speed[name], at.across, at.i.v))
    return at.stacked(rows, ())


def _upper(name: str, i: Any, bounds: dict[str, Scalar], moving: Any) -> Any:
    """Return 1/a for the largest a = u̇² that satisfies the limit; the quantity is proportional to √a^`per_time`."""
    given, bound = quantity(name), bounds[name]
    entry = quantity(given.base) if given.base else given
    xp, square = namespace(moving, bound, i.S), entry.numerator(i)
    if given.base:  # negative on the other side
        square, bound = square * xp.sign(given.side * given.numerator(i)), scale_and_shift(name, bounds)[0]
    if entry.denominator is not None:
        # Where the divisor is zero, the path is straight or vertical, and the numerator is zero, too.
        divisor = entry.denominator(i)
        square = xp.where(divisor > 0, square / xp.where(divisor > 0, divisor, 1.0), 0.0)
    square = xp.where(moving, square, 0.0) / bound / bound  # the square of an infinite bound has no derivative
    if entry.per_time == 1:
        return square
    return xp.where(square > 0, xp.sqrt(xp.where(square > 0, square, 1.0)), 0.0)


def inverse_root(x: Any) -> Any:
    """Return 1/√x, or 0 where x is not positive."""
    xp = namespace(x)
    return xp.where(x > 0, 1 / xp.sqrt(xp.where(x > 0, x, 1.0)), 0.0)
