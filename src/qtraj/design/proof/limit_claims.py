"""Limits as claims: limit² · denominator − numerator is not negative, and the divisor of the quantity is positive.

The formulas are those of the registry, over polynomials; signed quantities and those of a vehicle on a road also
contain the roots √S of the squared speed and √H of the squared horizontal speed (see `algebra.surd`).
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from qtraj.algebra.combined_claims import AnyClaim
from qtraj.algebra.radical import RadicalSum
from qtraj.algebra.sparse import is_one, is_zero, mul
from qtraj.algebra.surd import Claim, Surd
from qtraj.design.proof import speed_claims
from qtraj.design.proof.sources import Derivatives
from qtraj.foundation.namespace import xp
from qtraj.path.contact import Contact, upward_force
from qtraj.path.formula import evaluated
from qtraj.path.frenet import Invariants
from qtraj.path.gravity_quantities import bank_divisor, force_divisor
from qtraj.path.own_facts import Guard
from qtraj.path.path_quantity import FORCE, LOAD, ROAD_FRAME, UPRIGHT_FORCE, VEHICLE, PathQuantity
from qtraj.path.regularity import cross_norm_squares

MIN_RELATIVE_DIVISOR = 1e-9
"""A divisor counts as zero if its relative size is below this value.

The speed is compared with the largest speed of the path, and the other divisors as in `regularity`.
"""

DIVISORS = {"speed": "S", "cross_norm": "N", "level": "H"}
"""The invariants that are the squares of divisors; the load on the road has a formula instead."""

DIVISOR_ORDER = {"speed": 1, "cross_norm": 2, "level": 1, LOAD: 2, FORCE: 2, UPRIGHT_FORCE: 2, ROAD_FRAME: 1}
"""The order of the highest derivative that is needed for each divisor and for its relative size."""

UPRIGHT_DIVISORS = ("level", LOAD, FORCE, UPRIGHT_FORCE, ROAD_FRAME)
"""The divisors that depend on the vertical."""


class Bound(NamedTuple):
    """A limit as a polynomial, in the units of the derivatives, and the factor of the quantity or None.

    For a limit that depends on the speed, it is the limit itself, and a function that returns constant polynomials.
    """

    limit: Any
    factor: Any = None
    constant: Any = None


class RootedInvariants(Invariants):
    """Invariants that are polynomials, with the roots v = √S and h = √H for signed quantities.

    Quantities of one's own contain other roots and numbers, which `constant` converts to polynomials.
    """

    def __init__(self, derivatives: Derivatives, vehicle: Any, constant: Callable[[Any], Any]):
        radicands: list[Any] = []
        root = lambda square: RadicalSum.root(square, radicands)  # noqa: E731
        super().__init__(derivatives.rows, derivatives.up, vehicle, root, derivatives.pace)
        self._constant = constant

    def number(self, x: Fraction) -> Any:
        """Return a dyadic number as a polynomial."""
        return self._constant(x)

    @cached_property
    def v(self) -> Any:
        """The speed v = √S."""
        return Surd((0, 1, 0, 0), (self.S, self.H))

    @cached_property
    def h(self) -> Any:
        """The horizontal speed h = √H."""
        return Surd((0, 0, 1, 0), (self.S, self.H))


class RoadInvariants:
    """The invariants in the formulas of `contact`, which may contain the roots v = √S and h = √H."""

    def __init__(self, i: Invariants):
        squares = i.S, i.H
        for name in ("S", "H", "B", "P", "V", "W", "plumb_ahead", "plumb_above"):
            setattr(self, name, Surd((getattr(i, name), 0, 0, 0), squares))
        self.plumb, self.plumb_aside = i.plumb, Surd((i.plumb_aside, 0, 0, 0), squares)
        self._rational = i
        self.v, self.h = Surd((0, 1, 0, 0), squares), Surd((0, 0, 1, 0), squares)
        self.pace = i.pace if is_one(i.pace) else Surd((i.pace, 0, 0, 0), squares)
        self.vehicle = i.vehicle
        self.contact = Contact(self)

    @property
    def gravity(self) -> Any:
        """Gravity, in the units of the derivatives."""
        return self.vehicle.gravity

    @cached_property
    def Q(self) -> Surd:  # noqa: N802
        """The squared horizontal acceleration."""
        return Surd((self._rational.Q, 0, 0, 0), (self._rational.S, self._rational.H))

    @cached_property
    def upward_force(self) -> Any:
        """The specific force along the third axis of the frame, times v√H."""
        return upward_force(self)

    def root(self, square: Surd) -> Surd:
        """Return the root of a square without roots."""
        return Surd((0, 0, 1, 0), (self._rational.S, square.terms[0]))


class Formulas:
    """The claims about the paths with these derivatives, for a `vehicle` whose parameters are constant polynomials.

    `constant` converts a number to a constant polynomial. `window` are the start and the end of the part of [0, 1] that
    the claims are about; None means the whole path.
    """

    def __init__(
        self, derivatives: Derivatives, constant: Callable[[float], Any], vehicle: Any = None, window: Any = None
    ):
        if window is not None:
            derivatives = _restricted(derivatives, window)
        self._in_time = window is None and not is_one(derivatives.span)
        self._constant, self._threshold = constant, constant(MIN_RELATIVE_DIVISOR**2)
        self.span, self._squared_span = derivatives.span, 1
        if not is_one(self.span):
            self._squared_span = constant(self.span) * constant(self.span)
        self.invariants = RootedInvariants(derivatives, vehicle, constant)

    @cached_property
    def upright(self) -> RoadInvariants:
        """The invariants for quantities that contain gravity."""
        return RoadInvariants(self.invariants)

    @cached_property
    def road(self) -> RoadInvariants:
        """The invariants for forces, about the axis of the road."""
        own = self.invariants.on_road
        return self.upright if own is self.invariants else RoadInvariants(own)

    def within(self, entry: PathQuantity, bound: Bound) -> AnyClaim:
        """Return the claim that a quantity satisfies its limit."""
        i: Any = self.invariants
        if entry.gravity:
            i = self.road if entry.needs == VEHICLE else self.upright
        if bound.constant is not None:
            along, across, square = map(self._in_fraction, (i.B, i.N, i.S))
            speed = square if is_one(i.pace) else self._in_fraction(i.pace * i.pace * i.S)
            motion = speed_claims.Motion(along, across, square, speed)
            longitudinal = entry.base == "longitudinal_acceleration"
            return speed_claims.within(bound.limit, entry.side, longitudinal, motion, bound.constant)
        numerator = entry.numerator(i)
        if bound.factor is not None:
            numerator = bound.factor * bound.factor * numerator
        limit = bound.limit if entry.signed else bound.limit * bound.limit
        scaled = limit if entry.denominator is None else limit * entry.denominator(i)
        return self._claim(numerator - scaled if entry.lower else scaled - numerator)

    def divisor(self, name: str, fastest: Any) -> AnyClaim:
        """Return the claim that a divisor does not vanish: it must be positive.

        The load and the part of the specific force upwards must be positive, and the relative size of any other divisor
        must exceed `MIN_RELATIVE_DIVISOR`.
        `fastest` is the largest squared speed, as a constant polynomial.
        """
        if name == LOAD:
            return self._claim(self.road.contact.onto)
        if name == UPRIGHT_FORCE:
            return self._claim(bank_divisor(self.upright)[0])
        square, scale = sizes(name, self.invariants, fastest, self._squared_span)
        return self._claim(square - self._threshold * scale)

    def guard(self, guard: Guard, sign: Any, least: Any) -> Claim:
        """Return the claim that a guard of a quantity of one's own is satisfied.

        `least` is a value that a divisor, multiplied by the `sign` of its values, must exceed; both are constant
        polynomials.
        """
        x: Any = evaluated(guard.factor, self.invariants)
        return self._claim(sign * x - least if guard.divisor else x)

    def _claim(self, number: Any) -> Claim:
        """Return a claim about polynomials in u."""
        claim = Claim(number)
        claim.polynomials = [self._in_fraction(p) for p in claim.polynomials]
        return claim

    def _in_fraction(self, p: Any) -> Any:
        """Return a polynomial in u."""
        own = self._constant(float(p)) if isinstance(p, int) else p
        return own.substituted(self.span) if self._in_time else own


def _restricted(d: Derivatives, window: Any) -> Derivatives:
    """Return the derivatives as polynomials in the fraction of the window."""

    def of_window(p: Any) -> Any:
        if is_zero(p) or is_one(p):
            return p
        return (p if is_one(d.span) else p.substituted(d.span)).restricted(*window)

    rows = [None if row is None else tuple(map(of_window, row)) for row in d.rows]
    return d._replace(rows=rows, pace=of_window(d.pace))


def sizes(name: str, i: Any, fastest: Any, span: Any = 1) -> tuple[Any, Any]:
    """Return the square of a divisor other than the load, and the square to which it is compared.

    `span` is the square of the duration, or 1 if the derivatives are with respect to u, as those of `fastest` are.
    """
    if name == "speed":
        return mul(span, i.S), fastest
    if name in (FORCE, UPRIGHT_FORCE):
        return (force_divisor if name == FORCE else bank_divisor)(i)
    return cross_norm_squares(i, span) if name == "cross_norm" else (_level_square(name, i), i.S)


def _level_square(name: str, i: Any) -> Any:
    """Return the square of the horizontal speed, or of the component of the velocity normal to the axis of the road."""
    return i.on_road.H if name == ROAD_FRAME else i.H


def relative_sizes(name: str, i: Any, fastest: np.ndarray) -> np.ndarray:
    """Return the squared relative size of a divisor, from invariants that are numbers."""
    if name != LOAD:
        square, scale = sizes(name, i, fastest)
        return xp.where(scale > 0, square / xp.where(scale > 0, scale, 1.0), 0.0)
    p, load = i.vehicle, xp.maximum(i.contact.onto, 0.0)
    largest = 2 * (i.A + p.gravity * p.gravity) * (i.S * i.on_road.H)
    return xp.where(largest > 0, load * load / xp.where(largest > 0, largest, 1.0), 0.0)
