"""The pieces of a path R_z(φ)·(x, y, z) whose x, y, z and φ are polynomials, such as a spiral-helix.

In each cell, φ differs little from its value in the middle, and its cosine and sine are replaced by Taylor polynomials.
Their remainders, and small terms that are left out, are bounded; the bounds are part of the pieces.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.exact import ExactPolynomial
from qtraj.design.obstacles.cosines import cos_and_sin, taylor
from qtraj.design.obstacles.piece import Piece
from qtraj.design.obstacles.place import Vector
from qtraj.path.hodograph import AbstractHodograph

HALF = Fraction(1, 8)
"""Largest difference of the angle from its value in the middle of a cell [rad]."""

MOST_CELLS = 1 << 16
"""A path with more cells has no pieces."""

BITS = 64
"""Bits of the largest coefficient of a polynomial that are kept."""

FINE = 100
"""Bits after the binary point of the direction cosines of a placement."""

W = ExactPolynomial([-1, 2])
"""The variable w of a cell, −1 ≤ w ≤ 1, as a function of the fraction."""


class _Path(NamedTuple):
    """The polynomials x, y, z and φ of the fraction u, the matrix and the origin of the placement, and the duration."""

    x: ExactPolynomial
    y: ExactPolynomial
    z: ExactPolynomial
    angle: ExactPolynomial
    matrix: list[list[Fraction]]
    origin: list[float]
    duration: float


def turning_pieces(path: AbstractHodograph, turns: bool) -> list[Piece] | None:
    """Return the pieces of one path with concrete values; None if it is not polynomial, or has too many turns."""
    found = path.polynomials()
    if found is None:
        return None
    h = float(np.asarray(path.duration))

    def exact(c: Any) -> ExactPolynomial:
        return ExactPolynomial([0]) if c is None else ExactPolynomial.from_floats(np.asarray(c, float)).substituted(h)

    matrix, origin = _placement(found.placement)
    own = _Path(exact(found.x), exact(found.y), exact(found.z), exact(found.angle), matrix, origin, h)
    pieces, cells = [], [(0.0, 1.0)]
    while cells:
        start, end = cells.pop()
        piece = _piece(own, start, end, turns)
        if piece is not None:
            pieces.append(piece)
            continue
        if len(cells) + len(pieces) > MOST_CELLS or end - start < 2.0**-40:
            return None
        middle = 0.5 * (start + end)
        cells += [(middle, end), (start, middle)]
    return pieces


def _piece(p: _Path, start: float, end: float, turns: bool) -> Piece | None:
    """Return the piece between two fractions; None if the angle changes too much."""
    middle = 0.5 * (start + end)
    x, y, z, angle = (c.restricted(middle, end) for c in p[:4])
    centre = float(ExactPolynomial([angle.numbers[0]], angle.exponent).floats()[0])
    change = angle - centre
    size = _bound(change)
    if size > HALF:
        return None
    cos, sin, error = cos_and_sin(centre)
    c, s, remainder = taylor(change, size)
    cos0, sin0 = ExactPolynomial.of(cos), ExactPolynomial.of(sin)
    factor = cos0 * c - sin0 * s, sin0 * c + cos0 * s
    # Each of cos and sin differs by at most e = error + remainder + error·remainder times 2; a vector by √2 as much.
    wrong = _up(3 * (error + remainder + error * remainder))
    position, position_error = _in_world(p.matrix, factor, (x, y, z), wrong)
    position = [a + b for a, b in zip(position, p.origin, strict=True)]
    time = ExactPolynomial.of(p.duration) * (ExactPolynomial.of(start) + _line(start, end))
    report = lambda u: p.duration * (start + (end - start) * u)  # noqa: E731
    direction, tilt = None, None
    if turns:
        rate = angle.derivative()
        velocity = x.derivative() - rate * y, y.derivative() + rate * x, z.derivative()
        direction, own = _in_world(p.matrix, factor, velocity, wrong)
        direction = [v.composed(W) for v in direction]
        tilt = _tilt(direction, own)
    return Piece([v.composed(W) for v in position], direction, time, report, position_error, tilt)


def _line(start: float, end: float) -> ExactPolynomial:
    return (ExactPolynomial.of(end) - ExactPolynomial.of(start)) * ExactPolynomial([0, 1])


def _in_world(matrix: list[list[Fraction]], factor: Any, local: Any, wrong: Fraction) -> tuple[Vector, Fraction]:
    """Return R·(rotated vector) with short polynomials, and a bound on the error of its length."""
    (c, s), (x, y, z) = factor, local
    size = _bound(x) + _bound(y) + _bound(z)
    rotated = c * x - s * y, s * x + c * y, z
    error, found = size * wrong, []
    for row in matrix:
        own: Any = ExactPolynomial([0])
        for m, v in zip(row, rotated, strict=True):
            if m:
                own = own + ExactPolynomial.of(m) * v
        short, left_out = _shortened(own)
        found.append(short)
        error += left_out + 3 * size * Fraction(1, 1 << (FINE - 1))
    return found, _up(error)


def _shortened(p: ExactPolynomial) -> tuple[ExactPolynomial, Fraction]:
    """Return the polynomial with rounded coefficients, without tiny ones, and a bound on the change for |w| ≤ 1."""
    largest = max(max(p.numbers), -min(p.numbers))
    shift = largest.bit_length() - BITS
    if shift <= 0:
        return p, Fraction(0)
    numbers = [x >> shift for x in p.numbers]
    while len(numbers) > 1 and numbers[-1] in (0, -1):
        numbers.pop()
    changed = sum(abs((numbers[k] << shift) - x) if k < len(numbers) else abs(x) for k, x in enumerate(p.numbers))
    return ExactPolynomial(numbers, p.exponent + shift), _scaled(changed, p.exponent)


def _tilt(direction: Vector, error: Fraction) -> Fraction | None:
    """Return a bound on the errors of the axes of the upright frame; None if the direction may vanish or be vertical.

    If a vector v is wrong by e, its direction is wrong by at most 2e/|v|.
    """
    x, y, z = direction
    level = x * x + y * y
    least, least_level = _lowest(level + z * z), _lowest(level)
    if least <= 0 or least_level <= 0:
        return None
    along, aside = (2 * error / _root_below(v) for v in (least, least_level))
    return _up(along + aside + along * aside)


def _lowest(p: ExactPolynomial) -> Fraction:
    """Return a lower bound on [0, 1], the smallest Bernstein coefficient."""
    n = len(p.numbers) - 1
    return min(
        sum((Fraction(math.comb(i, k) * x, math.comb(n, k)) for k, x in enumerate(p.numbers[: i + 1])), Fraction(0))
        for i in range(n + 1)
    ) * _scaled(1, p.exponent)


def _root_below(x: Fraction) -> Fraction:
    """Return a positive number that is not larger than √x, for x > 0."""
    bits = 64 + max(0, x.denominator.bit_length() - x.numerator.bit_length())
    return Fraction(math.isqrt((x.numerator << 2 * bits) // x.denominator), 1 << bits)


def _bound(p: ExactPolynomial) -> Fraction:
    """Return a bound on |p| for |w| ≤ 1."""
    return _scaled(sum(map(abs, p.numbers)), p.exponent)


def _scaled(x: int, exponent: int) -> Fraction:
    return Fraction(x << exponent) if exponent >= 0 else Fraction(x, 1 << -exponent)


def _up(x: Fraction) -> Fraction:
    """Return a dyadic number that is not smaller than a positive one."""
    if not x:
        return x
    bits = 32 + max(0, x.denominator.bit_length() - x.numerator.bit_length())
    return Fraction(-((-x.numerator << bits) // x.denominator), 1 << bits)


def _placement(placement: Any) -> tuple[list[list[Fraction]], list[float]]:
    """Return the direction cosines from the path's axes to the world, rounded to `FINE` bits, and the origin."""
    if placement is None:
        return [[Fraction(int(i == j)) for j in range(3)] for i in range(3)], [0.0, 0.0, 0.0]
    w, x, y, z = (Fraction(v) for v in np.asarray(placement.orientation, float).tolist())
    size = w * w + x * x + y * y + z * z
    rows = [
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ]
    unit = 1 << FINE
    rounded = [[Fraction(round(v / size * unit), unit) for v in row] for row in rows]
    return rounded, np.asarray(placement.origin, float).tolist()
