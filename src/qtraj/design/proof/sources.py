"""The data of a proof: paths as polynomials in u = t/duration, in exact integers, in bounded floats, and as values.

All derivatives are with respect to u. In floats the unit of length is a power of two near the size of the path, so that
polynomials of high degree do not overflow. In this *moving basis* (see `path.moving_basis`) the components of every
derivative are polynomials.
"""

from __future__ import annotations

import abc
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from qtraj.algebra.bounded import BoundedPolynomial
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.polynomial import horner, taylor_terms
from qtraj.algebra.sparse import add, is_zero, mul, sub
from qtraj.path.components import Triple, rotated_z
from qtraj.path.moving_basis import in_moving_basis
from qtraj.path.path_quantity import PathQuantity

Columns = Float[np.ndarray, " n"]
Instants = Float[np.ndarray, "k n"]


class Derivatives(NamedTuple):
    """Derivatives of r with respect to u: `rows[k]` is the k-th, a triple; `rows[0]` is None without the position.

    `rows[1]` may be a vector in the direction of the velocity; `pace` is then the velocity divided by this vector, and
    otherwise the integer 1. `up` is the vertical; None means the third axis. If `span` is not the integer 1, it is the
    duration, and the derivatives are with respect to the time: powers of the duration would make the coefficients of
    exact polynomials long.
    """

    rows: list[Any]
    pace: Any = 1
    up: Any = None
    span: Any = 1


class Source(abc.ABC):
    """A batch of n paths. `duration` (n,) is in s, and `length` (n,) is the unit of length [m]."""

    duration: Columns
    length: Columns

    @property
    def count(self) -> int:
        """The number of paths."""
        return len(self.duration)

    @property
    def in_world(self) -> bool:
        """Whether the derivatives are in world axes."""
        return True

    @abc.abstractmethod
    def provable(self, upright: bool) -> Bool[np.ndarray, " n"]:
        """Return for which paths limits can be proved; `upright` indicates formulas with the vertical."""

    @abc.abstractmethod
    def at(self, u: Instants, order: int) -> Derivatives:
        """Return the derivatives up to `order` at the fractions `u` of the durations, in floats."""

    def bounded(self, order: int) -> Derivatives | None:
        """Return the derivatives up to `order` of all paths as `BoundedPolynomial`s, or None if there are none."""
        return None

    def exact(self, k: int, order: int) -> Derivatives:
        """Return the derivatives up to `order` of path k as `ExactPolynomial`s, in metres; see `Derivatives.span`."""
        raise ValueError(f"path {k} is not polynomial")

    def proves(self, entry: PathQuantity) -> bool:
        """Return whether the polynomials of a quantity are known."""
        return not entry.of_world

    def positioned(self) -> Source:
        """Return the source whose derivatives contain the position, or its height, if it is known."""
        return self


class PolynomialSource(Source):
    """Paths R_z(φ)·(x, y, z), where x, y, z and φ are polynomials in the time t; `y` and `angle` may be None for zero.

    The coefficients (terms, n) are in ascending order. `vertical` (n, 3) is the vertical in the axes of the placement;
    None means the third axis. Positions are relative to `origin` (3,) or (n, 3), in world axes; None is zero.
    """

    def __init__(
        self,
        x: Float[np.ndarray, "_ n"],
        y: Float[np.ndarray, "_ n"] | None,
        z: Float[np.ndarray, "_ n"],
        angle: Float[np.ndarray, "_ n"] | None,
        duration: Columns,
        vertical: Float[np.ndarray, "n 3"] | None = None,
        origin: Float[np.ndarray, "*n 3"] | None = None,
    ):
        self.duration, self.vertical = duration, vertical
        self._azimuth = 0.0 if angle is None else angle[0]
        # No derivative depends on the initial height or azimuth, nor, without rotation, on the initial position.
        plane = [x, y] if angle is not None else [_without_first(x), _without_first(y)]
        self._given = [*plane, _without_first(z), _without_first(angle)]
        with np.errstate(all="ignore"):
            scaled = [None if c is None else c * powers(duration, len(c)) for c in self._given]
            sizes = [np.abs(c).max(axis=0) for c in scaled[:3] if c is not None]
            self.length = power_of_two(np.max(sizes, axis=0))
            self._scaled = [None if c is None else c / self.length for c in scaled[:3]] + scaled[3:]
        self._in_world, self._whole, self._position = angle is None and vertical is None, (x, y, z), False
        self._origin = np.broadcast_to(np.zeros(3) if origin is None else np.asarray(origin, float), (self.count, 3)).T

    @property
    def in_world(self) -> bool:
        """Whether the derivatives are in world axes."""
        return self._in_world

    def proves(self, entry: PathQuantity) -> bool:
        """Return whether the path is polynomial in world axes if the quantity is computed from components in them."""
        return self._in_world or entry.own is None or not entry.own.world

    def positioned(self) -> PolynomialSource:
        """Return the same source with the position; of paths that are not in world axes, only its height is right."""
        self._position = True
        return self

    def provable(self, upright: bool) -> Bool[np.ndarray, " n"]:
        """Return all paths, or for formulas with the vertical the paths whose axis is vertical."""
        if not upright or self.vertical is None:
            return np.ones(self.count, bool)
        return (self.vertical[:, 0] == 0) & (self.vertical[:, 1] == 0)

    def at(self, u: Instants, order: int) -> Derivatives:
        """Return the derivatives in the moving basis at `u`; the zeroth derivative is not complete."""
        x, y, z, angle = ([0] * (order + 1) if c is None else taylor_terms([*c], u, order) for c in self._scaled)
        rows = in_moving_basis(x, y, z, angle)
        zero = np.zeros_like(u)
        rows = [None, *(tuple(zero if is_zero(c) else c + zero for c in row) for row in rows[1:])]
        up = self._up(u)
        if self._position:
            own, origin = self._scaled_position()
            if not self._in_world:
                origin = [x * origin[2] for x in up or (0.0, 0.0, 1.0)]
            rows[0] = tuple(horner([*c], u) + zero + x for c, x in zip(own, origin, strict=True))  # type: ignore[call-overload]
        return Derivatives(rows, up=up)

    def bounded(self, order: int) -> Derivatives:
        """Return the derivatives as bounded polynomials, with the units `length` and `duration`."""
        x, y, z, angle = (0 if c is None else BoundedPolynomial(c, k=2 * len(c) + 2) for c in self._scaled)
        signs = self._signs()
        rows = moving_derivatives(x, y, z, angle, order)
        if np.any(signs < 0):
            rows = [None, *((r[0], _signed(r[1], signs), _signed(r[2], signs)) for r in rows[1:])]
        if self._position:
            x, y, z = (
                BoundedPolynomial(c, k=2 * len(c) + 2) + BoundedPolynomial.constant(shift, k=1)
                for c, shift in zip(*self._scaled_position(signs), strict=True)
            )
            rows[0] = x, y, z
        return Derivatives(rows)

    def exact(self, k: int, order: int) -> Derivatives:
        """Return the derivatives of path k as exact polynomials in the time, from the stored coefficients."""
        x, y, z, angle = (0 if c is None else ExactPolynomial.from_floats(c[:, k]) for c in self._given)
        rows = moving_derivatives(x, y, z, angle, order)
        sign = self._signs()[k]
        if sign < 0:
            rows = [None, *((r[0], -r[1], -r[2]) for r in rows[1:])]
        if self._position:
            x, y, z = (ExactPolynomial.from_floats(c[:, k]) for c in self._axes())
            own = x, y, z if sign > 0 else -z
            rows[0] = tuple(p + float(shift) for p, shift in zip(own, self._origin[:, k], strict=True))
        return Derivatives(rows, span=float(self.duration[k]))

    def _axes(self) -> list[Float[np.ndarray, "_ n"]]:
        """Return the coefficients of the position relative to the origin, in the axes of the placement."""
        return [np.zeros((1, self.count)) if c is None else c for c in self._whole]

    def _scaled_position(self, signs: Any = 1.0) -> tuple[list[Float[np.ndarray, "_ n"]], list[Any]]:
        """Return the same in the units `length` and `duration`, the third with `signs`, and the origin (3, n)."""
        x, y, z = (c * powers(self.duration, len(c)) / self.length for c in self._axes())
        return [x, y, signs * z], [*(self._origin / self.length)]

    def _signs(self) -> np.ndarray:
        """Return −1 where the axis points down: a half turn about x makes the third axis point up."""
        return np.ones(self.count) if self.vertical is None else np.where(self.vertical[:, 2] < 0, -1.0, 1.0)

    def _up(self, u: Instants) -> Triple | None:
        """Return the vertical in the moving basis."""
        if self.vertical is None:
            return None
        zero, change = np.zeros_like(u), self._scaled[3]
        angle = self._azimuth + (zero if change is None else taylor_terms([*change], u, 0)[0])
        return tuple(c + zero for c in rotated_z(tuple(self.vertical.T), np.cos(angle), -np.sin(angle)))


def polynomial_source(
    x: np.ndarray,
    y: Any,
    z: np.ndarray,
    angle: np.ndarray,
    duration: np.ndarray,
    orientation: np.ndarray,
    origin: np.ndarray,
) -> PolynomialSource:
    """Return the source of n paths from coefficients (n, terms), orientations (n, 4) and origins (n, 3)."""
    y = None if y is None else y.T
    return PolynomialSource(x.T, y, z.T, angle.T, duration, _local_vertical(orientation), origin)


def _local_vertical(q: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, "n 3"] | None:
    """Return the world's vertical in the axes of placements, exactly (0, 0, ±1) for a vertical axis; None if all are.

    None is returned if all axes point up.
    """
    w, x, y, z = q.T
    vertical = np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z], axis=-1)
    vertical /= np.sum(q * q, axis=-1)[:, None]
    vertical[(x == 0) & (y == 0)] = 0.0, 0.0, 1.0
    vertical[(w == 0) & (z == 0)] = 0.0, 0.0, -1.0
    return None if np.all(vertical == [0.0, 0.0, 1.0]) else vertical


def moving_derivatives(x: Any, y: Any, z: Any, angle: Any, order: int) -> list[Any]:
    """Return the derivatives up to `order` of R_z(φ)·(x, y, z) in the moving basis.

    The derivative of the vector with the components a, b, c is (a' − φ'b, b' + φ'a, c').
    """
    rate, row, rows = _slope(angle), (x, y, z), [None]
    for _ in range(order):
        a, b, c = row
        row = sub(_slope(a), mul(rate, b)), add([_slope(b), mul(rate, a)]), _slope(c)
        rows.append(row)  # type: ignore[arg-type]
    return rows


def _slope(p: Any) -> Any:
    return 0 if is_zero(p) else p.derivative()


def _signed(p: BoundedPolynomial, signs: np.ndarray) -> BoundedPolynomial:
    return BoundedPolynomial(p.c * signs, p.m, p.k)


def _without_first(c: np.ndarray | None) -> Any:
    if c is None:
        return None
    c = c.copy()
    c[0] = 0.0
    return c


def powers(h: Columns, count: int) -> Float[np.ndarray, "count n"]:
    """Return the powers of h of orders 0 … count − 1, each computed by at most `count` multiplications."""
    powers = [np.ones_like(h)]
    for _ in range(count - 1):
        powers.append(powers[-1] * h)
    return np.stack(powers)


def power_of_two(size: Columns) -> Columns:
    """Return the largest power of two that does not exceed `size`, or 1 if `size` is not positive and finite."""
    fine = (size > 0) & np.isfinite(size)
    return np.where(fine, np.ldexp(0.5, np.frexp(np.where(fine, size, 1.0))[1]), 1.0)
