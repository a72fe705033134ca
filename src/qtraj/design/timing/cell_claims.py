"""Express limits on a timing as claims about polynomials in the cells: limit² · denominator − numerator is at least 0.

The motion has the velocity √a r', the acceleration a r'' + ½ a' r' and the jerk √a (a r''' + 3/2 a' r'' + ½ a'' r')
(see `constraints`); the formulas contain their doubles. Quantities that depend on the direction of the path are
computed from the factor q of r' (see `directions`), because q does not vanish where a segment starts or ends at a stop.

The formulas of `contact` apply to q and to the doubled acceleration, with doubled gravity and drag. With S = q·q and
r' = w·q, they contain the squared speed w² a S only in the drag. Let the drive power be w√a·P. Then the limit on the
power is satisfied if P ≤ 0 or w² a P² ≤ limit².
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

from qtraj.algebra.combined_claims import AnyClaim, all_of, any_of
from qtraj.algebra.sparse import is_zero
from qtraj.algebra.surd import Claim, Surd
from qtraj.design.ellipse import OfSpeed
from qtraj.design.proof import speed_claims
from qtraj.design.proof.limit_claims import DIVISORS, RoadInvariants
from qtraj.design.timing.cell_motions import Motion
from qtraj.design.timing.constraints import UPPER
from qtraj.design.timing.own_claims import OwnClaims
from qtraj.design.timing.road import LOADS, POWER_SIDES, ROAD
from qtraj.design.timing.roots import Enclosed, Root, at_bounds
from qtraj.design.timing.sided import SIDED, SIDES_OF_RATES, SLOWEST
from qtraj.path.components import cross, dot
from qtraj.path.contact import power_numerator
from qtraj.path.frenet import Invariants
from qtraj.path.own_name import OwnName
from qtraj.path.path_quantity import ROAD_FRAME
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters

OF_PATH = ("speed", "vertical_speed", "curvature_rate")
"""Quantities that need the velocity of the path itself, not only its direction."""

THIRD = ("jerk", "yaw_acceleration", "curvature_rate", "angular_rate")
"""Quantities that contain the third derivative of the path; all others need two derivatives."""


class CellClaims:
    """The claims about a motion; the parameters of `vehicle` are constant polynomials in the units of the motion."""

    def __init__(self, motion: Motion, vehicle: RoadParameters | None, constant: Callable[[Any], Any] | None = None):
        """Store the motion; `constant` converts a number to a polynomial in the formulas of the user.

        `roots` and `speed_roots` may be set to enclosures of √S, √H and √a, and of √S and √S a.
        """
        self.motion, self._vehicle = motion, vehicle
        self.own = OwnClaims(motion, vehicle, constant or (lambda x: x))
        self.roots: Sequence[Root] | None = None
        self.speed_roots: Sequence[Root] | None = None
        self._real = Invariants([None, *motion.path])
        self._own = self._real if motion.ahead is motion.path else Invariants([None, *motion.ahead])

    def squares(self) -> tuple[Any, Any, Any]:
        """Return the squares S, H and a of the `roots`."""
        return self._own.S, self._level_square(), self.motion.a

    def forward(self) -> Claim:
        """Return a = u̇², without its zero at an end at rest; it must be positive."""
        return Claim(self.motion.rest)

    def divisor(self, name: str) -> Claim:
        """Return the divisor with this name (see `limit_claims.DIVISORS`); it must be positive."""
        return Claim(self._level_square() if name == ROAD_FRAME else getattr(self._own, DIVISORS[name]))

    def _level_square(self) -> Any:
        """Return H in the formulas of `contact`."""
        return Invariants([None, self._own.r[1]], vehicle=self._vehicle).on_road.H

    def within(self, name: str, limit: Any, allows_zero: bool = True) -> AnyClaim:
        """Return the claim that a quantity satisfies its `limit`, a constant polynomial.

        `allows_zero` is whether the limit on one side of a signed value is satisfied by zero.
        """
        if isinstance(name, OwnName):
            return self.own.within(quantity(name), limit)
        if name in (*ROAD, *POWER_SIDES):
            return self._road(name, limit, allows_zero)
        if name in LOADS:
            return self._load(quantity(name).side, limit)
        if name in SIDES_OF_RATES:
            return self._side_of_rate(name, limit, allows_zero)
        return Claim(self._side(name, limit) if name in SIDED else self._slack(name, limit * limit))

    def within_speed(self, name: str, limit: OfSpeed, constant: Callable[[float, int], Any]) -> AnyClaim:
        """Return the claim that a `limit` is satisfied that depends on the speed."""
        m, i = self.motion, self._own
        across = cross(i.r[1], self._real.r[2])
        lateral = dot(across, across) * (m.a * m.a)
        speed = self._real.S * m.a
        claim = Claim if self.speed_roots is None else self._enclosed
        motion = speed_claims.Motion(self._along(), lateral, i.S, speed, 2, claim)
        return speed_claims.within(limit, quantity(name).side, name.startswith("longitudinal"), motion, constant)

    def speed_squares(self) -> tuple[Any, Any]:
        """Return the squares S and r'·r' a of the `speed_roots`."""
        return self._own.S, self._real.S * self.motion.a

    def _enclosed(self, number: Surd) -> AnyClaim:
        """Return the claim that a number is nonnegative that contains roots of `speed_squares`."""
        square, speed = self.speed_roots  # pyright: ignore[reportGeneralTypeIssues]
        own = [square if number.squares[0] is self._own.S else speed, speed]
        used = [root for k, root in enumerate(own) if not (is_zero(number.terms[k + 1]) and is_zero(number.terms[3]))]
        return Enclosed(at_bounds(number, own), used) if used else Claim(number)

    def _side(self, name: str, limit: Any) -> Any:
        """Return a number that is not negative if a limit on one side is satisfied."""
        i, side = self._own, quantity(name).side
        if name == SLOWEST:
            return self._real.S * self.motion.a - limit * limit
        if name.startswith("vertical"):
            return 2 * side * limit - side * self._doubled_vertical()
        if name.startswith("longitudinal"):
            return Surd((-side * self._along(), 2 * side * limit, 0, 0), (i.S, i.H))
        return Surd((-side * self._turning(), 0, 0, 2 * side * limit * (i.S * i.H)), (i.S, i.H))

    def _side_of_rate(self, name: str, limit: Any, allows_zero: bool) -> AnyClaim:
        """Return the claim that the path turns or climbs to the other side, or that the rate is small enough.

        If the limit does not allow zero, the claim is that it does so, and that the rate is large enough.
        """
        entry = quantity(name)
        other_side = Claim(-entry.side * entry.numerator(self._rows(entry.base)))
        slack = self._slack(entry.base, limit * limit)
        return (any_of if allows_zero else all_of)([other_side, Claim(slack if allows_zero else -slack)])

    def _rows(self, name: str) -> Invariants:
        """Return the invariants of a quantity that is proportional to a power of the speed."""
        return self._real if name in OF_PATH else self._own

    def _doubled_vertical(self) -> Any:
        """Return twice the vertical acceleration."""
        return 2 * (self._real.W * self.motion.a) + self._real.V * self.motion.slope

    def _along(self) -> Any:
        """Return twice the acceleration in the direction of q, times |q|."""
        m = self.motion
        return 2 * (dot(self._own.r[1], self._real.r[2]) * m.a) + self._times_factor(self._own.S * m.slope)

    def _turning(self) -> Any:
        """Return twice the yaw acceleration times √(SH)³."""
        i, m = self._own, self.motion
        SH = i.S * i.H
        growth = i.P1 * SH - i.P * (i.B * i.H + i.S * i.G)
        return 2 * (growth * m.a) + (i.P * SH) * m.slope

    def _slack(self, name: str, bound: Any) -> Any:
        m, real, i, a = self.motion, self._real, self._own, self.motion.a
        if name == "lateral_acceleration":
            across = cross(i.r[1], real.r[2])
            return bound * i.S - dot(across, across) * (a * a)
        if name in UPPER:
            entry, own = quantity(name), self._rows(name)
            numerator = entry.numerator(own) * a
            return (bound if entry.denominator is None else bound * entry.denominator(own)) - numerator
        if name == "longitudinal_acceleration":
            along = self._along()
            return 4 * (bound * i.S) - along * along
        if name == "vertical_acceleration":
            vertical = self._doubled_vertical()
            return 4 * bound - vertical * vertical
        if name == "acceleration":
            return 4 * bound - dot(*2 * [self._doubled()])
        if name == "jerk":
            rows = zip(real.r[3], real.r[2], real.r[1], strict=True)
            double = tuple(2 * (p * a) + 3 * (q * m.slope) + x * m.bend for p, q, x in rows)
            return 4 * bound - a * dot(double, double)
        SH, turning = i.S * i.H, self._turning()
        return 4 * (bound * (SH * (SH * SH))) - turning * turning

    def _doubled(self) -> tuple[Any, ...]:
        """Return twice the acceleration."""
        m, real = self.motion, self._real
        return tuple(2 * (p * m.a) + q * m.slope for p, q in zip(real.r[2], real.r[1], strict=True))

    def _times_factor(self, p: Any) -> Any:
        return p if self._real is self._own else self.motion.factor * p

    @cached_property
    def _pace(self) -> Any:
        """The squared pace u̇² of the path, whose derivative is q."""
        return self._times_factor(self._times_factor(self.motion.a))

    @cached_property
    def _on_road(self) -> Any:
        """The invariants of q and of the doubled acceleration, with doubled gravity and drag."""
        own: Any = self._vehicle
        vehicle = own._replace(gravity=2 * own.gravity, drag=2 * own.drag * self._pace if own.drag else 0)
        return RoadInvariants(Invariants([None, self._own.r[1], self._doubled()], vehicle=vehicle).on_road)

    def _load(self, side: int, limit: Any) -> AnyClaim:
        """Return the claim that the normal load satisfies its limit."""
        i: Any = self._on_road
        slack = side * ((i.v * i.contact.level) * (2 * limit) - i.contact.onto * i.vehicle.mass)
        return Claim(slack) if self.roots is None else Enclosed(at_bounds(slack, self.roots[:2]), self.roots[:2])

    def _road(self, name: str, limit: Any, allows_zero: bool) -> AnyClaim:
        i: Any = self._on_road
        entry: Any = quantity(name)
        if name == "friction":
            slack, load = (limit * limit) * entry.denominator(i) - entry.numerator(i), i.contact.onto
            if self.roots is None:
                return all_of([Claim(slack), Claim(load)])
            own = self.roots[:2]
            return Enclosed([*at_bounds(slack, own), *at_bounds(load, own)], self.roots[:1])
        power = entry.side * power_numerator(i)
        limit = entry.side * limit
        if self.roots is not None:
            S, H, a = self.roots
            values = [
                2 * limit * h - self._times_factor(root) * p
                for h, root in itertools.product((H.low, H.high), (a.low, a.high))
                for p in at_bounds(power, (S, H._replace(low=h, high=h)))
            ]
            return Enclosed(values, self.roots)
        slack = 4 * (limit * limit) * i.H - power * power * self._pace
        return any_of([Claim(-power), Claim(slack)]) if allows_zero else all_of([Claim(-power), Claim(-slack)])
