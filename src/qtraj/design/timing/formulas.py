"""Limits on formulas of the motion, as constraints on a = u̇² and its derivatives: own quantities, sides of the power.

The formula of the registry is evaluated with jets in (a, a', a''), so it needs no derivation of its own. With the shape
fixed, velocity, acceleration and jerk are functions of these three numbers (see `constraints`). A formula that contains
only the velocity and v × r̈ is a power of a, so its limit is an upper bound on a. All others may be nonconvex: the
Hessian of the Lagrangian then omits their negative curvature, as for the power (see `road`).
"""

from collections.abc import Mapping
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

from qtraj.algebra import jets
from qtraj.algebra.jets import Jet
from qtraj.design.ellipse import OfSpeed
from qtraj.design.one_sided import scale_and_shift
from qtraj.design.timing.formula_limits import (
    LOWER_SQUARE,
    SIGNED,
    SQUARE,
    UPPER_BOUND,
    exponent,
    kind_of,
    of_lower,
    own_names,
)
from qtraj.design.timing.road import POWER_SIDES
from qtraj.path.frenet import Invariants
from qtraj.path.quantity import quantity
from qtraj.path.road_parameters import RoadParameters

STANDS = 1e-30
"""The value of a = u̇² for the direction of motion where the vehicle is at rest."""

HARDLY = 1e-8
"""The velocity of the path where it is zero, relative to its maximum, for the direction of motion there."""


class Formulas(eqx.Module):
    """The limits on formulas at all nodes, which are the last axes of all arrays.

    `motion` contains the velocity divided by √a, which has the direction of motion where it is zero, and the
    coefficients of a and a' in the acceleration, and of a, a' and a'' in the jerk divided by √a. The value x of a
    signed quantity is imposed as (±x + shift)/scale ≤ 1, and others by their squares. `upper` are the inverses of the
    upper bounds on a, or 0, and `factors` those by which limits are tightened.
    """

    names: tuple[str, ...] = eqx.field(static=True)
    kinds: tuple[str, ...] = eqx.field(static=True)
    third: bool = eqx.field(static=True)
    motion: Float[Any, "6 3 *nodes"]
    vehicle: Any
    scale: Float[Any, "rows * nodes"]
    shift: Float[Any, "rows * nodes"]
    upper: Float[Any, "rows * nodes"]
    factors: Float[Any, "rows * nodes"]

    def __len__(self) -> int:
        return len(self.names)

    @property
    def highest(self) -> Float[Any, "*nodes"]:
        """1/a for the upper bound on a = u̇² of all limits; 0 without a bound."""
        rows = [x for x, kind in zip(self.upper, self.kinds, strict=True) if kind == UPPER_BOUND]
        return np.max([np.zeros(self.motion.shape[2:]), *rows], axis=0)

    @property
    def powers(self) -> np.ndarray:
        """The power of a factor with which each constraint is multiplied if its limit is divided by the factor."""
        of_kind = {SIGNED: 1.0, SQUARE: 2.0, LOWER_SQUARE: 1.0}
        return np.array([of_kind.get(k) or 1 / exponent(n) for n, k in zip(self.names, self.kinds, strict=True)])

    def tightened(self, factors: Float[Any, "rows * nodes"]) -> "Formulas":
        """Return the same constraints with their limits divided by `factors`."""
        return eqx.tree_at(lambda x: x.factors, self, self.factors * factors)

    def without(self, omitted: Any) -> "Formulas":
        """Return the same constraints, which are always satisfied at the nodes where `omitted` is true."""
        return eqx.tree_at(lambda x: x.factors, self, np.where(omitted, 0.0, self.factors))

    def used(self, v: Float[Any, "orders * nodes"]) -> Float[Any, "rows * nodes"]:
        """Return the ratio of each quantity to its limit, or the imposed function for a limit on one side."""
        found = self._rows(v, 0)
        rows = []
        for x, name, kind in zip(found, self.names, self.kinds, strict=True):
            if kind == UPPER_BOUND:
                x = np.sign(x) * np.abs(x) ** exponent(name)
            rows.append(np.sqrt(np.maximum(x, 0.0)) if kind == SQUARE else x)
        return np.stack(rows)

    def values(self, v: Float[Any, "orders * nodes"]) -> Float[Any, "rows * nodes"]:
        """Return the constraint values, which must not be positive."""
        powers = self.powers.reshape(-1, *(1,) * (v.ndim - 1))
        return np.where(self.factors > 0, self.factors**powers * np.stack(self._rows(v, 0)), 0.0) - 1

    def gradients(self, v: Float[Any, "orders * nodes"]) -> Float[Any, "rows orders *nodes"]:
        """Return the gradients of `values` with respect to the components of v."""
        rows = [x.gradient for x in self._rows(v, 1)]
        return self._weights(v.ndim - 1)[:, None] * np.stack(rows)

    def second_derivatives(
        self, v: Float[Any, "orders * nodes"], multipliers: Float[Any, "rows * nodes"]
    ) -> Float[Any, "orders orders *nodes"]:
        """Return Σ multiplier·(second derivatives), without the part that is not positive semidefinite.

        A quantity per second^k is a^p w with p = (k − 2)/2, where w is linear or convex for accelerations, jerks and
        the power. As for the jerk in `constraints`, the second derivatives of the power a^p are omitted.
        """
        v = v[: 3 if self.third else 2]
        n, weights = len(v), multipliers * self._weights(v.ndim - 1)
        total = np.zeros((n, n, *v.shape[1:]))
        for x, weight, name, kind in zip(self._rows(v, 2), weights, self.names, self.kinds, strict=True):
            power = 0.5 * quantity(name).per_time - 1.0
            total += weight * np.nan_to_num(_convexified(x, v, power if kind == SIGNED else 2 * power, kind == SQUARE))
        sizes, directions = np.linalg.eigh(np.moveaxis(total, (0, 1), (-2, -1)))
        convex = (directions * np.maximum(sizes, 0.0)[..., None, :]) @ np.swapaxes(directions, -1, -2)
        return np.moveaxis(convex, (-2, -1), (0, 1))

    def _weights(self, ndim: int) -> Float[Any, "rows * nodes"]:
        powers = self.powers.reshape(-1, *(1,) * ndim)
        return np.where(self.factors > 0, self.factors**powers, 0.0)

    def _rows(self, v: Float[Any, "orders * nodes"], order: int) -> list[Any]:
        """Return the imposed functions: as arrays for `order` 0, and as jets of order 1 or 2."""
        v = v[: 3 if self.third else 2]
        if order == 0:
            variables: list[Any] = list(v)
        else:
            variables = jets.coordinates(v)
            variables = [Jet(x.value, x.gradient, None) for x in variables] if order == 1 else variables
        i = None
        rows = []
        for k, (name, kind) in enumerate(zip(self.names, self.kinds, strict=True)):
            if kind == UPPER_BOUND:
                rows.append(variables[0] * self.upper[k])
                continue
            i = i or self._invariants(variables)
            x = _ratio(quantity(name), i)
            sign = quantity(name).side if kind == SIGNED else -1 if kind == LOWER_SQUARE else 1
            rows.append((x * sign + self.shift[k]) * (1 / self.scale[k]))
        return [_full(x, v) for x in rows] if order else [x + 0.0 * v[0] for x in rows]

    def _invariants(self, variables: list[Any]) -> Invariants:
        a, slope, *bend = variables
        stands = (a.value if isinstance(a, Jet) else a) <= 0
        root = jets.sqrt(jets.replaced(a, stands, STANDS))
        ahead, second, along, third, mixed, last = self.motion
        velocity, acceleration = (tuple(x * y for y in row) for x, row in ((root, ahead), (a, second)))
        acceleration = tuple(x + slope * y for x, y in zip(acceleration, along, strict=True))
        rows = [None, velocity, acceleration]
        if bend:
            each = zip(third, mixed, last, strict=True)
            rows.append(tuple(root * (a * x + slope * y + bend[0] * z) for x, y, z in each))
        return Invariants(rows, None, self.vehicle, jets.sqrt)


def formulas_of(
    r: Float[Any, "3 3 *nodes"],
    ahead: tuple[Any, ...],
    unit: Any,
    bounds: Mapping[str, Any],
    vehicle: RoadParameters | None,
) -> Formulas | None:
    """Return the limits on formulas, from r', r'' and r''' at the nodes; None if `bounds` contains none.

    `ahead` is r', or has the direction of motion where r' is zero. Derivatives of a = u̇² are with respect to u/`unit`.
    """
    names = tuple(name for name in POWER_SIDES if name in bounds and vehicle is not None) + own_names(bounds)
    if not names:
        return None
    r, nodes = np.asarray(r), r.shape[2:]
    r1, r2, r3 = r
    half = 0.5 / unit
    moving = np.all(r1 == np.stack(ahead), axis=0)
    size = np.sqrt(np.sum(np.square(ahead), axis=0))
    small = HARDLY * np.sqrt(np.max(np.sum(r1 * r1, axis=0))) / np.where(size > 0, size, 1.0)
    motion = np.stack(
        [np.where(moving, r1, small * np.stack(ahead)), r2, half * r1, r3, 3 * half * r2, half / unit * r1]
    )
    own = None if vehicle is None else vehicle.each(lambda x: np.broadcast_to(np.asarray(x, float), nodes))
    kinds = tuple(kind_of(name, bounds[name]) for name in names)
    numbers = {name: x for name, x in bounds.items() if not isinstance(x, OfSpeed)}
    pairs = [_scale_and_shift(name, kind, numbers) for name, kind in zip(names, kinds, strict=True)]
    scale, shift = (
        np.stack([np.broadcast_to(np.asarray(x, float), nodes) for x in y]) for y in zip(*pairs, strict=True)
    )
    none = np.zeros((len(names), *nodes))
    found = Formulas(names, kinds, any(quantity(x).order > 2 for x in names), motion, own, scale, shift, none, none + 1)
    return eqx.tree_at(lambda x: x.upper, found, _upper(found, moving))


def _upper(f: Formulas, moving: Any) -> Float[np.ndarray, "rows * nodes"]:
    """Return 1/a for the a = u̇² at which each limit of the kind `UPPER_BOUND` is reached; negative on the other one."""
    rows = np.zeros(f.scale.shape)
    if UPPER_BOUND not in f.kinds:
        return rows
    one = np.ones(rows.shape[1:])
    i = f._invariants([one, 0 * one, *([0 * one] if f.third else [])])
    for k, (name, kind) in enumerate(zip(f.names, f.kinds, strict=True)):
        if kind == UPPER_BOUND:
            entry = quantity(name)
            x = _ratio(entry, i)
            x = entry.side * x if entry.signed is not None else np.sqrt(np.maximum(x, 0.0))
            x = x / f.scale[k]
            rows[k] = np.where(moving, np.sign(x) * np.abs(x) ** (1 / exponent(name)), 0.0)
    return rows


def _scale_and_shift(name: str, kind: str, bounds: Mapping[str, Any]) -> tuple[Any, Any]:
    bound = np.asarray(bounds[name])
    if kind == SQUARE:
        return bound**2, 0.0
    if kind == LOWER_SQUARE:
        return of_lower(bound)
    return scale_and_shift(name, bounds) if quantity(name).signed is not None else (bound, 0.0)


def _ratio(entry: Any, i: Invariants) -> Any:
    """Return the value of a signed quantity, or the square of another one; 0 where it does not exist."""
    numerator = entry.numerator(i)
    if entry.denominator is None:
        return numerator
    denominator = entry.denominator(i)
    zero = ~((denominator.value if isinstance(denominator, Jet) else denominator) > 0)
    return jets.replaced(numerator, zero, 0.0) / jets.replaced(denominator, zero, 1.0)


def _convexified(x: Jet, v: Any, power: float, square: bool) -> Any:
    """Return the second derivatives of x = a^power·m without those of the power; those of a square keep it convex."""
    if not power:
        return x.hessian
    stands = v[0] <= 0
    a = jets.replaced(jets.variables(v)[0], stands, 1.0)
    scale = a.apply(a.value**power, power * a.value ** (power - 1), power * (power - 1) * a.value ** (power - 2))
    m = x * scale.reciprocal()
    found = scale.value * m.hessian
    if square:
        mixed = m.gradient[:, None] * scale.gradient
        own = scale.gradient[:, None] * scale.gradient
        found = found + 0.5 * (mixed + mixed.swapaxes(0, 1) + m.value / scale.value * own)
    return np.where(stands, 0.0, found)


def _full(x: Any, v: Any) -> Jet:
    """Return a jet whose arrays have all axes of the nodes."""
    n, nodes = v.shape[0], v.shape[1:]
    hessian = None if x.hessian is None else np.broadcast_to(x.hessian, (n, n, *nodes))
    return Jet(np.broadcast_to(x.value, nodes), np.broadcast_to(x.gradient, (n, *nodes)), hessian)
