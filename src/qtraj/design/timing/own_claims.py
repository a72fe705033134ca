"""Claims about quantities of the user's own on a retimed path (see `cell_claims`).

With a = u̇², the velocity is √a r', the acceleration a r'' + ½ a' r', and the jerk √a (a r''' + 3/2 a' r'' + ½ a'' r').
So the formulas contain the root √a, besides their own roots. A formula that the length of the velocity does not change
is computed from the factor q of r' (see `directions`), which does not vanish at a stop, and without √a.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from typing import Any

from qtraj.algebra.surd import Claim
from qtraj.design.proof.limit_claims import RootedInvariants
from qtraj.design.proof.sources import Derivatives
from qtraj.design.timing.cell_motions import Motion
from qtraj.path.formula import evaluated
from qtraj.path.own_facts import Guard, velocities
from qtraj.path.path_quantity import PathQuantity

Constant = Callable[[Any], Any]
"""Converts a dyadic number to a constant polynomial."""


class OwnClaims:
    """The claims about a motion; the parameters of `vehicle` are constant polynomials in the units of the motion."""

    def __init__(self, motion: Motion, vehicle: Any, constant: Constant):
        self._motion, self._vehicle, self._constant = motion, vehicle, constant

    def within(self, entry: PathQuantity, limit: Any) -> Claim:
        """Return the claim that a quantity satisfies its `limit`, a constant polynomial or one in the cell."""
        i = self._of(entry)
        numerator, bound = entry.numerator(i), limit if entry.signed else limit * limit
        scaled = bound if entry.denominator is None else bound * entry.denominator(i)
        return self._claim(numerator - scaled if entry.lower else scaled - numerator)

    def guard(self, entry: PathQuantity, guard: Guard, sign: int) -> Claim:
        """Return the claim that a factor, multiplied by `sign`, is not negative; for a divisor, it must be positive."""
        x = evaluated(guard.factor, self._of(entry))
        return self._claim(x if sign > 0 else -x)

    def _of(self, entry: PathQuantity) -> RootedInvariants:
        formula = entry.own.formula
        return self._of_direction if formula.degree(velocities) == 0 else self._whole

    @cached_property
    def _whole(self) -> RootedInvariants:
        return self._invariants(lambda root: tuple(root * x for x in self._motion.path[0]))

    @cached_property
    def _of_direction(self) -> RootedInvariants:
        return self._invariants(lambda _: self._motion.ahead[0])

    def _invariants(self, velocity: Callable[[Any], Any]) -> RootedInvariants:
        m, half = self._motion, self._constant(Fraction(1, 2))
        r1, r2, *more = m.path
        acceleration = tuple(m.a * y + half * (m.slope * x) for x, y in zip(r1, r2, strict=True))
        i = RootedInvariants(Derivatives([None, r1, acceleration]), self._vehicle, self._constant)
        root = i.root(m.a)
        i.r = [None, velocity(root), acceleration]
        if more:
            each = zip(r1, r2, more[0], strict=True)
            i.r.append(tuple(root * (m.a * z + half * (3 * (m.slope * y)) + half * (m.bend * x)) for x, y, z in each))
        return i

    def _claim(self, number: Any) -> Claim:
        claim = Claim(self._constant(number) if isinstance(number, int) else number)
        claim.polynomials = [self._constant(p) if isinstance(p, int) else p for p in claim.polynomials]
        return claim
