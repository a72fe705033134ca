"""Express limits on a motion r(u(t)) as constraints on a = u̇² and its derivatives with respect to u.

With the derivatives r', r'' and r''' of the path with respect to its parameter u, the motion has the

    velocity      √a r'
    acceleration  a r'' + ½ a' r'
    jerk          √a (a r''' + 3/2 a' r'' + ½ a'' r').

So limits on the speed, the lateral acceleration and the rates of rotation are upper bounds on a. The squares of the
longitudinal acceleration, of the yaw acceleration and of the acceleration are convex quadratic forms in (a, a'). The
square of the jerk is a·Q, where Q is a quadratic form in (a, a', a''). So a limit on the jerk is √Q ≤ limit/√a. This
inequality becomes convex if 1/√a is replaced by its tangent. Limits on friction and power need a vehicle (see `road`).

The last axes of every array index the nodes. Quadratic forms are represented by their symmetric matrices. All functions
accept NumPy and JAX arrays; `constraint_values` evaluates the constraints.
"""

import functools
from collections.abc import Collection
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from qtraj.design.ellipse import OfSpeed
from qtraj.design.timing import road
from qtraj.design.timing.by_speed import Combined, Curve, combined_of, stacked
from qtraj.design.timing.formula_limits import is_formula, own_names
from qtraj.design.timing.formulas import Formulas, formulas_of
from qtraj.design.timing.node_limits import FORMS, UPPER, AtNodes, of_forms, of_jerk, of_sides, of_upper
from qtraj.design.timing.road import LOADS, ON_ROAD, POWER_SIDES, ROAD, Road
from qtraj.design.timing.sided import SIDED, SLOWEST
from qtraj.foundation.namespace import namespace
from qtraj.foundation.types import Scalar
from qtraj.path.components import dot
from qtraj.path.pieces import BLOCK_SIZE
from qtraj.path.quantity import COMBINED, quantity
from qtraj.path.road_parameters import RoadParameters

NAMES = (*UPPER, *FORMS, *SIDED, COMBINED, "jerk", *POWER_SIDES, *ROAD)
"""Limits that depend on the timing. Arrays have this order, and omit absent limits; those on own quantities follow."""

POWERS = {name: 0.5 * quantity(name).per_time for name in NAMES if name not in (*ON_ROAD, SLOWEST, COMBINED)}
"""For each quantity an exponent p: if a = u̇² is multiplied by a constant k, the quantity is multiplied by k^p.

Friction, power and the load have no such exponent, because gravity does not depend on a. A lower bound on the speed has
none.
"""
POWERS[COMBINED] = 1.0

STANDING = 1e-8
"""|r'| below this fraction of its maximum is treated as zero, and so is |r''| there."""


def listed(bounds: Collection[str], vehicle: bool) -> tuple[str, ...]:
    """Return the names of the limits in `bounds`, in the order of the rows of arrays.

    Limits on own quantities precede those of `ROAD`. With a `vehicle`, the names include all of `ROAD`, even if
    `bounds` does not.
    """
    absent = ROAD if vehicle else (*ROAD, *POWER_SIDES)
    before = tuple(name for name in NAMES if name in bounds and name not in absent)
    return before + own_names(bounds) + (ROAD if vehicle else ())


def all_names(bounds: Collection[str]) -> tuple[str, ...]:
    """Return `NAMES` and the own quantities in `bounds`, the order of the statuses of proofs."""
    return (*NAMES, *own_names(bounds))


def uses_vehicle(names: Collection[str]) -> bool:
    """Return whether a limit needs the parameters of a vehicle."""
    return any(quantity(name).uses_vehicle for name in names)


class Constraints(NamedTuple):
    """Constraints on v = (a, a', a'') at all nodes: a·`upper` ≤ 1, `forms`(v) ≤ 1, a·`jerk`(v) ≤ 1, and others.

    Here a = u̇², and a prime denotes the derivative with respect to the path parameter u. There is one form for each
    limit of `FORMS` that is set. `sides` are the coefficients of 1, a and a' in functions that are at most 1, one for
    each limit of `SIDED` that is set. `jerk` has one form for each body with a limit on the jerk, and is None without
    one. `road` is None without a vehicle.
    """

    upper: Float[Any, "*nodes"]
    forms: Float[Any, "forms 2 2 *nodes"]
    sides: Float[Any, "sides 3 *nodes"]
    jerk: Float[Any, "jerks 3 3 *nodes"] | None = None
    road: Road | None = None
    bends: Curve | None = None
    combined: Combined | None = None
    formulas: Formulas | None = None

    @property
    def per_node(self) -> int:
        """Number of constraints at each node."""
        return self.before_road + (0 if self.road is None else len(ROAD))

    @property
    def before_road(self) -> int:
        """Number of constraints at each node without those of `road`."""
        return self.before_formulas + (0 if self.formulas is None else len(self.formulas))

    @property
    def before_formulas(self) -> int:
        """Number of constraints at each node up to those of `formulas`."""
        return self.before_jerk + (0 if self.jerk is None else len(self.jerk))

    @property
    def before_jerk(self) -> int:
        """Number of constraints at each node up to the jerk."""
        return self.before_combined + (self.combined is not None)

    @property
    def before_combined(self) -> int:
        """Number of constraints at each node that are the upper bound, the forms and the sides."""
        return 1 + len(self.forms) + len(self.sides)

    @property
    def orders(self) -> int:
        """Number of components of v that the constraints contain: a, a' and, if they contain the jerk, a''."""
        return 3 if self.jerk is not None or (self.formulas is not None and self.formulas.third) else 2


class Parts(NamedTuple):
    """The constraints before the upper bounds are combined; `upper` has one row for each limit."""

    upper: Float[Any, "uppers *nodes"]
    forms: Float[Any, "forms 2 2 *nodes"]
    sides: Float[Any, "sides 3 *nodes"]
    jerk: Float[Any, "jerks 3 3 *nodes"] | None = None
    road: Road | None = None
    bends: Curve | None = None
    combined: Combined | None = None
    formulas: Formulas | None = None

    def constraints(self, largest: Float[Any, "*nodes"]) -> Constraints:
        """Return the constraints with only the lowest upper bound on a at each node, at most `largest`."""
        xp = namespace(self.upper, largest)
        upper = functools.reduce(xp.maximum, self.upper, 1 / largest)
        upper = upper if self.road is None else xp.maximum(upper, self.road.upper)
        upper = upper if self.combined is None else xp.maximum(upper, self.combined.upper)
        upper = upper if self.formulas is None else xp.maximum(upper, self.formulas.highest)
        return Constraints(upper, *self[1:])


def parts(
    r: Float[Any, "3 3 *nodes"],
    unit: Scalar,
    bounds: dict[str, Scalar],
    vehicle: RoadParameters | None = None,
    before_stop: Any = False,
) -> Parts:
    """Compute the constraints on a = u̇² from `r`, the derivatives r', r'' and r''' at the nodes.

    The first axes of `r` are the order of the derivative and the component. Derivatives of a are with respect to
    u/`unit`. Limits on friction and power are included only with a `vehicle`. Where r' = 0, the motion ends if
    `before_stop` (nodes) is true, and starts otherwise.
    """
    xp = namespace(r, unit, *jax.tree.leaves((bounds, vehicle)))
    square, size = (dot(x, x) for x in (tuple(r[0]), tuple(r[1])))
    still = tuple(STANDING**2 * xp.max(x) for x in (square, size))
    changing = any(is_formula(name) or isinstance(x, OfSpeed) or np.ndim(x) for name, x in bounds.items())
    constant = vehicle is None and not changing
    if xp is not np or not constant or square.ndim > 1 or square.size <= BLOCK_SIZE:
        return _at_nodes(r, unit, bounds, vehicle, before_stop, still)
    found = []
    for start in range(0, square.size, BLOCK_SIZE):
        own = slice(start, start + BLOCK_SIZE)
        stops = before_stop[own] if np.ndim(before_stop) else before_stop
        found.append(_at_nodes(r[..., own], unit, bounds, None, stops, still))
    return jax.tree.map(lambda *x: np.concatenate(x, axis=-1), *found)


def _at_nodes(
    r: Float[Any, "3 3 *nodes"],
    unit: Scalar,
    given: dict[str, Any],
    vehicle: RoadParameters | None,
    before_stop: Any,
    still: tuple[Any, ...],
) -> Parts:
    """Compute the constraints at some of the nodes; up to `still`, the values of |r'|² and |r''|² count as zero."""
    by_speed: dict[str, Any] = {name: x for name, x in given.items() if isinstance(x, OfSpeed)}
    bounds = {name: x for name, x in given.items() if name not in by_speed}
    xp = namespace(r, unit, *bounds.values(), *(() if vehicle is None else vehicle.numbers))
    at = AtNodes(r, unit, before_stop, still[0], xp)
    load: tuple[Any, Any] = (0.0 * at.i.S, 0.0 * at.i.S)
    on_road = None
    if vehicle is not None:
        direction = xp.stack(at.ahead) * at.inv_ahead[None]
        # Where r' and r'' vanish, the direction of motion is unknown, so omit friction and power there.
        known = road.coefficients(direction, at.r2, at.i.v, at.half, vehicle, bounds)
        on_road = road.without(known, ~at.moving & (dot(at.r2, at.r2) <= still[1]))
        load = road.normal_load(direction, at.r2, vehicle) if set(LOADS) & set(bounds) else load
    sides, curves = of_sides(at, bounds, by_speed, load)
    return Parts(
        of_upper(at, bounds, by_speed),
        of_forms(at, bounds),
        sides,
        of_jerk(at, bounds, at.half / unit),
        on_road,
        stacked(curves, at.i.v),
        combined_of(by_speed[COMBINED], at.along, at.across, at.i.v) if COMBINED in by_speed else None,
        formulas_of(r, at.ahead, unit, given, vehicle) if any(map(is_formula, given)) else None,
    )
