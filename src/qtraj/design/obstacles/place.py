"""The centre of a ball of the body as exact polynomials and roots, and the numbers from which claims are made.

The position r of the path and its direction q are polynomials in u. The axes of the upright frame are τ = q/√S,
n = (ẑ×q)/√H and b = (S ẑ − q_z q)/√(SH), with S = q·q and H = q_x² + q_y². So the centre is r + O/W, where the weight W
and the components of the shift O are polynomials and roots: W is 1 without an offset, √S for an offset along τ, and
√(SH) for other offsets. Claims are multiplied by positive powers of W.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.surd import Surd
from qtraj.path.components import dot

Vector = Sequence[Any]


class Place(NamedTuple):
    """The centre r + `shift`/`weight` of a ball; see the module.

    `position` is r, and `time` is the time [s]. `shift` is None without an offset. `weight_sq` is W², and `length_sq`
    the square of the offset. `near` (k, 3) are centres in floats at the times `near_times` (k,), where the ball is near
    the obstacle.
    """

    position: Vector
    time: ExactPolynomial
    shift: Vector | None = None
    weight: Any = 1
    weight_sq: Any = 1
    length_sq: Any = 0
    near: Any = np.zeros((0, 3))
    near_times: Any = np.zeros(0)

    def relative(self, point: Vector) -> Vector:
        """Return r relative to a point."""
        return [p - x for p, x in zip(self.position, point, strict=True)]

    def weighted(self, relative: Vector) -> Vector:
        """Return W times the centre, for r relative to a point."""
        if self.shift is None:
            return relative
        return [self.weight * p + x for p, x in zip(relative, self.shift, strict=True)]

    def beyond(self, relative: Vector, square: Any) -> Any:
        """Return a positive multiple of the squared distance of the centre from a point, minus `square`."""
        away = dot(tuple(relative), tuple(relative)) - square
        if self.shift is None:
            return away
        return self.weight * (away + self.length_sq) + 2 * total(p * x for p, x in zip(relative, self.shift))  # noqa: B905


def placed(position: Vector, time: ExactPolynomial, direction: Vector | None, offset: Sequence[float]) -> Place:
    """Return the centre with an offset (3,) [m] in the axes of the upright frame."""
    if not any(offset) or direction is None:
        return Place(position, time)
    forward, left, up = (ExactPolynomial.of(x) for x in offset)
    x, y, z = direction
    H = x * x + y * y
    S = H + z * z
    squares = S, H
    length_sq = forward * forward + left * left + up * up
    if not (offset[1] or offset[2]):
        weight = Surd((0, 1, 0, 0), squares)
        return Place(position, time, [forward * p for p in direction], weight, S, length_sq)
    aside, above = (-y, x, ExactPolynomial([0])), (-1 * (z * x), -1 * (z * y), H)
    shift = [Surd((up * c, left * b, forward * a, 0), squares) for a, b, c in zip(direction, aside, above, strict=True)]
    return Place(position, time, shift, Surd((0, 0, 0, 1), squares), S * H, length_sq)


def quadratic(matrix: Sequence[Sequence[Any]], vector: Vector) -> Any:
    """Return xᵀ M x for a symmetric matrix."""
    squares = (matrix[i][i] * (vector[i] * vector[i]) for i in range(3))
    products = (2 * (matrix[i][j] * (vector[i] * vector[j])) for i, j in ((0, 1), (0, 2), (1, 2)))
    return total([*squares, *products])


def total(terms: Any) -> Any:
    """Return the sum of polynomials and roots."""
    first, *others = terms
    for x in others:
        first = first + x
    return first


def number(x: Any) -> ExactPolynomial:
    """Return a float, an integer or a dyadic fraction as a constant polynomial."""
    return ExactPolynomial.of(x)
