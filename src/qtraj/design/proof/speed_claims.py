"""Claims about limits that depend on the speed, for any arithmetic of polynomials.

Such a limit consists of lines between two speeds. For each line, the claim is that it is not exceeded, except where the
speed is outside of its range; all ranges together cover all speeds. Lines are multiplied by the width of their range,
so that no coefficient is rounded. The speed is the root of a polynomial, so the claims contain roots (see
`algebra.surd`).

With the velocity r' = w·q, let S = q·q. The longitudinal acceleration is a_τ = A/(d√S), and the lateral one a_n =
√(C/S).
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra import subdivision
from qtraj.algebra.combined_claims import AnyClaim, Except, all_of
from qtraj.algebra.cpu import inverse_root
from qtraj.algebra.exact import ExactPolynomial
from qtraj.algebra.sparse import is_zero, mul
from qtraj.algebra.surd import Claim, Surd
from qtraj.design.by_speed import BySpeed
from qtraj.design.ellipse import Ellipse, OfSpeed
from qtraj.path.quantity import quantity

Constant = Callable[[float, int], Any]
"""A function of a number and the negative exponent of the second in its unit, which returns a constant polynomial."""

EASY = 20_000
"""Number of additions of integers to find out whether the speed is always outside of a range."""


class Motion(NamedTuple):
    """The polynomials A (`along`), C (`across`) and S (`square`), the squared speed, and the integer d (`divisor`).

    The claims are about their values on [0, 1]. `claim` returns the claim that a number is nonnegative, whose roots are
    those of the squares in `Surd.squares`.
    """

    along: Any
    across: Any
    square: Any
    speed: Any
    divisor: int = 1
    claim: Callable[[Surd], AnyClaim] = Claim

    def outside(self, line: Line) -> list[Claim]:
        """Return the claims of which one is strictly true where the speed is outside of the range of a line."""
        below = [] if line.low is None else [Claim(line.low * line.low - self.speed)]
        return below if line.high is None else [*below, Claim(self.speed - line.high * line.high)]

    def needed(self, own: list[Line]) -> list[Line]:
        """Return the lines without those in whose ranges the speed never is, as far as this is easy to find out."""
        if not isinstance(self.speed, ExactPolynomial) or len(own) == 1:
            return own
        return [x for x in own if not any(subdivision.decide(y, True, EASY).proved for y in self.outside(x))]

    def at(self, line: Line) -> Surd:
        """Return the value of a line times its width at the speed."""
        return Surd((line.start, line.slope, 0, 0), (self.speed, self.speed))


class Line(NamedTuple):
    """The line (`start` + `slope`·v)/`width` from the speed `low` to the speed `high`, as constant polynomials.

    The ends are None if the range is unbounded; `speeds` are the ends as numbers.
    """

    start: Any
    slope: Any
    width: Any
    low: Any
    high: Any
    speeds: tuple[float, float]


def within(limit: OfSpeed, side: int, longitudinal: bool, m: Motion, constant: Constant) -> AnyClaim:
    """Return the claim that a limit is satisfied.

    `side` is −1 for a lower bound, and otherwise 1; `longitudinal` is whether a limit by speed bounds the longitudinal
    acceleration instead of the lateral one.
    """
    if isinstance(limit, Ellipse):
        each = (limit.braking, limit.accelerating, limit.lateral)
        return _combined(m, *(m.needed(lines(x, constant)) for x in each))
    own = m.needed(lines(limit, constant))
    return _longitudinal(m, own, side) if longitudinal else _lateral(m, own)


def compared(i: Any, name: str, limit: OfSpeed, units: tuple[Any, Any] = (1.0, 1.0)) -> tuple[Any, Any]:
    """Return the value of a quantity and its limit from invariants; `units` are those of speed and acceleration."""
    speed, inverse = i.v * i.pace * units[0], inverse_root(i.S) * units[1]
    if isinstance(limit, Ellipse):
        return limit.usage(i.B * inverse, i.root(i.N) * inverse, speed), np.ones_like(speed)
    return quantity(name).value(i) * units[1], np.asarray(limit.at(speed))


def lines(limit: BySpeed, constant: Constant) -> list[Line]:
    """Return the lines that a limit by speed consists of."""
    v, f = (np.asarray(x, float).tolist() for x in (limit.speeds, limit.values))
    ends = [*([(0.0, f[0])] if v[0] > 0 else []), *zip(v, f, strict=True), (np.inf, f[-1])]
    result: list[Line] = []
    for (low, first), (high, last) in pairwise(ends):
        if result and first == last and is_zero(result[-1].slope):  # the same constant
            low = result.pop().speeds[0]
        start, end = (None if x in (0.0, np.inf) else constant(x, 1) for x in (low, high))
        p, q = constant(first, 2), constant(last, 2)
        if first == last:
            result.append(Line(p, 0, 1, start, end, (low, high)))
        elif start is None:
            result.append(Line(p * end, q - p, end, start, end, (low, high)))
        else:
            result.append(Line(p * end - q * start, q - p, end - start, start, end, (low, high)))
    return result


def _longitudinal(m: Motion, own: list[Line], side: int) -> AnyClaim:
    d = side * m.divisor

    def claim(x: Line) -> AnyClaim:
        along = -side * mul(x.width, m.along)
        if m.speed is m.square:
            terms = along if is_zero(x.slope) else along + d * (x.slope * m.square), d * x.start, 0, 0
        else:
            terms = along, d * x.start, 0, 0 if is_zero(x.slope) else d * x.slope
        return Except(m.claim(Surd(terms, (m.square, m.speed))), m.outside(x))

    return all_of([claim(x) for x in own])


def _lateral(m: Motion, own: list[Line]) -> AnyClaim:
    def claim(x: Line) -> AnyClaim:
        value = m.at(x)
        number = value * value * m.square - mul(mul(x.width, x.width), m.across)
        return Except(m.claim(number), m.outside(x))

    return all_of([claim(x) for x in own])


def _combined(m: Motion, braking: list[Line], accelerating: list[Line], lateral: list[Line]) -> AnyClaim:
    """Return the claim for an ellipse."""
    claims = []
    square, across = m.divisor**2 * m.square, m.divisor**2 * m.across
    for direction, own in ((1, accelerating), (-1, braking)):
        other = Claim(-direction * m.along)
        for p in own:
            for q in lateral:
                if p.speeds[0] >= q.speeds[1] or q.speeds[0] >= p.speeds[1]:
                    continue
                x, y = (m.at(line) * m.at(line) for line in (p, q))
                used = y * mul(mul(p.width, p.width), m.along * m.along) + x * mul(mul(q.width, q.width), across)
                claims.append(Except(m.claim(x * y * square - used), [other, *m.outside(p), *m.outside(q)]))
    return all_of(claims)
