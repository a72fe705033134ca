"""Evaluate the constraints on a = u̇² and its derivatives, with their derivatives (see `constraints`).

All functions accept NumPy and JAX arrays, except `second_derivatives`, which needs NumPy arrays.
"""

from typing import Any

import numpy as np
from jaxtyping import Float

from qtraj.design.timing import road
from qtraj.design.timing.constraints import POWERS, UPPER, Constraints, Parts
from qtraj.design.timing.forms import symmetric
from qtraj.design.timing.road import ROAD
from qtraj.foundation.namespace import namespace

Gradients = Float[Any, "count orders *nodes"]
"""For each constraint, the derivatives with respect to a = u̇², a' and, with a limit on the jerk, a''."""


def tightened(c: Constraints, factors: Float[Any, "count *nodes"]) -> Constraints:
    """Return the same constraints with their limits divided by `factors`."""
    own = None if c.road is None else road.tightened(c.road, factors[c.before_road :])
    forms = factors[1 : 1 + len(c.forms), None, None] ** 2
    own_sides = factors[1 + len(c.forms) : c.before_combined]
    sides, bends, combined = own_sides[:, None], c.bends, c.combined
    bends = None if bends is None else bends.scaled(own_sides)
    if combined is not None:
        combined = combined._replace(factor=combined.factor * factors[c.before_combined])
    jerk = None if c.jerk is None else c.jerk * factors[c.before_jerk : c.before_formulas, None, None] ** 2
    formulas = None if c.formulas is None else c.formulas.tightened(factors[c.before_formulas : c.before_road])
    return Constraints(c.upper * factors[0], c.forms * forms, c.sides * sides, jerk, own, bends, combined, formulas)


def squares(p: Parts) -> np.ndarray:
    """Return the power of a factor with which each constraint is multiplied if its limit is divided by the factor."""
    quadratic = (p.combined is not None) + (0 if p.jerk is None else len(p.jerk))
    formulas = [] if p.formulas is None else p.formulas.powers.tolist()
    road = [] if p.road is None else [1.0] * len(ROAD)
    return np.array([1.0] + [2.0] * len(p.forms) + [1.0] * len(p.sides) + [2.0] * quadratic + formulas + road)


def used(p: Parts, v: Float[Any, "orders *nodes"]) -> Float[Any, "limits *nodes"]:
    """Return each quantity divided by its limit in the order of `NAMES`, or a divided by its bound for `UPPER`.

    `v` contains a = u̇² and its derivatives with respect to the path parameter.
    """
    xp = namespace(v, p.upper)
    on_road = [] if p.road is None else road.used(p.road, v)
    upper = p.upper * xp.maximum(v[0], 0.0)[None]
    forms, *jerk = (xp.sqrt(xp.maximum(x, 0.0)) for x in _squares(p, v))
    combined = [] if p.combined is None else [p.combined.used(v)[None]]
    formulas = [] if p.formulas is None else [p.formulas.used(v)]
    return xp.concatenate([upper, forms, _of_sides(p, v), *combined, *jerk, *formulas, *(x[None] for x in on_road)])


def ratios(found: Float[Any, "limits *nodes"], rows: tuple[str, ...]) -> Float[Any, "limits *nodes"]:
    """Convert the result of `used` to ratios of quantities to their limits; `rows` are the names of its rows."""
    linear = [name in UPPER and POWERS[name] < 1 for name in rows]
    xp = namespace(found)
    return xp.stack([xp.sign(x) * xp.sqrt(abs(x)) if root else x for x, root in zip(found, linear, strict=True)])


def values(c: Constraints, v: Float[Any, "orders *nodes"]) -> Float[Any, "count *nodes"]:
    """Return the constraint values, which must not be positive."""
    on_road = [] if c.road is None else [x[None] for x in road.values(c.road, v)]
    upper, (forms, *jerk) = (c.upper * v[0])[None], _squares(c, v)
    own = [x - 1 for x in (upper, forms, *([_of_sides(c, v)] if len(c.sides) else []))]
    combined = [] if c.combined is None else [c.combined.value(v)[None]]
    formulas = [] if c.formulas is None else [c.formulas.values(v)]
    return namespace(v, c.upper).concatenate([*own, *combined, *(x - 1 for x in jerk), *formulas, *on_road])


def gradients(c: Constraints, v: Float[Any, "orders *nodes"]) -> Gradients:
    """Return the gradients of `values` with respect to the components of v = (a, a', a''), where a = u̇²."""
    xp = namespace(v, c.upper)
    zero = xp.zeros_like(v[:1] * c.upper[None])
    found = [xp.concatenate([c.upper[None], *[zero] * (c.orders - 1)])[None]]
    flat = [2 * _products(xp, c.forms, v)]
    if len(c.sides):
        sides = c.sides[:, 1:] + 0.0 * v[0][None, None]
        if c.bends is not None:
            sides[:, 0] += c.bends.values(v[0])[1]
        flat.append(sides)
    if c.combined is not None:
        flat.append(xp.stack(c.combined.gradient(v))[None])
    found += flat if c.orders == 2 else [xp.concatenate([x, xp.zeros_like(x[:, :1])], axis=1) for x in flat]
    if c.jerk is not None:
        slope = _products(xp, c.jerk, v)
        own = 2 * v[0][None, None] * slope
        found.append(
            xp.concatenate([own[:, :1] + xp.einsum("ki...,i...->k...", slope, v)[:, None], own[:, 1:]], axis=1)
        )
    if c.formulas is not None:
        own = c.formulas.gradients(v)
        more = [np.zeros_like(own[:, :1])] * (c.orders - own.shape[1])
        found.append(np.concatenate([own, *more], axis=1))
    if c.road is not None:
        more = [] if c.orders == 2 else [zero[0]]
        found += [xp.stack([*x, *more])[None] for x in road.gradients(c.road, v)]
    return xp.concatenate(found)


def second_derivatives(
    c: Constraints,
    slope: Gradients,
    v: Float[Any, "orders *nodes"],
    multipliers: Float[Any, "count *nodes"],
    ratio: Float[Any, "count *nodes"],
    a: Float[Any, "*nodes"],
) -> Float[Any, "orders orders *nodes"]:
    """Return Σ multiplier·(second derivatives) + ratio·gradient·gradientᵀ; `a` > 0, and `slope` are the gradients.

    The derivatives are with respect to v = (a, a', a''), where a = u̇². The jerk constraint is |y|² ≤ 1, y = √a·w, with
    w linear in v. Replacing 1/√a by its tangent leaves the second derivatives 2YᵀY, where Y is the Jacobian of y.
    """
    found = np.einsum("ci...,cj...->ij...", ratio[:, None] * slope, slope)
    count = c.forms.shape[0]
    if c.bends is not None:
        rows = multipliers[1 + count : c.before_combined]
        found[0, 0] += np.sum(rows * np.maximum(c.bends.values(v[0])[2], 0.0), axis=0)
    if c.combined is not None:
        found[:2, :2] += multipliers[c.before_combined] * symmetric(np.stack(c.combined.second(v)))
    found[:2, :2] += np.einsum("f...,fij...->ij...", 2 * multipliers[1 : 1 + count], c.forms)
    if c.jerk is not None:
        last = multipliers[c.before_jerk : c.before_formulas]
        own = np.einsum("k...,ki...->i...", last, _products(np, c.jerk, v))
        found += np.einsum("k...,kij...->ij...", 2 * last * v[0][None], c.jerk)
        found[0] += own
        found[:, 0] += own
        found[0, 0] += np.einsum("i...,i...->...", own, v) / (2 * a)
    if c.formulas is not None:
        own = c.formulas.second_derivatives(v, multipliers[c.before_formulas : c.before_road])
        found[: len(own), : len(own)] += own
    if c.road is not None:
        found[:2, :2] += symmetric(np.stack(road.second_derivatives(c.road, multipliers[c.before_road :])))
    return found


def changes(slope: Gradients, dv: Float[Any, "orders *nodes"]) -> Float[Any, "count *nodes"]:
    """Return the changes of the linearised constraint values for the changes `dv` of a and its derivatives."""
    return namespace(slope, dv).einsum("ci...,i...->c...", slope, dv)


def weighted(slope: Gradients, weights: Float[Any, "count *nodes"]) -> Float[Any, "orders *nodes"]:
    """Return the weighted sums of the gradients."""
    return namespace(slope, weights).einsum("ci...,c...->i...", slope, weights)


def _squares(c: Constraints | Parts, v: Float[Any, "orders *nodes"]) -> list[Float[Any, "some *nodes"]]:
    """Return the squares of the quantities of the forms, divided by their limits, and that of the jerk."""
    xp = namespace(v, c.upper)
    forms = xp.einsum("fi...,i...->f...", _products(xp, c.forms, v), v[:2])
    if c.jerk is None:
        return [forms]
    return [forms, v[0][None] * xp.einsum("ki...,i...->k...", _products(xp, c.jerk, v), v)]


def _of_sides(c: Constraints | Parts, v: Float[Any, "orders *nodes"]) -> Float[Any, "sides *nodes"]:
    """Return the functions of the limits on one side."""
    affine = c.sides[:, 0] + c.sides[:, 1] * v[0][None] + c.sides[:, 2] * v[1][None]
    return affine if c.bends is None else affine + c.bends.values(v[0])[0]


def _products(xp: Any, forms: Float[Any, "forms n n *nodes"], v: Any) -> Float[Any, "forms n *nodes"]:
    return xp.einsum("fij...,j...->fi...", forms, v[: forms.shape[1]])
