"""Limits on formulas that are linear in the acceleration, as bounds on the acceleration along the path.

At a point of a path with the direction τ, the acceleration is Aτ + a·n. A is that along the path, a = u̇², and n is the
part of r'' across it. So such a formula is c·A + d·a.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from qtraj.algebra import jets
from qtraj.design.timing.formula_limits import SIGNED, SQUARE
from qtraj.design.timing.formulas import Formulas
from qtraj.path import formula as formulas
from qtraj.path.frenet import Invariants
from qtraj.path.own_facts import is_linear
from qtraj.path.quantity import quantity

ROUNDED = 1e-12
"""Coefficients c and d below this fraction of their largest possible values consist of rounding errors."""


class LinearLimits(NamedTuple):
    """Limits c·A + d·a ≤ `most`, where `along` is c and `across` is d.

    A is `steady`·a + `rising`·a'.
    """

    along: Float[Any, "rows * nodes"]
    across: Float[Any, "rows * nodes"]
    most: Float[Any, "rows * nodes"]
    steady: Float[Any, "*nodes"]
    rising: Float[Any, "*nodes"]

    def accelerations(self, inverse: Float[Any, "*nodes"]) -> tuple[Any, Any]:
        """Return upper bounds on A and on −A, or infinity, for all a up to 1/`inverse`; `inverse` may be 0."""
        highest = np.divide(1.0, inverse, out=np.full(np.shape(inverse), np.inf), where=inverse > 0)
        gained = np.multiply(self.across, highest, out=np.zeros(self.across.shape), where=self.across < 0)
        rest = self.most - gained
        each = []
        for sign in (1.0, -1.0):
            c = sign * self.along
            bounds = np.divide(rest, c, out=np.full(rest.shape, np.inf), where=c > 0)
            each.append(np.min(bounds, axis=0, initial=np.inf))
        return each[0], each[1]

    def sides(self) -> Float[Any, "rows 3 *nodes"]:
        """Return the coefficients of 1, a and a' in functions that are at most 1, as in `Constraints.sides`.

        They are relative to the limits, except those that are not positive.
        """
        known = np.isfinite(self.most)
        most = np.where(known, self.most, 1.0)
        unit = np.where(most > 0, most, 1.0)
        rows = (self.across + self.along * self.steady, self.along * self.rising)
        return np.stack([1.0 - most / unit, *(np.where(known, x / unit, 0.0) for x in rows)], 1)


def linear_limits(f: Formulas) -> LinearLimits:
    """Return the limits on formulas that are linear in the acceleration and are not lower bounds on magnitudes."""
    ahead, second, half = f.motion[:3]
    square = np.sum(ahead * ahead, axis=0)
    direction = ahead / np.sqrt(np.where(square > 0, square, 1.0))
    steady = np.sum(direction * second, axis=0)
    normal = second - steady * direction
    along, across, most = [], [], []
    for k, (name, kind) in enumerate(zip(f.names, f.kinds, strict=True)):
        entry = quantity(name)
        if kind not in (SIGNED, SQUARE) or not is_linear(entry):
            continue
        c, d = (_value(entry, direction, x, f.vehicle) for x in (direction, normal))
        size = np.sqrt(np.sum(second * second, axis=0)) * np.max(np.abs(c), initial=0.0)
        d = np.where(np.abs(d) > ROUNDED * size, d, 0.0)
        bent = np.sqrt(np.sum(normal * normal, axis=0))
        size = np.max(np.abs(np.divide(d, bent, out=np.zeros(d.shape), where=bent > 0)), initial=np.max(np.abs(c)))
        c = np.where(np.abs(c) > ROUNDED * size, c, 0.0)
        limit = _most(f, k)
        for sign in (entry.side,) if kind == SIGNED else (1, -1):
            along.append(sign * c)
            across.append(sign * d)
            most.append(limit)
    c, d, limit = (np.reshape(x, (len(x), *square.shape)) for x in (along, across, most))
    return LinearLimits(c, d, limit, steady, np.sum(direction * half, axis=0))


def _value(entry: Any, velocity: Any, acceleration: Any, vehicle: Any) -> Any:
    """Return the value of a formula for a velocity and an acceleration."""
    i = Invariants([None, tuple(velocity), tuple(acceleration)], None, vehicle, jets.sqrt)
    return formulas.value(entry.own.formula, i) + np.zeros(velocity.shape[1:])


def _most(f: Formulas, k: int) -> Float[np.ndarray, "*nodes"]:
    """Return the limit on the signed value, infinite where the constraint is omitted."""
    factor = np.asarray(f.factors[k])
    inverse = np.divide(1.0, factor, out=np.full(factor.shape, np.inf), where=factor > 0)
    if f.kinds[k] == SQUARE:
        return np.sqrt(f.scale[k]) * inverse
    return np.where(
        np.isfinite(f.scale[k]), f.scale[k] * inverse - np.where(np.isfinite(f.scale[k]), f.shift[k], 0.0), np.inf
    )
